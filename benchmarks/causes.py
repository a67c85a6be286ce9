# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare the causes in the reports of robots in motion with what happens without each of them.

Run as ``python benchmarks/causes.py``; ``--tasks 20`` for a first impression, ``--masks`` for
stacks whose tasks may move some joints only, and weigh their rows. A robot drives from
goal to goal. At random moments every limit of every joint, and every task above, is taken away in
turn: the robot gets a copy without the limit, the stack runs without the task, and the controller
goes on with the same demands until its command has settled; what it remembers of curvature never
grows beyond what it is at the moment. The share of the missing velocity that comes back, compared
with the same controller and all limits and tasks, is the true share of this cause. All that is
without acceleration limits: what comes back at once without them is the share of `accelerating`. A
true cause has at least a tenth.

*Found* are the true causes that the report names, as a share of all true ones. *Right* are the
named causes that are true, as a share of all named ones; in both, those within `MARGIN` of a tenth
are left out. A task that moves no joint of another one, nor any that tasks above couple to these,
is no cause: it changes damping only. That is so where no joint slows all. *Within 0.1* are the
shares, true or named, that differ by less than that, and *off by* is the largest difference. The
times are those of `TaskReport.causes` for all tasks of a cycle in which at least one task is
limited, when a report is read right after another one.
"""

import argparse
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace
from itertools import chain
import time
from typing import Any

from _robots import load_robot
import numpy as np
from scipy.sparse.csgraph import connected_components
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.report import Report
from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.control.velocity_limits import VelocityBounds
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation
import yaml

SEED, TASKS = 0, 500
NOTABLE = 0.1
# Shares nearer to that than this may be named or not.
MARGIN = 0.02
PERIOD = 0.01
# Duration of a run, times between two goals and between two moments [s].
RUN, STAY, PAUSE = 4.0, (0.5, 2.0), (0.1, 0.4)
ACCELERATIONS = None, 3.0, 8.0, 15.0
# A command has settled if it and the memory change by at most this in a number of cycles [rad/s or
# m/s, and relative].
STILL, SETTLED, CYCLES, MOST_CYCLES = 1e-9, 1e-6, 5, 2000
# How often a task leaves out some joints, and has weights of its rows.
MASKED, WEIGHTED = 0.6, 0.4
# {robot: stacks}
CASES = {
    'Panda': ("""
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
- posture: {type: posture}
""", """
- cell: {type: keep_in, frame: panda_hand_tcp, shape: {box: [1.0, 1.0, 1.0]}, at: [0, 0, 0.5]}
- tool: {type: position, frame: panda_hand_tcp}
- direction: {type: orientation, frame: panda_hand_tcp, axes: xy}
"""),
    'UR5': ("""
- tool: {type: position, frame: tool0}
- turn: {type: orientation, frame: tool0}
- posture: {type: posture}
""",),
    'xArm 7': ("""
- tool: {type: pose, frame: link7}
- elbow: {type: position, frame: link4}
- posture: {type: posture}
""", """
- floor: {type: keep_in, frame: link7, shape: {box: [1.0, 1.0, 0.9]}, at: [0, 0, 0.5]}
- tool: {type: position, frame: link7}
- direction: {type: orientation, frame: link7, axes: xy}
- posture: {type: posture}
"""),
    'TIAGo on wheels': ("""
- tool: {type: pose, frame: arm_tool_link}
- elbow: {type: position, frame: arm_4_link}
- posture: {type: posture}
""", """
- tool: {type: position, frame: arm_tool_link, mode: scale}
- turn: {type: orientation, frame: arm_tool_link}
- posture: {type: posture}
"""),
    'Baxter': ("""
- grip: {type: pose, frame: left_gripper, reference: right_gripper}
- left: {type: position, frame: left_gripper}
- posture: {type: posture}
""", """
- limits: {type: joint_limits}
- left: {type: pose, frame: left_gripper}
- right: {type: pose, frame: right_gripper}
- posture: {type: posture}
"""),
    'Talos': ("""
- left: {type: pose, frame: arm_left_7_link}
- right: {type: pose, frame: arm_right_7_link}
- head: {type: orientation, frame: head_2_link, axes: yz}
- posture: {type: posture}
""", """
- left: {type: position, frame: arm_left_7_link, mode: scale}
- right: {type: position, frame: arm_right_7_link}
- turn: {type: orientation, frame: arm_left_7_link}
- posture: {type: posture}
"""),
}
LIMITS = {
    'velocity limit': ('velocity', 1e6), 'upper position limit': ('upper', 1e4),
    'lower position limit': ('lower', -1e4)}


@dataclass
class Scene:
    """One moment of a run."""

    robot: Robot
    settings: Settings
    solved: SolvedCycle
    report: Report

    def missing(self, velocity: np.ndarray) -> dict[str, float]:
        """Return how much each task misses at a velocity (n,)."""
        found = {}
        for evaluation in chain(*self.solved.evaluations):
            level = evaluation.level
            achieved = level.J @ velocity
            demand = np.clip(achieved, level.lower, level.upper) if level.v is None else level.v
            found[evaluation.task.name] = float(np.linalg.norm(demand - achieved))
        return found

    def named(self) -> dict[str, dict[tuple[str, str], float]]:
        """Return the shares of the causes of each task, as a new report has them."""
        report = Report(self.robot, (), {}, self.solved)
        return {task.name: {(cause.kind, cause.name): cause.share for cause in task.causes}
                for task in report.tasks}

    def bounds(self, robot: Robot) -> VelocityBounds:
        """Return the bounds of the joints of a robot in this state, but for accelerations."""
        options = CycleOptions(robot, self.settings, robot.velocity)
        positions = robot.positions(self.solved.place.q)
        return options.limits.at(JointMotion(positions, np.zeros(robot.n), PERIOD),
                                 PERIOD).settled

    def accelerated(self) -> np.ndarray:
        """Return the command (n,) without acceleration limits."""
        cycle = self.solved.cycle
        return cycle.solver.solve(cycle.levels, self.bounds(self.robot), cycle.memory).velocity

    def lasting(self, robot: Robot | None = None, without: str = '', unmasked: str = ''
                ) -> dict[str, float]:
        """
        Return how much each task misses once the command has settled in this state.

        Optionally with the limits of a robot, without a task, or with all joints for another.
        """
        cycle, bounds = self.solved.cycle, self.bounds(robot or self.robot)
        groups = [[each for each in group if each.task.name != without]
                  for group in self.solved.evaluations]
        kept = [index for index, group in enumerate(groups) if group]
        levels = levels_of([[_with_all_joints(each) if each.task.name == unmasked else each
                             for each in groups[index]] for index in kept])
        most = np.array(cycle.memory or (0.0,) * len(cycle.levels))[kept]
        memory = tuple(most)
        velocity, still = self.solved.velocity, 0
        for _ in range(MOST_CYCLES):
            last = np.append(velocity, memory)
            solution = cycle.solver.solve(levels, bounds, memory)
            velocity, memory = solution.velocity, tuple(np.minimum(solution.memory, most))
            now = np.append(velocity, memory)
            still = still + 1 if np.allclose(now, last, SETTLED, STILL) else 0
            if still == CYCLES:
                break
        return self.missing(velocity)

    def couples(self, name: str, other: str) -> bool:
        """Return whether a task above another one, or a joint, can do more than damp it."""
        evaluations = {each.task.name: each for each in chain(*self.solved.evaluations)}
        if other not in evaluations or self.settings.scaling == 'uniform':
            return True
        names = list(evaluations)
        group = next(group for group in self.solved.evaluations
                     if name in [each.task.name for each in group])
        last = names.index(group[-1].task.name)
        J = [evaluations[each].level.J != 0.0 for each in names[:last + 1]]
        rows = np.vstack(J).astype(int)
        _, labels = connected_components(rows.T @ rows, directed=False)
        moved = [set(labels[evaluations[each].level.J.any(axis=0)]) for each in (name, other)]
        return not moved[0].isdisjoint(moved[1])

    def alone(self) -> Iterator[tuple[tuple[str, str], dict[str, float]]]:
        """Yield (kind, name) of all that may be taken away, and what each task misses then."""
        for evaluation in chain(*self.solved.evaluations):
            task = evaluation.task
            yield ('bounds' if task.bounded else 'task', task.name), self.lasting(
                without=task.name)
            if task.joint_mask is not None:
                yield ('joints', task.name), self.lasting(unmasked=task.name)
        for index, joint in enumerate(self.robot.velocity_names):
            for kind, (attribute, value) in LIMITS.items():
                yield (kind, joint), self.lasting(without_limits(
                    self.robot, attribute, value, index))


def _with_all_joints(evaluation: Evaluation) -> Evaluation:
    """Return an evaluation whose level may move all joints."""
    return replace(evaluation, level=replace(evaluation.level, joints=None))


def without_limits(robot: Robot, attribute: str, value: float, index: Any = slice(None)) -> Robot:
    """Return a robot with other limits of a joint, by default of all."""
    robot = copy(robot)
    limits = getattr(robot, attribute).copy()
    limits[index] = value
    setattr(robot, attribute, limits)
    return robot


@dataclass
class Findings:
    """What a comparison came to."""

    tasks: int = 0
    true: int = 0
    found: int = 0
    named: int = 0
    right: int = 0
    shares: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def masked(text: str, robot: Robot, random: np.random.Generator) -> Stack:
    """Return a stack in which most tasks may move some joints only, and some have weights."""
    entries, names = yaml.safe_load(text), np.array(robot.velocity_names)
    for entry in entries:
        for task in entry.values():
            count = int(random.integers(1, max(2, len(names) // 2)))
            some = random.choice(names, count, replace=False).tolist()
            if random.random() < MASKED:
                # Rows of joint tasks have the same name.
                task['excluded_joints'] = some
            if random.random() < WEIGHTED:
                task['weights'] = {'m': float(10.0 ** random.uniform(-1.0, 1.0))} \
                    if task['type'] == 'pose' else float(10.0 ** random.uniform(-1.0, 1.0))
    return Stack(entries, robot)


def drive(case: str, number: int, masks: bool = False) -> Iterator[Scene]:
    """Yield some moments of a run by its number; see `masked`."""
    stacks = CASES[case]
    random = np.random.default_rng([SEED, number])
    robot = load_robot(case, random.choice(np.array(ACCELERATIONS, dtype=object)))
    settings = Settings(
        period=PERIOD, blend=0.0, reserve=0.0, command_delay=0,
        scaling=str(random.choice(['redistribute', 'redistribute', 'uniform'])),
        weights=tuple(10.0 ** random.uniform(-1.0, 1.0, robot.n))
        if random.random() < 0.3 else None)
    text = stacks[random.integers(len(stacks))]
    stack = masked(text, robot, random) if masks else Stack.from_yaml(text, robot)
    controller = Controller(robot, stack, settings)
    q, change, moment = configuration(robot, random), 0.0, 0.0
    for cycle in range(int(RUN / PERIOD)):
        now = cycle * PERIOD
        if now >= change:
            there = robot.state(configuration(robot, random))
            for task in controller.stack.tasks.values():
                if not task.bounded:
                    controller.set_goal(task.name, task.value(there), now)
            change = now + random.uniform(*STAY)
        command = controller.update(q, now)
        if now >= moment:
            moment = now + random.uniform(*PAUSE)
            yield Scene(robot, settings, command.report._solved, command.report)
        q = robot.integrate(q, command.velocity, PERIOD)


def configuration(robot: Robot, random: np.random.Generator) -> np.ndarray:
    """Return positions within the limits; a base stays within half a metre."""
    q = robot.neutral()
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    drawn = random.uniform(lower, upper)
    joints = len(robot.joint_names)
    q[len(q) - joints:] = drawn[len(drawn) - joints:]
    if len(drawn) > joints:
        q[:2] = random.uniform(-0.5, 0.5, 2)
    return q


def compare(scene: Scene, title: str, findings: Findings) -> None:
    """Add what one moment says to the findings."""
    named = scene.named()
    start = time.perf_counter()
    scene.named()
    elapsed = time.perf_counter() - start
    limited = [task for task in scene.report.tasks if task.causes or task.status == 'limited']
    if not limited:
        return
    findings.tasks += len(limited)
    findings.times.append(1e6 * elapsed)
    now, lasting = scene.missing(scene.solved.velocity), scene.lasting()
    order = [task.name for task in scene.report.tasks]
    for removed, left in scene.alone():
        for task in limited:
            own = removed == ('joints', task.name)
            if own or (removed[1] not in order[order.index(task.name):]
                       and (removed[0] == 'joints' or scene.couples(task.name, removed[1]))):
                _count(title, task.name, removed, (lasting[task.name] - left[task.name])
                       / max(now[task.name], lasting[task.name]),
                       named[task.name].get(('joints', '') if own else removed, 0.0), findings)
    velocity = scene.accelerated()
    if np.abs(velocity - scene.solved.velocity).max() > STILL:
        accelerated = scene.missing(velocity)
        for task in limited:
            name = task.name
            cause = 'accelerating', ''
            _count(title, name, cause,
                   (now[name] - accelerated[name]) / max(now[name], lasting[name]),
                   named[name].get(cause, 0.0), findings)


def _count(title: str, task: str, cause: tuple[str, str], share: float, given: float,
           findings: Findings) -> None:
    """Add one candidate, its true share and the one that is named to the findings."""
    if max(share, given) < NOTABLE - MARGIN:
        return
    findings.shares.append(abs(share - given))
    findings.true += share > NOTABLE + MARGIN
    findings.found += share > NOTABLE + MARGIN and given > NOTABLE - MARGIN
    findings.named += given > NOTABLE + MARGIN
    findings.right += given > NOTABLE + MARGIN and share > NOTABLE - MARGIN
    if abs(share - given) > NOTABLE:
        findings.faults.append(f'{title}: {task}, {cause}: {share:.3f}, not {given:.3f}')


def measure(case: str, tasks: int, masks: bool = False) -> Findings:
    """Return what runs come to, with at least this many limited tasks."""
    findings, number = Findings(), 0
    while findings.tasks < tasks:
        for moment, scene in enumerate(drive(case, number, masks)):
            if findings.tasks < tasks:
                compare(scene, f'{case}, run {number}, moment {moment}', findings)
        number += 1
    return findings


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--tasks', type=int, default=TASKS, help='limited tasks of each robot')
    parser.add_argument('--cases', nargs='+', choices=CASES, default=list(CASES))
    parser.add_argument('--masks', action='store_true',
                        help='tasks may move some joints only, and weigh their rows')
    options = parser.parse_args()
    print('| robot | limited tasks | true causes | found | right | within 0.1 | off by '
          '| µs: median | 99th percentile |\n|' + ' --- |' * 9, flush=True)
    faults = []
    for case in options.cases:
        findings = measure(case, options.tasks, options.masks)
        faults.extend(findings.faults)
        median, most = np.percentile(findings.times, (50, 99))
        shares = np.array(findings.shares)
        print(f'| {case} | {findings.tasks} | {findings.true} '
              f'| {findings.found / max(findings.true, 1):.1%} '
              f'| {findings.right / max(findings.named, 1):.1%} '
              f'| {np.mean(shares < 0.1):.1%} | {shares.max():.2g} '
              f'| {median:.0f} | {most:.0f} |', flush=True)
    print(*faults, sep='\n')


if __name__ == '__main__':
    main()

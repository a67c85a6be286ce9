# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Compare the causes in the report with what solving again without each of them shows.

Run as ``python benchmarks/causes.py``; ``--states 20`` for a first impression. Every state draws
joint positions, goals and settings, and in a third of the states acceleration limits. Then every
limit of every joint, and every task above, is removed in turn: the robot gets a copy without the
limit, the stack is solved without the task. The share of the missing velocity that comes back is
the true share of this cause; a true cause has more than 1 %.

*Found* are the true causes that the report names, as a share of all true ones. *Right* are the
named causes that are true, as a share of all named ones. *Shares off by* is the largest difference
between a reported and a true share. The times are those of `TaskReport.causes` for all tasks of a
cycle in which at least one task is limited.
"""

import argparse
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field
import math
import time
from typing import Any

from _robots import load_robot
import numpy as np
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.report import Report

SEED, STATES = 0, 200
NOTABLE = 0.01
# Shares nearer to that than this may be named or not.
MARGIN = 0.002
PERIOD = 0.01
# {name: (robot, stack)}
CASES = {
    'Panda': ('Panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
- posture: {type: posture}
"""),
    'Panda in a cell': ('Panda', """
- cell: {type: keep_in, frame: panda_hand_tcp, shape: {box: [1.0, 1.0, 1.0]}, at: [0, 0, 0.5]}
- tool: {type: position, frame: panda_hand_tcp}
- direction: {type: orientation, frame: panda_hand_tcp, axes: xy}
"""),
    'UR5': ('UR5', """
- tool: {type: position, frame: tool0}
- turn: {type: orientation, frame: tool0}
- posture: {type: posture}
"""),
    'Baxter': ('Baxter', """
- grip: {type: pose, frame: left_gripper, reference: right_gripper}
- left: {type: position, frame: left_gripper}
- posture: {type: posture}
"""),
    'TIAGo on wheels': ('TIAGo on wheels', """
- tool: {type: pose, frame: arm_tool_link}
- elbow: {type: position, frame: arm_4_link}
- posture: {type: posture}
"""),
}
LIMITS = {
    'velocity limit': ('velocity', 1e6), 'upper position limit': ('upper', 1e4),
    'lower position limit': ('lower', -1e4), 'acceleration limit': ('acceleration', math.inf)}


@dataclass
class Scene:
    """One state: what is to be done, and under which limits."""

    robot: Robot
    stack: str
    settings: Settings
    q: np.ndarray
    goals: dict[str, Any]
    cycles: int

    def solve(self, robot: Robot, without: str = '') -> tuple[Report, dict[str, float]]:
        """Return the report of the last cycle, and how much each task misses."""
        stack = Stack.from_yaml(self.stack, robot)
        controller = Controller(robot, stack, self.settings)
        if without:
            controller.enable(without, False)
        for name, goal in self.goals.items():
            controller.set_goal(name, goal, 0.0)
        for cycle in range(self.cycles):
            command = controller.update(self.q, cycle * PERIOD)
        state, missing = robot.state(self.q), {}
        for task in stack.tasks.values():
            level = task.evaluate(state, 0.0).level
            achieved = level.J @ command.velocity
            demand = np.clip(achieved, level.lower, level.upper) if level.v is None else level.v
            missing[task.name] = float(np.linalg.norm(demand - achieved))
        return command.report, missing

    def alone(self) -> Iterator[tuple[tuple[str, str], dict[str, float]]]:
        """Yield (kind, name) of all that may be taken away, and what each task misses then."""
        for task in Stack.from_yaml(self.stack, self.robot).tasks.values():
            yield ('bounds' if task.bounded else 'task', task.name), self.solve(
                self.robot, without=task.name)[1]
        for index, joint in enumerate(self.robot.velocity_names):
            for kind, (attribute, value) in LIMITS.items():
                robot = copy(self.robot)
                limits = getattr(robot, attribute).copy()
                limits[index] = value
                setattr(robot, attribute, limits)
                yield (kind, joint), self.solve(robot)[1]


@dataclass
class Findings:
    """What a comparison came to."""

    true: int = 0
    found: int = 0
    named: int = 0
    right: int = 0
    off: float = 0.0
    times: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)


def draw(case: str, number: int, cycles: int) -> Scene:
    """Return a state by its number, in which the robot is for some cycles."""
    robot_name, stack = CASES[case]
    random = np.random.default_rng([SEED, number])
    robot = load_robot(robot_name)
    # What accelerations reach depends on the cycles before, which differ without a limit.
    if number % 3 == 0 and cycles == 1:
        robot = copy(robot)
        robot.acceleration = np.full(robot.n, 15.0)
    settings = Settings(
        period=PERIOD, blend=0.0, reserve=0.0,
        scaling=str(random.choice(['redistribute', 'redistribute', 'uniform'])),
        weights=tuple(10.0 ** random.uniform(-1.0, 1.0, robot.n))
        if random.random() < 0.3 else None)
    q, there = _configuration(robot, random), robot.state(_configuration(robot, random))
    tasks = Stack.from_yaml(stack, robot).tasks.values()
    return Scene(robot, stack, settings, q, {
        task.name: task.value(there) for task in tasks if not task.bounded}, cycles)


def _configuration(robot: Robot, random: np.random.Generator) -> np.ndarray:
    """Return positions within the limits; a base stays within half a metre."""
    q = robot.neutral()
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    drawn = random.uniform(lower, upper)
    joints = len(robot.joint_names)
    q[len(q) - joints:] = drawn[len(drawn) - joints:]
    if len(drawn) > joints:
        q[:2] = random.uniform(-0.5, 0.5, 2)
    return q


def compare(case: str, number: int, cycles: int, findings: Findings) -> None:
    """Add what one state says to the findings."""
    scene = draw(case, number, cycles)
    report, missing = scene.solve(scene.robot)
    start = time.perf_counter()
    named = {task.name: {(cause.kind, cause.name): cause.share for cause in task.causes}
             for task in report.tasks}
    elapsed = time.perf_counter() - start
    if any(named.values()):
        findings.times.append(1e6 * elapsed)
    order = [task.name for task in report.tasks]
    for removed, left in scene.alone():
        for index, task in enumerate(report.tasks):
            above = removed[1] in order[:index] or removed[1] not in order
            if not above or missing[task.name] <= max(1e-6, NOTABLE * task.demanded_speed):
                continue
            share = 1.0 - left[task.name] / missing[task.name]
            given = named[task.name].get(removed, 0.0)
            findings.true += share > NOTABLE + MARGIN
            findings.found += share > NOTABLE + MARGIN and given > 0.0
            findings.named += given > 0.0
            findings.right += given > 0.0 and share > NOTABLE - MARGIN
            findings.off = max(findings.off, abs(share - given) if given else 0.0)
            if (share > NOTABLE + MARGIN) != (given > 0.0) and abs(share - NOTABLE) > MARGIN:
                findings.faults.append(f'{case}, state {number}: {task.name}, {removed}: '
                                       f'{share:.3f}, not {given:.3f}')


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--states', type=int, default=STATES, help='of each stack')
    parser.add_argument('--cycles', type=int, default=1,
                        help='for which the robot stays in a state, so that more is remembered')
    parser.add_argument('--cases', nargs='+', choices=CASES, default=list(CASES))
    options = parser.parse_args()
    print('| stack | true causes | found | right | shares off by | µs: median | 90th percentile |'
          '\n|' + ' --- |' * 7, flush=True)
    faults = []
    for case in options.cases:
        findings = Findings()
        for number in range(options.states):
            compare(case, number, options.cycles, findings)
        faults.extend(findings.faults)
        median, most = np.percentile(findings.times, (50, 90)) if findings.times else (0.0, 0.0)
        print(f'| {case} | {findings.true} | {findings.found / max(findings.true, 1):.1%} '
              f'| {findings.right / max(findings.named, 1):.1%} | {findings.off:.2g} '
              f'| {median:.0f} | {most:.0f} |', flush=True)
    print(*faults, sep='\n')


if __name__ == '__main__':
    main()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Run a million cycles of random closed loops, and count what must not happen.

Run as ``python benchmarks/closed_loops.py``; ``--cycles 20000`` for a first impression. The
robot is ideal: its positions are the integral of the commands. Stacks, modes, goals, feed-forward
velocities, settings and starts are random; some starts are outside the position limits or at a
singularity. While the robot moves, tasks are enabled and disabled and the stack is replaced.

Half of the episodes have a period of 10 ms and end with a settling phase: 700 cycles in which
nothing changes any more. The others have a period of 1 ms. Half of the episodes have acceleration
limits; in a third of all episodes cycles come early at random.

Every episode has its own random generator, so that it can be repeated: a finding names robot,
seed and episode, which `Episode(robot name, seed, episode)` takes.
"""

import argparse
from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache
import math
import multiprocessing
import time
from unittest.mock import patch

from _robots import load_robot
import numpy as np
from scipy.optimize import lsq_linear
from tp_controller import Controller, Settings, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.solver import bounded_hierarchy
from tp_controller.solver.compiled import left_to_the_reference, running
from tp_controller.solver.qp import regularised

# {robot: (frames tasks are about, frame that some are relative to, axes of a pose task)}
ROBOTS = {
    'Panda': (('panda_hand_tcp', 'panda_link4'), 'panda_link3', None),
    'UR5': (('tool0', 'forearm_link'), 'upper_arm_link', None),
    'Baxter': (('left_gripper', 'right_gripper', 'left_lower_elbow'), 'right_gripper', None),
    'planar 10R': (('link10', 'link5'), 'link3', {'pose': '[x, y, rz]', 'position': 'xy',
                                                  'orientation': 'z'}),
}
PERIODS = (0.01, 0.001)
ACCELERATIONS = (None, None, 5.0, 15.0)
# Cycles with random events, and without any at the end (period 10 ms only).
MOVING, SETTLING = 300, 700
# How often something happens, per cycle.
CHANCES = {'goal': 0.01, 'feed_forward': 0.02, 'enable': 0.005, 'replace': 0.003}
# After this time nothing that happened before acts on the command any more [s].
DIED_OUT = 1.0
# What rounding may add to a limit, and an outside joint to its distance [rad].
ROUNDING = 1e-9
OUTWARDS = 1e-12
# Share of the speed of the first task that may get lost before it counts as stuck wrongly.
LOST = 0.05
# A settling phase with more than `CHATTER_CYCLES` changes of a velocity by more than this counts
# as chattering [rad/s].
CHATTER = 0.5
CHATTER_CYCLES = 5
# Further findings are counted but not described.
DESCRIBED = 20


@dataclass
class Result:
    """What came of the closed loops of one robot."""

    robot: str
    cycles: int = 0
    # Exceptions and commands that are not finite.
    failures: int = 0
    # Of the solver in Python: quadratic programs, and those that rounding defeats.
    programs: int = 0
    unsolved: int = 0
    # Of the compiled core: cycles that it leaves to the solver in Python.
    left: int = 0
    # Commands beyond a velocity limit; joints that left their range or went farther out.
    velocity: int = 0
    position: int = 0
    # Largest change of a velocity over what its acceleration limit allows.
    acceleration: float = 0.0
    # Largest change of a velocity between cycles, without acceleration limits [rad/s], and the
    # same in settling phases, when no change of stack, goal or feed-forward velocity has an effect
    # any more.
    change: float = 0.0
    change_alone: float = 0.0
    # Cycles in which a limit slowed a level.
    active: int = 0
    # What became of the first task in settling phases.
    outcomes: Counter = field(default_factory=Counter)
    seconds: float = 0.0
    findings: list = field(default_factory=list)

    def find(self, what, episode, cycle):
        """Describe something that must not happen."""
        if len(self.findings) < DESCRIBED:
            self.findings.append(f'{episode.name}, cycle {cycle}: {what}')


class Programs:
    """Stands in for `tp_controller.solver.qp.regularised`, and counts."""

    def __init__(self, result):
        self._result = result

    def __call__(self, *arguments):
        """Run it."""
        answer = regularised(*arguments)
        self._result.programs += 1
        self._result.unsolved += answer is None
        return answer


class Episode:
    """A robot, a controller and what happens to them, all drawn from one generator."""

    def __init__(self, robot_name, seed, number):
        self.name = f'{robot_name}, seed {seed}, episode {number}'
        self.random = random = np.random.default_rng((seed, number))
        self.period = PERIODS[number % 2]
        self.acceleration = random.choice(ACCELERATIONS)
        self.robot = robot = _robot(robot_name, self.acceleration)
        self.frames, self.reference, self.axes = ROBOTS[robot_name]
        self.jitter = random.random() < 1.0 / 3.0
        self.settings = Settings(
            period=self.period,
            braking_gain=float(random.choice([10.0, 0.5 / self.period, 1.0 / self.period])),
            reserve=float(random.choice([0.0, 0.4, 0.4, 1.0])),
            blend=float(random.choice([0.0, 0.4, 0.4])),
            weights=tuple(random.uniform(0.2, 5.0, robot.n)) if random.random() < 0.2 else None)
        self.lower, self.upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
        self.controller = Controller(robot, self.stack(), self.settings)
        self.state = robot.state(robot.neutral())
        self.q = self.start()

    def start(self):
        """Return positions: anywhere, at a singularity, or partly outside the limits."""
        random, robot = self.random, self.robot
        kind = random.choice(['inside', 'inside', 'singular', 'outside'])
        if kind == 'singular':
            return np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        q = random.uniform(self.lower, self.upper)
        if kind == 'outside':
            out = random.random(robot.n) < 0.3
            beyond = random.uniform(0.0, 0.3, robot.n)
            q = np.where(out, np.where(random.random(robot.n) < 0.5, robot.lower - beyond,
                                       robot.upper + beyond), q)
            q = np.where(np.isfinite(q), q, 0.0)
        return q

    def stack(self):
        """Return a random stack; the first task is about the first frame."""
        random = self.random
        lines = [self.entry(0, random.choice(['pose', 'position', 'orientation']),
                            self.frames[0])]
        for number in range(1, random.integers(1, 4)):
            kind = random.choice(['pose', 'position', 'position', 'orientation', 'joint'])
            lines.append(self.entry(number, kind, random.choice(self.frames)))
        if random.random() < 0.7:
            lines.append(self.entry('posture', 'posture', None))
        return Stack.from_yaml('\n'.join(lines), self.robot)

    def entry(self, number, kind, frame):
        """Return one line of a stack."""
        random = self.random
        mode = random.choice(['least_squares', 'least_squares', 'scale'])
        keys = [f'type: {kind}', f'mode: {mode}', f'gain: {random.uniform(2.0, 5.0):.3f}']
        if kind == 'joint':
            chosen = random.choice(self.robot.joint_names, random.integers(1, 3), replace=False)
            keys.append(f'joints: [{", ".join(chosen)}]')
        elif kind != 'posture':
            keys.append(f'frame: {frame}')
            if frame != self.reference and random.random() < 0.2:
                keys.append(f'reference: {self.reference}')
            if self.axes:
                keys.append(f'axes: {self.axes[kind]}')
        return f'- t{number}: {{{", ".join(keys)}}}'

    def goal(self, task):
        """Set the goal of a task to what it is about at random positions within the limits."""
        self.state.update(self.random.uniform(self.lower, self.upper))
        self.controller.set_goal(task.name, task.value(self.state), self.now)

    def happen(self):
        """Let happen what happens in a cycle."""
        random, controller = self.random, self.controller
        tasks = list(controller.stack.tasks.values())
        task = tasks[random.integers(len(tasks))]
        drawn = dict(zip(CHANCES, random.random(len(CHANCES))))
        if drawn['goal'] < CHANCES['goal']:
            self.goal(task)
        if drawn['feed_forward'] < CHANCES['feed_forward']:
            size = 6 if task.feed_forward_type == 'twist' else task.rows
            controller.set_feed_forward(task.name, random.normal(0.0, 0.5, size), self.now)
        if drawn['enable'] < CHANCES['enable']:
            controller.enable(task.name, task.name in controller.stack.disabled)
        if drawn['replace'] < CHANCES['replace']:
            controller.replace_stack(self.stack())

    def run(self, result, most):
        """Run at most some cycles; return how many it were."""
        robot, controller = self.robot, self.controller
        self.now, self.settling_since, self.chatter = 0.0, math.inf, 0
        previous, elapsed = np.zeros(robot.n), self.period
        cycles = min(most, MOVING + SETTLING)
        for cycle in range(cycles):
            try:
                if cycle < MOVING or self.period != PERIODS[0]:
                    self.happen()
                elif cycle == MOVING:
                    self.settle()
                began = time.thread_time_ns()
                command = controller.update(self.q, self.now)
                result.seconds += (time.thread_time_ns() - began) * 1e-9
            except Exception as error:
                result.failures += 1
                result.find(f'{type(error).__name__}: {error}', self, cycle)
                return cycle + 1
            velocity = command.velocity
            if not np.isfinite(velocity).all():
                result.failures += 1
                result.find('not finite', self, cycle)
                return cycle + 1
            result.active += int(command.report.scale < 1.0 - 1e-6)
            step = self.period * (self.random.uniform(0.3, 1.0) if self.jitter else 1.0)
            self.check(result, cycle, velocity, previous, elapsed, step)
            self.q = self.q + step * velocity
            self.now, elapsed, previous = self.now + step, step, velocity
        if self.settling_since < math.inf and cycles == MOVING + SETTLING:
            self.judge(result, previous, elapsed)
        return cycles

    def check(self, result, cycle, velocity, previous, elapsed, step):
        """Count what a command does that it must not."""
        robot, q = self.robot, self.q
        too_fast = np.abs(velocity) - robot.velocity
        if (too_fast > ROUNDING).any():
            result.velocity += 1
            result.find(f'velocity limit exceeded by {too_fast.max():.2e}', self, cycle)
        moved = q + step * velocity
        allowed = np.maximum(np.maximum(robot.lower - q, q - robot.upper) + OUTWARDS, ROUNDING)
        beyond = np.maximum(robot.lower - moved, moved - robot.upper) - allowed
        if (beyond > 0.0).any():
            result.position += 1
            result.find(f'position limit exceeded by {beyond.max():.2e}', self, cycle)
        change = np.abs(velocity - previous)
        if self.acceleration is not None:
            ratio = float((change / (robot.acceleration * elapsed)).max())
            if ratio > 1.0 + 1e-6:
                result.find(f'acceleration limit exceeded {ratio:.6f} times', self, cycle)
            result.acceleration = max(result.acceleration, ratio)
        elif cycle:
            result.change = max(result.change, float(change.max()))
            if self.now > self.settling_since + DIED_OUT:
                result.change_alone = max(result.change_alone, float(change.max()))
                self.chatter += int(change.max() > CHATTER)

    def settle(self):
        """Give the first task a goal it can reach, enable all tasks, and change nothing more."""
        controller = self.controller
        for name in tuple(controller.stack.disabled):
            controller.enable(name, True)
        self.goal(controller.stack.groups[0][0])
        self.settling_since = self.now

    def judge(self, result, previous, elapsed):
        """
        Say what became of the first task at the end of a settling phase.

        ``stuck``: velocities within the same bounds would bring it on notably better than the
        command does, although it is in no weak direction. All else is where a way straight to
        the goal ends. Chattering is counted besides, without acceleration limits.
        """
        if self.chatter > CHATTER_CYCLES:
            result.outcomes['chattering'] += 1
            result.find(f'{self.chatter} changes by more than {CHATTER} rad/s', self,
                        MOVING + SETTLING)
        robot, settings = self.robot, self.settings
        state = robot.state(self.q)
        level = self.controller.stack.levels(state, self.now)[0]
        limits = VelocityLimits(robot, settings.period, settings.braking_gain)
        bounds = limits.at(JointMotion(state.q, previous, elapsed))
        command = self.controller.update(self.q, self.now)
        task = command.report.tasks[0]
        if task.reached:
            result.outcomes['reached'] += 1
            return
        if 'singularity' in task.reason:
            result.outcomes['singularity'] += 1
        elif 'position limit' in task.reason:
            result.outcomes['position limit'] += 1
        else:
            result.outcomes['under way'] += 1
        J, v = level.J, level.v
        best = lsq_linear(J, v, (bounds.lower, np.maximum(bounds.upper, bounds.lower + 1e-12)))
        lost = np.linalg.norm(v - J.dot(command.velocity)) - np.linalg.norm(v - J.dot(best.x))
        weights = np.ones(robot.n) if settings.weights is None else np.array(settings.weights)
        weak = np.linalg.svd(J * np.sqrt(weights.min() / weights))[1].min() \
            < settings.singular_region
        if lost > LOST * np.linalg.norm(v) and not weak and level.mode != 'scale':
            result.outcomes['stuck'] += 1
            result.find(f'stuck: {lost:.2e} of {np.linalg.norm(v):.2e} lost; {task.reason}',
                        self, MOVING + SETTLING)


def run(robot_name, cycles, seed):
    """
    Run closed loops.

    Parameters
    ----------
    robot_name : str
        One of `ROBOTS`.
    cycles : int
        In all.
    seed : int
        Of the generators of the episodes.

    Returns
    -------
    Result

    """
    result, left = Result(robot_name), left_to_the_reference()
    with patch.object(bounded_hierarchy, 'regularised', Programs(result)):
        number = 0
        while result.cycles < cycles:
            episode = Episode(robot_name, seed, number)
            result.cycles += episode.run(result, cycles - result.cycles)
            number += 1
    result.left = left_to_the_reference() - left
    return result


@lru_cache(maxsize=None)
def _robot(name, acceleration):
    """Return a robot, read once."""
    return load_robot(name, acceleration)


def rows(result):
    """Yield what the table shows of a result, (name, text)."""
    outcomes = result.outcomes
    ends = ('reached', 'position limit', 'singularity', 'under way')
    yield 'cycles', f'{result.cycles:,}'
    yield 'failures', result.failures
    if running() == 'compiled':
        yield 'left to the solver in Python', result.left
    else:
        yield 'quadratic programs', f'{result.programs:,}'
        yield '… unsolved', result.unsolved
    yield 'velocity limit violated', result.velocity
    yield 'position limit violated', result.position
    yield 'largest acceleration / limit', f'{result.acceleration:.9f}'
    yield 'largest change without such a limit', f'{result.change:.2f} rad/s'
    yield '… in settling phases', f'{result.change_alone:.2f} rad/s'
    yield 'cycles slowed by limits', f'{100.0 * result.active / result.cycles:.0f} %'
    yield 'settling phases', sum(outcomes[name] for name in ends)
    for name in (*ends, 'stuck', 'chattering'):
        yield f'… {name}', outcomes[name]
    yield 'µs per update', f'{1e6 * result.seconds / result.cycles:.0f}'


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--cycles', type=int, default=1_000_000, help='of all robots together')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    options = parser.parse_args()
    work = [(name, options.cycles // len(ROBOTS), options.seed) for name in ROBOTS]
    if options.jobs > 1:
        with multiprocessing.Pool(options.jobs) as pool:
            results = pool.starmap(run, work, chunksize=1)
    else:
        results = [run(*arguments) for arguments in work]
    print('| | ' + ' | '.join(ROBOTS) + ' |')
    print('| --- |' + ' --- |' * len(ROBOTS))
    for cells in zip(*(rows(result) for result in results)):
        print(f'| {cells[0][0]} | ' + ' | '.join(str(value) for _, value in cells) + ' |')
    for result in results:
        for finding in result.findings:
            print(finding)


if __name__ == '__main__':
    main()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Time one control cycle, in microseconds, beside the plain recursion with np.linalg.pinv.

Run as ``python benchmarks/solver.py`` (or ``make bench``). The plain recursion is section 2.2 of
*lecture* (docs/sources.md) as one writes it first: ``np.linalg.pinv(J @ P)`` for every level, then
uniform scaling (section 4). Every stack is timed in states in which no limit is active, and in
states that demand two to three times the speed limits, so that limits are active in every cycle;
the latter also with mode ``scale`` on the first level.

All variants take turns in one process, so that a machine whose speed drifts affects all figures
alike: quote ratios. Measured is processor time, without other processes. Each figure is the median
over the rounds, with the fastest and the slowest round.
"""

import argparse
import time

from _robots import load_robot, PANDA_READY, TALOS_READY
import numpy as np
from tp_controller import Controller, Settings, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.solver.solve import solve_cycle

# {name: (robot, working posture, stack)}
CASES = {
    'Panda, pose > posture': ('Panda', PANDA_READY, """
- tool: {type: pose, frame: panda_hand_tcp}
- posture: {type: posture, gain: 0.5}
"""),
    'Panda, pose > elbow position': ('Panda', PANDA_READY, """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
"""),
    'Talos upper body, 18 joints, 4 levels': ('Talos', TALOS_READY, """
- left: {type: pose, frame: arm_left_7_link}
- right: {type: pose, frame: arm_right_7_link}
- head: {type: orientation, frame: head_2_link, axes: yz}
- posture: {type: posture, gain: 0.5}
"""),
}
# A node at 1 kHz.
PERIOD = 1e-3
STATES = 64
CYCLES = 200
# How many times too fast the states with active limits are, in the median.
TOO_FAST = 2.5
# States that are drawn; those in the middle, by how fast they ask the joints to be, are kept.
DRAWN = 4 * STATES


class Case:
    """A robot, a stack and the states it is in; every method runs one cycle of state `k`."""

    def __init__(self, robot, ready, states, stack_text, scaled=False):
        self.robot, self.states = robot, states
        self.stack = Stack.from_yaml(stack_text, robot)
        if scaled:
            next(iter(self.stack.tasks.values())).mode = 'scale'
        self.settings = settings = Settings(period=PERIOD)
        self.controller = Controller(robot, self.stack, settings)
        # In the first cycle tasks without a goal take their current value as default goal.
        self.controller.update(ready, 0.0, elapsed=PERIOD)
        self.options, self.memory = settings.solver(robot.n), ()
        self.state = robot.state(ready)
        self.frames = [task.frame for task in self.stack.tasks.values() if task.frame]
        limits = VelocityLimits(robot, settings.period, settings.braking_gain)
        self.prepared = []
        for q in states:
            self.state.update(q)
            bounds = limits.at(JointMotion(self.state.q, np.zeros(robot.n), settings.period))
            self.prepared.append((self.stack.levels(self.state, 0.0), bounds.lower,
                                  bounds.upper))

    def limited(self):
        """Return in how many states a limit is active, to the solver and to the controller."""
        return (sum(self.solution(*given).scale < 1.0 for given in self.prepared),
                sum(self.controller.update(q, 0.0, elapsed=PERIOD).report.scale < 1.0
                    for q in self.states))

    def update(self, k):
        """Run the whole `Controller.update`."""
        self.controller.update(self.states[k], 0.0, elapsed=PERIOD)

    def kinematics_and_solve(self, k):
        """Evaluate the kinematics the stack needs, and solve levels prepared before."""
        self.kinematics(k)
        self.solve(k)

    def kinematics(self, k):
        """Evaluate the kinematics the stack needs."""
        state = self.state
        state.update(self.states[k])
        for frame in self.frames:
            state.jacobian(frame)

    def solve(self, k):
        """Solve levels that were prepared before."""
        self.solution(*self.prepared[k])

    def solution(self, levels, lower=None, upper=None):
        """Return the solution of one cycle, with what is remembered of the one before."""
        found = solve_cycle(levels, lower, upper, self.options, PERIOD, memory=self.memory)
        self.memory = found.memory
        return found

    def plain(self, k):
        """Run kinematics, levels, the recursion with `np.linalg.pinv`, and uniform scaling."""
        robot, state = self.robot, self.state
        state.update(self.states[k])
        levels = self.stack.levels(state, 0.0)
        zeta, P = np.zeros(robot.n), np.eye(robot.n)
        for level in levels:
            J_bar = level.J @ P
            inverse = np.linalg.pinv(J_bar, rcond=1e-9)
            zeta = zeta + inverse @ (level.v - level.J @ zeta)
            P = P - inverse @ J_bar
        scale = np.max(np.abs(zeta) / robot.velocity)
        return zeta / scale if scale > 1.0 else zeta


# (shown, which of the cases of `load_case`, what is run)
ROWS = (
    ('Controller.update', 'free', Case.update),
    ('kinematics + solve', 'free', Case.kinematics_and_solve),
    ('kinematics', 'free', Case.kinematics),
    ('solve', 'free', Case.solve),
    ('limits active: Controller.update', 'limited', Case.update),
    ('limits active: kinematics + solve', 'limited', Case.kinematics_and_solve),
    ('limits active: solve', 'limited', Case.solve),
    ('the same, scale: Controller.update', 'scaled', Case.update),
    ('the same, scale: solve', 'scaled', Case.solve),
    ('plain recursion, pinv', 'free', Case.plain),
)
REFERENCE = 'plain recursion, pinv'


def load_case(robot_name, ready, stack_text, too_fast=TOO_FAST):
    """Return {'free', 'limited', 'scaled': Case} in the same states; only the limits differ."""
    random = np.random.default_rng(1)
    robot, ready = load_robot(robot_name), np.array(ready)
    drawn = [np.clip(ready + 0.2 * random.standard_normal(robot.n), robot.lower, robot.upper)
             for _ in range(DRAWN)]
    case = Case(robot, ready, drawn, stack_text)
    free = [index for index, given in enumerate(case.prepared)
            if case.solution(*given).scale == 1.0]
    # Share of its speed limit that the fastest joint has.
    shares = {index: np.max(np.abs(case.solution(case.prepared[index][0]).velocity)
                            / robot.velocity) for index in free}
    middle = sorted(free, key=shares.get)[(len(free) - STATES) // 2:][:STATES]
    states = [drawn[index] for index in sorted(middle)]
    factor = np.median([shares[index] for index in middle]) / too_fast
    slow = load_robot(robot_name, limits={
        joint: {'velocity': factor * velocity}
        for joint, velocity in zip(robot.joint_names, robot.velocity)})
    return {'free': Case(robot, ready, states, stack_text),
            'limited': Case(slow, ready, states, stack_text),
            'scaled': Case(slow, ready, states, stack_text, scaled=True)}


def check(cases):
    """Make sure that limits are active where they should be."""
    for kind, expected in (('free', 0), ('limited', STATES), ('scaled', STATES)):
        assert cases[kind].limited() == (expected, expected), (kind, cases[kind].limited())


def measure(cases, rounds, pause):
    """
    Return microseconds per cycle, {(case, row): array (rounds,)}.

    Parameters
    ----------
    cases : dict
        {name: what `load_case` returns}
    rounds : int
        How often everything is measured.
    pause : float
        Time asleep before each cycle [s]; 0 measures a tight loop.

    """
    times = {(case, shown): [] for case in cases for shown, _, _ in ROWS}
    for _ in range(rounds):
        for name, kinds in cases.items():
            for shown, kind, cycle in ROWS:
                times[name, shown].append(time_cycles(kinds[kind], cycle, pause))
    return {key: np.array(row) for key, row in times.items()}


def time_cycles(case, cycle, pause):
    """Return microseconds per cycle."""
    cycles = CYCLES if pause == 0.0 else CYCLES // 4
    if pause == 0.0:
        began = time.thread_time_ns()
        for k in range(cycles):
            cycle(case, k % STATES)
        return (time.thread_time_ns() - began) / cycles / 1e3
    spent = 0
    for k in range(cycles):
        time.sleep(pause)
        began = time.thread_time_ns()
        cycle(case, k % STATES)
        spent += time.thread_time_ns() - began
    return spent / cycles / 1e3


def print_text(times, pace, rounds):
    """Print figures of one pace, aligned."""
    print(f'µs per cycle, {pace}: median (fastest to slowest of {rounds} rounds), '
          'and share of the plain recursion with pinv\n')
    for case in CASES:
        print(case)
        for shown, _, _ in ROWS:
            row = times[case, shown]
            share = np.median(row) / np.median(times[case, REFERENCE])
            print(f'  {shown:<34} {np.median(row):7.1f}  ({row.min():6.1f} to {row.max():6.1f})  '
                  f'{share:5.2f}')


def print_table(tight, cold):
    """Print the table of docs/performance.md."""
    print('| µs | ' + ' | '.join(f'{case} | once per ms' for case in CASES) + ' |')
    print('| --- |' + ' --- | --- |' * len(CASES))
    for shown, _, _ in ROWS:
        rows = [times[case, shown] for case in CASES for times in (tight, cold)]
        cells = [f'{np.median(row):.0f} ({row.min():.0f}–{row.max():.0f})' for row in rows]
        print(f'| {shown} | {" | ".join(cells)} |')


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=21)
    parser.add_argument('--cold', action='store_true',
                        help='one cycle per millisecond, as in a running node')
    parser.add_argument('--markdown', action='store_true',
                        help='both paces, as the table of docs/performance.md')
    options = parser.parse_args()
    cases = {name: load_case(*given) for name, given in CASES.items()}
    for kinds in cases.values():
        check(kinds)
    if options.markdown:
        print_table(measure(cases, options.rounds, 0.0), measure(cases, options.rounds, 1e-3))
    elif options.cold:
        print_text(measure(cases, options.rounds, 1e-3), 'one cycle per millisecond',
                   options.rounds)
    else:
        print_text(measure(cases, options.rounds, 0.0), 'tight loop', options.rounds)


if __name__ == '__main__':
    main()

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
Time one control cycle, in microseconds, beside a textbook recursion.

Run as ``python benchmarks/solver.py`` (or ``make bench``). Everything is measured in turns in one
process, so that a machine whose speed drifts disturbs all figures alike; ratios are what to
quote. Time is that of the processor, without what other programs took from it; each figure is
the median over the rounds, with the fastest and the slowest round.
"""

import argparse
from importlib.metadata import distribution
from pathlib import Path
import time

import numpy as np
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.limits import velocity_bounds
from tp_controller.solver import Solver

PANDA_JOINTS = [f'panda_joint{number}' for number in range(1, 8)]
PANDA_READY = [0.3, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8]
TALOS_JOINTS = [f'torso_{number}_joint' for number in (1, 2)] + \
    [f'head_{number}_joint' for number in (1, 2)] + \
    [f'arm_{side}_{number}_joint' for side in ('left', 'right') for number in range(1, 8)]
ARM_READY = [0.3, 0.5, -0.4, -1.4, 0.2, 0.1, 0.1]
TALOS_READY = [0.1, 0.2, 0.05, 0.1] + ARM_READY + [-value for value in ARM_READY[:3]] \
    + ARM_READY[3:]
CASES = {
    'Panda, pose > posture': ('panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- posture: {type: posture, gain: 0.5}
"""),
    'Panda, pose > elbow position': ('panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
"""),
    'Talos upper body, 18 joints, 4 levels': ('talos', """
- left: {type: pose, frame: arm_left_7_link}
- right: {type: pose, frame: arm_right_7_link}
- head: {type: orientation, frame: head_2_link, axes: yz}
- posture: {type: posture, gain: 0.5}
"""),
}
STATES = 64
CYCLES = 200


class Case:
    """A robot, a stack and the states it is in; every method runs one cycle of state `k`."""

    def __init__(self, robot, ready, stack_text):
        random = np.random.default_rng(1)
        self.robot = robot
        self.states = [np.clip(ready + 0.2 * random.standard_normal(robot.n),
                               robot.lower, robot.upper) for _ in range(STATES)]
        self.stack = Stack.from_yaml(stack_text, robot)
        settings = Settings()
        self.controller = Controller(robot, self.stack, settings)
        self.solver = Solver(robot.n, None, settings.damping, settings.scaling,
                             settings.singular_region, settings.method, settings.rank_tolerance)
        self.controller.update(np.asarray(ready, float), 0.0)
        self.state = robot.state(ready)
        self.frames = [task.frame for task in self.stack.tasks.values() if hasattr(task, 'frame')]
        self.levels = []
        for q in self.states:
            self.state.update(q)
            self.levels.append((self.stack.levels(self.state, 0.0),
                                *velocity_bounds(robot, self.state.q, settings.braking_gain)))

    def update(self, k):
        """Run the whole `Controller.update`."""
        self.controller.update(self.states[k], 0.0)

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
        self.solver.solve(*self.levels[k])

    def textbook(self, k):
        """Run kinematics, levels, the recursion with `np.linalg.pinv`, and the scaling."""
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


METHODS = {'Controller.update': Case.update, 'kinematics + solve': Case.kinematics_and_solve,
           'kinematics': Case.kinematics, 'solve': Case.solve, 'textbook pinv': Case.textbook}


def measure(cases, rounds, pause):
    """
    Return microseconds per cycle, {(case, method): array (rounds,)}.

    Parameters
    ----------
    cases : dict
        {name: Case}
    rounds : int
        How often everything is measured.
    pause : float
        Time asleep before each cycle [s]; 0 measures a tight loop.

    """
    times = {(case, method): [] for case in cases for method in METHODS}
    cycles = CYCLES if pause == 0.0 else CYCLES // 4
    for _ in range(rounds):
        for (case, method), row in times.items():
            cycle = METHODS[method]
            if pause == 0.0:
                began = time.thread_time_ns()
                for k in range(cycles):
                    cycle(cases[case], k % STATES)
                row.append((time.thread_time_ns() - began) / cycles / 1e3)
            else:
                spent = 0
                for k in range(cycles):
                    time.sleep(pause)
                    began = time.thread_time_ns()
                    cycle(cases[case], k % STATES)
                    spent += time.thread_time_ns() - began
                row.append(spent / cycles / 1e3)
    return {key: np.array(row) for key, row in times.items()}


def load_cases():
    """Return the cases by name; Talos comes from the example-robot-data package."""
    config = Path(__file__).resolve().parent.parent / 'config'
    talos = next(distribution('example-robot-data').locate_file(file)
                 for file in distribution('example-robot-data').files
                 if file.name == 'talos_reduced.urdf')
    robots = {'panda': (Robot.from_file(config / 'robots' / 'panda.yaml'), PANDA_READY),
              'talos': (Robot.from_urdf(str(talos), joints=TALOS_JOINTS), TALOS_READY)}
    return {name: Case(*robots[robot], stack) for name, (robot, stack) in CASES.items()}


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=21)
    parser.add_argument('--cold', action='store_true',
                        help='one cycle per millisecond, as in a running node')
    options = parser.parse_args()
    times = measure(load_cases(), options.rounds, 1e-3 if options.cold else 0.0)
    pace = 'one cycle per millisecond' if options.cold else 'tight loop'
    print(f'µs per cycle, {pace}: median (fastest to slowest of {options.rounds} rounds), '
          'and share of the textbook recursion\n')
    for case in CASES:
        print(case)
        reference = np.median(times[case, 'textbook pinv'])
        for method in METHODS:
            row = times[case, method]
            median = np.median(row)
            print(f'  {method:<20} {median:7.1f}  ({row.min():6.1f} to {row.max():6.1f})  '
                  f'{median / reference:5.2f}')


if __name__ == '__main__':
    main()

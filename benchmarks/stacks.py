# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Time control cycles of larger stacks, in microseconds: inequality tasks, and thirty joints.

Run as ``python benchmarks/stacks.py`` (or ``make bench``). Every stack runs in closed loops with
an ideal robot at 1 kHz: first to a goal within the bounds, after it has been blended in; then to a
goal beyond them, where the bounds limit the tool in nearly every cycle. Each figure is the
processor time of `Controller.update`, a mean over the cycles of a run; shown are the median over
the rounds, the fastest and the slowest round. All variants take turns in one process.

The plain recursion is that of `solver.py`: np.linalg.pinv and uniform scaling, for the equality
levels only.
"""

import argparse
import time

from _robots import CONFIG, load_robot, PANDA_READY, TALOS_READY
import numpy as np
from tp_controller import Controller, Settings, Stack

PERIOD = 1e-3
CYCLES = 300
# After so many cycles the goal has been blended in, and the tool has come to its bounds.
BLENDED, APPROACH = 600, 1500
TOOL = 'panda_hand_tcp'
CAPSULES = CONFIG / 'panda_capsules.yaml'
OBSTACLES = ('{table: {shape: half_space, at: [0, 0, -0.05]}, '
             'post: {shape: {cylinder: [0.08, 1.2]}, at: [0.45, 0.35, 0.6]}, '
             'box: {shape: {box: [0.2, 0.2, 0.2]}, at: [0.5, -0.4, 0.5]}}')
# What stands above tool and posture, and a goal for the tool beyond it [m].
BOUNDS = {
    'nothing above': ('', [0.45, 0.35, 0.6]),
    'joint_limits': ('- guard: {type: joint_limits, joints: panda_joint1, margin: 2.5}',
                     [0.25, 0.45, 0.5]),
    'keep_out': (f'- guard: {{type: keep_out, frame: {TOOL}, radius: 0.05, '
                 'shape: {cylinder: [0.08, 1.2]}, at: [0.45, 0.35, 0.6]}', [0.45, 0.35, 0.6]),
    'field_of_view': ('- guard: {type: field_of_view, frame: panda_link7, half_angle: 0.4, '
                      'target: [0.5, 0.15, 0.0]}', [0.4, -0.4, 0.5]),
    'tilt': (f'- guard: {{type: tilt, frame: {TOOL}, axis: -z, within: 0.1}}', [0.75, 0.2, 0.3]),
    'orientation_range': (f'- guard: {{type: orientation_range, frame: {TOOL}, '
                          'target: [1, 0, 0, 0], maximum: [0.1, 0.1, 0.5]}', [0.75, 0.2, 0.3]),
    'distance': (f'- guard: {{type: distance, frame: {TOOL}, reference: panda_link1, '
                 'maximum: 0.5}', [0.45, 0.35, 0.6]),
    'manipulability_above': (f'- guard: {{type: manipulability_above, frame: {TOOL}, '
                             'minimum: 0.075}', [0.8, 0.3, 0.5]),
    'speed_limit': (f'- guard: {{type: speed_limit, frame: {TOOL}, linear: 0.02}}',
                    [0.45, 0.35, 0.6]),
    'obstacles, three': (f'- guard: {{type: obstacles, capsules: {CAPSULES}, '
                         f'obstacles: {OBSTACLES}}}', [0.45, 0.35, 0.6]),
    'self_collision': (f'- guard: {{type: self_collision, capsules: {CAPSULES}}}',
                       [0.05, 0.1, 0.2]),
}
TALOS = """
- [left_foot: {type: pose, frame: leg_left_6_link},
   right_foot: {type: pose, frame: leg_right_6_link}]
- balance: {type: center_of_mass, axes: xy}
- left: {type: pose, frame: arm_left_7_link}
- right: {type: pose, frame: arm_right_7_link}
- eyes: {type: look_at, frame: head_2_link, axis: x, target: [1.5, 0.3, 0.5]}
- posture: {type: posture, gain: 0.5}
"""
SOLE = '[[0.1, 0.06, 0], [-0.1, 0.06, 0], [-0.1, -0.06, 0], [0.1, -0.06, 0]]'
SUPPORTED = TALOS.replace('center_of_mass, axes: xy', 'com_polygon, contacts: '
                          f'{{left_sole_link: {SOLE}, right_sole_link: {SOLE}}}')
LEG_READY = (0.0, 0.0, -0.4, 0.8, -0.4, 0.0)


class Loop:
    """A closed loop with an ideal robot that begins anew whenever it is run."""

    def __init__(self, robot, ready, text, task, goal, approach, locked=()):
        self.robot, self.text = robot, text
        self.start = np.array(ready, dtype=float)
        self.task, self.goal, self.approach, self.locked = task, goal, approach, locked

    def run(self):
        """Return microseconds of processor time per cycle."""
        controller = Controller(self.robot, Stack.from_yaml(self.text, self.robot),
                                Settings(period=PERIOD))
        q = self.start
        controller.update(q, 0.0)
        controller.set_goal(self.task, self.goal, 0.0)
        controller.lock(self.locked, 0.0)
        spent = 0
        for cycle in range(1, self.approach + CYCLES):
            began = time.thread_time_ns()
            velocity = controller.update(q, cycle * PERIOD).velocity
            if cycle >= self.approach:
                spent += time.thread_time_ns() - began
            q = q + PERIOD * velocity
        return spent / CYCLES / 1e3

    def plain(self):
        """Return microseconds per cycle of the plain recursion, at the start."""
        robot, state = self.robot, self.robot.state(self.start)
        stack = Stack.from_yaml(self.text, robot)
        stack.start(state)
        began = time.thread_time_ns()
        for _ in range(CYCLES):
            state.update(self.start)
            zeta, P = np.zeros(robot.n), np.eye(robot.n)
            for level in stack.levels(state, 0.0):
                J_bar = level.J @ P
                inverse = np.linalg.pinv(J_bar, rcond=1e-9)
                zeta = zeta + inverse @ (level.v - level.J @ zeta)
                P = P - inverse @ J_bar
            scale = np.max(np.abs(zeta) / robot.velocity)
            zeta = zeta / scale if scale > 1.0 else zeta
        return (time.thread_time_ns() - began) / CYCLES / 1e3


def loops():
    """Return {name: (Loop whose goal is allowed, Loop whose goal is beyond the bounds)}."""
    found = {}
    panda = load_robot('Panda')
    for name, (bounds, goal) in BOUNDS.items():
        text = (f'{bounds}\n- tool: {{type: position, frame: {TOOL}, gain: 2.0}}\n'
                '- posture: {type: posture, gain: 0.5}\n')
        here = panda.state(np.array(PANDA_READY)).position(TOOL)
        found[f'Panda: {name}'] = (
            Loop(panda, PANDA_READY, text, 'tool', here + [0.0, 0.0, 0.01], BLENDED),
            Loop(panda, PANDA_READY, text, 'tool', goal, APPROACH))
    T = panda.state(np.array(PANDA_READY)).pose(TOOL).copy()
    for name, locked in (('pose > posture', ()), ('pose > posture, a joint locked',
                                                  ('panda_joint3',))):
        text = f'- tool: {{type: pose, frame: {TOOL}}}\n- posture: {{type: posture, gain: 0.5}}\n'
        near, far = T.copy(), T.copy()
        near[2, 3] += 0.01
        far[:3, 3] += [0.8, 0.3, 0.4]
        found[f'Panda: {name}'] = (
            Loop(panda, PANDA_READY, text, 'tool', near, BLENDED, locked),
            Loop(panda, PANDA_READY, text, 'tool', far, APPROACH, locked))
    talos = load_robot('Talos, 30 joints')
    ready = np.array([*LEG_READY, *LEG_READY, *TALOS_READY])
    hand = talos.state(ready).pose('arm_left_7_link').copy()
    near, far = hand.copy(), hand.copy()
    near[2, 3] += 0.01
    far[:3, 3] += [0.8, 0.3, 0.4]
    for name, text, locked in (('30 joints, 6 levels', TALOS, ()),
                               ('a joint locked', TALOS, ('arm_left_3_joint',)),
                               ('com_polygon', SUPPORTED, ())):
        found[f'Talos: {name}'] = (Loop(talos, ready, text, 'left', near, BLENDED, locked),
                                   Loop(talos, ready, text, 'left', far, APPROACH, locked))
    return found


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=7)
    rounds = parser.parse_args().rounds
    pairs = loops()
    panda = next(iter(pairs.values()))[0]
    talos = pairs['Talos: 30 joints, 6 levels'][0]
    times = {name: [] for name in pairs}
    books = {'Panda': [], 'Talos': []}
    for _ in range(rounds):
        for name, (free, bounded) in pairs.items():
            times[name].append((free.run(), bounded.run()))
        books['Panda'].append(panda.plain())
        books['Talos'].append(talos.plain())
    print('| stack | bounds not reached | at the bounds |')
    print('| --- | --- | --- |')
    for name, measured in times.items():
        cells = [f'{np.median(column):.0f} ({min(column):.0f}–{max(column):.0f})'
                 for column in zip(*measured)]
        print(f'| {name} | {" | ".join(cells)} |')
    for name, column in books.items():
        print(f'| {name}: plain recursion '
              f'| {np.median(column):.0f} ({min(column):.0f}–{max(column):.0f}) | |')


if __name__ == '__main__':
    main()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""
Largest change of a command in one cycle while nothing changes, and its cause.

Robots with stacks of one to four random tasks, and often a posture, get goals once, and 6 s to
get there at 100 Hz. The first 0.6 s, with the transition to the goals, do not count. The kind of
the largest change of a run is

- ``demand``: a task demands something else at once, by more than a quarter of its length, as
  where a rotation passes half a turn;
- ``bounds``: an inequality task is at a bound, or outside;
- ``limits``: joints are at their limits;
- ``singular``: none of these: directions near a singularity turn with the robot.
"""

import argparse
from collections import Counter, deque
from dataclasses import dataclass
import zlib

from _robots import load_robot
import numpy as np
from tp_controller import Controller, Settings, Stack

ROBOTS = ('HyQ', 'SO-101', 'Talos', 'Baxter', 'Panda', 'UR5')
KINDS = ('demand', 'bounds', 'limits', 'singular')
# Changes above this count [rad/s].
NOTABLE = 1.0
RATE, SECONDS, SETTLING = 100, 6.0, 0.6
# {type: what its entry in a stack has; `point` is near the frame, `way` any direction}
TYPES = {
    'pose': '', 'position': '', 'orientation': '', 'manipulability': '',
    'pointing': 'axis: z, target: {way}', 'look_at': 'axis: z, target: {point}',
    'field_of_view': 'half_angle: 0.6, target: {point}',
    'manipulability_above': 'minimum: 0.05',
    'keep_in': 'shape: {{box: [0.4, 0.4, 0.4]}}, at: {here}',
    'keep_out': 'radius: 0.05, shape: {{sphere: 0.1}}, at: {point}'}
GOALS = ('pose', 'position', 'orientation')


@dataclass
class Jump:
    """The largest change of a command in one cycle of a run [rad/s], and its kind."""

    size: float = 0.0
    kind: str = ''


class Scene:
    """A robot, its stack and goals, drawn from a generator of its own."""

    def __init__(self, name, number, acceleration=None):
        self.random = random = np.random.default_rng((zlib.crc32(name.encode()), number))
        self.robot = robot = load_robot(name, acceleration)
        self.lower, self.upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
        self.start = random.uniform(self.lower, self.upper)
        wider = random.choice([0.0, 0.3]) * (self.upper - self.lower)
        self.aim = random.uniform(self.lower - wider, self.upper + wider)
        here = robot.state(self.start)
        self.frames = [frame for frame in robot.frame_names[1:]
                       if np.linalg.norm(here.jacobian(frame)) > 0.5]
        lines = [self.entry(number, here) for number in range(random.integers(1, 5))]
        if random.random() < 0.7:
            lines.append(f'- posture: {{type: posture, gain: {random.uniform(0.3, 2.0):.2f}}}')
        self.stack = Stack.from_yaml('\n'.join(lines), robot)

    def entry(self, number, here):
        """Return one line of the stack."""
        random = self.random
        kind, frame = str(random.choice(list(TYPES))), str(random.choice(self.frames))
        position = here.position(frame)
        keys = TYPES[kind].format(
            here=position.round(3).tolist(), way=random.normal(size=3).round(3).tolist(),
            point=(position + 0.3 * random.normal(size=3)).round(3).tolist())
        return (f'- t{number}: {{type: {kind}, frame: {frame}, '
                f'gain: {random.uniform(1.0, 5.0):.2f}{", " * bool(keys)}{keys}}}')

    def controller(self, settings):
        """Return a controller that has its goals."""
        controller = Controller(self.robot, self.stack, settings)
        controller.update(self.start, 0.0)
        there = self.robot.state(self.aim)
        for task in self.stack.tasks.values():
            if task.type_name in GOALS:
                controller.set_goal(task.name, task.value(there), 0.0)
            elif task.type_name == 'posture':
                aim = np.clip(self.aim, self.robot.lower, self.robot.upper)
                controller.set_goal(task.name, aim, 0.0)
        return controller


def run(name, number, acceleration=None, late=0, rate=RATE, **settings):
    """
    Return the largest `Jump` of a run.

    Parameters
    ----------
    name : str
        Robot.
    number : int
        Which start, stack and goals.
    acceleration : float, optional
        Limit of every joint [rad/s²].
    late : int
        Cycles after which a command acts.
    rate : int
        Cycles per second.
    settings
        Others than the default ones.

    """
    scene = Scene(name, number, acceleration)
    controller = scene.controller(Settings(period=1.0 / rate, **settings))
    q, before, found = scene.start, None, Jump()
    pending = deque([np.zeros(scene.robot.n)] * late)
    for cycle in range(1, round(SECONDS * rate)):
        command = controller.update(q, cycle / rate)
        if before is not None and cycle > SETTLING * rate:
            size = float(np.abs(command.velocity - before.velocity).max())
            if size > found.size:
                found = Jump(size, kind_of(before.report._solution, command.report._solution))
        before = command
        pending.append(command.velocity)
        q = scene.robot.integrate(q, pending.popleft(), 1.0 / rate)
    return found


def kind_of(before, after):
    """Return the kind of a change from one `Solution` to the next one."""
    demands = [(one.v, other.v) for one, other in zip(before.hierarchy, after.hierarchy)
               if one.v is not None and other.v is not None]
    if any(np.linalg.norm(v - w) > 0.25 * max(np.linalg.norm(v), np.linalg.norm(w), 1e-3)
           for v, w in demands):
        return 'demand'
    if any(_is_active(level, solution.velocity) for solution in (before, after)
           for level in solution.hierarchy if level.v is None):
        return 'bounds'
    limited = any(len(level.limited_by) for solution in (before, after)
                  for level in solution.levels)
    return 'limits' if limited else 'singular'


def _is_active(level, velocity):
    """Return whether a level with bounds is at one of them, or outside."""
    achieved = level.J @ velocity
    return bool((np.minimum(achieved - level.lower, level.upper - achieved) < 1e-6).any())


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=100, help='of each robot')
    parser.add_argument('--robots', nargs='+', choices=ROBOTS, default=ROBOTS)
    parser.add_argument('--late', type=int, default=0, help='cycles after which a command acts')
    parser.add_argument('--acceleration', type=float, help='limit of every joint [rad/s²]')
    options = parser.parse_args()
    head = ('robot', f'runs with more than {NOTABLE:g} rad/s',
            *(f'{kind}: runs, largest' for kind in KINDS))
    print('| ' + ' | '.join(head) + ' |\n|' + ' --- |' * len(head))
    for name in options.robots:
        jumps = [run(name, number, options.acceleration, options.late)
                 for number in range(options.runs)]
        notable = [each for each in jumps if each.size > NOTABLE]
        count = Counter(each.kind for each in notable)
        cells = [name, f'{len(notable)} of {options.runs}']
        for kind in KINDS:
            largest = max((each.size for each in jumps if each.kind == kind), default=0.0)
            cells.append(f'{count[kind]}, {largest:.2f} rad/s')
        print('| ' + ' | '.join(cells) + ' |', flush=True)


if __name__ == '__main__':
    main()

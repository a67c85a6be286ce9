# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare ways to respect velocity limits, on the same random states (see docs/limits.md).

Run as ``python benchmarks/limits.py``. Joint positions are uniformly distributed in their ranges.
Every level demands a velocity in a random direction: the first level 0.3 to 2 (m/s, or m/s and
rad/s), the others 0.3 to 2 rad/s, a posture up to half the speed limits of the joints.
"""

import argparse

from _robots import load_robot
import numpy as np
from tp_controller import Settings, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.solver.level import Level
from tp_controller.solver.solve import solve_cycle

SEED = 0
STATES = 1000
SPEEDS = 0.3, 2.0
# The first level counts as carried out in full up to this share of its speed.
FULL = 0.01
# Directions of slower motions are rounding [m/s].
SLOWEST = 1e-6
TWO_LEVELS = """
- position: {type: position, frame: panda_hand_tcp}
- orientation: {type: orientation, frame: panda_hand_tcp}
"""
THREE_LEVELS = """
- position: {type: position, frame: panda_hand_tcp}
- direction: {type: orientation, frame: panda_hand_tcp, axes: xy}
- posture: {type: posture}
"""
ARMS = """
- grip: {type: pose, frame: left_gripper, reference: right_gripper}
- left: {type: position, frame: left_gripper}
- posture: {type: posture}
"""
# {name: (robot, stack, whether position limits count, too)}
CASES = {
    'Panda, position > orientation': ('Panda', TWO_LEVELS, False),
    'Panda, position > two axes of orientation > posture': ('Panda', THREE_LEVELS, False),
    'the same with position limits': ('Panda', THREE_LEVELS, True),
    'Baxter, relative pose > left position > posture': ('Baxter', ARMS, False),
}


def solver(robot, scaling, cap=None):
    """Return a function (levels, lower, upper) -> velocity (n,) with the default settings."""
    settings = Settings(scaling=scaling)
    options = settings.solver(robot.n)

    def velocity(levels, lower=None, upper=None):
        return solve_cycle(levels, lower, upper, options, settings.period, cap).velocity
    return velocity


def methods(robot):
    """Return {name: function (levels, lower, upper) -> velocity (n,)}."""
    uniform = solver(robot, 'uniform')
    redistribute = solver(robot, 'redistribute', Settings().speed_cap(robot))

    def scaled_first(levels, lower, upper):
        first = Level(levels[0].J, levels[0].v, 'scale')
        return redistribute([first, *levels[1:]], lower, upper)

    return {
        'uniform': uniform,
        'clip': lambda levels, *bounds: np.clip(uniform(levels), *bounds),
        'redistribute, least_squares': redistribute,
        'redistribute, first level scale': scaled_first,
    }


def states(robot, stack, positions_count, count):
    """Yield random levels, and bounds on the velocities."""
    random = np.random.default_rng(SEED)
    limits = VelocityLimits(robot, Settings().period, Settings().braking_gain)
    state = robot.state(robot.neutral())
    for _ in range(count):
        state.update(random.uniform(robot.lower, robot.upper))
        levels = []
        for task in stack.tasks.values():
            if task.type_name == 'posture':
                v = 0.5 * robot.velocity * random.uniform(-1.0, 1.0, robot.n)
            else:
                v = random.standard_normal(task.rows)
                v *= random.uniform(*SPEEDS) / np.linalg.norm(v)
            levels.append(Level(task.jacobian(state), v))
        if positions_count:
            bounds = limits.at(JointMotion(state.q, np.zeros(robot.n), Settings().period))
            yield levels, bounds.lower, bounds.upper
        else:
            yield levels, -robot.velocity, robot.velocity


def qualities(levels, velocity, unlimited):
    """
    Return how well levels are carried out, the first beside what it is without limits.

    Returns
    -------
    full : bool
        Whether the first is carried out in full.
    scale : float
        Its speed in its direction without limits, over its speed there.
    angle : float
        Between its directions with and without limits [degrees]; NaN at rest.
    errors : list of float
        Of the levels below, relative.

    """
    relative = [np.linalg.norm(level.v - level.J.dot(velocity)) / np.linalg.norm(level.v)
                for level in levels[1:]]
    demand, achieved = levels[0].J.dot(unlimited), levels[0].J.dot(velocity)
    along = demand.dot(achieved)
    size, speed = np.linalg.norm(demand), np.linalg.norm(achieved)
    angle = np.degrees(np.arccos(np.clip(along / (size * speed), -1.0, 1.0))) \
        if speed > SLOWEST else np.nan
    full = np.linalg.norm(demand - achieved) <= FULL * size
    return full, along / size ** 2, angle, relative


def compare(name, count=STATES):
    """Return {method: (full, scales, angles, errors)}, arrays over the states of a case."""
    robot_name, stack_text, positions_count = CASES[name]
    robot = load_robot(robot_name)
    stack = Stack.from_yaml(stack_text, robot)
    functions, free = methods(robot), solver(robot, 'uniform')
    found = {method: [] for method in functions}
    for levels, lower, upper in states(robot, stack, positions_count, count):
        unlimited = free(levels)
        for method, function in functions.items():
            found[method].append(qualities(levels, function(levels, lower, upper),
                                           unlimited))
    return {method: tuple(np.array(column) for column in zip(*rows))
            for method, rows in found.items()}


def main():
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--states', type=int, default=STATES)
    options = parser.parse_args()
    print('| stack | method | first task in full | its speed, mean / 5th percentile '
          '| its direction is off, mean / 95th percentile | relative error of the levels below |')
    print('| --- | --- | --- | --- | --- | --- |')
    for name in CASES:
        shown = name
        for method, (full, scales, angles, errors) in compare(name, options.states).items():
            below = ', '.join(f'{value:.2f}' for value in errors.mean(axis=0))
            print(f'| {shown} | {method} | {100.0 * full.mean():.1f} % '
                  f'| {scales.mean():.2f} / {np.percentile(scales, 5):.2f} '
                  f'| {np.nanmean(angles):.1f}° / {np.nanpercentile(angles, 95):.1f}° '
                  f'| {below} |')
            shown = ''


if __name__ == '__main__':
    main()

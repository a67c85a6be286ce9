# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Follow fast random paths under limits, with and without a reserve (see docs/limits.md).

Run as ``python benchmarks/paths.py``. A Panda follows a random Lissajous figure with its tool.
Below this level it keeps the tool pointing down, below that it moves its elbow up and down, and
the last level is a posture. The robot is ideal, at 1 kHz. Measured is from 1 s on, when the tool
has reached the figure.
"""

import argparse

from _robots import load_robot
import numpy as np
from tp_controller import Settings
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.solver.level import identity, Level
from tp_controller.solver.solve import solve_cycle

SEED = 0
PATHS = 20
SECONDS = 2.0
PERIOD = 1e-3
START = 1.0
READY = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8])
TOOL, ELBOW = 'panda_hand_tcp', 'panda_link4'
# Gains of the four levels [1/s].
GAINS = (5.0, 3.0, 2.0, 0.5)
ELBOW_STROKE, ELBOW_RATE = 0.1, 2.0
# What counts as a path that was lost [m], and as a jump of the command [rad/s].
LOST = 5e-3
JUMP = 0.1
# (acceleration limit, settings)
RUNS = [(15.0, {'reserve': 0.0}), (15.0, {'reserve': 0.4}), (15.0, {'reserve': 1.0}),
        (None, {}), (None, {'regularisation': 0.01})]


class Path:
    """A Lissajous figure in front of the robot, and a smooth way from its tool onto it."""

    def __init__(self, random, start):
        self._start, self._centre = start, start + (-0.08, 0.0, -0.1)
        self._size = random.uniform(0.1, 0.25, 3)
        self._rate = 2.0 * np.pi * random.uniform(0.2, 0.6, 3)
        self._phase = random.uniform(0.0, 2.0 * np.pi, 3)

    def at(self, now):
        """Return the position at a time (3,)."""
        figure = self._centre + self._size * np.sin(self._rate * now + self._phase)
        share = min(now / START, 1.0)
        return self._start + share * share * (3.0 - 2.0 * share) * (figure - self._start)


def levels_at(state, goal, velocity, elbow, pointing):
    """
    Return the four levels.

    Parameters
    ----------
    state : RobotState
        Where the robot is.
    goal, velocity : ndarray (3,)
        Of the tool [m], [m/s].
    elbow : float
        Height wanted of it [m].
    pointing : ndarray (3,)
        Direction wanted of the tool.

    Returns
    -------
    list of Level
        The second is about the turn that takes the tool's axis to `pointing`, about its other
        two axes.

    """
    J, R = state.jacobian(TOOL), state.rotation(TOOL)
    across = R[:, :2].T
    missing = across.dot(np.cross(R[:, 2], pointing))
    return [Level(J[:3], GAINS[0] * (goal - state.position(TOOL)) + velocity),
            Level(across.dot(J[3:]), GAINS[1] * missing),
            Level(state.jacobian(ELBOW)[2:3],
                  GAINS[2] * (elbow - state.position(ELBOW)[2:])),
            Level(identity(len(state.q)), GAINS[3] * (READY - state.q))]


def follow(robot, path, settings, seconds):
    """
    Follow a path.

    Returns
    -------
    errors, turns : ndarray (cycles,)
        Distance of the tool from the path [m], and of its axis from pointing down [rad].
    jumps : ndarray (cycles,)
        Largest change of a velocity from the cycle before [rad/s].

    """
    options, memory = settings.solver(robot.n), ()
    limits = VelocityLimits(robot, settings.period, settings.braking_gain)
    cap = settings.speed_cap(robot)
    q, velocity = READY, np.zeros(robot.n)
    state = robot.state(q)
    elbow, pointing = state.position(ELBOW)[2], state.rotation(TOOL)[:, 2]
    rows = []
    for cycle in range(int(seconds / PERIOD)):
        now = cycle * PERIOD
        state.update(q)
        goal = path.at(now)
        levels = levels_at(state, goal, (path.at(now + PERIOD) - goal) / PERIOD,
                           elbow + ELBOW_STROKE * np.sin(ELBOW_RATE * now), pointing)
        bounds = limits.at(JointMotion(q, velocity, PERIOD))
        previous = velocity
        solution = solve_cycle(levels, bounds.lower, bounds.upper, options, settings.period, cap,
                               memory)
        velocity, memory = solution.velocity, solution.memory
        q = q + PERIOD * velocity
        rows.append((np.linalg.norm(goal - state.position(TOOL)),
                     np.arccos(np.clip(pointing.dot(state.rotation(TOOL)[:, 2]), -1.0, 1.0)),
                     np.abs(velocity - previous).max()))
    return tuple(np.array(column)[int(START / PERIOD):] for column in zip(*rows))


def compare(acceleration, changes, count, seconds):
    """
    Return what came of following the same random paths.

    Returns
    -------
    dict
        `lost` paths, means over the paths of the `rms` errors of the first [m] and the
        `second` level [rad], `jumps` and how many paths are `jumping`, `largest` jump [rad/s].

    """
    robot = load_robot('Panda', acceleration)
    settings = Settings(period=PERIOD, braking_gain=50.0, command_delay=0, **changes)
    random = np.random.default_rng(SEED)
    start = robot.state(READY).position(TOOL)
    rows = [follow(robot, Path(random, start), settings, seconds) for _ in range(count)]
    jumps = [int((jump > JUMP).sum()) for _, _, jump in rows]
    return {
        'lost': sum(errors.max() > LOST for errors, _, _ in rows),
        'rms': np.mean([np.sqrt((errors ** 2).mean()) for errors, _, _ in rows]),
        'second': np.mean([np.sqrt((turns ** 2).mean()) for _, turns, _ in rows]),
        'jumps': sum(jumps), 'jumping': sum(jump > 0 for jump in jumps),
        'largest': max(jump.max() for _, _, jump in rows)}


def main():
    """Follow and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--paths', type=int, default=PATHS)
    parser.add_argument('--seconds', type=float, default=SECONDS,
                        help='how long each is followed, after the first second')
    options = parser.parse_args()
    print('| acceleration limit | settings | paths with an error > 5 mm | rms error, mean '
          '| error of the direction | changes > 0.1 rad/s in a cycle | largest |')
    print('| --- | --- | --- | --- | --- | --- | --- |')
    for acceleration, changes in RUNS:
        found = compare(acceleration, changes, options.paths, START + options.seconds)
        limit = 'none' if acceleration is None else f'{acceleration:g} rad/s²'
        shown = ', '.join(f'{name} {value:g}' for name, value in changes.items()) or 'default'
        print(f'| {limit} | {shown} | {found["lost"]} of {options.paths} '
              f'| {1e3 * found["rms"]:.2f} mm | {found["second"]:.2f} rad '
              f'| {found["jumps"]} in {found["jumping"]} paths | {found["largest"]:.3f} rad/s |',
              flush=True)


if __name__ == '__main__':
    main()

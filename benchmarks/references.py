# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""
Distance of a tool from the path that it gets in chunks, with jitter, loss and overlap.

A Panda at 100 Hz, ideal, with the tool's pose above a posture, receives a circle, a square and a
line (0.2 m/s at most) in chunks of 32 poses, or in one piece. A chunk is sent every third pose,
arrives up to two poses late, and a fifth of them never arrive. Distances are from where the path
is at that time, after the first 1.5 s; the change of the command is its largest one in a cycle.
"""

import argparse
from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Settings, Stack

PERIOD, SECONDS, SETTLING = 0.01, 8.0, 1.5
START = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
TOOL, SIZE, SPEED = 'panda_hand_tcp', 0.1, 0.2
STACK = f"""
- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
"""
CHUNK, EVERY, LATE, LOST = 32, 3, 2.0, 0.2


class Result(NamedTuple):
    """Distances from the path (cycles,) [m], and velocities of the joints (cycles, n) [rad/s]."""

    distances: np.ndarray
    velocities: np.ndarray


def circle(times: np.ndarray) -> np.ndarray:
    """Return points on a circle through the origin (k, 3) [m]."""
    angles = SPEED / SIZE * times
    return SIZE * np.stack((np.cos(angles) - 1.0, np.sin(angles), 0.0 * times), axis=-1)


def square(times: np.ndarray) -> np.ndarray:
    """Return the points of a path along four sides, each from rest to rest (k, 3) [m]."""
    corners = SIZE * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    return along(corners, times)


def line(times: np.ndarray) -> np.ndarray:
    """Return points on a line, to and fro (k, 3) [m]."""
    return along(SIZE * np.array([[0.0, 0.0, 0.0], [0.0, 1.5, 0.5]]), times)


def along(corners: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return points on a closed polygon, with the least jerk on each side (k, 3) [m]."""
    duration = 1.875 * np.linalg.norm(corners[1] - corners[0]) / SPEED
    number = np.maximum(times, 0.0) / duration
    side = np.floor(number).astype(int)
    u = (number - side)[:, np.newaxis]
    begin, end = corners[side % len(corners)], corners[(side + 1) % len(corners)]
    return begin + (end - begin) * (10.0 * u ** 3 - 15.0 * u ** 4 + 6.0 * u ** 5)


PATHS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    'circle': circle, 'square': square, 'line': line}


def run(path: str, rate: float, seed: int, at_once: bool = False) -> Result:
    """Return the result of one path, in poses of a rate [Hz]."""
    robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')
    controller = Controller(robot, Stack.from_yaml(STACK, robot), Settings(period=PERIOD))
    simulator, rng = KinematicSimulator(robot, START), np.random.default_rng(seed)
    start = robot.state(START).pose(TOOL).copy()

    def poses(times: np.ndarray) -> np.ndarray:
        """Return poses on the path (k, 4, 4)."""
        found = np.tile(start, (len(times), 1, 1))
        found[:, :3, 3] += PATHS[path](times)
        return found

    waiting: list[tuple[float, np.ndarray]] = []
    if at_once:
        waiting.append((PERIOD, np.arange(PERIOD, SECONDS + 1.0, 1.0 / rate)))
    sent, distances, velocities = -math.inf, [], []
    for cycle in range(round(SECONDS / PERIOD)):
        now = PERIOD * cycle
        if not at_once and now - sent >= EVERY / rate - 1e-9:
            sent = now
            if rng.random() >= LOST or cycle == 0:
                waiting.append((now + max(rng.uniform(0.0, LATE) / rate, PERIOD),
                                now + np.arange(CHUNK) / rate))
        for arrival, times in [each for each in waiting if each[0] <= now]:
            waiting = [each for each in waiting if each[1] is not times]
            controller.set_trajectory('tool', times, poses(times), now)
        velocity = controller.update(simulator.q, now).velocity
        simulator.command(velocity)
        simulator.step(PERIOD)
        place = robot.state(simulator.q).position(TOOL)
        distances.append(np.linalg.norm(place - poses(np.array([now + PERIOD]))[0, :3, 3]))
        velocities.append(velocity)
    return Result(np.array(distances), np.array(velocities))


def main() -> None:
    """Print the distances."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('--runs', type=int, default=10, help='number of each kind (default: 10)')
    options = parser.parse_args()
    print('| path | poses | mean distance | largest distance | change of the command |\n'
          '|---|---|---|---|---|')
    first = round(SETTLING / PERIOD)
    for path in PATHS:
        for rate, at_once in ((10.0, False), (20.0, False), (50.0, False), (20.0, True)):
            found = [run(path, rate, seed, at_once) for seed in range(
                1 if at_once else options.runs)]
            distances = np.concatenate([each.distances[first:] for each in found])
            change = max(float(np.abs(np.diff(each.velocities[first:], axis=0)).max())
                         for each in found)
            kind = f'{rate:g} Hz, {"in one piece" if at_once else "in chunks"}'
            print(f'| {path} | {kind} | {1e3 * distances.mean():.2f} mm | '
                  f'{1e3 * distances.max():.2f} mm | {change:.3f} rad/s |', flush=True)


if __name__ == '__main__':
    main()

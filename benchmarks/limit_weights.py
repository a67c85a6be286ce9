# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare weights that follow the distance to the joint limits with the tasks about these limits.

Run as ``python benchmarks/limit_weights.py``; ``--goals 10`` for a first impression. Redundant
arms start at a random configuration; the goal of the tool is its value at another one, a random
share of the way to a second random configuration. They have 8 s for each goal at 100 Hz, with the
default settings, gain 2, and an ideal robot.

The rule of Chan and Dubey (1995) makes a joint the more costly, the nearer it is to a limit,
w = 1 + |∂H/∂q| with H = Σ (upper − lower)² / (4 (upper − q) (q − lower)), and 1 while the joint
moves away from the limit. ``weights, both ways`` has no such switch. These weights are those of
the solver, recomputed in each cycle; tasks stand below the tool, or above it.

Each robot has a table, and all together have one: the share of goals reached; the median time to
those that all ways reach; the mean error of the tool's position at the end; the share of time in
which a joint is nearer to a limit than 1 % of half its range; the mean distance of the nearest
joint from its limit, in the same units; reversals per second; and the largest change of a command
in one cycle, as the median of the runs and the largest of all.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple
import zlib

from _motion import reversals
from _robots import load_robot
import numpy as np
from tp_controller import Controller, Level, Robot, Settings, Stack
from tp_controller.solver.solution import Bounds, Memory, Solution, Solver

GOALS = 200
PERIOD, SECONDS = 0.01, 8.0
# {robot: keys of the tool's task}; all of them have joints to spare.
ROBOTS = {'Panda': 'type: pose, frame: panda_hand_tcp', 'FR3': 'type: pose, frame: fr3_hand_tcp',
          'xArm 7': 'type: pose, frame: link7', 'TIAGo': 'type: pose, frame: arm_tool_link',
          'planar 10R': 'type: position, frame: link10, axes: xy'}
# Share of the way to the second configuration at which a goal is.
FAR = 0.1, 0.7
# Position up to which joints without limits are drawn [rad]; distance from a limit, over half the
# range, that counts as at it [1].
SPAN, AT_LIMIT = np.pi, 0.01
Rule = Callable[[Robot, np.ndarray, np.ndarray], np.ndarray]


def slope(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return ∂H/∂q (n,); 0 for joints without limits."""
    lower, upper = robot.lower, robot.upper
    limited = np.isfinite(upper - lower)
    low, high, at = lower[limited], upper[limited], q[limited]
    # At a limit the weight is large, but not infinite.
    gaps = np.maximum((high - at) * (at - low), 1e-3 * (high - low) ** 2)
    found = np.zeros(robot.n)
    found[limited] = (high - low) ** 2 * (2.0 * at - high - low) / (4.0 * gaps ** 2)
    return found


def on_approach(robot: Robot, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the weights of Chan and Dubey (n,), for the velocity of the last cycle."""
    change = slope(robot, q)
    return np.where(change * velocity > 0.0, 1.0 + np.abs(change), 1.0)


def both_ways(robot: Robot, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return weights that do not depend on the direction of motion (n,)."""
    return 1.0 + np.abs(slope(robot, q))


class Way(NamedTuple):
    """Stack about the tool, as entries above and below it, and the rule of the weights."""

    above: str = ''
    below: str = ''
    rule: Rule | None = None


LIMITS = '- limits: {{type: joint_limits, margin: {}}}'
WAYS = {'nothing': Way(), 'weights (Chan and Dubey)': Way(rule=on_approach),
        'weights, both ways': Way(rule=both_ways),
        'joint_limits, 0.1, below': Way(below=LIMITS.format(0.1)),
        'joint_limits, 0.15, below': Way(below=LIMITS.format(0.15)),
        'joint_limits, 0.05, above': Way(above=LIMITS.format(0.05)),
        'joint_limits, 0.1, below; weights': Way('', LIMITS.format(0.1), on_approach),
        'joint_limit_distance': Way(below='- relax: {type: joint_limit_distance, gain: 0.3}')}


class Outcome(NamedTuple):
    """One goal with one way; see the module."""

    reached: bool
    seconds: float
    error: float
    at_limit: float
    nearest: float
    reversals: float
    jump: float


class RuleSolver:
    """Solver whose weights follow a rule, cycle by cycle."""

    def __init__(self, settings: Settings, n: int) -> None:
        self._solver = settings.solver(n)

    def weigh(self, weights: np.ndarray) -> None:
        """Set the weights (n,) of the next cycle."""
        self._solver = replace(self._solver, weights=weights)

    def solve(self, levels: list[Level], bounds: Bounds, memory: Memory = ()) -> Solution:
        """Return the solution of a cycle."""
        return self._solver.solve(levels, bounds, memory)

    @property
    def undamped(self) -> Solver:
        """Return the solver without damping."""
        return self._solver.undamped


def run(robot: Robot, tool: str, way: Way, start: np.ndarray, end: np.ndarray) -> Outcome:
    """Return the outcome of one goal."""
    stack = Stack.from_yaml('\n'.join(filter(None, (way.above, tool, way.below))), robot)
    settings = Settings(period=PERIOD)
    solver = RuleSolver(settings, robot.n)
    controller = Controller(robot, stack, settings,
                            *([lambda settings, n: solver] if way.rule else ()))
    controller.update(start, 0.0)
    controller.set_goal('tool', stack.tasks['tool'].value(robot.state(end)), 0.0)
    q, velocity, commands, places, arrival = start, np.zeros(robot.n), [], [], np.inf
    for cycle in range(1, round(SECONDS / PERIOD) + 1):
        if way.rule:
            solver.weigh(way.rule(robot, q, velocity))
        command = controller.update(q, cycle * PERIOD)
        velocity = command.velocity
        report = next(task for task in command.report.tasks if task.name == 'tool')
        arrival = min(arrival, cycle * PERIOD) if report.reached else np.inf
        q = robot.integrate(q, velocity, PERIOD)
        commands.append(velocity)
        places.append(q)
    nearest = distances(robot, np.array(places))
    return Outcome(report.reached, arrival, report.errors[0][0],
                   float(np.mean(nearest < AT_LIMIT)), float(nearest.mean()),
                   reversals(np.array(commands), PERIOD),
                   float(np.abs(np.diff(commands, axis=0)).max()))


def distances(robot: Robot, places: np.ndarray) -> np.ndarray:
    """Return the distance of the nearest joint from its limit (T,), over half its range."""
    half = 0.5 * (robot.upper - robot.lower)
    return (np.minimum(robot.upper - places, places - robot.lower) / half).min(axis=1)


def outcomes(name: str, count: int) -> dict[str, list[Outcome]]:
    """Return the outcomes of a robot by way, in the order of the goals."""
    robot, random = load_robot(name), np.random.default_rng(zlib.crc32(name.encode()))
    tool = f'- tool: {{{ROBOTS[name]}, gain: 2.0}}'
    lower, upper = np.maximum(robot.lower, -SPAN), np.minimum(robot.upper, SPAN)
    starts, seconds = random.uniform(lower, upper, (2, count, robot.n))
    ends = starts + random.uniform(*FAR, (count, 1)) * (seconds - starts)
    return {shown: [run(robot, tool, way, *pair) for pair in zip(starts, ends)]
            for shown, way in WAYS.items()}


def row(shown: str, found: list[Outcome], by_all: np.ndarray) -> str:
    """Return the row of a way; `by_all` (runs,) are the goals that all ways reach."""
    reached, seconds, error, at_limit, nearest, turns, jump = np.array(found).T
    return (f'| {shown} | {100.0 * reached.mean():.1f} % | {np.median(seconds[by_all]):.2f} s '
            f'| {1e3 * error.mean():.1f} mm '
            f'| {100.0 * at_limit.mean():.1f} % | {100.0 * nearest.mean():.1f} % '
            f'| {turns.mean():.2f} | {np.median(jump):.3f}, {jump.max():.2f} rad/s |')


def table(title: str, found: dict[str, list[Outcome]]) -> Iterator[str]:
    """Yield the table of a robot, or of all."""
    by_all = np.all([[each.reached for each in runs] for runs in found.values()], axis=0)
    yield f'\n{title}, {len(by_all)} goals, {by_all.sum()} of them reached by all\n'
    yield ('| way | reached | time | error | at a limit | nearest joint '
           '| reversals 1/s | jump: median, most |\n|' + ' --- |' * 8)
    for shown, runs in found.items():
        yield row(shown, runs, by_all)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--goals', type=int, default=GOALS, help='for each robot')
    options = parser.parse_args()
    together: dict[str, list[Outcome]] = {shown: [] for shown in WAYS}
    for name in ROBOTS:
        found = outcomes(name, options.goals)
        print('\n'.join(table(name, found)), flush=True)
        for shown, runs in found.items():
            together[shown] += runs
    print('\n'.join(table('all', together)))


if __name__ == '__main__':
    main()

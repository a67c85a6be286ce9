# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare cycles in one call of the compiled core with those of `step`, over random stacks.

Run as ``python benchmarks/one_call.py --stacks 10000``. Stacks of all task types, on robots of
example-robot-data with fixed and moving bases, as in calm.py. In every cycle both controllers
begin with the same positions and the same memory; the reference evaluates all tasks in Python.
Counted are stacks whose commands differ by more than a share of the fastest joint, and of 1. Where
they do, the reference solves the levels of that cycle again, changed in their last digits: a
difference that is much larger than what this changes is a fault.
"""

import argparse
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from _random_stacks import Drawn
import numpy as np
from tp_controller import Controller, Settings, TpControllerError
from tp_controller.control.step import Commanded
from tp_controller.solver.level import Level

# Differences that are counted.
LEVELS = 1e-12, 1e-9, 1e-6
# Of a level whose last digits are changed: the digits, how often, and how much larger a difference
# may be than the largest change that this makes.
DIGITS, TRIALS, FACTOR = 1e-15, 8, 100.0
# The cycle in which goals are set.
CHANGE = 2
# Stacks of one job of a process.
TOGETHER = 20


def controllers(drawn):
    """Return a controller that uses the core, and one that does not."""
    found = []
    for by_step in (False, True):
        stack = drawn.stack()
        controller = Controller(drawn.robot, stack, Settings(period=1.0 / drawn.rate, blend=0.0))
        if by_step:
            controller._core.solve = lambda *given: None
            for task in stack.tasks.values():
                task.make_twin = lambda: None
        found.append(controller)
    return found


def changed(level, random):
    """Return a level that differs in the last digits."""
    def near(values):
        if values is None:
            return None
        noise = random.uniform(-DIGITS, DIGITS, values.shape)
        return values + noise * np.maximum(1.0, np.abs(np.where(np.isfinite(values), values, 0.0)))

    J = level.J if level.is_identity else near(level.J)
    if level.v is not None:
        return Level(J, near(level.v), level.mode, is_identity=level.is_identity)
    return Level(J, lower=near(level.lower), upper=near(level.upper))


def sensitivity(cycle):
    """Return the largest change of the velocities of a cycle by the last digits of its levels."""
    random, velocity, most = np.random.default_rng(0), cycle.solve().velocity, 0.0
    for _ in range(TRIALS):
        other = cycle._replace(levels=[changed(level, random) for level in cycle.levels])
        most = max(most, float(np.abs(other.solve().velocity - velocity).max(initial=0.0)))
    return most


def compare(number, cycles):
    """Return the largest difference, the cycles, those in one call, faults, and the name."""
    drawn = Drawn(number)
    one, other = controllers(drawn)
    q, period, worst, together, faults = drawn.start, 1.0 / drawn.rate, 0.0, 0, 0
    for cycle in range(cycles):
        now = cycle * period
        if cycle == CHANGE:
            for controller in (one, other):
                for name, goal in drawn.goals.items():
                    controller.set_goal(name, goal, now)
                for name, velocity in drawn.leading.items():
                    controller.set_feed_forward(name, velocity, now)
        other._last = Commanded(one._memory)
        try:
            found, expected = (each.update(q, now).velocity for each in (one, other))
        except TpControllerError as error:
            return float('nan'), cycle, together, faults, f'{drawn.name}: {error}'
        together += hasattr(one._last, 'numbers')
        scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
        difference = float(np.abs(found - expected).max(initial=0.0)) / scale
        if difference > LEVELS[0]:
            faults += difference * scale > FACTOR * sensitivity(other._last.cycle)
        worst = max(worst, difference)
        q = drawn.robot.integrate(q, found, period)
    return worst, cycles, together, faults, drawn.name


def compare_some(numbers, cycles):
    """Return the results of `compare` for some stacks."""
    return [(number, *compare(number, cycles)) for number in numbers]


def main():
    """Print how many stacks differ, and the worst of them."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--stacks', type=int, default=200)
    parser.add_argument('--cycles', type=int, default=20)
    given = parser.parse_args()
    jobs = [range(first, min(first + TOGETHER, given.stacks))
            for first in range(0, given.stacks, TOGETHER)]
    results = []
    with ProcessPoolExecutor() as pool:
        for some in pool.map(compare_some, jobs, [given.cycles] * len(jobs)):
            results += some
    cycles, together, faults = (sum(result[place] for result in results) for place in (2, 3, 4))
    failed = [result for result in results if np.isnan(result[1])]
    counts = Counter({level: sum(result[1] > level for result in results) for level in LEVELS})
    print(f'{len(results)} stacks, {cycles} cycles, {together} in one call, {len(failed)} failed; '
          + ', '.join(f'{count} differ by more than {level:g}' for level, count in counts.items())
          + f'; {faults} cycles by more than {FACTOR:g} times what the last digits change')
    for number, worst, *_, faults, name in sorted(
            results, key=lambda result: (-result[4], -result[1]))[:5]:
        print(f'{number:6d}  {worst:.1e}  {faults}  {name}')


if __name__ == '__main__':
    main()

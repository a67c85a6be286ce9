# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Count faults of the solver in random problems that are as hard as one can make them.

Run as ``python benchmarks/robustness.py``; ``--problems 500`` for a first impression. The
problems are those of the tests (`hard_problem` in test/unit/solver/problems.py): rows and levels
that repeat each other, exactly or to 1e-12 … 1e-3; units of rows and joints from 1e-6 to 1e6;
weights over up to twelve decades; bounds that exclude zero or leave nothing; levels with bounds,
levels without rows, one joint. Each is solved with five settings, by both solvers.

A level is *disturbed* if the levels below change it by more than 1e-9 of ‖J‖ ‖x‖ + ‖v‖, beyond
what is relaxed there. Without damping they are also taken away, and the answers compared. The two
solvers differ by the largest difference of a velocity, as a share of the largest velocity, and of
at least 1; *ordinary units* leaves out the problems whose joints have units.
"""

import argparse
from collections import Counter
from functools import partial
from importlib import import_module
from multiprocessing import Pool
from pathlib import Path
import sys
import warnings

import numpy as np
from tp_controller.solver import compiled
from tp_controller.solver.solve import solve_by_reference

TESTS = Path(__file__).parents[1] / 'test' / 'unit'
sys.path[:0] = [str(TESTS), str(TESTS / 'solver')]
audit = import_module('audit').audit
problems = import_module('problems')
SETTINGS = problems.SETTINGS

COLUMNS = ('answers', 'errors', 'not finite', 'beyond bounds', 'disturbed > 1e-9', '> 1e-6',
           'differ > 1e-9', '> 1e-6 differ', '… ordinary units', 'left')


def by_core(cycle):
    """Return what the core makes of a cycle; None where it leaves it to the other."""
    levels, lower, upper, options, period, cap, memory = cycle
    return compiled.solve_by_core(options.core, options.n, levels, lower, upper, period, cap,
                                  memory)


def by_reference(cycle):
    """Return what the solver in Python makes of a cycle."""
    return solve_by_reference(*cycle)


SOLVERS = {'Python': by_reference, 'core': by_core}


def count(seed, settings):
    """Return what happens to a problem, counted by setting, solver and column."""
    warnings.simplefilter('error')
    counted = Counter()
    for setting in settings:
        cycle, velocities = problems.hard_cycle(seed, setting), []
        for name, solver in SOLVERS.items():
            found = audit(cycle, solver)
            velocities.append(found.velocity)
            for column, value in zip(COLUMNS, (
                    found.velocity is not None, bool(found.error), found.not_finite, found.beyond,
                    found.disturbed > 1e-9, found.disturbed > 1e-6)):
                counted[setting, name, column] += value
        counted[setting, 'core', 'left'] += velocities[1] is None
        if all(each is not None for each in velocities):
            off = difference(*velocities)
            counted[setting, 'core', 'differ > 1e-9'] += off > 1e-9
            counted[setting, 'core', '> 1e-6 differ'] += off > 1e-6
            counted[setting, 'core', '… ordinary units'] += \
                off > 1e-6 and 'joint units' not in problems.features_of(seed)
    return counted


def difference(one, other):
    """Return by how much two velocities differ, as a share of the larger, and of 1."""
    return np.abs(one - other).max(initial=0.0) / max(1.0, np.abs(one).max(initial=0.0))


def main():
    """Count, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--problems', type=int, default=8000)
    parser.add_argument('--settings', nargs='+', choices=SETTINGS, default=SETTINGS)
    parser.add_argument('--jobs', type=int, default=1)
    options = parser.parse_args()
    counted = Counter()
    with Pool(options.jobs) as pool:
        for each in pool.imap_unordered(partial(count, settings=options.settings),
                                        range(options.problems), 50):
            counted.update(each)
    print('| setting | solver | ' + ' | '.join(COLUMNS) + ' |')
    print('|---' * (2 + len(COLUMNS)) + '|')
    for setting in options.settings:
        for name in SOLVERS:
            print(f'| {setting} | {name} | ' + ' | '.join(
                str(counted[setting, name, column]) for column in COLUMNS) + ' |')


if __name__ == '__main__':
    main()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inequality tasks that no configuration satisfies, alone or together with another one."""

from collections.abc import Collection, Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from tp_controller.control.task_report import TaskReport
from tp_controller.control.units import with_unit
from tp_controller.errors import TpControllerError
from tp_controller.model.spatial import Array
from tp_controller.tools.check.closed_loop import Loop
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Random configurations from which bounds are tried, and longest time for each [s].
STARTS, SECONDS = 3, 20.0


class Contradiction(NamedTuple):
    """
    Inequality task that no configuration satisfies.

    Attributes
    ----------
    task : str
    other : str
        Inequality task that it contradicts; empty if it cannot be satisfied alone.
    missing : str
        Least violation that was found, with its unit.

    """

    task: str
    other: str
    missing: str


def contradictions(setup: Setup, seed: np.random.SeedSequence) -> list[Contradiction]:
    """
    Return the inequality tasks that cannot be satisfied, without all tasks with a demand.

    If they cannot be satisfied all together, each is tried alone, then each pair of the others.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    seed : numpy.random.SeedSequence
        Seed of the `STARTS` configurations from which bounds are tried.

    Returns
    -------
    list of Contradiction
        One for each task that cannot be satisfied alone, and for each pair of others.

    """
    starts = [random_configuration(setup.robot, np.random.default_rng(each), setup.around)
              for each in seed.spawn(STARTS)]
    bounded = [task.name for task in setup.stack.active_tasks if task.bounded]
    if not bounded or not _least_violation(setup, bounded, starts):
        return []
    found = list(_alone(setup, bounded, starts))
    unsatisfiable = {each.task for each in found}
    for upper, lower in combinations([name for name in bounded if name not in unsatisfiable], 2):
        best = _least_violation(setup, (upper, lower), starts)
        if best:
            other = upper if best.name == lower else lower
            found.append(Contradiction(best.name, other, _missing(best)))
    return found


def _alone(setup: Setup, names: Sequence[str], starts: Sequence[Array]
           ) -> Iterator[Contradiction]:
    """Yield the tasks that cannot be satisfied alone."""
    for name in names:
        best = _least_violation(setup, (name,), starts)
        if best:
            yield Contradiction(name, '', _missing(best))


def _least_violation(setup: Setup, names: Collection[str], starts: Sequence[Array]
                     ) -> TaskReport | None:
    """Return the least violation of tasks without all others; None if they can be satisfied."""
    violations: list[list[TaskReport]] = []
    for start in starts:
        stack = setup.stack.copy()
        for task in stack.active_tasks:
            if task.name not in names:
                stack.enable(task.name, False)
        loop = Loop.at(setup, start, stack)
        try:
            loop.run(SECONDS)
        except TpControllerError:
            # A task fails; the runs report it.
            return None
        missed = [task for task in loop.reports if not task.reached]
        if not missed:
            return None
        violations.append(missed)
    # A task that is not the last one may still be on its way.
    least = min(violations, key=lambda tasks: sum(map(_size, tasks)))
    return max(least, key=_size)


def _size(task: TaskReport) -> float:
    """Return the largest error of a task in units of its tolerance."""
    return max(value / tolerance for value, _, tolerance in task.errors)


def _missing(task: TaskReport) -> str:
    """Return the errors of a task that exceed their tolerances, as text."""
    return ', '.join(with_unit(f'{value:.2g}', unit)
                     for value, unit, tolerance in task.errors if value > tolerance)

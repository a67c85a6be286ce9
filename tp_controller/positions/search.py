# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Search among configurations: a descent from the start, then from random configurations.

A descent may end at a saddle point, or beside a lower minimum. Where levels are not met, descents
from nearby follow, as in basin hopping (Wales and Doye, J. Phys. Chem. A 101, 1997).
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.descent import Descent, kept_cost, MET
from tp_controller.positions.locked_robot import fixed
from tp_controller.positions.position_stack import Point, PositionStack

# Costs that differ by no more than this share are equal.
EQUAL = 1e-3
# Number of descents from nearby, and standard deviation of their starts [rad or m].
NUDGES, NUDGE = 8, 0.15


class Attempts(NamedTuple):
    """
    Configuration that a search has found.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration [rad or m].
    costs : list of float
        Squared norm of the error of each level there.
    descents : int
        Number of descents of the search.

    """

    q: Array
    costs: list[float]
    descents: int

    def meets(self, needed: int) -> bool:
        """Return whether the first levels are met."""
        return sum(self.costs[:needed]) <= MET


def search(tasks: PositionStack, descent: Descent, needed: int, starts: Iterable[Array],
           wanted: int = 1) -> list[Attempts]:
    """
    Return configurations that meet the needed levels, or the best one if there is none.

    Parameters
    ----------
    tasks : PositionStack
        Tasks.
    descent : Descent
        Their descent.
    needed : int
        Number of first levels that have to be met.
    starts : iterable of ndarray (nq,)
        Configuration at which each descent starts [rad or m].
    wanted : int
        Number of configurations that end the search.

    """
    met: list[Attempts] = []
    best, descents = None, 0
    for start in starts:
        descent.begin()
        found = descent.approach(tasks.at(start), needed)
        descents += 1
        if sum(found.costs[:needed]) <= MET:
            if needed < len(found.costs):
                found = finish(tasks, descent, found)
            met.append(Attempts(found.q, found.costs, descents))
        elif best is None or is_better(found.costs[:needed], best.costs[:needed]):
            best = found
        if len(met) == wanted or descent.out_of_time():
            break
    if not met and best is not None:
        met = [Attempts(best.q, best.costs, descents)]
    return [each._replace(descents=descents) for each in met]


def nudges(robot: Robot) -> Array:
    """Return changes (count, n) of the positions that lead to the starts nearby."""
    found = np.random.default_rng(0).normal(0.0, NUDGE, (NUDGES, robot.n))
    return np.where(fixed(robot), 0.0, found)


def finish(tasks: PositionStack, descent: Descent, point: Point) -> Point:
    """Reduce all levels in turn; where some are not met, descend from nearby, too."""
    descent.begin()
    point = descent.finish(point)
    for nudge in nudges(tasks.robot):
        if sum(point.costs) <= MET or descent.out_of_time():
            break
        descent.begin()
        nearby = descent.approach(tasks.moved(point, nudge), len(point.costs))
        if not is_better(nearby.costs, point.costs):
            continue
        descent.begin()
        nearby = descent.finish(nearby)
        if improves(nearby.costs, point.costs):
            point = nearby
    return point


def improves(costs: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether a level costs notably less than another time, and none above costs more."""
    for cost, other in zip(costs, others):
        if cost < (1.0 - EQUAL) * other - MET:
            return True
        if cost > kept_cost(other):
            return False
    return False


def is_better(costs: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether the first costs that differ notably are less than the others."""
    for cost, other in zip(costs, others):
        if abs(cost - other) > EQUAL * max(cost, other) + MET:
            return cost < other
    return False

# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Search among configurations: a descent from the start, then from random configurations."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from tp_controller.model.spatial import Array
from tp_controller.positions.descent import Descent, MET
from tp_controller.positions.position_stack import PositionStack

# Costs that differ by no more than this share are equal.
EQUAL = 1e-3


class Attempts(NamedTuple):
    """
    Outcome of a search.

    Attributes
    ----------
    q : ndarray (nq,)
        Best configuration [rad or m].
    costs : list of float
        Squared norm of the error of each level there.
    descents : int

    """

    q: Array
    costs: list[float]
    descents: int


def search(tasks: PositionStack, descent: Descent, needed: int,
           starts: Iterable[Array]) -> Attempts:
    """
    Return the best configuration of some descents; the first that meets the needed levels ends it.

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

    """
    best, descents = None, 0
    for start in starts:
        descent.begin()
        found = descent.approach(tasks.at(start), needed)
        descents += 1
        if best is None or is_better(found.costs[:needed], best.costs[:needed]):
            best = found
        if sum(best.costs[:needed]) <= MET or descent.out_of_time():
            break
    assert best is not None
    return Attempts(best.q, best.costs, descents)


def is_better(costs: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether the first costs that differ notably are less than the others."""
    for cost, other in zip(costs, others):
        if abs(cost - other) > EQUAL * max(cost, other) + MET:
            return cost < other
    return False

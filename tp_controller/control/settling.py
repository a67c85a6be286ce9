# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Memory of the solver after a cycle has lasted: the fixed point of what each cycle leaves of it.

No level depends on those below it, so the memory of one level settles after the other. Each is a
root of bend − memory, where the bend follows from a cycle with this memory. It never rises above
the present one, from which the search begins. With uniform scaling levels with bounds depend on
all demands, and all memories settle together.
"""

from collections.abc import Mapping, Sequence
import math

import numpy as np
from tp_controller.control.cycle import Cycle
from tp_controller.model.spatial import Array
from tp_controller.solver.solution import Solution

# Most cycles in which the memory of a level settles, its relative distance from the root then, and
# the relative difference up to which velocities are the same.
SETTLING_STEPS, MEMORY_SETTLED, SAME_MOTION = 16, 2e-2, 1e-3
# Steepest slope of the bend that is believed, also where none is known yet; and the ratio of two
# memories from which the search goes on at their geometric mean.
STEEPEST, FAR_APART = 0.9, 10.0
# Least share of the interval between two memories by which the next one differs from both.
INNERMOST = 0.05


class SettlingMemory:
    """
    Search for the memory that a level keeps, by the secant method.

    Parameters
    ----------
    most : float
        Present memory.

    Attributes
    ----------
    memory : float
        Memory with which the next cycle is solved; the settled one in the end.

    """

    def __init__(self, most: float) -> None:
        self.memory, self._most, self._steps = most, most, 0
        # Memory, bend and velocity at the lowest memory above the root, and the highest below.
        self._above: tuple[float, float, Array] | None = None
        self._below: tuple[float, float, Array] | None = None

    def has_settled(self, bend: float, velocity: Array) -> bool:
        """
        Return whether the memory has settled; move it on otherwise.

        Parameters
        ----------
        bend : float
            `LevelStep.bend` of the level in a cycle with this memory.
        velocity : ndarray (n,)
            Velocities after the level.

        """
        bend, old = min(bend, self._most), self.memory
        self._steps += 1
        last, here = self._above, (old, bend, velocity)
        slope = STEEPEST if last is None else (bend - last[1]) / (old - last[0])
        if abs(bend - old) <= MEMORY_SETTLED * old * (1.0 - min(max(slope, 0.0), STEEPEST)) \
                or self._steps >= SETTLING_STEPS:
            return True
        if bend > old:
            self._below = here
        else:
            self._above = here
        if self._below is not None and self._above is not None:
            return self._is_between(self._below, self._above)
        self.memory = bend if last is None else max(
            old + (bend - old) / (1.0 - min(slope, STEEPEST)), 0.0)
        return False

    def _is_between(self, below: tuple[float, float, Array],
                    above: tuple[float, float, Array]) -> bool:
        """Return whether two memories are close or move the robot alike; else go between them."""
        (least, bend_least, slow), (most, bend_most, fast) = below, above
        if most - least <= MEMORY_SETTLED * most or np.abs(slow - fast).max() \
                <= SAME_MOTION * max(np.abs(slow).max(), np.abs(fast).max()):
            return True
        if most > FAR_APART * least > 0.0:
            self.memory = math.sqrt(least * most)
            return False
        rise, fall = bend_least - least, bend_most - most
        share = rise / (rise - fall)
        if least > 0.0:
            share = min(max(share, INNERMOST), 1.0 - INNERMOST)
        self.memory = least + share * (most - least)
        return False


def settled(cycle: Cycle) -> Solution:
    """Return the solution of a cycle once its memory has settled, at most at the present one."""
    solution, memory = cycle.solve(), list(cycle.memory)
    searches = {index: SettlingMemory(most) for index, most in enumerate(memory) if most > 0.0}
    together = getattr(cycle.solver, 'scaling', '') == 'uniform' \
        and any(level.v is None for level in cycle.levels)
    for indices in [list(searches)] if together else [[index] for index in searches]:
        while not _have_settled(indices, searches, solution):
            for index in indices:
                memory[index] = searches[index].memory
            solution = cycle._replace(memory=tuple(memory)).solve()
    return solution


def _have_settled(indices: Sequence[int], searches: Mapping[int, SettlingMemory],
                  solution: Solution) -> bool:
    """Return whether the memories of levels have settled; move on those that have not."""
    moved = [index for index in indices if not searches[index].has_settled(
        solution.bends[index], solution.step(index).velocity)]
    return not moved

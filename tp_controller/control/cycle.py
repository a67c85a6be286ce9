# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Problem of one control cycle, kept so that variants of it can be solved."""

from typing import NamedTuple

from tp_controller.control.standing_joints import without_joints
from tp_controller.control.velocity_limits import VelocityBounds
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Bounds, Memory, Solution, Solver

# Kind of an outcome that blends in a change; see `Outcome.override`.
TRANSITION = 'transition'


class Cycle(NamedTuple):
    """
    Problem of one control cycle.

    Attributes
    ----------
    levels : list of Level
        Levels of the stack.
    bounds : VelocityBounds
    solver : Solver
    memory : tuple of float
        `Solution.memory` of the previous cycle.
    standing : tuple of int
        Joints that stand and stay, which all levels leave out.
    demand : Solution or None
        Solution without transient limits, which the bounds follow; None where they follow none.

    """

    levels: list[Level]
    bounds: VelocityBounds
    solver: Solver
    memory: Memory
    standing: tuple[int, ...] = ()
    demand: Solution | None = None

    @classmethod
    def begin(cls, levels: list[Level], bounds: VelocityBounds, solver: Solver, memory: Memory
              ) -> 'Cycle':
        """Return the cycle of levels of all joints."""
        standing = bounds.standing
        return cls([without_joints(level, standing) for level in levels], bounds, solver, memory,
                   standing).towards()

    def solve(self, levels: list[Level] | None = None) -> Solution:
        """Return the solution of levels, by default those of the stack."""
        if levels is None:
            return self.solver.solve(self.levels, self.bounds, self.memory)
        return self._solve(levels, self.bounds)

    def towards(self, levels: list[Level] | None = None) -> 'Cycle':
        """Return the cycle with bounds for the demand of levels, by default those of the stack."""
        if not self.bounds.follow_demand:
            return self
        demand = self.aim(levels)
        return self._replace(bounds=self.bounds.towards(demand.velocity, levels is None),
                             demand=demand)

    def aim(self, levels: list[Level] | None = None) -> Solution:
        """Return the solution of levels without transient limits."""
        return self._solve(self.levels if levels is None else levels, self.bounds.settled)

    def _solve(self, levels: list[Level], bounds: Bounds) -> Solution:
        """Return the solution of levels within other bounds."""
        # Levels that are not in the stack have no memory.
        memory = self.memory
        if levels is not self.levels and any(memory):
            remembered = {id(level): h for level, h in zip(self.levels, memory)}
            memory = tuple([remembered.get(id(level), 0.0) for level in levels])
        if levels is not self.levels and self.standing:
            levels = [without_joints(level, self.standing) for level in levels]
        return self.solver.solve(levels, bounds, memory)


class Outcome(NamedTuple):
    """
    Outcome of a cycle.

    Attributes
    ----------
    solution : Solution
        Solution of the stack.
    commanded : Solution
        Commanded solution: the same, unless another stack temporarily replaces the own one.
    override : str
        Reason for the replacement; empty if both solutions are the same.

    """

    solution: Solution
    commanded: Solution
    override: str = ''

    @property
    def velocity(self) -> Array:
        """Return the commanded velocities (n,)."""
        return self.commanded.velocity

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

"""Variants of a solved cycle: without some tasks or limits, or without damping."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple, TypeAlias

from tp_controller.control.cycle import Cycle, Outcome, TRANSITION
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Bounds
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation


class ActiveLimits(NamedTuple):
    """Coinciding limits of a joint that are active in a level."""

    joint: int
    limits: tuple[str, ...]


Removable: TypeAlias = Evaluation | ActiveLimits


class Variants:
    """
    Velocities of a cycle that is solved again with some of its tasks or limits changed.

    Parameters
    ----------
    evaluations : sequence of sequence of Evaluation
        Evaluations of the tasks, level by level.
    cycle : Cycle
    outcome : Outcome
        Outcome of the cycle.

    """

    def __init__(self, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 outcome: Outcome) -> None:
        self._evaluations, self._cycle, self._outcome = evaluations, cycle, outcome
        self._level_indices = {id(evaluation): index for index, group in enumerate(evaluations)
                               for evaluation in group}
        # Cache of velocities: another task may need the same variant.
        self._solved: dict[tuple[object, ...], Array] = {}

    def level_index(self, evaluation: Evaluation) -> int:
        """Return the index of the level of a task."""
        return self._level_indices[id(evaluation)]

    @cached_property
    def unblended(self) -> Array:
        """Return the velocities (n,) without a transition."""
        return self._cycle.solve().velocity

    @cached_property
    def undamped(self) -> Array:
        """Return the velocities (n,) without damping or relaxed directions."""
        bounds = self._cycle.bounds
        return self._cycle.solver.undamped.solve(
            self._outcome.commanded.hierarchy,
            Bounds(bounds.lower, bounds.upper, bounds.cap)).velocity

    def velocity_without(self, removed: Sequence[Removable], complete: bool = False) -> Array:
        """Return the velocities (n,) without some tasks and limits; unblended if `complete`."""
        tasks = [each for each in removed if isinstance(each, Evaluation)]
        hierarchy = self._cycle.levels if complete and self._outcome.override == TRANSITION \
            else self._outcome.commanded.hierarchy
        key = (hierarchy is self._cycle.levels, *(each.task.name for each in tasks),
               *(each for each in removed if isinstance(each, ActiveLimits)))
        if key not in self._solved:
            groups = {}
            for number in {self.level_index(each) for each in tasks}:
                left = [each for each in self._evaluations[number] if each not in tasks]
                groups[number] = levels_of([left] if left else [])
            self._solved[key] = self.velocity_with(
                self.cycle_without(removed), groups, hierarchy)
        return self._solved[key]

    def cycle_without(self, removed: Sequence[Removable]) -> Cycle:
        """Return the cycle without the joint limits among the removed candidates."""
        cycle = self._cycle
        for each in removed:
            if isinstance(each, ActiveLimits):
                cycle = cycle._replace(bounds=cycle.bounds.without(*each))
        return cycle

    def velocity_with(self, cycle: Cycle, groups: Mapping[int, list[Level]],
                      hierarchy: Sequence[Level]) -> Array:
        """Return the velocities (n,) with some levels replaced, each by one level or none."""
        hierarchy, levels = list(hierarchy), list(cycle.levels)
        kept = list(range(len(levels)))
        for number in sorted(groups, reverse=True):
            # Levels below a transition are not in force yet.
            if number < len(hierarchy) and hierarchy[number] is levels[number]:
                hierarchy[number:number + 1] = levels[number:number + 1] = groups[number]
                kept[number:number + 1] *= len(groups[number])
        memory = tuple([cycle.memory[index] for index in kept]) if cycle.memory else ()
        return self._velocity_after(cycle._replace(levels=levels, memory=memory), hierarchy, kept)

    @cached_property
    def _bends(self) -> list[float]:
        """Return h of each level of the stack from this cycle alone."""
        return _bends(self._cycle, self._outcome.commanded.hierarchy)

    def _velocity_after(self, cycle: Cycle, levels: list[Level], kept: Sequence[int]) -> Array:
        """
        Return the velocities (n,) of a changed cycle that kept these levels, by index.

        The memory (h of each level) follows from earlier cycles and is not a cause of its own: it
        is reduced in proportion to h of this cycle alone.
        """
        if any(cycle.memory):
            before = [self._bends[index] for index in kept]
            after = _bends(cycle, levels)
            cycle = cycle._replace(memory=tuple([
                h * new / old if new < old else h
                for h, old, new in zip(cycle.memory, before, after)]))
        return cycle.solve(levels).velocity


def _bends(cycle: Cycle, levels: list[Level]) -> list[float]:
    """Return h of each level of the stack, from one cycle alone that solves `levels`."""
    found = cycle._replace(memory=()).solve(levels)
    bends = {id(level): h for level, h in zip(levels, found.bends)}
    return [bends.get(id(level), 0.0) for level in cycle.levels]

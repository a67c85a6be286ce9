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

"""Causes of limited tasks, found by solving a cycle again without one candidate at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from tp_controller.control.cycle import Cycle, Outcome, TRANSITION
from tp_controller.control.error_minimum import is_at_minimum, Place, SIGNIFICANT_SHARE
from tp_controller.control.joint_limits import LIMITS
from tp_controller.control.variants import ActiveLimits, Removable, Variants
from tp_controller.control.velocity_limits import RESERVE, SAME_VELOCITY, VelocityBounds
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.solution import LevelSolution
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation, norm

# A residual below this, times the row scale of the task, is a rounding error [unit/s].
DEMAND_ROUNDING = 1e-6
# Singular value below which a direction is singular, in the units of J.
NEAR_SINGULAR = 0.1

TASK, BOUNDS = 'task', 'bounds'
SINGULARITY, IMPOSSIBLE, DAMPING = 'singularity', 'impossible', 'damping'
# Kinds of causes, in the order of causes.h.
KINDS = (*[limit.name for limit in LIMITS], RESERVE, TASK, BOUNDS, SINGULARITY, IMPOSSIBLE,
         DAMPING)
# Kind, index of the joint or task or −1, and share of the causes of each task.
FoundCauses: TypeAlias = tuple[tuple[tuple[int, int, float], ...], ...]


class Cause(NamedTuple):
    """
    One cause that limits a task.

    Attributes
    ----------
    kind : str
        ``velocity limit``, ``lower position limit``, ``upper position limit``,
        ``acceleration limit`` or ``reserve`` of a joint; ``task`` or ``bounds``: another task
        that takes the directions, or whose bounds block it; ``singularity``: a direction in
        which the robot can hardly move here; ``impossible``: one in which it cannot move;
        ``damping``; ``transition``: a change that is still being blended in.
    name : str
        Joint or task; else empty.
    share : float
        Share of the residual that would disappear without this cause alone, in (0, 1].

    """

    kind: str
    name: str
    share: float


class Causes:
    """
    Search for causes: solves a cycle again, each time without one candidate.

    Parameters
    ----------
    robot : Robot
    evaluations : sequence of sequence of Evaluation
        Evaluations of the tasks, level by level.
    cycle : Cycle
    outcome : Outcome
        Outcome of the cycle.
    place : Place
        Configuration of the robot in the cycle.

    """

    def __init__(self, robot: Robot, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 outcome: Outcome, place: Place) -> None:
        self._robot, self._evaluations, self._place = robot, evaluations, place
        self._cycle, self._outcome = cycle, outcome
        self._variants = Variants(evaluations, cycle, outcome)
        self._limits_by_level: dict[int, list[ActiveLimits]] = {}
        self._out_of_reach: dict[str, bool] = {}

    @property
    def period(self) -> float:
        """Return the mean time between two commands [s]."""
        return self._cycle.bounds.hold

    @property
    def override(self) -> str:
        """Return the reason why another stack is commanded; empty if the own stack is."""
        return self._outcome.override

    def is_limited(self, evaluation: Evaluation) -> bool:
        """Return whether the residual of a task is a significant share of its demand."""
        level = evaluation.level
        demand = 0.0 if level.v is None else norm(level.v)
        return norm(residual_of(level, self._outcome.velocity)) > max(
            DEMAND_ROUNDING * evaluation.task.row_scale, SIGNIFICANT_SHARE * demand)

    def is_out_of_reach(self, evaluation: Evaluation) -> bool:
        """
        Return whether no small motion of the robot reduces the error of a task.

        This is the case if the task does not move and its error is at a minimum.
        """
        name = evaluation.task.name
        if name not in self._out_of_reach:
            level = evaluation.level
            self._out_of_reach[name] = (
                level.v is not None and bool(evaluation.error.any()) and not self.override
                and norm(level.J.dot(self._outcome.velocity)) <= SIGNIFICANT_SHARE * norm(level.v)
                and is_at_minimum(evaluation, self._robot, self._place))
        return self._out_of_reach[name]

    def shares_level(self, evaluation: Evaluation, name: str) -> bool:
        """Return whether a task is on the same level as another one."""
        group = self._evaluations[self._variants.level_index(evaluation)]
        return any(other.task.name == name for other in group)

    def combined_causes(self, evaluation: Evaluation) -> list[tuple[str, str]]:
        """
        Return (kind, name) of the tasks and limits that block a task together; [] if none do.

        The set is minimal: with any of them in place, part of the residual returns. A transition
        counts as complete.
        """
        index, level = self._variants.level_index(evaluation), evaluation.level
        removed: list[Removable] = [
            other for group in self._evaluations[:index + 1] for other in group
            if other is not evaluation]
        removed += self._active_limits(index)
        residual = norm(residual_of(level, self._outcome.velocity))
        # Without a task, a limit may become the next to stop the joints.
        hidden: list[ActiveLimits] | None = None
        while hidden is None or hidden:
            velocity = self._variants.velocity_without(removed, complete=True)
            least = norm(residual_of(level, velocity))
            hidden = [] if least <= SIGNIFICANT_SHARE * residual else [
                each for each in _at_bounds(self._variants.cycle_without(removed).bounds, velocity)
                if each not in removed]
            removed += hidden
        if least > (1.0 - SIGNIFICANT_SHARE) * residual:
            return []
        for candidate in tuple(removed):
            fewer = [each for each in removed if each is not candidate]
            left = norm(residual_of(level, self._variants.velocity_without(fewer, complete=True)))
            if left <= least + SIGNIFICANT_SHARE * residual:
                removed = fewer
        return [self._kind_and_name(each) for each in removed]

    def blocking_rows(self, evaluation: Evaluation, name: str) -> list[str]:
        """Return the names of the rows of an inequality task that block another task."""
        found: dict[str, None] = {}
        index = self._variants.level_index(evaluation)
        for level in self._outcome.commanded.levels[:index + 1]:
            for number, multipliers in level.row_multipliers.items():
                first = 0
                for other in self._evaluations[number]:
                    rows = multipliers[first:first + len(other.level.J)]
                    first += len(rows)
                    if other.task.name == name and other.row_names:
                        found.update(
                            (other.row_names[row], None) for row in np.flatnonzero(rows).tolist())
        return list(found)

    def of(self, evaluation: Evaluation) -> tuple[Cause, ...]:
        """
        Return the causes that limit a task, the largest share first.

        A candidate is a cause if the residual shrinks by a significant share without it.
        """
        if not self.is_limited(evaluation):
            return ()
        index, found = self._variants.level_index(evaluation), []
        residual = residual_of(evaluation.level, self._outcome.velocity)
        size = norm(residual)
        for kind, name, left in self._candidates(index, evaluation, residual):
            share = 1.0 - norm(left) / size
            if share > SIGNIFICANT_SHARE:
                found.append(Cause(kind, name, share))
        return tuple(sorted(found, key=lambda cause: -cause.share))

    def _candidates(self, index: int, evaluation: Evaluation,
                    residual: Array) -> Iterator[tuple[str, str, Array]]:
        """Yield (kind, name, residual without it) of each candidate."""
        level = evaluation.level
        for active in self._active_limits(index):
            left = residual_of(level, self._variants.velocity_without([active]))
            yield (*self._kind_and_name(active), left)
        for group in self._evaluations[:index + 1]:
            for other in group:
                if other is not evaluation:
                    left = residual_of(level, self._variants.velocity_without([other]))
                    yield (*self._kind_and_name(other), left)
        if self._outcome.override == TRANSITION:
            yield TRANSITION, '', residual_of(level, self._variants.unblended)
        if self._is_damped(index):
            yield DAMPING, '', residual_of(level, self._variants.undamped)
        yield from self._singular(index, evaluation, residual)

    def _kind_and_name(self, cause: Removable) -> tuple[str, str]:
        """Return the kind and name of a task or limit as a cause."""
        if isinstance(cause, ActiveLimits):
            # Coinciding limits count as one, named after the first.
            return cause.limits[0], self._robot.velocity_names[cause.joint]
        return BOUNDS if cause.task.bounded else TASK, cause.task.name

    def limits_at(self, level: LevelSolution, joint: int) -> list[str]:
        """Return the limits of a joint that are active in a level; mostly one."""
        return self._cycle.bounds.limits(joint, bool(level.multipliers[joint] > 0.0),
                                         float(level.limited_velocity[joint]))

    def _active_limits(self, index: int) -> list[ActiveLimits]:
        """Return all limits that are active in a level or in one above it."""
        commanded, bounds = self._outcome.commanded, self._cycle.bounds
        found = {each: True for number in self._levels_down_to(index)
                 for each in self._limits_of_level(number)}
        if commanded.slowed < 1.0:
            # Bounds of levels may bring more joints to their limits than the one that decides.
            found.update((each, True) for each in _at_bounds(bounds, commanded.velocity))
        return list(found)

    def _levels_down_to(self, index: int) -> range:
        """Return the indices of a level and those above it, as far as they are commanded."""
        return range(min(index + 1, len(self._outcome.commanded.hierarchy)))

    def _limits_of_level(self, index: int) -> list[ActiveLimits]:
        """Return the limits that are active in a level."""
        if index not in self._limits_by_level:
            level = self._outcome.commanded.levels[index]
            self._limits_by_level[index] = [
                ActiveLimits(joint, tuple(self.limits_at(level, joint)))
                for joint in level.limited_by]
        return self._limits_by_level[index]

    def _is_damped(self, index: int) -> bool:
        """Return whether a level, or one above it, is damped or relaxed."""
        levels = self._outcome.commanded.levels
        return any(levels[number].is_damped for number in self._levels_down_to(index))

    def _singular(self, index: int, evaluation: Evaluation,
                  residual: Array) -> Iterator[tuple[str, str, Array]]:
        """Yield the candidates for directions in which the robot can hardly move or not at all."""
        level = evaluation.level
        if not level.J.size or level.is_identity:
            return
        its = self._outcome.commanded.directions_alone(level, NEAR_SINGULAR)
        if its is None:
            # It moves well in all directions.
            return
        if its.rank < len(level.J):
            yield IMPOSSIBLE, '', its.U.dot(its.U.T.dot(residual))
        if its.rank and its.s[-1] < NEAR_SINGULAR:
            J = (its.U * np.maximum(its.s, NEAR_SINGULAR)).dot(its.moving.T)
            other = Evaluation(evaluation.task, replace(level, J=J), evaluation.error)
            group = [other if each is evaluation else each for each in self._evaluations[index]]
            yield SINGULARITY, '', residual_of(other.level, self._variants.velocity_with(
                self._cycle, {index: levels_of([group])}, self._outcome.commanded.hierarchy))


def _at_bounds(bounds: VelocityBounds, x: Array) -> list[ActiveLimits]:
    """Return the limits that are active at velocities x (n,)."""
    return [ActiveLimits(joint, tuple(bounds.limits(joint, up)))
            for up, bound in ((True, bounds.upper), (False, bounds.lower))
            for joint in np.flatnonzero(np.abs(x - bound) <= SAME_VELOCITY).tolist()]


def residual_of(level: Level, x: Array) -> Array:
    """Return the residual (m,) of the demand or bounds of a level at velocities x (n,)."""
    achieved = level.J.dot(x)
    return (level.demanded(achieved) if level.v is None else level.v) - achieved

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

"""What limits a task: whatever brings back part of what is missing if it is taken away."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import Any

import numpy as np
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.escape import STILL
from tp_controller.control.velocity_limits import SAME
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level, NEGLIGIBLE
from tp_controller.solver.min_norm import moves_well
from tp_controller.solver.null_space import singular_values
from tp_controller.solver.solution import LevelSolution
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation, norm

# A part of the demand below this is rounding, not something that is missing.
UNNOTICED = 1e-6
# A task is limited where it misses more than this share of its demand, and a cause is one
# where it brings back more than this share of that.
NOTABLE = 0.01

# Below this singular value a direction is singular, in the units of J.
NEAR_SINGULAR = 0.1

RESERVE, TASK, BOUNDS = 'reserve', 'task', 'bounds'
SINGULARITY, IMPOSSIBLE, DAMPING, TRANSITION = (
    'singularity', 'impossible', 'damping', 'transition')


@dataclass(frozen=True)
class Cause:
    """
    One cause that limits a task.

    Attributes
    ----------
    kind : str
        ``velocity limit``, ``lower position limit``, ``upper position limit``,
        ``acceleration limit`` or ``reserve`` of a joint; ``task`` or ``bounds``: another task
        that takes the directions, or whose bounds block it; ``singularity``: a direction that
        the robot can hardly move in here; ``impossible``: one that it cannot; ``damping``;
        ``transition``: a change that is still blended in.
    name : str
        The joint, or the task; else empty.
    share : float
        The part of what is missing that would come back if this cause alone were taken away, in
        (0, 1].

    """

    kind: str
    name: str
    share: float


class Causes:
    """
    Solves a cycle again, each time with one cause taken away.

    Parameters
    ----------
    robot : Robot
    evaluations : sequence of sequence of Evaluation
        Of the tasks, level by level.
    cycle : Cycle
    outcome : Outcome
        What it came to.

    """

    def __init__(self, robot: Robot, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 outcome: Outcome) -> None:
        self._robot, self._evaluations = robot, evaluations
        self._cycle, self._outcome = cycle, outcome
        self._places = {id(evaluation): index for index, group in enumerate(evaluations)
                        for evaluation in group}
        # Another task may need the same.
        self._solved: dict[tuple[object, ...], Array] = {}
        self._limits: dict[tuple[int, bool], list[str]] = {}

    @property
    def instead(self) -> str:
        """Return why something else than the stack is carried out; mostly empty."""
        return self._outcome.instead

    def is_limited(self, evaluation: Evaluation) -> bool:
        """Say whether a task misses more than next to nothing of its demand."""
        level = evaluation.level
        demand = 0.0 if level.v is None else norm(level.v)
        return norm(missing_of(level, self._outcome.velocity)) > max(
            UNNOTICED * evaluation.task.row_scale, NOTABLE * demand)

    def at_rest(self, evaluation: Evaluation) -> bool:
        """Say whether the robot stands still, and a task gets next to nothing of its demand."""
        level, x = evaluation.level, self._outcome.velocity
        return norm(x) <= STILL and norm(level.J.dot(x)) <= NOTABLE * norm(level.v)

    def pushes_limits(self, evaluation: Evaluation) -> bool:
        """Say whether the level of a task, or one above it, pushes against limits of joints."""
        return bool(self._pushed(self._places[id(evaluation)]))

    def share_a_level(self, evaluation: Evaluation, name: str) -> bool:
        """Say whether a task is on the same level as another one."""
        group = self._evaluations[self._places[id(evaluation)]]
        return any(other.task.name == name for other in group)

    def together(self, evaluation: Evaluation) -> list[str]:
        """Return the names of the other tasks that block one together, where they do."""
        index = self._places[id(evaluation)]
        if not index:
            return []
        level, key = evaluation.level, (evaluation.task.name, 'alone')
        if key not in self._solved:
            self._solved[key] = self._cycle.solve([level]).velocity
        alone = missing_of(level, self._solved[key])
        if norm(alone) > (1.0 - NOTABLE) * norm(missing_of(level, self._outcome.velocity)):
            return []
        return [other.task.name for group in self._evaluations[:index] for other in group]

    def rows_in_the_way(self, evaluation: Evaluation, name: str) -> list[str]:
        """Return which rows of a task with bounds block another one, by name."""
        found: dict[str, None] = {}
        index = self._places[id(evaluation)]
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
        """Return what limits a task, the largest share first."""
        if not self.is_limited(evaluation):
            return ()
        index, found = self._places[id(evaluation)], []
        missing = missing_of(evaluation.level, self._outcome.velocity)
        size = norm(missing)
        for kind, name, left in self._candidates(index, evaluation, missing):
            share = 1.0 - norm(left) / size
            if share > NOTABLE:
                found.append(Cause(kind, name, share))
        return tuple(sorted(found, key=lambda cause: -cause.share))

    def _candidates(self, index: int, evaluation: Evaluation,
                    missing: Array) -> Iterator[tuple[str, str, Array]]:
        """Yield (kind, name, what is still missing without it)."""
        level = evaluation.level
        for joint, *limits in self._pushed(index):
            # Limits that say the same are one: the first gives it the name.
            yield (limits[0], self._robot.velocity_names[joint],
                   missing_of(level, self._without_limits(joint, limits)))
        for number, group in enumerate(self._evaluations[:index + 1]):
            for other in group:
                if other is not evaluation:
                    yield (BOUNDS if other.task.bounded else TASK, other.task.name,
                           missing_of(level, self._without_task(number, other)))
        if self._outcome.instead == TRANSITION:
            yield TRANSITION, '', missing_of(level, self._cycle.solve().velocity)
        if self._is_damped(index):
            yield DAMPING, '', missing_of(level, self._undamped)
        yield from self._singular(index, evaluation, missing)

    def limits_at(self, level: LevelSolution, joint: int) -> list[str]:
        """Return the limits of a joint that a level pushes against; mostly one."""
        up = bool(level.multipliers[joint] > 0.0)
        bounds = self._cycle.bounds
        velocity = level.limited_velocity[joint]
        cap = self._cycle.speed_cap
        before = velocity < bounds.upper[joint] - SAME if up \
            else velocity > bounds.lower[joint] + SAME
        # The reserve stops a joint before its own bound does.
        if before and cap is not None and math.isfinite(cap[joint]):
            return [RESERVE]
        # Levels above and below push against the same ones.
        if (joint, up) not in self._limits:
            self._limits[joint, up] = bounds.limits(joint, up)
        return self._limits[joint, up]

    def _pushed(self, index: int) -> list[tuple[Any, ...]]:
        """Return (joint, *limits) for all that a level, or one above it, pushes against."""
        commanded, bounds = self._outcome.commanded, self._cycle.bounds
        found = {each: True for level in self._pushed_by[:index + 1] for each in level}
        if commanded.slowed < 1.0:
            # Bounds of levels may have led more joints to their limits than the one that decides.
            velocity = commanded.velocity.tolist()
            for up, bound in ((True, bounds.upper), (False, bounds.lower)):
                for joint, (one, other) in enumerate(zip(velocity, bound.tolist())):
                    if abs(one - other) <= SAME:
                        found[(joint, *bounds.limits(joint, up))] = True
        return list(found)

    @cached_property
    def _pushed_by(self) -> list[list[tuple[Any, ...]]]:
        """Return (joint, *limits) for all that a level pushes against, for each level."""
        return [[(joint, *self.limits_at(level, joint)) for joint in level.limited_by]
                for level in self._outcome.commanded.levels]

    def _without_limits(self, joint: int, limits: Sequence[str]) -> Array:
        """Return the velocities (n,) without some limits of a joint."""
        cycle, key = self._cycle, (joint, *limits)
        if key not in self._solved:
            if RESERVE in limits and cycle.speed_cap is not None:
                cap = cycle.speed_cap.copy()
                cap[joint] = np.inf
                cycle = replace(cycle, speed_cap=cap)
            else:
                cycle = replace(cycle, bounds=cycle.bounds.without(joint, limits))
            self._solved[key] = self._again(cycle, self._outcome.commanded.hierarchy)
        return self._solved[key]

    def _without_task(self, number: int, evaluation: Evaluation) -> Array:
        """Return the velocities (n,) without a task of a level."""
        key = (evaluation.task.name,)
        if key not in self._solved:
            others = [each for each in self._evaluations[number] if each is not evaluation]
            self._solved[key] = self._with(number, levels_of([others] if others else []))
        return self._solved[key]

    def _with(self, number: int, levels: list[Level]) -> Array:
        """Return the velocities (n,) with other levels, one or none, in place of one."""
        cycle, hierarchy = self._cycle, self._outcome.commanded.hierarchy
        if number >= len(hierarchy) or hierarchy[number] is not cycle.levels[number]:
            # While a change fades in it is not in force yet.
            return self._outcome.velocity
        memory = list(cycle.memory)
        memory[number:number + 1] *= len(levels)
        other = replace(cycle, memory=tuple(memory), levels=[
            *cycle.levels[:number], *levels, *cycle.levels[number + 1:]])
        return self._again(other, [*hierarchy[:number], *levels, *hierarchy[number + 1:]],
                           number if len(levels) != 1 else None)

    @cached_property
    def _pushes(self) -> list[float]:
        """Return h of each level of the stack, from this cycle alone."""
        return _pushes(self._cycle, self._outcome.commanded.hierarchy)

    def _again(self, cycle: Cycle, levels: Sequence[Level], without: int | None = None) -> Array:
        """
        Return the velocities (n,) of a cycle with one change; a level may be gone.

        What it remembers follows from what pushed before (h of each level), and so is no cause
        of its own: it falls as far as the pushes do.
        """
        if any(cycle.memory):
            before = [h for index, h in enumerate(self._pushes) if index != without]
            after = _pushes(cycle, levels)
            cycle = replace(cycle, memory=tuple(
                h * new / old if new < old else h
                for h, old, new in zip(cycle.memory, before, after)))
        return cycle.solve(levels).velocity

    def _is_damped(self, index: int) -> bool:
        """Say whether a level, or one above it, is damped or relaxed."""
        # Bounds of levels that cannot be met are damped, too.
        return any(step.relaxed is not None or step.directions is None and step.multipliers is
                   not None or min(step.followed.tolist(), default=1.0) < 1.0 - NEGLIGIBLE
                   for step in self._outcome.commanded.steps[:index + 1])

    @cached_property
    def _undamped(self) -> Array:
        """Return the velocities (n,) without damping or relaxed directions."""
        cycle = self._cycle
        return replace(cycle, options=cycle.options.undamped, period=0.0, memory=()).solve(
            self._outcome.commanded.hierarchy).velocity

    def _singular(self, index: int, evaluation: Evaluation,
                  missing: Array) -> Iterator[tuple[str, str, Array]]:
        """Yield what is missing because the robot can hardly move, or not at all, there."""
        level = evaluation.level
        if not level.J.size or level.is_identity or moves_well(level.J, NEAR_SINGULAR):
            return
        U, s, V = singular_values(level.J)
        least, sizes = NEGLIGIBLE * norm(s), s.tolist()
        rank = sum(each > least for each in sizes)
        if rank < len(U):
            nowhere = U[:, rank:]
            yield IMPOSSIBLE, '', missing - nowhere.dot(nowhere.T.dot(missing))
        if rank and sizes[rank - 1] < NEAR_SINGULAR:
            stronger = np.maximum(s[:rank], NEAR_SINGULAR)
            J = (U[:, :rank] * stronger).dot(V[:, :rank].T)
            other = Evaluation(evaluation.task, replace(level, J=J), evaluation.error)
            group = [other if each is evaluation else each for each in self._evaluations[index]]
            yield SINGULARITY, '', missing_of(other.level, self._with(index, levels_of([group])))


def _pushes(cycle: Cycle, levels: Sequence[Level]) -> list[float]:
    """Return h of each level of a stack, from one cycle alone, in which levels are carried out."""
    found = replace(cycle, memory=()).solve(levels)
    pushes = {id(level): h for level, h in zip(levels, found.bends)}
    return [pushes.get(id(level), 0.0) for level in cycle.levels]


def missing_of(level: Level, x: Array) -> Array:
    """Return what is missing of the demand of a level, or to its bounds, at velocities x (n,)."""
    achieved = level.J.dot(x)
    return (level.demanded(achieved) if level.v is None else level.v) - achieved

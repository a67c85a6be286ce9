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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import NamedTuple, TypeAlias

import numpy as np
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.velocity_limits import SAME, VelocityBounds
from tp_controller.foreign import foreign
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level, NEGLIGIBLE
from tp_controller.solver.min_norm import moves_well
from tp_controller.solver.null_space import decompose, Directions
from tp_controller.solver.solution import LevelSolution
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation, norm

# A part of the demand below this is rounding, not something that is missing.
UNNOTICED = 1e-6
# A task is limited where it misses more than this share of its demand, and a cause is one
# where it brings back more than this share of that.
NOTABLE = 0.01

# Of differences between two states [rad or m].
STEP = 1e-5

# Below this singular value a direction is singular, in the units of J.
NEAR_SINGULAR = 0.1

RESERVE, TASK, BOUNDS = 'reserve', 'task', 'bounds'
SINGULARITY, IMPOSSIBLE, DAMPING, TRANSITION = (
    'singularity', 'impossible', 'damping', 'transition')


class Place(NamedTuple):
    """
    Where the robot was in a cycle.

    Attributes
    ----------
    q : ndarray (nq,)
        Configuration [rad or m].
    passive : ndarray (p,) or None
        Positions of the passive joints; see `Robot.state`.
    now : float
        [s]
    spare : RobotState
        For states nearby; finding causes moves it.

    """

    q: Array
    passive: Array | None
    now: float
    spare: RobotState


class Pushed(NamedTuple):
    """The limits of a joint that a level pushes against; they say the same."""

    joint: int
    limits: tuple[str, ...]


Removable: TypeAlias = Evaluation | Pushed


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
    place : Place
        Where the robot was.

    """

    def __init__(self, robot: Robot, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 outcome: Outcome, place: Place) -> None:
        self._robot, self._evaluations, self._place = robot, evaluations, place
        self._cycle, self._outcome = cycle, outcome
        self._places = {id(evaluation): index for index, group in enumerate(evaluations)
                        for evaluation in group}
        # Another task may need the same.
        self._solved: dict[tuple[object, ...], Array] = {}
        self._limits: dict[tuple[int, bool], list[str]] = {}
        self._pushed_at: dict[int, list[Pushed]] = {}
        self._out_of_reach: dict[str, bool] = {}

    @property
    def period(self) -> float:
        """Return the mean time between two commands [s]."""
        return self._cycle.period

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

    def is_out_of_reach(self, evaluation: Evaluation) -> bool:
        """
        Say whether no small motion of the robot makes the error of a task smaller.

        Then the task does not move, and its error is at a minimum: nothing else is the reason.
        """
        name = evaluation.task.name
        if name not in self._out_of_reach:
            level = evaluation.level
            self._out_of_reach[name] = (
                level.v is not None and bool(evaluation.error.any()) and not self.instead
                and norm(level.J.dot(self._outcome.velocity)) <= NOTABLE * norm(level.v)
                and self._at_minimum(evaluation))
        return self._out_of_reach[name]

    def share_a_level(self, evaluation: Evaluation, name: str) -> bool:
        """Say whether a task is on the same level as another one."""
        group = self._evaluations[self._places[id(evaluation)]]
        return any(other.task.name == name for other in group)

    def together(self, evaluation: Evaluation) -> list[tuple[str, str]]:
        """
        Return (kind, name) of the tasks and limits that block a task together, where they do.

        None of them can be left in its place without some of what comes back being lost again. A
        change that fades in is taken for complete.
        """
        index, level = self._places[id(evaluation)], evaluation.level
        removed: list[Removable] = [
            other for group in self._evaluations[:index + 1] for other in group
            if other is not evaluation]
        removed += self._pushed(index)
        missing = norm(missing_of(level, self._outcome.velocity))
        # Without a task it may well be a limit that stops the joints next.
        hidden: list[Pushed] | None = None
        while hidden is None or hidden:
            velocity = self._without(removed, complete=True)
            least = norm(missing_of(level, velocity))
            hidden = [] if least <= NOTABLE * missing else [
                each for each in _at_bounds(self._cycle_without(removed).bounds, velocity)
                if each not in removed]
            removed += hidden
        if least > (1.0 - NOTABLE) * missing:
            return []
        for candidate in tuple(removed):
            fewer = [each for each in removed if each is not candidate]
            left = norm(missing_of(level, self._without(fewer, complete=True)))
            if left <= least + NOTABLE * missing:
                removed = fewer
        return [self._named(each) for each in removed]

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
        for pushed in self._pushed(index):
            yield (*self._named(pushed), missing_of(level, self._without([pushed])))
        for group in self._evaluations[:index + 1]:
            for other in group:
                if other is not evaluation:
                    yield (*self._named(other), missing_of(level, self._without([other])))
        if self._outcome.instead == TRANSITION:
            yield TRANSITION, '', missing_of(level, self._cycle.solve().velocity)
        if self._is_damped(index):
            yield DAMPING, '', missing_of(level, self._undamped)
        yield from self._singular(index, evaluation, missing)

    def _named(self, cause: Removable) -> tuple[str, str]:
        """Return the kind and name of a task or limit as a cause."""
        if isinstance(cause, Pushed):
            # Limits that say the same are one: the first gives it the name.
            return cause.limits[0], self._robot.velocity_names[cause.joint]
        return BOUNDS if cause.task.bounded else TASK, cause.task.name

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

    def _pushed(self, index: int) -> list[Pushed]:
        """Return all limits that a level, or one above it, pushes against."""
        commanded, bounds = self._outcome.commanded, self._cycle.bounds
        found = {each: True for number in self._down_to(index) for each in self._pushed_by(number)}
        if commanded.slowed < 1.0:
            # Bounds of levels may have led more joints to their limits than the one that decides.
            found.update((each, True) for each in _at_bounds(bounds, commanded.velocity))
        return list(found)

    def _down_to(self, index: int) -> range:
        """Return the indices of a level and those above it, as far as they are commanded."""
        return range(min(index + 1, len(self._outcome.commanded.hierarchy)))

    def _pushed_by(self, index: int) -> list[Pushed]:
        """Return the limits that a level pushes against."""
        if index not in self._pushed_at:
            level = self._outcome.commanded.levels[index]
            self._pushed_at[index] = [Pushed(joint, tuple(self.limits_at(level, joint)))
                                      for joint in level.limited_by]
        return self._pushed_at[index]

    def _without(self, removed: Sequence[Removable], complete: bool = False) -> Array:
        """Return the velocities (n,) without some tasks and limits, if `complete` unblended."""
        tasks = [each for each in removed if isinstance(each, Evaluation)]
        hierarchy = self._cycle.levels if complete and self.instead == TRANSITION \
            else self._outcome.commanded.hierarchy
        key = (hierarchy is self._cycle.levels, *(each.task.name for each in tasks),
               *(each for each in removed if isinstance(each, Pushed)))
        if key not in self._solved:
            groups = {}
            for number in {self._places[id(each)] for each in tasks}:
                left = [each for each in self._evaluations[number] if each not in tasks]
                groups[number] = levels_of([left] if left else [])
            self._solved[key] = self._with(self._cycle_without(removed), groups, hierarchy)
        return self._solved[key]

    def _cycle_without(self, removed: Sequence[Removable]) -> Cycle:
        """Return the cycle without those of them that are limits of joints."""
        cycle = self._cycle
        for each in removed:
            if isinstance(each, Pushed):
                cycle = _without_limits(cycle, each)
        return cycle

    def _with(self, cycle: Cycle, groups: Mapping[int, list[Level]],
              hierarchy: Sequence[Level]) -> Array:
        """Return the velocities (n,) with other levels, one or none, in place of some."""
        hierarchy, levels = list(hierarchy), list(cycle.levels)
        kept = list(range(len(levels)))
        for number in sorted(groups, reverse=True):
            # Levels below a change that fades in are not in force yet.
            if number < len(hierarchy) and hierarchy[number] is levels[number]:
                hierarchy[number:number + 1] = levels[number:number + 1] = groups[number]
                kept[number:number + 1] *= len(groups[number])
        memory = tuple([cycle.memory[index] for index in kept]) if cycle.memory else ()
        return self._again(cycle._replace(levels=levels, memory=memory), hierarchy, kept)

    @cached_property
    def _pushes(self) -> list[float]:
        """Return h of each level of the stack, from this cycle alone."""
        return _pushes(self._cycle, self._outcome.commanded.hierarchy)

    def _again(self, cycle: Cycle, levels: Sequence[Level], kept: Sequence[int]) -> Array:
        """
        Return the velocities (n,) of a cycle with a change that kept these levels, by index.

        What it remembers follows from what pushed before (h of each level), and so is no cause
        of its own: it falls as far as the pushes do.
        """
        if any(cycle.memory):
            before = [self._pushes[index] for index in kept]
            after = _pushes(cycle, levels)
            cycle = cycle._replace(memory=tuple([
                h * new / old if new < old else h
                for h, old, new in zip(cycle.memory, before, after)]))
        return cycle.solve(levels).velocity

    def _at_minimum(self, evaluation: Evaluation) -> bool:
        """Say whether the error of a task is at a minimum; where that fails, it is not."""
        try:
            with foreign:
                return self._is_minimum(evaluation)
        except Exception:
            # A type of another package may fail anywhere.
            return False

    def _is_minimum(self, evaluation: Evaluation) -> bool:
        """
        Say whether the error of a task is at a minimum.

        Along all motions of the robot the gradient of ½ eᵀ K e has to vanish and its Jacobian H
        must not fall. Were H not symmetric, as where a base has to turn before it drives on, two
        motions in turns would lead to a third one along which the error falls.
        """
        task, (q, passive, now, state) = evaluation.task.probe(), self._place
        state.update(q, passive)
        n = self._robot.n

        def gradient() -> Array:
            level = task.evaluate(state, now).level
            return -level.J.T.dot(level.v)

        here, H = gradient(), np.empty((n, n))
        for column, motion in enumerate(np.eye(n)):
            state.update(self._robot.integrate(q, motion, STEP))
            H[:, column] = (gradient() - here) / STEP
        # As large as H is where the error is large.
        least = NOTABLE * norm(evaluation.level.v)
        values, motions = np.linalg.eigh(0.5 * (H + H.T))
        along = motions.T.dot(here)
        to_gain = (along * along / np.maximum(values, least)).sum()
        return bool(values[0] > -least and np.abs(H - H.T).max() < least
                    and to_gain <= NOTABLE * norm(evaluation.level.v) * norm(evaluation.error))

    def _is_damped(self, index: int) -> bool:
        """Say whether a level, or one above it, is damped or relaxed."""
        # Bounds of levels that cannot be met are damped, too.
        return any(step.relaxed is not None or step.directions is None and step.multipliers is
                   not None or min(step.followed.tolist(), default=1.0) < 1.0 - NEGLIGIBLE
                   for step in map(self._outcome.commanded.step, self._down_to(index)))

    @cached_property
    def _undamped(self) -> Array:
        """Return the velocities (n,) without damping or relaxed directions."""
        cycle = self._cycle
        return cycle._replace(options=cycle.options.undamped, period=0.0, memory=()).solve(
            self._outcome.commanded.hierarchy).velocity

    def _singular(self, index: int, evaluation: Evaluation,
                  missing: Array) -> Iterator[tuple[str, str, Array]]:
        """Yield what is missing because the robot can hardly move, or not at all, there."""
        level = evaluation.level
        its = self._directions(index, level)
        if its is None:
            return
        if its.rank < len(level.J):
            yield IMPOSSIBLE, '', its.U.dot(its.U.T.dot(missing))
        if its.rank and its.s[-1] < NEAR_SINGULAR:
            J = (its.U * np.maximum(its.s, NEAR_SINGULAR)).dot(its.moving.T)
            other = Evaluation(evaluation.task, replace(level, J=J), evaluation.error)
            group = [other if each is evaluation else each for each in self._evaluations[index]]
            yield SINGULARITY, '', missing_of(other.level, self._with(
                self._cycle, {index: levels_of([group])}, self._outcome.commanded.hierarchy))

    def _directions(self, index: int, level: Level) -> Directions | None:
        """Return the directions of a level by itself; None where it moves well in all of them."""
        if not level.J.size or level.is_identity:
            return None
        commanded = self._outcome.commanded
        if index == 0 and commanded.hierarchy[0] is level:
            # The solver has them: nothing is above the first level.
            its = commanded.step(0).directions
            if its is not None:
                return its
        return None if moves_well(level.J, NEAR_SINGULAR) else decompose(level)


def _at_bounds(bounds: VelocityBounds, x: Array) -> list[Pushed]:
    """Return the limits that velocities x (n,) are at."""
    return [Pushed(joint, tuple(bounds.limits(joint, up)))
            for up, bound in ((True, bounds.upper), (False, bounds.lower))
            for joint in np.flatnonzero(np.abs(x - bound) <= SAME).tolist()]


def _without_limits(cycle: Cycle, pushed: Pushed) -> Cycle:
    """Return a cycle without some limits of a joint."""
    joint, limits = pushed
    if RESERVE not in limits or cycle.speed_cap is None:
        return cycle._replace(bounds=cycle.bounds.without(joint, limits))
    cap = cycle.speed_cap.copy()
    cap[joint] = np.inf
    return cycle._replace(speed_cap=cap)


def _pushes(cycle: Cycle, levels: Sequence[Level]) -> list[float]:
    """Return h of each level of a stack, from one cycle alone, in which levels are carried out."""
    found = cycle._replace(memory=()).solve(levels)
    pushes = {id(level): h for level, h in zip(levels, found.bends)}
    return [pushes.get(id(level), 0.0) for level in cycle.levels]


def missing_of(level: Level, x: Array) -> Array:
    """Return what is missing of the demand of a level, or to its bounds, at velocities x (n,)."""
    achieved = level.J.dot(x)
    return (level.demanded(achieved) if level.v is None else level.v) - achieved

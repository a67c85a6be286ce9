# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Causes of limited tasks, found by solving a cycle again without one candidate at a time.

A part of what is missing comes by itself: joints accelerate, and changes are blended in. These are
causes, too. Those of the rest are found in the cycle that lasts
(`tp_controller.control.variants`): the present one, once all that has settled.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from tp_controller.control.cycle import Cycle, Outcome, TRANSITION
from tp_controller.control.error_minimum import is_at_minimum, Place, SIGNIFICANT_SHARE
from tp_controller.control.joint_limits import VelocityLimit
from tp_controller.control.variants import ActiveLimits, Removable, Variants
from tp_controller.control.velocity_limits import (
    LIMITS,
    RESERVE,
    SAME_VELOCITY,
    VelocityBounds,
)
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.null_space import Directions
from tp_controller.solver.solution import LevelSolution
from tp_controller.tasks.task import Evaluation, norm

# Share from which a cause alone is a reason.
NOTABLE_SHARE = 0.1
# A residual below this, times the row scale of the task, is a rounding error [unit/s].
DEMAND_ROUNDING = 1e-6
# Singular value below which a direction is singular, in the units of J, and share of the largest
# one up to which the robot cannot move in it: descriptions have angles with five digits.
NEAR_SINGULAR, IMMOVABLE = 0.1, 1e-5

TASK, BOUNDS = 'task', 'bounds'
SINGULARITY, IMPOSSIBLE = 'singularity', 'impossible'
DAMPING, CURVED, ACCELERATING = 'damping', 'curvature', 'accelerating'
LOCK, JOINTS = 'lock', 'joints'
# Kinds of causes, in the order of causes.h.
KINDS = (*[limit.name for limit in LIMITS], RESERVE, TASK, BOUNDS, SINGULARITY, IMPOSSIBLE,
         DAMPING, CURVED, ACCELERATING, JOINTS)
# Kind, index of the joint or task or −1, and share of the causes of each task.
FoundCauses: TypeAlias = tuple[tuple[tuple[int, int, float], ...], ...]
# Kind and index of each of the causes that block a task together.
CombinedCauses: TypeAlias = tuple[tuple[int, int], ...]


class Cause(NamedTuple):
    """
    One cause that limits a task.

    Attributes
    ----------
    kind : str
        ``velocity limit``, ``lower position limit``, ``upper position limit`` or ``reserve`` of
        a joint; ``task`` or ``bounds``: another task that takes the directions, or whose bounds
        block it; ``joints``: those that the task, or one above, may move; ``singularity``: a
        direction in which the robot can hardly move here; ``impossible``: one in which it cannot
        move; ``lock`` of a joint; ``damping``; ``curvature``: damping that keeps the robot from
        oscillating; ``accelerating``: joints that are about to move faster; ``transition``: a
        change that is still being blended in.
    name : str
        Joint or task; else empty, also for the joints of the task itself.
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
    locked : sequence of str
        Locked joints.

    """

    def __init__(self, robot: Robot, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 outcome: Outcome, place: Place, locked: Sequence[str] = ()) -> None:
        self._robot, self._evaluations, self._place = robot, evaluations, place
        self._cycle, self._outcome, self._locked = cycle, outcome, locked
        self.variants = Variants(evaluations, cycle, place)
        self._out_of_reach: dict[str, bool] = {}

    @property
    def period(self) -> float:
        """Return the mean time between two commands [s]."""
        return self._cycle.bounds.hold

    @property
    def override(self) -> str:
        """Return the reason why another stack is commanded; empty if the own stack is."""
        return self._outcome.override

    def overshoots(self, evaluation: Evaluation) -> bool:
        """Return whether the last command moved a task against its present demand."""
        level, last = evaluation.level, self._cycle.bounds.last
        return level.v is not None and float(level.v.dot(level.J.dot(last))) < 0.0

    def is_limited(self, evaluation: Evaluation) -> bool:
        """Return whether the residual of a task is a significant share of its demand."""
        level = self.variants.whole_level(evaluation)
        demand = 0.0 if level.v is None else norm(level.v)
        return missing(level, self._outcome.velocity) > max(
            DEMAND_ROUNDING * evaluation.task.row_scale, SIGNIFICANT_SHARE * demand)

    def loss(self, evaluation: Evaluation) -> float:
        """Return the share of its demand that a task misses, now or in the cycle that lasts."""
        level = self.variants.whole_level(evaluation)
        most = max(missing(level, self._outcome.velocity),
                   missing(level, self.variants.lasting.velocity))
        demand = 0.0 if level.v is None else norm(level.v)
        return most / demand if demand > 0.0 else math.inf

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
                and is_at_minimum(evaluation, self._robot, self._place, self._cycle.standing))
        return self._out_of_reach[name]

    def shares_level(self, evaluation: Evaluation, name: str) -> bool:
        """Return whether a task is on the same level as another one."""
        group = self._evaluations[self.variants.level_index(evaluation)]
        return any(other.task.name == name for other in group)

    def combined_causes(self, evaluation: Evaluation) -> list[tuple[str, str]]:
        """
        Return (kind, name) of the tasks and limits that block a task together; [] if none do.

        The set is minimal: with any of them in place, part of the residual returns. Limits that
        act only without the others are among them where little would come back otherwise.
        """
        index = self.variants.level_index(evaluation)
        level = self.variants.whole_level(evaluation)
        removed: list[Removable] = [*self._others(evaluation), *self.active_limits(index),
                                    *self.variants.standing]
        residual = missing(level, self.variants.lasting.velocity)
        hidden: list[ActiveLimits] | None = None
        while hidden is None or hidden:
            velocity = self.variants.without(removed)
            least = missing(level, velocity)
            hidden = [] if least <= (1.0 - NOTABLE_SHARE) * residual else [
                each for each in _at_bounds(self.variants.cycle_without(removed).bounds, velocity)
                if each not in removed]
            removed += hidden
        if least > (1.0 - SIGNIFICANT_SHARE) * residual:
            return []
        removed = self.fewest(level, removed, least + SIGNIFICANT_SHARE * residual)
        return [self.kind_and_name(each) for each in removed]

    def fewest(self, level: Level, removed: list[Removable], most: float) -> list[Removable]:
        """Return the tasks and limits without which a level still misses `most` at most."""
        for candidate in tuple(removed):
            fewer = [each for each in removed if each is not candidate]
            if missing(level, self.variants.without(fewer)) <= most:
                removed = fewer
        return removed

    def acts(self, evaluation: Evaluation, kind: str, name: str) -> bool:
        """Return whether a task or limit acts on a task in the cycle that lasts, all in place."""
        index = self.variants.level_index(evaluation)
        if kind in (TASK, LOCK):
            return True
        if kind != BOUNDS:
            at_bounds = _at_bounds(self.variants.cycle.bounds, self.variants.lasting.velocity)
            return (kind, name) in [self.kind_and_name(each) for each in (
                *self.active_limits(index), *at_bounds)]
        return any(each.task.name == name for each, _ in self._active_rows(index))

    def _active_rows(self, index: int) -> Iterator[tuple[Evaluation, NDArray[np.intp]]]:
        """Yield each inequality task that acts on a level or above it, with its active rows."""
        for level in self.variants.lasting.levels[:index + 1]:
            for number, multipliers in level.row_multipliers.items():
                first = 0
                for other in self._evaluations[number]:
                    rows = np.flatnonzero(multipliers[first:first + len(other.level.J)])
                    first += len(other.level.J)
                    if len(rows):
                        yield other, rows

    def blocking_rows(self, evaluation: Evaluation, name: str) -> list[str]:
        """Return the names of the rows of an inequality task that block another task."""
        found: dict[str, None] = {}
        # Rows of joints that do not move the task block only others.
        moving = np.abs(evaluation.level.J).sum(axis=0)
        index = self.variants.level_index(evaluation)
        for other, rows in self._active_rows(index):
            if other.task.name == name and other.row_names:
                found.update((other.row_names[row], None) for row in rows.tolist()
                             if np.abs(other.level.J[row]).dot(moving) > 0.0)
        return list(found)

    def of(self, evaluation: Evaluation) -> tuple[Cause, ...]:
        """
        Return the causes that limit a task, the largest share first.

        A candidate is a cause if the residual shrinks by a significant share without it.
        """
        if not self.is_limited(evaluation):
            return ()
        level, found = self.variants.whole_level(evaluation), []
        now = missing(level, self._outcome.velocity)
        lasting = missing(level, self.variants.lasting.velocity)
        for kind, name, gained in self._candidates(evaluation, now, lasting):
            # Before joints have accelerated, more may be missing than now and later.
            share = min(gained / max(now, lasting), 1.0)
            if share > SIGNIFICANT_SHARE:
                found.append(Cause(kind, name, share))
        return tuple(sorted(found, key=lambda cause: -cause.share))

    def _candidates(self, evaluation: Evaluation, now: float, lasting: float
                    ) -> Iterator[tuple[str, str, float]]:
        """Yield (kind, name, size of the residual that disappears) of each candidate."""
        variants = self.variants
        level, index = variants.whole_level(evaluation), variants.level_index(evaluation)
        candidates: list[Removable] = [*self.active_limits(index), *variants.standing,
                                       *self._others(evaluation)]
        for each in candidates:
            yield *self.kind_and_name(each), lasting - missing(level, variants.without([each]))
        yield from self._masked(evaluation, level, lasting)
        if self._is_damped(index):
            yield DAMPING, '', lasting - missing(level, variants.undamped)
        yield from self._singular(evaluation, lasting)
        yield from self._passing(level, now, lasting)

    def _others(self, evaluation: Evaluation) -> list[Evaluation]:
        """
        Return the other tasks, on the level of a task or above it, that can block it.

        They move joints that move it, or that are coupled to these by rows of such tasks. Unless
        one joint slows all, the others change nothing but damping, of which a level has one for
        all joints, and the reserve for the first level, which is a cause of its own.
        """
        index = self.variants.level_index(evaluation)
        others = [each for group in self._evaluations[:index + 1] for each in group
                  if each is not evaluation]
        if self.slows_all:
            return others
        coupled: Array = np.any(_moves(evaluation), axis=0)
        rows = np.vstack([_moves(each) for each in others]) if others else coupled[None]
        for _ in rows:
            found = coupled | np.any(rows[np.any(rows[:, coupled], axis=1)], axis=0)
            if np.array_equal(found, coupled):
                break
            coupled = found
        return [each for each in others if _moves(each)[:, coupled].any()]

    def _masked(self, evaluation: Evaluation, level: Level, lasting: float
                ) -> Iterator[tuple[str, str, float]]:
        """Yield the candidates for joints that the level of a task, or one above, may move."""
        own = self.variants.level_index(evaluation)
        for index, group in enumerate(self._evaluations[:own + 1]):
            if group[0].level.joints is not None:
                yield JOINTS, '' if index == own else group[0].task.name, lasting - missing(
                    level, self.variants.with_all_joints(index))

    def _passing(self, level: Level, now: float, lasting: float
                 ) -> Iterator[tuple[str, str, float]]:
        """Yield the candidates that disappear by themselves, one after the other."""
        variants = self.variants
        unblended = missing(level, variants.unblended)
        if self._outcome.override == TRANSITION:
            yield TRANSITION, '', now - unblended
        accelerated = missing(level, variants.accelerated)
        yield ACCELERATING, '', unblended - accelerated
        if variants.remembers:
            # Curvature that is about to be forgotten, and that of the cycle that lasts.
            yield CURVED, '', accelerated - min(missing(level, variants.straight), lasting)

    def kind_and_name(self, cause: Removable) -> tuple[str, str]:
        """Return the kind and name of a task or limit as a cause."""
        if isinstance(cause, Evaluation):
            return BOUNDS if cause.task.bounded else TASK, cause.task.name
        # Coinciding limits count as one, named after the first.
        kind = cause.limits[0] if isinstance(cause, ActiveLimits) else VelocityLimit.name
        return kind_of_limit(kind, self._robot.velocity_names[cause.joint], self._locked)

    def reaches(self, kind: str, name: str) -> tuple[bool, bool]:
        """Return whether a joint is at a limit now, and in the cycle that lasts."""
        joint, bounds = self._robot.velocity_names.index(name), self.variants.cycle.bounds
        if joint in self._cycle.standing:
            return True, True
        now, later = (any(each.joint == joint and kind in each.limits
                          for each in _at_bounds(bounds, velocity)) for velocity in (
                              self._outcome.velocity, self.variants.lasting.velocity))
        return now, later

    @property
    def slows_all(self) -> bool:
        """Return whether joints at their limits scale the whole command."""
        return self.variants.lasting.slowed < 1.0

    @property
    def slowing_limits(self) -> list[tuple[str, str]]:
        """Return (kind, name) of the limits that slow all joints notably; mostly []."""
        lasting = self.variants.lasting
        return [] if lasting.slowed > 1.0 - NOTABLE_SHARE else [
            self.kind_and_name(each)
            for each in _at_bounds(self.variants.cycle.bounds, lasting.velocity)]

    def limits_at(self, level: LevelSolution, joint: int) -> list[str]:
        """Return the limits of a joint that are active in a level of the cycle; mostly one."""
        return _limits_at(self._cycle.bounds, level, joint)

    def active_limits(self, index: int) -> list[ActiveLimits]:
        """Return all limits that are active in a level of the cycle that lasts, or above it."""
        lasting, bounds = self.variants.lasting, self.variants.cycle.bounds
        found = {ActiveLimits(joint, tuple(_limits_at(bounds, level, joint))): True
                 for level in lasting.levels[:index + 1] for joint in level.limited_by}
        if lasting.slowed < 1.0:
            # Bounds of levels may bring more joints to their limits than the one that decides.
            found.update((each, True) for each in _at_bounds(bounds, lasting.velocity))
        return list(found)

    def movable(self, level: Level) -> Directions | None:
        """Return the directions in which the robot can move a level; None if it moves in all."""
        if not level.J.size or level.is_identity:
            return None
        its = self.variants.lasting.directions_alone(level, NEAR_SINGULAR)
        if its is None or not its.rank or its.s[-1] > IMMOVABLE * its.s[0]:
            return its
        rank = int(np.count_nonzero(its.s > IMMOVABLE * its.s[0]))
        return its._replace(U=its.U[:, :rank], s=its.s[:rank])

    def _is_damped(self, index: int) -> bool:
        """Return whether a level, or one above it, is damped or relaxed."""
        return any(level.is_damped for level in self.variants.lasting.levels[:index + 1])

    def _singular(self, evaluation: Evaluation, lasting: float
                  ) -> Iterator[tuple[str, str, float]]:
        """Yield the candidates for directions in which the robot can hardly move or not at all."""
        level, solution = self.variants.whole_level(evaluation), self.variants.lasting
        residual, gained = residual_of(level, solution.velocity), 0.0
        solved = solution.levels[self.variants.level_index(evaluation)]
        if solved.is_relaxed:
            gained = lasting - norm(residual + level.J.dot(solved.added))
        its = self.movable(level)
        if its is not None and its.rank < len(level.J):
            yield IMPOSSIBLE, '', lasting - norm(its.U.T.dot(residual))
        if its is not None and its.rank and its.s[-1] < NEAR_SINGULAR:
            J = (its.U * np.maximum(its.s, NEAR_SINGULAR)).dot(its.moving.T)
            other = replace(level, J=J)
            gained = max(gained, lasting - missing(
                other, self.variants.with_level(evaluation, other)))
        yield SINGULARITY, '', gained


def kind_of_limit(kind: str, joint: str, locked: Sequence[str]) -> tuple[str, str]:
    """Return kind and name of the cause that is a limit of a joint, or its lock."""
    return LOCK if kind == VelocityLimit.name and joint in locked else kind, joint


def _moves(evaluation: Evaluation) -> Array:
    """Return whether each joint moves each row of a task (rows, n)."""
    return np.asarray(evaluation.level.J != 0.0)


def _limits_at(bounds: VelocityBounds, level: LevelSolution, joint: int) -> list[str]:
    """Return the limits of a joint that are active in a level; mostly one."""
    return bounds.limits(joint, bool(level.multipliers[joint] > 0.0),
                         float(level.limited_velocity[joint]))


def _at_bounds(bounds: VelocityBounds, x: Array) -> list[ActiveLimits]:
    """Return the limits that are active at velocities x (n,)."""
    return [ActiveLimits(joint, tuple(bounds.limits(joint, up)))
            for up, bound in ((True, bounds.upper), (False, bounds.lower))
            for joint in np.flatnonzero(np.abs(x - bound) <= SAME_VELOCITY).tolist()
            if joint not in bounds.standing]


def residual_of(level: Level, x: Array) -> Array:
    """Return the residual (m,) of the demand or bounds of a level at velocities x (n,)."""
    achieved = level.J.dot(x)
    return (level.demanded(achieved) if level.v is None else level.v) - achieved


def missing(level: Level, x: Array) -> float:
    """Return the norm of the residual of a level at velocities x (n,)."""
    return norm(residual_of(level, x))

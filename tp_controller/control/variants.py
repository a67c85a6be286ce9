# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Variants of a cycle that lasts: with some of its tasks, limits or options changed."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

from tp_controller.control.cycle import Cycle
from tp_controller.control.error_minimum import Place
from tp_controller.control.joint_limits import VelocityLimit
from tp_controller.control.settling import settled
from tp_controller.control.standing_joints import whole_levels, without_joints
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Bounds, Solution
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation


class ActiveLimits(NamedTuple):
    """Coinciding limits of a joint that are active in a level."""

    joint: int
    limits: tuple[str, ...]


class StandingJoint(NamedTuple):
    """Joint whose velocity limit of zero keeps it from moving."""

    joint: int


Removable: TypeAlias = Evaluation | ActiveLimits | StandingJoint


class Variants:
    """
    Velocities of a cycle that lasts, with some of its tasks or limits changed.

    A cycle lasts if state and goals stay as they are: all joints have accelerated, changes are
    blended in, and the memory of the solver has settled. It never rises above the present one,
    which has seen only what has happened.

    Parameters
    ----------
    evaluations : sequence of sequence of Evaluation
        Evaluations of the tasks, level by level.
    cycle : Cycle
        The present cycle.
    place : Place
        Configuration of the robot in the cycle.

    Attributes
    ----------
    cycle : Cycle
        The cycle without transient limits, with the present memory, one number for each level.

    """

    def __init__(self, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle,
                 place: Place) -> None:
        self._evaluations, self._present, self._place = evaluations, cycle, place
        memory = (*cycle.memory, *(0.0,) * len(cycle.levels))[:len(cycle.levels)]
        self.cycle = cycle._replace(bounds=cycle.bounds.settled, memory=memory)
        self._level_indices = {id(evaluation): index for index, group in enumerate(evaluations)
                               for evaluation in group}
        # Cache of velocities: another task may need the same variant.
        self._found: dict[tuple[object, ...], Array] = {}

    def level_index(self, evaluation: Evaluation) -> int:
        """Return the index of the level of a task."""
        return self._level_indices[id(evaluation)]

    @cached_property
    def _whole_levels(self) -> dict[int, Level]:
        """Return the levels of the tasks with the columns of all joints."""
        return whole_levels(self._evaluations, self._place, self._present.bounds.last,
                            self.cycle.standing)

    def whole_level(self, evaluation: Evaluation) -> Level:
        """Return the level of a task with the columns of joints that stand, too."""
        return self._whole_levels[id(evaluation)] if self.cycle.standing else evaluation.level

    @property
    def standing(self) -> list[StandingJoint]:
        """Return the joints that stand, and stay."""
        return [StandingJoint(joint) for joint in self.cycle.standing]

    @cached_property
    def lasting(self) -> Solution:
        """Return the solution of the cycle that lasts."""
        return settled(self.cycle)

    @property
    def remembers(self) -> bool:
        """Return whether the memory damps a level."""
        return any(self.cycle.memory)

    @cached_property
    def unblended(self) -> Array:
        """Return the present velocities (n,) without a transition."""
        return self._present.solve().velocity

    @cached_property
    def accelerated(self) -> Array:
        """Return the velocities (n,) without transient limits, with the present memory."""
        return self.cycle.solve().velocity

    @cached_property
    def straight(self) -> Array:
        """Return the velocities (n,) without damping against curvature."""
        bounds = self.cycle.bounds
        return self.cycle.solver.solve(
            self.cycle.levels, Bounds(bounds.lower, bounds.upper, bounds.cap)).velocity

    @cached_property
    def undamped(self) -> Array:
        """Return the velocities (n,) without damping."""
        return settled(self.cycle._replace(solver=self.cycle.solver.undamped)).velocity

    def without(self, removed: Sequence[Removable]) -> Array:
        """Return the velocities (n,) without some tasks and limits."""
        key = tuple([each.task.name if isinstance(each, Evaluation) else each for each in removed])
        if key not in self._found:
            cycle = self.cycle_without(removed)
            groups = [[self._moved(each, cycle.standing) for each in group if each not in removed]
                      for group in self._evaluations]
            kept = [index for index, group in enumerate(groups) if group]
            self._found[key] = settled(cycle._replace(
                levels=levels_of([groups[index] for index in kept]),
                memory=tuple([self.cycle.memory[index] for index in kept]))).velocity
        return self._found[key]

    def with_all_joints(self, index: int) -> Array:
        """Return the velocities (n,) with a level that may move all joints."""
        key = 'joints', index
        if key not in self._found:
            levels = list(self.cycle.levels)
            levels[index] = replace(levels[index], joints=None)
            self._found[key] = settled(self.cycle._replace(levels=levels)).velocity
        return self._found[key]

    def cycle_without(self, removed: Sequence[Removable]) -> Cycle:
        """Return the cycle without the joint limits and locks among removed candidates."""
        cycle = self.cycle
        for each in removed:
            if isinstance(each, ActiveLimits):
                cycle = cycle._replace(bounds=cycle.bounds.without(*each))
            elif isinstance(each, StandingJoint):
                cycle = cycle._replace(
                    bounds=cycle.bounds.without(each.joint, [VelocityLimit.name]),
                    standing=tuple([joint for joint in cycle.standing if joint != each.joint]))
        return cycle

    def _moved(self, evaluation: Evaluation, standing: tuple[int, ...]) -> Evaluation:
        """Return an evaluation with the columns of all joints but some that stand."""
        if standing == self.cycle.standing:
            return evaluation
        return replace(evaluation, level=without_joints(self.whole_level(evaluation), standing))

    def with_level(self, evaluation: Evaluation, level: Level) -> Array:
        """Return the velocities (n,) with another level in place of that of a task."""
        other = replace(evaluation, level=without_joints(level, self.cycle.standing))
        groups = [[other if each is evaluation else each for each in group]
                  for group in self._evaluations]
        return settled(self.cycle._replace(levels=levels_of(groups))).velocity

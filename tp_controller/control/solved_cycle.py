# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Cycles that were solved, as their reports read them."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from tp_controller.control.causes import CombinedCauses, FoundCauses
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.error_minimum import Place
from tp_controller.control.standing_joints import evaluations_without
from tp_controller.control.step import CycleMemory
from tp_controller.model.spatial import Array
from tp_controller.tasks.stack import Groups
from tp_controller.tasks.task import Evaluation


class SolvedCycle(Protocol):
    """Problem and outcome of a cycle, its memory, and the configuration of the robot in it."""

    @property
    def velocity(self) -> Array:
        """Return the command (n,) [rad/s or m/s]."""

    @property
    def memory(self) -> CycleMemory:
        """Return the memory for the next cycle."""

    @property
    def tasks(self) -> Groups:
        """Return the enabled tasks, level by level."""

    @property
    def errors(self) -> Sequence[Array]:
        """Return the error of each task."""

    @property
    def evaluations(self) -> Sequence[Sequence[Evaluation]]:
        """Return the evaluations of the tasks, level by level."""

    @property
    def cycle(self) -> Cycle:
        """Return the problem."""

    @property
    def outcome(self) -> Outcome:
        """Return the outcome."""

    @property
    def place(self) -> Place:
        """Return the configuration."""

    @property
    def options(self) -> CycleOptions:
        """Return the options in force."""

    def causes(self, least: Array) -> FoundCauses | None:
        """Return the causes that limit each task; None if they are not found by the core."""

    def combined_causes(self, index: int) -> CombinedCauses | None:
        """Return the causes that block a task together; None if they are not found by the core."""


class Solved(NamedTuple):
    """Cycle that `step` computed; see `SolvedCycle`."""

    evaluations: Sequence[Sequence[Evaluation]]
    cycle: Cycle
    outcome: Outcome
    memory: CycleMemory
    place: Place
    options: CycleOptions

    @classmethod
    def after(cls, evaluations: Sequence[Sequence[Evaluation]], cycle: Cycle, outcome: Outcome,
              memory: CycleMemory, place: Place, options: CycleOptions) -> 'Solved':
        """Return a cycle of tasks as they were evaluated, with the levels that it solved."""
        return cls(evaluations_without(evaluations, cycle.standing), cycle, outcome, memory,
                   place, options)

    @property
    def tasks(self) -> Groups:
        """Return the enabled tasks, level by level."""
        return tuple([tuple([each.task for each in group]) for group in self.evaluations])

    @property
    def errors(self) -> Sequence[Array]:
        """Return the error of each task."""
        return [each.error for group in self.evaluations for each in group]

    @property
    def velocity(self) -> Array:
        """Return the command (n,) [rad/s or m/s]."""
        return self.memory.velocity

    def causes(self, least: Array) -> None:
        """Leave the search for causes to the reference."""

    def combined_causes(self, index: int) -> None:
        """Leave the search for causes to the reference."""

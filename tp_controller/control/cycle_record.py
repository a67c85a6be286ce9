# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Records of cycles: all of a cycle as a row of doubles, as the compiled core writes it.

It begins with the memory that the next cycle gets; the rest is for reports. step_object.h writes
it.
"""

from collections.abc import Iterator, Sequence
from functools import cached_property
import math
from struct import Struct
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from tp_controller.control.causes import CombinedCauses, FoundCauses
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.cycle_time import CycleTime
from tp_controller.control.error_minimum import Place
from tp_controller.control.escape import Escape
from tp_controller.control.standing_joints import evaluations_without
from tp_controller.control.step import CycleMemory
from tp_controller.control.velocity_limits import VelocityBounds
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.compiled import Record
from tp_controller.solver.level import identity, Level
from tp_controller.solver.solution import Solution
from tp_controller.tasks.stack import Groups, levels_of
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.twin import Twin

# Numbers of a memory that precede its arrays: time of the last command, those of `CycleTime`,
# tries and nudges of `Escape`, the time since which the robot is at rest, and that of the last
# change of the command.
MEMORY_HEAD = 9
# Numbers between the memory and the arrays of a cycle.
CYCLE_HEAD = Struct('5d')
# The twins of the tasks of each level; None for a task that Python evaluates.
Twins: TypeAlias = tuple[tuple[Twin | None, ...], ...]


class CompiledCauses(Protocol):
    """Search for causes in the compiled core."""

    def causes(self, record: bytes, before: bytes, least: Array) -> FoundCauses | None:
        """
        Return the causes that limit each task in a cycle; None if the reference is needed.

        Parameters
        ----------
        record, before : bytes
            Records of the cycle and the one before.
        least : ndarray (t,)
            Residual of each task up to which it is not limited.

        """

    def combined_causes(self, record: bytes, before: bytes, task: int) -> CombinedCauses | None:
        """Return the causes that block a task, by its index, together; see `causes`."""


class Layout(NamedTuple):
    """
    Places of the numbers in the records of a stack.

    Attributes
    ----------
    options : CycleOptions
    active : tuple of tuple of Task
        Tasks of each level.
    twins : tuple of tuple of Twin or None
        Their twins.
    search : CompiledCauses
    spare : RobotState
        Scratch state for reports.

    """

    options: CycleOptions
    active: Groups
    twins: Twins
    search: CompiledCauses
    spare: RobotState

    def memory(self, record: bytes) -> CycleMemory:
        """Return the memory after a cycle."""
        n, delay = self.options.n, self.options.delay
        numbers = np.frombuffer(record)
        (commanded, now, mean, usual, commands, tries, nudges,
         still_since, before) = numbers[:MEMORY_HEAD].tolist()
        first = MEMORY_HEAD + 3 * n
        velocity, acceleration, demand = numbers[MEMORY_HEAD:first].reshape(3, n)
        return CycleMemory(
            velocity, acceleration, before,
            tuple(numbers[first:first + delay * n].reshape(delay, n)),
            None if math.isnan(commanded) else commanded,
            CycleTime(now, mean, usual, int(commands)),
            tuple(numbers[first + delay * n:][:len(self.active)].tolist()),
            escape=Escape(int(tries), int(nudges),
                          None if math.isnan(still_since) else still_since),
            demand=None if np.isnan(demand).any() else demand)

    def pack(self, memory: CycleMemory) -> bytes | None:
        """Return a memory as the beginning of a record; None during a transition or a nudge."""
        if memory.transition.fades or memory.escape.upper:
            return None
        escape, count = memory.escape, len(self.active)
        head = (memory.commanded, *memory.time, escape.tries, escape.nudges, escape.still_since,
                memory.before)
        return np.concatenate((
            [math.nan if number is None else number for number in head], memory.velocity,
            memory.acceleration, np.full(self.options.n, math.nan) if memory.demand is None
            else memory.demand, *memory.pending,
            (*memory.damping, *(0.0,) * count)[:count])).tobytes()


class CycleRecord:
    """
    One cycle of the compiled core; everything is read on access.

    Parameters
    ----------
    layout : Layout
    numbers, before : bytes
        Records of this cycle and the one before.
    velocity : ndarray (n,)
        Command [rad/s or m/s].
    given : sequence of Evaluation
        Evaluations of the tasks without a twin, in order.
    configuration : tuple, optional
        q (nq,) and the positions of the passive joints (p,) or None [rad or m]; by default the
        positions of the record.

    """

    def __init__(self, layout: Layout, numbers: bytes, before: bytes, velocity: Array,
                 given: Sequence[Evaluation],
                 configuration: tuple[Array, Array | None] | None) -> None:
        self.layout, self.numbers, self.velocity = layout, numbers, velocity
        self._before, self._given, self._configuration = before, given, configuration

    @cached_property
    def memory(self) -> CycleMemory:
        """Return the memory for the next cycle."""
        return self.layout.memory(self.numbers)

    @property
    def place(self) -> Place:
        """Return the configuration of the robot."""
        q, passive = self._configuration or (self._positions, None)
        return Place(q, passive, float(self._numbers[0]), self.layout.spare)

    @property
    def velocity_before(self) -> Array:
        """Return the command before this one (n,) [rad/s or m/s]."""
        return self.layout.memory(self._before).velocity

    @property
    def options(self) -> CycleOptions:
        """Return the options in force."""
        return self.layout.options

    @property
    def tasks(self) -> Groups:
        """Return the enabled tasks, level by level."""
        return self.layout.active

    @cached_property
    def errors(self) -> list[Array]:
        """Return the error of each task."""
        given, compiled = iter(self._given), iter(self._by_twins)
        return [next(given).error if twin is None else next(compiled)[0]
                for twins in self.layout.twins for twin in twins]

    @cached_property
    def evaluations(self) -> Sequence[Sequence[Evaluation]]:
        """Return the evaluations of the enabled tasks, level by level."""
        given, compiled = iter(self._given), iter(self._by_twins)
        self._at = self._first + (4 if self._has_demand else 3) * self._n
        found = [self._group(list(zip(*group)), given, compiled)
                 for group in zip(self.layout.active, self.layout.twins)]
        # The record has the columns of all joints.
        return evaluations_without(found, self._bounds.standing)

    @cached_property
    def cycle(self) -> Cycle:
        """Return the problem of the cycle."""
        return Cycle(levels_of(self.evaluations), self._bounds, self.layout.options.solver,
                     self.layout.memory(self._before).damping, self._bounds.standing)

    @cached_property
    def _bounds(self) -> VelocityBounds:
        """Return the bounds of the cycle."""
        options, before, n = self.layout.options, self.layout.memory(self._before), self._n
        time = self.memory.time
        motion = before.motion(self._positions, self._head[2], time.longest_hold(options.period))
        first = self._first + 3 * n
        if self._has_demand:
            motion = motion._replace(demand=self._numbers[first:first + n])
        box = self._numbers[first - 2 * n:first].reshape(2, n)
        return options.limits.bounds(motion, (box[0], box[1]), time.mean)

    @cached_property
    def outcome(self) -> Outcome:
        """Return the outcome of the cycle."""
        slowed, has_steps, *_, steps_at = self._head
        levels, memory = self.cycle.levels, self.memory.damping
        if not has_steps:
            solution = Solution(self.velocity, levels, memory)
            return Outcome(solution, solution)
        steps = memoryview(self.numbers)[8 * int(steps_at):]
        whole = np.frombuffer(steps, count=self._n)
        solution = Solution(self.velocity, levels, memory, Record(steps, self._n, len(levels)),
                            whole, slowed)
        return Outcome(solution, solution)

    def causes(self, least: Array) -> FoundCauses | None:
        """Return the causes that limit each task; see `CompiledCauses`."""
        return self.layout.search.causes(self.numbers, self._before, least)

    def combined_causes(self, index: int) -> CombinedCauses | None:
        """Return the causes that block a task together; see `CompiledCauses`."""
        return self.layout.search.combined_causes(self.numbers, self._before, index)

    @cached_property
    def _numbers(self) -> Array:
        """Return the record as an array of doubles."""
        return np.frombuffer(self.numbers)

    @property
    def _n(self) -> int:
        """Return the number of joints."""
        return self.layout.options.n

    @cached_property
    def _first(self) -> int:
        """Return the index of the first number after memory and head."""
        options = self.layout.options
        return MEMORY_HEAD + (3 + options.delay) * options.n + len(self.layout.active) \
            + CYCLE_HEAD.size // 8

    @property
    def _has_demand(self) -> bool:
        """Return whether the record has the demand of the tasks, which limits follow."""
        return self.layout.options.limits.follow_demand

    @cached_property
    def _head(self) -> tuple[float, ...]:
        """
        Return the numbers between memory and arrays.

        The uniform scaling, whether there are steps, the time since a command, and the indices at
        which errors and steps begin.
        """
        return CYCLE_HEAD.unpack_from(self.numbers, 8 * self._first - CYCLE_HEAD.size)

    @property
    def _positions(self) -> Array:
        """Return the positions (n,) [rad or m]."""
        return self._numbers[self._first:self._first + self._n]

    @cached_property
    def _by_twins(self) -> list[tuple[Array, Array]]:
        """Return the error of each task that has a twin, and the keys of its rows, if any."""
        self._at = int(self._head[3])
        found = []
        for twins in self.layout.twins:
            for _ in filter(None, twins):
                rows, keyed = map(int, self._take(2).tolist())
                found.append((self._take(rows), self._take(rows * keyed)))
        return found

    def _group(self, tasks: list[tuple[Task, Twin | None]], given: Iterator[Evaluation],
               compiled: Iterator[tuple[Array, Array]]) -> list[Evaluation]:
        """Return the evaluations of the tasks of the next level."""
        count, bounded, _, masked, weighted = map(int, self._take(5).tolist())
        self._take(self._n * masked)
        parts = self._take(2 * count).astype(int).reshape(count, 2).tolist()
        m, is_identity = sum(rows for rows, _ in parts), count == 1 and parts[0][1]
        J = identity(self._n) if is_identity else self._take(m * self._n).reshape(m, self._n)
        v, upper = self._take(m), self._take(m) if bounded else None
        self._take(m * weighted)
        found, first = [], 0
        for (task, twin), (rows, every_joint) in zip(tasks, parts):
            if twin is None:
                found.append(next(given))
            else:
                error, keys = next(compiled)
                its = slice(first, first + rows)
                level = Level(J[its], v[its], twin.mode, is_identity=bool(every_joint)) \
                    if upper is None else Level(J[its], lower=v[its], upper=upper[its])
                found.append(task.complete(Evaluation(task, level, error,
                                                      task.row_names_of(keys))))
            first += rows
        return found

    def _take(self, size: int) -> Array:
        """Return the next numbers (size,)."""
        begin = self._at
        self._at = begin + size
        return self._numbers[begin:self._at]

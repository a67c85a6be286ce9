# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Cycles in one call of the compiled core: `step`, and the evaluation of its tasks.

Transitions, nudges, faults and cycles without a solution are left to `step`, and so are robots and
solvers that the core does not support.
"""

from collections.abc import Sequence
import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.active_stack import ActiveStack
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.cycle_record import CompiledCauses, CycleRecord, Layout
from tp_controller.control.solved_cycle import SolvedCycle
from tp_controller.control.state_buffer import StateBuffer
from tp_controller.control.step import Commanded
from tp_controller.model.compiled import Motion
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.compiled import core
from tp_controller.solver.level import Level
from tp_controller.solver.solve import PrioritySolver
from tp_controller.tasks.stack import Groups
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import is_foreign
from tp_controller.tasks.twin import CompiledTask, Watch


class CompiledCycle(CompiledCauses, Protocol):
    """Cycle of a stack in the compiled core."""

    def set_tasks(self, motion: Motion,
                  tasks: tuple[tuple[CompiledTask | None, ...], ...]) -> None:
        """Set the tasks of each level of a robot; raise ValueError if they do not fit."""

    def run(self, memory: bytes, motion: Motion, moved: bool, positions: ArrayLike, now: float,
            elapsed: float, levels: tuple[Level, ...], velocity: Array) -> bytes | None:
        """
        Fill in the velocity (n,) of a cycle and return its record; None if `step` is needed.

        Parameters
        ----------
        memory : bytes
            Record of the cycle before, or its memory alone.
        motion : Motion
            Kinematics.
        moved : bool
            Whether they are at these positions; else they are moved there.
        positions : array_like (n,)
            [rad or m]
        now, elapsed : float
            See `Problem`; `elapsed` is NaN for the advance of `now` [s].
        levels : tuple of Level
            Levels of the tasks that are None, in order.
        velocity : ndarray (n,)
            Filled in [rad/s or m/s].

        """


class CompiledStep:
    """
    Cycles of one stack with one set of options.

    Parameters
    ----------
    options : CycleOptions
    active : tuple of tuple of Task
        Enabled tasks of each level.
    compiled : CompiledCycle
    motion : Motion
        Kinematics, for robots whose configuration is the positions of the driven joints.

    Attributes
    ----------
    layout : Layout
    given : tuple of Task
        Tasks that Python evaluates.

    """

    def __init__(self, options: CycleOptions, active: Groups, compiled: CompiledCycle,
                 motion: Motion) -> None:
        self._compiled, self._motion = compiled, motion
        self._watch = Watch()
        self.layout = Layout(options, active, (), compiled)
        self.given: tuple[Task, ...] = ()
        for group in active:
            for task in group:
                if has_twin(task):
                    # Others may set attributes in every cycle.
                    task.watch(self._watch)

    def refresh(self) -> None:
        """Read inputs of tasks that have changed."""
        if not self._watch.changed:
            return
        self._watch.changed, active = False, self.layout.active
        twins = tuple([tuple([task.twin if has_twin(task) else None for task in group])
                       for group in active])
        self._compiled.set_tasks(self._motion, tuple([
            tuple([None if twin is None else twin.task for twin in group]) for group in twins]))
        self.layout = self.layout._replace(twins=twins)
        self.given = tuple([task for group in zip(active, twins)
                            for task, twin in zip(*group) if twin is None])

    def run(self, memory: bytes, state: RobotState | None, q: ArrayLike, now: float,
            elapsed: float | None, given: Sequence[Evaluation], velocity: Array) -> bytes | None:
        """
        Fill in the velocity (n,) of a cycle and return its record; None if `step` is needed.

        Parameters
        ----------
        memory : bytes
            Record of the cycle before, or its memory alone.
        state : RobotState or None
            State at the configuration; None for a robot whose configuration is its positions.
        q : array_like (nq,)
            Configuration [rad or m].
        now, elapsed
            See `Problem`.
        given : sequence of Evaluation
            Evaluations of the tasks in `given`.
        velocity : ndarray (n,)
            Filled in [rad/s or m/s].

        """
        motion = self._motion if state is None else state.motion
        if motion is None:
            return None
        return self._compiled.run(
            memory, motion, state is not None, q if state is None else state.positions, now,
            math.nan if elapsed is None else elapsed,
            tuple([each.level for each in given]) if given else (), velocity)


def has_twin(task: Task) -> bool:
    """Return whether a task may have a twin; Python evaluates and checks those of others."""
    return type(task).make_twin is not Task.make_twin and not is_foreign(task)


def compiled_step(robot: Robot, options: CycleOptions, active: Groups) -> CompiledStep | None:
    """Return the cycles of a stack in the core; None if it does not support robot or solver."""
    solver, motion = options.solver, robot.kinematics.motion()
    if core is None or motion is None or not isinstance(solver, PrioritySolver) \
            or solver.core is None or options.limits.compiled is None:
        return None
    compiled: CompiledCycle = core.Step(solver.core, options.limits.compiled, options.limits.cap,
                                        options.period, options.delay)
    if not robot.kinematics.base.moves:
        motion.move(robot.neutral(), robot.kinematics.offset, None)
    return CompiledStep(options, active, compiled, motion)


class CoreCycles:
    """
    Cycles of a robot in the compiled core, for the stack and the options in force.

    Parameters
    ----------
    robot : Robot
    states : StateBuffer
        States of the robot; cycles whose tasks all have twins need none.

    """

    def __init__(self, robot: Robot, states: StateBuffer) -> None:
        self._robot, self._states = robot, states
        self._moving_base = robot.kinematics.base.moves
        self._step: CompiledStep | None = None
        self._made_for: tuple[CycleOptions, Groups] | None = None

    def solve(self, options: CycleOptions, tasks: ActiveStack, last: SolvedCycle | Commanded,
              q: ArrayLike, now: float, passive: ArrayLike | None, elapsed: float | None
              ) -> CycleRecord | None:
        """
        Return the next cycle; None if `step` is needed.

        Parameters
        ----------
        options : CycleOptions
            Options in force.
        tasks : ActiveStack
            Stack in force, without changes since the last cycle.
        last : SolvedCycle or Commanded
            The last cycle.
        q, now, passive, elapsed
            See `Controller.update`.

        Raises
        ------
        RobotError, EvaluationError
            See `Controller.update`.

        """
        step = self._step_of(options, tasks.stack.active)
        memory = None if step is None else self._memory_of(last, step.layout)
        if step is None or memory is None:
            return None
        states, state, place = self._states, None, None
        given: list[Evaluation] = []
        if step.given or self._moving_base or passive is not None or states.passive is not None:
            state = states.update(q, passive, last.velocity)
            place = state.q
            evaluated = tasks.evaluate_some(step.given, state, now)
            if evaluated is None:
                return None
            given = evaluated
        velocity = np.empty(options.n)
        numbers = step.run(memory, state, q, now, elapsed, given, velocity)
        if numbers is None:
            return None
        found = CycleRecord(step.layout, numbers, memory, velocity, given,
                            (place, states.passive, now, states.spare))
        if state is None:
            states.pass_by(found, last.velocity)
        return found

    def _step_of(self, options: CycleOptions, active: Groups) -> CompiledStep | None:
        """Return the compiled step of a stack, with the present inputs of its tasks."""
        wanted = self._made_for
        if wanted is None or wanted[0] is not options or wanted[1] is not active:
            self._made_for = options, active
            self._step = compiled_step(self._robot, options, active)
        if self._step is not None:
            self._step.refresh()
        return self._step

    @staticmethod
    def _memory_of(last: SolvedCycle | Commanded, layout: Layout) -> bytes | None:
        """Return the memory of the last cycle as a record; None during a transition or nudge."""
        if isinstance(last, CycleRecord) and last.layout.options is layout.options \
                and len(last.layout.active) == len(layout.active):
            return last.numbers
        return layout.pack(last.memory)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Cycles in one call of the compiled core: `step`, and the evaluation of its tasks.

Transitions, nudges, faults and cycles without a solution are left to `step`, and so are robots and
solvers that the core does not support.
"""

from collections.abc import Sequence
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
            elapsed: float | None, levels: tuple[Level, ...], velocity: Array) -> bytes | None:
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
            See `Problem` [s].
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
    spare : RobotState
        Scratch state for reports.

    Attributes
    ----------
    layout : Layout
    given : tuple of Task
        Tasks that Python evaluates.
    watch : Watch
        Whether `refresh` is due.

    """

    def __init__(self, options: CycleOptions, active: Groups, compiled: CompiledCycle,
                 motion: Motion, spare: RobotState) -> None:
        self._compiled, self._motion, self._n = compiled, motion, options.n
        self.watch = Watch()
        self.layout = Layout(options, active, (), compiled, spare)
        self.given: tuple[Task, ...] = ()
        for group in active:
            for task in group:
                if has_twin(task):
                    # Others may set attributes in every cycle.
                    task.watch(self.watch)

    def refresh(self) -> None:
        """Read inputs of tasks that have changed."""
        self.watch.changed, active = False, self.layout.active
        twins = tuple([tuple([task.twin if has_twin(task) else None for task in group])
                       for group in active])
        self._compiled.set_tasks(self._motion, tuple([
            tuple([None if twin is None else twin.task for twin in group]) for group in twins]))
        self.layout = self.layout._replace(twins=twins)
        self.given = tuple([task for group in zip(active, twins)
                            for task, twin in zip(*group) if twin is None])

    def run(self, memory: bytes, q: ArrayLike, now: float, elapsed: float | None,
            state: RobotState | None = None, passive: Array | None = None,
            given: Sequence[Evaluation] = ()) -> CycleRecord | None:
        """
        Return the next cycle; None if `step` is needed.

        Parameters
        ----------
        memory : bytes
            Record of the cycle before, or its memory alone.
        q : array_like (nq,)
            Configuration [rad or m].
        now, elapsed
            See `Problem`.
        state : RobotState, optional
            State at the configuration; not needed if that is the positions of the driven joints.
        passive : ndarray (p,), optional
            Positions of the passive joints in that state [rad or m].
        given : sequence of Evaluation
            Evaluations of the tasks in `given`.

        """
        velocity = np.empty(self._n)
        if state is None:
            numbers = self._compiled.run(memory, self._motion, False, q, now, elapsed, (),
                                         velocity)
            configuration = None
        elif state.motion is None:
            return None
        else:
            numbers = self._compiled.run(
                memory, state.motion, True, state.positions, now, elapsed,
                tuple([each.level for each in given]), velocity)
            configuration = state.q, passive
        return None if numbers is None else CycleRecord(self.layout, numbers, memory, velocity,
                                                        given, configuration)


def has_twin(task: Task) -> bool:
    """Return whether a task may have a twin; Python evaluates and checks those of others."""
    return type(task).make_twin is not Task.make_twin and not is_foreign(task)


def compiled_step(robot: Robot, options: CycleOptions, active: Groups, spare: RobotState
                  ) -> CompiledStep | None:
    """Return the cycles of a stack in the core; None if it does not support robot or solver."""
    solver, motion = options.solver, robot.kinematics.motion()
    if core is None or motion is None or not isinstance(solver, PrioritySolver) \
            or solver.core is None or options.limits.compiled is None:
        return None
    compiled: CompiledCycle = core.Step(solver.core, options.limits.compiled, options.limits.cap,
                                        options.period, options.delay)
    if not robot.kinematics.base.moves:
        motion.move(robot.neutral(), robot.kinematics.offset, None)
    return CompiledStep(options, active, compiled, motion, spare)


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
        self._options: CycleOptions | None = None
        self._active: Groups | None = None

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
        active = tasks.stack.active
        if options is not self._options or active is not self._active:
            self._options, self._active = options, active
            self._step = compiled_step(self._robot, options, active, self._states.spare)
        step, states = self._step, self._states
        if step is None:
            return None
        if step.watch.changed:
            step.refresh()
        memory = last.numbers if type(last) is CycleRecord and last.layout is step.layout \
            else self._memory_of(last, step.layout)
        if memory is None:
            return None
        if step.given or self._moving_base or passive is not None or states.passive is not None:
            state = states.update(q, passive, last.velocity)
            given = tasks.evaluate_some(step.given, state, now)
            return None if given is None else step.run(memory, q, now, elapsed, state,
                                                       states.passive, given)
        found = step.run(memory, q, now, elapsed)
        if found is not None:
            states.pending = found
        return found

    @staticmethod
    def _memory_of(last: SolvedCycle | Commanded, layout: Layout) -> bytes | None:
        """Return the memory of the last cycle as a record; None during a transition or nudge."""
        if isinstance(last, CycleRecord) and last.layout.options is layout.options \
                and len(last.layout.active) == len(layout.active):
            return last.numbers
        return layout.pack(last.memory)

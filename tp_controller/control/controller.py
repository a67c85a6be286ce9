# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Controller: joint positions in, joint velocities and a report out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.changes import NO_TRAJECTORIES
from tp_controller.control.compiled_step import CoreCycles
from tp_controller.control.cycle_options import CycleOptions, setting_faults, SolverFactory
from tp_controller.control.cycle_time import check_time, check_times
from tp_controller.control.error_minimum import Place
from tp_controller.control.gains import gain_remark
from tp_controller.control.joint_inputs import JointInputs
from tp_controller.control.ramp import ramp_down
from tp_controller.control.report import Report
from tp_controller.control.settings import Settings, STOP
from tp_controller.control.solved_cycle import Solved, SolvedCycle
from tp_controller.control.step import Commanded, CycleMemory, Problem, Snapshot, step
from tp_controller.errors import SettingsError, TimeError
from tp_controller.model.robot import check_robot, Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.stack import check_type, levels_of, Stack


class Command(NamedTuple):
    """
    Command and report of one cycle.

    Attributes
    ----------
    velocity : ndarray (n,)
        Velocities of the base, if it moves, and the driven joints [rad/s or m/s], within every
        limit; see `Robot.velocity_names`.
    report : Report

    """

    velocity: Array
    report: Report


class Controller(JointInputs):
    """
    Velocity controller that executes a stack of tasks on a robot, one `update` per cycle.

    The tasks store goals and the state of cycles, so they belong to this controller from now on.

    Times (`now`) come from any clock of the caller, in seconds; calls without a time are refused.
    The clock should not stand still or be set back, but both are tolerated; see `update`.

    Parameters
    ----------
    robot : Robot
    stack : Stack
    settings : Settings, optional
    solver : callable (Settings, int) -> Solver, optional
        Makes the solver for settings and n joints; by default that of this package.

    Raises
    ------
    RobotError
        `robot` is not a `Robot`.
    SettingsError
        The settings do not fit the robot or the stack; see `check_settings`.
    StackError
        `stack` is not a `Stack`, or another controller has used tasks of it; see `Stack.copy`.

    """

    def __init__(self, robot: Robot, stack: Stack, settings: Settings | None = None,
                 solver: SolverFactory = Settings.solver) -> None:
        check_robot(robot)
        check_type(stack)
        super().__init__(robot, stack, settings or Settings())
        self._make_solver = solver
        self.check_settings(self._settings)
        # The last cycle, or the memory of a command without tasks.
        self._last: SolvedCycle | Commanded = Commanded(CycleMemory.at_rest(robot.n))
        self._core = CoreCycles(robot, self._states)
        self._apply(self._settings)
        self._tasks.own()

    def replace_stack(self, stack: Stack, settings: Settings | None = None) -> None:
        """
        Replace the stack from the next cycle on.

        Tasks of the same name, type and frame or joints keep their goals and feed-forward
        velocities. The change does not disturb the upper levels whose tasks are the same in both
        stacks, with the same keys and goals.

        Parameters
        ----------
        stack : Stack
            New stack.
        settings : Settings, optional
            New settings; those in force by default.

        Raises
        ------
        SettingsError
            The settings do not fit it; the previous stack and settings stay in force.
        StackError
            Tasks belong to another controller, or to a stack that was replaced before; see
            `Stack.copy`. The previous stack stays in force.
        EvaluationError
            A task fails when it receives its goal; the previous stack stays in force.

        """
        settings = settings or self._settings
        self.check_settings(settings, stack)
        self._tasks.replace(stack)
        stack.limit_time(settings.task_budget * settings.period)
        self.settings = settings

    def halt(self, now: float | None = None) -> None:
        """
        Notify the controller that zero velocity is being commanded.

        Raises
        ------
        TimeError
            `now` is not a finite number; the call then has no effect.

        """
        self._command(now, np.zeros(self.robot.n))

    @property
    def velocity(self) -> Array:
        """Return the last command (n,) [rad/s or m/s]; zeros before the first one."""
        return self._last.velocity

    def slow_down(self, q: ArrayLike, now: float, deceleration: float,
                  elapsed: float | None = None) -> Array:
        """
        Return the next velocity of a ramped stop, as a replacement for `update`.

        All joints slow down by the same factor, so that the robot stays on its path in
        configuration space. The fastest joint has the given deceleration, or more if a position
        limit demands it.

        Parameters
        ----------
        q, now, elapsed
            See `update`.
        deceleration : float
            More than zero [rad/s² or m/s²].

        Returns
        -------
        ndarray (n,)
            Velocity; zero at the end, when `halt` is to be called.

        """
        positions = self.robot.positions(np.asarray(q, dtype=float))
        self._command(now, ramp_down(self._options, self._memory, positions, now, elapsed,
                                     deceleration), elapsed)
        return self.velocity

    @property
    def settings(self) -> Settings:
        """Return the settings; they can be replaced between two cycles."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        self.check_settings(settings)
        if settings != self._settings:
            self._apply(settings)
            self._changes.announce(0)

    def _apply(self, settings: Settings) -> None:
        """Apply validated settings."""
        self._settings = settings
        self._options = CycleOptions(self.robot, settings, self._limits_with_locks,
                                     self._make_solver)
        self._states.set_still(self._options.limits.zero)
        self._last = Commanded(self._memory.fit(self._options))
        self.stack.limit_time(settings.task_budget * settings.period)
        self._tasks.switches_off = settings.task_faults != STOP
        self._changes.duration = settings.blend

    def check_settings(self, settings: Settings, stack: Stack | None = None) -> None:
        """
        Check whether settings fit the robot and a stack, the one in force by default.

        Raises
        ------
        SettingsError
            The number of weights is not the number of joints, or a gain is too high for the
            period: a bound would be crossed, or an error would grow.

        """
        stack = self.stack if stack is None else check_type(stack)
        faults = setting_faults(settings, self.robot, stack)
        if faults:
            raise SettingsError(faults)

    def gain_warning(self, name: str) -> str:
        """
        Return a warning about a doubtful gain of a task, with a suggested change; mostly empty.

        The gain is compared with the mean time between the last cycles, at first the `period`.

        Raises
        ------
        GoalError
            There is no such task.

        """
        task = self._tasks.task(name)
        doubt = gain_remark(task, task.gain, self._memory.time.mean)
        return f'{doubt.message}: {doubt.change}' if doubt else ''

    def update(self, q: ArrayLike, now: float | None = None, passive: ArrayLike | None = None,
               elapsed: float | None = None) -> Command:
        """
        Return the command at positions `q`.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration: pose of the base, if it moves, then positions of the driven joints
            [rad or m].
        now : float
            [s]
        passive : array_like (p,), optional
            Positions of the passive joints [rad or m]; unchanged if omitted.
        elapsed : float, optional
            Time since the last command, used by acceleration limits, if the clock of the robot
            is not that of `now`, as in a simulation; by default the advance of `now`, in the
            first cycle the `period` [s]. If it is not more than zero, because the clock stands
            still or was set back, the time between commands is assumed to equal that at the last
            advance of the clock, at first the `period`.

        Returns
        -------
        Command

        Raises
        ------
        RobotError
            `q` or `passive` has the wrong shape, is not finite, or its quaternion has zero norm.
        TimeError
            `now` or `elapsed` is not a finite number.
        EvaluationError
            A task fails, and the setting `task_faults` is ``stop``.
        SolverError
            The stack has no finite solution.

        """
        now, elapsed = check_times(now, elapsed)
        tasks, changes, solved = self._tasks, self._changes, None
        self._runs = True
        if tasks.references:
            tasks.follow(now, self._settings.period)
        last = self._last if changes.shared is None \
            else changes.continued(self._last, tasks.stack.active)
        if last is not None:
            if not tasks.started:
                tasks.start(self._states.update(q, passive, self.velocity))
            solved = self._core.solve(self._options, tasks, last, q, now, passive, elapsed)
        self._last = found = solved or self._step(q, now, passive, elapsed)
        if changes.shared is not None:
            changes.clear()
        stack = tasks.stack
        progress = tasks.progress(now) if tasks.references else NO_TRAJECTORIES
        # `Command(…)` calls a function of Python that does the same.
        return tuple.__new__(Command, (found.velocity, Report(
            self.robot, stack.inactive, stack.faults, found, progress)))

    def _step(self, q: ArrayLike, now: float, passive: ArrayLike | None,
              elapsed: float | None) -> Solved:
        """Return the cycle that `step` computes."""
        tasks, changes = self._tasks, self._changes
        # Of the last command; nothing is blended in at rest.
        moving = changes.shared is not None and self._settings.blend > 0.0 and self.velocity.any()
        before = self._states.present if moving else None
        state = self._states.update(q, passive, self.velocity)
        if not tasks.started:
            tasks.start(state)
        # Evaluate the states in the order of time.
        snapshot = None if before is None else self._snapshot(before, now)
        evaluations, stack = tasks.evaluate(state, now), tasks.stack
        memory = self._memory.for_groups(changes.groups, stack.active)
        problem = Problem(self._options, levels_of(evaluations), state.positions, now, elapsed,
                          changes.shared, snapshot)
        try:
            cycle, outcome, memory = step(problem, memory)
        except Exception:
            # Name the task with faulty levels, if it is a single one.
            stack.check(evaluations, self.robot.n)
            raise
        place = Place(state.q, self._states.passive, now, self._states.spare)
        return Solved.after(evaluations, cycle, outcome, memory, place, self._options)

    @property
    def _memory(self) -> CycleMemory:
        """Return the memory for the next cycle."""
        return self._last.memory

    def _command(self, now: float | None, velocity: Array, elapsed: float | None = None) -> None:
        """Command a velocity (n,) without tasks; motion that follows is blended in."""
        now = check_time(now, 'now', TimeError)
        self._last = Commanded(self._memory.after_command(velocity, now, self._options, elapsed))
        self._end_motion()
        self._changes.announce(0)

    def _snapshot(self, state: RobotState, now: float) -> Snapshot:
        """Return the demand of the tasks at the state of the last command."""
        evaluations = self._tasks.evaluate(state, now)
        memory = self._memory.for_groups(self._changes.groups, self.stack.active)
        return Snapshot(levels_of(evaluations), state.positions, memory.damping)

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

"""The controller: joint positions in, joint velocities and a report out."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.causes import Place, TRANSITION
from tp_controller.control.cycle import Cycle, Outcome
from tp_controller.control.cycle_time import check_time, CycleTime
from tp_controller.control.escape import Escape
from tp_controller.control.gains import gain_faults, gain_remark, set_gain, set_tolerance
from tp_controller.control.goal_limits import check_goal
from tp_controller.control.report import Report
from tp_controller.control.settings import Settings, STOP
from tp_controller.control.transition import kept_above, Transition
from tp_controller.control.velocity_limits import lowered, VelocityBounds, VelocityLimits
from tp_controller.errors import (
    EvaluationError,
    GoalError,
    RobotError,
    SettingsError,
    TimeError,
    unknown,
)
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, inverse_pose
from tp_controller.model.state import RobotState
from tp_controller.solver.damping import Memory
from tp_controller.solver.level import Level
from tp_controller.tasks.keys import Gain, Tolerance
from tp_controller.tasks.pose import parse_pose
from tp_controller.tasks.stack import check_type, Groups, levels_of, shared_levels, Stack
from tp_controller.tasks.task import Evaluation, Goal, Task
from tp_controller.tasks.task_errors import accept

# A command is in force for at most this multiple of the mean time between two, or a period.
LATE = 2.0


class Command(NamedTuple):
    """
    What one cycle gives.

    Attributes
    ----------
    velocity : ndarray (n,)
        Velocities of the base, if it moves, and the driven joints [rad/s or m/s], within every
        limit; see `Robot.velocity_names`.
    report : Report

    """

    velocity: Array
    report: Report


class Controller:
    """
    Carries out a stack of tasks on a robot, one `update` a cycle.

    Its tasks remember goals and cycles, so they belong to this controller from now on.

    Time is whatever clock the caller has, in seconds; without it (`now`) calls are refused. It
    should not stand still nor be set back, but nothing is lost if it does; see `update`.

    Parameters
    ----------
    robot : Robot
    stack : Stack
    settings : Settings, optional

    Raises
    ------
    RobotError
        `robot` is none.
    SettingsError
        The settings do not fit the robot or the stack; see `check_settings`.
    StackError
        `stack` is none, or another controller has used tasks of it; see `Stack.copy`.

    """

    def __init__(self, robot: Robot, stack: Stack, settings: Settings | None = None) -> None:
        if not isinstance(robot, Robot):
            raise RobotError('a controller needs a Robot, such as Robot.from_urdf(file), and then '
                             f'a Stack, got {type(robot).__name__}')
        check_type(stack)
        self.robot = robot
        self.stack = stack
        # Mark of the stack in force; another one with each stack.
        self._owner = object()
        stack.check_owner(self._owner)
        # None before the first update.
        self._state: RobotState | None = None
        # Of this cycle and of the one before, in turns, and one for reports. To make one takes
        # Pinocchio 8 ms for TIAGo and 44 ms with two arms: too long for a cycle.
        *self._states, self._spare = [robot.state(robot.neutral()) for _ in range(3)]
        self._passive: ArrayLike | None = None
        self._started = False
        # What was commanded last, and when; at rest before the first command. Of commands that
        # are under way the last one comes first.
        self._velocity = np.zeros(robot.n)
        self._velocity_limits = robot.velocity
        self._pending = np.zeros((0, robot.n))
        self._last_update: float | None = None
        self._memory: Memory = ()
        self._transition = Transition(0.0)
        self._escape = Escape(robot.n)
        self._settings = settings = settings or Settings()
        self.check_settings(settings)
        self._time = CycleTime(settings.period)
        self._use(settings)
        stack.set_owner(self._owner)

    def replace_stack(self, stack: Stack, settings: Settings | None = None) -> None:
        """
        Carry out another stack from the next cycle on.

        Tasks of the same name, type and frame or joints keep their goals, and the velocities in
        force. The change does not disturb the upper levels whose tasks are the same in both
        stacks, with the same keys and goals.

        Parameters
        ----------
        stack : Stack
            To be carried out.
        settings : Settings, optional
            That go with it; those in force by default.

        Raises
        ------
        SettingsError
            The settings do not fit it; what was in force before stays in force.
        StackError
            Tasks belong to another controller, or to a stack that was replaced before; see
            `Stack.copy`. What was in force before stays in force.
        EvaluationError
            A task fails when it gets its goal; what was in force before stays in force.

        """
        settings = settings or self._settings
        self.check_settings(settings, stack)
        stack.check_owner(self._owner)
        before = self.stack.active
        stack.inherit_goals(self.stack)
        self._owner = object()
        stack.set_owner(self._owner)
        stack.limit_time(settings.task_budget * settings.period)
        self.stack = stack
        self._started = False
        self._announce_stack(before)
        self.settings = settings

    def restart(self) -> None:
        """
        Give tasks without a goal, in the next cycle, the value they have then as goal.

        Raises
        ------
        EvaluationError
            A task fails; the others forget their default goals all the same.

        """
        changed = [any(task.has_default_goal for task in group) for group in self.stack.active]
        if any(changed):
            self._transition.announce(changed.index(True))
        self._started = False
        self.stack.reset()

    def forget_goals(self) -> None:
        """
        Give all tasks, in the next cycle, the value they have then as goal; bounds stay.

        Raises
        ------
        EvaluationError
            A task fails; the others forget their goals all the same.

        """
        self._transition.announce(0)
        self._started = False
        self.stack.forget_goals()

    def halt(self, now: float | None = None) -> None:
        """
        Say that no motion is commanded now, whatever the last update returned.

        Raises
        ------
        TimeError
            `now` is not a finite number; then nothing is taken for halted.

        """
        self._rest(now, np.zeros(self.robot.n))

    @property
    def velocity(self) -> Array:
        """Return what was commanded last (n,) [rad/s or m/s]; zeros before the first command."""
        return self._velocity

    def slow_down(self, q: ArrayLike, now: float, deceleration: float,
                  elapsed: float | None = None) -> Array:
        """
        Return the next velocity of a ramped stop, in place of `update`.

        All joints slow down by the same factor, so that the robot stays on its path through the
        configurations. The fastest one has the deceleration, or more where a position limit
        demands it.

        Parameters
        ----------
        q, now, elapsed
            See `update`.
        deceleration : float
            More than zero [rad/s² or m/s²].

        Returns
        -------
        ndarray (n,)
            Zero at the end; call `halt` then.

        """
        before, last = self._velocity, self._last_update
        if elapsed is None:
            elapsed = now - last if last is not None else 0.0
        passed = min(max(elapsed, 0.0), 1.0) or self._settings.period
        fastest = float(np.abs(before).max(initial=0.0))
        left = fastest - deceleration * passed
        factor = 0.0
        if left > 0.0:
            positions = self.robot.positions(np.asarray(q, dtype=float))
            upper, lower = self._bounds(positions, passed).stopping
            moving = before != 0.0
            shares = np.where(before > 0.0, upper, lower)[moving] / np.abs(before[moving])
            factor = min(left / fastest, float(shares.min()))
        self._rest(now, factor * before)
        return self._velocity

    @property
    def settings(self) -> Settings:
        """Return the settings; they can be replaced between two cycles."""
        return self._settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        self.check_settings(settings)
        if settings != self._settings:
            self._use(settings)
            self._transition.announce(0)

    def _use(self, settings: Settings) -> None:
        """Act by settings that were checked."""
        self._settings = settings
        self._limits = VelocityLimits(self.robot, settings.period, settings.braking_gain,
                                      self._velocity_limits)
        known = self._pending[:settings.command_delay]
        rest = np.zeros((settings.command_delay - len(known), self.robot.n))
        self._pending = np.vstack((known, rest))
        self._speed_cap = settings.speed_cap(self.robot, self._velocity_limits)
        self._options = settings.solver_options(self.robot.n)
        self._time.expect(settings.period)
        self.stack.limit_time(settings.task_budget * settings.period)
        self._transition.duration = settings.blend

    def check_settings(self, settings: Settings, stack: Stack | None = None) -> None:
        """
        Check whether settings fit the robot and a stack, the one in force by default.

        Raises
        ------
        SettingsError
            There is not one weight for each joint, or a gain is too high for the period: a bound
            would be crossed, or an error would grow.

        """
        stack = self.stack if stack is None else check_type(stack)
        if not isinstance(settings, Settings):
            raise SettingsError([f'settings must be made by Settings(…), got {settings!r}'])
        faults = []
        weights = settings.weights
        if weights and len(weights) != self.robot.n:
            faults.append(f'weights needs {self.robot.n} numbers, one for each of '
                          f'{", ".join(self.robot.velocity_names)}, got {len(weights)}')
        for task in stack.tasks.values():
            faults += gain_faults(task, task.gain, settings.period)
        if faults:
            raise SettingsError(faults)

    @property
    def velocity_limits(self) -> Array:
        """Return the velocity limits in force (n,) [rad/s or m/s]."""
        return self._velocity_limits.copy()

    def check_velocity_limits(self, limits: Mapping[str, float]) -> None:
        """Raise `SettingsError` if `set_velocity_limits` cannot set such limits."""
        lowered(self.robot, self._velocity_limits, limits)

    def set_velocity_limits(self, limits: Mapping[str, float]) -> None:
        """
        Lower velocity limits from the next cycle on, or raise them again.

        A joint that is faster brakes with its acceleration limit, or at once where it has none.

        Parameters
        ----------
        limits : mapping
            {velocity: limit}, of `Robot.velocity_names` [rad/s or m/s]; others stay.

        Raises
        ------
        SettingsError
            All that are not above 0, or are beyond the limit of the robot; those before stay in
            force.

        """
        found = lowered(self.robot, self._velocity_limits, limits)
        if not np.array_equal(found, self._velocity_limits):
            self._velocity_limits = found
            self._use(self._settings)
            self._transition.announce(0)

    def set_gain(self, name: str, gain: Gain) -> None:
        """
        Give a task another gain from the next cycle on; it is blended in as a setting is.

        Parameters
        ----------
        name : str
            Task.
        gain : float or array_like (rows,)
            One number, or one for each row [1/s].

        Raises
        ------
        GoalError
            There is no such task.
        SettingsError
            It has no gain, or not this one; the gain before stays in force.

        """
        task = self._task(name)
        before = task.gain
        set_gain(task, gain, self._settings.period)
        if np.array_equal(task.gain, before):
            return
        for index, group in enumerate(self.stack.active):
            if task in group:
                self._transition.announce(index)

    def gain_warning(self, name: str) -> str:
        """
        Return what is doubtful about the gain of a task, and what can be changed; mostly empty.

        It is judged by the mean time between the last cycles, at first by the `period`.

        Raises
        ------
        GoalError
            There is no such task.

        """
        task = self._task(name)
        doubt = gain_remark(task, task.gain, self._time.mean)
        return f'{doubt.message}: {doubt.change}' if doubt else ''

    def set_tolerance(self, name: str, tolerance: Tolerance) -> None:
        """
        Give a task other tolerances, which changes its report only.

        Parameters
        ----------
        name : str
            Task.
        tolerance : float or dict
            Error below which the goal counts as reached, or one for each of some units.

        Raises
        ------
        GoalError
            There is no such task.
        SettingsError
            It has no tolerance, or not this one; the tolerances before stay in force.

        """
        set_tolerance(self._task(name), tolerance)

    def set_goal(self, name: str, goal: Goal, now: float | None = None,
                 frame: str | Array | None = None) -> tuple[str, ...]:
        """
        Set the goal of a task.

        Parameters
        ----------
        name : str
            Task.
        goal : array_like or dict
            What the type of the task takes; see `tp_controller.tasks`.
        now : float
            [s]
        frame : str or ndarray (4, 4), optional
            Frame of the robot that the goal is expressed in, where it is now, or the pose
            T_root_frame of a frame that is not on the robot; the task's reference frame by
            default.

        Returns
        -------
        tuple of str
            What is probably a mistake in the goal: it is out of reach, or coordinates are given
            that do not count.

        Raises
        ------
        GoalError
            The task or frame is unknown, the goal is not finite, has the wrong shape or is beyond
            the limits of goals in the settings, or `now` is not a finite number. The goal before
            stays in force.

        """
        now = check_time(now, 'now', GoalError)
        task = self._task(name)
        goal = accept(task, task.parse_goal, goal)
        if frame is not None:
            goal = accept(task, task.goal_in_reference, goal, self._pose_in(task, frame))
        accept(task, check_goal, task, goal, self._state, self._settings)
        own = frame is None or (isinstance(frame, str) and frame == task.reference)
        remarks = accept(task, task.goal_remarks, goal, not own)
        self._announce_goal(task, now)
        accept(task, task.set_goal, goal, now)
        return remarks

    def set_feed_forward(self, name: str, velocity: Any, now: float | None = None,
                         frame: str | Array | None = None) -> None:
        """
        Set the feed-forward velocity of a task, in force until its timeout.

        Parameters
        ----------
        name, now, frame
            See `set_goal`.
        velocity : array_like or dict
            Twist (6,), linear then angular [m/s, rad/s], or joint velocities.

        Raises
        ------
        GoalError
            As `set_goal`.

        """
        now = check_time(now, 'now', GoalError)
        task = self._task(name)
        velocity = accept(task, task.parse_feed_forward, velocity)
        if frame is not None:
            velocity = accept(task, task.feed_forward_in_reference, velocity,
                              self._pose_in(task, frame)[:3, :3])
        self._announce_goal(task, now)
        accept(task, task.set_feed_forward, velocity, now)

    def enable(self, name: str, enabled: bool) -> None:
        """
        Enable or disable a task of the stack.

        A task that is enabled again without a goal keeps the value it has then.

        Raises
        ------
        GoalError
            There is no such task, or `enabled` is neither true nor false.

        """
        task = self._task(name)
        if not isinstance(enabled, (int, np.bool_)) or enabled not in (True, False):
            raise GoalError(f'enabled must be True or False, got {enabled!r}')
        if enabled == (name not in self.stack.disabled):
            return
        before = self.stack.active
        if enabled:
            accept(task, task.reset)
            self._started = False
        self.stack.enable(name, enabled)
        self._announce_stack(before)

    def update(self, q: ArrayLike, now: float | None = None, passive: ArrayLike | None = None,
               elapsed: float | None = None) -> Command:
        """
        Return the command at positions `q`.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration: where the base is, if it moves, then positions of the driven joints
            [rad or m].
        now : float
            [s]
        passive : array_like (p,), optional
            Positions of the passive joints [rad or m]; unchanged where left out.
        elapsed : float, optional
            Time since the last command, which acceleration limits count with, where another
            clock than that of `now` is the robot's, as in a simulation; by default by how much
            `now` has advanced [s]. If that is not more than zero, because the clock stands still
            or was set back, the time between commands is assumed to be what it was when the
            clock advanced last, at first the `period`.

        Returns
        -------
        Command

        Raises
        ------
        RobotError
            `q` or `passive` has the wrong shape, is not finite, or its quaternion is none.
        TimeError
            `now` or `elapsed` is not a finite number.
        EvaluationError
            A task fails, and the setting `task_faults` is ``stop``.
        SolverError
            No finite velocity carries the stack out.

        """
        now = check_time(now, 'now', TimeError)
        if elapsed is not None:
            elapsed = check_time(elapsed, 'elapsed', TimeError)
        before = self._before_change()
        state = self._states[0]
        if passive is None or not self.robot.passive_names:
            passive = self._passive
        state.update(q, passive)
        # Whoever has given the positions may change them later.
        self._passive = None if passive is None else np.array(passive)
        self._states.reverse()
        self._state = state
        state.velocity = self._velocity
        if not self._started:
            self._start(state)
        if self._last_update is None:
            elapsed = self._settings.period
        elif elapsed is None:
            elapsed = now - self._last_update
        elapsed = self._time.advance(elapsed)
        # Tasks see the states in the order of time.
        changed = None if before is None else self._cycle(before, now, elapsed)[1]
        evaluations, cycle = self._cycle(state, now, elapsed)
        try:
            outcome = self._blend(cycle, changed or cycle, elapsed) or self._follow(cycle)
        except Exception:
            # The levels were at fault: name the task, if it is a single one.
            self.stack.check(evaluations, self.robot.n)
            raise
        self._send(outcome.velocity)
        self._last_update = now
        self._memory = outcome.solution.memory
        return Command(outcome.velocity, Report(self.robot, evaluations, self.stack.inactive,
                                                cycle, outcome, self.stack.faults,
                                                Place(state.q, self._passive, now, self._spare)))

    def _rest(self, now: float | None, velocity: Array) -> None:
        """Command a velocity (n,) that no task demands; motion that follows is blended in."""
        self._last_update = check_time(now, 'now', TimeError)
        self._send(velocity)
        self._transition.end()
        self._transition.announce(0)

    def _send(self, velocity: Array) -> None:
        """Note what is commanded now (n,)."""
        self._velocity = velocity
        if len(self._pending):
            self._pending[1:] = self._pending[:-1]
            self._pending[0] = velocity

    def _start(self, state: RobotState) -> None:
        """Give tasks without a goal the value they have now, once."""
        while not self._started:
            try:
                self.stack.start(state)
                self._started = True
            except EvaluationError as error:
                self._switch_off(error)

    def _evaluate(self, state: RobotState, now: float) -> list[list[Evaluation]]:
        """Return what the tasks demand at a state."""
        while True:
            try:
                return self.stack.evaluate(state, now)
            except EvaluationError as error:
                self._switch_off(error)

    def _switch_off(self, error: EvaluationError) -> None:
        """Go on without a task that fails, or raise."""
        if self._settings.task_faults == STOP:
            raise error
        before = self.stack.active
        self.stack.switch_off(error.task, error.reason)
        self._announce_stack(before)

    def _before_change(self) -> RobotState | None:
        """
        Return where the robot was when it was told to move last, if something has changed since.

        What the new stack demands there, and not where the robot has come since, shows what the
        change alone changes.
        """
        if not self._transition.announced or self._state is None or not self._velocity.any():
            return None
        return self._state

    def _cycle(self, state: RobotState, now: float, elapsed: float
               ) -> tuple[list[list[Evaluation]], Cycle]:
        """Return what is to be solved at a state."""
        evaluations = self._evaluate(state, now)
        bounds = self._bounds(state.positions, elapsed)
        return evaluations, Cycle(levels_of(evaluations), bounds, self._options, self._time.mean,
                                  self._speed_cap, self._memory)

    def _bounds(self, positions: Array, elapsed: float) -> VelocityBounds:
        """Return the velocities that the joints may have at positions (n,)."""
        duration = min(self._settings.period, LATE * self._time.mean)
        return self._limits.at(positions, self._velocity, elapsed, self._pending, duration)

    def _follow(self, cycle: Cycle) -> Outcome:
        """Return what carries the stack out."""
        solution = cycle.solve()
        escape = self._escape.levels(solution, self._time.now, cycle.solve)
        if escape is None:
            return Outcome(solution, solution)
        return Outcome(solution, cycle.solve(escape), 'leaving a singularity')

    def _blend(self, cycle: Cycle, changed: Cycle, elapsed: float) -> Outcome | None:
        """
        Return the outcome that blends in a change; None where there is nothing to blend.

        `changed` is what is to be solved where the robot was before the change.
        """
        if self._transition.idle:
            return None
        now = self._time.now
        shared = self._transition.pending()
        if shared is not None:
            self._escape.reset()
        if self._last_update is None or not (shared is not None or self._transition.active(now)):
            return None
        # The end of the transition: acceleration limits only say how fast to get there.
        aim = cycle.aim()
        if shared is not None:
            began = now - min(elapsed, self._settings.period)
            # What is shared is not to fade, even if its goal moves on.
            velocity = changed.aim(kept_above(changed.levels, shared) + [
                Level.of_joints(self._velocity - self._transition.offset(began, shared))]).velocity
            after = aim if changed is cycle else changed.aim()
            self._transition.begin(velocity - after.velocity, began, shared)
        blended = self._transition.levels(cycle.levels, aim.velocity, now)
        if blended is None:
            return None
        return Outcome(aim, cycle.solve(blended), TRANSITION)

    def _announce_stack(self, before: Groups) -> None:
        """Tell the transition that the stack has changed, unless it is the same."""
        after = self.stack.active
        shared = shared_levels(before, after)
        if shared < max(len(before), len(after)):
            self._transition.announce(shared)
            remembered = dict(zip(map(_names, before), self._memory))
            self._memory = tuple([remembered.get(_names(group), 0.0) for group in after])

    def _announce_goal(self, task: Task, now: float) -> None:
        """Tell the transition that a task gets a goal."""
        for index, group in enumerate(self.stack.active):
            if task in group:
                self._transition.announce_goal(task.name, index, now)

    def _task(self, name: str) -> Task:
        """Return a task by name."""
        if not isinstance(name, str) or name not in self.stack.tasks:
            raise GoalError(unknown('task', name, self.stack.tasks))
        return self.stack.tasks[name]

    def configuration(self) -> tuple[Array, ArrayLike | None] | None:
        """
        Return where the robot was in the last update; None before the first one.

        Returns
        -------
        q : ndarray (nq,)
            Configuration [rad or m].
        passive : ndarray (p,) or None
            Positions of the passive joints; None where none were given [rad or m].

        """
        return None if self._state is None else (self._state.q, self._passive)

    def _pose_in(self, task: Task, frame: str | Array) -> Array:
        """Return T_reference_frame (4, 4), as the robot stands now."""
        if task.reference is None:
            raise GoalError(f'a goal of task {task.name!r} is not expressed in a frame: '
                            'leave it out')
        if isinstance(frame, str) and frame not in self.robot.frame_names:
            raise GoalError(unknown('frame', frame, self.robot.frame_names))
        if isinstance(frame, str) and frame == task.reference:
            return np.eye(4)
        if self._state is None:
            raise GoalError('a goal in another frame needs joint positions, '
                            'and none have arrived yet')
        T_root_frame = self._state.pose(frame) if isinstance(frame, str) else parse_pose(
            frame, f'the frame of a goal for task {task.name!r}')
        return inverse_pose(self._state.pose(task.reference)).dot(T_root_frame)


def _names(group: Iterable[Task]) -> tuple[str, ...]:
    """Return the names of the tasks of a level."""
    return tuple([task.name for task in group])

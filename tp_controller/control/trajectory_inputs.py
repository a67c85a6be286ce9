# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Trajectories of the tasks of a controller: timed values, and goals with a speed."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.cycle_time import check_time
from tp_controller.control.goal_limits import check_goal, check_motion
from tp_controller.control.task_inputs import TaskInputs
from tp_controller.errors import GoalError, unknown
from tp_controller.model.spatial import Array
from tp_controller.references.forms import Form, FORMS, joints_form
from tp_controller.references.reference import (
    Chunk,
    chunk_at_speed,
    chunk_of,
    MOST_KNOTS,
    Reference,
)
from tp_controller.resources import is_number
from tp_controller.tasks.center_of_mass import CenterOfMass
from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.joint import JointTask
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import accept

# A speed of a frame [m/s] limits its turns to that of a point at this distance [m].
LEVER = 0.25
# One number, or one for each unit.
Speed: TypeAlias = float | Mapping[str, float]


class TrajectoryInputs(TaskInputs):
    """
    Inputs of the tasks of a controller, with trajectories.

    While a task follows a trajectory, its goal and feed-forward velocity are those of the
    trajectory; the last value stays the goal. A new goal ends it, and so do zeros that are
    commanded in place of a cycle, and disabling the task.
    """

    # Whether cycles run, so that a motion may begin.
    _runs = False

    @property
    @abstractmethod
    def velocity(self) -> Array:
        """Return the last command (n,) [rad/s or m/s]."""

    def set_goal(self, name: str, goal: Goal, now: float | None = None,
                 frame: str | Array | None = None, *, posture: ArrayLike | None = None,
                 speed: Speed | None = None, duration: float | None = None) -> tuple[str, ...]:
        """
        Set the goal of a task.

        Parameters
        ----------
        name : str
            Task.
        goal : array_like or dict
            Goal of the type of the task; see `tp_controller.tasks`.
        now : float
            [s]
        frame : str or ndarray (4, 4), optional
            Frame of the robot, at its present pose, in which the goal is expressed, or the pose
            T_root_frame of a frame that is not on the robot; the task's reference frame by
            default.
        posture : array_like (n,), optional
            Positions of all joints at the goal [rad or m]: all of them move there along a
            straight line, and the task goes on from its end. By default the task moves straight
            to the goal. See `set_goal_by_posture`.
        speed : float or dict, optional
            Largest speed on a straight line to the goal, with a smooth profile, in place of the
            exponential approach: a number [m/s, or rad/s without a position], or {unit: number}.
            A number for a pose limits its turn to that of a point at 0.25 m.
        duration : float, optional
            Time of that motion, in place of its speed [s].

        Returns
        -------
        tuple of str
            Remarks about probable mistakes in the goal: it is out of reach, or it has coordinates
            that do not count.

        Raises
        ------
        GoalError
            The task or frame is unknown, the goal is not finite, has the wrong shape or is beyond
            the limits of goals in the settings, or `now` is not a finite number; or the base
            moves, or the posture is beyond the position limits; or the task has no goal that can
            be reached at a speed. The previous goal stays in force.

        """
        if speed is None and duration is None:
            return self._set_constant_goal(name, goal, now, frame, posture)
        if posture is not None or None not in (speed, duration):
            raise GoalError('a goal has a posture, a speed or a duration, but one of them only')
        now = check_time(now, 'now', GoalError)
        task, parsed = self._tasks.task(name), self.parsed_goal(name, goal, frame)
        form = form_of(task)
        limit = None if speed is None else speeds(speed, task, form)
        if duration is not None and (not is_number(duration) or duration <= 0.0):
            raise GoalError(f'the duration of a goal must be more than 0 s, not {duration!r}')
        accept(task, check_goal, task, parsed, self._states.present, self._settings)
        remarks = accept(task, task.goal_remarks, parsed, not self._is_own(task, frame))
        value = form.flatten(parsed)[np.newaxis]

        def chunk(start: Array) -> Chunk:
            if limit is None:
                return chunk_of(form, np.array([now + float(duration or 0.0)]), value)
            return chunk_at_speed(form, np.concatenate((start[np.newaxis], value)), limit, now)

        self._begin(task, form, chunk, now)
        return remarks

    def set_trajectory(self, name: str, times: ArrayLike | None, values: Sequence[Goal] | Array,
                       now: float | None = None, frame: str | Array | None = None, *,
                       speed: Speed | None = None) -> tuple[str, ...]:
        """
        Let a task follow values with times, along a smooth curve and with its velocity.

        The curve replaces a trajectory that runs from its own first time on, or from now on if
        that is past, without a jump in value, velocity or acceleration. It ends at rest at the
        last value, which stays the goal.

        Parameters
        ----------
        name : str
            Task whose goal is a point, an orientation, a pose or joint positions.
        times : array_like (n,) or None
            Increasing times of the values, on the clock of `now` [s]; None with a `speed`.
        values : sequence of n goals
            Goals of the type of the task, such as poses (n, 7) or joint positions (n, rows).
        now : float
            [s]
        frame : str or ndarray (4, 4), optional
            Frame of the values; see `set_goal`.
        speed : float or dict, optional
            Largest speed on a way through all values from where the task is, in place of times;
            see `set_goal`.

        Returns
        -------
        tuple of str
            Remarks about probable mistakes in the first value that has any.

        Raises
        ------
        GoalError
            As `set_goal`; or there are no values, they are all past, they begin before those that
            run, times do not increase, or the task is disabled or the robot stopped. The previous
            goal or trajectory stays in force.

        """
        now = check_time(now, 'now', GoalError)
        task = self._tasks.task(name)
        form, what = form_of(task), f'the trajectory of task {name!r}'
        count = _count(values, what)
        if (times is None) == (speed is None):
            raise GoalError(f'{what} needs times or a speed, one of them')
        clock = None if times is None else _checked_times(times, count, what)
        limit = None if speed is None else speeds(speed, task, form)
        T = None if frame is None else self._pose_of(task, frame)
        goals: list[Goal] = []
        remarks: tuple[str, ...] = ()
        for index, value in enumerate(values):
            goal = self._parsed(task, value, T, f'{what}, value {index + 1} of {count}')
            remarks = remarks or accept(task, task.goal_remarks, goal,
                                        not self._is_own(task, frame))
            goals.append(goal)
        vectors = np.array([form.flatten(goal) for goal in goals])
        if clock is not None:
            timed = chunk_of(form, clock, vectors)
            self._begin_checked(task, form, goals[0], lambda start: timed, now)
        elif limit is not None:
            allowed = limit
            self._begin_checked(task, form, goals[0], lambda start: chunk_at_speed(
                form, np.concatenate((start[np.newaxis], vectors)), allowed, now), now)
        return remarks

    def cancel_trajectory(self, name: str, now: float | None = None) -> bool:
        """
        Let a task that follows a trajectory come to rest, and stay there.

        Returns
        -------
        bool
            Whether it followed one.

        Raises
        ------
        GoalError
            There is no such task, or `now` is not a finite number.

        """
        now = check_time(now, 'now', GoalError)
        task = self._tasks.task(name)
        reference = self._tasks.reference(task, now)
        if reference is not None:
            self._tasks.set_reference(task, reference.braked(now), now)
        return reference is not None

    def set_feed_forward(self, name: str, velocity: Any, now: float | None = None,
                         frame: str | Array | None = None) -> None:
        """
        Set the feed-forward velocity of a task that follows no trajectory, until its timeout.

        Parameters
        ----------
        name, now, frame
            See `set_goal`.
        velocity : array_like or dict
            Twist (6,), linear then angular [m/s, rad/s], or joint velocities.

        Raises
        ------
        GoalError
            As `set_goal`, and while the task follows a trajectory.

        """
        now = check_time(now, 'now', GoalError)
        task = self._tasks.task(name)
        if self._tasks.reference(task, now) is not None:
            raise GoalError(f'task {name!r} follows a trajectory, with its velocity: cancel it '
                            'first')
        velocity = accept(task, task.parse_feed_forward, velocity)
        if frame is not None:
            velocity = accept(task, task.feed_forward_in_reference, velocity,
                              self._pose_of(task, frame)[:3, :3])
        self._tasks.set_feed_forward(task, velocity, now)

    def _end_motion(self) -> None:
        """End all trajectories: a command without tasks takes the place of a cycle."""
        self._runs = False
        self._tasks.end_references()

    def _parsed(self, task: Task, value: Goal, T: Array | None, what: str) -> Goal:
        """Return a value in internal form, in the reference frame; errors begin with `what`."""
        try:
            goal = accept(task, task.parse_goal, value)
            return goal if T is None else accept(task, task.goal_in_reference, goal, T)
        except GoalError as error:
            raise GoalError(f'{what}: {error}') from error

    def _pose_of(self, task: Task, frame: str | Array) -> Array:
        """Return T_reference_frame (4, 4)."""
        found: Array = accept(task, self._states.pose_in_reference, task, frame)
        return found

    def _begin_checked(self, task: Task, form: Form, first: Goal,
                       chunk: Callable[[Array], Chunk], now: float) -> None:
        """Begin a motion whose first value, and what follows, is within the limits of goals."""
        state, settings = self._states.present, self._settings
        accept(task, check_goal, task, first, state, settings)

        def checked(start: Array) -> Chunk:
            found = chunk(start)
            check_motion(task, form, found.curve, state, settings)
            return found

        self._begin(task, form, checked, now)

    def _begin(self, task: Task, form: Form, chunk: Callable[[Array], Chunk], now: float) -> None:
        """Begin a motion of a task: `chunk` returns it for the value (d,) where it starts."""
        if self._tasks.task(task.name) is not task:
            raise GoalError(f'the stack with task {task.name!r} was replaced meanwhile')
        if task.name in self.stack.disabled:
            raise GoalError(f'task {task.name!r} is disabled: enable it first')
        state = self._states.present
        if not self._runs or state is None or task.goal is None:
            raise GoalError('the robot is stopped: a trajectory begins from a cycle that runs')
        reference = self._tasks.reference(task, now)
        if reference is None:
            value = form.flatten(task.value(state))
            velocity = task.from_rows(task.jacobian(state).dot(self.velocity))
            reference = Reference.braking(form, np.stack((
                value, form.rate(value, velocity), np.zeros(form.size))), now)
        try:
            followed = reference.followed_by(chunk(reference.curve.value(now)), now)
        except ValueError as error:
            raise GoalError(f'the trajectory of task {task.name!r}: {error}') from error
        self._tasks.set_reference(task, followed, now)


def form_of(task: Task) -> Form:
    """Return the form of the goals of a task, or raise `GoalError` if it follows none."""
    if task.has_position and not task.bounded and task.feed_forward_type:
        if isinstance(task, JointTask):
            robot = task.robot
            return joints_form(task.units, robot.continuous[
                [robot.joint_index(joint) for joint in task.joints]])
        if isinstance(task, (FrameTask, CenterOfMass)) and task.goal_type in FORMS:
            return FORMS[task.goal_type]
    raise GoalError(f'task {task.name!r} of type {task.type_name} follows no trajectory: it needs '
                    'a goal that is a point, an orientation or a pose of a frame, a point of the '
                    'centre of mass, or positions of joints')


def speeds(speed: Speed, task: Task, form: Form) -> dict[str, float]:
    """Return the largest speed in each unit of a task, or raise `GoalError`."""
    units = list(form.sizes(np.ones((1, form.size)), np.ones((1, form.size))))
    if not isinstance(speed, Mapping):
        lever = LEVER if units == ['m', 'rad'] and not form.units else 1.0
        speed = {unit: speed / lever if unit == 'rad' else speed for unit in units} \
            if is_number(speed) else dict.fromkeys(units, speed)
    for unit, value in speed.items():
        if unit not in units:
            raise GoalError(f'the speed of task {task.name!r}: {unknown("unit", unit, units)}')
        if not is_number(value) or not 0.0 < value < np.inf:
            raise GoalError(f'the speed of task {task.name!r} must be more than 0 {unit}/s, '
                            f'not {value!r}')
    missing = [unit for unit in units if unit not in speed]
    if missing:
        raise GoalError(f'the speed of task {task.name!r} needs a number for '
                        f'{", ".join(missing)}, too')
    return dict(speed)


def _count(values: Any, what: str) -> int:
    """Return the number of values, or raise `GoalError`."""
    if not isinstance(values, (Sequence, np.ndarray)) or isinstance(values, str) \
            or not np.shape(values[:1]):
        raise GoalError(f'{what} needs a sequence of goals, got {type(values).__name__}')
    if not len(values):
        raise GoalError(f'{what} is empty; to end one that runs, cancel it')
    if len(values) > MOST_KNOTS:
        raise GoalError(f'{what} has {len(values)} values; at most {MOST_KNOTS} are possible')
    return len(values)


def _checked_times(times: ArrayLike, count: int, what: str) -> Array:
    """Return the times of values (n,) [s], or raise `GoalError`."""
    try:
        found = np.asarray(times, dtype=float)
    except (TypeError, ValueError) as error:
        raise GoalError(f'{what}: times must be numbers [s], got {times!r}') from error
    if found.shape != (count,):
        raise GoalError(f'{what} needs a time for each of its {count} values, got an array of '
                        f'shape {found.shape}')
    if not np.isfinite(found).all():
        raise GoalError(f'{what}: times must be finite')
    late = np.flatnonzero(np.diff(found) <= 0.0)
    if len(late):
        index = int(late[0])
        earlier = found[index] - found[index + 1]
        raise GoalError(f'{what}: times must increase, but value {index + 2} of {count} is '
                        + (f'{earlier:.3g} s before' if earlier else 'at the same time as')
                        + f' value {index + 1}')
    return found

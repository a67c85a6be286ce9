# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of trajectory messages to values with times."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Quaternion, Vector3
from nav_msgs.msg import Path
from tp_controller.control.trajectory_inputs import form_of, Speed
from tp_controller.errors import GoalError
from tp_controller.ros import Message
from tp_controller.tasks.task import Task
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

# Longest time ahead of a trajectory [s]: stamps of another clock are beyond it.
MOST_AHEAD = 3600.0


class Timed(NamedTuple):
    """
    Content of a trajectory message.

    Attributes
    ----------
    values : list
        Goals of the task.
    start : float
        Stamp of the start; 0 for the receipt of the message [s].
    times : list of float or None
        Times from the start [s]; None for a way at a speed.
    speed : float, dict or None
        The speed; see `Controller.set_trajectory`.
    frame : str
        Frame of the values; empty for the reference of the task.

    """

    values: list[Any]
    start: float
    times: list[float] | None
    speed: Speed | None
    frame: str

    def due(self, now: float, stamp: float) -> list[float] | None:
        """
        Return the times on the clock of the controller [s]; None for a way at a speed.

        Parameters
        ----------
        now, stamp : float
            The same time on the clock of the controller, and on that of the stamps [s].

        """
        if self.times is None:
            return None
        start = now + (self.start - stamp if self.start else 0.0)
        times = [start + time for time in self.times]
        if times and abs(times[0] - now) > MOST_AHEAD:
            raise GoalError(f'the trajectory begins {times[0] - now:.3g} s from now: its stamps '
                            'are of another clock')
        return times


@dataclass(frozen=True)
class TrajectoryMessage:
    """
    Message type and topic of trajectories.

    Attributes
    ----------
    kind : type
        Message type.
    topic : str
        Last part of the topic, after the name of the task.
    timed : callable
        Returns the `Timed` content of a message, for a type of goals.

    """

    kind: type
    topic: str
    timed: Callable[[Message, str], Timed]


def seconds(time: Time | Duration) -> float:
    """Return a time or duration of ROS in seconds."""
    return float(time.sec + 1e-9 * time.nanosec)


def _goal(place: Point | Vector3, turn: Quaternion, kind: str) -> tuple[float, ...]:
    """Return a goal of a type: a point, a quaternion or both."""
    point, quaternion = (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
    return {'point': point, 'quaternion': quaternion}.get(kind, (*point, *quaternion))


def _path(message: Path, kind: str) -> Timed:
    """Return poses with stamps; without a stamp of the whole they are times from the start."""
    frames = {pose.header.frame_id for pose in message.poses} - {'', message.header.frame_id}
    if frames:
        raise GoalError('all poses of a path have to be in the frame of its header, not in '
                        f'{", ".join(sorted(frames))}')
    times = [seconds(pose.header.stamp) for pose in message.poses]
    if len(times) > 1 and not any(times):
        raise GoalError('the poses of a path need stamps; for a way at a speed send a '
                        'MultiDOFJointTrajectory with velocities')
    start = times[0] if times and seconds(message.header.stamp) else 0.0
    return Timed([_goal(pose.pose.position, pose.pose.orientation, kind)
                  for pose in message.poses], start, [time - start for time in times], None,
                 message.header.frame_id)


def _frames(message: MultiDOFJointTrajectory, kind: str) -> Timed:
    """Return the transforms of the points, one of each."""
    for index, point in enumerate(message.points):
        if len(point.transforms) != 1:
            raise GoalError(f'point {index + 1} needs one transform, that of the frame, got '
                            f'{len(point.transforms)}')
    twists = [twist for point in message.points for twist in point.velocities]
    linear, angular = (max((math.hypot(part.x, part.y, part.z) for part in parts), default=0.0)
                       for parts in ([twist.linear for twist in twists],
                                     [twist.angular for twist in twists]))
    speed: Speed = {'m': linear, 'rad': angular} if linear and angular else linear or angular
    return _timed(message, [_goal(point.transforms[0].translation, point.transforms[0].rotation,
                                  kind) for point in message.points], speed)


def _joints(message: JointTrajectory, _: str) -> Timed:
    """Return the positions of the points, by joint."""
    names = message.joint_names
    if len(set(names)) < len(names):
        raise GoalError(f'a joint is named twice: {", ".join(names)}')
    for index, point in enumerate(message.points):
        if names and len(point.positions) != len(names):
            raise GoalError(f'point {index + 1} has {len(point.positions)} positions for '
                            f'{len(names)} joints')
    speed = max((abs(value) for point in message.points for value in point.velocities),
                default=0.0)
    return _timed(message, [dict(zip(names, point.positions)) if names else list(point.positions)
                            for point in message.points], speed, framed=False)


def _timed(message: JointTrajectory | MultiDOFJointTrajectory, values: list[Any], speed: Speed,
           framed: bool = True) -> Timed:
    """Return values with times from the start; without times, they are a way at a speed."""
    times: Sequence[float] = [seconds(point.time_from_start) for point in message.points]
    untimed = bool(speed) and not any(times)
    if len(times) > 1 and not any(times) and not speed:
        raise GoalError('the points need times from the start, or velocities for a way at a speed')
    return Timed(values, seconds(message.header.stamp), None if untimed else list(times),
                 speed if untimed else None, message.header.frame_id if framed else '')


FRAMES = (TrajectoryMessage(MultiDOFJointTrajectory, 'trajectory', _frames),
          TrajectoryMessage(Path, 'path', _path))
JOINTS = (TrajectoryMessage(JointTrajectory, 'trajectory', _joints),)


def trajectories_of(task: Task) -> Sequence[TrajectoryMessage]:
    """Return the trajectory messages that a task accepts, one for each topic."""
    try:
        form = form_of(task)
    except GoalError:
        return ()
    return JOINTS if form.units else FRAMES

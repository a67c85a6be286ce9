# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Trajectory messages made from the fields of their goals."""

from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Transform, Twist
from tp_controller.errors import GoalError
from tp_controller.ros import Message
from tp_controller.ros.client.goal_fields import Fields, fill, make_message, type_name
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

# Trajectory messages, by the name of their type in the graph.
TRAJECTORY_TYPES: dict[str, type] = {
    type_name(kind): kind for kind in (JointTrajectory, MultiDOFJointTrajectory)}
NANOSECONDS = 1_000_000_000


def make_trajectory(task: str, kinds: Mapping[str, type], values: Sequence[Fields],
                    times: Sequence[float] | None, speed: float,
                    names: Mapping[str, str] | None = None) -> Message:
    """
    Return a trajectory message.

    Parameters
    ----------
    task : str
        Name for error messages.
    kinds : dict
        {topic: message type} of the task, with ``goal`` and ``trajectory``.
    values : sequence of dict
        Fields of each goal; see `client.Client.send`.
    times : sequence of float or None
        Times from the start [s]; None for a way at a speed.
    speed : float
        The speed, without times [m/s or rad/s].
    names : dict, optional
        See `client.Client`.

    Raises
    ------
    GoalError
        Fields do not match the goals of the task.

    """
    for value in values:
        # The same fields are missing as in a goal.
        make_message(task, kinds['goal'], value, names)
    joints = kinds['trajectory'] is JointTrajectory
    points = [_joints(value) if joints else _frame(value) for value in values]
    for point, value, time in zip(points, values, times or [0.0] * len(points)):
        point.time_from_start = _duration(time)
        if times is None:
            point.velocities = [speed] * len(point.positions) if joints else [
                _twist(speed, 'xyz' in value)]
    if not joints:
        return MultiDOFJointTrajectory(points=points)
    used = list(values[0]['joints'])
    if any(list(value['joints']) != used for value in values):
        raise GoalError('all positions of a trajectory need the same joints, in the same order')
    return JointTrajectory(joint_names=used, points=points)


def _joints(value: Fields) -> JointTrajectoryPoint:
    """Return a point of positions."""
    if 'joints' not in value or 'velocities' in value:
        raise GoalError('a trajectory of joints has positions alone')
    return JointTrajectoryPoint(positions=[float(each) for each in value['joints'].values()])


def _frame(value: Fields) -> MultiDOFJointTrajectoryPoint:
    """Return a point with one transform."""
    transform = Transform()
    for part, field in ((transform.translation, 'xyz'), (transform.rotation, 'quat_xyzw')):
        if field in value:
            fill(part, value[field])
    return MultiDOFJointTrajectoryPoint(transforms=[transform])


def _twist(speed: float, linear: bool) -> Twist:
    """Return a linear or angular velocity of a speed."""
    twist = Twist()
    (twist.linear if linear else twist.angular).x = speed
    return twist


def _duration(seconds: float) -> Duration:
    """Return a time from the start."""
    whole, rest = divmod(round(seconds * NANOSECONDS), NANOSECONDS)
    return Duration(sec=whole, nanosec=rest)

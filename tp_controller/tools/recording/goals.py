# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Outcomes of the goals of tasks: accepted, refused, reached, replaced."""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from tp_controller.model.spatial import rotation_from_quaternion
from tp_controller.ros.client.status import TaskStatus
from tp_controller.untrusted.texts import plain

# Goals at shorter intervals belong to one stream [s].
STREAM_INTERVAL = 0.2
# Largest number of listed goals; more are counted.
MOST_GOALS = 500
# Components of a twist up to this count as zero [m/s, rad/s].
ZERO_TWIST = 1e-12


@dataclass
class Goal:
    """
    Goal of a task, or stream of goals.

    Attributes
    ----------
    time, last : float
        Time of the goal, or of the first and the last one of a stream [s].
    task, text, frame : str
        Task, content and frame.
    count : int
        Number of messages.
    answer : str
        ``'accepted'``, or the reason of a refusal; empty while it is unknown.
    reached : float
        Time at which the task first reached it [s]; infinite if never.
    point : tuple of float or None
        Position of the goal [m].

    """

    time: float
    last: float
    task: str
    text: str
    frame: str = ''
    count: int = 1
    answer: str = ''
    reached: float = math.inf
    point: tuple[float, float, float] | None = None

    @property
    def accepted(self) -> bool:
        """Return whether the task has accepted the goal."""
        return self.answer == 'accepted'


class Goals:
    """
    Goals of the tasks of one controller, with their outcomes.

    Attributes
    ----------
    goals : list of Goal
        Goals in order of time.
    more : int
        Number of goals that are not listed.

    """

    def __init__(self) -> None:
        self.goals: list[Goal] = []
        self.more = 0
        self._latest: dict[str, Goal] = {}
        # Unanswered goals by task, and counts of the last status.
        self._open: dict[str, list[Goal]] = {}
        self._counts: dict[str, tuple[int, int]] = {}

    def add_message(self, time: float, task: str, kind: str, message: Any) -> None:
        """Process the message of a goal, or of a velocity."""
        latest = self._latest.get(task)
        if latest is not None and time - latest.last < STREAM_INTERVAL \
                and not latest.text.startswith('('):
            latest.last, latest.count = time, latest.count + 1
            latest.text, latest.point = plain(TEXTS[kind](message)), _point(message)
            waiting = self._open.setdefault(task, [])
            if not waiting or waiting[-1] is not latest:
                waiting.append(latest)
            return
        self._add(Goal(time, time, task, plain(TEXTS[kind](message)), plain(_frame(message)),
                       point=_point(message)))

    def add_status(self, time: float, status: TaskStatus) -> None:
        """Update the outcomes from the status of a task."""
        task, counts = status.name, status.answers
        before = self._counts.get(task)
        self._counts[task] = counts
        waiting = self._open.get(task, [])
        # The first status includes goals before the recording.
        accepted, refused = (now - then for now, then in zip(counts, before or counts))
        if accepted < 0 or refused < 0:
            # The controller was restarted.
            accepted, refused = counts
        if accepted + refused and not waiting:
            self._add(Goal(time, time, task, '(the message was not recorded)'))
            waiting = self._open[task]
        if accepted + refused:
            answer = 'accepted' if not refused else f'refused: {status.refusal}' \
                if not accepted else f'{refused} of {accepted + refused} refused: {status.refusal}'
            for goal in waiting:
                goal.answer = answer
            self._open[task] = []
        latest = self._latest.get(task)
        if status.status == 'reached' and latest is not None and latest.accepted \
                and not self._open.get(task):
            latest.reached = min(latest.reached, time)

    def _add(self, goal: Goal) -> None:
        """Add a goal."""
        self._open.setdefault(goal.task, []).append(goal)
        self._latest[goal.task] = goal
        if len(self.goals) < MOST_GOALS:
            self.goals.append(goal)
        else:
            self.more += 1


def outcome(goal: Goal, following: Goal | None, end: float) -> str:
    """
    Return the outcome of a goal as text.

    Parameters
    ----------
    goal : Goal
        The goal.
    following : Goal or None
        Next goal of the same task.
    end : float
        End of the recording [s].

    """
    if not goal.accepted:
        return goal.answer or 'no answer was recorded'
    if math.isfinite(goal.reached):
        return f'reached after {max(goal.reached - goal.last, 0.0):.1f} s'
    if following is not None:
        return f'replaced after {following.time - goal.last:.1f} s, before it was reached'
    return f'not reached within {end - goal.last:.1f} s'


def _frame(message: Any) -> str:
    """Return the frame of a message; empty if it has none."""
    header = getattr(message, 'header', None)
    return '' if header is None else str(header.frame_id)


def _point(message: Any) -> tuple[float, float, float] | None:
    """Return the position of a message; None if it has none."""
    point = getattr(message, 'point', None) or getattr(
        getattr(message, 'pose', None), 'position', None)
    return None if point is None else (point.x, point.y, point.z)


def _numbers(*values: float) -> str:
    """Return numbers as text."""
    # Adding 0.0 removes the sign of zero.
    return ' '.join(f'{round(value, 9) + 0.0:.4g}' for value in values)


def _vector(value: Any) -> str:
    """Return the text of a vector with x, y and z."""
    return _numbers(value.x, value.y, value.z)


def _turn(value: Any) -> str:
    """Return the text of a quaternion: roll, pitch and yaw in degrees."""
    quaternion = np.array([value.x, value.y, value.z, value.w])
    norm = float(np.linalg.norm(quaternion))
    if not norm > 0.0:
        return f'quaternion {_numbers(*quaternion)}'
    R = rotation_from_quaternion(quaternion / norm)
    angles = (math.atan2(R[2, 1], R[2, 2]), math.asin(min(max(-R[2, 0], -1.0), 1.0)),
              math.atan2(R[1, 0], R[0, 0]))
    return f'rpy {_numbers(*np.degrees(angles))}°'


def _joints(message: Any) -> str:
    """Return the text of positions or velocities of joints."""
    positions = [f'{name} {value:.4g}' for name, value in zip(message.name, message.position)]
    velocities = [f'{name} {value:.4g}/s' for name, value in zip(message.name, message.velocity)]
    return ', '.join(positions + velocities)


def _twist(message: Any) -> str:
    """Return the text of a twist, without zero parts."""
    parts = {'linear': message.twist.linear, 'angular': message.twist.angular}
    return ', '.join(f'{name} {_vector(value)}' for name, value in parts.items()
                     if max(abs(value.x), abs(value.y), abs(value.z)) > ZERO_TWIST) or 'zero'


TEXTS: dict[str, Callable[[Any], str]] = {
    'geometry_msgs/msg/PointStamped': lambda message: f'xyz {_vector(message.point)}',
    'geometry_msgs/msg/Vector3Stamped': lambda message: f'xyz {_vector(message.vector)}',
    'geometry_msgs/msg/QuaternionStamped': lambda message: _turn(message.quaternion),
    'geometry_msgs/msg/PoseStamped': lambda message: (
        f'xyz {_vector(message.pose.position)}, {_turn(message.pose.orientation)}'),
    'sensor_msgs/msg/JointState': _joints,
    'geometry_msgs/msg/TwistStamped': _twist,
    'visualization_msgs/msg/MarkerArray': lambda message: (
        f'{len(message.markers)} obstacles' if len(message.markers) != 1 else '1 obstacle'),
}

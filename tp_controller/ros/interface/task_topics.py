# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Topics and service of each task of a stack."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from functools import partial
import math

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger
from tp_controller.control.controller import Controller
from tp_controller.errors import GoalError, in_words
from tp_controller.positions.approach import set_goal_by_posture
from tp_controller.ros import Message
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.interface.goal_messages import GoalMessage, messages_of, Parts
from tp_controller.ros.interface.tf_frames import TfFrames
from tp_controller.ros.interface.trajectory_messages import trajectories_of, TrajectoryMessage
from tp_controller.ros.log import Log
from tp_controller.ros.rclpy_internals import RCLError
from tp_controller.tasks.frame import BY_POSTURE
from tp_controller.tasks.obstacle_goals import ALL_OBSTACLES
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import accept

# Service that ends a trajectory.
CANCEL = 'trajectory/cancel'
# Period of retries to open a topic [s], and number of failures that is logged.
REOPEN_PERIOD = 0.02
LOGGED_FAILURES = 100


@dataclass
class GoalRecord:
    """
    Goals received for a task.

    Attributes
    ----------
    accepted, refused : int
        Numbers of goals.
    refusal : str
        Reason of the last refusal.
    warning : str
        Probable mistake in the last accepted goal.
    listeners : dict
        {topic: number of its subscriptions, including this one}, at the last count.

    """

    accepted: int = 0
    refused: int = 0
    refusal: str = ''
    warning: str = ''
    listeners: dict[str, int] = field(default_factory=dict)


class TaskTopics:
    """
    Subscriptions to goals and feed-forward velocities of the tasks of a controller.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to, below ``~/<task>/``.
    controller : Controller
        Controller that the goals are passed to.
    clock : callable
        Returns the time of receipt [s].
    log : Log

    Attributes
    ----------
    records : dict
        {task: GoalRecord}, in order of priority.
    changed : float
        Time of the last accepted message [s].

    """

    def __init__(self, node: Node, controller: Controller,
                 clock: Callable[[], float], log: Log) -> None:
        self._node, self._controller, self._clock = node, controller, clock
        self._log = log
        self._frames = TfFrames(node, controller.robot.root)
        # {(task, topic): (type, function that closes it)}
        self._open: dict[tuple[str, str], tuple[type, Callable[[], object]]] = {}
        self._needed: dict[tuple[str, str], type] = {}
        self._again = node.create_timer(REOPEN_PERIOD, self._open_missing,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._again.cancel()
        self.records: dict[str, GoalRecord] = {}
        self.changed = -math.inf

    def follow_stack(self) -> None:
        """Open the topics of the tasks of the stack, and close all others."""
        self.records = {name: self.records.get(name, GoalRecord())
                        for name in self._controller.stack.tasks}
        self._needed = {}
        for name, task in self._controller.stack.tasks.items():
            self._needed[name, 'enable'] = SetBool
            if trajectories_of(task):
                self._needed[name, CANCEL] = Trigger
            for entry in _entries_of(task):
                self._needed[name, entry.topic] = entry.kind
        closed = [key for key, (kind, _) in self._open.items()
                  if self._needed.get(key) is not kind]
        for key in closed:
            _, close = self._open.pop(key)
            close()
        self._refusals = 0
        # A topic cannot change its type before the executor has dropped the closed one.
        self._open_missing(later=closed)

    def take(self, name: str, topic: str, message: Message) -> None:
        """
        Pass on a goal or a feed-forward velocity, or log its refusal.

        Parameters
        ----------
        name, topic : str
            The task, and the last part of the topic of the message.
        message : Message
            Of the type in `messages_of` or `trajectories_of` for that topic; other types are
            ignored.

        """
        kind, _ = self._open.get((name, topic), (None, None))
        if kind is not type(message):
            # The message was sent before the stack changed.
            return
        task = self._controller.stack.tasks[name]
        entry, = (entry for entry in _entries_of(task) if entry.topic == topic)
        record = self.records[name]
        try:
            self._warn(name, self._hand_on(name, entry, message))
            record.accepted += 1
            self.changed = self._clock()
        except Exception as error:
            record.refused += 1
            record.refusal = in_words(error)
            self._log.error(f'goal for task {name} refused: {record.refusal}', f'refused {name}')

    def count_listeners(self) -> None:
        """Count the subscribers of each topic of a task, for senders that wait for all of them."""
        for record in self.records.values():
            record.listeners = {}
        for (name, topic), (kind, _) in self._open.items():
            if kind not in (SetBool, Trigger) and name in self.records:
                self.records[name].listeners[topic] = self._node.count_subscribers(
                    f'{self._node.get_fully_qualified_name()}/{name}/{topic}')

    def close(self) -> None:
        """Close all topics."""
        self._needed = {}
        self._node.destroy_timer(self._again)
        for _, close in self._open.values():
            close()
        self._open = {}

    def _open_missing(self, later: Collection[tuple[str, str]] = ()) -> None:
        """Open the missing topics; retry soon after a failure."""
        for key, kind in self._needed.items():
            if key not in self._open and key not in later:
                try:
                    self._open[key] = kind, self._make(*key, kind)
                except RCLError as error:
                    self._refusals += 1
                    if self._refusals == LOGGED_FAILURES:
                        self._log.error(f'cannot open ~/{"/".join(key)}: {error}')
        if len(self._open) < len(self._needed):
            self._again.reset()
        else:
            self._again.cancel()

    def _make(self, name: str, topic: str, kind: type) -> Callable[[], object]:
        """Open a topic or service; return the function that closes it."""
        if kind is SetBool:
            service = self._node.create_service(kind, f'~/{name}/{topic}',
                                                partial(self._on_enable, name))
            return partial(self._node.destroy_service, service)
        if kind is Trigger:
            service = self._node.create_service(kind, f'~/{name}/{topic}',
                                                partial(self._on_cancel, name))
            return partial(self._node.destroy_service, service)
        return AdaptiveSubscription(self._node, kind, f'~/{name}/{topic}',
                                    partial(self.take, name, topic)).close

    def _on_enable(self, name: str, request: SetBool.Request,
                   response: SetBool.Response) -> SetBool.Response:
        """Enable or disable a task."""
        try:
            self._controller.enable(name, request.data)
        except Exception as error:
            response.success, response.message = False, in_words(error)
            return response
        self.changed = self._clock()
        response.success = True
        response.message = f'task {name} is {"enabled" if request.data else "disabled"}'
        return response

    def _on_cancel(self, name: str, request: Trigger.Request,
                   response: Trigger.Response) -> Trigger.Response:
        """End the trajectory of a task."""
        try:
            response.success = self._controller.cancel_trajectory(name, self._clock())
            response.message = f'task {name} comes to rest' if response.success \
                else f'task {name} follows no trajectory'
        except Exception as error:
            response.success, response.message = False, in_words(error)
        return response

    def _warn(self, name: str, remarks: Collection[str]) -> None:
        """Record the remarks about a goal; log them once for a stream of goals."""
        record, warning = self.records[name], '; '.join(remarks)
        if warning and warning != record.warning:
            self._log.warning(f'goal for task {name}: {warning}', f'warned {name}')
        record.warning = warning

    def _hand_on(self, name: str, entry: GoalMessage | TrajectoryMessage, message: Message
                 ) -> Collection[str]:
        """Pass the content of a message to the controller; return remarks about it."""
        if isinstance(entry, TrajectoryMessage):
            return self._take_trajectory(name, entry, message)
        if entry.parts is not None:
            self._take_parts(name, entry.parts(message))
            return ()
        goal, feed_forward = entry.goal(message), entry.feed_forward(message)
        if goal is None and feed_forward is None:
            raise GoalError('the message has no goal or velocity for this task')
        frame = self._frame(message.header.frame_id) if entry.framed else None
        now = self._clock()
        if goal is not None and feed_forward is not None:
            # A message is accepted as a whole or not at all.
            task = self._controller.stack.tasks[name]
            accept(task, task.parse_feed_forward, feed_forward)
        remarks: Collection[str] = ()
        if goal is not None:
            by_posture = getattr(self._controller.stack.tasks[name], 'approach', '') == BY_POSTURE
            set_goal = set_goal_by_posture if by_posture else type(self._controller).set_goal
            remarks = set_goal(self._controller, name, goal, now, frame)
        if feed_forward is not None:
            self._controller.set_feed_forward(name, feed_forward, now, frame)
        return remarks

    def _take_trajectory(self, name: str, entry: TrajectoryMessage, message: Message
                         ) -> Collection[str]:
        """Pass a trajectory to the controller; return remarks about it."""
        given = entry.timed(message, self._controller.stack.tasks[name].goal_type or '')
        now, stamp = self._clock(), 1e-9 * self._node.get_clock().now().nanoseconds
        return self._controller.set_trajectory(name, given.due(now, stamp), given.values, now,
                                               self._frame(given.frame), speed=given.speed)

    def _take_parts(self, name: str, parts: Parts) -> None:
        """Pass parts (frame, goal) to the controller, all of them or none."""
        if not parts:
            raise GoalError('the message has no goal or velocity for this task')
        task = self._controller.stack.tasks[name]
        placed = [(None if frame == task.reference else self._frame(frame), goal)
                  for frame, goal in parts]
        accept(task, task.parse_goal,
               {key: value for _, goal in placed for key, value in goal.items()})
        now = self._clock()
        # Goals in other frames may still be refused while joint positions are unknown.
        placed.sort(key=lambda part: part[0] is None)
        cleared = any(ALL_OBSTACLES in goal for _, goal in placed)
        for place, goal in placed:
            goal = {key: value for key, value in goal.items() if key != ALL_OBSTACLES}
            self._controller.set_goal(
                name, {ALL_OBSTACLES: None, **goal} if cleared else goal, now, place)
            cleared = False

    def _frame(self, frame: str) -> str | NDArray[np.float64] | None:
        """Return a frame for the controller: None, a name or a pose in the root."""
        if not frame or frame in self._controller.robot.frame_names:
            return frame or None
        return self._frames.pose(frame)


def _entries_of(task: Task) -> list[GoalMessage | TrajectoryMessage]:
    """Return the messages that a task accepts, one for each topic."""
    return [*messages_of(task), *trajectories_of(task)]

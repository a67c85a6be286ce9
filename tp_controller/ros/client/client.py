# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Client of a controller: sends goals, receives the status."""

from collections.abc import Callable, Mapping, Sequence
import time
from typing import Any

from rclpy import try_shutdown
from rclpy.client import Client as RosClient
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from sensor_msgs.msg import JointState
from tp_controller.errors import GoalError, TpControllerError, unknown
from tp_controller.ros import Message
from tp_controller.ros.client.context import new_context
from tp_controller.ros.client.goal_fields import Fields, listed, make_message
from tp_controller.ros.client.graph import absence, goal_topics
from tp_controller.ros.client.received_status import subscribe_status
from tp_controller.ros.client.status import ControllerStatus, TaskStatus
from tp_controller.ros.client.trajectory_fields import make_trajectory
from tp_controller.ros.signals import uninterrupted
from trajectory_msgs.msg import JointTrajectory

# Timeouts on closing for the acknowledgement of goals: by the controller, and, once it has
# answered, by all other subscribers [s].
LEAVE_SECONDS, OTHERS_SECONDS = 5.0, 2.0
# Polling period [s]; ROS does not signal topic discovery.
DISCOVERY_POLL_SECONDS = 0.02
# Largest number of callbacks run at once, since more may become ready all the time.
MOST_CALLBACKS = 100
# Timeout for other subscribers of a goal [s]: one that was just killed is counted for a while.
SUBSCRIBER_SECONDS = 2.0


class Client:
    """
    Node that communicates with a running controller.

    Parameters
    ----------
    controller : str
        Name of the controller node.
    context : rclpy.context.Context, optional
        Initialised context; by default the client creates its own.
    names : dict, optional
        {part of a goal: name in messages}; by default the argument names of `send`.

    Raises
    ------
    TpControllerError
        ROS cannot start here, or `controller` cannot be the name of a node.

    """

    def __init__(self, controller: str = 'tp_controller', context: Context | None = None,
                 names: Mapping[str, str] | None = None) -> None:
        self._names = names or {}
        self._own = context is None
        self._context = context or new_context()
        self.controller = controller.strip('/')
        # No log topic or parameters: each takes time to open.
        self.node = Node('tp_client', context=self._context, use_global_arguments=False,
                         enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._services: dict[str, RosClient] = {}
        self._last: tuple[Publisher, Message] | None = None
        # {publisher: timeout on closing until its messages are acknowledged [s]}
        self._pending: dict[Publisher, float] = {}
        self.status: ControllerStatus | None = None
        try:
            subscribe_status(self.node, self.controller, self._on_status)
        except TpControllerError:
            self.close()
            raise

    def close(self) -> None:
        """Close the client once all sent messages are acknowledged."""
        for publisher, seconds in self._pending.items():
            publisher.wait_for_all_acked(Duration(seconds=seconds))
        self._executor.shutdown()
        self.node.destroy_node()
        if self._own:
            try_shutdown(context=self._context)

    def __enter__(self) -> 'Client':
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the client."""
        self.close()

    def spin(self, seconds: float) -> None:
        """Process incoming messages for at most `seconds`."""
        with uninterrupted():
            self._executor.spin_once(timeout_sec=seconds)

    def catch_up(self) -> None:
        """Process all messages that have arrived, without waiting."""
        with uninterrupted():
            for _ in range(MOST_CALLBACKS):
                try:
                    handler, _, _ = self._executor.wait_for_ready_callbacks(timeout_sec=0.0)
                except TimeoutException:
                    return
                handler()
                if handler.exception() is not None:
                    raise handler.exception()

    def wait(self, condition: Callable[[], object], seconds: float) -> bool:
        """
        Spin until a condition holds.

        Parameters
        ----------
        condition : callable
            Evaluated after each message, and at least fifty times a second.
        seconds : float
            Timeout [s].

        Returns
        -------
        bool
            True once the condition holds, False after the timeout.

        """
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.spin(min(left, DISCOVERY_POLL_SECONDS))
        return True

    def tasks(self) -> dict[str, dict[str, type]]:
        """Return {task: {topic: message type}} of the goal topics in the graph."""
        return goal_topics(self.node, self.controller)

    def task_names(self) -> list[str]:
        """Return the names of all tasks in the status, by priority."""
        return list(self.status.tasks) if self.status else []

    def send(self, task: str, frame: str = '', wait: float = 10.0, **fields: Any) -> None:
        """
        Publish a goal, or a velocity, for a task.

        Parameters
        ----------
        task : str
            Its name.
        frame : str
            Frame that the goal is expressed in; the task's reference by default.
        wait : float
            Timeout for the controller [s].
        **fields
            ``xyz`` [m, or a direction], ``quat_xyzw``, ``joints`` {name: position}, ``velocities``
            {name: velocity}, ``linear`` [m/s], ``angular`` [rad/s].

        Raises
        ------
        GoalError
            The controller or task does not exist, the task takes another type of goal, or the
            controller refused the goal.

        """
        topic = 'twist' if {'linear', 'angular'} & set(fields) else 'goal'
        kinds = self._await_topics(task, (topic,), fields, wait)
        message = make_message(task, kinds[topic], fields, self._names)
        self._send(task, topic, message, frame, wait)

    def send_trajectory(self, task: str, values: Sequence[Fields],
                        times: Sequence[float] | None = None, speed: float = 0.0,
                        frame: str = '', wait: float = 10.0) -> None:
        """
        Publish a trajectory for a task.

        Parameters
        ----------
        task, frame, wait
            See `send`.
        values : sequence of dict
            Fields of each goal, as for `send`.
        times : sequence of float, optional
            Times from the receipt on [s]; without them the task moves at the speed.
        speed : float
            [m/s, or rad/s without a position]

        Raises
        ------
        GoalError
            As `send`.

        """
        kinds = self._await_topics(task, ('goal', 'trajectory'), values[0], wait)
        message = make_trajectory(task, kinds, values, times, speed, self._names)
        self._send(task, 'trajectory', message, frame, wait)

    def _await_topics(self, task: str, topics: Sequence[str], fields: Fields,
                      wait: float) -> dict[str, type]:
        """Wait for topics of a task; return {topic: message type}."""
        def missing() -> list[str]:
            known = self.tasks().get(task, {})
            return [topic for topic in topics if topic not in known]

        self.wait(lambda: not missing() or task not in (self.task_names() or [task]), wait)
        absent = missing()
        if absent:
            raise GoalError(self._absence(task, absent[0], fields))
        return self.tasks()[task]

    def _send(self, task: str, topic: str, message: Message, frame: str, wait: float) -> None:
        """Publish a message in a frame, and wait for the answer."""
        if frame and isinstance(message, (JointState, JointTrajectory)):
            raise GoalError(f'a goal of task {task!r} is not expressed in a frame: leave it out')
        message.header.frame_id = frame
        publisher = self._publisher(task, topic, type(message))
        self._await_subscribers(task, topic, publisher, wait)
        self._publish_goal(task, publisher, message, wait)

    def _await_subscribers(self, task: str, topic: str, publisher: Publisher,
                           wait: float) -> None:
        """Wait for the controller, and for all other subscribers of a goal."""
        if not self.wait(lambda: publisher.get_subscription_count() > 0, wait):
            raise GoalError(f'the controller does not answer on {publisher.topic_name}')
        if not self.wait(lambda: task in self.task_names(), wait):
            raise GoalError(f'the controller sends no status of task {task!r}')
        # Recorders are to receive it, too. The controller, which has been running for longer, may
        # know of subscribers that this node has not discovered yet.
        self.wait(lambda: publisher.get_subscription_count() >= max(
            self.node.count_subscribers(publisher.topic_name),
            self.task_status(task).listeners.get(topic, 0)),
            SUBSCRIBER_SECONDS)

    def _publish_goal(self, task: str, publisher: Publisher, message: Message,
                      wait: float) -> None:
        """Publish a goal, and wait for the answer of the controller."""
        before = self.task_status(task).answers
        self._last = publisher, message
        self._pending[publisher] = LEAVE_SECONDS
        publisher.publish(message)
        if not self.wait(lambda: task in self.task_names()
                         and self.task_status(task).answers != before, wait):
            raise GoalError(f'the controller did not answer the goal for task {task!r}')
        self._pending[publisher] = OTHERS_SECONDS
        status = self.task_status(task)
        if status.refused != before[1]:
            raise GoalError(f'refused: {status.refusal}')

    def publish(self, task: str, topic: str, message: Message) -> None:
        """Publish on a topic of a task, without waiting."""
        self._publisher(task, topic, type(message)).publish(message)

    def call(self, kind: type, name: str, request: Message) -> Future | None:
        """
        Call a service of the controller, without waiting.

        Parameters
        ----------
        kind : type
            Type of the service.
        name : str
            Name below that of the controller, such as ``stop``.
        request : object
            Request message.

        Returns
        -------
        rclpy.task.Future or None
            Done once the service has answered; None if the service is not available.

        """
        service = self.service(kind, name)
        return service.call_async(request) if service.service_is_ready() else None

    def service(self, kind: type, name: str) -> RosClient:
        """Return the client of a service of the controller, created on first use."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, f'/{self.controller}/{name}')
        return self._services[name]

    def repeat(self) -> None:
        """Publish the last goal again, without waiting for an answer."""
        if self._last is not None:
            publisher, message = self._last
            self._pending[publisher] = LEAVE_SECONDS
            publisher.publish(message)

    def task_status(self, task: str) -> TaskStatus:
        """Return the latest status of a task; empty while there is none."""
        tasks = self.status.tasks if self.status else {}
        return tasks.get(task) or TaskStatus(task)

    def stop_reason(self) -> str:
        """Return the reason for which the controller commands zeros; empty while it runs."""
        return self.status.stop_reason if self.status else 'no status yet'

    def _publisher(self, task: str, topic: str, kind: type) -> Publisher:
        """Return the publisher of a topic, created on first use."""
        if (task, topic) not in self._publishers:
            self._publishers[task, topic] = self.node.create_publisher(
                kind, f'/{self.controller}/{task}/{topic}', 10)
        return self._publishers[task, topic]

    def _absence(self, task: str, topic: str, fields: Fields) -> str:
        """Return the error message for a topic of a task that was not found."""
        tasks = self.tasks()
        names = self.task_names() or sorted(tasks)
        if topic == 'trajectory' and task in tasks:
            return f'task {task!r} follows no trajectory'
        if not names and self.status:
            return f'/{self.controller} has no tasks: {self.stop_reason()}'
        if not names:
            return absence(f'/{self.controller}')
        if task not in names:
            return unknown('task', task, names)
        return (f'task {task!r} takes no {listed(fields, self._names)}; its topics: '
                f'{", ".join(sorted(tasks.get(task, []))) or "none"}')

    def _on_status(self, status: ControllerStatus) -> None:
        """Store the latest status."""
        self.status = status

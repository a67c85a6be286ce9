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

"""Client of a controller: sends goals, receives the status."""

from collections.abc import Callable, Iterable, Mapping
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    Quaternion,
    QuaternionStamped,
    TwistStamped,
    Vector3,
    Vector3Stamped,
)
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy import init, try_shutdown
from rclpy.client import Client as RosClient
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.task import Future
from sensor_msgs.msg import JointState
from tp_controller.errors import GoalError, TpControllerError, unknown
from tp_controller.ros import Message
from tp_controller.ros.bounded_subscription import subscribe
from tp_controller.ros.client.received_status import received
from tp_controller.ros.signals import uninterrupted
from tp_controller.untrusted import count

# Parts of a goal, by the names that `FIELDS` lists.
Fields = Mapping[str, Any]

# Timeouts on closing for the acknowledgement of goals: by the controller, and, once it has
# answered, by all other subscribers [s].
LEAVE_SECONDS, OTHERS_SECONDS = 5.0, 2.0
# Polling period [s]; ROS does not signal topic discovery.
POLL_SECONDS = 0.02
# Largest number of callbacks run at once, since more may become ready all the time.
MOST_CALLBACKS = 100
# Timeout for other subscribers of a goal [s]: one that was just killed is counted for a while.
SUBSCRIBER_SECONDS = 2.0
# Answers to goals while the status has no such task.
NO_ANSWERS = '', ''
# Parts of a goal that each message can carry, and must.
FIELDS: dict[type, tuple[str, ...]] = {
    PointStamped: ('xyz',),
    Vector3Stamped: ('xyz',),
    QuaternionStamped: ('quat_xyzw',),
    PoseStamped: ('xyz', 'quat_xyzw'),
    JointState: ('joints', 'velocities'),
    TwistStamped: ('linear', 'angular'),
}


def type_name(kind: type) -> str:
    """Return the name of a message type in the graph."""
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


TYPES: dict[str, type] = {type_name(kind): kind for kind in FIELDS}


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
        self.status: DiagnosticArray | None = None
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
            self.spin(min(left, POLL_SECONDS))
        return True

    def tasks(self) -> dict[str, dict[str, type]]:
        """Return {task: {topic: message type}} of the goal topics in the graph."""
        prefix = f'/{self.controller}/'
        found: dict[str, dict[str, type]] = {}
        for topic, types in self.node.get_topic_names_and_types():
            name, _, last = topic.removeprefix(prefix).partition('/')
            if topic.startswith(prefix) and last in ('goal', 'twist') and types[0] in TYPES \
                    and self.node.count_subscribers(topic):
                found.setdefault(name, {})[last] = TYPES[types[0]]
        return found

    def task_names(self) -> list[str]:
        """Return the names of all tasks in the status, by priority."""
        return [status.name.partition(': ')[2] for status in self.status.status[1:]] \
            if self.status else []

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

        def found() -> bool:
            return topic in self.tasks().get(task, {})

        self.wait(lambda: found() or task not in (self.task_names() or [task]), wait)
        if not found():
            raise GoalError(self._absence(task, topic, fields))
        message = make_message(task, self.tasks()[task][topic], fields, self._names)
        if frame and isinstance(message, JointState):
            raise GoalError(f'a goal of task {task!r} is not expressed in a frame: leave it out')
        message.header.frame_id = frame
        publisher = self._publisher(task, topic, type(message))
        if not self.wait(lambda: publisher.get_subscription_count() > 0, wait):
            raise GoalError(f'the controller does not answer on {publisher.topic_name}')
        if not self.wait(lambda: self.task_status(task), wait):
            raise GoalError(f'the controller sends no status of task {task!r}')
        # Recorders are to receive it, too. The controller, which has been running for longer, may
        # know of subscribers that this node has not discovered yet.
        self.wait(lambda: publisher.get_subscription_count() >= max(
            self.node.count_subscribers(publisher.topic_name), self._count_listeners(task, topic)),
            SUBSCRIBER_SECONDS)
        before = self._answers(task)
        self._last = publisher, message
        self._pending[publisher] = LEAVE_SECONDS
        publisher.publish(message)
        if not self.wait(lambda: self._answers(task) not in (NO_ANSWERS, before), wait):
            raise GoalError(f'the controller did not answer the goal for task {task!r}')
        self._pending[publisher] = OTHERS_SECONDS
        if self._answers(task)[1] != before[1]:
            raise GoalError(f'refused: {self.task_status(task).get("last refusal", "")}')

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

    def set_parameter(self, node: str, name: str, value: object, wait: float) -> bool:
        """
        Set a parameter of any node.

        Parameters
        ----------
        node, name : str
            Names of the node and of its parameter.
        value : object
            New value.
        wait : float
            Timeout for the node, and for its answer [s].

        Returns
        -------
        bool
            True if the node has accepted it.

        """
        service = self.node.create_client(SetParameters, f'/{node}/set_parameters')
        if not self.wait(service.service_is_ready, wait):
            return False
        future = service.call_async(SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))
        return self.wait(future.done, wait) and future.result().results[0].successful

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

    def turning(self, joints: Iterable[str], wait: float = 10.0) -> set[str]:
        """
        Return the revolute ones of some joints; the others are prismatic.

        Parameters
        ----------
        joints : iterable of str
            Driven joints.
        wait : float
            Timeout for the controller [s].

        Raises
        ------
        GoalError
            The controller does not answer, or lacks some of these joints.

        """
        names = list(joints)
        service = self.node.create_client(DescribeParameters,
                                          f'/{self.controller}/describe_parameters')
        if not self.wait(service.service_is_ready, wait):
            raise GoalError(absence(f'/{self.controller}'))
        # The description of a limit contains its unit.
        future = service.call_async(DescribeParameters.Request(
            names=[f'limits.{name}.lower' for name in names]))
        self.wait(future.done, wait)
        found = future.result().descriptors if future.done() else []
        if len(found) < len(names):
            raise GoalError('cannot tell which joints turn: the controller has not all of '
                            f'{", ".join(names)}')
        return {name for name, limit in zip(names, found) if limit.description.endswith('[rad]')}

    def task_status(self, task: str) -> dict[str, str]:
        """Return {key: value} of the latest status of a task; empty before the first."""
        for status in self.status.status if self.status else ():
            if status.name == f'{self.controller}: {task}':
                return {value.key: value.value for value in status.values}
        return {}

    def _answers(self, task: str) -> tuple[str, str]:
        """Return the numbers of accepted and refused goals of a task, or `NO_ANSWERS`."""
        status = self.task_status(task)
        return (status.get('goals accepted', ''), status.get('goals refused', ''))

    def _count_listeners(self, task: str, topic: str) -> int:
        """Return the number of subscribers of a task topic that the controller has counted."""
        return count(self.task_status(task).get(f'{topic} listeners', ''))

    def stop_reason(self) -> str:
        """Return the reason for which the controller commands zeros; empty while it runs."""
        head = self.status.status[0].message if self.status else 'no status yet'
        return '' if head == 'running' else head

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
        if not names:
            return absence(f'/{self.controller}')
        if task not in names:
            return unknown('task', task, names)
        return (f'task {task!r} takes no {_listed(fields, self._names)}; its topics: '
                f'{", ".join(sorted(tasks.get(task, []))) or "none"}')

    def _on_status(self, message: DiagnosticArray) -> None:
        """Store the latest status."""
        self.status = message


def new_context() -> Context:
    """Return an initialised context; raise `TpControllerError` if ROS cannot start here."""
    context = Context()
    try:
        init(context=context, args=[])
    except (RuntimeError, ValueError) as error:
        raise TpControllerError(f'ROS 2 cannot start: {error}') from error
    return context


def absence(names: str) -> str:
    """Return the error message for nodes, of some names or any, that are not running."""
    return (f'no node {f"{names} " if names else ""}with tasks is running (ROS_DOMAIN_ID and '
            "ROS_AUTOMATIC_DISCOVERY_RANGE must be the same as the controller's)")


def subscribe_status(node: Node, controller: str,
                     callback: Callable[[DiagnosticArray], None], depth: int = 10) -> None:
    """Subscribe to the status of a controller; raise `TpControllerError` for an invalid name."""
    def take(message: DiagnosticArray) -> None:
        # Other nodes may have topics of this name and type, too.
        if message.status and message.status[0].name == controller:
            callback(received(message))

    try:
        subscribe(node, DiagnosticArray, f'/{controller}/status', take, depth)
    except NameValidationException as error:
        raise TpControllerError(f'{controller!r} cannot be the name of a node') from error


def make_message(task: str, kind: type, fields: Fields,
                 names: Mapping[str, str] | None = None) -> Message:
    """
    Return a goal message.

    Parameters
    ----------
    task : str
        Name for error messages.
    kind : type
        Message type.
    fields : dict
        See `Client.send`.
    names : dict, optional
        See `Client`.

    Raises
    ------
    GoalError
        `fields` does not match the parts of the message.

    """
    allowed = FIELDS[kind]
    extra = [name for name in fields if name not in allowed]
    missing = [name for name in allowed if name not in fields]
    one_is_enough = kind in (JointState, TwistStamped)
    if one_is_enough and len(missing) < len(allowed):
        missing = []
    if extra or missing:
        needed = _listed(allowed, names, ' or ' if one_is_enough else ' and ')
        raise GoalError(f'task {task!r} needs {needed} ({kind.__name__}), '
                        f'got {_listed(fields, names) or "nothing"}')
    return _FILL[kind](fields)


def _listed(fields: Iterable[str], names: Mapping[str, str] | None, word: str = ' and ') -> str:
    """Return the names of parts of a goal, as messages show them."""
    return word.join((names or {}).get(field, field) for field in fields)


def _vector(target: Point | Vector3, values: Iterable[float]) -> None:
    """Set x, y, z of a message."""
    target.x, target.y, target.z = map(float, values)


def _quaternion(target: Quaternion, values: Iterable[float]) -> None:
    """Set x, y, z, w of a message."""
    target.x, target.y, target.z, target.w = map(float, values)


def _point(fields: Fields) -> PointStamped:
    """Return a PointStamped."""
    message = PointStamped()
    _vector(message.point, fields['xyz'])
    return message


def _direction(fields: Fields) -> Vector3Stamped:
    """Return a Vector3Stamped."""
    message = Vector3Stamped()
    _vector(message.vector, fields['xyz'])
    return message


def _orientation(fields: Fields) -> QuaternionStamped:
    """Return a QuaternionStamped."""
    message = QuaternionStamped()
    _quaternion(message.quaternion, fields['quat_xyzw'])
    return message


def _pose(fields: Fields) -> PoseStamped:
    """Return a PoseStamped."""
    message = PoseStamped()
    _vector(message.pose.position, fields['xyz'])
    _quaternion(message.pose.orientation, fields['quat_xyzw'])
    return message


def _joints(fields: Fields) -> JointState:
    """Return a JointState with positions or velocities, or both for the same joints."""
    positions, velocities = fields.get('joints', {}), fields.get('velocities', {})
    if positions and velocities and list(positions) != list(velocities):
        raise GoalError('positions and velocities must be for the same joints')
    return JointState(name=list(positions or velocities),
                      position=[float(value) for value in positions.values()],
                      velocity=[float(value) for value in velocities.values()])


def _twist(fields: Fields) -> TwistStamped:
    """Return a TwistStamped."""
    message = TwistStamped()
    _vector(message.twist.linear, fields.get('linear', (0.0, 0.0, 0.0)))
    _vector(message.twist.angular, fields.get('angular', (0.0, 0.0, 0.0)))
    return message


_FILL: dict[type, Callable[[Fields], Message]] = {
    PointStamped: _point, Vector3Stamped: _direction, QuaternionStamped: _orientation,
    PoseStamped: _pose, JointState: _joints, TwistStamped: _twist}

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

"""The other side of the controller's topics: sends goals, listens to the status."""

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

# What a message is filled with, by the names that `FIELDS` lists.
Fields = Mapping[str, Any]

# How long to wait, on leaving, for goals to arrive: at the controller, and, if it has answered, at
# all others that listen [s].
LEAVE_SECONDS, OTHERS_SECONDS = 5.0, 2.0
# How often a condition is looked at: that a topic is found, nobody says.
POLL_SECONDS = 0.02
# How much is taken at once, where more may come all the time.
MOST_WAITING = 100
# How long others that listen to a goal are waited for: one that was killed a moment ago is counted
# for a while [s].
SETTLE_SECONDS = 2.0
# What stands for the answers to goals where the task is not there.
ABSENT = '', ''
# What of a goal each message can carry, and must.
FIELDS: dict[type, tuple[str, ...]] = {
    PointStamped: ('xyz',),
    Vector3Stamped: ('xyz',),
    QuaternionStamped: ('quat_xyzw',),
    PoseStamped: ('xyz', 'quat_xyzw'),
    JointState: ('joints', 'velocities'),
    TwistStamped: ('linear', 'angular'),
}


def type_name(kind: type) -> str:
    """Return the name of a message type, as the graph has it."""
    return f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


TYPES: dict[str, type] = {type_name(kind): kind for kind in FIELDS}


class Client:
    """
    A node that talks to a running controller.

    Parameters
    ----------
    controller : str
        Name of the controller node.
    context : rclpy.context.Context, optional
        Context that is initialised already; one of its own by default.
    names : dict, optional
        {part of a goal: what messages call it}; the names that `send` takes by default.

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
        # Neither log topic nor parameters: each costs time to open.
        self.node = Node('tp_client', context=self._context, use_global_arguments=False,
                         enable_rosout=False, start_parameter_services=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: dict[tuple[str, str], Publisher] = {}
        self._services: dict[str, RosClient] = {}
        self._last: tuple[Publisher, Message] | None = None
        # Publishers of messages, and how long to wait on leaving until these have arrived [s].
        self._pending: dict[Publisher, float] = {}
        self.status: DiagnosticArray | None = None
        try:
            subscribe_status(self.node, self.controller, self._on_status)
        except TpControllerError:
            self.close()
            raise

    def close(self) -> None:
        """Leave, once everything that was sent has arrived."""
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
        """Leave."""
        self.close()

    def spin(self, seconds: float) -> None:
        """Take what arrives, for at most `seconds`."""
        with uninterrupted():
            self._executor.spin_once(timeout_sec=seconds)

    def catch_up(self) -> None:
        """Take all that has arrived, and wait for nothing."""
        with uninterrupted():
            for _ in range(MOST_WAITING):
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
            Asked after everything that arrives, and at least fifty times a second.
        seconds : float
            How long to wait at most.

        Returns
        -------
        bool
            Whether it came to hold.

        """
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.spin(min(left, POLL_SECONDS))
        return True

    def tasks(self) -> dict[str, dict[str, type]]:
        """Return {task: {topic: message type}} of the goal topics that the graph shows."""
        prefix = f'/{self.controller}/'
        found: dict[str, dict[str, type]] = {}
        for topic, types in self.node.get_topic_names_and_types():
            name, _, last = topic.removeprefix(prefix).partition('/')
            if topic.startswith(prefix) and last in ('goal', 'twist') and types[0] in TYPES \
                    and self.node.count_subscribers(topic):
                found.setdefault(name, {})[last] = TYPES[types[0]]
        return found

    def task_names(self) -> list[str]:
        """Return the names of all tasks by priority, as the status has them."""
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
            How long to look for the controller [s].
        **fields
            ``xyz`` [m, or a direction], ``quat_xyzw``, ``joints`` {name: position}, ``velocities``
            {name: velocity}, ``linear`` [m/s], ``angular`` [rad/s].

        Raises
        ------
        GoalError
            The controller or task is not there, the task takes something else, or the
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
        # Whoever records is to hear it, too. The controller, which has been here for longer, may
        # know of somebody whom this node has not found yet.
        self.wait(lambda: publisher.get_subscription_count() >= max(
            self.node.count_subscribers(publisher.topic_name), self._listeners(task, topic)),
            SETTLE_SECONDS)
        before = self._answers(task)
        self._last = publisher, message
        self._pending[publisher] = LEAVE_SECONDS
        publisher.publish(message)
        if not self.wait(lambda: self._answers(task) not in (ABSENT, before), wait):
            raise GoalError(f'the controller did not answer the goal for task {task!r}')
        self._pending[publisher] = OTHERS_SECONDS
        if self._answers(task)[1] != before[1]:
            raise GoalError(f'refused: {self.task_status(task).get("last refusal", "")}')

    def publish(self, task: str, topic: str, message: Message) -> None:
        """Publish on a topic of a task, and wait for nothing."""
        self._publisher(task, topic, type(message)).publish(message)

    def call(self, kind: type, name: str, request: Message) -> Future | None:
        """
        Call a service of the controller, and wait for nothing.

        Parameters
        ----------
        kind : type
            Of the service.
        name : str
            Below the name of the controller, as ``stop``.
        request : object
            What it is asked.

        Returns
        -------
        rclpy.task.Future or None
            Done once it has answered; None where it is not there.

        """
        service = self.service(kind, name)
        return service.call_async(request) if service.service_is_ready() else None

    def set_parameter(self, node: str, name: str, value: object, wait: float) -> bool:
        """
        Set a parameter of any node.

        Parameters
        ----------
        node, name : str
            Of the node, and of its parameter.
        value : object
            Of the parameter.
        wait : float
            How long to wait for the node, and for its answer [s].

        Returns
        -------
        bool
            Whether the node has taken it.

        """
        service = self.node.create_client(SetParameters, f'/{node}/set_parameters')
        if not self.wait(service.service_is_ready, wait):
            return False
        future = service.call_async(SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]))
        return self.wait(future.done, wait) and future.result().results[0].successful

    def service(self, kind: type, name: str) -> RosClient:
        """Return the client of a service of the controller, made at the first use."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, f'/{self.controller}/{name}')
        return self._services[name]

    def repeat(self) -> None:
        """Publish once more what was sent last; no answer is waited for."""
        if self._last is not None:
            publisher, message = self._last
            self._pending[publisher] = LEAVE_SECONDS
            publisher.publish(message)

    def turning(self, joints: Iterable[str], wait: float = 10.0) -> set[str]:
        """
        Return those of some joints that turn; the others slide.

        Parameters
        ----------
        joints : iterable of str
            Driven joints.
        wait : float
            How long to wait for the controller [s].

        Raises
        ------
        GoalError
            The controller does not answer, or has not all of these joints.

        """
        names = list(joints)
        service = self.node.create_client(DescribeParameters,
                                          f'/{self.controller}/describe_parameters')
        if not self.wait(service.service_is_ready, wait):
            raise GoalError(absence(f'/{self.controller}'))
        # The unit stands in the description of a limit.
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
        """Return how many goals of a task were accepted and refused, or `ABSENT`."""
        status = self.task_status(task)
        return (status.get('goals accepted', ''), status.get('goals refused', ''))

    def _listeners(self, task: str, topic: str) -> int:
        """Return how many the controller knows of that listen to a topic of a task."""
        return count(self.task_status(task).get(f'{topic} listeners', ''))

    def stop_reason(self) -> str:
        """Return why the controller commands zeros; empty while it runs."""
        head = self.status.status[0].message if self.status else 'no status yet'
        return '' if head == 'running' else head

    def _publisher(self, task: str, topic: str, kind: type) -> Publisher:
        """Return the publisher of a topic, made at the first use."""
        if (task, topic) not in self._publishers:
            self._publishers[task, topic] = self.node.create_publisher(
                kind, f'/{self.controller}/{task}/{topic}', 10)
        return self._publishers[task, topic]

    def _absence(self, task: str, topic: str, fields: Fields) -> str:
        """Return what is missing where a topic of a task was not found."""
        tasks = self.tasks()
        names = self.task_names() or sorted(tasks)
        if not names:
            return absence(f'/{self.controller}')
        if task not in names:
            return unknown('task', task, names)
        return (f'task {task!r} takes no {_listed(fields, self._names)}; its topics: '
                f'{", ".join(sorted(tasks.get(task, []))) or "none"}')

    def _on_status(self, message: DiagnosticArray) -> None:
        """Keep the latest status."""
        self.status = message


def new_context() -> Context:
    """Return a context that is initialised; `TpControllerError` if ROS cannot start here."""
    context = Context()
    try:
        init(context=context, args=[])
    except (RuntimeError, ValueError) as error:
        raise TpControllerError(f'ROS 2 cannot start: {error}') from error
    return context


def absence(names: str) -> str:
    """Return that nodes of some names, or of any name, are not there."""
    return (f'no node {f"{names} " if names else ""}with tasks is running (ROS_DOMAIN_ID and '
            "ROS_AUTOMATIC_DISCOVERY_RANGE must be the same as the controller's)")


def subscribe_status(node: Node, controller: str,
                     callback: Callable[[DiagnosticArray], None], depth: int = 10) -> None:
    """Subscribe to the status of a controller; `TpControllerError` if that is no valid name."""
    def take(message: DiagnosticArray) -> None:
        # Other nodes have topics of this name and type, too.
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
        For what is said of a fault.
    kind : type
        Message type.
    fields : dict
        See `Client.send`.
    names : dict, optional
        See `Client`.

    Raises
    ------
    GoalError
        `fields` is not what the message carries.

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
    """Return what messages call parts of a goal."""
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

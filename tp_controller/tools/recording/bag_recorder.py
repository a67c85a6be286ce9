# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recorder of all topics of running controllers, to a bag."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
import operator
import time
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy import try_shutdown
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from tp_controller.errors import TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.ros import Message
from tp_controller.ros.client.context import new_context
from tp_controller.ros.client.status import STATUS_TYPE
from tp_controller.ros.rclpy_internals import NodeNameNonExistentError, RCLError
from tp_controller.tools.recording.writer import BagWriter

EVENTS = '/parameter_events'
EVENT_TYPE = 'rcl_interfaces/msg/ParameterEvent'
TEXT_TYPE = 'std_msgs/msg/String'
# Topics of other nodes that locate a robot.
SHARED = {'/tf', '/tf_static', '/clock'}
# Queue depth of a topic, for a busy file system: some seconds at 1 kHz.
DEPTH = 5000
# Period of the search for new topics, and timeout of parameter requests [s].
LOOK_SECONDS, PARAMETERS_ANSWER_SECONDS = 0.1, 5.0
# Fields of a ParameterValue: scalars, and arrays with their types.
SINGLE = ('type', 'bool_value', 'integer_value', 'double_value', 'string_value')
ARRAYS = {'bool_array_value': np.bool_, 'integer_array_value': np.int64,
          'double_array_value': np.float64}


@dataclass
class _Topic:
    """Subscribed topic; message losses are only known with a single publisher."""

    kind: str
    subscription: Subscription
    qos: QoSProfile
    offered: list[Qos]
    publishers: int
    sent: int = 0
    lost: int = 0

    def known_lost(self) -> int:
        """Return the number of lost messages; 0 if it is unknown."""
        return self.lost if self.publishers < 2 else 0


class BagRecorder:
    """
    Recorder of all topics that controllers publish and subscribe to, to a bag.

    Messages are not decoded, and no executor runs callbacks: the recorder polls the queues of the
    subscriptions, which contain the times of receipt.

    Parameters
    ----------
    names : collection of str
        Names of controller nodes with their namespaces; if empty, all that are found.
    context : rclpy.context.Context, optional
        Initialised context; by default a new one.

    Attributes
    ----------
    controllers : list of str
        Controllers found so far.
    skipped : dict
        {topic: reason for not recording it}

    Raises
    ------
    TpControllerError
        ROS cannot be initialised.

    """

    def __init__(self, names: Collection[str] = (), context: Context | None = None) -> None:
        self._own = context is None
        self._context = context or new_context()
        self._names = [name.strip('/') for name in names]
        # The subscriptions belong to a node outside the executor, which would take their messages.
        self._node, self._caller = (
            Node(name, context=self._context, use_global_arguments=False, enable_rosout=False,
                 start_parameter_services=False) for name in ('tp_recorder', 'tp_recorder_client'))
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._caller)
        self._topics: dict[str, _Topic] = {}
        self._requests: dict[str, _ParameterRequest] = {}
        self._search_time = -LOOK_SECONDS
        self._lost = 0
        self.controllers: list[str] = []
        self.skipped: dict[str, str] = {}

    def __enter__(self) -> 'BagRecorder':
        """Return the recorder."""
        return self

    def __exit__(self, *_: object) -> None:
        """Destroy the nodes, and an own context."""
        self._executor.shutdown()
        self._caller.destroy_node()
        self._node.destroy_node()
        if self._own:
            try_shutdown(context=self._context)

    def missing(self) -> list[str]:
        """Return the named controllers that were not found."""
        return [name for name in self._names if name not in self.controllers]

    def find(self) -> bool:
        """Search controllers; return whether all named ones, or any one, were found."""
        for name in self._names or self._candidates():
            if name not in self.controllers and self._topics_of(name):
                self.controllers.append(name)
        return bool(self.controllers) and not self.missing()

    def record(self, bag: BagWriter) -> int:
        """Write the messages received since the last call; return their number."""
        if (now := time.monotonic()) - self._search_time >= LOOK_SECONDS:
            self._search_time = now
            self.find()
            self._follow(bag)
        self._request_parameters(bag)
        arrived = [(info['received_timestamp'], name, topic, data)
                   for name, topic in self._topics.items() for data, info in _queued(topic)]
        arrived.sort(key=operator.itemgetter(0))
        for stamp, name, topic, data in arrived:
            bag.write(name, topic.kind, stamp, data, topic.offered)
        return len(arrived)

    def lost(self) -> int:
        """Return the number of messages lost on topics with one publisher."""
        return self._lost + sum(topic.known_lost() for topic in self._topics.values())

    def _candidates(self) -> Iterator[str]:
        """Yield the names of nodes that publish the topics of a controller."""
        topics = dict(self._node.get_topic_names_and_types())
        for topic, kinds in topics.items():
            name, _, last = topic.rpartition('/')
            if last == 'status' and STATUS_TYPE in kinds and f'{name}/markers' in topics and any(
                    _full_name(publisher) == name
                    for publisher in self._node.get_publishers_info_by_topic(topic)):
                yield name.strip('/')

    def _topics_of(self, name: str) -> dict[str, str]:
        """Return {topic: type} of the topics of a controller and its loop."""
        namespace, _, base = f'/{name}'.rpartition('/')
        found: dict[str, str] = {}
        for node in (base, f'{base}_loop'):
            for look in (self._node.get_publisher_names_and_types_by_node,
                         self._node.get_subscriber_names_and_types_by_node):
                try:
                    found.update((topic, kinds[0])
                                 for topic, kinds in look(node, namespace or '/'))
                except NodeNameNonExistentError:
                    continue
        return found

    def _wanted(self) -> dict[str, str]:
        """Return {topic: type} of all topics to record now."""
        wanted: dict[str, str] = {}
        shared = set(SHARED)
        for name in self.controllers:
            # A controller that has ended may be restarted: its topics stay.
            found = self._topics_of(name) or {
                topic: known.kind for topic, known in self._topics.items()}
            wanted.update(found)
            namespace = f'/{name}'.rpartition('/')[0]
            shared |= {'/robot_description', f'{namespace}/robot_description'}
        wanted.update((topic, kinds[0])
                      for topic, kinds in self._node.get_topic_names_and_types()
                      if topic in shared)
        return wanted

    def _follow(self, bag: BagWriter) -> None:
        """Subscribe to new topics, and again to those whose type or publishers have changed."""
        wanted = self._wanted()
        for name in [name for name in self._topics if name not in wanted]:
            # The topic of a removed task may return with another type.
            self._drop(name)
        for name, kind in wanted.items():
            publishers = self._node.get_publishers_info_by_topic(name)
            qos = _matching(publishers)
            topic = self._topics.get(name)
            if topic is not None and topic.kind == kind and topic.qos == qos:
                # Keep the profiles of publishers that have ended.
                topic.offered = [_qos(each.qos_profile) for each in publishers] or topic.offered
                topic.publishers = max(topic.publishers, len(publishers))
                continue
            if topic is not None:
                self._drop(name)
            self._listen(bag, name, kind, qos, publishers)

    def _drop(self, name: str) -> None:
        """Unsubscribe from a topic."""
        topic = self._topics.pop(name)
        self._lost += topic.known_lost()
        self._node.destroy_subscription(topic.subscription)

    def _listen(self, bag: BagWriter, name: str, kind: str, qos: QoSProfile,
                publishers: Collection[TopicEndpointInfo]) -> None:
        """Subscribe to a topic; a failure is retried in the next search."""
        message_type = _message_type(kind) if bag.knows(kind) else None
        if message_type is None:
            self.skipped[name] = f'its type {kind} is unknown on this machine'
            return
        try:
            subscription = self._node.create_subscription(message_type, name, _ignore, qos,
                                                          raw=True)
        except RCLError:
            # The subscription of another type was closed just now.
            return
        self._topics[name] = _Topic(kind, subscription, qos,
                                    [_qos(each.qos_profile) for each in publishers],
                                    len(publishers))

    def _request_parameters(self, bag: BagWriter) -> None:
        """Write the parameters of each controller once; events contain later changes."""
        for name in self.controllers:
            if name not in self._requests:
                self._requests[name] = _ParameterRequest(self._caller, name)
        if any(not request.done for request in self._requests.values()):
            self._executor.spin_once(timeout_sec=0.0)
        for request in self._requests.values():
            request.proceed(bag)


class _ParameterRequest:
    """Asynchronous reader of the parameters of a controller."""

    def __init__(self, node: Node, name: str) -> None:
        self._name = name
        self._list = node.create_client(ListParameters, f'/{name}/list_parameters')
        self._get = node.create_client(GetParameters, f'/{name}/get_parameters')
        self._future: Any = None
        self._names: list[str] = []
        self._since = -PARAMETERS_ANSWER_SECONDS
        self.done = False

    def proceed(self, bag: BagWriter) -> None:
        """Process a response or send a request, without blocking; retry after a timeout."""
        if self.done or not self._get.service_is_ready():
            return
        if self._future is None or time.monotonic() - self._since > PARAMETERS_ANSWER_SECONDS:
            self._since = time.monotonic()
            self._names = []
            self._future = self._list.call_async(ListParameters.Request())
        elif self._future.done():
            answer = self._future.result()
            if not self._names:
                self._names = list(answer.result.names)
                self._future = self._get.call_async(GetParameters.Request(names=self._names))
            else:
                self.done = True
                self._write(bag, dict(zip(self._names, answer.values)))

    def _write(self, bag: BagWriter, values: dict[str, Message]) -> None:
        """Write all parameters as an event, and the description of a robot in a file."""
        now = time.time_ns()
        stamp = bag.make('builtin_interfaces/msg/Time', dict(zip(('sec', 'nanosec'),
                                                                 divmod(now, 10**9))))
        parameters = [bag.make('rcl_interfaces/msg/Parameter', {
            'name': name, 'value': _parameter_value(bag, value)})
                      for name, value in values.items()]
        bag.write_message(EVENTS, EVENT_TYPE, now, {
            'stamp': stamp, 'node': f'/{self._name}', 'new_parameters': parameters,
            'changed_parameters': [], 'deleted_parameters': []})
        file = values['robot'].string_value if 'robot' in values else ''
        if file:
            try:
                arguments = values.get('xacro_arguments')
                urdf = Robot.from_file(file, xacro_arguments=None if arguments is None else list(
                    arguments.string_array_value)).urdf
            except TpControllerError:
                # The file is on another machine, perhaps that of the reader of the bag.
                return
            bag.write_message(f'/{self._name}/robot_description', TEXT_TYPE, now, {'data': urdf})


def _parameter_value(bag: BagWriter, value: Message) -> object:
    """Return the value of a parameter as part of a message to write."""
    return bag.make('rcl_interfaces/msg/ParameterValue', {
        **{name: getattr(value, name) for name in SINGLE},
        **{name: np.array(getattr(value, name), kind) for name, kind in ARRAYS.items()},
        'byte_array_value': np.frombuffer(b''.join(value.byte_array_value), np.uint8),
        'string_array_value': list(value.string_array_value)})


def _queued(topic: _Topic) -> Iterator[tuple[bytes, dict[str, int]]]:
    """Yield the messages in the queue of a topic, and count lost ones by sequence numbers."""
    handle = topic.subscription.handle
    with handle:
        for _ in range(DEPTH):
            taken = handle.take_message(topic.subscription.msg_type, True)
            if taken is None:
                return
            number = taken[1]['publication_sequence_number']
            if topic.sent and number > topic.sent:
                topic.lost += number - topic.sent - 1
            topic.sent = number
            yield taken


def _full_name(endpoint: TopicEndpointInfo) -> str:
    """Return the name of the node of a publisher, with its namespace."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _matching(publishers: Iterable[TopicEndpointInfo]) -> QoSProfile:
    """Return the strictest profile that matches those of all publishers."""
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    lasting = profiles and all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL
                               for each in profiles)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE)


def _qos(profile: QoSProfile) -> Qos:
    """Return a QoS profile in the format of a bag."""
    return Qos(QosHistory[profile.history.name], profile.depth,
               QosReliability[profile.reliability.name], QosDurability[profile.durability.name],
               _time(profile.deadline), _time(profile.lifespan),
               QosLiveliness[profile.liveliness.name],
               _time(profile.liveliness_lease_duration), profile.avoid_ros_namespace_conventions)


def _time(duration: Duration) -> QosTime:
    """Return a duration in the format of a bag."""
    return QosTime(*divmod(duration.nanoseconds, 10**9))


def _message_type(kind: str) -> type | None:
    """Return the class of a message type; None if it is not installed."""
    package, _, name = kind.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None


def _ignore(_: object) -> None:
    """Ignore a message; the recorder polls the queue."""

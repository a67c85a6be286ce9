# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""History of a controller, collected in one pass over a recording."""

from collections import Counter
from collections.abc import Callable, Sequence
import math
from typing import Any

import numpy as np
from tp_controller.errors import TpControllerError, unknown
from tp_controller.resources import MOST_XML_CHARACTERS
from tp_controller.ros.client.status import LONGEST_KEY, received, STATUS_TYPE
from tp_controller.tools.recording.goals import Goals
from tp_controller.tools.recording.mcap import Raw
from tp_controller.tools.recording.motion import Moment, Motion
from tp_controller.tools.recording.reader import Bag, Unreadable
from tp_controller.tools.recording.series import Series
from tp_controller.tools.recording.stops import Stops
from tp_controller.tools.recording.task_curves import TaskCurves
from tp_controller.tools.recording.task_history import TaskHistory
from tp_controller.untrusted.texts import plain

JOINTS_TYPE = 'sensor_msgs/msg/JointState'
NUMBERS_TYPE = 'std_msgs/msg/Float64MultiArray'
TWIST_TYPE, STAMPED_TWIST_TYPE = 'geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'
ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'
MARKERS_TYPE = 'visualization_msgs/msg/MarkerArray'
TEXT_TYPE = 'std_msgs/msg/String'
EVENT_TYPE = 'rcl_interfaces/msg/ParameterEvent'
# Topic of all nodes, for general diagnostic tools.
DIAGNOSTICS = '/diagnostics'
GOAL_TOPICS = ('goal', 'twist', 'obstacles')
# Fields of a ParameterValue by its type (rcl_interfaces/msg/ParameterType).
VALUE_FIELDS = ('', 'bool_value', 'integer_value', 'double_value', 'string_value',
                'byte_array_value', 'bool_array_value', 'integer_array_value',
                'double_array_value', 'string_array_value')
# Longest interval between two statuses that counts [s]; the state in longer gaps is unknown.
MOST_STATUS_SECONDS = 1.0
# Bound of the memory for any recording: largest number of tasks.
MOST_TASKS = 100
# Largest numbers of topics of one kind, and of values of all commands.
MOST_TOPICS_OF_A_KIND, MOST_COMMANDS = 30, 1000
# Largest number of parameters, and length of all [characters].
MOST_PARAMETERS, LONGEST_PARAMETERS = 5000, 1 << 23


class History:
    """
    History of one controller.

    Parameters
    ----------
    bag : Bag
        Bag; it is read once for the name, as far as needed, and once completely.
    node : str
        Name of the controller node with its namespace; if empty, the only one in the bag.
    advance : callable
        Called with the number of bytes read since the last call.

    Attributes
    ----------
    node : str
        Empty if the bag has no status of a controller.
    began : int
        Time of the first message [ns since 1970]; all other times count from it [s].
    end : float
        Time of the last message [s].
    counts : Counter
        {topic: messages}
    parameters : dict
        {name: value} of the controller.
    descriptions : dict
        {topic: URDF}
    tasks : dict
        {name: TaskHistory}, by priority.
    curves : TaskCurves
        Errors and limiting causes of the tasks.
    goals : Goals
        Goals, with their outcomes.
    stops : Stops
        Times of zero commands, with their reasons.
    commands, twists : dict
        {topic: Series} of joint velocities, and of twists (6) of a base.
    motion : Motion
        Joint ranges, and the recorded moments.

    Raises
    ------
    TpControllerError
        There are several controllers, or none with this name.

    """

    def __init__(self, bag: Bag, node: str, advance: Callable[[float], object]) -> None:
        self._bag = bag
        self.node = _find_node(bag, node.strip('/'))
        self.began, self.end = 0, 0.0
        self.counts: Counter[str] = Counter()
        self.parameters: dict[str, Any] = {}
        self.descriptions: dict[str, str] = {}
        self.tasks: dict[str, TaskHistory] = {}
        self.curves = TaskCurves()
        self.goals = Goals()
        self.stops = Stops()
        self._status_time = math.nan
        self.commands: dict[str, Series] = {}
        self.twists: dict[str, Series] = {}
        self.motion = Motion()
        self._parameter_characters = 0
        self._unreadable: Counter[str] = Counter()
        for raw in bag.messages(advance):
            self._take(raw)
        bag.remarks += [f'{count} messages of {what} could not be read'
                        for what, count in self._unreadable.items()]

    @property
    def namespace(self) -> str:
        """Return the namespace of the controller with a leading slash, or an empty string."""
        return f'/{self.node}'.rpartition('/')[0]

    def markers(self, moment: Moment) -> list[Any]:
        """Return the markers of the tasks at a moment."""
        if moment.markers is None:
            return []
        try:
            return list(self._bag.decode(moment.markers).markers)
        except Unreadable:
            return []

    def _take(self, raw: Raw) -> None:
        """Process one message."""
        if not self.counts:
            self.began = raw.stamp
        self.counts[raw.topic] += 1
        time = 1e-9 * (raw.stamp - self.began)
        self.end = max(self.end, time)
        task, _, last = raw.topic.removeprefix(f'/{self.node}/').partition('/')
        own = bool(self.node) and raw.topic.startswith(f'/{self.node}/')
        try:
            if own and last in GOAL_TOPICS:
                self.goals.add_message(time, task, raw.kind, self._bag.decode(raw))
            elif own and raw.kind == MARKERS_TYPE:
                self.motion.set_markers(raw)
            elif raw.kind in TAKERS and not (own and raw.kind in (JOINTS_TYPE, NUMBERS_TYPE)):
                TAKERS[raw.kind](self, time, raw.topic, self._bag.decode(raw))
        except Exception as error:
            # Decoded messages may still be invalid in any way.
            what = str(error) if isinstance(error, Unreadable) else raw.topic
            self._unreadable[what] += 1

    def _take_status(self, time: float, topic: str, message: Any) -> None:
        """Process the status of the controller and its tasks."""
        if topic == DIAGNOSTICS or not self.node:
            return
        status = received(message)
        if status.name != self.node:
            return
        lasted = time - self._status_time
        lasted = lasted if 0.0 < lasted < MOST_STATUS_SECONDS else 0.0
        self._status_time = time
        self.stops.add_status(time, status.head)
        samples = {}
        for name, task in status.tasks.items():
            if name not in self.tasks and len(self.tasks) >= MOST_TASKS:
                continue
            self.goals.add_status(time, task)
            history = self.tasks.setdefault(name, TaskHistory(name))
            history.update(task, lasted)
            samples[name] = ({unit: task.errors.get(unit, math.nan) for unit in history.errors},
                             task.causes)
        self.curves.add(time, samples)

    def _take_joints(self, time: float, topic: str, message: Any) -> None:
        """Process joint states."""
        self.motion.add_joints(time, message)

    def _take_command(self, time: float, topic: str, message: Any) -> None:
        """Process joint velocities."""
        values = message.data
        if topic not in self.commands:
            if len(values) + sum(map(len, self.commands.values())) > MOST_COMMANDS:
                return
            self.commands[topic] = Series(len(values))
        if len(values) <= len(self.commands[topic]):
            self.commands[topic].add(time, values)

    def _take_twist(self, time: float, topic: str, message: Any) -> None:
        """Process the velocity of a base, with or without a stamp."""
        message = getattr(message, 'twist', message)
        linear, angular = message.linear, message.angular
        if topic not in self.twists and len(self.twists) >= MOST_TOPICS_OF_A_KIND:
            return
        self.twists.setdefault(topic, Series(6)).add(
            time, (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z))

    def _take_odometry(self, time: float, topic: str, message: Any) -> None:
        """Process the pose of a base."""
        self.motion.set_base(message)

    def _take_text(self, time: float, topic: str, message: Any) -> None:
        """Store a description of a robot."""
        if topic.endswith('robot_description') and len(message.data) <= MOST_XML_CHARACTERS and (
                topic in self.descriptions or len(self.descriptions) < MOST_TOPICS_OF_A_KIND):
            self.descriptions[topic] = message.data

    def _take_event(self, time: float, topic: str, message: Any) -> None:
        """Store parameters of the controller."""
        if message.node.strip('/') == self.node:
            for parameter in (*message.new_parameters, *message.changed_parameters):
                value = parameter.value
                self._set_parameter(plain(parameter.name, LONGEST_KEY), getattr(
                    value, VALUE_FIELDS[value.type]) if value.type else None)

    def _set_parameter(self, name: str, value: Any) -> None:
        """Store a parameter, unless the limits are exceeded."""
        length = _length(value) - _length(self.parameters.get(name))
        if self._parameter_characters + length <= LONGEST_PARAMETERS and (
                name in self.parameters or len(self.parameters) < MOST_PARAMETERS):
            self._parameter_characters += length
            self.parameters[name] = value


TAKERS: dict[str, Callable[[History, float, str, Any], None]] = {
    STATUS_TYPE: History._take_status, JOINTS_TYPE: History._take_joints,
    NUMBERS_TYPE: History._take_command, TWIST_TYPE: History._take_twist,
    STAMPED_TWIST_TYPE: History._take_twist,
    ODOMETRY_TYPE: History._take_odometry, TEXT_TYPE: History._take_text,
    EVENT_TYPE: History._take_event}


def _find_node(bag: Bag, node: str) -> str:
    """Return the name of the controller; '' if the bag has no status."""
    found: dict[str, None] = {}
    looked: set[str] = set()
    first, remarks = None, len(bag.remarks)
    for raw in bag.messages(lambda size: None):
        first = raw.stamp if first is None else first
        if raw.kind == STATUS_TYPE and raw.topic != DIAGNOSTICS and raw.topic not in looked:
            looked.add(raw.topic)
            name = _controller_in(bag, raw)
            if name:
                found[name] = None
        if found and (node in found or raw.stamp - first > 10 * 10**9):
            break
    # The complete pass repeats these remarks.
    del bag.remarks[remarks:]
    if node and node not in found:
        if found:
            raise TpControllerError(unknown('controller', node, list(found)))
        raise TpControllerError(f'{bag.path} has no status of /{node}, nor of another controller')
    if len(found) > 1 and not node:
        raise TpControllerError(f'{bag.path} has several controllers: choose one with --node: '
                                f'{", ".join(found)}')
    return node or next(iter(found), '')


def _controller_in(bag: Bag, raw: Raw) -> str:
    """Return the name of the controller that published a status; '' for other nodes."""
    try:
        status = received(bag.decode(raw))
    except Unreadable:
        return ''
    return status.name if status.from_controller else ''


def _length(value: Any) -> int:
    """Return the length of the value of a parameter [characters]."""
    if isinstance(value, list):
        return sum(map(_length, value))
    return len(value) if isinstance(value, str) else 8 * np.size(value)


def nearest(topics: Sequence[str], names: Sequence[str], namespace: str) -> str:
    """
    Return the topic of one type that most probably belongs to a controller.

    Parameters
    ----------
    topics : sequence of str
        Topics to choose from.
    names : sequence of str
        Default names of the topic.
    namespace : str
        Namespace of the controller.

    Returns
    -------
    str
        Name of the topic; empty if there is none.

    """
    def order(topic: str) -> tuple[bool, bool]:
        return (topic not in [f'{namespace}/{name}' for name in names],
                not topic.startswith(f'{namespace}/'))

    return min(topics, key=order, default='')

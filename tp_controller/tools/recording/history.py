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

"""History of a controller, collected in one pass over a recording."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import math
import re
from typing import Any

import numpy as np
from tp_controller.errors import TpControllerError, unknown
from tp_controller.model.spatial import Array, pose, rotation_from_quaternion
from tp_controller.resources import MOST_XML_CHARACTERS
from tp_controller.tools.recording.goals import Goals
from tp_controller.tools.recording.mcap import Raw
from tp_controller.tools.recording.reader import Bag, Unreadable
from tp_controller.tools.recording.series import Series
from tp_controller.untrusted import errors_of, number, plain

STATUS = 'diagnostic_msgs/msg/DiagnosticArray'
JOINTS = 'sensor_msgs/msg/JointState'
NUMBERS = 'std_msgs/msg/Float64MultiArray'
TWIST = 'geometry_msgs/msg/Twist'
ODOMETRY = 'nav_msgs/msg/Odometry'
MARKERS = 'visualization_msgs/msg/MarkerArray'
TEXT = 'std_msgs/msg/String'
EVENT = 'rcl_interfaces/msg/ParameterEvent'
# Topic of all nodes, for general diagnostic tools.
DIAGNOSTICS = '/diagnostics'
GOAL_TOPICS = ('goal', 'twist', 'obstacles')
# Interval of recorded moments [s], and their largest number.
FRAME_SECONDS, MOST_FRAMES = 0.04, 1500
# Share of the interval after which the next moment is recorded, as messages may be early.
EARLY = 0.9
# Status of all tasks while the robot is stopped.
STOPPED = 'stopped'
# Largest number of listed stops; more are counted.
MOST_STOPS = 500
# Numbers in a reason, which change continuously.
NUMBER = re.compile(r' by [-+.\de]+ (m|rad)\b')
# Parts of the reason of a stop that change while it lasts.
VARIABLE_PARTS = re.compile(r' \(ignored: .*\)|, until a moment ago|[-+]?\d+(\.\d+)?')
# Fields of a ParameterValue by its type (rcl_interfaces/msg/ParameterType).
VALUE_FIELDS = ('', 'bool_value', 'integer_value', 'double_value', 'string_value',
                'byte_array_value', 'bool_array_value', 'integer_array_value',
                'double_array_value', 'string_array_value')
# Longest interval between two statuses that counts [s]; the state in longer gaps is unknown.
MOST_STATUS_SECONDS = 1.0
# Bounds of the memory for any recording. Largest numbers of tasks, errors and causes of a task,
# and distinct reasons; longest name [characters].
MOST_TASKS, MOST_ERRORS, MOST_CAUSES, MOST_REASONS, LONGEST_NAME = 100, 4, 100, 5000, 256
# Largest numbers of joints, of topics of one kind, and of values of all commands.
MOST_JOINTS, MOST_TOPICS, MOST_COMMANDS = 300, 30, 1000
# Largest size of all markers [bytes], number of parameters, and length of all [characters].
MOST_MARKER_BYTES, MOST_PARAMETERS, LONGEST_PARAMETERS = 1 << 26, 5000, 1 << 23


@dataclass
class TaskHistory:
    """
    History of a task.

    Attributes
    ----------
    name, kind, level : str
        Name, type and level in the last status.
    status : str
        Last status before a stop; ``stopped`` if there is no other.
    stopped : bool
        Whether the robot was stopped at the end.
    errors : dict
        {unit: (last known error, tolerance)}
    largest : dict
        {unit: largest error}
    causes : dict
        {cause: time for which it limited the task [s]}
    reached, known : float
        Time for which the task was reached or satisfied, and time with a known status [s].

    """

    name: str
    kind: str = ''
    level: str = ''
    status: str = ''
    stopped: bool = False
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=dict)
    causes: dict[str, float] = field(default_factory=dict)
    reached: float = 0.0
    known: float = 0.0


@dataclass
class Stop:
    """Stop: zeros were commanded from `start` to `end` [s], for a reason."""

    start: float
    end: float
    reason: str


@dataclass
class Moment:
    """
    Recorded state at one time.

    Attributes
    ----------
    time : float
        [s]
    joints : dict
        {joint: position [rad or m]}
    base : (str, str, ndarray (4, 4)) or None
        Frame, child frame and pose of the odometry.
    markers : Raw or None
        Markers of the tasks, not decoded.

    """

    time: float
    joints: Mapping[str, float]
    base: tuple[str, str, Array] | None
    markers: Raw | None


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
    errors : Series
        Errors, in the order of `columns`.
    columns : dict
        {(task, unit): column}
    reasons : Series
        Codes of the limiting causes of each task, in the order of `reason_columns`; see `texts`.
    reason_columns : dict
        {task: column}
    texts : list of str
        Texts of the codes; 0 stands for no reason.
    goals : Goals
    stops : list of Stop
    more_stops : int
        Number of stops that are not listed.
    commands, twists : dict
        {topic: Series} of joint velocities, and of twists (6) of a base.
    ranges : dict
        {joint: (smallest, largest) position [rad or m]}
    moments : list of Moment

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
        self.errors, self.columns = Series(0), dict[tuple[str, str], int]()
        self.reasons, self.reason_columns = Series(0), dict[str, int]()
        self.texts = ['']
        self._codes = {'': 0.0}
        self.goals = Goals()
        self.stops: list[Stop] = []
        self.more_stops = 0
        self._stop: Stop | None = None
        self._status_time = math.nan
        self.commands: dict[str, Series] = {}
        self.twists: dict[str, Series] = {}
        self._extremes: dict[tuple[str, ...], tuple[Array, Array]] = {}
        self._joints: dict[str, float] = {}
        self._base: tuple[str, str, Array] | None = None
        self._markers: Raw | None = None
        self.moments: list[Moment] = []
        self._period = FRAME_SECONDS
        self._marker_bytes = self._parameter_characters = 0
        self._unreadable: Counter[str] = Counter()
        for raw in bag.messages(advance):
            self._take(raw)
        bag.remarks += [f'{count} messages of {what} could not be read'
                        for what, count in self._unreadable.items()]

    @property
    def namespace(self) -> str:
        """Return the namespace of the controller with a leading slash, or an empty string."""
        return f'/{self.node}'.rpartition('/')[0]

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return {joint: (smallest, largest) position [rad or m]}."""
        found: dict[str, tuple[float, float]] = {}
        for names, (low, high) in self._extremes.items():
            for name, least, most in zip(names, low.tolist(), high.tolist()):
                before = found.get(name, (math.inf, -math.inf))
                found[name] = min(before[0], least), max(before[1], most)
        return found

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
            elif own and raw.kind == MARKERS:
                self._markers = raw
            elif raw.kind in TAKERS and not (own and raw.kind in (JOINTS, NUMBERS)):
                TAKERS[raw.kind](self, time, raw.topic, self._bag.decode(raw))
        except Exception as error:
            # Decoded messages may still be invalid in any way.
            what = str(error) if isinstance(error, Unreadable) else raw.topic
            self._unreadable[what] += 1

    def _take_status(self, time: float, topic: str, message: Any) -> None:
        """Process the status of the controller and its tasks."""
        if topic == DIAGNOSTICS or not message.status or message.status[0].name != self.node:
            return
        lasted = time - self._status_time
        lasted = lasted if 0.0 < lasted < MOST_STATUS_SECONDS else 0.0
        self._status_time = time
        self._take_stop(time, message.status[0].message)
        errors, codes = [math.nan] * len(self.columns), [0.0] * len(self.reason_columns)
        for status in message.status[1:MOST_TASKS + 1]:
            name = plain(status.name, LONGEST_NAME).partition(': ')[2]
            if name not in self.tasks and len(self.tasks) >= MOST_TASKS:
                continue
            values = {plain(value.key, LONGEST_NAME): plain(value.value)
                      for value in status.values}
            self.goals.add_status(time, name, values)
            task = self.tasks.setdefault(name, TaskHistory(name))
            _update(task, values, lasted)
            for unit in task.errors:
                _put(errors, self.columns, (name, unit),
                     number(values.get(f'error [{unit}]', '')), math.nan)
            _put(codes, self.reason_columns, name, self._code(values.get('reason', '')), 0.0)
        self.errors.add(time, errors)
        self.reasons.add(time, codes)

    def _take_stop(self, time: float, head: str) -> None:
        """Process the reason of zero commands, or the end of a stop."""
        stop, head = self._stop, plain(head)
        if stop is not None:
            stop.end = time
            if _constant_part(head) == _constant_part(stop.reason):
                return
        self._stop = None
        if head != 'running':
            self._stop = Stop(time, time, head)
            if len(self.stops) < MOST_STOPS:
                self.stops.append(self._stop)
            else:
                self.more_stops += 1

    def _code(self, reason: str) -> float:
        """Return the code of a reason, independent of the order of its parts."""
        text = '; '.join(sorted({_brief(cause) for cause in reason.split('; ')}))
        if text not in self._codes and len(self.texts) >= MOST_REASONS:
            text = 'another reason'
        if text not in self._codes:
            self._codes[text] = float(len(self.texts))
            self.texts.append(text)
        return self._codes[text]

    def _take_joints(self, time: float, topic: str, message: Any) -> None:
        """Process joint states."""
        names, positions = tuple(message.name), message.position
        if len(names) != len(positions) or len(self._joints.keys() | set(names)) > MOST_JOINTS:
            return
        if names not in self._extremes:
            if len(self._extremes) >= MOST_TOPICS:
                return
            self._extremes[names] = positions.copy(), positions.copy()
        low, high = self._extremes[names]
        np.minimum(low, positions, out=low)
        np.maximum(high, positions, out=high)
        if self.moments and time - self.moments[-1].time < EARLY * self._period:
            return
        self._joints.update(zip(names, positions.tolist()))
        if self._markers is not None and (
                not self.moments or self.moments[-1].markers is not self._markers):
            self._marker_bytes += len(self._markers.data)
        self.moments.append(Moment(time, dict(self._joints), self._base, self._markers))
        if len(self.moments) >= 2 * MOST_FRAMES or (
                self._marker_bytes > MOST_MARKER_BYTES and len(self.moments) > 1):
            self._halve_moments()

    def _halve_moments(self) -> None:
        """Drop every second moment, and double the interval."""
        self.moments = self.moments[::2]
        self._period *= 2.0
        self._marker_bytes = sum(len(raw.data) for raw in {
            id(moment.markers): moment.markers for moment in self.moments}.values() if raw)

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
        """Process the velocity of a base."""
        linear, angular = message.linear, message.angular
        if topic not in self.twists and len(self.twists) >= MOST_TOPICS:
            return
        self.twists.setdefault(topic, Series(6)).add(
            time, (linear.x, linear.y, linear.z, angular.x, angular.y, angular.z))

    def _take_odometry(self, time: float, topic: str, message: Any) -> None:
        """Process the pose of a base."""
        point, turn = message.pose.pose.position, message.pose.pose.orientation
        T = pose(rotation_from_quaternion((turn.x, turn.y, turn.z, turn.w)),
                 (point.x, point.y, point.z))
        self._base = message.header.frame_id, message.child_frame_id, T

    def _take_text(self, time: float, topic: str, message: Any) -> None:
        """Store a description of a robot."""
        if topic.endswith('robot_description') and len(message.data) <= MOST_XML_CHARACTERS and (
                topic in self.descriptions or len(self.descriptions) < MOST_TOPICS):
            self.descriptions[topic] = message.data

    def _take_event(self, time: float, topic: str, message: Any) -> None:
        """Store parameters of the controller."""
        if message.node.strip('/') == self.node:
            for parameter in (*message.new_parameters, *message.changed_parameters):
                value = parameter.value
                self._set_parameter(plain(parameter.name, LONGEST_NAME), getattr(
                    value, VALUE_FIELDS[value.type]) if value.type else None)

    def _set_parameter(self, name: str, value: Any) -> None:
        """Store a parameter, unless the limits are exceeded."""
        length = _length(value) - _length(self.parameters.get(name))
        if self._parameter_characters + length <= LONGEST_PARAMETERS and (
                name in self.parameters or len(self.parameters) < MOST_PARAMETERS):
            self._parameter_characters += length
            self.parameters[name] = value


TAKERS: dict[str, Callable[[History, float, str, Any], None]] = {
    STATUS: History._take_status, JOINTS: History._take_joints, NUMBERS: History._take_command,
    TWIST: History._take_twist, ODOMETRY: History._take_odometry, TEXT: History._take_text,
    EVENT: History._take_event}


def _find_node(bag: Bag, node: str) -> str:
    """Return the name of the controller; '' if the bag has no status."""
    found: dict[str, None] = {}
    looked: set[str] = set()
    first, remarks = None, len(bag.remarks)
    for raw in bag.messages(lambda size: None):
        first = raw.stamp if first is None else first
        if raw.kind == STATUS and raw.topic != DIAGNOSTICS and raw.topic not in looked:
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
        statuses = bag.decode(raw).status
    except Unreadable:
        return ''
    name = statuses[0].name if statuses else ''
    keys = {value.key for value in statuses[0].values} if statuses else set()
    return name if {'scale', 'limiting'} <= keys else ''


def _update(task: TaskHistory, values: Mapping[str, str], lasted: float) -> None:
    """Update the history of a task by a status, the previous one having lasted a time [s]."""
    # The previous status applies to the time since then.
    task.known += lasted
    if task.status in ('reached', 'satisfied') and not task.stopped:
        task.reached += lasted
    task.kind, task.level = values.get('type', ''), values.get('level', '')
    status = values.get('status', '')
    task.stopped = status == STOPPED
    # A stop, as at the end of most recordings, must not hide the outcome.
    task.status = task.status or status if task.stopped else status
    for unit, error in errors_of(values).items():
        if math.isnan(error) and unit in task.errors:
            continue
        if unit in task.errors or len(task.errors) < MOST_ERRORS:
            task.errors[unit] = error, number(values.get(f'tolerance [{unit}]', ''))
            if error > task.largest.get(unit, -math.inf):
                task.largest[unit] = error
    for cause in filter(None, values.get('reason', '').split('; ')):
        brief = _brief(cause)
        if brief in task.causes or len(task.causes) < MOST_CAUSES:
            task.causes[brief] = task.causes.get(brief, 0.0) + lasted


def _length(value: Any) -> int:
    """Return the length of the value of a parameter [characters]."""
    if isinstance(value, list):
        return sum(map(_length, value))
    return len(value) if isinstance(value, str) else 8 * np.size(value)


def _put(row: list[float], columns: dict[Any, int], key: object, value: float,
         missing: float) -> None:
    """Set the value in the column of a key; add the column if it is new."""
    column = columns.setdefault(key, len(columns))
    row.extend([missing] * (column + 1 - len(row)))
    row[column] = value


def _brief(cause: str) -> str:
    """Return a cause without numbers, with a list of combined causes reduced to its first."""
    cause = NUMBER.sub('', cause)
    first, comma, _ = cause.partition(', ')
    return f'{first} and others together' if comma and cause.endswith(' together') else cause


def _constant_part(reason: str) -> str:
    """Return a reason without its variable parts."""
    return VARIABLE_PARTS.sub('', reason)


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

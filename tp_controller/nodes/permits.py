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

"""Inputs that allow motion: an enable switch, states of the robot, and its speed scaling."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
import math
import operator
import re
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from tp_controller.errors import in_words, SettingsError
from tp_controller.nodes.log import Log
from tp_controller.nodes.parameters import names_in, Spec
from tp_controller.nodes.stops import Stops

PARAMETERS = (
    Spec('enable_topic', '', 'enable switch (std_msgs/Bool): motion only while it is true (empty: '
         'none)', fixed=True),
    Spec('enable_timeout', 0.5, 'age of the last message of the enable switch from which it '
         'counts as off (0: any age, for a publisher that publishes changes only)', 's', 0.0,
         60.0, True),
    Spec('permit_topics', [''], 'states of the robot that allow motion: topics of one Bool or '
         'number, true or more than 0, or as "topic:field == value" with ==, !=, >, >=, <, <= '
         '(an empty name: none). One that is lost stops the robot until ~/start', fixed=True),
    Spec('speed_scaling_topic', '', 'share of the commanded velocity that the robot carries out '
         '(one number): it follows by that share of its commands (empty: none)', fixed=True),
    Spec('speed_scaling_full', 100.0, 'value on `speed_scaling_topic` that stands for full speed',
         '', 1e-6, 1e6, True),
)
OPERATORS: Mapping[str, Callable[[float, float], bool]] = {
    '==': operator.eq, '!=': operator.ne, '>=': operator.ge, '<=': operator.le,
    '>': operator.gt, '<': operator.lt}
CONDITION = re.compile(r'\s*([\w/~]+)(?::([\w.]+))?\s*(?:(==|!=|>=|<=|>|<)\s*(\S+))?\s*')
# Field of a message where none is named.
DATA = 'data'


class Input:
    """
    The latest number on a topic, whatever its type.

    Parameters
    ----------
    topic : str
        Full name.
    field : str
        Of the message, with dots.

    Attributes
    ----------
    value : float
        NaN before the first message.
    received : float
        When it was received [s].

    """

    def __init__(self, topic: str, field: str = DATA) -> None:
        self.topic, self._field = topic, field
        self._subscription: Subscription | None = None
        self.fault = ''
        self.forget()

    def forget(self) -> None:
        """Forget what was received."""
        self.value, self.received = math.nan, -math.inf

    def look(self, graph: Node, node: Node, clock: Callable[[], float]) -> None:
        """Subscribe as soon as there is a publisher, and forget those that have gone."""
        if not graph.count_publishers(self.topic):
            self.forget()
        elif self._subscription is None and not self.fault:
            self._subscribe(graph, node, clock)

    def close(self, node: Node) -> None:
        """Unsubscribe."""
        if self._subscription is not None:
            node.destroy_subscription(self._subscription)
            self._subscription = None

    def _subscribe(self, graph: Node, node: Node, clock: Callable[[], float]) -> None:
        """Subscribe as the publisher publishes; note why not."""
        offered = graph.get_publishers_info_by_topic(self.topic)
        if not offered:
            return
        package, _, name = offered[0].topic_type.split('/')
        try:
            kind = getattr(import_module(f'{package}.msg'), name)
            float(operator.attrgetter(self._field)(kind()))
        except (ImportError, AttributeError, TypeError, ValueError) as error:
            self.fault = f'{self.topic}: {package}/{name} has no number {self._field!r}: {error}'
            return
        # As it is offered: of a latched topic the last value is received, too.
        qos = offered[0].qos_profile
        self._subscription = node.create_subscription(
            kind, self.topic, partial(self._take, clock),
            QoSProfile(depth=10, reliability=qos.reliability, durability=qos.durability))

    def _take(self, clock: Callable[[], float], message: Any) -> None:
        """Take a message."""
        self.value = float(operator.attrgetter(self._field)(message))
        self.received = clock()


class Condition:
    """
    A condition on an input, as a parameter states it.

    Parameters
    ----------
    text : str
        ``topic``, ``topic:field`` or ``topic:field == value``.
    resolve : callable
        Returns the full name of a topic.

    Raises
    ------
    SettingsError
        The text is no condition.

    """

    def __init__(self, text: str, resolve: Callable[[str], str]) -> None:
        match = CONDITION.fullmatch(text)
        try:
            topic, field, sign, value = match.groups() if match else ('', '', '', '')
            self._value = float({'true': 1.0, 'false': 0.0}.get(value, value)) if sign else 0.0
        except ValueError:
            topic = ''
        if not topic:
            raise SettingsError([f'permit_topics: {text!r} is no condition; valid: topic, '
                                 'topic:field or topic:field == number'])
        self._holds = OPERATORS[sign or '>']
        self.input = Input(_resolved('permit_topics', topic, resolve), field or DATA)

    def fault(self) -> str:
        """Return why motion is not allowed; empty if it is."""
        found = self.input
        if found.fault:
            return found.fault
        if math.isnan(found.value):
            return f'nothing received on {found.topic}'
        if not self._holds(found.value, self._value):
            return f'{found.topic} is {found.value:g}'
        return ''


class Permits:
    """
    The inputs that allow motion.

    The enable switch stops the robot while it is off. A state of the robot that is lost
    after the first motion, as in a protective stop, stops it until ~/start.

    Parameters
    ----------
    node : rclpy.node.Node
        Node of the loop, whose thread receives the inputs.
    topic : callable
        Returns the full name of a topic.
    values : dict
        Values of `PARAMETERS`.
    stops : Stops
    clock : callable
        Returns the time of receipt [s].

    Raises
    ------
    SettingsError
        A permit is no condition.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], values: Mapping[str, Any],
                 stops: Stops, clock: Callable[[], float]) -> None:
        self._node, self._stops, self._clock = node, stops, clock
        self._timeout, self._full = values['enable_timeout'], values['speed_scaling_full']
        self._enable, self._scaling = (
            Input(_resolved(name, values[name], topic)) if values[name] else None
            for name in ('enable_topic', 'speed_scaling_topic'))
        self._conditions: Sequence[Condition] = [
            Condition(text, topic) for text in names_in(values['permit_topics']) or ()]
        self._inputs = [each for each in (self._enable, self._scaling) if each] \
            + [condition.input for condition in self._conditions]

    @property
    def speed(self) -> float:
        """Return the share of the commanded velocity that the robot carries out, 0 to 1."""
        if self._scaling is None or math.isnan(self._scaling.value):
            return 1.0
        return min(max(self._scaling.value / self._full, 0.0), 1.0)

    def look(self, graph: Node, log: Log) -> None:
        """Look for the publishers of the inputs, by another node; called regularly."""
        for each in self._inputs:
            before = each.fault
            each.look(graph, self._node, self._clock)
            if each.fault and not before:
                log.error(f'input ignored: {each.fault}')

    def reason(self, now: float) -> str:
        """Return why motion is not allowed; empty if it is. A state that is lost latches."""
        if not self._inputs:
            return ''
        fault = self.refusal()
        if fault and self._stops.moved:
            self._stops.latch(fault, abrupt=False)
        return fault or self._switched_off(now)

    def refusal(self) -> str:
        """Return which state of the robot forbids a start; empty if none does."""
        return next(filter(None, (condition.fault() for condition in self._conditions)), '')

    def close(self) -> None:
        """Unsubscribe from everything."""
        for each in self._inputs:
            each.close(self._node)

    def _switched_off(self, now: float) -> str:
        """Return why the enable switch counts as off; empty if it is on."""
        switch = self._enable
        if switch is None:
            return ''
        if switch.fault:
            return switch.fault
        if math.isnan(switch.value) or 0.0 < self._timeout < now - switch.received:
            return f'not enabled: nothing received on {switch.topic}'
        return '' if switch.value else f'not enabled: {switch.topic} is false'


def _resolved(parameter: str, name: str, resolve: Callable[[str], str]) -> str:
    """Return the full name of a topic that a parameter names."""
    try:
        return resolve(name)
    except Exception as error:  # of rclpy, and not always of the same type
        raise SettingsError([f'{parameter}: {name!r} is no name of a topic: '
                             f'{in_words(error)}']) from error

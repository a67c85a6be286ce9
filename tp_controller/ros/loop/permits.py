# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs that allow motion: an enable switch, states of the robot, and its speed scaling."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
import math
import operator
import re
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from tp_controller.errors import in_words, SettingsError
from tp_controller.ros.log import Log
from tp_controller.ros.loop.stop_reasons import Stops
from tp_controller.ros.parameters import names_in

OPERATORS: Mapping[str, Callable[[float, float], bool]] = {
    '==': operator.eq, '!=': operator.ne, '>=': operator.ge, '<=': operator.le,
    '>': operator.gt, '<': operator.lt}
CONDITION = re.compile(r'\s*([\w/~]+)(?::([\w.]+))?\s*(?:(==|!=|>=|<=|>|<)\s*(\S+))?\s*')
# Default field of a message.
DATA = 'data'
BOOL = 'std_msgs/msg/Bool'
# Properties of a subscription: type, reliability and durability.
Offer = tuple[str, ReliabilityPolicy, DurabilityPolicy]


class Input:
    """
    Latest number on a topic.

    Parameters
    ----------
    topic : str
        Full name.
    field : str
        Field of the message, with dots.
    kind : str
        Type of the message; empty for any type with the field.

    Attributes
    ----------
    value : float
        NaN before the first message.
    received : float
        Time of its receipt [s].
    fault : str
        Reason for which the topic cannot be received as it is published, or empty.

    """

    def __init__(self, topic: str, field: str = DATA, kind: str = '') -> None:
        self.topic, self.field, self._kind = topic, field, kind
        self._subscription: Subscription | None = None
        self._offer: Offer | None = None
        # Ids of the publishers found in the last query.
        self._publishers: set[bytes] = set()
        self.fault = ''
        self.forget()

    def forget(self) -> None:
        """Discard the received value."""
        self.value, self.received = math.nan, -math.inf

    def look(self, graph: Node, node: Node, clock: Callable[[], float]) -> None:
        """Subscribe with the properties of the publishers; discard the value of vanished ones."""
        found = graph.get_publishers_info_by_topic(self.topic)
        before, self._publishers = self._publishers, {bytes(info.endpoint_gid) for info in found}
        replaced = bool(before) and not before & self._publishers
        if replaced:
            self.forget()
        offer = _offer(found)
        if found and (replaced or offer is None or offer != self._offer):
            # A new subscription receives the last value of a latched topic again.
            self.close(node)
            self.fault = self._subscribe(offer, found, node, clock)
            self._offer = offer
            if self.fault:
                self.forget()

    def close(self, node: Node) -> None:
        """Unsubscribe."""
        if self._subscription is not None:
            node.destroy_subscription(self._subscription)
            self._subscription = None

    def _subscribe(self, offer: Offer | None, found: Sequence[TopicEndpointInfo], node: Node,
                   clock: Callable[[], float]) -> str:
        """Subscribe with offered properties; return the fault if that is not possible."""
        types = sorted({info.topic_type for info in found})
        published = f'{self.topic} is published as {" and ".join(types)}'
        if offer is None:
            return f'{published}; only one type can be received'
        if self._kind and offer[0] != self._kind:
            return f'{published}; it must be {self._kind}'
        package, _, name = offer[0].split('/')
        try:
            kind = getattr(import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError) as error:
            return f'{published}, which cannot be read: {error}'
        try:
            float(operator.attrgetter(self.field)(kind()))
        except (AttributeError, TypeError, ValueError):
            return (f'{published}, which has no number {self.field!r}; '
                    f'its fields: {", ".join(kind.get_fields_and_field_types()) or "none"}')
        self._subscription = node.create_subscription(
            kind, self.topic, partial(self._take, clock),
            QoSProfile(depth=10, reliability=offer[1], durability=offer[2]))
        return ''

    def _take(self, clock: Callable[[], float], message: Any) -> None:
        """Store the number of a message."""
        self.value = float(operator.attrgetter(self.field)(message))
        self.received = clock()


def _offer(found: Sequence[TopicEndpointInfo]) -> Offer | None:
    """Return properties compatible with all publishers, or None if their types differ."""
    profiles = [info.qos_profile for info in found]
    if len({info.topic_type for info in found}) != 1:
        return None
    # Transient local, so that the last value of a latched topic is received, too.
    latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in profiles)
    reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in profiles)
    return (found[0].topic_type,
            ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)


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
        The text is not a valid condition.

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
        # With <, <=, > or >= the value may change all the time: the bound is reported.
        self._bound = f'{sign} {value}' if sign and sign[0] in '<>' else ''
        self.input = Input(_resolved('permit_topics', topic, resolve), field or DATA)

    def fault(self) -> str:
        """Return the reason for which the condition forbids motion, or an empty string."""
        found = self.input
        if found.fault:
            return found.fault
        if found.received == -math.inf:
            return f'nothing received on {found.topic}'
        if self._holds(found.value, self._value) and not math.isnan(found.value):
            return ''
        return f'{found.topic} is ' + (f'not {self._bound}' if self._bound
                                       else f'{found.value:g}')


class Permits:
    """
    Inputs that allow motion.

    The enable switch stops the robot while it is off. A state of the robot that is lost
    after the first motion, as in a protective stop, stops it until ~/start.

    Parameters
    ----------
    node : rclpy.node.Node
        Node of the loop, whose thread receives the inputs.
    topic : callable
        Returns the full name of a topic.
    values : dict
        Values of `tp_controller.ros.declarations.controller.PERMITS`.
    stops : Stops
    clock : callable
        Returns the time of receipt [s].

    Raises
    ------
    SettingsError
        See `read_inputs`.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], values: Mapping[str, Any],
                 stops: Stops, clock: Callable[[], float]) -> None:
        self._node, self._stops, self._clock = node, stops, clock
        self._timeout, self._full = values['enable_timeout'], values['speed_scaling_full']
        self._enable, self._scaling, self._conditions = read_inputs(values, topic)
        self._inputs = [each for each in (self._enable, self._scaling) if each] \
            + [condition.input for condition in self._conditions]

    @property
    def speed(self) -> float:
        """Return the share of the commanded velocity that the robot carries out, 0 to 1."""
        if self._scaling is None or math.isnan(self._scaling.value):
            return 1.0
        return min(max(self._scaling.value / self._full, 0.0), 1.0)

    def look(self, graph: Node, log: Log) -> None:
        """Update the subscriptions with the graph of another node; called regularly."""
        for each in self._inputs:
            before = each.fault
            each.look(graph, self._node, self._clock)
            if each.fault and not before:
                log.error(each.fault)

    def reason(self, now: float) -> str:
        """Return the reason for which motion is not allowed, or empty; a lost state latches."""
        if not self._inputs:
            return ''
        fault = self.refusal()
        if fault and self._stops.moved:
            self._stops.latch(fault, abrupt=False)
        unread = self._scaling.fault if self._scaling else ''
        return fault or unread or self._switched_off(now)

    def refusal(self) -> str:
        """Return the state of the robot that prevents a start, or an empty string."""
        return next(filter(None, (condition.fault() for condition in self._conditions)), '')

    def close(self) -> None:
        """Destroy the subscriptions."""
        for each in self._inputs:
            each.close(self._node)

    def _switched_off(self, now: float) -> str:
        """Return the reason for which the enable switch counts as off, or an empty string."""
        switch = self._enable
        if switch is None:
            return ''
        if switch.fault:
            return f'not enabled: {switch.fault}'
        if math.isnan(switch.value) or 0.0 < self._timeout < now - switch.received:
            return f'not enabled: nothing received on {switch.topic}'
        return '' if switch.value else f'not enabled: {switch.topic} is false'


def read_inputs(values: Mapping[str, Any], resolve: Callable[[str], str]
                ) -> tuple[Input | None, Input | None, list[Condition]]:
    """
    Return the enable switch, the speed scaling and the conditions of parameters.

    Parameters
    ----------
    values : dict
        Values of `tp_controller.ros.declarations.controller.PERMITS`.
    resolve : callable
        Returns the full name of a topic.

    Raises
    ------
    SettingsError
        A permit is not a valid condition, or the same number of a topic is named twice.

    """
    enable, scaling = (
        Input(_resolved(name, values[name], resolve), kind=kind) if values[name] else None
        for name, kind in (('enable_topic', BOOL), ('speed_scaling_topic', '')))
    conditions = [Condition(text, resolve) for text in names_in(values['permit_topics']) or ()]
    named = [('enable_topic', enable), ('speed_scaling_topic', scaling),
             *(('permit_topics', condition.input) for condition in conditions)]
    parameters: dict[tuple[str, str], list[str]] = {}
    for parameter, each in named:
        if each is not None:
            parameters.setdefault((each.topic, each.field), []).append(parameter)
    faults = [f'{topic}:{field} is named by {" and ".join(names)}; it can be named once'
              for (topic, field), names in parameters.items() if len(names) > 1]
    if faults:
        raise SettingsError(faults)
    return enable, scaling, conditions


def _resolved(parameter: str, name: str, resolve: Callable[[str], str]) -> str:
    """Return the full name of a topic that a parameter names."""
    try:
        return resolve(name)
    except Exception as error:  # of rclpy, and not always of the same type
        raise SettingsError([f'{parameter}: {name!r} is no name of a topic: '
                             f'{in_words(error)}']) from error

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Other nodes on the command topics: publishers and subscribers."""

from collections import defaultdict, deque
from functools import partial
import math
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String
from tp_controller.ros.log import Log
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.control_loop import ControlLoop
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher

# Suffix of the names of watchdog nodes.
WATCHDOG = 'watchdog'
# Heartbeat of a watchdog: suffix of its topic, period, and time without one after which the
# watchdog counts as gone [s]; the graph of ROS lists a killed node for 20 s more.
HEARTBEAT, HEARTBEAT_SECONDS, LATE_HEARTBEAT_SECONDS = '/watchdog', 0.1, 1.0
# Largest number of watchdog names: bounds the memory if names change all the time.
MOST_NAMES = 100
# Name that ROS shows for nodes that are not identified yet.
UNKNOWN = '_NODE_NAME_UNKNOWN_'
# Time for discovery of others before the first command; time after its activation in which this
# node counts as the newcomer; time for which a command of others prevents a start [s].
LISTEN_SECONDS, NEW_SECONDS, RECENT_SECONDS = 0.5, 2.0, 1.0
# Number of commands of others that stops the robot, at any interval: a single one may have been in
# transit, or sent by hand.
FOREIGN_COMMANDS = 2
LOOKING = 'looking for other nodes that publish commands'
# Quality of service of the subscriptions to commands of others: lost ones need not be repeated.
FOREIGN_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)


class Competitors:
    """
    Supervision of the command topics: exclusive commands, and counts of their subscribers.

    A newcomer that finds another publisher of its commands stays silent. An active node that
    receives commands of another one stops, reports it, and stays silent. Both last until ~/start,
    which is refused while commands of the other node arrive; after it the next of them stops the
    robot. Once the other node has gone, zeros are published again.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that queries the graph.
    loop_node : rclpy.node.Node
        Node of the loop, whose thread receives the commands of others.
    loop : ControlLoop
    requirements : dict
        Parameters `exclusive`, `require_listener` and `require_watchdog`.
    log : Log

    """

    def __init__(self, node: Node, loop_node: Node, loop: ControlLoop,
                 requirements: dict[str, bool], log: Log) -> None:
        self._node, self._loop_node, self._loop, self._log = node, loop_node, loop, log
        self._exclusive = requirements['exclusive']
        self._required = requirements['require_listener'], requirements['require_watchdog']
        self._made = self._since = boot_time()
        self._others: dict[str, tuple[str, ...]] = {}
        self._subscriptions: dict[str, Subscription] = {}
        # Times of receipt of commands of others, by topic, while there are others.
        self._foreign: defaultdict[str, deque[float]] = defaultdict(
            partial(deque, maxlen=FOREIGN_COMMANDS))
        # Time at which another publisher was last discovered.
        self._found = 0.0
        # Times of the last heartbeats: {(topic, watchdog): time [s]}.
        self._beats: dict[tuple[str, str], float] = {}
        self._pulses = [loop_node.create_subscription(
            String, publisher.topic + HEARTBEAT, partial(self._on_heartbeat, publisher.topic), 10)
            for publisher in loop.commands.watched]
        if self._exclusive:
            loop.commands.silent, loop.unmet = True, LOOKING

    def activate(self) -> None:
        """Treat this node as the newcomer from now on."""
        self._since = boot_time()
        self._others = {}
        self._foreign.clear()
        self.look()

    def look(self) -> None:
        """Update the list of other nodes; called regularly while the node is active."""
        now, loop = boot_time(), self._loop
        if self._exclusive and now - self._made < LISTEN_SECONDS:
            return
        for publisher in loop.commands.publishers:
            self._find_others(publisher, now)
        loop.figures.other_publishers = max(map(len, self._others.values()), default=0)
        loop.unmet = self._find_unmet()
        if loop.commands.silent and not any(self._others.values()):
            loop.commands.silent = False

    def restart(self) -> None:
        """Publish again; the caller has checked `fault`."""
        self._loop.commands.silent = False

    def fault(self) -> str:
        """Return the warning about others that command the robot now, or an empty string."""
        # Commands of a node that was just discovered may not have arrived yet.
        last = max([self._found, *(times[-1] for times in list(self._foreign.values())
                                   if len(times) == FOREIGN_COMMANDS)])
        if boot_time() - last > RECENT_SECONDS:
            return ''
        return next((_publishing(names, topic) for topic, names in self._others.items() if names),
                    '')

    def close(self) -> None:
        """Destroy the subscriptions."""
        for subscription in (*self._subscriptions.values(), *self._pulses):
            self._loop_node.destroy_subscription(subscription)
        self._subscriptions, self._pulses = {}, []

    def _find_others(self, publisher: NumbersPublisher, now: float) -> None:
        """Find the other publishers of a topic."""
        topic, names = publisher.topic, tuple[str, ...]()
        # A cheap query, which is mostly enough: there is no other.
        if self._node.count_publishers(topic) > 1:
            found = sorted(map(_name, self._node.get_publishers_info_by_topic(topic)))
            if _full_name(self._loop_node) in found:
                # Removed once: another node may have the same name.
                found.remove(_full_name(self._loop_node))
            names = tuple(name for name in found if not name.endswith((WATCHDOG, UNKNOWN)))
        if len(names) > len(self._others.get(topic, ())):
            self._log.warning(_publishing(names, topic))
            self._found = now
        self._others[topic] = names
        if not self._exclusive:
            return
        # A node that already moves the robot is no newcomer. A base may share its topic with a
        # joystick or a planner that is silent meanwhile.
        is_new = now - self._since < NEW_SECONDS and self._loop.reported < self._since
        if names and is_new and publisher is self._loop.commands.output.publisher:
            self._stop(names, topic)
        if names and topic not in self._subscriptions:
            self._subscriptions[topic] = self._loop_node.create_subscription(
                publisher.kind, topic, lambda raw: self._on_foreign(publisher, raw), FOREIGN_QOS,
                raw=True)
        elif not names and topic in self._subscriptions:
            self._loop_node.destroy_subscription(self._subscriptions.pop(topic))
            self._foreign.pop(topic, None)

    def _on_foreign(self, publisher: NumbersPublisher, raw: Any) -> None:
        """Record a serialized command of another node, on the thread of the loop."""
        if publisher.is_own(raw):
            return
        times, names = self._foreign[publisher.topic], self._others.get(publisher.topic)
        times.append(boot_time())
        if len(times) == FOREIGN_COMMANDS and names and self._loop.active:
            self._stop(names, publisher.topic)

    def _stop(self, names: tuple[str, ...], topic: str) -> None:
        """Stop the robot until ~/start, and leave it to the others."""
        self._loop.stops.latch(_publishing(names, topic))
        self._loop.commands.withdraw()

    def _find_unmet(self) -> str:
        """Count the subscribers of the commands; return the requirement that is not met."""
        commands, figures = self._loop.commands, self._loop.figures
        counts = {publisher: self._count_subscribers(publisher)
                  for publisher in commands.publishers}
        listeners = {publisher: count for publisher, (count, _) in counts.items()}
        watchdogs = {publisher: counts[publisher][1] for publisher in commands.watched}
        figures.listeners = min(listeners.values())
        figures.watchdogs = min(watchdogs.values(), default=0)
        for required, counted, what in zip(self._required, (listeners, watchdogs),
                                           ('node listens to', 'watchdog listens to')):
            for publisher, count in counted.items():
                if required and not count:
                    return f'no {what} {publisher.topic}'
        return ''

    def _count_subscribers(self, publisher: NumbersPublisher) -> tuple[int, int]:
        """Return the numbers of nodes, and of watchdogs, that subscribe to a topic."""
        own = _full_name(self._loop_node)
        # Subscriptions of another type receive nothing.
        names = {_name(info) for info
                 in self._node.get_subscriptions_info_by_topic(publisher.topic)
                 if info.topic_type == publisher.type_name} - {own}
        watchdogs = {name for name in names if name.endswith(WATCHDOG)}
        return len(names - watchdogs), self._count_alive(watchdogs, publisher.topic)

    def _count_alive(self, watchdogs: set[str], topic: str) -> int:
        """Return the number of live watchdogs of a topic; other names are ignored."""
        if not watchdogs:
            return 0
        now, beating = boot_time(), set(map(_name, self._node.get_publishers_info_by_topic(
            topic + HEARTBEAT)))
        return sum(name not in beating
                   or now - self._beats.get((topic, name), -math.inf) < LATE_HEARTBEAT_SECONDS
                   for name in watchdogs)

    def _on_heartbeat(self, topic: str, message: String) -> None:
        """Record the heartbeat of a watchdog, on the thread of the loop."""
        if len(self._beats) >= MOST_NAMES:
            self._beats.clear()
        self._beats[topic, message.data] = boot_time()


def _name(info: TopicEndpointInfo) -> str:
    """Return the name of the node of an endpoint, with its namespace."""
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _full_name(node: Node) -> str:
    """Return the name of a node, with its namespace."""
    return f'{node.get_namespace().rstrip("/")}/{node.get_name()}'


def _publishing(names: tuple[str, ...], topic: str) -> str:
    """Return the warning about other publishers of commands."""
    listed = ', '.join(name.removesuffix('_loop') for name in names)
    return f'{listed} {"publishes" if len(names) == 1 else "publish"} on {topic}, too'

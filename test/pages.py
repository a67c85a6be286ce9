# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A page with a made-up controller: tests say what comes from the network and from browsers."""

import asyncio
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import msgspec
from rclpy.serialization import serialize_message
from robots import planar
from std_msgs.msg import String
from tp_controller.ros.client.client import Client
from tp_controller.ros.client.received_status import subscribe_status
from tp_controller.ros.declarations.spec import ROBOT
from tp_controller.tools.view.incoming import checked, MESSAGES
from tp_controller.tools.view.link import Link
from tp_controller.tools.view.page import Page
from viser import _messages

CONTROLLER = 'tp_controller'
BROWSER = 7


class Answer:
    """An answer of a service that has come."""

    def __init__(self, answer):
        self._answer = answer

    def done(self):
        """Return True."""
        return True

    def result(self):
        """Return the answer."""
        return self._answer


class MadeUpNode:
    """
    A node that hears what a test says.

    Attributes
    ----------
    takers : dict
        {topic: what is called with the bytes of a message}

    """

    def __init__(self):
        self.takers = {}

    def create_subscription(self, kind, topic, callback, qos, raw):
        """Subscribe to a topic."""
        assert raw
        self.takers[topic] = callback
        return topic

    def destroy_subscription(self, topic):
        """Leave a topic."""
        del self.takers[topic]

    def get_subscriber_names_and_types_by_node(self, *_):
        """Return no topics."""
        return []


class Somebody:
    """A browser."""


class MadeUpClient(Client):
    """
    A client that talks to a test.

    Attributes
    ----------
    calls : list of str
        The services that were called.
    answers : dict
        {service: what it answers}
    sent : list of (str, str, object)
        What was published: task, topic, message.

    """

    def __init__(self):
        self.controller, self.status = CONTROLLER, None
        self.node = MadeUpNode()
        self.calls, self.answers, self.sent = [], {}, []
        self.topics = {}
        subscribe_status(self.node, CONTROLLER, self._on_status)

    def catch_up(self):
        """Take nothing: `hear` did."""

    def tasks(self):
        """Return the goal topics that the test says there are."""
        return self.topics

    def publish(self, task, topic, message):
        """Note what is published; it must be a message that can be sent."""
        serialize_message(message)
        self.sent.append((task, topic, message))

    def service(self, kind, name):
        """Return a service, which is there."""
        return SimpleNamespace(service_is_ready=lambda: True)

    def call(self, kind, name, request):
        """Note which service is called."""
        self.calls.append(name)
        return Answer(self.answers[name]) if name in self.answers else None


class MadeUpController:
    """
    A page and its controller.

    Parameters
    ----------
    server : PageServer
    robot : tp_controller.Robot
        By default a planar arm.

    """

    def __init__(self, server, robot=None):
        server.scene.reset()
        server.gui.reset()
        # Without one, viser drops what comes.
        server._connected_clients[BROWSER] = Somebody()
        self.server, self.client = server, MadeUpClient()
        self.link = Link(self.client)
        self.page = Page(server, self.link)
        self.link.values = {**{spec.name: spec.default for spec in ROBOT}, 'joints': [''],
                            'stack': ''}
        self.link._ask = lambda: None
        self.link._on_description(String(data=(robot or planar()).urdf))
        self.update()

    def hear(self, topic, message):
        """Let the page hear a message, given as one or as bytes."""
        self.client.node.takers[topic](
            message if isinstance(message, bytes) else serialize_message(message))

    def tell(self, head='running', **tasks):
        """Send a status; of each task {key: value}."""
        self.hear(f'/{CONTROLLER}/status', status(head, **tasks))

    def update(self):
        """Update the page, texts included."""
        self.page._texts_due = 0.0
        self.page.update()

    def do(self, message):
        """Do what a browser sends, if it is taken; return whether it is."""
        raw = message if isinstance(message, bytes) else msgspec.msgpack.encode(message)
        taken = checked(raw, MESSAGES, self.server.gui._gui_input_handle_from_uuid.get)
        if taken is None:
            return False
        message = _messages.Message.deserialize(taken)
        server = self.server._websock_server
        asyncio.run_coroutine_threadsafe(
            server._handle_incoming_message(BROWSER, message), self.server._event_loop).result()
        return True

    def set_value(self, widget, value=True):
        """Give a widget another value as a browser does; return whether it is taken."""
        return self.do({'type': 'GuiUpdateMessage', 'uuid': widget._impl.uuid,
                        'updates': {'value': value}})


def status(head='running', **tasks):
    """Return a status; of each task {key: value}."""
    def entry(name, message, values):
        return DiagnosticStatus(name=name, message=message, values=[
            KeyValue(key=key, value=str(value)) for key, value in values.items()])
    return DiagnosticArray(status=[
        entry(CONTROLLER, head, {}),
        *(entry(f'{CONTROLLER}: {name}', '', values) for name, values in tasks.items())])

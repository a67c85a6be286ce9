# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscription to the status of a controller."""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from tp_controller.errors import TpControllerError
from tp_controller.ros.bounded_subscription import subscribe
from tp_controller.ros.client.status import ControllerStatus, received


def subscribe_status(node: Node, controller: str,
                     callback: Callable[[ControllerStatus], None], depth: int = 10) -> None:
    """Subscribe to the status of a controller; raise `TpControllerError` for an invalid name."""
    def take(message: DiagnosticArray) -> None:
        # Other nodes may have topics of this name and type, too.
        if message.status and message.status[0].name == controller:
            callback(received(message))

    try:
        subscribe(node, DiagnosticArray, f'/{controller}/status', take, depth)
    except NameValidationException as error:
        raise TpControllerError(f'{controller!r} cannot be the name of a node') from error

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

"""Sanitization of a received status: bounded size and printable text."""

from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from tp_controller.errors import TpControllerError
from tp_controller.ros.bounded_subscription import subscribe
from tp_controller.untrusted import plain

# Largest number of tasks, and of entries per task.
MOST_RECEIVED_TASKS, MOST_VALUES = 200, 64
# Longest name [characters].
LONGEST_KEY = 256


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


def received(message: DiagnosticArray) -> DiagnosticArray:
    """Return a status with printable text, cut to the bounds of its size."""
    message.status = [_shown(status) for status in message.status[:MOST_RECEIVED_TASKS + 1]]
    return message


def _shown(status: DiagnosticStatus) -> DiagnosticStatus:
    """Return the entry of the controller, or of a task, with printable text."""
    status.name, status.message = plain(status.name, LONGEST_KEY), plain(status.message)
    status.values = status.values[:MOST_VALUES]
    for value in status.values:
        value.key, value.value = plain(value.key, LONGEST_KEY), plain(value.value)
    return status

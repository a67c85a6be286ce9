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

"""Private parts of rclpy that the nodes need, since it has no public ones for the purpose."""

from collections.abc import Collection
from typing import Any, cast

from rclpy._rclpy_pybind11 import NodeNameNonExistentError, RCLError
from rclpy.node import Node
from rclpy.parameter import Parameter
from tp_controller.ros import Message

__all__ = ['NodeNameNonExistentError', 'RCLError', 'declared_names', 'initial_parameters',
           'refuse_invalid_transitions']


def initial_parameters(node: Node) -> dict[str, Parameter]:
    """Return {name: parameter} that a node was started with; changes act on declarations."""
    return cast(dict[str, Parameter], node._parameter_overrides)


def declared_names(node: Node) -> Collection[str]:
    """Return the names of the declared parameters of a node."""
    return cast(Collection[str], node._parameters)


def refuse_invalid_transitions(node: Node) -> None:
    """Report an invalid transition of a lifecycle node as failed, instead of ending the node."""
    service = cast(Any, node)._service_change_state
    change = service.callback

    def refusing(request: Message, response: Message) -> Message:
        try:
            return change(request, response)
        except RCLError:
            response.success = False
            return response

    service.callback = refusing

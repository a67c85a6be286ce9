# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Context of ROS for programs that talk to a controller."""

from rclpy import init
from rclpy.context import Context
from tp_controller.errors import TpControllerError


def new_context() -> Context:
    """Return an initialised context; raise `TpControllerError` if ROS cannot start here."""
    context = Context()
    try:
        init(context=context, args=[])
    except (RuntimeError, ValueError) as error:
        raise TpControllerError(f'ROS 2 cannot start: {error}') from error
    return context

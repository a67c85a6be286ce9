# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Locked joints as a parameter."""

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from tp_controller.ros.declarations.controller import LOCKED
from tp_controller.ros.log import Log
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.parameters import names_in


class LockParameter:
    """
    Parameter ``locked_joints``: the locks of a user, and those of the loop.

    Parameters
    ----------
    node : rclpy.node.Node
        Node of the parameter.
    controller : SharedController
        Controller of a robot, at rest.
    values : mapping
        Parameters of the node.
    log : Log

    Raises
    ------
    RobotError
        The robot has no such joint.

    """

    def __init__(self, node: Node, controller: SharedController, values: Mapping[str, Any],
                 log: Log) -> None:
        self._node, self._controller, self._log = node, controller, log
        self._names: list[str] = []
        self.check(values)
        self.apply(values)

    def check(self, given: Mapping[str, Any]) -> None:
        """Raise `RobotError` if the robot lacks a joint among {parameter: value}."""
        self._controller.check_joints(_named(given.get(LOCKED, [''])))

    def apply(self, given: Mapping[str, Any]) -> None:
        """Lock and unlock the joints by which a checked value differs from the one before."""
        if LOCKED not in given:
            return
        names, before = _named(given[LOCKED]), self._names
        added = [name for name in names if name not in before]
        removed = [name for name in before if name not in names]
        with self._controller.mutex:
            self._controller.lock(added, boot_time())
            self._controller.unlock(removed, boot_time())
        self._names = names
        if added:
            self._log.warning(f'locked: {", ".join(added)}')
        if removed:
            self._log.info(f'unlocked: {", ".join(removed)}')

    def look(self) -> None:
        """Add the locks of the loop to the parameter."""
        added = [name for name in self._controller.locked if name not in self._names]
        if added:
            self._node.set_parameters([Parameter(LOCKED, value=[*self._names, *added])])


def _named(value: Sequence[str]) -> list[str]:
    """Return the joints that a value of the parameter names."""
    return names_in(value) or []

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Clocks of the loop: one for timeouts, one for the motion of the robot."""

import time

from rclpy.node import Node

CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


def boot_time() -> float:
    """
    Return the time since the machine was booted [s].

    This clock cannot be set, and it goes on while the machine is suspended.
    """
    return time.clock_gettime(CLOCK)


class RobotClock:
    """
    Clock of the robot: that of its simulation, if there is one, else the clock of timeouts.

    Parameters
    ----------
    node : rclpy.node.Node
        Node with the parameter `use_sim_time`.

    Attributes
    ----------
    simulated : bool
        Time is that of a simulation (/clock), and may stand still.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.simulated: bool = node.get_parameter('use_sim_time').value

    def time(self, now: float) -> float:
        """Return the time on this clock [s] at a time `now` on the clock of timeouts [s]."""
        return self._node.get_clock().now().nanoseconds * 1e-9 if self.simulated else now

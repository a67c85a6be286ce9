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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Driving a robot by hand: gamepads, 6-DoF mice, pose streams and the keyboard.

Begin with `drive`, which turns the input of a device into a twist. `mapping` and `dead_man` know
neither ROS nor a clock; `teleop_node` connects them to topics.
"""

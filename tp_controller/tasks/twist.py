# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Desired velocity of a frame (slides (1), (3))."""

from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.velocity import VelocityTask


class Twist(VelocityTask, FrameTask):
    """
    Move a frame with a desired velocity, linear and angular (slides (1), (3)).

    The goal is a twist (6,), linear then angular [m/s, rad/s], in the axes of the reference
    frame. After a timeout the demand is zero.
    """

    type_name = 'twist'
    without = ('approach', 'gain', 'tolerance')
    example = {'frame': 'panda_hand_tcp'}
    make_twin = FrameTask.twin_of_velocity
    sketch_parts = {'frame': True}

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the simulator node, besides those of limits."""

from tp_controller.ros.declarations.spec import ROBOT, Spec

PARAMETERS = (
    *ROBOT,
    Spec('command_joints', [''], 'joints in the order of the commands; all others stand '
         'still (an empty name: all that can be driven)', fixed=True),
    Spec('rate', 200.0, 'joint states, and odometry of a base, per simulated second', 'Hz',
         1.0, 5000.0, True),
    Spec('speed', 1.0, 'simulated seconds per second', '', 0.01, 1000.0, True),
    Spec('publish_clock', False, 'publish simulated time on /clock', fixed=True),
    Spec('publish_tf', False,
         'publish the odometry of a moving base as tf, too, for RViz; needs tf2_ros', fixed=True),
    Spec('command_timeout', 0.1, 'time without a command after which the joints, or the base, '
         'stop, of the wall clock', 's', 1e-3, 10.0, True),
    Spec('state_deadline', 0.0,
         'deadline (QoS) of joint states that is promised, of the wall clock (0: none)', 's', 0.0,
         60.0, True),
    Spec('initial_positions', '', 'positions at the start, as YAML {joint: position} or a file '
         'of it, with base_x, base_y … base_yaw for a moving base; other joints start at zero, or '
         'in the middle of their range where zero is outside or near a limit',
         fixed=True),
    Spec('noise', 0.0, 'standard deviation of measured positions', 'rad or m', 0.0, 1.0, True),
    Spec('delay', 0.0, 'time from a command to its effect, simulated', 's', 0.0, 10.0, True),
    Spec('lag', 0.0, 'time constant of the drives, first order', 's', 0.0, 10.0, True),
    Spec('drop', 0.0, 'share of commands and of joint states that get lost', '', 0.0, 0.99,
         True),
    Spec('seed', 0, 'seed of noise and loss, not negative', fixed=True),
)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the teleop node."""

from tp_controller.ros.declarations.spec import Spec
from tp_controller.tools.teleop.mapping import DIRECTIONS

SUM = ', a sum such as axis 1 - button 13'
PARAMETERS = (
    Spec('controller', 'tp_controller', 'name of the controller node, with its namespace',
         fixed=True),
    Spec('task', 'tool', 'task that is driven: of the type twist, or pose with `pose_topic`',
         fixed=True),
    Spec('joy_topic', 'joy', 'axes and buttons of the device (sensor_msgs/Joy)', fixed=True),
    Spec('twist_topic', '', 'twists of the device, in place of axes (empty: none)', fixed=True),
    Spec('twist_stamped', True, 'type of `twist_topic`: TwistStamped, else Twist', fixed=True),
    Spec('pose_topic', '', 'poses of the device in its own world, that the tool follows, in '
         'place of axes (empty: none)', fixed=True),
    Spec('pose_type', 'PoseStamped', 'type of `pose_topic`: PoseStamped or Odometry', fixed=True),
    Spec('unitless', True, 'twists are deflections from -1 to 1, that are scaled; else m/s and '
         'rad/s', fixed=True),
    Spec('x', '', f'deflection along x{SUM} (empty: none)', fixed=True),
    *(Spec(name, '', f'the same {"about" if name[0] == "r" else "along"} {name[-1]}', fixed=True)
      for name in DIRECTIONS if name != 'x'),
    Spec('dead_man', '', f'switch that has to be pressed for motion{SUM} (empty: none, a device '
         'at rest counts as open)', fixed=True),
    Spec('dead_man_topic', '', 'switch in place of `dead_man`, for poses (std_msgs/Bool; empty: '
         'none)', fixed=True),
    Spec('gripper', '', f'button whose state is published on ~/gripper{SUM} (empty: none)',
         fixed=True),
    Spec('rest_first', True, 'after the start and after a loss the dead-man switch has to be open '
         'once, or a device without one at rest', fixed=True),
    Spec('timeout', 0.2, 'age of the last message of the device from which zeros are sent', 's',
         0.01, 10.0, True),
    Spec('ramp', 0.3, 'time from the press of the dead-man switch to full speed', 's', 0.0, 10.0,
         True),
    Spec('rate', 50.0, 'twists per second', 'Hz', 1.0, 1000.0, True),
    Spec('linear_scale', 0.1, 'speed at full deflection', 'm/s', 0.0, 10.0),
    Spec('angular_scale', 0.5, 'angular speed at full deflection', 'rad/s', 0.0, 20.0),
    Spec('deadband', 0.1, 'deflection up to which an axis counts as at rest', '', 0.0, 0.9),
    Spec('frame', '', 'frame of the robot that the twists are expressed in (empty: that of the '
         'messages, else the reference of the task); of poses, that of the tool or the reference'),
    Spec('pose_scale', 1.0, 'motion of the tool per motion of the device', '', 0.0, 10.0),
    Spec('pose_turn_scale', 1.0, 'angle of the tool per angle of the device', '', 0.0, 10.0),
    Spec('pose_deadband', 0.001, 'motion of the device that moves nothing, after each change of '
         'direction', 'm', 0.0, 0.1),
    Spec('pose_turn_deadband', 0.005, 'the same of its angle', 'rad', 0.0, 0.5),
    Spec('pose_axes', [0.0, 0.0, 0.0, 1.0], 'quaternion x, y, z, w that turns vectors of the '
         'world of the device to the axes of `frame`', fixed=True),
    Spec('pose_forward', '', 'axis of the device (x, -x, y, …) that points along x of `frame`, '
         'seen from above, at each press (empty: as `pose_axes` says)', fixed=True),
    Spec('pose_largest_step', 0.15, 'distance of two successive poses of the device that opens '
         'the switch', 'm', 0.001, 10.0, True),
    Spec('pose_largest_turn', 0.6, 'the same of their angle', 'rad', 0.01, 4.0, True),
    Spec('pose_largest_lag', 0.3, 'distance of the tool from its goal that opens the switch', 'm',
         0.01, 10.0, True),
    Spec('pose_largest_turn_lag', 1.0, 'the same of their angle', 'rad', 0.01, 4.0, True),
)

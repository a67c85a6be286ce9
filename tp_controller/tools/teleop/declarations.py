# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the teleop node."""

from tp_controller.ros.declarations.spec import Spec
from tp_controller.tools.teleop.mapping import DIRECTIONS

SUM = ', as a sum such as axis 1 or button 14 - button 13'
PARAMETERS = (
    Spec('controller', 'tp_controller', 'name of the controller node, with its namespace',
         fixed=True),
    Spec('task', 'tool', 'task that is driven, of the type twist', fixed=True),
    Spec('joy_topic', 'joy', 'axes and buttons of the device (sensor_msgs/Joy)', fixed=True),
    Spec('twist_topic', '', 'twists of the device, in place of axes (empty: none)', fixed=True),
    Spec('twist_stamped', True, 'type of `twist_topic`: TwistStamped, else Twist', fixed=True),
    Spec('unitless', True, 'twists are deflections from -1 to 1, that are scaled; else m/s and '
         'rad/s', fixed=True),
    *(Spec(name, '', f'deflection {"about" if name[0] == "r" else "along"} {name[-1]}{SUM} '
           '(empty: none)', fixed=True) for name in DIRECTIONS),
    Spec('dead_man', '', f'switch that has to be pressed for motion{SUM} (empty: none, a device '
         'at rest is one that is not pressed)', fixed=True),
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
    Spec('frame', '', 'frame of the robot that the twists are expressed in, such as that of the '
         'tool (empty: that of the messages, else the reference of the task)'),
)

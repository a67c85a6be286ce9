# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the controller node, besides those of limits and tasks."""

from dataclasses import fields
import math

from tp_controller.control.settings import Settings
from tp_controller.ros.declarations.spec import EQUAL, ROBOT, Spec

# Largest number of processors that Linux can be configured for.
MOST_PROCESSORS = 8192
# Inputs that allow motion.
PERMITS = (
    Spec('enable_topic', '', 'enable switch (std_msgs/Bool): motion only while it is true (empty: '
         'none)', fixed=True),
    Spec('enable_timeout', 0.5,
         'age of the last message of the enable switch from which it counts as off (0: any '
         'age, for a publisher of changes only)', 's', 0.0,
         60.0, True),
    Spec('permit_topics', [''],
         'states of the robot that all have to hold for motion: topics of one Bool or number, '
         'true or more than 0, or "topic:field == value" with ==, !=, >, >=, <, <=; one that '
         'is lost stops the robot until ~/start (an empty name: none)', fixed=True),
    Spec('speed_scaling_topic', '',
         'topic of the share of the commanded velocity that the robot carries out, one number '
         '(empty: none)', fixed=True),
    Spec('speed_scaling_full', 100.0, 'value on `speed_scaling_topic` that stands for full speed',
         '', 1e-6, 1e6, True),
)
# Names, descriptions and ranges are defined by the fields of Settings.
SETTINGS = tuple(
    Spec(item.name, EQUAL if item.name == 'weights' else item.default,
         item.metadata['description']
         + (f' ({", ".join(item.metadata["valid"])})' if 'valid' in item.metadata else ''),
         item.metadata['unit'], item.metadata.get('lower', -math.inf),
         item.metadata.get('upper', math.inf))
    for item in fields(Settings) if item.name != 'period')
LOCKED = 'locked_joints'
# Reactions to a joint that does not follow its commands.
STOP, LOCK = REACTIONS = ('stop', 'lock')
OUTPUTS = ('velocity', 'position', 'trajectory')
PARAMETERS = (
    *ROBOT,
    Spec('joints', [''], 'driven joints, in the order of `weights` (an empty name: all that can '
         'be driven)', fixed=True),
    Spec('command_joints', [''], 'the driven joints in the order of the commands (an empty name: '
         'as `joints`)', fixed=True),
    Spec('output', 'velocity', 'commands for the joints: velocities; or, for a robot without an '
         'interface for them, positions, as such or as trajectories of one point '
         f'({", ".join(OUTPUTS)})', fixed=True, valid=OUTPUTS),
    Spec('lead', 0.2, 'time by which a robot may be late before commanded positions wait for it; '
         'at least the lag of its drives', 's', 0.0, 10.0, True),
    Spec('cmd_vel_stamped', True, 'publish cmd_vel as TwistStamped, as diff_drive_controller '
         'requires it since Jazzy; else as Twist', fixed=True),
    Spec('stack', '', 'the tasks, the highest priority first: YAML text, a path, or '
         'package://<package>/<path>'),
    Spec('rate', 100.0, 'cycles per second; 0: one cycle for each complete joint state', 'Hz',
         0.0, 2000.0, True),
    Spec('state_timeout', 0.1, 'age of joint states, and of odometry, since their receipt, '
         'from which zeros are commanded', 's', 1e-3, 10.0, True),
    Spec('check_stamps', True, 'ignore joint states that are older than `state_timeout` by their '
         'stamps, or ahead of time', fixed=True),
    Spec('jump_tolerance', 0.1, 'distance that a joint may move beyond what its velocity limit, '
         'or twice its command, allows before the robot is stopped until ~/start (inf: any '
         'distance)', 'rad or m', 0.0, math.inf, True),
    Spec('odometry_jump_tolerance', 0.25, 'the same for the base and its odometry; at least the '
         'corrections of the localisation', 'm or rad', 0.0, math.inf, True),
    Spec('limit_tolerance', 0.05, 'distance of a joint beyond a position limit at which the '
         'robot is stopped until ~/start (inf: never)', 'rad or m', 0.0, math.inf),
    Spec(LOCKED, [''], 'driven joints, or velocities of a moving base, that stay where they are '
         'while the others go on (an empty name: none)'),
    Spec('follow_window', 1.0, 'time after which a joint, or a base, that does not follow its '
         'command stops the robot until ~/start (0: never)', 's', 0.0, 60.0, True),
    Spec('on_not_following', STOP, 'reaction to a joint that alone does not follow: stop, or lock '
         f'it, and go on with the others ({", ".join(REACTIONS)})', valid=REACTIONS),
    Spec('settle_time', 0.3, 'time that everything has to be in order before motion resumes, '
         'after a stop that ends by itself', 's', 0.0, 60.0, True),
    Spec('exclusive', True, 'stop until ~/start, and publish nothing, if another node publishes '
         'the same commands', fixed=True),
    Spec('require_listener', False, 'stop while no node other than watchdogs listens to the '
         'commands', fixed=True),
    Spec('require_watchdog', False, 'stop while no node whose name ends in watchdog listens to '
         'the commands', fixed=True),
    Spec('stop_deceleration', 0.0, 'deceleration of a stop while positions are known, at most '
         'that of the drives; no stop takes longer than 2 s (0: zeros at once)', 'rad/s² or m/s²',
         0.0, 1e6),
    Spec('keep_goals', False, 'after a deactivation go on to the goals of before; else the tasks '
         'stay where they are'),
    *PERMITS,
    Spec('watchdog_timeout', 0.2, 'time without a completed cycle after which zeros are commanded',
         's', 0.01, 10.0, True),
    Spec('command_deadline', 0.0, 'deadline (QoS) of the commands that is promised, which costs '
         'time in every cycle (0: none)', 's', 0.0, 60.0, True),
    Spec('state_deadline', 0.0, 'deadline (QoS) of joint states that is requested (0: none)', 's',
         0.0, 60.0, True),
    Spec('autostart', True, 'configure and activate the node at once', fixed=True),
    Spec('realtime_priority', 0, 'priority of the thread of the loop, from 1 to 99 (SCHED_FIFO); '
         '0: as other threads', '', 0, 99, True),
    Spec('processor', -1, 'the only processor that this thread runs on; -1: any', '', -1,
         MOST_PROCESSORS - 1, True),
    Spec('lock_memory', False, 'lock the memory of the process', fixed=True),
    # A collection of the objects that the imports leave takes 50 ms without a command: once in
    # 10 s while a stack is read 50 times a second.
    Spec('freeze_garbage', True, 'exclude the objects of the start from garbage collection',
         fixed=True),
    Spec('status_rate', 10.0, 'status and marker messages per second', 'Hz', 0.1, 1000.0, True),
    *SETTINGS,
)

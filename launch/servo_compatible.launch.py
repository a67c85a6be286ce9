# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Start the controller behind the topics of MoveIt Servo, for programs that speak to it."""

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_entity import LaunchDescriptionEntity
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir
from launch_ros.actions import Node, SetRemap
from tp_controller.resources import find_file
from tp_controller.ros.declarations.controller import OUTPUTS

# Name of the node of Servo, below which programs look for its topics.
SERVO = 'servo_node'
SETTINGS = 'package://tp_controller/config/teleop/servo.yaml'
# The tool, and below it the posture of the start.
STACK = '[tool: {{type: {command_type}, frame: {ee_frame}}}, posture: {{type: posture}}]'


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'robot', default_value='',
            description='file of the robot, as for controller.launch.py; empty: as the parameter '
                        'file says, else the URDF of the topic robot_description'),
        DeclareLaunchArgument(
            'ee_frame', default_value='panda_hand_tcp',
            description='frame of the tool, for the stack of this file'),
        DeclareLaunchArgument(
            'command_type', default_value='twist', choices=['twist', 'pose'],
            description='commands that the tool follows: delta_twist_cmds or pose_target_cmds'),
        DeclareLaunchArgument(
            'command_in_type', default_value='unitless', choices=['unitless', 'speed_units'],
            description='twists from -1 to 1, that are scaled, or in m/s and rad/s'),
        DeclareLaunchArgument(
            'scale_linear', default_value='0.4', description='speed of a unitless 1 [m/s]'),
        DeclareLaunchArgument(
            'scale_rotational', default_value='0.8',
            description='angular speed of a unitless 1 [rad/s]'),
        DeclareLaunchArgument(
            'stack', default_value='',
            description='other tasks, the highest priority first, one of them named tool: YAML '
                        'text, a path or package://<package>/<path>; empty: as the parameter '
                        'file says, else the tool and a posture below it'),
        DeclareLaunchArgument(
            'params_file', default_value='',
            description='parameter file of the controller: a path or package://<package>/<path>'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of the nodes and their topics'),
        DeclareLaunchArgument(
            'output', default_value='', choices=['', *OUTPUTS],
            description='commands for the joints: velocity, position or trajectory; empty: as '
                        'the parameter file says, else velocity'),
        DeclareLaunchArgument(
            'commands', default_value='',
            description='topic of the commands for the joints; empty: that of the output'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false', choices=['true', 'false'],
            description='take the time from /clock'),
        DeclareLaunchArgument(
            'rviz', default_value='false', choices=['true', 'false'],
            description='start RViz: robot model, frames, goals of the tasks'),
        OpaqueFunction(function=_nodes),
    ])


def _nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the controller, and the translator of twists where they are the commands."""
    given = {name: LaunchConfiguration(name).perform(context) for name in (
        'robot', 'stack', 'params_file', 'namespace', 'output', 'commands', 'use_sim_time',
        'rviz')}
    twists = LaunchConfiguration('command_type').perform(context) == 'twist'
    if not (given['stack'] or given['params_file']):
        given['stack'] = STACK.format(**{name: LaunchConfiguration(name).perform(context)
                                         for name in ('command_type', 'ee_frame')})
    controller = GroupAction([
        SetRemap('~/tool/goal', f'{SERVO}/pose_target_cmds'),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource([ThisLaunchFileDir(), '/controller.launch.py']),
            launch_arguments=given.items())])
    return [controller, *([_translator(context, given['namespace'])] if twists else [])]


def _translator(context: LaunchContext, namespace: str) -> Node:
    """Return the node that turns the twists of Servo into those of the task."""
    linear, rotational = (_number(context, name) for name in ('scale_linear', 'scale_rotational'))
    unitless = LaunchConfiguration('command_in_type').perform(context) == 'unitless'
    return Node(
        package='tp_controller', executable='teleop_node', name=SERVO, namespace=namespace,
        parameters=[str(find_file(SETTINGS)), {
            'controller': f'{namespace}/tp_controller', 'unitless': unitless,
            'linear_scale': linear, 'angular_scale': rotational}],
        output='screen')


def _number(context: LaunchContext, name: str) -> float:
    """Return the value of an argument that is a number."""
    text = LaunchConfiguration(name).perform(context)
    try:
        return float(text)
    except ValueError:
        raise RuntimeError(f'{name} must be a number, not {text!r}') from None

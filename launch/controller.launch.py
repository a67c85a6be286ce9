# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Start the controller node; RViz beside it with ``rviz:=true``."""

import shlex

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
from tp_controller.resources import find_file
from tp_controller.ros.declarations.controller import OUTPUTS

CONFIG = [FindPackageShare('tp_controller'), 'config']
# Any robot can carry it out: it stays where it is until a goal arrives.
DEFAULT_STACK = '- posture: {type: posture}'
# Those of the outputs.
TOPICS = ('velocity_controller/commands', 'position_controller/commands',
          'joint_trajectory_controller/joint_trajectory')
# What RViz needs for goals that can be dragged.
INTERACTIVE = ('interactive_goals/update', 'interactive_goals/feedback',
               'interactive_goals/get_interactive_markers')


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'robot', default_value='',
            description='file of the robot, URDF, xacro, MJCF or DH table (.yaml): a path or '
                        'package://<package>/<path>; empty: as the parameter file says, else the '
                        'URDF of the topic robot_description'),
        DeclareLaunchArgument(
            'xacro_arguments', default_value='',
            description='arguments of a xacro, as "name:=value name:=value"'),
        DeclareLaunchArgument(
            'base', default_value='',
            description='how the base moves: fixed, planar, differential, floating or '
                        'underwater; empty: as the parameter file says, else fixed'),
        DeclareLaunchArgument(
            'stack', default_value='',
            description='the tasks, the highest priority first: YAML text, a path or '
                        'package://<package>/<path>; empty: as the parameter file says, else '
                        'one posture task'),
        DeclareLaunchArgument(
            'params_file', default_value='',
            description='parameter file: a path or package://<package>/<path>; in a namespace the '
                        'entry of the node has to be /**/tp_controller or '
                        '/<namespace>/tp_controller'),
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
        DeclareLaunchArgument(
            'rviz_config', default_value=PathJoinSubstitution([*CONFIG, 'controller.rviz']),
            description='configuration of RViz'),
        DeclareLaunchArgument(
            'fixed_frame', default_value='base_link',
            description='frame that RViz shows everything in: the root of the robot, or '
                        'world_frame where the base moves'),
        OpaqueFunction(function=_controller),
        Node(package='rviz2', executable='rviz2', namespace=LaunchConfiguration('namespace'),
             arguments=['-d', LaunchConfiguration('rviz_config'),
                        '-f', LaunchConfiguration('fixed_frame')],
             # The names of the configuration are absolute, those on the right are not.
             remappings=[('/robot_description', 'robot_description'),
                         ('/tp_controller/markers', 'tp_controller/markers'),
                         *((f'/tp_controller/{name}', f'tp_controller/{name}')
                           for name in INTERACTIVE)],
             parameters=[{'use_sim_time': _boolean('use_sim_time')}],
             condition=IfCondition(LaunchConfiguration('rviz')), output='screen'),
    ])


def _controller(context: LaunchContext) -> list[Node]:
    """Return the controller node: an argument that is empty leaves the parameter file alone."""
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('robot', 'base', 'stack', 'output', 'xacro_arguments', 'params_file')}
    commands = LaunchConfiguration('commands').perform(context)
    file, words = given.pop('params_file'), given.pop('xacro_arguments')
    if not file:
        given['stack'] = given['stack'] or DEFAULT_STACK
    # As text, whatever YAML would make of it.
    texts = {name: ParameterValue(value, value_type=str)
             for name, value in given.items() if value}
    lists = {'xacro_arguments': shlex.split(words)} if words else {}
    return [Node(
        package='tp_controller', executable='controller_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[*([str(find_file(file))] if file else []),
                    {'use_sim_time': _boolean('use_sim_time'), **texts, **lists}],
        # Only one of them is published.
        remappings=[(topic, commands) for topic in TOPICS if commands],
        output='screen')]


def _boolean(name: str) -> ParameterValue:
    """Return an argument as a boolean parameter."""
    return ParameterValue(LaunchConfiguration(name), value_type=bool)

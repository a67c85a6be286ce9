# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Start a simulated robot, the controller, RViz, and goals one after the other."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
import shlex

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.conditions import IfCondition
from launch.event_handlers import OnProcessExit
from launch.launch_description_entity import LaunchDescriptionEntity
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage
from tp_controller.model.robot import Robot
from tp_controller.resources import find_file
from tp_controller.ros.declarations.controller import OUTPUTS
from tp_controller.tools.demos.scenarios import DEMOS, Goal, robot_of

# How long a goal may take to be reached before the next one follows [s].
REACH_SECONDS = 20.0
# How long to look for the controller, which may have a lot to load [s].
START_SECONDS = 120.0


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument(
            'demo', default_value='panda', choices=list(DEMOS),
            description='which robot, stack and goals of this package'),
        DeclareLaunchArgument(
            'robot', default_value='',
            description='file of another robot, URDF, xacro, MJCF or DH table (.yaml): a path or '
                        'package://<package>/<path>; it gets no goals'),
        DeclareLaunchArgument(
            'xacro_arguments', default_value='',
            description='arguments of a xacro, as "name:=value name:=value"'),
        DeclareLaunchArgument(
            'base', default_value='',
            description='how the base of another robot moves: fixed, planar, differential, '
                        'floating or underwater; empty: fixed'),
        DeclareLaunchArgument(
            'stack', default_value='',
            description='other tasks, the highest priority first: YAML text, a path or '
                        'package://<package>/<path>; they get no goals; empty: those of the '
                        'demo, for another robot one posture task'),
        DeclareLaunchArgument(
            'output', default_value='', choices=['', *OUTPUTS],
            description='commands for the joints; empty: as the parameter file says, else '
                        'velocity'),
        DeclareLaunchArgument(
            'params_file', default_value='',
            description='parameter file, a path or package://<package>/<path>, in place of the '
                        'one of the demo, with entries /**/tp_simulator and /**/tp_controller; '
                        'another robot has none by default'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='namespace of the nodes and their topics'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false', choices=['true', 'false'],
            description='let the simulator publish /clock, and everything else follow it'),
        DeclareLaunchArgument(
            'rviz', choices=['true', 'false'],
            default_value=str('rviz2' in get_packages_with_prefixes()).lower(),
            description='start RViz and what it needs: robot model, frames, goals of the tasks; '
                        'by default where it is installed'),
        DeclareLaunchArgument(
            'goals', default_value='true', choices=['true', 'false'],
            description='send the goals of the demo, one after the other'),
        OpaqueFunction(function=_demo),
    ])


def _demo(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return everything that the arguments, which are known by now, decide about."""
    given = {name: LaunchConfiguration(name).perform(context)
             for name in ('robot', 'base', 'stack', 'xacro_arguments', 'params_file')}
    demo = DEMOS[LaunchConfiguration('demo').perform(context)]
    if given['robot']:
        robot = Robot.from_file(given['robot'], base=given['base'] or 'fixed',
                                xacro_arguments=shlex.split(given['xacro_arguments']))
    else:
        given['params_file'] = str(find_file(given['params_file'] or demo.file('')))
        robot = robot_of(Path(given['params_file']))
    goals = [] if any(given[name] for name in ('robot', 'stack')) \
        or LaunchConfiguration('goals').perform(context) == 'false' else demo.steps
    return [
        _simulator(given),
        # The frames of the robot as tf, for RViz.
        Node(package='robot_state_publisher', executable='robot_state_publisher',
             namespace=LaunchConfiguration('namespace'),
             parameters=[{'robot_description': ParameterValue(robot.urdf, value_type=str),
                          'use_sim_time': _sim_time()}],
             condition=IfCondition(LaunchConfiguration('rviz')), output='screen'),
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource([ThisLaunchFileDir(), '/controller.launch.py']),
            launch_arguments={**given, 'fixed_frame': robot.root, **{
                name: LaunchConfiguration(name)
                for name in ('namespace', 'output', 'use_sim_time', 'rviz')}}.items()),
        *_one_after_the_other([process for step in goals for process in _step(step)]),
    ]


def _simulator(given: dict[str, str]) -> Node:
    """Return the simulated robot."""
    file = given['params_file']
    texts = {name: ParameterValue(given[name], value_type=str)
             for name in ('robot', 'base') if given[name]}
    words = shlex.split(given['xacro_arguments'])
    lists = {'xacro_arguments': words} if words else {}
    return Node(package='tp_controller', executable='simulator_node',
                namespace=LaunchConfiguration('namespace'),
                parameters=[*([str(find_file(file))] if file else []), {
                    'publish_clock': _sim_time(), **texts, **lists,
                    'publish_tf': ParameterValue(LaunchConfiguration('rviz'), value_type=bool)}],
                output='screen')


def _sim_time() -> ParameterValue:
    """Return the argument use_sim_time as a boolean parameter."""
    return ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)


def _step(step: Sequence[Goal]) -> list[ExecuteProcess]:
    """Return what sends the goals of one step: the last one is waited for."""
    return [_send(goal, wait=goal is step[-1]) for goal in step]


def _send(goal: Goal, wait: bool) -> ExecuteProcess:
    """Return what sends a goal."""
    options = {'xyz': '--xyz', 'rpy': '--rpy', 'linear': '--linear', 'angular': '--angular'}
    parts = [[option, *map(str, goal[key])] for key, option in options.items() if key in goal]
    if 'for' in goal:
        parts.append(['--for', str(goal['for'])])
    elif wait:
        parts.append(['--reach', str(REACH_SECONDS)])
    return ExecuteProcess(
        name=f'goal_{goal["task"]}', output='screen',
        cmd=[ExecutableInPackage('tp_controller', package='tp_controller'), 'goal', goal['task'],
             *sum(parts, []), '--wait', str(START_SECONDS),
             '--node', [LaunchConfiguration('namespace'), '/tp_controller']])


def _one_after_the_other(processes: Sequence[ExecuteProcess]) -> list[LaunchDescriptionEntity]:
    """Return what starts each process when the one before has ended."""
    return [*processes[:1], *(RegisterEventHandler(OnProcessExit(
        target_action=before, on_exit=[after])) for before, after in pairwise(processes))]

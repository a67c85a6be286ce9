# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The commands of the robots' pages, with the parameter file for the first motion and without."""

import shlex

from geometry_msgs.msg import PoseStamped
from harness import Status
import numpy as np
import pytest
from robots import CONFIG, REPOSITORY
from std_msgs.msg import Float64MultiArray
from tp_controller import Robot
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode

SHARE = '$(ros2 pkg prefix --share tp_controller)'
# Robot: the topic that the driver takes commands on.
COMMANDS = {
    'ur5e': '/forward_velocity_controller/commands', 'fr3': '/velocity_controller/commands',
    'gen3': '/joint_group_velocity_controller/commands', 'xarm7': '/velocity_controller/commands'}


def arguments_of(page, node):
    """Return the arguments of the command on a page that starts a node."""
    text = (REPOSITORY / 'docs' / f'{page}.md').read_text(encoding='utf-8')
    line, = (line for line in text.replace('\\\n', ' ').splitlines()
             if line.startswith(f'ros2 run tp_controller {node} '))
    return [word.replace(SHARE, str(REPOSITORY)) for word in shlex.split(line)[4:]]


def simulator_arguments(name):
    """Return the arguments of the simulator, as shown for the robot that stands for all."""
    return [word.replace('ur5e', name) for word in arguments_of('robots', 'simulator_node')]


def start(harness, name, first=True):
    """
    Return the controller that the command of a page starts, for the table of the robot.

    Without the second file it is, as the page says, the one after the first motion.
    """
    arguments = arguments_of(f'robots/{name}', 'controller_node')
    if not first:
        second = max(at for at, word in enumerate(arguments) if word == '--params-file')
        assert arguments[second + 1].endswith(f'{name}_first.yaml')
        del arguments[second:second + 2]
    return harness.make(ControllerNode, arguments=arguments,
                        robot=str(CONFIG / 'robots' / f'{name}.yaml'), status_rate=50.0)


@pytest.mark.parametrize('first, share', [(True, 0.1), (False, 1.0)])
@pytest.mark.parametrize('name', COMMANDS)
def test_first_motion_has_a_tenth_of_the_velocities(harness, name, first, share):
    table = Robot.from_file(CONFIG / 'robots' / f'{name}.yaml')
    robot = start(harness, name, first)._robot.controller.robot
    assert robot.velocity == pytest.approx(share * table.velocity, rel=1e-3)
    assert (robot.acceleration < table.acceleration).all() == first
    assert (robot.lower == table.lower).all() and (robot.upper == table.upper).all()


@pytest.mark.parametrize('name', COMMANDS)
def test_first_motion_refuses_goals_far_away_and_is_slow(harness, name):
    controller = start(harness, name)
    arguments = simulator_arguments(name)
    for word in arguments_of(f'robots/{name}', 'controller_node'):
        arguments += ['-r', word] if word.startswith(('joint_states', 'velocity_')) else []
    harness.make(SimulatorNode, arguments=arguments)
    goals = harness.publisher(PoseStamped, '/tp_controller/tool/goal')
    commands, status = harness.record(Float64MultiArray, COMMANDS[name]), Status(harness)
    message = PoseStamped()
    message.header.frame_id = controller._robot.controller.stack.tasks['tool'].frame
    harness.spin_until(lambda: status.head == 'running', 'a controller that runs')

    message.pose.position.z = -0.15
    goals.publish(message)
    harness.spin_until(lambda: status.task('tool')['goals refused'] == '1', 'a refusal')
    assert 'more than largest_jump (0.1 m) allows' in status.task('tool')['last refusal']
    assert not any(velocities(command).any() for command in commands)

    message.pose.position.z = -0.05
    goals.publish(message)
    harness.spin_until(lambda: np.any(velocities(commands[-1]) > 0.02), 'a motion')
    table = Robot.from_file(CONFIG / 'robots' / f'{name}.yaml')
    assert all((velocities(command) <= 0.1001 * table.velocity).all() for command in commands)


def velocities(command):
    """Return how fast each joint is commanded [rad/s]."""
    return np.abs(command.data)

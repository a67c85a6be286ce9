# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The files and pages of real robots: tables, limits, stacks, home, and what they say."""

from importlib import import_module
from pathlib import Path
import re
import sys
import types

import numpy as np
import pytest
from tp_controller import Controller, KinematicSimulator, Robot, Settings, Stack
from tp_controller.model.simulator import initial_positions
import yaml

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / 'config' / 'robots'
PAGES = ROOT / 'docs' / 'robots'
ROBOTS = ('ur5e', 'fr3', 'gen3', 'xarm7')
# Tool, and at home + 0.1, 0.2 … rad its position [m], x axis and z axis: from the URDFs of the
# manufacturers, made by xacro.
POSES = {
    'ur5e': ('tool0', (0.40219, 0.22238, 0.25853), (-0.58565, -0.78638, 0.1965),
             (-0.73207, 0.40908, -0.54473)),
    'fr3': ('fr3_hand_tcp', (0.40063, 0.2772, 0.70585), (0.82406, -0.47714, 0.30537),
            (0.54238, 0.50892, -0.66845)),
    'gen3': ('end_effector_link', (0.52358, -0.07744, 0.54455), (0.41358, 0.44897, -0.79207),
             (0.7629, 0.30393, 0.57063)),
    'xarm7': ('link_eef', (0.28318, 0.20321, 0.53529), (0.82721, -0.161, -0.53834),
              (-0.51053, 0.18484, -0.83976)),
}
# Jerk at which the Franka Research 3 stops [rad/s³].
FR3_JERK = 5000.0


def load(name):
    """Return a YAML file of config/robots/."""
    return yaml.safe_load((FILES / name).read_text(encoding='utf-8'))


def parameters(name, node):
    """Return the parameters of a node in the file of a robot."""
    return load(f'{name}_parameters.yaml')[f'/**/{node}']['ros__parameters']


def robot_of(name):
    """Return a robot with the limits of its parameter file."""
    given = parameters(name, 'tp_controller')
    return Robot.from_file(FILES / f'{name}.yaml', joints=given['joints'],
                           limits=given['limits'])


def stack_of(name, robot, kind='stack'):
    """Return a stack of a robot."""
    return Stack.from_yaml(FILES / f'{name}_{kind}.yaml', robot)


def home_of(name, robot):
    """Return the configuration that its simulator starts in."""
    return initial_positions(parameters(name, 'tp_simulator')['initial_positions'], robot)


def motion(name, goal, seconds, period=0.01):
    """Return positions, commands and the last report on the way from home to a pose."""
    robot = robot_of(name)
    controller = Controller(robot, stack_of(name, robot), Settings(period=period))
    simulator = KinematicSimulator(robot, home_of(name, robot))
    controller.set_goal('tool', goal, now=0.0)
    positions, commands = [], []
    for cycle in range(round(seconds / period)):
        command = controller.update(simulator.q, now=period * cycle)
        simulator.command(command.velocity)
        simulator.step(period)
        positions.append(simulator.q.copy())
        commands.append(command.velocity)
    return np.array(positions), np.array(commands), command.report


@pytest.mark.parametrize('name', ROBOTS)
def test_table_has_the_kinematics_of_the_manufacturer(name):
    robot = robot_of(name)
    tool, position, x_axis, z_axis = POSES[name]
    T = robot.state(home_of(name, robot) + 0.1 * np.arange(1, robot.n + 1)).pose(tool)
    assert T[:3, 3] == pytest.approx(position, abs=2e-5)
    assert T[:3, 0] == pytest.approx(x_axis, abs=4e-5)
    assert T[:3, 2] == pytest.approx(z_axis, abs=4e-5)


@pytest.mark.parametrize('name', ROBOTS)
def test_parameters_and_table_agree(name):
    table, robot = Robot.from_file(FILES / f'{name}.yaml'), robot_of(name)
    assert table.joint_names == robot.joint_names
    for limit in ('lower', 'upper', 'velocity', 'acceleration'):
        assert np.array_equal(getattr(table, limit), getattr(robot, limit)), limit
    assert np.isfinite(robot.acceleration).all() and np.isfinite(robot.velocity).all()
    for node in ('tp_simulator', 'tp_controller'):
        for key in {'robot', 'stack'} & set(parameters(name, node)):
            file = parameters(name, node)[key].removeprefix('package://tp_controller/')
            assert (ROOT / file).is_file()


@pytest.mark.parametrize('name', ROBOTS)
def test_nodes_have_every_parameter_of_the_files(name):
    pytest.importorskip('rclpy')
    for node, module in (('tp_simulator', 'simulator_node'), ('tp_controller', 'controller_node')):
        specs = import_module(f'tp_controller.nodes.{module}').PARAMETERS
        defaults = {spec.name: spec.default for spec in specs}
        for key, value in parameters(name, node).items():
            assert key == 'limits' or isinstance(value, type(defaults[key])), (node, key)


@pytest.mark.parametrize('name', ROBOTS)
def test_home_is_bent_within_limits_and_the_same_in_both_files(name):
    robot = robot_of(name)
    home, tool = home_of(name, robot), stack_of(name, robot).tasks['tool'].frame
    assert stack_of(name, robot, 'home').tasks['home'].goal == pytest.approx(home)
    assert (home > robot.lower + 0.1).all() and (home < robot.upper - 0.1).all()
    assert np.linalg.svd(robot.state(home).jacobian(tool))[1][-1] > 0.1


@pytest.mark.parametrize('name', ROBOTS)
def test_tool_reaches_goals_and_no_limit_is_exceeded(name):
    robot = robot_of(name)
    tool, random = stack_of(name, robot).tasks['tool'].frame, np.random.default_rng(3)
    for _ in range(4):
        q = home_of(name, robot) + random.uniform(-0.6, 0.6, robot.n)
        q = np.clip(q, robot.lower + 0.1, robot.upper - 0.1)
        goal = robot.state(q).pose(tool)
        positions, commands, report = motion(name, goal, 8.0)
        reached, = (task.status for task in report.tasks if task.name == 'tool')
        assert reached == 'reached'
        assert robot.state(positions[-1]).pose(tool) == pytest.approx(goal, abs=2e-3)
        assert (np.abs(commands) <= robot.velocity + 1e-9).all()
        changes = np.diff(commands, axis=0, prepend=np.zeros((1, robot.n)))
        assert (np.abs(changes) <= 0.01 * robot.acceleration + 1e-9).all()
        assert (positions >= robot.lower - 1e-9).all() and (positions <= robot.upper + 1e-9).all()


def test_jerk_of_fr3_stays_allowed_if_commands_are_late_by_a_cycle():
    robot, period = robot_of('fr3'), 0.001
    q = home_of('fr3', robot) + [0.5, 0.3, -0.4, 0.4, 0.3, -0.3, 0.6]
    _, commands, _ = motion('fr3', robot.state(q).pose('fr3_link8'), 3.0, period)
    random = np.random.default_rng(0)
    late = np.arange(len(commands)) - random.integers(0, 2, len(commands))
    received = commands[np.maximum(late, 0)]
    for taken in (commands, received):
        accelerations = np.diff(taken, axis=0) / period
        assert np.abs(accelerations).max() <= 10.0
        assert np.abs(np.diff(accelerations, axis=0)).max() / period <= FR3_JERK
    # What its own limit of acceleration would do.
    assert 3.0 * 10.0 / period > FR3_JERK >= 3.0 * robot.acceleration.max() / period


@pytest.mark.parametrize('name', ROBOTS)
def test_page_shows_order_and_files(name):
    page = (PAGES / f'{name}.md').read_text(encoding='utf-8')
    joints, = re.findall(r'^\| joints, in this order \| (.*) \|$', page, re.MULTILINE)
    first, *_, last = re.findall(r'`(\w+)`', joints)
    assert (first, last) == robot_of(name).joint_names[::robot_of(name).n - 1]
    for part in ('', '_parameters', '_stack', '_home'):
        assert f'../../config/robots/{name}{part}.yaml' in page


@pytest.fixture
def bridge(monkeypatch):
    """Return the module of the bridge on the page of the Gen3, with a stand-in of its API."""
    page = (PAGES / 'gen3.md').read_text(encoding='utf-8')
    source, = re.findall(r'<!-- file: kortex_bridge.py -->\n```python\n(.*?)```', page, re.DOTALL)

    class JointSpeeds:

        def __init__(self):
            self.joint_speeds = self
            self.joints = []

        def add(self):
            self.joints.append(types.SimpleNamespace())
            return self.joints[-1]

    stand_ins = {name: types.ModuleType(name) for name in (
        'kortex_api', 'kortex_api.autogen', 'kortex_api.autogen.client_stubs',
        'kortex_api.autogen.client_stubs.BaseClientRpc', 'kortex_api.autogen.messages', 'rclpy',
        'std_msgs', 'std_msgs.msg', 'utilities')}
    stand_ins['kortex_api.autogen.client_stubs.BaseClientRpc'].BaseClient = object
    stand_ins['kortex_api.autogen.messages'].Base_pb2 = types.SimpleNamespace(
        JointSpeeds=JointSpeeds, SINGLE_LEVEL_SERVOING=2,
        ServoingModeInformation=types.SimpleNamespace)
    stand_ins['std_msgs.msg'].Float64MultiArray = object
    for name, module in stand_ins.items():
        monkeypatch.setitem(sys.modules, name, module)
    module = types.ModuleType('kortex_bridge')
    exec(compile(source, 'kortex_bridge.py', 'exec'), module.__dict__)
    return module


def test_bridge_to_the_gen3_sends_degrees_and_zeros_once_commands_stay_away(bridge, monkeypatch):
    sent, modes, clock = [], [], [100.0]
    monkeypatch.setattr(bridge.time, 'monotonic', lambda: clock[0])
    base = types.SimpleNamespace(
        SetServoingMode=lambda mode: modes.append(mode.servoing_mode),
        SendJointSpeedsCommand=lambda speeds: sent.append(
            [(joint.joint_identifier, joint.value) for joint in speeds.joints]))
    arm = bridge.Bridge(base)
    assert modes == [2]
    arm.send()
    arm.receive(types.SimpleNamespace(data=[np.pi / 6, 0.0, 0.0, 0.0, 0.0, 0.0, -np.pi / 4]))
    arm.send()
    clock[0] += bridge.TIMEOUT + 0.01
    arm.send()
    zeros = [(joint, 0.0) for joint in range(7)]
    assert sent[0] == sent[2] == zeros
    assert sent[1][0] == (0, pytest.approx(30.0)) and sent[1][6] == (6, pytest.approx(-45.0))

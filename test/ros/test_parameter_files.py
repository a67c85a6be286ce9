# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What `ros2 param dump` writes can be loaded, and starts an equal node."""

from harness import Arm
import numpy as np
import pytest
from rclpy.parameter import (
    Parameter,
    PARAMETER_SEPARATOR_STRING,
    parameter_value_to_python,
)
from rclpy.parameter_client import AsyncParameterClient
from robots import CONFIG, PLANAR_DH
from tp_controller.ros import controller_node, simulator_node, watchdog_node
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode
from tp_controller.ros.watchdog_node import WatchdogNode
import yaml

STACK = """
# A comment, and a target: only in this text
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
- swing:
    type: joint
    joints: [joint1, joint2]
    target: [1, 0.5]
"""
NODES = controller_node, simulator_node, watchdog_node
# Those that rclpy makes for every node are read-only.
FOREIGN = ('start_type_description_service', 'qos_overrides')


def insert(tree, name, value):
    """Put a parameter into nested mappings, as `ros2 param dump` does."""
    first, dot, rest = name.partition(PARAMETER_SEPARATOR_STRING)
    if dot:
        insert(tree.setdefault(first, {}), rest, value)
    else:
        tree[name] = value


class Client:
    """Does what `ros2 param` does, with a client of another node."""

    def __init__(self, harness, name):
        self._harness, self._name = harness, name
        self._client = AsyncParameterClient(harness.node, name)
        harness.spin_until(self._client.services_are_ready, f'the parameters of {name}')

    def _answer(self, future):
        self._harness.spin_until(future.done, 'an answer about parameters')
        return future.result()

    def values(self):
        """Return {name: value} of all parameters."""
        names = sorted(self._answer(self._client.list_parameters()).result.names)
        answer = self._answer(self._client.get_parameters(names))
        assert len(answer.values) == len(names)
        return dict(zip(names, map(parameter_value_to_python, answer.values)))

    def change(self, name, value, kind=None):
        """Set a parameter; return why it was refused."""
        parameter = Parameter(name, kind, value)
        result, = self._answer(self._client.set_parameters([parameter])).results
        return result.reason

    def dump(self, path):
        """Write all parameters to a file, and return their values."""
        values, tree = self.values(), {}
        for name, value in values.items():
            insert(tree, name, value)
        path.write_text(yaml.dump({self._name: {'ros__parameters': tree}},
                                  default_flow_style=False))
        return values

    def load(self, path):
        """Set all parameters of a file; return {name: reason} of those that were refused."""
        with path.open() as file:
            tree = yaml.safe_load(file)[self._name]['ros__parameters']
        results = self._answer(self._client.load_parameter_file(str(path), True)).results
        names = list(names_of(tree))
        assert len(results) == len(names)
        return {name: result.reason for name, result in zip(names, results)
                if not result.successful and not name.startswith(FOREIGN)}


def names_of(tree, prefix=''):
    """Yield the names of parameters in nested mappings."""
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from names_of(value, f'{prefix}{key}{PARAMETER_SEPARATOR_STRING}')
        else:
            yield prefix + key


CONTROLLERS = {
    'defaults': {},
    'text': {'stack': STACK, 'blend': 0.4, 'damping': 1e-5, 'singular_region': float('inf')},
    'file': {'stack': 'package://tp_controller/config/demo_stack.yaml',
             'robot': str(CONFIG / 'robots' / 'panda.yaml')},
    'limits': {'limits__joint1__velocity': 0.5, 'limits__joint2__acceleration': 1e-7,
               'weights': [1.0, 2e-7, 3.0]},
    'base': {'robot': str(CONFIG / 'robots' / 'mobile_arm.urdf'), 'base': 'planar',
             'stack': '- rest: {type: posture}'},
    'joints': {'joints': ['joint2', 'joint1'], 'stack': '- rest: {type: posture}',
               'command_joints': ['joint1', 'joint2']},
    'simulated time': {'use_sim_time': True},
    'no robot': {'robot': '', 'autostart': False},
    'no stack': {'stack': ''},
}


@pytest.mark.parametrize('name', CONTROLLERS)
def test_a_dump_can_be_loaded_and_changes_nothing(harness, tmp_path, name):
    harness.controller(**CONTROLLERS[name])
    client, path = Client(harness, '/tp_controller'), tmp_path / 'dump.yaml'
    values = client.dump(path)
    refused = client.load(path)
    if name == 'no stack':
        assert refused.pop('stack').startswith('parameter stack is empty')
    assert refused == {}
    assert client.values() == values


@pytest.mark.parametrize('name', CONTROLLERS)
def test_a_dump_starts_an_equal_node(harness, tmp_path, name):
    first, path = harness.controller(**CONTROLLERS[name]), tmp_path / 'dump.yaml'
    values = Client(harness, '/tp_controller').dump(path)
    robot = first._robot and first._robot.controller.robot
    harness.remove(first)
    second = from_file(harness, type(first), path)
    assert Client(harness, '/tp_controller').values() == values
    if robot is not None:
        for key in ('lower', 'upper', 'velocity', 'acceleration'):
            np.testing.assert_array_equal(getattr(second._robot.controller.robot, key),
                                          getattr(robot, key))


def from_file(harness, kind, path):
    """Return a node that was started with a parameter file."""
    return harness.make(kind, arguments=['--ros-args', '--params-file', str(path)])


def test_loading_a_dump_leaves_motion_and_goals_as_they_are(harness, tmp_path, monkeypatch):
    """A goal that was sent is still in force, though the stack has a target."""
    controller = harness.controller(stack=STACK, state_timeout=5.0)
    client, path = Client(harness, '/tp_controller'), tmp_path / 'dump.yaml'
    arm, commands = Arm(harness, (0.0, 0.6, 0.3)), harness.commands()
    core = controller._robot.controller
    core.set_goal('swing', [0.25, 0.5], 0.0)
    harness.spin_until(lambda: commands and any(commands[-1]), meanwhile=arm.publish)
    before = harness.spin_for_more(commands, 2, arm.publish)[-1]
    client.dump(path)
    stack, goal, announced = core.stack, core.stack.tasks['swing'].goal, []
    monkeypatch.setattr(core._changes, 'announce', announced.append)
    assert client.load(path) == {}
    assert core.stack is stack and core.stack.tasks['swing'].goal is goal and not announced
    harness.spin_for_more(commands, 3, arm.publish)
    np.testing.assert_allclose(commands[-3:], [before] * 3, atol=1e-12)


def test_a_description_may_lose_its_line_breaks(harness, tmp_path):
    """`ros2 param load` of Jazzy folds text."""
    text = (CONFIG / 'robots' / 'mobile_arm.urdf').read_text()
    harness.controller(robot_description=text, stack='- rest: {type: posture}')
    client, path = Client(harness, '/tp_controller'), tmp_path / 'dump.yaml'
    values = client.dump(path)
    assert values['robot_description'] == text
    assert client.load(path) == {}
    values = client.values()
    assert values['robot_description'] != text
    assert values['robot_description'].split() == text.split()
    told = client.change('robot_description', text.replace('torso', 'trunk'))
    assert told.endswith('fixed while the node is configured')


def test_a_number_may_be_written_as_the_tools_of_ros_write_it(harness):
    """`ros2 param load` of Jazzy sends .inf and 1.0e-05 as text."""
    harness.controller(singular_region=0.5)
    client = Client(harness, '/tp_controller')
    for text, value in (('inf', float('inf')), ('1e-05', 1e-5), ('0.1', 0.1)):
        assert client.change('singular_region', text) == ''
        assert client.values()['singular_region'] == value
    assert client.change('weights', '[1e-05, 1.0, 1]') == ''
    assert client.values()['weights'] == [1e-5, 1.0, 1.0]
    assert client.change('weights', [], Parameter.Type.BOOL_ARRAY) == ''
    assert client.values()['weights'] == [1.0]
    for text in ('much', 'nan', '', 'true', '[1.0]', '-inf'):
        assert client.change('singular_region', text) != ''
    assert client.values()['singular_region'] == 0.1


def test_an_integer_is_a_number_wherever_a_number_is_needed(harness, tmp_path):
    path = tmp_path / 'parameters.yaml'
    path.write_text(
        '/tp_controller:\n  ros__parameters:\n    rate: 50\n    damping: 1\n'
        '    weights: [1, 2, 3]\n    workspace: [-1, 1, -1, 1, -1, 1]\n'
        '    limits: {joint1: {velocity: 2}}\n'
        '    tasks: {swing: {gain: 3, tolerance: 1}}\n')
    harness.make(ControllerNode, robot=str(PLANAR_DH), stack=STACK,
                 arguments=['--ros-args', '--params-file', str(path)])
    client = Client(harness, '/tp_controller')
    values = {'rate': 50.0, 'damping': 1.0, 'weights': [1.0, 2.0, 3.0],
              'workspace': [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0], 'limits.joint1.velocity': 2.0,
              'tasks.swing.gain': 3.0, 'tasks.swing.tolerance': 1.0}
    assert {name: client.values()[name] for name in values} == values
    for name, given, value in (('damping', 0, 0.0), ('weights', [3, 2, 1], [3.0, 2.0, 1.0]),
                               ('limits.joint1.velocity', 1, 1.0), ('tasks.swing.gain', 2, 2.0),
                               ('weights', '[1, 2.5, 3]', [1.0, 2.5, 3.0])):
        assert client.change(name, given) == ''
        assert client.values()[name] == value and type(client.values()[name]) is type(value)
    # Integers stay integers, and truth is no number.
    assert client.change('damping', True) != ''
    assert client.change('realtime_priority', 1.0) != ''


def test_an_integer_is_a_number_for_the_other_nodes_too(harness):
    for kind, values in ((SimulatorNode, {'robot': str(PLANAR_DH), 'rate': 100, 'lag': 1}),
                         (WatchdogNode, {'timeout': 1})):
        node = harness.make(kind, **values)
        assert node.get_parameter(list(values)[-1]).value == 1.0
        assert Client(harness, node.get_fully_qualified_name()).change(list(values)[-1], 1) == ''


SIMULATORS = {
    'defaults': {},
    'all': {'lag': 1e-7, 'noise': 0.01, 'seed': 3, 'command_joints': ['joint2']},
    'positions': {'initial_positions': '{joint1: 0.5}'},
}


@pytest.mark.parametrize('name', SIMULATORS)
def test_a_dump_of_the_simulator_starts_an_equal_one(harness, tmp_path, name):
    first, path = harness.simulator(**SIMULATORS[name]), tmp_path / 'dump.yaml'
    client = Client(harness, '/tp_simulator')
    values = client.dump(path)
    if name != 'positions':
        assert client.load(path) == {}
        assert client.values() == values
    harness.remove(first)
    from_file(harness, type(first), path)
    assert Client(harness, '/tp_simulator').values() == values


def test_parameters_of_the_same_name_can_share_a_value():
    """As in the entry ``/**`` of a file, which is for all nodes."""
    meanings = {}
    for module in NODES:
        for spec in module.PARAMETERS:
            meanings.setdefault(spec.name, set()).add((type(spec.default), spec.unit))
    assert [name for name, kinds in meanings.items() if len(kinds) > 1] == []

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A parameter file, read as a node reads it."""

import subprocess
import sys

import numpy as np
import pytest
from robots import CONFIG, PLANAR_DH
from tp_controller import SettingsError
from tp_controller.tools.check.parameter_file import node_parameters, read, Refused

STACK = '- tip: {type: position, frame: link3, axes: xy, gain: 2.0}\n'
FILE = """
/**/tp_simulator:
  ros__parameters: {robot: ROBOT, rate: 250.0, initial_positions: '{joint2: 0.5}'}
left:
  tp_controller:
    ros__parameters:
      stack: "- tip: {type: position, frame: link3, axes: xy, gain: 2.0}"
      rate: 0.0
      state_timeout: 0.02
      joints: [joint1, joint3]
      weights: [1.0, 2.0]
      braking_gain: 5
      status_rate: 20.0
      limits: {joint1: {velocity: 0.5}, joint3: {acceleration: 4.0}}
      tasks.tip.gain: 3.0
      tasks: {tip: {tolerance: 0.01}}
"""


@pytest.fixture
def file(tmp_path):
    """Return a function that writes a parameter file and returns its path."""
    def write(text):
        path = tmp_path / 'parameters.yaml'
        path.write_text(text.replace('ROBOT', str(PLANAR_DH)))
        return path

    return write


@pytest.mark.slow
def test_of_several_files_the_last_one_that_gives_a_parameter_counts(tmp_path):
    texts = (
        'tp_controller: {ros__parameters: {rate: 50.0, damping: 0.2, '
        'limits: {joint1: {velocity: 0.5, acceleration: 4.0}}}}',
        '/**: {ros__parameters: {rate: 200.0, limits: {joint1: {velocity: 0.05}}}}\n'
        'tp_controller: {ros__parameters: {limits: {joint2: {velocity: 0.1}}}}')
    files = []
    for number, text in enumerate(texts):
        files.append(tmp_path / f'{number}.yaml')
        files[-1].write_text(text)
    given = read(files, STACK, str(PLANAR_DH), '', None)
    assert (given.period, given.settings.damping) == (0.005, 0.2)
    assert given.robot.velocity[:2].tolist() == [0.05, 0.1]
    assert given.robot.acceleration[0] == 4.0
    assert read(files[::-1], STACK, str(PLANAR_DH), '', None).robot.velocity[0] == 0.5


@pytest.mark.slow
def test_everything_of_a_file_is_read(file):
    given = read([file(FILE)], '', '', '', None)
    assert given.robot.joint_names == ('joint1', 'joint3')
    assert given.robot.velocity.tolist() == [0.5, 1.0]
    assert given.robot.acceleration.tolist() == [np.inf, 4.0]
    assert (given.settings.period, given.period) == (0.02, 1.0 / 250.0)
    assert given.settings.weights == (1.0, 2.0) and given.settings.braking_gain == 5
    task = given.stack.tasks['tip']
    assert task.gain == 3.0 and task.groups[0].tolerance == 0.01
    # The base does not move.
    assert not given.ignored and given.around is None


def test_a_base_starts_where_the_simulator_has_it():
    assert read([CONFIG / 'underwater.yaml'], '', '', '', None).around[2] == -3.0


@pytest.mark.slow
def test_arguments_go_before_the_file(file):
    text = FILE.replace("initial_positions: '{joint2: 0.5}'", 'noise: 0.0')
    given = read([file(text)], STACK.replace('tip', 'top'), str(CONFIG / 'robots/planar_3r.yaml'),
                 'planar', 50.0)
    assert given.robot.base == 'planar' and list(given.stack.tasks) == ['top']
    assert given.period == given.settings.period == 0.02 and given.around is None
    # The file is about a task that this stack does not have.
    assert set(given.ignored) == {'tasks.tip.gain', 'tasks.tip.tolerance'}


def test_without_a_file_the_defaults_of_a_node_are_in_force():
    given = read([], STACK, str(PLANAR_DH), '', None)
    assert given.period == given.settings.period == 0.01 and given.robot.base == 'fixed'
    assert given.settings.weights is None


@pytest.mark.parametrize('name', ['tp_controller', '/tp_controller', '/a/b/tp_controller', '/**',
                                  '/**/tp_controller', '/*/tp_controller'])
@pytest.mark.slow
def test_names_of_nodes_are_found_in_any_namespace(file, name):
    path = file(f'{name}: {{ros__parameters: {{rate: 50.0}}}}\n'
                'other: {ros__parameters: {rate: 20.0}}\n')
    assert node_parameters(path, 'tp_controller') == {'rate': 50.0}


@pytest.mark.slow
def test_equal_weights_are_any_number(file):
    for value in ('[]', '[1.0]'):
        path = file(f'tp_controller:\n  ros__parameters: {{weights: {value}}}\n')
        assert read([path], STACK, str(PLANAR_DH), '', None).settings.weights is None


def test_unknown_parameters_are_named(file):
    path = file('tp_controller:\n  ros__parameters: {breaking_gain: 3.0, settle_time: 0.1}\n')
    assert read([path], STACK, str(PLANAR_DH), '', None).ignored == ('breaking_gain',)


@pytest.mark.slow
def test_all_that_a_node_would_refuse_is_listed(file):
    path = file('tp_controller:\n  ros__parameters: {damping: -1.0}\n')
    stack = '- tip: {type: positon, frame: link3}\n- top: {type: position, frame: link9}\n'
    with pytest.raises(Refused) as refused:
        read([path], stack, str(PLANAR_DH), '', None)
    messages = list(refused.value.messages())
    assert [where for where, _ in messages] == ['', 'line 1, tip', 'line 2, top, frame']
    assert 'damping' in messages[0][1] and 'position' in messages[1][1]
    assert not refused.value.missing_file


@pytest.mark.parametrize(('parameters', 'said'), [
    ('{rate: fast}', 'rate must be a number'), ('{rate: -1.0}', 'rate must be from 0 to 2000'),
    ('{status_rate: 0.0}', 'status_rate must be from 0.1'), ('{autostart: 1}', 'true or false'),
    ('{permit_topics: 3}', 'a list of strings'), ('{processor: 0.5}', 'an integer'),
    ('{limits: {joint9: {velocity: 1.0}}}', 'joint9'), ('{joints: [joint1, joint8]}', 'joint8'),
    ('{base: boat}', 'boat'), ('{tasks: {tip: {gain: [1.0, 2.0, 3.0]}}}', 'tasks.tip.gain'),
    ('{rate: 0.0, state_timeout: 0.0}', 'state_timeout must be from 0.001')])
@pytest.mark.slow
def test_parameters_that_are_wrong_are_faults(file, parameters, said):
    with pytest.raises(Refused, match=said):
        read([file(f'tp_controller: {{ros__parameters: {parameters}}}')], STACK, str(PLANAR_DH),
             '', None)


def test_values_that_a_node_accepts_are_no_faults(file):
    path = file('tp_controller:\n  ros__parameters: {rate: 0, joints: [], limit_tolerance: .inf, '
                'status_rate: 5e0}\n')
    given = read([path], STACK, str(PLANAR_DH), '', None)
    # Cycles as often as the simulator publishes, by its default.
    assert given.period == 1.0 / 200.0 and not given.ignored


@pytest.mark.slow
def test_a_check_needs_no_ros():
    code = ('import sys; sys.modules["rclpy"] = None\n'
            'from tp_controller.tools.check import parameter_file\n'
            'assert "rate" in parameter_file.DECLARED\n'
            'assert not [name for name in sys.modules if name.endswith("_msgs")]')
    subprocess.run([sys.executable, '-c', code], check=True)


@pytest.mark.parametrize('text', ['- a list', 'tp_controller: {rate: 3.0}', '{', 'a: {b: 3}',
                                  'tp_controller: {ros__parameters: 3}'])
@pytest.mark.slow
def test_other_files_are_refused(file, text):
    with pytest.raises(SettingsError, match='parameter file'):
        node_parameters(file(text), 'tp_controller')


def test_what_is_missing_is_told():
    for stack, robot, said in (('', str(PLANAR_DH), 'no stack'), (STACK, '', 'no robot')):
        with pytest.raises(Refused, match=said) as refused:
            read([], stack, robot, '', None)
        assert not refused.value.missing_file
    for arguments in (([], 'none.yaml', str(PLANAR_DH)), ([], STACK, 'none.urdf'),
                      (['none.yaml'], STACK, str(PLANAR_DH))):
        with pytest.raises((Refused, SettingsError)) as missing:
            read(*arguments, '', None)
        assert 'none.' in str(missing.value)


ROBOT_XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="joint" default="one"/><link name="a"/><link name="tip"/>
<joint name="$(arg joint)" type="continuous"><parent link="a"/><child link="tip"/></joint></robot>
"""


@pytest.mark.slow
def test_groups_are_those_of_the_controller(file):
    params = file(f'tp_controller: {{ros__parameters: {{robot: {PLANAR_DH}, '
                  'groups: "{first: [joint1, joint2]}"}}')
    stack = '- tip: {type: position, frame: link3, axes: xy, joints: first}'
    given = read([params], stack, '', '', None)
    assert given.robot.groups == {'first': ('joint1', 'joint2')}
    assert given.stack.tasks['tip'].joint_mask.tolist() == [True, True, False]


@pytest.mark.slow
@pytest.mark.parametrize('node', ['tp_controller', 'tp_simulator'])
def test_a_xacro_has_its_arguments(file, tmp_path, node):
    pytest.importorskip('xacro')
    path = tmp_path / 'robot.xacro'
    path.write_text(ROBOT_XACRO)
    params = file(f'{node}: {{ros__parameters: {{robot: {path}, '
                  "xacro_arguments: ['joint:=two']}}")
    stack = '- rest: {type: posture}'
    assert read([params], stack, '', '', None).robot.joint_names == ('two',)
    given = read([params], stack, '', '', None, xacro_arguments=['joint:=three'])
    assert given.robot.joint_names == ('three',)
    # Those of the file are not about another robot.
    assert read([params], stack, str(path), '', None).robot.joint_names == ('one',)
    assert read([params], stack, str(PLANAR_DH), '', None).robot.n == 3
    with pytest.raises(Refused, match="a xacro argument is name:=value, .* not 'joint=two'"):
        read([params], stack, str(path), '', None, xacro_arguments=['joint=two'])

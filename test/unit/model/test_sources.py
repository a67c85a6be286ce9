# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Sources of robot descriptions: names of `robot_descriptions`, formats, and what is refused."""

import sys
from types import ModuleType

import pinocchio
import pytest
import robots
from tp_controller import Robot, RobotError
from tp_controller.model.sources import describe

MJCF = ('<mujoco model="m"><worldbody><body name="a"><body name="b"><joint name="j"/></body>'
        '</body></worldbody></mujoco>')
XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="$(find parts)/parts.xacro"/><xacro:arg name="kind" default="slide"/>
<link name="a"/><link name="b"/><joint name="$(arg kind)_${suffix}" type="continuous">
<parent link="a"/><child link="b"/></joint></robot>"""
PARTS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="suffix" value="joint"/></robot>"""


@pytest.fixture
def package(monkeypatch):
    """Return a function that adds a robot to a package robot_descriptions without a network."""
    root, names = ModuleType('robot_descriptions'), ModuleType('robot_descriptions._descriptions')
    root.__path__, names.DESCRIPTIONS = [], {}
    monkeypatch.setitem(sys.modules, 'robot_descriptions', root)
    monkeypatch.setitem(sys.modules, 'robot_descriptions._descriptions', names)

    def add(name, **paths):
        module = ModuleType(f'robot_descriptions.{name}')
        vars(module).update(paths)
        names.DESCRIPTIONS[name] = None
        monkeypatch.setitem(sys.modules, module.__name__, module)

    add.names = names.DESCRIPTIONS
    return add


def test_a_urdf_is_found_by_its_name(package):
    package('panda_description', URDF_PATH=str(robots.urdf_path('panda')))
    for robot in (Robot.from_file('robot_descriptions:panda_description'),
                  Robot.from_urdf('robot_descriptions:panda_description')):
        assert robot.joint_names == Robot.from_file(robots.urdf_path('panda')).joint_names


@pytest.mark.slow
def test_an_mjcf_is_found_by_its_name(package, tmp_path):
    (tmp_path / 'm.xml').write_text(MJCF)
    package('m_mj_description', MJCF_PATH=str(tmp_path / 'm.xml'))
    assert Robot.from_file('robot_descriptions:m_mj_description').joint_names == ('j',)


def test_a_xacro_has_the_arguments_and_packages_of_its_name(package, tmp_path):
    (tmp_path / 'r.xacro').write_text(XACRO)
    (tmp_path / 'far').mkdir()
    (tmp_path / 'far' / 'parts.xacro').write_text(PARTS)
    package('r_description', XACRO_PATH=str(tmp_path / 'r.xacro'), XACRO_ARGS={'kind': 'turn'},
            XACRO_PACKAGE_PATHS={'parts': str(tmp_path / 'far')})
    name = 'robot_descriptions:r_description'
    assert Robot.from_file(name).joint_names == ('turn_joint',)
    robot = Robot.from_file(name, xacro_arguments=['kind:=roll'])
    assert robot.joint_names == ('roll_joint',)


def test_an_unknown_name_is_named_with_a_similar_one(package):
    package('panda_description')
    with pytest.raises(RobotError, match="unknown robot description 'panda_descripton' .did you "
                                         "mean 'panda_description'.*robot_descriptions list"):
        Robot.from_file('robot_descriptions:panda_descripton')


def test_a_robot_that_cannot_be_downloaded_or_read_is_named(package):
    # A known name without a module cannot be imported, as without a network.
    package.names['far_description'] = None
    package('srdf_description', SRDF_PATH='x.srdf')
    package('lost_description', URDF_PATH='/no/such/robot.urdf')
    for name, message in (('far', 'far_description cannot be downloaded: No module'),
                          ('srdf', 'has neither URDF, xacro nor MJCF'),
                          ('lost', 'no file /no/such/robot.urdf')):
        with pytest.raises(RobotError, match=message):
            Robot.from_file(f'robot_descriptions:{name}_description')


def test_a_missing_package_is_named_with_its_installation(monkeypatch):
    for name in ('robot_descriptions', 'robot_descriptions._descriptions'):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(RobotError, match='is missing: install it by "pip install robot_desc'):
        Robot.from_file('robot_descriptions:panda_description')


@pytest.mark.slow
@pytest.mark.parametrize('text', [
    f'<?xml version="1.0"?>\n<!-- a <robot> -->\n{MJCF}', ' ' * 20_000 + MJCF])
def test_the_format_is_that_of_the_outermost_element(tmp_path, text):
    path = tmp_path / 'robot.urdf'
    path.write_text(text)
    assert describe(text).urdf == describe(path).urdf
    assert Robot.from_file(path).joint_names == ('j',)


@pytest.mark.slow
def test_macros_in_comments_do_not_count(tmp_path):
    path = tmp_path / 'robot.urdf'
    path.write_text(robots.CHAIN.replace('<link name="l1"/>',
                                         '<!-- <xacro:arm/> --><link name="l1"/>'))
    for source in (path, path.read_text()):
        assert Robot.from_file(source).joint_names == ('a', 'c')


def test_a_model_is_taken_by_both_readers():
    model = pinocchio.buildModelFromUrdf(str(robots.urdf_path('ur5')))
    assert Robot.from_file(model).urdf == Robot.from_urdf(model).urdf
    with pytest.raises(RobotError, match='are for the file of a xacro, not for a model of Pin'):
        Robot.from_file(model, xacro_arguments={'a': 1})


@pytest.mark.parametrize('source, message', [
    (5, 'needs text, the name of a file or a pinocchio.Model, got 5'), (None, 'got None'),
    ('', 'no file: its name is empty'), ('robot_descriptions:', "unknown robot description ''"),
    ('<mujoco', 'not valid XML'), ('<mujoco><worldbody/></mujoco>', 'let MuJoCo write'),
    ('<robot>' + ' ' * 2_000_000, 'at most 2000000 are read'), ('\ud800<a/>', 'not valid XML')])
def test_other_sources_are_refused(package, source, message):
    for read in (Robot.from_file, Robot.from_urdf):
        with pytest.raises(RobotError, match=message):
            read(source)


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / 'robot.urdf'
    path.write_bytes(b'\xff\xfe<')
    with pytest.raises(RobotError, match='robot.urdf is not text in UTF-8'):
        Robot.from_file(path)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Expansion of xacro files: arguments, packages, and faults with their places."""

import sys

import pytest
import robots
from tp_controller import Robot, RobotError
from tp_controller.model.xacro_files import expand_xacro, xacro_values

pytest.importorskip('xacro')
HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
ARM = HEAD + """<xacro:arg name="length" default="1.5"/>
<xacro:arg name="tool" default="true"/>
<xacro:macro name="joint" params="name parent child">
  <link name="${child}"/>
  <joint name="${name}" type="revolute"><parent link="${parent}"/><child link="${child}"/>
    <origin xyz="0 0 $(arg length)"/><axis xyz="0 1 0"/>
    <limit lower="-${pi/2}" upper="1" velocity="2" effort="0"/></joint>
</xacro:macro>
<link name="base"/>
<xacro:joint name="a" parent="base" child="b"/>
<xacro:if value="$(arg tool)"><xacro:joint name="c" parent="b" child="tip"/></xacro:if>
</robot>"""


@pytest.fixture
def arm(tmp_path):
    """Return the file of a robot in xacro."""
    path = tmp_path / 'arm.urdf.xacro'
    path.write_text(ARM)
    return path


def test_a_xacro_is_the_robot_that_it_expands_to(arm):
    robot = Robot.from_file(arm)
    assert robot.joint_names == ('a', 'c') and robot.name == 'r'
    assert robot.lower[0] == pytest.approx(-1.5707963267948966, abs=0.0)
    assert robot.state([0.0, 0.0]).position('tip').tolist() == [0.0, 0.0, 3.0]


@pytest.mark.slow
@pytest.mark.parametrize('arguments', [
    {'length': 0.25, 'tool': False}, ['length:=0.25', 'tool:=false', '']])
def test_arguments_replace_defaults(arm, arguments):
    for robot in (Robot.from_file(str(arm), xacro_arguments=arguments),
                  Robot.from_urdf(arm, xacro_arguments=arguments)):
        assert robot.joint_names == ('a',)
        assert robot.state([0.0]).position('b')[2] == 0.25


@pytest.mark.slow
def test_macros_are_expanded_in_files_of_any_name(arm):
    plain = arm.rename(arm.with_name('arm.urdf'))
    assert Robot.from_file(plain).joint_names == ('a', 'c')


def package(folder, name, manifest=True):
    """Make a package with a file that has a property, and return its folder."""
    folder.mkdir(parents=True)
    if manifest:
        (folder / 'package.xml').write_text(f'<package><name> {name} </name></package>')
    (folder / 'sizes.xacro').write_text(
        HEAD + '<xacro:property name="length" value="0.125"/></robot>')
    return folder


USER = HEAD + """<xacro:include filename="$(find sizes)/sizes.xacro"/><link name="base"/>
<link name="b"/><joint name="a" type="prismatic"><parent link="base"/><child link="b"/>
<limit lower="0" upper="${length}" velocity="1" effort="0"/></joint></robot>"""


@pytest.mark.slow
@pytest.mark.parametrize('where', ['above', 'beside', 'by manifest', 'path', 'prefix'])
def test_packages_are_found_without_ros(tmp_path, monkeypatch, where):
    monkeypatch.setitem(sys.modules, 'ament_index_python', None)
    monkeypatch.setitem(sys.modules, 'ament_index_python.packages', None)
    for variable in ('ROS_PACKAGE_PATH', 'AMENT_PREFIX_PATH'):
        monkeypatch.delenv(variable, raising=False)
    folders = {'above': 'sizes', 'by manifest': 'Sizes_of_Robots', 'beside': 'other/sizes',
               'path': 'far/sizes', 'prefix': 'far/share/sizes'}
    package(tmp_path / folders[where], 'sizes', where != 'beside')
    user = {'above': 'sizes/urdf', 'by manifest': 'Sizes_of_Robots/urdf',
            'beside': 'other/user/urdf'}.get(where, 'user')
    (tmp_path / user).mkdir(parents=True, exist_ok=True)
    if where in ('path', 'prefix'):
        monkeypatch.setenv({'path': 'ROS_PACKAGE_PATH', 'prefix': 'AMENT_PREFIX_PATH'}[where],
                           f'/no/such/folder:{tmp_path / "far"}')
    path = tmp_path / user / 'robot.xacro'
    path.write_text(USER)
    assert Robot.from_file(path).upper.tolist() == [0.125]


def test_given_packages_precede_those_that_are_found(tmp_path):
    folder = package(tmp_path / 'elsewhere', 'another')
    path = tmp_path / 'robot.xacro'
    path.write_text(USER)
    assert 'upper="0.125"' in expand_xacro(path, {}, {'sizes': folder})


def test_own_package_is_found(tmp_path):
    path = tmp_path / 'robot.xacro'
    path.write_text(HEAD + '<link name="$(find tp_controller)"/></robot>')
    assert f'<link name="{robots.REPOSITORY}"/>' in expand_xacro(path, {})


@pytest.mark.slow
@pytest.mark.parametrize('body, message', [
    ('<link/>\n<xacro:foo/>', 'line 3: unknown macro name: xacro:foo'),
    ('\n<link name="${x*2}"/>', "line 3: name 'x' is not defined when evaluating expr"),
    ('<a>\n<b>', 'line 3: mismatched tag'),
    ('<xacro:include filename="bad.xacro"/>', 'line 2: files include each other'),
    ('<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>', 'macros call each other'),
    ('<xacro:macro name="m" params="y">\n\n<link name="${y+1}"/></xacro:macro>\n<xacro:m y="q"/>',
     'line 4: can only concatenate'),
    ('\n<xacro:include filename="none.xacro"/>', r'bad.xacro, line 3: no file .*none.xacro'),
    ('<xacro:include filename="$(find no_such)/x"/>', "line 2: package 'no_such' is not found"),
    ('<link name="$(arg length)"/>',
     "line 2: argument 'length' has no value; give it one, as length:=value"),
    ('<link name="${1/0}"/>', 'line 2: division by zero'),
    ('<link name="${().__class__}"/>', 'invalid name'),
    ('<xacro:if value="maybe"/>', 'line 2: .*maybe'),
    ('${xacro.load_yaml("no.yaml")}', 'No such file or directory: .*no.yaml$'),
    ('${"a" * 3000000}', 'bad.xacro: it expands to a text of 3000.* at most 2000000'),
])
def test_faults_are_named_with_their_places(tmp_path, body, message):
    path = tmp_path / 'bad.xacro'
    path.write_text(f'{HEAD}{body}</robot>')
    with pytest.raises(RobotError, match=f'xacro {tmp_path}.*{message}'):
        Robot.from_file(path)


def test_a_document_type_is_refused(tmp_path):
    path = tmp_path / 'bad.xacro'
    path.write_text('<!DOCTYPE a [<!ENTITY x "y">]>' + HEAD + '</robot>')
    with pytest.raises(RobotError, match='document type'):
        Robot.from_file(path)


@pytest.mark.slow
def test_an_optional_include_may_be_missing(tmp_path):
    path = tmp_path / 'robot.xacro'
    # What follows is relative to the file, not to the missing one.
    (tmp_path / 'base.xacro').write_text(f'{HEAD}<link name="base"/></robot>')
    path.write_text(ARM.replace(
        '<link name="base"/>', '<xacro:include filename="none/none.xacro" optional="true"/>'
                               '<xacro:include filename="base.xacro"/>'))
    assert Robot.from_file(path).joint_names == ('a', 'c')


def test_a_fault_leaves_nothing_behind(arm, tmp_path):
    from xacro import substitution_args
    find, path = substitution_args._eval_find, tmp_path / 'bad.xacro'
    path.write_text(f'{HEAD}<xacro:foo/></robot>')
    with pytest.raises(RobotError):
        Robot.from_file(path)
    assert substitution_args._eval_find is find
    assert Robot.from_file(arm).joint_names == ('a', 'c')


@pytest.mark.parametrize('arguments, message', [
    ({'lenght': 1}, "unknown argument 'lenght' .did you mean 'length'.*; valid: length, tool"),
    (['length=1'], "a xacro argument is name:=value, such as ur_type:=ur5e, not 'length=1'"),
    ([':=1'], 'a xacro argument is name:=value'), ([1], 'a xacro argument is name:=value'),
    ('length:=1', "must be a list or mapping, not 'length:=1'"), (5, 'must be a list or mapping'),
    ({'length': None}, "'length': needs a text or number, not None"),
    ({1: 'x'}, 'argument 1: needs a text')])
def test_arguments_that_are_not_valid_are_named(arm, arguments, message):
    with pytest.raises(RobotError, match=message):
        Robot.from_file(arm, xacro_arguments=arguments)


def test_an_unknown_argument_is_named_with_the_fault_that_it_leads_to(tmp_path):
    path = tmp_path / 'bad.xacro'
    path.write_text(HEAD + '<link name="$(arg length)"/></robot>')
    with pytest.raises(RobotError, match="'length' has no value.*; unknown argument 'lenght' .did "
                                         "you mean 'length'"):
        Robot.from_file(path, xacro_arguments={'lenght': 1})


def test_values_of_arguments_may_have_any_characters():
    assert xacro_values({'a': True, 'b': 1.5}) == {'a': 'true', 'b': '1.5'}
    assert xacro_values(['a:=b:=c', ' d :=', 'e:= f']) == {'a': 'b:=c', 'd': '', 'e': ' f'}


@pytest.mark.parametrize('source', [
    'package://tp_controller/config/robots/panda.yaml',
    'package://tp_controller/config/robots/two_arms.urdf', robots.CHAIN])
def test_arguments_of_another_description_are_refused(source):
    with pytest.raises(RobotError, match='xacro arguments .*are for the file of a xacro, not for'):
        Robot.from_file(source, xacro_arguments={'a': 1})


def test_a_missing_package_is_named_with_its_installation(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, 'xacro', None)
    with pytest.raises(RobotError, match='xacro is missing: install it by "pip install xacro"'):
        Robot.from_file(arm)

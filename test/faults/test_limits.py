# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Whatever is read is read or refused soon, and the message names the limit."""

import os
from pathlib import Path
import time

import numpy as np
import pytest
import robots
from tp_controller import (
    GoalError,
    resources,
    Robot,
    RobotError,
    Settings,
    SettingsError,
    Stack,
    StackError,
)
from tp_controller.errors import suggestion
from tp_controller.model import urdf
from tp_controller.model.simulator import initial_positions, SimulatorNoise
from tp_controller.model.srdf import srdf_pairs
from tp_controller.model.urdf_solids import urdf_solids
from tp_controller.resources import find_file, load_xml, load_yaml, read_source
from tp_controller.solver.errors import SolverError
from tp_controller.solver.solve import solve
from tp_controller.tasks import stack_reader
from tp_controller.tasks.collision import MOST_PAIRS

# What takes longer than this on a machine that does nothing else took minutes without limits [s].
SOON = 5.0
TASK = '- t{}: {{type: posture}}\n'


def aliases(levels):
    """Return a stack whose only gain stands for 9^levels numbers."""
    lists = ''.join(f', &a{level} [{", ".join([f"*a{level - 1}"] * 9)}]'
                    for level in range(1, levels))
    return f'- a: {{type: posture, gain: [&a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]{lists}]}}\n'


def merges(levels):
    """Return a mapping made of 9^levels merged ones."""
    return 'a0: &a0 {x: 1}\n' + ''.join(
        f'a{level}: &a{level} {{<<: [{", ".join([f"*a{level - 1}"] * 9)}]}}\n'
        for level in range(1, levels))


def chain(links, moving):
    """Return a URDF whose first joints move and whose others are fixed."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for number in range(1, links):
        kind = 'revolute' if number <= moving else 'fixed'
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' * (kind == 'revolute')
        parts.append(f'<link name="l{number}"/><joint name="j{number}" type="{kind}"><parent '
                     f'link="l{number - 1}"/><child link="l{number}"/>{limit}</joint>')
    return ''.join(parts) + '</robot>'


def entities(levels):
    """Return a URDF whose name stands for 10^levels letters."""
    declared = ''.join(f'<!ENTITY a{level} "{f"&a{level - 1};" * 10}">'
                       for level in range(1, levels))
    return f'<!DOCTYPE r [<!ENTITY a0 "a">{declared}]><robot name="&a{levels - 1};"/>'


def refusal(text):
    """Return why a stack is refused, which must be soon."""
    began = time.process_time()
    with pytest.raises(StackError) as error:
        Stack.from_yaml(text, robots.panda())
    assert time.process_time() - began < SOON
    return str(error.value)


@pytest.mark.parametrize('text, message', [
    (aliases(8), 'more than 10000 values, counting what aliases stand for'),
    (aliases(200), 'more than 10000 values'),
    ('- a: &x {type: posture, gain: [*x]}\n', 'the alias *x is part of what it stands for'),
    ('- a: ' + 300 * '[', 'nested too deeply, in more than 32 levels'),
    (100_000 * '- ', 'nested too deeply'),
    ('- a: {type: posture, gain: ' + 2000 * '1' + '}', 'of more than 1000 characters'),
    ('- {"\\ud800": {type: posture}}', 'half of a character'),
    ('- a: {type: "\\udfff"}', 'half of a character'),
    (''.join(TASK.format(number) for number in range(30_000)),
     'characters; at most 250000 are read'),
    (''.join(TASK.format(number) for number in range(101)), 'line 101: more than 100 tasks'),
    ('- [' + ', '.join(TASK.format(number)[2:-1] for number in range(101)) + ']',
     'more than 100 tasks'),
    ('- a: {type: "' + 200_000 * 'x' + '"}', "unknown type 'xxx"),
    ('- a: {type: posture, ' + ', '.join(f'k{number}: 1' for number in range(3000)) + '}',
     'and 2970 more')])
def test_stacks_beyond_a_limit_are_refused_soon(text, message):
    found = refusal(text)
    assert message in found and len(found) <= 10_002


@pytest.mark.parametrize('text, message', [
    (merges(12), 'more than 10000 values'), ('&x [*x]', 'the alias *x is part of'),
    ('[' + 9999 * '1, ' + ']', None), ('[' + 10_000 * '1, ' + ']', 'more than 10000 values'),
    (32 * '[' + 32 * ']', None), (33 * '[' + 33 * ']', 'more than 32 levels'),
    (1000 * 'x', None), (1001 * 'x', 'of more than 1000 characters'),
    ('"' + 249_998 * 'x' + '"', None), (250_001 * ' ', 'at most 250000'),
    ('[&a [1, 1], *a, *a]', None), ('1' + 400 * ':1' + '.5', 'not valid YAML')])
def test_limits_of_yaml_are_where_the_messages_say(text, message):
    if message is None:
        load_yaml(text)
    else:
        with pytest.raises(ValueError, match='not valid YAML|characters') as error:
            load_yaml(text)
        assert message in str(error.value)


def test_what_an_alias_stands_for_counts_as_often_as_it_is_used():
    hundred = '[' + 99 * '1, ' + ']'
    load_yaml(f'[&a {hundred}' + 98 * ', *a' + ']')
    with pytest.raises(ValueError, match='more than 10000 values'):
        load_yaml(f'[&a {hundred}' + 99 * ', *a' + ']')


def test_long_name_is_cut_and_not_compared_with_all_valid_ones():
    assert suggestion(10 * 'frame', ['frame']) == repr(10 * 'frame')
    assert suggestion(100_000 * 'frame', ['frame']) == "'" + (40 * 'frame')[:199] + ' …'


def test_no_name_is_suggested_in_its_own_place():
    # As of a package whose files are not found.
    assert suggestion('frame', ['frame']) == "'frame'"
    assert suggestion('frame', ['frames', 'frame']) == "'frame' (did you mean 'frames'?)"


def test_no_more_tasks_are_read_once_they_took_too_long(monkeypatch):
    monkeypatch.setattr(stack_reader, 'READ_SECONDS', -1.0)
    assert 'the tasks above took more than -1 s to read' in refusal(TASK.format(1))


@pytest.mark.parametrize('text, message', [
    (entities(10), 'a document type (<!DOCTYPE …>) is not read'),
    ('<!DOCTYPE robot SYSTEM "file:///etc/passwd"><robot/>', 'a document type'),
    ('<robot>' + 100_000 * '<a>', 'nested too deeply, in more than 64 levels'),
    ('<robot>' + 20_000 * '<a/>' + '</robot>', 'more than 20000 elements'),
    ('<robot>' + 2_000_000 * ' ' + '</robot>', 'characters; at most 2000000 are read'),
    (chain(20_000, 1)[:1_999_990] + '<!--', 'more than 20000 elements'),
    (chain(1001, 1), '1001 links; at most 1000 are read'),
    (chain(200, 151), 'more than 150 joints that move'),
    ('<robot name="\ud800"/>', 'not valid XML'), ('<robot', 'not valid XML')])
def test_descriptions_beyond_a_limit_are_refused_soon(text, message):
    began = time.process_time()
    with pytest.raises(RobotError) as error:
        Robot.from_urdf(text)
    assert message in str(error.value)
    assert time.process_time() - began < SOON


def test_largest_descriptions_are_read():
    assert len(Robot.from_urdf(chain(1000, 150)).joint_names) == 150


def test_limits_suffice_for_the_largest_robots_there_are():
    large = robots.urdf_path('tiago').with_name('tiago_dual.urdf').read_text()
    tree = load_xml(large)
    assert 4 * len(large) < resources.MOST_XML_CHARACTERS
    assert 4 * sum(1 for _ in tree.iter()) < resources.MOST_XML_ELEMENTS
    assert 4 * len(tree.findall('link')) < urdf.MOST_LINKS
    assert 1.4 * len(urdf.moving_joints(tree)) < urdf.MOST_MOVING_JOINTS


def test_encoding_that_a_description_names_says_nothing():
    text = robots.urdf_path('panda').read_text().partition('?>')[2]
    robot = Robot.from_urdf('<?xml version="1.0" encoding="foo"?>' + text)
    assert robot.n == robots.urdf_robot('panda').n


def test_piece_that_ends_anywhere_changes_nothing(monkeypatch):
    text = '<?xml version="1.0"?>\n<a b="&lt;ü&#x1F600;"><!-- c -->😀<d/></a>'
    monkeypatch.setattr(resources, 'XML_CHUNK', 1)
    tree = load_xml(text)
    assert (tree.get('b'), tree[0].tail or tree.text) == ('<ü😀', '😀')


def test_xml_that_comes_as_text_has_the_same_limits():
    load_xml('<a>' + 1_999_993 * ' ' + '</a>')
    with pytest.raises(ValueError, match='a text of 2000001 characters; at most 2000000 are read'):
        load_xml('<a>' + 1_999_994 * ' ' + '</a>')


def test_srdf_has_the_same_limits():
    with pytest.raises(ValueError, match='more than 20000 elements'):
        srdf_pairs('<robot>' + 20_000 * '<a/>' + '</robot>')
    with pytest.raises(ValueError, match='a document type'):
        srdf_pairs(entities(10))


def balls(links, moving):
    """Return the robot of a chain with a ball on each link."""
    text = chain(links, moving)
    for number in range(links):
        text = text.replace(
            f'<link name="l{number}"/>', f'<link name="l{number}"><collision><geometry>'
            '<sphere radius="0.01"/></geometry></collision></link>')
    return Robot.from_urdf(text)


def test_too_many_pairs_are_refused():
    robot = balls(400, 150)
    with pytest.raises(StackError, match='links: at most 15000 pairs of shapes, got '):
        Stack.from_yaml('- a: {type: self_collision}', robot)
    task = Stack.from_yaml('- a: {type: obstacles}', robot).tasks['a']
    ball = {'shape': {'sphere': 0.1}, 'at': [1.0, 0.0, 0.0]}
    most = MOST_PAIRS // 400
    task.set_goal(task.parse_goal({str(number): ball for number in range(most)}), 0.0)
    with pytest.raises(GoalError, match=f'at most {most} obstacles, got {most + 1}'):
        task.parse_goal({'one more': ball})


# Files


@pytest.mark.parametrize('name', ['fifo', 'folder', '/dev/zero', '/dev/stdin'])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, name):
    os.mkfifo(tmp_path / 'fifo')
    (tmp_path / 'folder').mkdir()
    path = tmp_path / name
    assert f'no file {path}: it is no regular file' in refusal(str(path))
    with pytest.raises(RobotError, match='it is no regular file'):
        Robot.from_file(path)


def test_fifo_in_the_place_of_a_file_does_not_block(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / 'fifo')
    monkeypatch.setattr(Path, 'is_file', lambda path: True)
    with pytest.raises(FileNotFoundError, match='it is no regular file'):
        read_source(tmp_path / 'fifo', bool)


def test_no_more_of_a_file_is_read_than_its_limit(tmp_path):
    path = tmp_path / 'large.yaml'
    with open(path, 'wb') as file:
        file.truncate(10 ** 12)
    assert f'{path} is longer than 250000 bytes' in refusal(str(path))
    with pytest.raises(RobotError, match='is longer than 2000000 bytes'):
        Robot.from_urdf(path)


def test_long_text_in_place_of_a_name_is_not_repeated():
    assert len(refusal(100_000 * 'x')) < 200


@pytest.mark.parametrize('end', ['\n', '\r\n', '\r'])
def test_lines_end_as_they_do_in_any_text(tmp_path, end):
    path = tmp_path / 'stack.yaml'
    path.write_bytes(f'- a: {{type: posture}}{end}- b: 1{end}'.encode())
    assert refusal(str(path)).startswith('line 2: b')


def test_half_written_stack_is_not_taken_for_a_shorter_one(tmp_path, monkeypatch):
    path, slept = tmp_path / 'stack.yaml', []
    lines = [TASK.format(number) for number in range(4)]
    path.write_text(''.join(lines[:2]))

    def sleep(seconds):
        slept.append(seconds)
        path.write_text(''.join(lines[:2 + len(slept)]))

    monkeypatch.setattr(resources.time, 'sleep', sleep)
    # Each time it is read just after it changed, at last when it has been complete for a while.
    monkeypatch.setattr(resources.time, 'time', lambda: os.stat(path).st_mtime + (
        2.0 if len(slept) == 2 else 0.9) * resources.SETTLING_TIME)
    assert len(Stack.from_yaml(path, robots.planar()).tasks) == 4
    assert slept == [resources.SETTLING_TIME] * 2


def test_pause_of_a_tenth_of_a_second_is_not_the_end_of_a_file(tmp_path, monkeypatch):
    path, ages = tmp_path / 'stack.yaml', [0.1, 1.0]
    path.write_text(TASK.format(1))
    monkeypatch.setattr(resources.time, 'sleep',
                        lambda seconds: path.write_text(TASK.format(1) + TASK.format(2)))
    monkeypatch.setattr(resources.time, 'time', lambda: os.stat(path).st_mtime + ages.pop(0))
    assert len(Stack.from_yaml(path, robots.planar()).tasks) == 2


def test_file_that_never_settles_is_refused(tmp_path, monkeypatch):
    path = tmp_path / 'stack.yaml'
    path.write_text(TASK.format(1))
    passed = iter(np.arange(0.0, 10.0, 0.3))
    monkeypatch.setattr(resources.time, 'monotonic', lambda: next(passed))
    monkeypatch.setattr(resources.time, 'time', lambda: os.stat(path).st_mtime)
    monkeypatch.setattr(resources.time, 'sleep', lambda seconds: None)
    with pytest.raises(ValueError, match='has been changing for 1 s'):
        read_source(path, lambda text: False)


@pytest.mark.parametrize('later', [-1000.0, 1000.0])
def test_file_of_another_time_is_read_at_once(tmp_path, monkeypatch, later):
    path = tmp_path / 'stack.yaml'
    path.write_text('x')
    os.utime(path, (time.time() + later,) * 2)
    monkeypatch.delattr(resources.time, 'sleep')
    assert read_source(path, lambda text: False) == 'x'


# Packages


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Return a workspace with the share directory of a package, its source and its build."""
    share = tmp_path / 'install' / 'arm' / 'share' / 'arm'
    for folder in (share, tmp_path / 'src' / 'my_arm', tmp_path / 'build' / 'arm'):
        folder.mkdir(parents=True)
        (folder / 'a.txt').write_text(str(folder))
    (tmp_path / 'secret.txt').write_text('secret')
    monkeypatch.setattr(resources, 'package_share', lambda package, near=None: share)
    return tmp_path


@pytest.mark.parametrize('rest', [
    '../../../../secret.txt', 'x/../../../../../secret.txt', '/etc/passwd', '//etc/passwd', '..',
    'link.txt', 'folder/secret.txt', 'a.txt\0'])
def test_no_path_leads_out_of_its_package(packages, rest):
    share = resources.package_share('arm')
    (share / 'x').mkdir()
    (share / 'link.txt').symlink_to(packages / 'secret.txt')
    (share / 'folder').symlink_to(packages)
    with pytest.raises(FileNotFoundError, match='no file') as error:
        find_file(f'package://arm/{rest}')
    assert str(error.value).endswith('leads out of its package') or rest in ('..', 'a.txt\0')
    mesh = (f'<robot name="r"><link name="a"><collision><geometry><mesh filename="package://arm/'
            f'{rest}"/></geometry></collision></link></robot>')
    if '\0' not in rest:
        with pytest.raises(RobotError, match='cannot be read: a: no file'):
            urdf_solids(mesh, ['a'])


def test_path_may_go_up_within_its_package(packages):
    share = resources.package_share('arm')
    (share / 'urdf').mkdir()
    assert find_file('package://arm/urdf/../a.txt').read_text() == str(share)


def test_links_to_source_and_build_of_a_package_are_its_own(packages):
    share = resources.package_share('arm')
    source, build = packages / 'src' / 'my_arm', packages / 'build' / 'arm'
    (source / 'package.xml').write_text('<package/>')
    for name, target in (('package.xml', source / 'package.xml'),
                         ('source.txt', source / 'a.txt'), ('built.txt', build / 'a.txt')):
        (share / name).symlink_to(target)
    for name, folder in (('a.txt', share), ('source.txt', source), ('built.txt', build)):
        assert find_file(f'package://arm/{name}').read_text() == str(folder)


# Meshes


def stl(path, triangles):
    """Write a binary STL of triangles (m, 3, 3)."""
    content = np.zeros(len(triangles), [('normal', '<f4', 3), ('corners', '<f4', (3, 3)),
                                        ('rest', '<u2')])
    content['corners'] = triangles
    path.write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + content.tobytes())


def with_mesh(path, scale='1 1 1'):
    """Return the URDF of a link with a mesh."""
    return (f'<robot name="r"><link name="a"><collision><geometry><mesh filename="{path}" '
            f'scale="{scale}"/></geometry></collision></link></robot>')


@pytest.mark.parametrize('scale', ['1 1 1', '0.5 2 3', '-1 1 1'])
def test_hull_of_a_binary_stl_is_the_one_that_coal_finds(tmp_path, scale, monkeypatch):
    stl(tmp_path / 'a.stl', np.random.default_rng(1).normal(size=(200, 3, 3)))
    solid, = urdf_solids(with_mesh(tmp_path / 'a.stl', scale), ['a'])
    monkeypatch.setattr('tp_controller.model.solids.binary_stl', lambda path: None)
    (tmp_path / 'b.stl').write_bytes((tmp_path / 'a.stl').read_bytes())
    other, = urdf_solids(with_mesh(tmp_path / 'b.stl', scale), ['a'])
    hulls = [solid.geometry, other.geometry]
    assert len({hull.num_points for hull in hulls}) == 1
    corners = [sorted(np.round(hull.points(), 6).tolist()) for hull in hulls]
    assert corners[0] == corners[1]
    assert hulls[0].computeVolume() == pytest.approx(hulls[1].computeVolume())


def test_mesh_is_read_again_only_when_its_file_changed(tmp_path):
    path = tmp_path / 'a.stl'
    rng = np.random.default_rng(2)
    stl(path, rng.normal(size=(20, 3, 3)))
    first, second = (urdf_solids(with_mesh(path), ['a'])[0] for _ in range(2))
    assert first.geometry is second.geometry
    stl(path, rng.normal(size=(30, 3, 3)))
    os.utime(path, ns=(1, 1))
    assert urdf_solids(with_mesh(path), ['a'])[0].geometry is not first.geometry


@pytest.mark.parametrize('corners', [np.zeros((4, 3, 3)), np.full((4, 3, 3), np.nan),
                                     np.zeros((0, 3, 3))])
def test_mesh_without_a_volume_is_refused(tmp_path, corners):
    stl(tmp_path / 'a.stl', corners)
    with pytest.raises(RobotError, match='collision meshes cannot be read: a: '):
        urdf_solids(with_mesh(tmp_path / 'a.stl'), ['a'])


def test_large_mesh_is_refused(tmp_path):
    path = tmp_path / 'a.dae'
    with open(path, 'wb') as file:
        file.truncate(20_000_001)
    with pytest.raises(RobotError, match='20000001 bytes; at most 20000000 are read'):
        urdf_solids(with_mesh(path), ['a'])


# YAML has whole numbers of any size, and Python adds up what no float can hold.
HUGE = 10 ** 400


@pytest.mark.parametrize('value', [HUGE, -HUGE])
@pytest.mark.parametrize('key', ['lower', 'upper', 'velocity', 'acceleration'])
def test_a_limit_that_no_float_can_hold_is_refused(key, value):
    with pytest.raises(RobotError, match=f'joint1: {key} limit must be a number'):
        Robot.from_file(robots.PLANAR_DH, limits={'joint1': {key: value}})


@pytest.mark.parametrize('value', [HUGE, -HUGE])
def test_a_number_that_no_float_can_hold_is_refused_wherever_numbers_are_read(value):
    robot = Robot.from_file(robots.PLANAR_DH)
    with pytest.raises(RobotError, match='initial positions: joint1 must be a finite number'):
        initial_positions(f'joint1: {value}', robot)
    for key in ('noise', 'delay', 'lag', 'drop'):
        with pytest.raises(SettingsError, match=f'{key} must be'):
            SimulatorNoise(**{key: value})
    for key in ('period', 'damping', 'weights'):
        with pytest.raises(SettingsError, match=f'{key} must be'):
            Settings(**{key: (value,) * 3 if key == 'weights' else value})
    with pytest.raises(RobotError, match='a must be a number'):
        Robot.from_dh(f'joints: [{{name: one, a: {value}}}]')
    with pytest.raises(StackError, match='gain'):
        Stack.from_yaml(f'- tip: {{type: posture, gain: {value}}}', robot)
    for key in ('damping', 'singular_region', 'regularisation', 'period'):
        with pytest.raises(SolverError, match=f'{key} must be'):
            solve([([[1.0]], [1.0])], **{key: value})
    for key in ('weights', 'lower', 'upper'):
        with pytest.raises(SolverError, match='number|int too large'):
            solve([([[1.0]], [1.0])], **{key: [value]})
    with pytest.raises(SolverError, match='int too large'):
        solve([([[value]], [1.0])])

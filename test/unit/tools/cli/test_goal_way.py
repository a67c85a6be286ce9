# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ways on the command line: their options, and tables of goals."""

import pytest
from tp_controller.errors import GoalError
from tp_controller.tools.cli.goal import _fault
from tp_controller.tools.cli.goal_way import read_way, way
from tp_controller.tools.cli.main import make_parser


def options(*words):
    """Return the options of a goal."""
    return make_parser().parse_args(['goal', 'tool', *words])


@pytest.mark.parametrize('words, told', [
    (('--speed', '0.1'), 'need a goal'),
    (('--linear', '1', '0', '0', '--speed', '0.1'), 'velocities have no way'),
    (('--xyz', '1', '0', '0', '--file', 'a.csv'), '--file has all goals'),
    (('--via', '1', '0', '0', '--speed', '0.1'), 'give --xyz'),
    (('--via', '1', '0', '0', '--xyz', '1', '0', '0'), '--via needs a --speed'),
    (('--via', '1', '0', '0', '--xyz', '1', '0', '0', '--duration', '1'), 'for one goal'),
    (('--xyz', '1', '0', '0', '--speed', '0.1'), '')])
def test_options_that_contradict_each_other_are_named(words, told):
    fault = _fault(options(*words))
    assert told in fault
    assert bool(fault) == bool(told)


def test_points_on_the_way_have_the_orientation_of_the_goal():
    values, times = way(
        options('--via', '1', '0', '0', '--via', '2', '0', '0', '--xyz', '3', '0', '0',
                '--speed', '1'), {'xyz': [3.0, 0.0, 0.0], 'quat_xyzw': [0.0, 0.0, 0.0, 1.0]})
    assert [value['xyz'][0] for value in values] == [1.0, 2.0, 3.0]
    assert all(value['quat_xyzw'] == [0.0, 0.0, 0.0, 1.0] for value in values)
    assert times is None


def test_duration_is_the_time_of_the_goal():
    assert way(options('--xyz', '3', '0', '0', '--duration', '2.5'), {'xyz': [3.0, 0.0, 0.0]}) == (
        [{'xyz': [3.0, 0.0, 0.0]}], [2.5])


def test_file_has_goals_and_times(tmp_path):
    path = tmp_path / 'way.csv'
    path.write_text('t, x, y, z\n0.5, 1, 2, 3\n1.5, 4, 5, 6\n', encoding='utf-8')
    assert read_way(path) == ([{'xyz': [1.0, 2.0, 3.0]}, {'xyz': [4.0, 5.0, 6.0]}], [0.5, 1.5])
    path.write_text('x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,1\n', encoding='utf-8')
    assert read_way(path) == (
        [{'xyz': [1.0, 2.0, 3.0], 'quat_xyzw': [0.0, 0.0, 0.0, 1.0]}], None)
    path.write_text('a,b\n1,2\n', encoding='utf-8')
    assert read_way(path) == ([{'joints': {'a': 1.0, 'b': 2.0}}], None)


@pytest.mark.parametrize('text, told', [
    ('', 'no goals'), ('x,y,z\n', 'no goals'), ('x,y\n1,2\n', 'line 1: needs x, y and z'),
    ('x,y,z,a\n1,2,3,4\n', 'line 1'), ('t\n1\n', 'line 1'), ('a,a\n1,2\n', 'line 1'),
    ('x,y,z\n1,2\n', 'line 2: needs 3 numbers, got 2'),
    ('x,y,z\n1,2,nan\n', "line 2: 'nan' is not a finite number")])
def test_faulty_files_are_refused_with_the_line(tmp_path, text, told):
    path = tmp_path / 'way.csv'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(GoalError, match=told):
        read_way(path)


def test_file_needs_times_or_a_speed(tmp_path):
    path = tmp_path / 'way.csv'
    path.write_text('x,y,z\n1,2,3\n', encoding='utf-8')
    with pytest.raises(GoalError, match='a column t or --speed'):
        way(options('--file', str(path)), {})
    path.write_text('t,x,y,z\n1,1,2,3\n', encoding='utf-8')
    with pytest.raises(GoalError, match='one of them'):
        way(options('--file', str(path), '--speed', '1'), {})
    with pytest.raises(GoalError, match='No such file'):
        way(options('--file', str(tmp_path / 'none.csv')), {})

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``tp_controller ik``: what it prints, writes and returns."""

import csv
import json

import numpy as np
import pytest
from robots import PANDA_DH, PLANAR_DH
from tp_controller import Robot
from tp_controller.tools.cli.ik import STEP
from tp_controller.tools.cli.main import main

TIP = '- tip: {type: position, frame: link3, axes: xy}\n'
MIDDLE = '- middle: {type: joint, joints: joint2}\n'


def run(capsys, *arguments, robot=PLANAR_DH):
    """Return the exit status, and what was printed."""
    status = main(['ik', *map(str, arguments), '--robot', str(robot)])
    printed = capsys.readouterr()
    return status, printed.out, printed.err


def positions(text):
    """Return the positions in a printed result, by joint."""
    return {name: float(value) for name, value in (
        line.split() for line in text.partition('\n\n')[0].splitlines())}


def test_joints_lead_to_the_goal(capsys):
    status, out, err = run(capsys, TIP, '--goal', 'tip=1.0, 0.5, 0')
    assert status == 0
    assert not err
    assert out.endswith('\nreached\n')
    robot = Robot.from_file(PLANAR_DH)
    found = positions(out)
    assert list(found) == list(robot.joint_names)
    np.testing.assert_allclose(
        robot.state(list(found.values())).position('link3')[:2], [1.0, 0.5], atol=5e-6)


def test_reason_and_hint_are_printed_where_a_goal_is_not_reached(capsys):
    status, out, _ = run(capsys, TIP + MIDDLE, '--goal', 'tip=[2.25, 0, 0]', '--goal',
                         'middle={joint2: 0.5}')
    assert status == 1
    assert 'tip: limited, error 0.5 m\n  out of reach by 0.5 m\n  hint: ' in out
    assert 'middle: limited, error 0.5 rad\n  blocked by tip\n' in out
    assert out.endswith('\nnot reached\n')


def test_search_begins_at_the_given_start(capsys):
    starts = (0.4, -0.4)
    found = [positions(run(capsys, TIP, '--goal', 'tip=1.0, 0, 0', '--start', f'joint2={start}',
                           '--start', f'joint3={start}')[1]) for start in starts]
    assert found[0]['joint3'] == pytest.approx(-found[1]['joint3'], abs=1e-5)
    assert found[0]['joint3'] > 0.1


def test_goals_in_the_stack_are_the_default(capsys):
    status, out, _ = run(capsys, '- one: {type: joint, joints: joint1, target: [0.7]}')
    assert status == 0
    assert positions(out)['joint1'] == pytest.approx(0.7, abs=1e-6)


def test_table_of_goals_gives_a_table_of_configurations(capsys, tmp_path):
    goals, found, page = (tmp_path / name for name in ('goals.csv', 'found.csv', 'found.json'))
    goals.write_text('tip.y, tip.x, tip.z, middle.joint2, start.joint3\n'
                     '0.5, 1.0, 0, 0.3, 0.2\n0, 2.25, 0, 0.3, 0.2\n\n-0.5, 1.0, 0, -0.3, -0.2\n')
    status, out, _ = run(capsys, TIP + MIDDLE, '--csv', goals, '--output', found)
    assert status == 1
    lines = out.splitlines()
    assert lines[1] == '    2 not reached  tip: out of reach by 0.5 m'
    assert lines[-1].endswith(' of 3 reached')
    robot = Robot.from_file(PLANAR_DH)
    rows = list(csv.DictReader(found.read_text().splitlines()))
    assert [int(row.pop('reached')) for row in rows][1] == 0
    tips = [robot.state([float(row[name]) for name in robot.joint_names]).position('link3')
            for row in rows]
    np.testing.assert_allclose(np.array(tips)[[0, 2], :2], [[1.0, 0.5], [1.0, -0.5]], atol=1e-6)
    assert run(capsys, TIP + MIDDLE, '--csv', goals, '--output', page)[0] == 1
    results = json.loads(page.read_text())
    assert [list(each['q'].values()) for each in results] == [
        [float(value) for value in row.values()] for row in rows]
    task = results[1]['tasks'][0]
    assert task['name'] == 'tip'
    assert task['errors'] == {'m': pytest.approx(0.5, abs=1e-6)}
    assert task['reason'] == 'out of reach by 0.5 m'
    assert results[1]['reached'] is False


@pytest.mark.parametrize(('arguments', 'text'), [
    (['--goal', 'tip'], "'tip' is not of the form TASK=NUMBERS"),
    (['--goal', 'tip=1, 2, 0', '--goal', 'tip=2, 1, 0'], "two goals for task 'tip'"),
    (['--goal', 'tip=[1, 2'], 'the goal of task .tip.'),
    (['--goal', 'tip=1, 2'], 'tp_controller: the goal of task .tip. (a point x, y, z) needs 3 '),
    (['--goal', 'tap=1, 2, 3'], "position 'tap'"),
    (['--start', 'joint9=1'], "unknown joint 'joint9'"),
    (['--output', 'found.txt'], 'needs the ending .csv or .json'),
    (['--output', 'none/found.csv'], 'none'), (['--csv', 'none.csv'], 'none.csv: No such file'),
    (['--base', 'boat'], 'boat')], ids=str)
def test_arguments_that_are_not_valid_are_named(capsys, tmp_path, monkeypatch, arguments, text):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, TIP, *arguments)
    assert status == 2
    assert err.startswith('tp_controller: ')
    assert text.replace('.tip.', "'tip'") in err


@pytest.mark.parametrize(('table', 'text'), [
    ('', 'line 1 needs a name for each column'), ('tip.x,tip.x\n1,2\n', 'each once'),
    ('x,y\n1,2\n', "'x' is not of the form <task>.<part>"),
    ('tip.x,tip.y,tip.z\n1,2\n', 'line 2: needs 3 numbers, got 2'),
    ('tip.x,tip.y,tip.z\n1,2,3\n1,two,3\n', "line 3: tip.y is not a number: 'two'"),
    ('tip.x,tip.y\n1,2\n', 'tip has x, y; valid: x, y and z, or qx'),
    ('tip.x,tip.y,tip.z,tip.qw\n1,0,0,0\n', 'tip has qw, x, y, z; valid'),
    ('tip.x,tip.y,tip.z\n', 'no goals')], ids=str)
def test_faults_of_a_table_are_named_with_their_line(capsys, tmp_path, table, text):
    path = tmp_path / 'goals.csv'
    path.write_text(table)
    status, _, err = run(capsys, TIP, '--csv', path)
    assert status == 2
    assert text in err


def test_refused_goal_is_named_with_its_line_also_in_a_long_table(capsys, tmp_path):
    path = tmp_path / 'goals.csv'
    path.write_text('tip.x,tip.y,tip.z\n' + '1,0.5,0\n' * (STEP + 3) + '\n1,inf,0\n')
    status, _, err = run(capsys, TIP, '--csv', path)
    assert status == 2
    assert err.startswith(f'tp_controller: {path}: line {STEP + 6}: the goal of task')


def test_joint_that_is_not_driven_stands_where_the_start_says(capsys):
    status, out, _ = run(capsys, TIP, '--joints', 'joint1', 'joint2', '--goal', 'tip=1.0, 0.5, 0',
                         '--start', 'joint3=0.7')
    assert status == 0
    robot = Robot.from_file(PLANAR_DH, joints=['joint1', 'joint2'])
    state = robot.state(list(positions(out).values()), passive=[0.7])
    np.testing.assert_allclose(state.position('link3')[:2], [1.0, 0.5], atol=5e-6)


def test_table_gives_no_start_for_a_joint_that_is_not_driven(capsys, tmp_path):
    path = tmp_path / 'goals.csv'
    path.write_text('tip.x,tip.y,tip.z,start.joint3\n1,0.5,0,0.7\n')
    status, _, err = run(capsys, TIP, '--joints', 'joint1', 'joint2', '--csv', path)
    assert status == 2
    assert "unknown joint 'joint3'" in err


def test_mark_that_a_spreadsheet_writes_is_no_part_of_a_name(capsys, tmp_path):
    path = tmp_path / 'goals.csv'
    path.write_text('\ufefftip.x,tip.y,tip.z\n1,0.5,0\n', encoding='utf-8')
    assert run(capsys, TIP, '--csv', path)[0] == 0


def test_unknown_stack_or_robot_is_refused(capsys, tmp_path):
    assert run(capsys, '- tip: {type: spot}')[0] == 2
    status, _, err = run(capsys, TIP, robot=tmp_path / 'none.urdf')
    assert status == 2
    assert 'none.urdf' in err


@pytest.mark.parametrize('arguments', [
    ['--start', 'joint1=far'], ['--start', 'joint1'],
    ['--attempts', '0'], ['--timeout', '-1'], ['--seed', 'x'], ['--criterion', 'best'],
    ['--jobs', '0'], ['--goal', 'tip=1', '--csv', 'a.csv']])
def test_wrong_numbers_are_refused_by_the_parser(capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        main(['ik', TIP, *arguments, '--robot', str(PANDA_DH)])
    assert ended.value.code == 2


@pytest.mark.parametrize('text', ['0', '-1', 'x'])
def test_refused_count_is_told_the_least_one(capsys, text):
    with pytest.raises(SystemExit):
        main(['ik', TIP, '--attempts', text, '--robot', str(PLANAR_DH)])
    assert f"{text}' is not a whole number from 1 on" in capsys.readouterr().err


def test_start_outside_the_position_limits_is_noted(capsys, tmp_path):
    found = tmp_path / 'found.csv'
    arguments = ('- one: {type: joint, joints: panda_joint1, target: [0.7]}', '--output', found,
                 '--start')
    results = []
    for start in (9.0, 2.8973, -0.0698, 3.7525):
        joint = 'panda_joint1' if start in (9.0, 2.8973) else 'panda_joint4'
        _, out, err = run(capsys, *arguments, f'{joint}={start}', robot=PANDA_DH)
        results.append((out, found.read_text(), err))
    assert results[0][:2] == results[1][:2]
    assert results[0][2].splitlines() == [
        'tp_controller: the start of panda_joint1, 9, is beyond its upper position limit: the '
        'search begins at 2.8973']
    assert [bool(err) for *_, err in results] == [True, False, False, True]
    table = tmp_path / 'starts.csv'
    table.write_text('start.panda_joint2\n-5\n0\n-5\n')
    err = run(capsys, arguments[0], '--csv', table, '--start', 'panda_joint1=9',
              robot=PANDA_DH)[2]
    assert [line.partition(', ')[0] for line in err.splitlines()] == [
        f'tp_controller: the start of panda_joint{number}' for number in (1, 2)]


@pytest.mark.parametrize('column', [None, 'start.joint1'])
def test_stack_without_a_goal_is_refused(capsys, tmp_path, column):
    arguments = []
    if column:
        table = tmp_path / 'starts.csv'
        table.write_text(f'{column}\n0.5\n')
        arguments = ['--csv', table]
    status, out, err = run(capsys, TIP + MIDDLE, *arguments)
    assert (status, out) == (2, '')
    assert 'no task has a goal' in err and 'tip, middle' in err
    assert run(capsys, MIDDLE.replace('joint2}', 'joint2, target: [0.5]}'),
               *arguments)[0] == 0
    assert run(capsys, '- limits: {type: joint_limits}\n', *arguments)[0] == 0

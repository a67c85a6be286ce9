# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What a check says of the joints that tasks may move, and of the weights of their rows."""

import numpy as np
import pytest
from robots import moving_panda, panda, planar
from tp_controller import Robot, Settings, Stack
from tp_controller.model.simulator import start_configuration
from tp_controller.tools.check import check
from tp_controller.tools.check import closed_loop as loops
from tp_controller.tools.check.results import DOUBTFUL, WRONG
from tp_controller.tools.check.sampling import moved_from
from tp_controller.tools.check.setup import Setup

TIP = 'tip: {type: position, frame: link3, axes: xy'
ELBOW = 'elbow: {type: position, frame: panda_link4, axes: z'
POSTURE = 'posture: {type: posture}'


def report_of(robot, *lines, **options):
    """Return the report of a check."""
    stack = Stack.from_yaml('\n'.join(f'- {line}' for line in lines), robot)
    return check(robot, stack, **{'samples': 20, 'runs': 0, **options})


def doubts(robot, *lines):
    """Return the findings as (severity, kind, where), and their texts."""
    found = report_of(robot, *lines).of(WRONG, DOUBTFUL)
    return [(each.severity, each.kind, each.where) for each in found], \
        ' '.join(f'{each.message} → {each.change}' for each in found)


# Joints ----------------------------------------------------------------------------------


def test_a_task_that_none_of_its_joints_moves_is_wrong():
    found, text = doubts(panda(), f'{ELBOW}, joints: [panda_joint6, panda_joint7]}}', POSTURE)
    assert found == [(WRONG, 'joints', 'elbow')]
    # Joint 1 turns about the vertical.
    assert text == 'none of its joints moves it: panda_joint6, panda_joint7 → let it move one ' \
        'or more of panda_joint2, panda_joint3'


def test_a_joint_that_cannot_move_the_frame_is_doubtful():
    found, text = doubts(panda(), f'{ELBOW}, joints: [panda_joint1, panda_joint2, panda_joint7]}}')
    assert found == [(DOUBTFUL, 'joints', 'elbow')]
    # Joint 1 moves the frame, though not upwards.
    assert text.startswith('its joints have no effect on it: panda_joint7 →')


def test_a_group_may_have_joints_that_do_not_matter():
    robot = Robot.from_urdf(panda().urdf, groups={
        'arm': [f'panda_joint{number}' for number in range(1, 8) if number != 5]})
    assert doubts(robot, f'{ELBOW}, joints: arm}}') == ([], '')
    # A joint of a group that the task does not get as a whole is one that was named.
    assert doubts(robot, f'{ELBOW}, joints: [panda_joint2, panda_joint7]}}')[0] == [
        (DOUBTFUL, 'joints', 'elbow')]


@pytest.mark.parametrize(('joints', 'expected'), [
    ('joint1', 'it uses 1 joint only and demands 2 rows: 1 of the 2 directions that all joints '
               'give are left, in the median → let it use more joints, such as joint2, joint3, '
               'or leave out axes'), ('[joint1, joint3]', ''), ('[joint2, joint3]', '')])
def test_fewer_joints_than_rows_are_doubtful(joints, expected):
    found, text = doubts(planar(), f'{TIP}, joints: {joints}}}')
    assert found == [(DOUBTFUL, 'joints', 'tip')] * bool(expected) and text == expected


def test_tasks_that_need_not_move_all_rows_are_not_doubted():
    cell = 'cell: {type: keep_in, frame: link3, shape: {box: [3.0, 3.0, 1.0]}, joints: joint1}'
    assert doubts(planar(), cell, 'posture: {type: posture, excluded_joints: joint1}')[0] == []


def test_bounds_that_no_joint_of_theirs_moves_are_wrong():
    cell = 'cell: {type: keep_in, frame: link1, shape: {box: [3.0, 3.0, 1.0]}, joints: joint3}'
    assert (WRONG, 'joints', 'cell') in doubts(planar(), cell)[0]


def test_joints_that_a_task_above_needs_never_act():
    pose = 'tool: {type: pose, frame: panda_hand_tcp}'
    report = report_of(panda(), pose, f'{ELBOW}, joints: [panda_joint1, panda_joint2]}}')
    level, finding = report.levels[1], report.of(WRONG)[0]
    assert (level.rank, level.most_left, level.most_of_all) == (1, 0, 1)
    assert (finding.kind, finding.where) == ('never acts', 'level 2 (elbow)')
    assert finding.change.startswith('let it use more joints, or put it above')
    # With all joints another change is needed.
    both = report_of(planar(), f'{TIP}}}', 'again: {type: position, frame: link3, axes: xy}')
    assert both.of(WRONG)[0].change.startswith('put it above')


def test_ranks_are_those_of_the_joints_of_a_level():
    level, = report_of(planar(), f'{TIP}, joints: joint1}}').levels
    assert (level.rank, level.least_left, level.most_left, level.most_of_all) == (1, 1, 1, 2)


def test_singular_values_are_those_of_the_joints_of_a_task():
    some, every = (report_of(planar(), f'{TIP}{keys}}}', samples=100).tasks[0].smallest
                   for keys in (', joints: [joint2, joint3]', ''))
    assert some < 0.8 * every


# Goals of the closed loops ---------------------------------------------------------------


@pytest.mark.parametrize(('below', 'same'), [
    ([], True), (['turn: {type: joint, joints: joint1}'], False),
    (['posture: {type: posture, excluded_joints: joint1}'], True), ([POSTURE], False)])
def test_goals_leave_joints_that_no_task_moves_at_the_start(monkeypatch, below, same):
    lines = [f'{TIP}, excluded_joints: joint1}}', *below]
    robot, seen, start_loop = planar(), [], loops.start_loop
    stack = Stack.from_yaml('\n'.join(f'- {line}' for line in lines), robot)
    setup = Setup(robot, stack, Settings(), 0.01, 0.1, start_configuration(robot))
    monkeypatch.setattr(loops, 'start_loop', lambda setup, start, goals, extremes:
                        seen.append((start, goals)) or start_loop(setup, start, goals, extremes))
    loops.closed_loop(setup, (0, np.random.SeedSequence(0)))
    (start, goals), = seen
    assert (start[0] == goals[0]) == same and (start[1:] != goals[1:]).all()


@pytest.mark.parametrize('robot', [planar(), moving_panda('planar')], ids=lambda robot: robot.base)
def test_configurations_differ_in_the_moved_joints(robot):
    around, q = start_configuration(robot), np.arange(1.0, robot.nq + 1.0)
    assert moved_from(robot, around, q, np.ones(robot.n, bool)) == pytest.approx(q)
    still = moved_from(robot, around, q, np.zeros(robot.n, bool))
    assert still == pytest.approx(around)
    one = np.zeros(robot.n, bool)
    one[robot.joint_columns.start] = True
    found = moved_from(robot, around, q, one)
    assert np.flatnonzero(found != around).tolist() == [robot.joint_rows.start]
    if robot.moves:
        one[0] = True
        found = moved_from(robot, around, q, one)
        assert found[:robot.joint_rows.start + 1] == pytest.approx(q[:robot.joint_rows.start + 1])


# Weights of rows -------------------------------------------------------------------------


@pytest.mark.parametrize(('lines', 'expected'), [
    ([f'{TIP}, weights: [1.0, 100.0]}}'], ''), ([f'{TIP}, weights: 3.0}}'], 'no effect'),
    ([f'{TIP}}}', 'posture: {type: posture, weights: {joint2: 9.0e+5}}'], ''),
    ([f'{TIP}, weights: [1.0e-2, 1.0e+4]}}'], 'factor of 1e+06'),
    ([f'[{{{TIP}, weights: 10.0}}}}, {{turn: {{type: joint, joints: joint1}}}}]'], ''),
    ([f'[{{{TIP}, weights: 20.0}}}}, {{turn: {{type: joint, joints: joint1, weights: 1.0e-5}}}}]'],
     'level 1 differ')])
def test_weights_without_effect_or_far_apart_are_doubtful(lines, expected):
    found = [each for each in report_of(planar(), *lines).of(WRONG, DOUBTFUL)
             if each.kind == 'weights']
    assert len(found) == bool(expected)
    assert all(expected in each.message for each in found)

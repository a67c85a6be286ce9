# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What a check says of stacks whose faults are known."""

from dataclasses import fields, is_dataclass, replace
import json
import math

import numpy as np
import pytest
from robots import mixed, moving_panda, panda, planar
from scipy.linalg import subspace_angles
from tp_controller import Controller, Robot, RobotError, Settings, SettingsError, Stack
from tp_controller.model.simulator import start_configuration
from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.task import Task
from tp_controller.tools.check import check, CheckReport
from tp_controller.tools.check.closed_loop import closed_loop, start_loop
from tp_controller.tools.check.configuration_sample import angles_between, smallest_singular_value
from tp_controller.tools.check.extremes import Extremes
from tp_controller.tools.check.findings import about_bounds, about_goals, about_limits
from tp_controller.tools.check.results import (
    CauseCount,
    DOUBTFUL,
    FINE,
    schema,
    WorstResult,
    WRONG,
)
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

FEW = {'samples': 20, 'runs': 0}


def stack_of(robot, *lines):
    """Return the stack of some lines."""
    return Stack.from_yaml('\n'.join(f'- {line}' for line in lines), robot)


def found(robot, lines, settings=None, **options):
    """Return {(kind, where): severity} of the findings of a check."""
    report = check(robot, stack_of(robot, *lines), settings, **{**FEW, **options})
    return {(each.kind, each.where): each.severity for each in report.findings}


def setup_of(robot, *lines, period=0.01):
    """Return a setup."""
    return Setup(robot, stack_of(robot, *lines), Settings(period=period), period, 5.0,
                 start_configuration(robot))


def arm(reach):
    """Return the planar arm with its last two joints within a range about straight."""
    return Robot.from_urdf(planar().urdf, limits={
        name: {'lower': -reach, 'upper': reach} for name in ('joint2', 'joint3')})


TIP = 'tip: {type: position, frame: link3, axes: xy}'
ANGLE = 'angle: {type: joint, joints: joint1}'
POSTURE = 'posture: {type: posture}'


# Levels and pairs ------------------------------------------------------------------------


def test_a_level_below_a_posture_never_acts():
    assert found(planar(), [POSTURE, TIP])['never acts', 'level 2 (tip)'] == WRONG
    assert ('never acts', 'level 2 (posture)') not in found(planar(), [TIP, POSTURE])


def test_a_posture_may_find_all_joints_taken():
    assert found(planar(), [TIP, ANGLE, POSTURE])['never acts', 'level 3 (posture)'] == FINE


def test_ranks_are_those_that_are_left():
    first, second, third = check(planar(), stack_of(planar(), TIP, ANGLE, POSTURE), **FEW).levels
    assert (first.rank, first.least_left, first.most_left) == (2, 2, 2)
    assert (second.rank, second.median_left, second.never) == (1, 1.0, 0.0)
    assert (third.rank, third.most_left, third.never) == (3, 0, 1.0)


def test_a_level_that_gets_a_part_of_its_directions_is_doubtful():
    joints = 'angle: {type: joint, joints: [joint1, joint2]}'
    assert found(planar(), [TIP, joints])['acts in part', 'level 2 (angle)'] == DOUBTFUL


@pytest.mark.parametrize('lines', [
    [TIP, 'twin: {type: position, frame: link3, axes: xy}'],
    ['[' + '{' + TIP + '}, {twin: {type: position, frame: link3, axes: xy}}]']])
def test_two_positions_of_one_frame_fight(lines):
    report = check(planar(), stack_of(planar(), *lines), **FEW)
    pair, = report.pairs
    # The cosine of 0 is flat: rounding makes an angle of 1e-8 of it.
    assert (pair.shared, pair.directions) == (1.0, 2) and pair.median_angle < 1e-6
    assert ('fight', 'tip, twin') in {(each.kind, each.where) for each in report.findings}


def test_tasks_about_different_joints_do_not_fight():
    lines = [ANGLE, 'other: {type: joint, joints: [joint2]}']
    report = check(planar(), stack_of(planar(), *lines), **FEW)
    assert report.pairs[0].median_angle == pytest.approx(math.pi / 2)
    assert not report.of(WRONG, DOUBTFUL)


def test_angles_are_those_of_another_library():
    random = np.random.default_rng(0)
    for rows in (1, 2, 4):
        one, other = random.normal(size=(3, 7)), random.normal(size=(rows, 7))
        other[0] = one[1] + 0.1 * other[0]
        assert angles_between(one, other) == pytest.approx(
            np.sort(subspace_angles(one.T, other.T)), abs=1e-7)
    # A row of zeros is no direction.
    assert angles_between(np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.0, 2.0]])) \
        == pytest.approx([math.pi / 2])


@pytest.mark.parametrize('robot', [panda(), moving_panda('differential')],
                         ids=lambda robot: robot.base)
def test_a_posture_fights_with_nobody(robot):
    # With a base that moves it is about the joints alone.
    lines = ['tool: {type: position, frame: panda_hand_tcp}', POSTURE]
    report = check(robot, stack_of(robot, *lines), **FEW)
    assert not report.pairs and not [each for each in report.findings if each.kind in (
        'fight', 'acts in part', 'never acts')]


def test_a_pose_of_an_arm_with_as_many_joints_as_rows_is_looked_at():
    lines = ['tip: {type: pose, frame: link3, axes: [x, y, rz]}', ANGLE]
    report = check(planar(), stack_of(planar(), *lines), **FEW)
    assert report.pairs[0].shared == 1.0 and report.tasks[0].smallest is not None
    assert ('never acts', 'level 2 (angle)') in {
        (each.kind, each.where) for each in report.of(WRONG)}


def test_limits_that_look_like_degrees_are_doubtful():
    robot = Robot.from_urdf(planar().urdf, limits={'joint2': {'lower': -120, 'upper': 120}})
    assert found(robot, [ANGLE], runs=0)[('remark', robot.name)] == DOUBTFUL


# Gains -----------------------------------------------------------------------------------


@pytest.mark.parametrize(('gain', 'severity'), [
    (49.0, None), (50.0, DOUBTFUL), (99.0, DOUBTFUL), (100.0, WRONG), (200.0, WRONG)])
def test_gains_are_judged_by_what_one_period_leaves(gain, severity):
    lines = [f'tip: {{type: position, frame: link3, axes: xy, gain: {gain}}}']
    assert found(planar(), lines).get(('gain', 'tip')) == severity


@pytest.mark.parametrize('step', [0.3, 0.8, 1.5, 1.9])
def test_one_period_leaves_what_the_message_says(step):
    # A gain of one joint: its error is linear, so a closed loop shows the factor exactly.
    robot, period = planar(), 0.01
    stack = stack_of(robot, f'angle: {{type: joint, joints: joint1, gain: {step / period}}}')
    controller = Controller(robot, stack, Settings(period=period, blend=0.0))
    controller.update([0.0, 0.0, 0.0], 0.0)
    controller.set_goal('angle', [1e-3], 0.0)
    after = 1e-3 - period * controller.update([0.0, 0.0, 0.0], period).velocity[0]
    assert after / 1e-3 == pytest.approx(1.0 - step)
    message, = (each.message for each in check(
        robot, stack_of(robot, f'angle: {{type: joint, joints: joint1, gain: {step / period}}}'),
        **FEW).findings if each.kind in ('gain',)) if step >= 0.5 else ('',)
    assert step < 0.5 or f'{1.0 - step:.2g} of the error is left' in message


def test_gain_that_a_controller_refuses_is_wrong_once():
    findings = check(planar(), stack_of(planar(), ANGLE[:-1] + ', gain: 300}'), **FEW).of(WRONG)
    assert [each.kind for each in findings] == ['fault']
    assert findings[0].message == (
        'gain 300 of task angle must be at most 2/period = 200, or its error would grow from '
        'cycle to cycle; 0.25/period does not overshoot, even a cycle late')


@pytest.mark.parametrize(('gain', 'told', 'change'), [
    (1e-4, 'still on its way: a gain of 0.0001/s needs 7e+04 s for a thousandth of an error, and '
     'a run has 2 s', 'raise its gain'),
    (199.5, '', 'a gain of at most 25/s')])
def test_goal_that_is_never_reached_is_doubtful_in_few_runs(gain, told, change):
    lines = ANGLE[:-1] + f', gain: {gain}, tolerance: 1.0e-9}}'
    finding, = (each for each in check(planar(), stack_of(planar(), lines), samples=1, runs=3,
                                       seconds=2.0, seed=1).findings
                if each.kind in ('never reached', 'slow'))
    assert finding.severity == DOUBTFUL and finding.message.startswith('at its goal in 0 of 3')
    assert told in finding.message and 'damping' not in finding.message
    assert finding.change.startswith(change)


def test_task_that_is_only_slow_is_not_limited():
    result, = check(planar(), stack_of(planar(), ANGLE[:-1] + ', gain: 0.3}'), samples=1, runs=5,
                    seconds=2.0).tasks
    assert {cause.kind for cause in result.causes} == {'moving'}


def test_the_gain_of_an_objective_says_nothing_about_a_rate():
    lines = [TIP, 'easy: {type: joint_limit_distance, gain: 300.0}']
    assert ('gain', 'easy') not in found(arm(1.0), lines)


# Bounds and singularities ----------------------------------------------------------------


def test_a_region_that_hardly_any_configuration_is_in_dominates():
    lines = ['small: {type: keep_in, frame: link3, shape: {sphere: 0.01}, at: [1.0, 0.0, 0.0]}']
    assert found(planar(), lines, samples=200)['bounds dominate', 'small'] == DOUBTFUL
    lines = ['wide: {type: keep_in, frame: link3, shape: {sphere: 1.7}}']
    assert ('bounds dominate', 'wide') not in found(planar(), lines, samples=200)


def test_many_rows_do_not_dominate_because_one_of_them_is_outside():
    # Each of seven joints is outside in about 45 % of the samples, one of them nearly always.
    lines = ['joints: {type: joint_limits, margin: 1.05}', 'tool: {type: posture}']
    task = check(panda(), stack_of(panda(), *lines), samples=200, runs=0).tasks[0]
    assert task.outside > 0.97 and 0.4 < task.rows_outside < 0.5
    setup = setup_of(panda(), *lines)
    assert not list(about_bounds(setup, [replace(task, outside=1.0)], 0, []))
    assert [each.kind for each in about_bounds(
        setup, [replace(task, outside=1.0, rows_outside=0.9)], 0, [])] == ['bounds dominate']


def test_shares_outside_are_those_of_the_samples():
    # The first joint turns without end: the tip is in the half plane half of the time.
    lines = ['half: {type: keep_in, frame: link3, shape: {box: [4.0, 8.0, 8.0]}, '
             'at: [2.0, 0.0, 0.0]}']
    report = check(planar(), stack_of(planar(), *lines), samples=400, runs=0)
    assert report.tasks[0].outside == pytest.approx(0.5, abs=0.08)


@pytest.mark.slow
def test_a_region_out_of_reach_is_wrong():
    lines = ['far: {type: keep_in, frame: link3, shape: {sphere: 0.1}, at: [3.0, 0.0, 0.0]}', TIP]
    assert found(planar(), lines, samples=5, runs=2, seconds=1.0)['bounds', 'far'] == WRONG


def test_a_straight_arm_is_singular():
    assert found(arm(0.01), [TIP])['singular', 'tip'] == DOUBTFUL
    assert ('singular', 'tip') not in found(arm(2.0), [TIP])


def test_smallest_singular_values_are_those_of_the_arm():
    # Of two joints and their links: the area that the columns span over their size.
    task = check(arm(0.5), stack_of(arm(0.5), TIP), samples=200, runs=0).tasks[0]
    random, values = np.random.default_rng(5), []
    for _ in range(4000):
        a, b, c = np.cumsum([0.0, *random.uniform(-0.5, 0.5, 2)])
        links = np.array([[-0.75 * math.sin(a), 0.75 * math.cos(a)],
                          [-0.5 * math.sin(b), 0.5 * math.cos(b)],
                          [-0.5 * math.sin(c), 0.5 * math.cos(c)]])
        J = np.cumsum(links[::-1], axis=0)[::-1].T
        values.append(math.sqrt(max(np.linalg.eigvalsh(J @ J.T)[0], 0.0)))
    assert task.smallest == pytest.approx(np.median(values), rel=0.15)
    assert smallest_singular_value(np.eye(3)[:2])[0] == 1.0
    assert smallest_singular_value(np.ones((3, 2)))[0] == 0.0


def test_directions_that_a_robot_does_not_have_are_named():
    assert found(planar(), ['tip: {type: position, frame: link3}'])['impossible', 'tip'] \
        == DOUBTFUL


# Closed loops ----------------------------------------------------------------------------


@pytest.mark.slow
def test_compatible_goals_are_reached():
    report = check(planar(), stack_of(planar(), TIP.replace('}', ', gain: 3}'), ANGLE),
                   samples=5, runs=6)
    tip = report.tasks[0]
    assert tip.possible == 6 and tip.reached == 6 == report.ended['reached']
    assert 0.1 < tip.median_seconds <= tip.longest_seconds < 15.0
    assert report.passes() and not report.of(WRONG)


@pytest.mark.slow
def test_goals_are_compatible_with_those_of_the_stack():
    # All goals come from the one configuration that the posture allows.
    lines = ['posture: {type: posture, gain: 5, '
             'target: {joint1: 0.0, joint2: 0.5, joint3: 0.5}}', TIP]
    report = check(planar(), stack_of(planar(), *lines), samples=3, runs=3, seconds=6.0)
    assert [task.reached for task in report.tasks] == [3, 3]
    assert [task.possible for task in report.tasks] == [3, 3]
    # Below the tip it hardly ever can be there: that is not judged.
    report = check(planar(), stack_of(planar(), *lines[::-1]), samples=3, runs=3, seconds=6.0)
    assert [task.possible for task in report.tasks] == [3, 0]
    assert not report.of(WRONG)


def test_a_slow_task_never_reaches_its_goal_in_time():
    lines = [TIP.replace('}', ', gain: 0.001}')]
    report = check(planar(), stack_of(planar(), *lines), samples=5, runs=5, seconds=1.0)
    finding, = (each for each in report.findings if each.where == 'tip')
    assert report.tasks[0].reached_near == 0 < report.tasks[0].possible_near
    # The time was too short for it, which may well be meant.
    assert (finding.severity, finding.kind) == (DOUBTFUL, 'slow')
    assert report.ended['time is up'] + report.ended['at rest'] == 5


def test_what_tasks_above_prevent_is_only_doubtful():
    # Both sit on one level as far as their directions go; the second is last.
    lines = ['first: {type: joint, joints: joint1, gain: 5.0, target: [0.5]}',
             'turn: {type: joint, joints: [joint1, joint2], gain: 5.0}', POSTURE]
    report = check(planar(), stack_of(planar(), *lines), samples=3, runs=2, seconds=2.0)
    setup = setup_of(planar(), *lines)
    blocked = replace(report.tasks[1], possible=6, reached=0, causes=(
        CauseCount('task', 'first', 'blocked by first', 6),))
    limited = replace(blocked, causes=(CauseCount(
        'velocity limit', 'joint1', 'joint1 at its velocity limit', 6),))
    for task, filling, severity in ((blocked, frozenset(), DOUBTFUL),
                                    (limited, frozenset(), WRONG),
                                    (limited, frozenset(['turn']), DOUBTFUL)):
        finding, = about_goals(setup, [task], 6, filling)
        assert (finding.severity, finding.kind) == (severity, 'never reached')
        assert finding.change


def test_a_violation_is_wrong_and_a_jump_doubtful(monkeypatch):
    add = Extremes.add

    def rough(extremes, q, velocity):
        add(extremes, q, -np.ones(3))
        add(extremes, q, 5.0 * np.ones(3))

    monkeypatch.setattr(Extremes, 'add', rough)
    kinds = found(planar(), [TIP], samples=2, runs=1, seconds=0.2)
    assert kinds['violation', 'joint1'] == WRONG and kinds['jump', 'joint1'] == DOUBTFUL
    assert ('limits', '') not in kinds


def test_a_jump_without_a_velocity_limit_has_a_unit():
    worst = [WorstResult('jump', 7.5, name, 0) for name in ('joint1', 'joint2')]
    robot = Robot.from_urdf(planar().urdf, limits={'joint1': {'velocity': math.inf}})
    without, limited, _ = about_limits(worst, setup_of(robot, TIP))
    assert 'changes by 7.5 rad/s in one cycle' in without.message
    assert 'changes by 750% of its velocity limit' in limited.message


@pytest.mark.slow
def test_goals_come_from_where_bounds_are_satisfied():
    lines = ['half: {type: keep_in, frame: link3, shape: {box: [4.0, 8.0, 8.0]}, '
             'at: [2.1, 0.0, 0.0], tolerance: 1.0e-3}', TIP.replace('}', ', gain: 3}')]
    setup = setup_of(planar(), *lines)
    for number, seed in enumerate(np.random.SeedSequence(3).spawn(4)):
        run = closed_loop(setup, (number, seed))
        assert run.tasks['half'].possible and run.tasks['half'].reached
        assert run.tasks['tip'].reached and 0.0 <= run.active['half'] <= 1.0


def test_the_stack_that_is_checked_stays_as_it_is():
    stack = stack_of(planar(), TIP, POSTURE)
    check(planar(), stack, samples=3, runs=1, seconds=0.5)
    assert all(task.goal is None for task in stack.tasks.values())


def test_goals_of_the_stack_stay_in_force():
    setup = setup_of(planar(), 'angle: {type: joint, joints: joint1, target: [0.7]}', TIP)
    loop = start_loop(setup, np.array([0.0, 0.1, 0.1]), np.array([1.0, 0.5, 0.5]))
    tasks = loop.controller.stack.tasks
    assert tasks['angle'].goal == pytest.approx([0.7])
    assert tasks['tip'].goal[:2] == pytest.approx(
        setup.robot.state([1.0, 0.5, 0.5]).position('link3')[:2])


# Bounds that cannot be satisfied, and numbers that look wrong ----------------------------

LEFT = 'left: {type: keep_in, frame: link3, shape: {sphere: 0.3}, at: [1.0, 0.6, 0.0]}'
RIGHT = 'right: {type: keep_in, frame: link3, shape: {sphere: 0.3}, at: [1.0, -0.6, 0.0]}'
WIDE = 'wide: {type: keep_in, frame: link3, shape: {sphere: 1.7}}'
FAR = 'far: {type: keep_in, frame: link3, shape: {sphere: 0.1}, at: [3.0, 0.0, 0.0]}'


@pytest.mark.slow
def test_bounds_that_contradict_each_other_are_named_with_what_is_missing():
    report = check(planar(), stack_of(planar(), LEFT, WIDE, RIGHT), samples=5, runs=2)
    finding, = report.of(WRONG)
    # Two spheres of 0.3 m, 1.2 m apart.
    assert (finding.kind, finding.where) == ('contradiction', 'left, right')
    assert 'at best 0.6 m are missing of right' in finding.message


@pytest.mark.slow
def test_bounds_that_cannot_be_satisfied_alone_are_named_with_what_is_missing():
    # The arm is 1.75 m long, and the region begins at 2.9 m.
    finding, = check(planar(), stack_of(planar(), WIDE, FAR), samples=5, runs=2).of(WRONG)
    assert (finding.kind, finding.where) == ('bounds', 'far')
    assert 'not even without all other tasks: at best 1.1 m are missing' in finding.message \
        or 'at best 1.2 m are missing' in finding.message


@pytest.mark.parametrize(('line', 'expected'), [
    ('fast: {type: speed_limit, frame: link3, linear: 250.0}', True),
    ('fast: {type: speed_limit, frame: link3, linear: 0.2}', False),
    ('fast: {type: keep_out, frame: link3, shape: {sphere: 0.1}, at: [600.0, 0.0, 0.0]}', True)])
def test_bounds_that_no_motion_can_reach_are_never_active(line, expected):
    assert (('never active', 'fast') in found(planar(), [line, TIP])) == expected


@pytest.mark.parametrize(('line', 'kind'), [
    ('it: {type: joint, joints: joint1, target: [90.0]}', 'units'),
    ('it: {type: joint, joints: joint1, target: [1.5]}', None),
    (TIP.replace('tip', 'it').replace('}', ', tolerance: 5.0}'), 'units'),
    (TIP.replace('tip', 'it').replace('}', ', gain: 300.0}'), 'gain')])
def test_numbers_of_tasks_that_look_wrong_are_doubtful(line, kind):
    kinds = {each for each, where in found(planar(), [line], Settings(period=0.001))
             if where == 'it'} - {'reached'}
    assert kinds == ({kind} if kind else set())


def test_limits_and_weights_that_look_wrong_are_doubtful():
    fast = Robot.from_urdf(planar().urdf, limits={'joint2': {'velocity': 120.0}})
    assert found(fast, [ANGLE])['units', 'joint2 (120)'] == DOUBTFUL
    weighted = found(planar(), [ANGLE], Settings(weights=(1.0, 1.0, 1e8)))
    assert weighted['weights', 'joint3'] == DOUBTFUL
    weighted = found(planar(), [ANGLE], Settings(weights=(1.0, 1.0, 50.0)))
    assert ('weights', 'joint3') not in weighted


def test_goals_of_the_loops_are_not_refused_for_the_limits_of_goals():
    report = check(planar(), stack_of(planar(), TIP.replace('}', ', gain: 3}')),
                   Settings(largest_jump=1e-6, largest_turn=1e-6), samples=5, runs=4)
    assert report.tasks[0].median_seconds > 0.5


def test_a_frame_on_a_sphere_lacks_no_axis():
    robot = panda()
    assert ('impossible', 'elbow') not in found(
        robot, ['elbow: {type: position, frame: panda_link4}'])
    lines = ['tip: {type: position, frame: link3}']
    assert found(planar(), lines)['impossible', 'tip'] == DOUBTFUL


def test_links_that_are_left_out_but_overlap_are_named():
    capsules = 'capsules: package://tp_controller/config/panda_capsules.yaml'
    every = f'apart: {{type: self_collision, {capsules}}}'
    some = f'apart: {{type: self_collision, links: [panda_link0, panda_link2], {capsules}}}'
    tool = 'tool: {type: position, frame: panda_hand_tcp}'
    assert ('unwatched', 'apart') not in found(panda(), [every, tool])
    assert found(panda(), [some, tool])['unwatched', 'apart'] == DOUBTFUL


@pytest.mark.slow
def test_a_task_below_one_that_is_still_on_its_way_is_not_judged():
    lines = ['tool: {type: pose, frame: panda_hand_tcp, gain: 0.2}', 'rest: {type: posture}']
    report = check(panda(), stack_of(panda(), *lines), samples=5, runs=5)
    kinds = {each.where: each.kind for each in report.of(WRONG, DOUBTFUL) if each.kind != 'jump'}
    assert kinds == {'tool': 'slow'}


# Tasks that fail -------------------------------------------------------------------------


@pytest.fixture
def failing(monkeypatch):
    """Register a type that fails to the left of the root."""
    monkeypatch.setattr(Task, 'types', dict(Task.types))

    class Failing(FrameTask):
        type_name = 'failing_to_the_left'
        twist_rows = slice(0, 3)

        def value(self, state):
            return self.position(state)

        def error(self, state):
            if self.position(state)[0] < 0.0:
                raise ValueError('I am lost')
            return self.goal - self.position(state)

        def parse_goal(self, goal):
            return np.array(goal)

    return 'lost: {type: failing_to_the_left, frame: link3}'


def test_a_task_that_fails_is_named_with_its_reason(failing):
    report = check(planar(), stack_of(planar(), failing), samples=20, runs=3, seconds=1.0)
    wrong = report.of(WRONG)
    assert any(each.kind == 'failed' and each.where == 'lost' and 'I am lost' in each.message
               for each in wrong)


def test_a_task_that_fails_can_be_switched_off(failing):
    report = check(planar(), stack_of(planar(), failing), Settings(task_faults='switch off'),
                   samples=5, runs=3, seconds=1.0)
    assert ('failed', 'lost') in {(each.kind, each.where) for each in report.of(WRONG)}


# Robots ----------------------------------------------------------------------------------


@pytest.mark.parametrize('robot', [panda(), planar(), mixed(), arm(0.3),
                                   *map(moving_panda, ('planar', 'differential', 'floating',
                                                       'underwater'))],
                         ids=lambda robot: f'{robot.name} {robot.base}')
def test_random_configurations_are_within_limits_and_spread(robot):
    random, around = np.random.default_rng(1), start_configuration(robot)
    q = np.array([random_configuration(robot, random, around) for _ in range(300)])
    positions = np.array([robot.positions(robot.state(each).q) for each in q])
    assert (positions >= robot.lower).all() and (positions <= robot.upper).all()
    columns = robot.joint_columns
    middle = 0.5 * (positions.min(axis=0) + positions.max(axis=0))[columns]
    spread = np.ptp(positions, axis=0)[columns]
    limits = np.clip(np.array([robot.lower, robot.upper]), -10.0, 10.0)[:, columns]
    bounded = np.isfinite(robot.upper - robot.lower)[columns]
    assert spread[bounded] == pytest.approx(np.ptp(limits, axis=0)[bounded], rel=0.05)
    assert np.abs(middle[~bounded]).max(initial=0.0) < 0.2
    assert (spread[~bounded] > 1.9).all()
    near = random_configuration(robot, random, around, 0.01)
    assert np.abs((near - around)[robot.joint_rows]).max() <= 0.01 * 2.0 * math.pi
    if robot.moves:
        places = np.array([robot.base_placement(each) for each in q])
        reach = [row for row in robot.base_reach if row < 3]
        assert (np.ptp(places[:, reach], axis=0) > 1.8).all()
        assert np.abs(places[:, :3]).max() <= 1.0 and np.ptp(places[:, 6]) > 0.5
        assert np.abs(robot.base_placement(near)[:3]).max() <= 0.01


def test_joints_with_one_limit_are_sampled_from_there():
    robot = Robot.from_urdf(planar().urdf, limits={'joint1': {'lower': 1.0},
                                                   'joint2': {'upper': -1.0}})
    random = np.random.default_rng(2)
    q = np.array([random_configuration(robot, random, np.zeros(3)) for _ in range(300)])
    assert 1.0 <= q[:, 0].min() < 1.1 and 7.2 < q[:, 0].max() <= 1.0 + 2.0 * math.pi
    assert -1.1 < q[:, 1].max() <= -1.0 and q[:, 1].min() < -7.2


@pytest.mark.parametrize('limits', [{'velocity': math.inf}, {'velocity': 0.0}])
def test_velocity_limits_that_are_none_are_doubtful(limits):
    robot = Robot.from_urdf(planar().urdf, limits={'joint2': limits})
    assert found(robot, [TIP])['velocity limit', 'joint2'] == DOUBTFUL


# Arguments and the report ----------------------------------------------------------------


@pytest.mark.parametrize(('options', 'said'), [
    ({'samples': 0}, 'samples'), ({'runs': -1}, 'runs'), ({'seed': 1.5}, 'seed'),
    ({'seconds': math.inf}, 'seconds'), ({'period': 1.0}, 'period'), ({'jobs': 0}, 'jobs')])
def test_arguments_out_of_range_are_refused(options, said):
    with pytest.raises(SettingsError, match=said):
        check(planar(), stack_of(planar(), TIP), **options)


def test_a_wrong_start_is_refused():
    with pytest.raises(RobotError):
        check(planar(), stack_of(planar(), TIP), around=[0.0])


def test_settings_that_a_controller_refuses_are_faults():
    lines = ['near: {type: keep_in, frame: link3, shape: {sphere: 1.0}, gain: 300.0}']
    report = check(planar(), stack_of(planar(), *lines), samples=3, runs=3)
    assert [each.kind for each in report.of(WRONG)] == ['fault'] and not report.runs


def test_the_same_seed_gives_the_same_report_and_another_one_another():
    stack = stack_of(planar(), TIP, POSTURE)
    reports = [replace(check(planar(), stack, samples=10, runs=2, seconds=2.0, seed=seed),
                       timing=None, findings=()) for seed in (1, 1, 2)]
    assert reports[0] == reports[1] != replace(reports[2], seed=1)


def test_progress_is_told_of_every_part():
    told = []

    class Shown:

        def __init__(self, total, what):
            told.append([what, total, 0])

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def advance(self):
            told[-1][2] += 1

    check(planar(), stack_of(planar(), TIP), samples=4, runs=2, seconds=0.1, progress=Shown)
    assert [entry[1:] for entry in told] == [[4, 4], [2, 2]]


def test_a_report_survives_json():
    lines = ['half: {type: keep_in, frame: link3, shape: {sphere: 1.0}}', TIP, POSTURE]
    report = check(planar(), stack_of(planar(), *lines), samples=5, runs=2, seconds=0.5)
    text = report.to_json()
    assert CheckReport.from_json(text) == report
    content = json.loads(text)
    assert isinstance(content['tasks'][0]['outside'], float)
    assert content['tasks'][1]['outside'] is None
    # It is a limit that no joint has.
    assert [each['value'] for each in content['worst'] if each['kind'] == 'acceleration'] == [None]


def test_every_part_of_a_report_is_in_the_schema_with_every_field():
    described = dict(schema())
    report = check(planar(), stack_of(planar(), TIP, ANGLE), samples=3, runs=1, seconds=0.1)
    for each in (report, report.findings[0], report.levels[0], report.tasks[0], report.pairs[0],
                 report.worst[0], report.timing):
        assert is_dataclass(each)
        assert [field.name for field in fields(each)] == [
            name for name, _, _ in described[type(each)]]
        assert all(text for _, _, text in described[type(each)])


def test_findings_are_the_worst_first():
    lines = [POSTURE, TIP.replace('}', ', gain: 60}')]
    report = check(planar(), stack_of(planar(), *lines), samples=5, runs=1, seconds=0.2)
    order = [each.severity for each in report.findings]
    assert set(order) == {WRONG, DOUBTFUL, FINE}
    assert order == sorted(order, key=[WRONG, DOUBTFUL, FINE].index)
    assert not report.passes() and report.of(WRONG)[0].change

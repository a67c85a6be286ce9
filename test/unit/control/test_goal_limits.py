# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals that are probably a mistake are told, and those beyond a limit refused."""

import math

from hypothesis import given, strategies
import numpy as np
import pytest
from robots import CONFIG, panda, PANDA_TOOL
from scipy.spatial.transform import Rotation
from tp_controller import Controller, GoalError, Robot, Settings, SettingsError, Stack
from tp_controller.model.rpy import quaternion_from_rpy

Q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785])
DOWN = (1.0, 0.0, 0.0, 0.0)
STACK = f"""
- tool: {{type: pose, frame: {PANDA_TOOL}}}
- flat: {{type: pose, frame: {PANDA_TOOL}, axes: [x, y, z]}}
- side: {{type: pose, frame: panda_link4, axes: [y, rz]}}
- elbow: {{type: position, frame: panda_link4, axes: y}}
- hand: {{type: position, frame: {PANDA_TOOL}, reference: panda_link4}}
- turn: {{type: orientation, frame: {PANDA_TOOL}}}
- view: {{type: look_at, frame: {PANDA_TOOL}}}
- in: {{type: keep_in, frame: {PANDA_TOOL}, shape: half_space}}
- posture: {{type: posture}}
"""


def controller(started=True, **settings):
    """Return a controller of the arm at `Q`."""
    robot = panda()
    made = Controller(robot, Stack.from_yaml(STACK, robot), Settings(**settings))
    if started:
        made.update(Q, 0.0)
    return made


def tool():
    """Return where the tool is at `Q`."""
    return panda().state(Q).pose(PANDA_TOOL).copy()


# Reach ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('name, base, frame', [
    ('panda.yaml', 'fixed', PANDA_TOOL), ('planar_3r.yaml', 'fixed', 'link3'),
    ('mobile_arm.urdf', 'fixed', 'tool'), ('two_arms.urdf', 'fixed', 'left_hand')])
def test_no_posture_brings_a_frame_beyond_its_reach(name, base, frame):
    robot = Robot.from_file(CONFIG / 'robots' / name, base=base)
    random = np.random.default_rng(3)
    lower, upper = np.maximum(robot.lower, -math.pi), np.minimum(robot.upper, math.pi)
    farthest = max(np.linalg.norm(robot.state(random.uniform(lower, upper)).position(frame))
                   for _ in range(2000))
    assert farthest <= robot.reach(frame) < 1.2 * farthest


def test_reach_between_two_frames_counts_what_lies_between_them():
    robot = Robot.from_file(CONFIG / 'robots' / 'two_arms.urdf')
    assert robot.reach('left_hand', 'right_hand') == robot.reach('right_hand', 'left_hand')
    assert robot.reach('left_hand', 'left_hand') <= 2.0 * robot.reach('left_hand')
    # A link of the arm does not come nearer than to the shoulder of its own side.
    state = robot.state(robot.neutral())
    apart = np.linalg.norm(state.position('left_hand') - state.position('right_hand'))
    assert apart <= robot.reach('left_hand', 'right_hand')


def test_a_base_that_moves_reaches_everything_but_not_with_its_arm_alone():
    robot = Robot.from_file(CONFIG / 'robots' / 'mobile_arm.urdf', base='differential')
    assert robot.reach('tool') == math.inf
    assert robot.reach('tool', 'base_link') < 3.0


# Remarks --------------------------------------------------------------------------------------


@pytest.mark.parametrize('task, goal, told', [
    ('tool', [400, 200, 500, *DOWN],
     r'the goal is 671 m from panda_link0, and out of reach: all links in a line are 1.42 m '
     'long; goals are in metres, not in millimetres'),
    ('tool', [4.0, 2.0, 5.0, *DOWN], r'the goal is 6.71 m from panda_link0, and out of reach: '
                                     'all links in a line are 1.42 m long'),
    ('elbow', [0.1, 0.06, -0.3],
     'not counted: x = 0.1, z = -0.3; the axes of the task are y'),
    ('flat', [0.4, 0.0, 0.5, *DOWN],
     'not counted: the orientation; the axes of the task are x, y, z')])
def test_a_goal_that_is_probably_a_mistake_is_taken_with_a_remark(task, goal, told):
    made = controller()
    assert made.set_goal(task, goal, 0.0) == (told,)
    assert made.stack.tasks[task].goal is not None


@pytest.mark.parametrize('task, goal', [
    ('tool', [0.4, 0.2, 0.5, *DOWN]), ('elbow', [0.0, 0.06, 0.0]),
    ('flat', [0.4, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]), ('hand', [0.1, 0.1, 0.1]),
    ('turn', DOWN), ('view', [40.0, 0.0, 0.0]), ('posture', Q)])
def test_an_ordinary_goal_has_no_remark(task, goal):
    assert controller().set_goal(task, goal, 0.0) == ()


def test_what_the_frame_of_a_goal_adds_to_it_was_not_given_by_anybody():
    made = controller()
    assert made.set_goal('elbow', [0.0, 0.1, 0.0], 0.0, frame=PANDA_TOOL) == ()
    assert 'not counted' in made.set_goal('elbow', [0.1, 0.1, 0.0], 0.0, frame='panda_link0')[0]
    # Out of reach it is all the same.
    assert made.set_goal('elbow', [0.0, 9.0, 0.0], 0.0, frame=PANDA_TOOL)


@pytest.mark.parametrize('value, hint', [
    (-115.0, '; goals are in radians, not in degrees'), (-2000.0, ''), (0.5, '')])
def test_a_joint_goal_in_degrees_is_refused_with_a_hint(value, hint):
    with pytest.raises(GoalError) as refused:
        controller().set_goal('posture', {'panda_joint4': value}, 0.0)
    assert str(refused.value).endswith(f'is outside its limits [-3.0718, -0.0698]{hint}')


# Limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('task, goal', [
    ('tool', [0.4, 0.2, 0.05, *DOWN]), ('flat', [0.4, 0.2, 0.05, *DOWN])])
def test_a_goal_outside_the_workspace_is_refused_and_the_old_one_stays(task, goal):
    made = controller(workspace=(-1.0, 1.0, -math.inf, math.inf, 0.1, 0.8))
    before = made.stack.tasks[task].goal
    with pytest.raises(GoalError, match='outside the workspace: z = 0.05 m is not from 0.1 m to '
                                        '0.8 m, in the frame panda_link0'):
        made.set_goal(task, goal, 0.0)
    assert made.stack.tasks[task].goal is before
    made.set_goal(task, [0.4, 5.0, 0.15, *goal[3:]], 0.0)


@pytest.mark.parametrize('task, rest', [('elbow', ()), ('side', (0.0, 0.0, 0.0, 1.0))])
def test_of_a_place_in_the_workspace_only_axes_that_count_are_those_of_the_goal(task, rest):
    elbow = panda().state(Q).position('panda_link4')
    made = controller(workspace=(-1.0, 1.0, -0.2, 0.2, elbow[2] - 0.01, 1.0))
    # x and z are those of the elbow.
    made.set_goal(task, [0.0, 0.1, 0.0, *rest], 0.0)
    with pytest.raises(GoalError, match='y = 0.3 m'):
        made.set_goal(task, [0.0, 0.3, 0.0, *rest], 0.0)


def test_the_workspace_is_in_the_root_whatever_the_reference_of_a_task():
    made = controller(workspace=(-1.0, 1.0, -1.0, 1.0, 0.2, 1.0))
    T = panda().state(Q).pose('panda_link4')
    low, high = np.array([0.4, 0.1, 0.1]), np.array([0.4, 0.1, 0.3])
    below, above = (T[:3, :3].T.dot(point - T[:3, 3]) for point in (low, high))
    made.set_goal('hand', above, 0.0)
    with pytest.raises(GoalError, match='z = 0.1 m'):
        made.set_goal('hand', below, 0.0)


@pytest.mark.parametrize('distance, refused', [(0.09, False), (0.11, True)])
def test_a_goal_farther_away_than_the_largest_jump_is_refused(distance, refused):
    made, T = controller(largest_jump=0.1), tool()
    goal = T.copy()
    goal[:3, 3] += distance * np.array([0.6, 0.0, 0.8])
    if not refused:
        made.set_goal('tool', goal, 0.0)
        return
    with pytest.raises(GoalError, match=r'the goal is 0.11 m away, more than largest_jump '
                                        r'\(0.1 m\) allows'):
        made.set_goal('tool', goal, 0.0)


@pytest.mark.parametrize('task', ['tool', 'turn'])
@pytest.mark.parametrize('angle, refused', [(0.45, False), (0.55, True)])
def test_a_goal_turned_more_than_the_largest_turn_is_refused(task, angle, refused):
    made, T = controller(largest_turn=0.5), tool()
    T[:3, :3] = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix().dot(T[:3, :3])
    goal = T if task == 'tool' else T[:3, :3]
    if not refused:
        made.set_goal(task, goal, 0.0)
        return
    with pytest.raises(GoalError, match='0.55 rad away, more than largest_turn'):
        made.set_goal(task, goal, 0.0)


def test_joints_are_limited_by_the_largest_turn_and_the_others_by_nothing():
    made = controller(largest_turn=0.5, largest_jump=0.1)
    made.set_goal('posture', {'panda_joint1': 0.4}, 0.0)
    with pytest.raises(GoalError, match='largest_turn'):
        made.set_goal('posture', {'panda_joint1': 0.6}, 0.0)
    # The region is no goal of the frame.
    for height in (-5.0, 5.0):
        made.set_goal('in', [0.0, 0.0, height, *DOWN], 0.0)


def test_a_refused_goal_leaves_the_direction_of_a_turn_alone():
    # Near half a turn a task remembers which way round it goes.
    free, limited = controller(), controller(largest_turn=3.2, largest_jump=0.01)
    half = tool()
    half[:3, :3] = Rotation.from_rotvec([0.0, 0.0, math.pi - 1e-3]).as_matrix().dot(half[:3, :3])
    other = tool()
    other[:3, :3] = Rotation.from_rotvec([0.0, 0.0, -2.0]).as_matrix().dot(
        other[:3, :3])
    other[0, 3] += 0.5
    for made in (free, limited):
        made.set_goal('tool', half, 0.0)
        made.update(Q, 0.01)
    with pytest.raises(GoalError):
        limited.set_goal('tool', other, 0.02)
    np.testing.assert_array_equal(free.update(Q, 0.03).velocity, limited.update(Q, 0.03).velocity)


def test_limits_need_to_know_where_the_robot_is():
    made = controller(started=False, largest_jump=0.1)
    with pytest.raises(GoalError, match='need joint positions, and none have arrived yet'):
        made.set_goal('tool', tool(), 0.0)


@pytest.mark.parametrize('workspace', [
    (0, 1, 0, 1, 0), (1, 0, 0, 1, 0, 1), (0, 1, 0, 1, 0, math.nan), 'all', None, (True,) * 6])
def test_a_workspace_that_is_no_box_is_refused(workspace):
    with pytest.raises(SettingsError, match='workspace must be six numbers, from and to'):
        Settings(workspace=workspace)


# Angles ---------------------------------------------------------------------------------------


@given(strategies.tuples(*[strategies.floats(-10.0, 10.0)] * 3))
def test_roll_pitch_and_yaw_are_turns_about_fixed_axes(rpy):
    expected = Rotation.from_euler('xyz', rpy).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(quaternion_from_rpy(*rpy)).as_matrix(),
                               expected, atol=1e-12)

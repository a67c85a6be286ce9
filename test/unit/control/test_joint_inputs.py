# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Locked joints: they brake and stand, and the tasks are those of a robot without them."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, GoalError, Robot, RobotError, Settings, Stack, TimeError
from tp_controller.control.cycle_record import CycleRecord

TOOL, READY, T = robots.PANDA_TOOL, np.array(robots.PANDA_READY), 0.01
NAMES = [f'panda_joint{number}' for number in range(1, 8)]
STACKS = (
    f'- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}\n- posture: {{type: posture}}\n',
    f'- limits: {{type: joint_limits}}\n- tool: {{type: position, frame: {TOOL}, gain: 3.0}}\n'
    '- elbow: {type: position, frame: panda_link4, axes: z}\n- posture: {type: posture}\n',
    f'- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.3}}\n'
    f'- [tool: {{type: position, frame: {TOOL}}}, turn: {{type: pointing, frame: {TOOL}}}]\n',
    f'- tool: {{type: position, frame: {TOOL}, mode: scale}}\n'
    f'- middle: {{type: joint_limit_distance, gain: 0.1}}\n',
    f'- [posture: {{type: posture, gain: 0.5}}, tool: {{type: pose, frame: {TOOL}}}]\n',
)


# What the robot can do counts as well.
AGILE = (f'- tool: {{type: position, frame: {TOOL}}}\n'
         f'- mobile: {{type: manipulability, frame: {TOOL}, axes: [x, y, z, rx], gain: 3.0}}\n')
MOBILE = f'- mobile: {{type: manipulability_above, frame: {TOOL}, minimum: 0.06}}\n'


def panda(**limits):
    """Return a Panda whose joints all have some limits."""
    return Robot.from_file(robots.PANDA_DH, limits=dict.fromkeys(NAMES, limits))


def control(text, robot=None, **options):
    """Return a controller without transitions."""
    robot = robot or panda()
    return Controller(robot, Stack.from_yaml(text, robot), Settings(
        **{'period': T, 'blend': 0.0, 'command_delay': 0, **options}))


def run(controller, q, count, begin=0, lock=None):
    """Return the configurations and commands of ideal cycles; `lock`: {cycle: joints}."""
    q, places, velocities = np.array(q), [], []
    for cycle in range(begin, begin + count):
        if cycle in (lock or {}):
            controller.lock(lock[cycle], T * cycle)
        places.append(q)
        velocities.append(controller.update(q, T * cycle).velocity)
        q = controller.robot.integrate(q, velocities[-1], T)
    return np.array([*places, q]), np.array(velocities)


def shifted(robot, q, way):
    """Return the pose of the tool, moved by a way [m]."""
    pose = robot.state(q).pose(TOOL).copy()
    pose[:3, 3] += way
    return pose


# The robot without the joint

@pytest.mark.parametrize('compiled', [True, False])
@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.parametrize('joint', ['panda_joint2', 'panda_joint4', 'panda_joint7'])
@pytest.mark.parametrize('text', [*STACKS[:3], AGILE])
def test_locked_joint_is_passive(text, joint, scaling, compiled):
    kept = [NAMES.index(name) for name in NAMES if name != joint]
    one = control(text, panda(acceleration=8.0), scaling=scaling)
    part = Robot(one.robot.urdf, [name for name in NAMES if name != joint],
                 {name: {'acceleration': 8.0} for name in NAMES if name != joint})
    other = control(text, part, scaling=scaling)
    if not compiled:
        one._core.solve = lambda *given: None
    q, passive = READY + 0.1, READY[[NAMES.index(joint)]] + 0.1
    one.lock([joint], 0.0)
    for cycle in range(60):
        if cycle == 5:
            goal = shifted(one.robot, q, [0.1, 0.2, -0.1])
            for controller in (one, other):
                task = controller.stack.tasks['tool']
                controller.set_goal('tool', goal if task.goal_type == 'pose' else goal[:3, 3],
                                    T * cycle)
        found = one.update(q, T * cycle).velocity
        expected = other.update(q[kept], T * cycle, passive=passive).velocity
        assert found[NAMES.index(joint)] == 0.0
        np.testing.assert_allclose(found[kept], expected, rtol=0.0, atol=1e-11)
        q = q + T * found


def test_locked_joint_counts_again_once_it_is_unlocked():
    controller, violations = control(MOBILE), []
    J = controller.robot.state(READY).jacobian(TOOL)
    for cycle, change in enumerate((controller.lock, controller.unlock)):
        change(NAMES[3:4], T * cycle)
        report = controller.update(READY, T * cycle).report
        violations.append(report.tasks[0].errors[0][0])
    for found, columns in zip(violations, (np.delete(J, 3, axis=1), J)):
        w = np.sqrt(np.linalg.det(columns @ columns.T))
        assert found == pytest.approx(max(1.0 - w / 0.06, 0.0))
    assert violations[0] > 0.1


def test_robot_with_fewer_joints_than_axes_has_no_manipulability():
    controller = control(f'- mobile: {{type: manipulability, frame: {TOOL}}}\n')
    controller.lock(NAMES[:2], 0.0)
    for cycle in range(3):
        command = controller.update(READY, T * cycle)
    assert np.abs(command.velocity).max() < 1e-9


def test_tool_arrives_without_a_joint_that_is_locked_in_motion():
    controller = control(STACKS[0], panda(acceleration=5.0))
    controller.update(READY, 0.0)
    goal = shifted(controller.robot, READY, [0.0, 0.25, 0.05])
    controller.set_goal('tool', goal, 0.0)
    places, _ = run(controller, READY, 800, lock={30: ['panda_joint3']})
    assert np.ptp(places[60:, 2]) == 0.0
    np.testing.assert_allclose(controller.robot.state(places[-1]).pose(TOOL), goal, atol=1e-4)
    tool, posture = controller.update(places[-1], 8.0).report.tasks
    assert tool.status == 'reached'
    assert posture.status == 'limited'


def test_cycles_without_a_joint_still_take_the_fast_path():
    controller = control(STACKS[0])
    run(controller, READY, 3, lock={0: ['panda_joint3']})
    assert isinstance(controller._last, CycleRecord)
    assert not controller._last._head[1]


def test_mimic_joints_of_a_locked_joint_stand_too():
    robot = Robot.from_urdf(robots.CHAIN)
    leader = robot.joint_names.index('a')
    controller = Controller(robot, Stack.from_yaml(
        '- tip: {type: position, frame: l2}', robot), Settings(blend=0.0))
    controller.lock(['a'], 0.0)
    controller.update(robot.neutral(), 0.0)
    controller.set_goal('tip', [9.0, 9.0, 9.0], 0.0)
    assert controller.update(robot.neutral(), T).velocity[leader] == 0.0
    level, = controller._last.cycle.levels
    # Joint b follows a, and nothing else moves the frame.
    assert not level.J.any()


def test_base_moves_no_more_along_a_locked_velocity():
    robot = robots.moving_panda('planar')
    controller = Controller(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {TOOL}}}', robot), Settings(blend=0.0))
    q = robot.configuration(READY, np.eye(4))
    controller.lock(['base_x', 'base_yaw'], 0.0)
    controller.update(q, 0.0)
    controller.set_goal('tool', robot.state(q).position(TOOL) + [0.2, 0.2, 0.0], 0.0)
    velocity = controller.update(q, T).velocity
    names = robot.velocity_names
    assert velocity[names.index('base_x')] == velocity[names.index('base_yaw')] == 0.0
    assert velocity[names.index('base_y')] > 0.0


def test_all_joints_can_be_locked():
    controller = control(STACKS[0])
    controller.update(READY, 0.0)
    controller.set_goal('tool', shifted(controller.robot, READY, [0.1, 0.0, 0.0]), 0.0)
    _, velocities = run(controller, READY, 5, lock={0: NAMES})
    assert not velocities.any()
    report = controller.update(READY, 1.0).report
    assert report.locked == tuple(NAMES)
    assert 'locked' in report.tasks[0].reason or 'together' in report.tasks[0].reason


# The moment of the lock

@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(STACKS), st.integers(0, 2 ** 32 - 1), st.booleans(), st.booleans(),
       st.sampled_from(['redistribute', 'uniform']), st.sampled_from([0.0, 0.3]))
def test_no_limit_is_exceeded_whenever_joints_are_locked_and_unlocked(
        text, seed, jerky, compiled, scaling, blend):
    rng = np.random.default_rng(seed)
    robot = panda(acceleration=6.0, **({'jerk': 120.0} if jerky else {}))
    controller = control(text, robot, scaling=scaling, blend=blend)
    if not compiled:
        controller._core.solve = lambda *given: None
    middle, reach = 0.5 * (robot.upper + robot.lower), 0.45 * (robot.upper - robot.lower)
    q, v, a = middle + rng.uniform(-reach, reach), np.zeros(7), np.zeros(7)
    for cycle in range(120):
        now = T * cycle
        if cycle % 50 == 1:
            pose = robot.state(middle + rng.uniform(-reach, reach)).pose(TOOL)
            kind = controller.stack.tasks['tool'].goal_type
            controller.set_goal('tool', pose if kind == 'pose' else pose[:3, 3], now)
        if rng.random() < 0.05:
            some = list(rng.choice(NAMES, rng.integers(1, 4), replace=False))
            (controller.lock if rng.random() < 0.7 else controller.unlock)(some, now)
        command = controller.update(q, now).velocity
        change = (command - v) / T
        assert (np.abs(command) <= robot.velocity * (1.0 + 1e-9)).all()
        assert (np.abs(change) <= 6.0 * (1.0 + 1e-9)).all()
        if jerky:
            assert (np.abs(change - a) <= 120.0 * T * (1.0 + 1e-6)).all()
        locked = [NAMES.index(name) for name in controller.locked]
        if not jerky:
            # Brakes as hard as it may, and stands.
            np.testing.assert_allclose(command[locked], np.copysign(
                np.maximum(np.abs(v[locked]) - 6.0 * T, 0.0), v[locked]), atol=1e-9)
        v, a, q = command, change, q + T * command
        assert (q <= robot.upper + 1e-9).all() and (q >= robot.lower - 1e-9).all()


def test_joint_with_a_jerk_limit_comes_to_rest_without_overshoot_and_stays():
    robot = panda(acceleration=6.0, jerk=100.0)
    controller = control('- swing: {type: joint, joints: panda_joint1, target: [2.5]}', robot)
    _, velocities = run(controller, READY, 90, lock={40: ['panda_joint1']})
    speeds = velocities[39:, 0]
    assert speeds[0] > 0.5
    assert (speeds >= -1e-12).all()
    assert (np.diff(speeds[speeds.argmax():]) <= 1e-12).all()
    # v/a + a/j, the time of a trapezoidal stop, and some for the present acceleration.
    still = np.flatnonzero(np.abs(speeds) < 1e-9)
    assert T * still[0] <= speeds[0] / 6.0 + 6.0 / 100.0 + 6.0 / 100.0 + 3 * T
    assert not speeds[still[0] + 3:].any()


@pytest.mark.parametrize('compiled', [True, False])
def test_first_level_is_not_disturbed_while_a_locked_joint_brakes(compiled):
    robot = Robot.from_file(robots.PANDA_DH, limits={'panda_joint1': {'acceleration': 2.0}})
    controller = control(f'- tool: {{type: position, frame: {TOOL}, gain: 1.5}}\n'
                         '- swing: {type: joint, joints: panda_joint1}\n', robot, reserve=0.0,
                         regularisation=0.0)
    if not compiled:
        controller._core.solve = lambda *given: None
    controller.update(READY, 0.0)
    goal = robot.state(READY).position(TOOL) + [0.0, 0.3, 0.0]
    controller.set_goal('tool', goal, 0.0)
    controller.set_goal('swing', [1.5], 0.0)
    places, velocities = run(controller, READY, 80, lock={40: ['panda_joint1']})
    braking = np.flatnonzero(velocities[:, 0])[np.flatnonzero(velocities[:, 0]) >= 40]
    assert len(braking) > 5
    for q, velocity in zip(places[30:], velocities[30:]):
        state = robot.state(q)
        np.testing.assert_allclose(state.jacobian(TOOL)[:3].dot(velocity),
                                   1.5 * (goal - state.position(TOOL)), atol=1e-6)


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
def test_lock_without_acceleration_limits_changes_no_other_joint_at_once(scaling):
    controller = control(STACKS[0], scaling=scaling, blend=0.4)
    controller.update(READY, 0.0)
    controller.set_goal('tool', shifted(controller.robot, READY, [0.0, 0.3, -0.1]), 0.0)
    _, velocities = run(controller, READY, 130, lock={60: ['panda_joint1']})
    assert np.abs(velocities[59, 0]) > 0.1 and not velocities[60:, 0].any()
    changes = np.abs(np.diff(np.delete(velocities, 0, axis=1)[55:], axis=0)).max(axis=1)
    assert changes.max() < 0.03
    # They make up for joint 1.
    assert np.abs(velocities[100:, 1:]).max() > 0.1


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
def test_unlock_is_blended_in(scaling):
    changes = []
    for blend in (0.0, 0.4):
        controller = control(STACKS[0], scaling=scaling, blend=blend)
        controller.update(READY, 0.0)
        goal = shifted(controller.robot, READY, [0.15, 0.1, 0.0])
        controller.set_goal('tool', goal, 0.0)
        places, before = run(controller, READY, 100, lock={0: ['panda_joint4']})
        controller.unlock(['panda_joint4'], 1.0)
        places, after = run(controller, places[-1], 400, 100)
        changes.append(np.abs(np.diff([before[-1], *after], axis=0)).max())
        np.testing.assert_allclose(controller.robot.state(places[-1]).pose(TOOL), goal, atol=1e-2)
    assert changes[1] < 0.3 * changes[0]


# Measured positions

def test_locked_joint_that_sags_is_compensated_and_may_pass_its_limits():
    controller = control(STACKS[0])
    q, index = READY.copy(), NAMES.index('panda_joint2')
    controller.lock(['panda_joint2'], 0.0)
    controller.update(q, 0.0)
    goal = controller.robot.state(READY).pose(TOOL)
    q[index] = controller.robot.lower[index] + 0.05
    controller.update(q, T)
    for cycle in range(2, 60):
        q[index] -= 1e-3
        velocity = controller.update(q, T * cycle).velocity
        assert velocity[index] == 0.0
        q = q + T * velocity
    assert q[index] < controller.robot.lower[index]
    # It does not come back by itself, and is followed.
    q = run(controller, q, 400, 60)[0][-1]
    np.testing.assert_allclose(controller.robot.state(q).position(TOOL), goal[:3, 3], atol=0.3)


# Reports

def test_lock_is_the_cause_and_the_hint():
    controller = control(STACKS[0])
    controller.update(READY, 0.0)
    controller.set_goal('tool', shifted(controller.robot, READY, [0.15, 0.0, 0.0]), 0.0)
    places, _ = run(controller, READY, 600, lock={0: ['panda_joint4']})
    report = controller.update(places[-1], 6.0).report
    assert report.locked == ('panda_joint4',)
    tool, _ = report.tasks
    assert [(cause.kind, cause.name) for cause in tool.causes] == [('lock', 'panda_joint4')]
    assert tool.causes[0].share > 0.9
    assert tool.status == 'limited'
    assert tool.reason.split('; ')[0] == 'panda_joint4 is locked'
    assert tool.hint == 'unlock panda_joint4'


def test_lock_is_the_cause_while_the_joint_brakes():
    controller = control('- swing: {type: joint, joints: panda_joint1, target: [2.5]}',
                         panda(acceleration=1.0))
    places, velocities = run(controller, READY, 51, lock={50: ['panda_joint1']})
    assert velocities[-1, 0] > 0.1
    task, = controller.update(places[-1], T * 51).report.tasks
    assert ('lock', 'panda_joint1') in [(cause.kind, cause.name) for cause in task.causes]
    assert 'panda_joint1 is locked' in task.reason


def test_posture_is_reached_but_for_the_locked_joint_and_says_so():
    controller = control('- posture: {type: posture}')
    controller.update(READY, 0.0)
    controller.set_goal('posture', READY + 0.2, 0.0)
    places, _ = run(controller, READY, 1500, lock={0: ['panda_joint5']})
    np.testing.assert_allclose(np.delete(places[-1], 4), np.delete(READY + 0.2, 4), atol=1e-4)
    posture, = controller.update(places[-1], 15.0).report.tasks
    assert (posture.status, posture.reason) == ('limited', 'panda_joint5 is locked')
    assert posture.errors[0][0] == pytest.approx(0.2, abs=1e-3)


def test_bounds_that_only_a_locked_joint_could_meet_move_no_other():
    robot = panda()
    q = READY.copy()
    q[3] = robot.upper[3] - 0.01
    controller = control('- limits: {type: joint_limits, margin: 0.1}', robot)
    _, velocities = run(controller, q, 3, lock={0: ['panda_joint4']})
    assert not velocities.any()
    limits, = controller.update(q, 1.0).report.tasks
    assert limits.reason == \
        'no joint can move panda_joint4 back within bounds; panda_joint4 is locked'


def test_goal_that_the_others_cannot_come_nearer_to_is_out_of_reach():
    robot = robots.planar()
    controller = control('- tip: {type: position, frame: link3, axes: xy}', robot)
    q = np.zeros(3)
    controller.lock(['joint2', 'joint3'], 0.0)
    controller.update(q, 0.0)
    # A straight arm, and a goal inwards: bending it would help, but no joint that moves.
    controller.set_goal('tip', robot.state(q).position('link3') - [0.1, 0.0, 0.0], 0.0)
    tip, = controller.update(q, T).report.tasks
    assert tip.reason.startswith('out of reach by 0.1 m')


# Inputs

def test_locks_stay_with_another_stack_and_other_settings_until_unlocked():
    controller = control(STACKS[0])
    controller.lock(['panda_joint2'], 3.0)
    controller.lock(['panda_joint2', 'panda_joint6'], 5.0)
    controller.settings = Settings(period=T, damping=0.2)
    controller.set_velocity_limits({'panda_joint2': 0.5})
    controller.replace_stack(Stack.from_yaml(STACKS[1], controller.robot))
    assert dict(controller.locked) == {'panda_joint2': 3.0, 'panda_joint6': 5.0}
    assert controller.update(READY, 6.0).velocity[[1, 5]].tolist() == [0.0, 0.0]
    controller.unlock(['panda_joint1', 'panda_joint2'], 7.0)
    assert list(controller.locked) == ['panda_joint6']
    assert controller.velocity_limits[1] == 0.5


@pytest.mark.parametrize('joints, now, error, told', [
    (['panda_joint2', 'joint4'], 0.0, RobotError, "unknown driven joint 'joint4'"),
    ('panda_joint2', 0.0, RobotError, 'must be a list of names'),
    (None, 0.0, RobotError, 'must be a list of names, not None'),
    (iter(['panda_joint2']), 0.0, RobotError, 'must be a list of names'),
    (['panda_joint2'], math.nan, TimeError, 'now must be a finite number'),
    (['panda_joint2'], None, TimeError, 'now must be a finite number')])
def test_lock_that_cannot_be_locks_nothing(joints, now, error, told):
    controller = control(STACKS[0])
    for method in (controller.lock, controller.unlock):
        with pytest.raises(error, match=told):
            method(joints, now)
    assert not controller.locked


def test_lock_ends_a_motion_by_a_posture_and_refuses_those_that_move_the_joint():
    controller = control(STACKS[0])
    controller.update(READY, 0.0)
    state = controller.robot.state(READY + 0.3)
    controller.set_goal('tool', state.pose(TOOL), 0.0, posture=READY + 0.3)
    assert controller.stack.tasks['tool'].led
    controller.lock(['panda_joint4'], 0.0)
    assert not controller.stack.tasks['tool'].led
    with pytest.raises(GoalError, match='moves panda_joint4, which is locked'):
        controller.set_goal('tool', state.pose(TOOL), 0.0, posture=READY + 0.3)
    posture = READY + [0.3, 0.3, 0.3, 0.0, 0.3, 0.3, 0.3]
    controller.set_goal('tool', controller.robot.state(posture).pose(TOOL), 0.0, posture=posture)
    # It sags meanwhile, which does not keep the task from going on by itself.
    run(controller, READY - [0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 900)
    assert not controller.stack.tasks['tool'].led

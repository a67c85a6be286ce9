# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The controller in closed loops, with the limits, goals and reports around it."""

from collections import deque
from dataclasses import replace
import math

from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation
from tp_controller import (
    Controller,
    GoalError,
    KinematicSimulator,
    Level,
    Robot,
    RobotError,
    Settings,
    SettingsError,
    SimulatorNoise,
    solve,
    solve_position,
    Stack,
    StackError,
    TpControllerError,
)
from tp_controller.tasks import Joint, JointLimits, Pose

SEEDS = st.integers(0, 2 ** 32 - 1)
TOOL = robots.PANDA_TOOL
READY = np.array(robots.PANDA_READY)
# Without a transition, so that each update is what the tasks demand.
EXACT = Settings(damping=0.0, blend=0.0)
POSE_AND_POSTURE = ('- tool: {type: pose, frame: panda_hand_tcp, gain: 2.0}\n'
                    '- posture: {type: posture, gain: 0.5}\n')


def unlimited(robot):
    """Return the same robot without limits."""
    free = {'lower': -math.inf, 'upper': math.inf, 'velocity': math.inf}
    return Robot.from_urdf(robot.urdf, limits=dict.fromkeys(robot.joint_names, free))


def control(text, robot=None, options=EXACT):
    """Return a controller of a stack, on the Panda by default."""
    robot = robot or robots.panda()
    return Controller(robot, Stack.from_yaml(text, robot), options)


def run(controller, q, cycles, dt=0.01, each=None, **noise):
    """Run a controller on the simulator; return the positions after every cycle."""
    simulator = KinematicSimulator(controller.robot, q, noise=SimulatorNoise(
        **noise))
    positions = [simulator.q.copy()]
    for _ in range(cycles):
        command = controller.update(simulator.measure()[0], simulator.now)
        if each is not None:
            each(simulator.now, command)
        simulator.command(command.velocity)
        simulator.step(dt)
        positions.append(simulator.q.copy())
    return np.array(positions)


def shifted(T, offset, turn=(0.0, 0.0, 0.0)):
    """Return a pose moved by an offset and turned by a rotation vector, in base axes."""
    T = T.copy()
    T[:3, 3] += offset
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T[:3, :3]
    return T


def report_of(controller, name):
    """Return the report of one task at the ready posture."""
    report = controller.update(READY, 0.0).report
    return next(task for task in report.tasks if task.name == name)


# Closed loops

@pytest.mark.parametrize('gain', [0.5, 2.0, 5.0])
def test_error_decays_exponentially_at_the_gain(gain):
    robot = robots.panda()
    controller = control(f'- tool: {{type: pose, frame: {TOOL}, gain: {gain}}}\n', robot,
                         Settings(blend=0.0, damping=0.0, period=0.001))
    goal = shifted(robot.state(READY).pose(TOOL), [0.02, -0.03, 0.02], [0.05, 0.1, -0.05])
    controller.set_goal('tool', goal, 0.0)
    norms = []
    run(controller, READY, 500, 0.001,
        lambda now, command: norms.append([task[0] for task in command.report.tasks[0].errors]))
    t = 0.001 * np.arange(500)
    for unit in range(2):
        np.testing.assert_allclose(np.array(norms)[:, unit] / norms[0][unit], np.exp(-gain * t),
                                   rtol=0.01)


def test_pose_is_reached_and_said_to_be():
    robot = robots.panda()
    controller = control(POSE_AND_POSTURE, robot, None)
    goal = shifted(robot.state(READY).pose(TOOL), [0.1, 0.2, -0.1], [0.0, 0.3, 0.4])
    controller.set_goal('tool', goal, 0.0)
    seen = []
    q = run(controller, READY, 600, each=lambda now, command: seen.append(
        command.report.tasks[0].reached))
    np.testing.assert_allclose(robot.state(q[-1]).pose(TOOL), goal, atol=1e-3)
    assert not seen[0] and seen[-1]


def test_robot_without_goals_stays_where_it_is():
    controller = control(POSE_AND_POSTURE, options=None)
    q = run(controller, READY, 50)
    np.testing.assert_allclose(q, np.tile(READY, (51, 1)), atol=1e-12)
    assert controller.update(READY, 1.0).report.reached


def test_controller_without_tasks_commands_zero():
    assert control('[]').update(READY, 0.0).velocity.tolist() == [0.0] * 7


def test_lower_task_never_disturbs_a_higher_one_in_closed_loop():
    robot = unlimited(robots.panda())
    texts = [f'- hand: {{type: position, frame: {TOOL}, gain: 2.0}}\n',
             '- elbow: {type: position, frame: panda_link4, axes: z, gain: 3.0}\n',
             '- base: {type: joint, joints: panda_joint1, target: [1.5], gain: 4.0}\n',
             '- rest: {type: posture, target: {panda_joint7: -1.0}, gain: 1.0}\n']
    whole = control(''.join(texts), robot)
    parts = [control(''.join(texts[:count]), robot) for count in range(1, 4)]
    for controller in (whole, *parts):
        controller.update(READY, 0.0)
        controller.set_goal('hand', robot.state(READY).position(TOOL) + [-0.1, 0.2, 0.1], 0.0)
        if 'elbow' in controller.stack.tasks:
            controller.set_goal('elbow', [0.0, 0.0, 0.5], 0.0)
    q = READY.copy()
    for cycle in range(100):
        command = whole.update(q, 0.01 * cycle)
        for count, controller in enumerate(parts, start=1):
            alone = controller.update(q, 0.01 * cycle).velocity
            for group in list(controller.stack.active)[:count]:
                J = group[0].jacobian(robot.state(q))
                assert np.linalg.norm(J @ (command.velocity - alone)) < 1e-9 * max(
                    1.0, np.linalg.norm(J @ alone))
        q = q + 0.01 * command.velocity


def test_moving_goal_is_followed_without_a_lag_with_feed_forward():
    robot = robots.panda()
    controller = control(f'- tool: {{type: position, frame: {TOOL}, gain: 5.0}}\n', robot)
    start = robot.state(READY).position(TOOL).copy()
    speed = np.array([0.0, 0.1, 0.0])
    errors = []

    def each(now, command):
        errors.append(command.report.tasks[0].errors[0][0])
        controller.set_goal('tool', start + speed * (now + 0.01), now)
        controller.set_feed_forward('tool', speed, now)
    run(controller, READY, 200, each=each)
    # Without feed-forward the error would settle at v / K = 20 mm.
    assert max(errors) < 2e-3 and errors[-1] < 1e-4


# Goals

def moving_frame_cases():
    """Return (stack, frame) whose goals are in a frame of the robot."""
    root = f'- tool: {{type: %s, frame: {TOOL}, gain: 2.0}}\n'
    relative = f'- tool: {{type: %s, frame: {TOOL}, reference: panda_link2, gain: 2.0}}\n'
    return [(root, 'panda_link4'), (root, TOOL), (relative, 'panda_link5'),
            (relative, 'panda_link0'), (root, None), (relative, None)]


@pytest.mark.parametrize('text, frame', moving_frame_cases())
@pytest.mark.parametrize('kind', ['position', 'orientation', 'pose'])
def test_goal_in_another_frame_is_taken_where_that_frame_is_now(kind, text, frame):
    robot = robots.panda()
    controller = control(text % kind, robot)
    controller.update(READY, 0.0)
    state = robot.state(READY)
    if frame is None:
        # A frame that is not on the robot is given as its pose in the root.
        T_root_frame = shifted(np.eye(4), [0.3, -0.2, 0.5], [0.4, 0.5, -0.6])
        told = T_root_frame
    else:
        T_root_frame, told = state.pose(frame), frame
    T_frame_goal = np.linalg.inv(T_root_frame) @ shifted(
        state.pose(TOOL), [0.02, 0.05, -0.04], [0.1, -0.1, 0.2])
    goal = {'position': T_frame_goal[:3, 3], 'orientation': T_frame_goal[:3, :3],
            'pose': T_frame_goal}[kind]
    controller.set_goal('tool', goal, 0.0, told)
    report = controller.update(READY, 0.0).report.tasks[0]
    sizes = {'m': math.sqrt(0.02 ** 2 + 0.05 ** 2 + 0.04 ** 2), 'rad': math.sqrt(0.06)}
    for value, unit, _ in report.errors:
        assert value == pytest.approx(sizes[unit], rel=1e-6)
    task = controller.stack.tasks['tool']
    reached = np.linalg.inv(state.pose(task.reference)) @ T_root_frame @ T_frame_goal
    expected = {'position': reached[:3, 3], 'orientation': reached[:3, :3], 'pose': reached}
    np.testing.assert_allclose(task.goal, expected[kind], atol=1e-9)


def test_velocity_in_the_tools_own_axes_moves_along_them():
    robot = robots.panda()
    controller = control(f'- tool: {{type: twist, frame: {TOOL}}}\n', robot)
    controller.update(READY, 0.0)
    controller.set_goal('tool', [0.0, 0.0, 0.1, 0.0, 0.2, 0.0], 0.0, TOOL)
    velocity = controller.update(READY, 0.0).velocity
    state = robot.state(READY)
    twist = state.jacobian(TOOL) @ velocity
    np.testing.assert_allclose(state.rotation(TOOL).T @ twist[:3], [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(state.rotation(TOOL).T @ twist[3:], [0, 0.2, 0], atol=1e-12)


def test_goal_in_the_reference_frame_itself_needs_no_positions_yet():
    controller = control(f'- tool: {{type: position, frame: {TOOL}}}\n')
    controller.set_goal('tool', [0.5, 0.0, 0.5], 0.0, 'panda_link0')
    assert controller.stack.tasks['tool'].goal.tolist() == [0.5, 0.0, 0.5]


@pytest.mark.parametrize('name, goal, frame, message', [
    ('tol', [0, 0, 0], None, "unknown task 'tol' .did you mean 'tool'"),
    (['tool'], [0, 0, 0], None, 'unknown task'),
    ('tool', [0, 0], None, "goal of task 'tool' .a point x, y, z. needs 3 numbers"),
    ('tool', [0, 0, math.nan], None, 'must be finite'),
    ('tool', [0, 0, 0], 'panda_link88', "unknown frame 'panda_link88'"),
    ('tool', [0, 0, 0], 'panda_link4', 'needs joint positions, and none have arrived yet'),
    ('rest', READY, 'panda_link4', "a goal of task 'rest' is not expressed in a frame"),
    ('rest', {'panda_joint4': 1.0}, None, 'outside its limits'),
])
def test_goal_that_is_refused_leaves_the_one_in_force(name, goal, frame, message):
    controller = control(f'- tool: {{type: position, frame: {TOOL}}}\n- rest: {{type: posture}}\n')
    controller.set_goal('tool', [0.4, 0.1, 0.5], 0.0)
    with pytest.raises(GoalError, match=message):
        controller.set_goal(name, goal, 0.0, frame)
    assert controller.stack.tasks['tool'].goal.tolist() == [0.4, 0.1, 0.5]


@pytest.mark.parametrize('name, velocity, frame, message', [
    ('tol', [0, 0, 0], None, "unknown task 'tol'"),
    ('tool', [0, math.inf, 0], None, 'must be finite'),
    ('tool', [0, 0, 0], 'panda_link88', 'unknown frame'),
    ('speed', [0.0] * 7, 'panda_link4', 'is not expressed in a frame'),
])
def test_velocity_that_is_refused_has_no_effect(name, velocity, frame, message):
    controller = control(f'- tool: {{type: position, frame: {TOOL}}}\n'
                         '- speed: {type: joint_velocity}\n')
    controller.update(READY, 0.0)
    with pytest.raises(GoalError, match=message):
        controller.set_feed_forward(name, velocity, 0.0, frame)
    assert controller.update(READY, 0.0).velocity.tolist() == [0.0] * 7


@pytest.mark.parametrize('q', [[0.0] * 6, [math.nan] * 7, None, 'q'])
def test_positions_that_are_none_are_refused_and_the_controller_goes_on(q):
    controller = control(POSE_AND_POSTURE)
    with pytest.raises(RobotError, match='q '):
        controller.update(q, 0.0)
    before = controller.update(READY, 0.0).velocity
    with pytest.raises(RobotError, match='q '):
        controller.update(q, 0.1)
    assert controller.update(READY, 0.2).velocity.tolist() == before.tolist()


# Limits

@st.composite
def hard_runs(draw):
    """Return (robot, stack, start, goals): nothing about them is kind to the limits."""
    rng = np.random.default_rng(draw(SEEDS))
    robot = draw(st.sampled_from([robots.panda(), robots.mixed()]))
    frame = robot.frame_names[-1]
    gain = draw(st.sampled_from([1.0, 10.0, 80.0]))
    text = (f'- tool: {{type: {draw(st.sampled_from(["pose", "position", "orientation"]))}, '
            f'frame: {frame}, gain: {gain}}}\n'
            f'- rest: {{type: posture, gain: {gain}}}\n')
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    outside = 0.3 * draw(st.booleans())
    start = rng.uniform(lower - outside, upper + outside)
    if draw(st.booleans()):
        start = np.clip(start, robot.lower, robot.upper)
        start[0] = robot.upper[0]
    goals = [np.concatenate([rng.uniform(-1.0, 1.0, 3),
                             Rotation.from_quat(rng.normal(size=4)).as_quat()]) for _ in range(3)]
    return robot, text, start, goals, rng.uniform(lower, upper)


@pytest.mark.slow
@settings(max_examples=80)
@given(hard_runs(), st.integers(0, 3))
def test_no_limit_is_ever_exceeded_whatever_the_goals_start_and_delay(case, delay):
    robot, text, start, goals, rest = case
    controller = control(text, robot, Settings(blend=0.0, period=0.01, braking_gain=10.0))
    part = {'position': slice(0, 3), 'orientation': slice(3, 7), 'pose': slice(0, 7)}[
        controller.stack.tasks['tool'].type_name]
    controller.update(start, 0.0)
    controller.set_goal('rest', rest, 0.0)
    # A robot that does exactly as it is told, `delay` cycles late, and stops at no limit itself.
    on_the_way = deque([np.zeros(robot.n)] * delay)
    q = start.copy()
    for cycle in range(120):
        if cycle % 40 == 0:
            controller.set_goal('tool', goals[cycle // 40][part], 0.0)
        velocity = controller.update(q, 0.01 * cycle).velocity
        assert np.isfinite(velocity).all()
        assert (np.abs(velocity) <= robot.velocity).all()
        on_the_way.append(velocity)
        moved = q + 0.01 * on_the_way.popleft()
        assert (moved >= np.minimum(robot.lower, q) - 1e-12).all()
        assert (moved <= np.maximum(robot.upper, q) + 1e-12).all()
        q = moved


def accelerated(robot, acceleration):
    """Return a robot whose velocities all have an acceleration limit."""
    limits = {name: {'acceleration': acceleration} for name in robot.velocity_names}
    return Robot.from_urdf(robot.urdf, base=robot.base, limits=limits)


@pytest.mark.parametrize(('elapsed', 'most'), [
    (0.005, 0.005), (None, 0.1), (0.0, 0.1), (9.0, 0.1)])
def test_the_first_command_is_one_that_joints_at_rest_can_follow(elapsed, most):
    # Where commands follow joint states, the period is only the longest time between them.
    robot = accelerated(robots.planar(), 2.0)
    stack = Stack.from_yaml('- rest: {type: posture, target: [3.0, 2.0, 2.0], gain: 5.0}', robot)
    controller = Controller(robot, stack, Settings(period=0.1))
    first = controller.update([0.0, 0.0, 0.0], 0.0, elapsed=elapsed).velocity
    assert np.abs(first).max() == pytest.approx(2.0 * most)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(['panda', 'mixed', 'planar', 'floating', 'talos_arm', 'xarm7']),
       st.sampled_from([20.0, 100.0, 1000.0]), st.sampled_from([3.0, 15.0]), st.integers(0, 2),
       st.booleans(), SEEDS)
@example('panda', 20.0, 15.0, 2, True, 0)
def test_late_commands_lead_no_joint_past_a_limit_that_brake_within_acceleration_limits(
        name, rate, acceleration, delay, hurried, seed):
    robot = {'panda': robots.panda, 'mixed': robots.mixed}[name]() if name in (
        'panda', 'mixed') else robots.moving_panda(name) if name in ('planar', 'floating') \
        else robots.urdf_robot(name)
    robot, rng, period = accelerated(robot, acceleration), np.random.default_rng(seed), 1.0 / rate
    rows = robot.joint_columns
    lower, upper = np.maximum(robot.lower, -3.0)[rows], np.minimum(robot.upper, 3.0)[rows]
    controller = control('- rest: {type: posture, gain: 10.0}\n', robot,
                         Settings(blend=0.0, period=period, command_delay=2))
    q, now = robot.configuration(rng.uniform(lower, upper)), 0.0
    controller.update(q, now)
    pending = deque([np.zeros(robot.n)] * delay)
    for cycle in range(150):
        if cycle % 50 == 0:
            ends = rng.choice([0.0, 1.0, rng.random()], len(lower))
            goal = np.clip(lower + ends * (upper - lower), lower, upper)
            controller.set_goal('rest', goal, now)
        pending.append(controller.update(q, now).velocity)
        elapsed = period * (rng.uniform(0.5, 1.0) if hurried and rate >= 50.0 else 1.0)
        q, now = robot.integrate(q, pending.popleft(), elapsed), now + elapsed
        positions = robot.positions(q)
        assert (positions <= robot.upper + 1e-12).all()
        assert (positions >= robot.lower - 1e-12).all()


def test_commands_count_as_pending_for_as_many_cycles_as_are_set():
    robot, near = robots.mixed(), np.array([2.4, 0.0, 0.0, 0.0])
    controller = control('- m: {type: joint_velocity, joints: turn, timeout: 100}\n', robot,
                         Settings(blend=0.0, damping=0.0, command_delay=2))
    controller.update(near, 0.0)
    controller.set_goal('m', [5.0], 0.0)

    def command(cycle):
        return controller.update(near, 0.01 * cycle).velocity[0]

    # 10 /s times what the commands of 10 ms before leave of 0.1 rad.
    first = command(1)
    second = command(2)
    third = command(3)
    assert (first, second, third) == pytest.approx((1.0, 0.9, 0.81))
    # Zeros that are sent in place of commands pass them on.
    controller.halt(0.04)
    assert command(5) == pytest.approx(10.0 * (0.1 - 0.01 * third))
    controller.halt(0.06)
    controller.halt(0.07)
    assert command(8) == pytest.approx(1.0)
    controller.settings = replace(controller.settings, command_delay=0)
    assert command(9) == pytest.approx(1.0)
    controller.settings = replace(controller.settings, command_delay=2)
    assert command(10) == pytest.approx(1.0)
    assert command(11) == pytest.approx(0.9)


def test_ramp_takes_no_longer_if_a_cycle_is_late():
    # However late it is: a stop is not put off. The period is 2 ms.
    robot = robots.mixed()
    controller = control('- m: {type: joint_velocity, joints: turn, timeout: 100}\n', robot,
                         Settings(blend=0.0, period=0.002))
    q = np.zeros(robot.nq)
    controller.update(q, 0.0)
    controller.set_goal('m', [1.0], 0.0)
    assert controller.update(q, 0.002).velocity[0] == pytest.approx(1.0)
    speeds = [controller.slow_down(q, now, 4.0)[0] for now in (0.004, 0.054, 0.056, 0.26)]
    assert speeds == pytest.approx([0.992, 0.792, 0.784, 0.0])


def test_pending_commands_count_for_twice_the_mean_time_between_two_and_a_period_at_most():
    robot, near = robots.mixed(), np.array([2.45, 0.0, 0.0, 0.0])
    controller = control('- m: {type: joint_velocity, joints: turn, timeout: 100}\n', robot,
                         Settings(blend=0.0, damping=0.0, period=0.1, command_delay=1))
    controller.update(near, 0.0)
    controller.set_goal('m', [5.0], 0.0)
    for cycle in range(1000):
        velocity = controller.update(near, 0.002 * cycle).velocity[0]
    # v = 10 /s (0.05 rad − 4 ms v)
    assert velocity == pytest.approx(0.5 / 1.04)


def test_joint_runs_into_its_limit_softly_and_stays_there():
    robot = robots.mixed()
    controller = control('- m: {type: joint_velocity, joints: turn, timeout: 100}\n', robot,
                         replace(EXACT, command_delay=0))
    controller.update([0.0] * 4, 0.0)
    controller.set_goal('m', [5.0], 0.0)
    q = run(controller, [0.0] * 4, 400)[:, 0]
    speeds = np.diff(q) / 0.01
    assert speeds.max() == pytest.approx(1.5)
    assert (speeds >= 0.0).all() and (q <= 2.5).all()
    assert q[-1] == pytest.approx(2.5, abs=1e-4)
    # The last radians are taken at braking_gain times the distance.
    near = (q[:-1] > 2.36) & (q[:-1] < 2.49)
    np.testing.assert_allclose(speeds[near], 10.0 * (2.5 - q[:-1][near]), rtol=1e-9)


def test_braking_gain_of_the_settings_is_the_one_in_force():
    robot = robots.mixed()
    for gain in (2.0, 5.0, 10.0):
        controller = control('- m: {type: joint_velocity, joints: turn}\n', robot,
                             Settings(blend=0.0, braking_gain=gain))
        controller.update([2.4, 0.0, 0.0, 0.0], 0.0)
        controller.set_goal('m', [5.0], 0.0)
        velocity = controller.update([2.4, 0.0, 0.0, 0.0], 0.0).velocity
        assert velocity[0] == pytest.approx(gain * 0.1)


def test_joint_outside_its_range_comes_back_in_and_goes_no_further_out():
    robot = robots.mixed()
    controller = control('- j: {type: joint, joints: turn, target: [0.0], gain: 2.0}\n', robot)
    assert controller.update([2.8, 0.0, 0.0, 0.0], 0.0).velocity[0] < -1.0
    controller = control('- m: {type: joint_velocity, joints: turn}\n', robot)
    controller.update([2.8, 0.0, 0.0, 0.0], 0.0)
    controller.set_goal('m', [1.0], 0.0)
    # Whatever is demanded, it returns: at 10 /s times 0.3 rad, but no faster than a fifth of its
    # speed limit.
    assert controller.update([2.8, 0.0, 0.0, 0.0], 0.0).velocity.tolist() == pytest.approx(
        [-0.2 * robot.velocity[0], 0.0, 0.0, 0.0])


@pytest.mark.parametrize('side, index', [(1.0, 0), (-1.0, 0), (1.0, 1), (-1.0, 1)])
@pytest.mark.parametrize('beyond', [0.002, 0.05, 0.3])
def test_joint_outside_its_range_comes_back_at_its_speed_limit_if_a_task_demands_it(side, index,
                                                                                    beyond):
    robot = robots.mixed()
    name, speed = robot.joint_names[index], robot.velocity[index]
    q = np.zeros(4)
    q[index] = (robot.upper if side > 0.0 else robot.lower)[index] + side * beyond
    for demanded, expected in ((2.0 * speed, speed), (0.9 * speed, 0.9 * speed),
                               (0.0, min(10.0 * beyond, 0.2 * speed, 1.0)),
                               (-speed, min(10.0 * beyond, 0.2 * speed, 1.0))):
        controller = control(f'- m: {{type: joint_velocity, joints: {name}}}\n', robot,
                             Settings(blend=0.0, braking_gain=10.0, command_delay=0))
        controller.update(q, 0.0)
        controller.set_goal('m', [-side * demanded], 0.0)
        assert -side * controller.update(q, 0.0).velocity[index] == pytest.approx(
            max(expected, min(10.0 * beyond, 0.2 * speed, 1.0)))


# Reports

def test_report_tells_every_task_with_its_unit_tolerance_and_speed():
    controller = control(POSE_AND_POSTURE)
    controller.update(READY, 0.0)
    state = controller.robot.state(READY)
    controller.set_goal('tool', shifted(state.pose(TOOL), [0.03, 0.0, 0.04], [0.0, 0.0, 0.2]), 0.0)
    tool = report_of(controller, 'tool')
    assert (tool.name, tool.type_name, tool.level) == ('tool', 'pose', 1)
    (way, unit, tolerance), (angle, angle_unit, angle_tolerance) = tool.errors
    assert (unit, tolerance, angle_unit, angle_tolerance) == ('m', 1e-3, 'rad', 5e-3)
    assert (way, angle) == (pytest.approx(0.05), pytest.approx(0.2))
    assert tool.demanded_speed == pytest.approx(2.0 * math.hypot(0.05, 0.2))
    assert tool.achieved_speed == pytest.approx(tool.demanded_speed)
    with pytest.warns(DeprecationWarning, match='demanded_speed'):
        assert tool.wanted_speed == tool.demanded_speed
    assert (tool.reached, tool.status, tool.reason) == (False, 'moving', '')
    posture = report_of(controller, 'posture')
    assert (posture.level, posture.status) == (2, 'reached')


@pytest.mark.parametrize('offset, turn, reached', [
    ([0.9e-3, 0.0, 0.0], [0.0, 4.9e-3, 0.0], True), ([1.1e-3, 0.0, 0.0], [0.0] * 3, False),
    ([0.0] * 3, [0.0, 5.1e-3, 0.0], False), ([0.8e-3, 0.8e-3, 0.0], [0.0] * 3, False)])
def test_task_is_reached_when_every_unit_is_within_its_tolerance(offset, turn, reached):
    controller = control(POSE_AND_POSTURE)
    controller.update(READY, 0.0)
    T = controller.robot.state(READY).pose(TOOL)
    controller.set_goal('tool', shifted(T, offset, turn), 0.0)
    report = controller.update(READY, 0.0).report
    assert report.tasks[0].reached is reached
    assert report.reached is reached


def test_report_of_a_velocity_task_is_in_units_per_second():
    controller = control(f'- t: {{type: twist, frame: {TOOL}}}\n')
    controller.update(READY, 0.0)
    controller.set_goal('t', [0.05, 0, 0, 0, 0, 0.1], 0.0)
    task = report_of(controller, 't')
    assert [unit for _, unit, _ in task.errors] == ['m/s', 'rad/s']
    assert task.reached
    assert task.demanded_speed == pytest.approx(math.hypot(0.05, 0.1))


@pytest.mark.parametrize('scaling', ['uniform', 'redistribute'])
def test_report_says_how_much_a_velocity_limit_slows_a_task_and_which(scaling):
    share = {'uniform': 0.5, 'redistribute': (4.35 * 2.175 + 1.0) / (4.35 ** 2 + 1.0)}[scaling]
    controller = control('- m: {type: joint_velocity}\n',
                         options=replace(EXACT, scaling=scaling))
    controller.update(READY, 0.0)
    controller.set_goal('m', [0.0, 0.0, -4.35, 0.0, 1.0, 0.0, 0.0], 0.0)
    task = report_of(controller, 'm')
    assert task.reason == 'panda_joint3 at its velocity limit' + {
        'uniform': ', which slows all tasks', 'redistribute': ''}[scaling]
    assert task.hint == 'raise the velocity limit of panda_joint3'
    cause, = task.causes
    assert (cause.kind, cause.name) == ('velocity limit', 'panda_joint3')
    assert cause.share == pytest.approx(1.0)
    assert task.status == 'limited'
    report = controller.update(READY, 0.0).report
    assert report.scale == pytest.approx(share)
    assert report.limiting == 'panda_joint3 at its velocity limit'


@pytest.mark.slow
@given(st.floats(1.02, 1e6))
@example(49.0)
def test_velocity_limit_is_named_as_such_whatever_the_rounding(speed):
    controller = control('- m: {type: joint_velocity, joints: joint1}\n', robots.planar())
    controller.update([0.0] * 3, 0.0)
    controller.set_goal('m', [-speed], 0.0)
    command = controller.update([0.0] * 3, 0.0)
    assert command.velocity[0] == -1.0
    assert command.report.limiting == 'joint1 at its velocity limit'


@pytest.mark.parametrize('position, demand, side', [
    (2.5, 1.0, 'upper'), (2.45, 1.0, 'upper'), (-2.0, -1.0, 'lower'), (-1.95, -1.0, 'lower'),
    (2.6, 1.0, 'upper')])
def test_report_names_the_position_limit_that_stops_a_joint(position, demand, side):
    controller = control('- m: {type: joint_velocity, joints: turn}\n', robots.mixed())
    q = [position, 0.0, 0.0, 0.0]
    controller.update(q, 0.0)
    controller.set_goal('m', [demand], 0.0)
    report = controller.update(q, 0.0).report
    assert report.tasks[0].reason == f'turn at its {side} position limit'
    assert report.tasks[0].status == 'limited'


def test_report_names_the_task_above_that_blocks_a_task():
    controller = control(
        '- a: {type: joint, joints: panda_joint1}\n'
        '- b: {type: joint, joints: [panda_joint1, panda_joint2], target: [0.5, 0.1]}\n')
    task = report_of(controller, 'b')
    assert task.reason == 'blocked by a'
    assert task.hint == ('exchange a and b in the stack (a then misses its goal), or choose goals '
                         'that are compatible')
    assert task.achieved_speed < task.demanded_speed


def test_report_says_that_the_robot_cannot_move_that_way():
    # A planar arm cannot leave its plane.
    controller = control('- tool: {type: position, frame: link3}\n', robots.planar())
    controller.update(robots.PLANAR_START, 0.0)
    goal = controller.robot.state(robots.PLANAR_START).position('link3') + [0.0, 0.0, 0.1]
    controller.set_goal('tool', goal, 0.0)
    task = controller.update(robots.PLANAR_START, 0.0).report.tasks[0]
    assert task.reason == 'out of reach by 0.1 m'
    assert task.hint == 'the goal is out of reach: choose another one'
    assert [(cause.kind, cause.name) for cause in task.causes] == [('impossible', '')]
    assert task.causes[0].share == pytest.approx(1.0)
    assert task.achieved_speed == pytest.approx(0.0, abs=1e-12)


def test_report_says_that_higher_levels_are_nearly_in_the_way():
    # Links 2 and 3 lie along x, nearly: only joint 1 moves the tool that way, and has no say
    # left in anything else. Alone each of the tasks is far from singular.
    controller = control(
        '- tool: {type: position, frame: link3, axes: x}\n'
        '- base: {type: joint, joints: joint1, target: [1.5]}\n', robots.planar(),
        Settings(reserve=0.0))
    task = controller.update([1.2, -1.18, 0.0], 0.0).report.tasks[1]
    assert task.reason == 'blocked by tool'
    assert [cause.kind for cause in task.causes] == ['task', 'damping']


def test_report_says_that_a_singularity_is_near():
    controller = control('- tool: {type: position, frame: link3, axes: xy}\n', robots.planar(),
                         Settings(blend=0.0, damping=0.1, singular_region=0.1))
    q = [0.3, 0.02, 0.02]
    controller.update(q, 0.0)
    controller.set_goal('tool', [0.2, 0.1, 0.0], 0.0)
    task = controller.update(q, 0.0).report.tasks[0]
    assert task.reason == 'near a singularity'
    assert [cause.kind for cause in task.causes] == ['singularity', 'velocity limit']


def test_report_says_that_damping_costs_speed_elsewhere():
    controller = control('- tool: {type: position, frame: link3, axes: xy}\n', robots.planar(),
                         Settings(blend=0.0, damping=0.3, singular_region=math.inf))
    q = [0.0, 1.2, 0.8]
    controller.update(q, 0.0)
    state = controller.robot.state(q)
    controller.set_goal('tool', state.position('link3') + [0.1, 0.1, 0.0], 0.0)
    task = controller.update(q, 0.0).report.tasks[0]
    assert task.reason == 'slowed by damping'
    assert task.achieved_speed < task.demanded_speed


def test_report_stays_what_it_was_when_the_robot_goes_on():
    controller = control(POSE_AND_POSTURE)
    controller.update(READY, 0.0)
    T = controller.robot.state(READY).pose(TOOL)
    controller.set_goal('tool', shifted(T, [0.1, 0.0, 0.0]), 0.0)
    report = controller.update(READY, 0.0).report
    controller.update(READY + 0.1, 0.1)
    controller.enable('tool', False)
    assert report.tasks[0].errors[0][0] == pytest.approx(0.1)
    assert report.tasks[0].demanded_speed == pytest.approx(0.2)
    assert [task.name for task in report.tasks] == ['tool', 'posture']


def test_task_is_evaluated_once_unless_something_changes_and_the_report_does_without(monkeypatch):
    asked = []
    for kind in (Pose, JointLimits, Joint):
        def counted(self, state, now, evaluate=kind.make_evaluation):
            asked.append(self.name)
            return evaluate(self, state, now)
        monkeypatch.setattr(kind, 'make_evaluation', counted)
        # The core does not count.
        monkeypatch.setattr(kind, 'make_twin', lambda self: None)
    controller = control('- limits: {type: joint_limits}\n' + POSE_AND_POSTURE, options=None)
    T = controller.robot.state(READY).pose(TOOL)
    for cycle in range(60):
        del asked[:]
        controller.set_goal('tool', shifted(T, [1e-3 * cycle, 0.0, 0.0]), 0.01 * cycle)
        if cycle == 30:
            controller.replace_stack(Stack.from_yaml(
                '- limits: {type: joint_limits}\n' + POSE_AND_POSTURE.replace('0.5', '0.7'),
                controller.robot))
        report = controller.update(READY, 0.01 * cycle).report
        assert len(report.tasks) == 3 and report.limiting == ''
        # After a change also where the robot was before it.
        assert asked == ['limits', 'tool', 'posture'] * (2 if cycle == 30 else 1)


def test_what_is_not_read_of_a_report_is_not_computed(monkeypatch):
    measured = []

    def counted(self, error, residual, reported=Pose.reported_errors):
        measured.append(self.name)
        return reported(self, error, residual)

    monkeypatch.setattr(Pose, 'reported_errors', counted)
    controller = control(POSE_AND_POSTURE)
    tool, _ = controller.update(READY, 0.0).report.tasks
    assert (tool.name, tool.level) == ('tool', 1) and not measured
    assert tool.reached and tool.status == 'reached' and tool.errors[0][0] == 0.0
    assert measured == ['tool']


@pytest.mark.parametrize('text, goal', [
    ('- tool: {type: pose, frame: panda_hand_tcp}\n', [2.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]),
    ('- tool: {type: position, frame: panda_hand_tcp}\n', [2.0, 0.0, 0.3])])
def test_goal_that_no_motion_reaches_is_said_at_once(text, goal):
    controller = control(text)
    controller.update(READY, 0.0)
    remark, = controller.set_goal('tool', goal, 0.0)
    task, = controller.update(READY, 0.01).report.tasks
    assert remark in task.reason and task.status == 'limited'
    assert task.hint == 'the goal is out of reach: choose another one'
    controller.set_goal('tool', [0.5, *goal[1:]], 0.02)
    assert controller.update(READY, 0.02).report.tasks[0].status == 'moving'


def test_type_that_fails_to_tell_its_reach_is_reported_all_the_same(monkeypatch):
    monkeypatch.setattr(Pose, 'out_of_reach', lambda self, goal: 1 / 0)
    controller = control(POSE_AND_POSTURE)
    controller.update(READY, 0.0)
    tool = controller.stack.tasks['tool']
    tool.goal = shifted(tool.goal, [0.1, 0.0, 0.0])
    assert controller.update(READY, 0.01).report.tasks[0].status == 'moving'


def test_tasks_that_share_a_level_are_reported_one_by_one():
    controller = control('- [a: {type: joint, joints: panda_joint1, target: [0.3]},\n'
                         '   b: {type: joint, joints: panda_joint7, target: [0.285], gain: 4}]\n')
    a, b = controller.update(READY, 0.0).report.tasks
    assert (a.level, b.level) == (1, 1)
    assert (a.demanded_speed, b.demanded_speed) == (pytest.approx(0.3), pytest.approx(2.0))
    assert (a.errors[0][0], b.errors[0][0]) == (pytest.approx(0.3), pytest.approx(0.5))


# Enabling, replacing, restarting

def test_disabled_task_has_no_say_and_comes_back_with_its_goal():
    controller = control('- a: {type: joint, joints: panda_joint1, target: [0.5]}\n'
                         '- b: {type: joint, joints: panda_joint2, target: [0.0]}\n')
    both = controller.update(READY, 0.0).velocity
    controller.enable('a', False)
    command = controller.update(READY, 0.0)
    assert command.velocity[0] == 0.0 and command.velocity[1] == both[1]
    assert [(task.name, task.level, task.status) for task in command.report.tasks] == [
        ('b', 1, 'moving'), ('a', None, 'disabled')]
    assert not command.report.reached
    controller.enable('a', True)
    assert controller.update(READY, 0.0).velocity.tolist() == both.tolist()
    with pytest.raises(GoalError, match="unknown task 'c'; valid: a, b"):
        controller.enable('c', True)


def test_stack_can_be_replaced_between_two_cycles():
    robot = robots.panda()
    controller = control(POSE_AND_POSTURE, robot)
    controller.update(READY, 0.0)
    controller.set_goal('posture', {'panda_joint1': 0.5}, 0.0)
    controller.replace_stack(Stack.from_yaml('- posture: {type: posture, gain: 2.0}\n'
                                             '- new: {type: pose, frame: panda_link7}\n', robot))
    command = controller.update(READY + 0.01, 0.1)
    assert command.velocity == pytest.approx(2.0 * (np.where(np.arange(7) == 0, 0.5, READY)
                                                    - READY - 0.01))
    assert command.report.tasks[1].errors[0][0] == pytest.approx(0.0, abs=1e-12)


SWING = '- swing: {type: joint, joints: panda_joint1, gain: %g}\n'
UNSTABLE = ('gain %g of task swing must be at most 2/period = %g, or its error would grow from '
            'cycle to cycle')


def test_gain_beyond_what_the_period_allows_is_refused():
    robot = robots.panda()
    stack = Stack.from_yaml(SWING % 201, robot)
    with pytest.raises(SettingsError, match=UNSTABLE % (201, 200)):
        Controller(robot, stack)
    controller = control(SWING % 200, robot)
    with pytest.raises(SettingsError, match=UNSTABLE % (201, 200)):
        controller.replace_stack(stack)
    with pytest.raises(SettingsError, match=UNSTABLE % (5e5, 200)):
        controller.set_gain('swing', 5e5)
    with pytest.raises(SettingsError, match=UNSTABLE % (200, 100)):
        controller.settings = Settings(period=0.02)
    assert controller.stack.tasks['swing'].gain == 200.0
    # The gain of an objective has nothing to do with the period.
    controller.replace_stack(Stack.from_yaml('- far: {type: joint_limit_distance, gain: 300}',
                                             robot))


@pytest.mark.parametrize('gain, late', [(60.0, 3), (150.0, 0)])
def test_hint_for_a_gain_with_which_a_task_overshoots_lowers_it(gain, late):
    """The arm chatters at its acceleration limit, and a higher one would make it worse."""
    robot = Robot.from_file(robots.PANDA_DH, limits={'panda_joint1': {'acceleration': 5.0}})
    controller = Controller(robot, Stack.from_yaml(SWING % gain, robot), Settings(blend=0.0))
    q, hints, sent = np.array(READY), [], deque([np.zeros(7)] * late)
    controller.update(q, 0.0)
    controller.set_goal('swing', [READY[0] + 0.05], 0.0)
    for cycle in range(1, 60):
        command = controller.update(q, 0.01 * cycle)
        hints.append(command.report.tasks[0].hint)
        sent.append(command.velocity)
        q = q + 0.01 * sent.popleft()
    # Nothing is known of an overshoot before the first.
    assert hints[0].startswith('wait')
    assert any(hint.startswith('a gain of at most 25/s does not overshoot') for hint in hints)
    assert controller.gain_warning('swing').startswith(
        f'gain {gain:g}/s at 100 Hz: after one cycle {1.0 - gain / 100.0:.2g} of the error')
    controller.set_gain('swing', 49.0)
    assert controller.gain_warning('swing') == ''


def test_controllers_of_copies_know_nothing_of_each_other():
    robot = robots.panda()
    stack = Stack.from_yaml(POSE_AND_POSTURE, robot)
    stack.enable('tool', False)
    one, other = Controller(robot, stack.copy()), Controller(robot, stack.copy())
    assert one.stack.disabled == {'tool'} and one.stack.text == stack.text
    for cycle in range(3):
        one.set_goal('posture', {'panda_joint1': 0.5}, 0.01 * cycle)
        one.set_gain('posture', 3.0)
        one.update(READY, 0.01 * cycle)
    assert not other.update(READY, 0.02).velocity.any()
    assert other.stack.tasks['posture'].gain == 0.5
    # Arrays of copies are not shared.
    third = stack.copy()
    third.start(robot.state(READY))
    fourth = third.copy()
    fourth.tasks['posture'].set_goal(READY + 1.0, 0.0)
    fourth.tasks['posture'].forget_goal()
    third.reset()
    third.start(robot.state(READY + 0.1))
    assert third.tasks['posture'].goal == pytest.approx(READY + 0.1)


def test_stack_that_a_controller_has_used_is_refused():
    first = control(POSE_AND_POSTURE)
    robot, used = first.robot, first.stack
    first.update(READY, 0.0)
    message = 'a controller has used tool, posture already, and goals of then would stay'
    with pytest.raises(StackError, match=message):
        Controller(robot, used)
    with pytest.raises(StackError, match=message):
        used.copy()
    with pytest.raises(StackError, match='has used posture already'):
        Controller(robot, Stack([[used.tasks['posture']]]))
    second = control('- posture: {type: posture, gain: 0.3}\n', robot)
    own = second.stack
    with pytest.raises(StackError, match=message):
        second.replace_stack(used)
    assert second.stack is own
    # A stack in force, or a part of it, is no other one.
    first.replace_stack(used)
    first.replace_stack(Stack([[used.tasks['posture']]]))
    first.update(READY, 0.01)
    with pytest.raises(StackError, match='has used tool already'):
        first.replace_stack(used)


def test_stack_that_comes_back_has_the_newer_goal():
    robot = robots.panda()
    one, other = (Stack.from_yaml(f'- a: {{type: joint, joints: panda_joint1, gain: {gain}}}\n',
                                  robot) for gain in (1.0, 2.0))
    controller = Controller(robot, one.copy(), Settings(blend=0.0))
    controller.update(READY, 0.0)
    for cycle, stack in enumerate((other, one, other), 1):
        controller.set_goal('a', [0.1 * cycle], 0.01 * cycle)
        controller.replace_stack(stack.copy())
        velocity = controller.update(READY, 0.01 * cycle).velocity
        assert velocity[0] == pytest.approx(controller.stack.tasks['a'].gain * 0.1 * cycle)


@pytest.mark.parametrize('make, told', [
    (lambda robot, stack: Stack([{'tool': {'type': 'posture'}}]), 'YAML by Stack.from_yaml'),
    (lambda robot, stack: Stack('stack.yaml'), "by Stack.from_yaml.*got 'stack.yaml'"),
    (lambda robot, stack: Stack(list(stack.tasks.values())), r'such as \[\[tool\], \[posture\]\]'),
    (lambda robot, stack: Stack(None), 'got None'),
    (lambda robot, stack: Settings(rate=-3), "unknown setting 'rate'; valid: period, damping"),
    (lambda robot, stack: Settings(brakinggain=1), "did you mean 'braking_gain'"),
    (lambda robot, stack: Controller(stack, robot), 'needs a Robot first.*got Stack'),
    (lambda robot, stack: solve_position(stack, robot), 'needs a Robot first.*got Stack'),
    (lambda robot, stack: KinematicSimulator(stack), 'needs a Robot first.*got Stack'),
    (lambda robot, stack: Robot.from_urdf(robot.urdf, limits=[1.0]), 'limits need a mapping'),
    (lambda robot, stack: Controller(robot, stack).set_velocity_limits([1.0] * 7),
     'velocity limits need a mapping'),
    (lambda robot, stack: robot.integrate(READY, [0.0] * 6, 0.1), r'q \(7,\).*\(7,\) and \(6,\)'),
    (lambda robot, stack: robot.integrate(READY[:6], [0.0] * 7, 0.1), r'\(6,\) and \(7,\)'),
    (lambda robot, stack: KinematicSimulator(robot).step(-0.1), 'not negative.*got -0.1'),
    (lambda robot, stack: KinematicSimulator(robot).step('0.1'), "not negative.*got '0.1'"),
    (lambda robot, stack: KinematicSimulator(robot).step(math.inf), 'finite.*got inf'),
    (lambda robot, stack: solve((np.eye(7), np.zeros(7))), r'level 1: .*\(7, 7\).*\[\(J, v\)\]'),
    (lambda robot, stack: solve([np.eye(7)]), r'level 1: needs Level or \(J, v\)'),
    (lambda robot, stack: solve([Level(np.eye(7), np.zeros(7), mode=np.ones(3))]),
     'level 1: unknown mode'),
    (lambda robot, stack: Controller(robot, POSE_AND_POSTURE), 'needs a Stack.*got str'),
    (lambda robot, stack: Controller(robot, stack, {'period': 1}), 'made by Settings'),
    (lambda robot, stack: Controller(robot, stack).replace_stack('x'), 'needs a Stack.*got str'),
    (lambda robot, stack: Controller(robot, stack).update(READY), 'time of any clock.*got None'),
    (lambda robot, stack: Controller(robot, stack).halt(), 'now must be'),
    (lambda robot, stack: Controller(robot, stack).set_goal('posture', READY), 'now must be'),
    (lambda robot, stack: Controller(robot, stack).set_feed_forward('posture', READY),
     'now must be')])
def test_what_is_something_else_is_refused_with_what_is_valid(make, told):
    robot = robots.panda()
    with pytest.raises(TpControllerError, match=told):
        make(robot, Stack.from_yaml(POSE_AND_POSTURE, robot))


def test_controller_that_refuses_its_settings_leaves_the_stack_unused():
    stack = Stack.from_yaml('- limits: {type: joint_limits, gain: 60}\n', robots.panda())
    with pytest.raises(SettingsError):
        Controller(robots.panda(), stack, Settings(period=0.02))
    Controller(robots.panda(), stack, Settings(period=0.01))


def test_restart_holds_where_the_robot_is_found_but_keeps_goals_that_were_given():
    controller = control('- a: {type: joint, joints: panda_joint1}\n'
                         '- b: {type: joint, joints: panda_joint2, target: [0.0]}\n')
    controller.update(READY, 0.0)
    controller.restart()
    velocity = controller.update(READY + 0.2, 1.0).velocity
    assert velocity[0] == 0.0
    assert velocity[1] == pytest.approx(0.785 - 0.2)


def test_goals_given_in_the_root_are_there_whatever_the_reference():
    robot = robots.panda()
    controller = control(f'- p: {{type: position, frame: {TOOL}, reference: panda_link3}}\n'
                         '- j: {type: posture}\n'
                         f'- o: {{type: orientation, frame: {TOOL}}}\n'
                         f'- w: {{type: pose, frame: {TOOL}}}\n', robot)
    controller.update(READY, 0.0)
    state = robot.state(READY)
    T = state.pose(TOOL)
    for kind, offset, turn in (('p', [0.1, 0.0, 0.0], [0.0] * 3), ('o', [0.0] * 3, [0.3, 0, 0]),
                               ('w', [0.0, 0.1, 0.0], [0.0, 0.2, 0.0])):
        goal = shifted(T, offset, turn)
        whole = {'p': goal[:3, 3], 'o': goal[:3, :3], 'w': goal}[kind]
        controller.set_goal(kind, whole, 0.0, 'panda_link0')
        task = controller.stack.tasks[kind]
        found = state.pose(task.reference) @ task.goal_pose(state)
        np.testing.assert_allclose(found, goal, atol=1e-9)


# Settings

def test_all_settings_out_of_range_are_told_at_once():
    with pytest.raises(SettingsError) as caught:
        Settings(blend=0.0, period=0.0, damping=-1.0, singular_region=math.nan, braking_gain='x',
                 scaling='clip', weights=[1.0, -1.0])
    faults = caught.value.faults
    assert [fault.split()[0] for fault in faults] == [
        'period', 'damping', 'singular_region', 'braking_gain', 'scaling', 'weights']
    assert 'must be a number from 1e-05 to 1, not 0.0' in faults[0]
    assert 'must be one of redistribute, uniform, not' in faults[4]


@pytest.mark.parametrize('delay', [1.0, 1.5, -1, 101, True, '2', None, math.nan])
def test_delay_that_is_no_number_of_cycles_is_refused(delay):
    with pytest.raises(SettingsError,
                       match='command_delay must be a whole number from 0 to 100, not'):
        Settings(command_delay=delay)


def test_braking_that_the_period_cannot_keep_up_with_is_refused():
    Settings(blend=0.0, period=0.05, braking_gain=20.0)
    with pytest.raises(SettingsError, match='braking_gain 21 must be at most 1/period = 20'):
        Settings(blend=0.0, period=0.05, braking_gain=21.0)


def test_defaults_are_in_range_and_every_setting_is_described():
    for name, item in Settings.__dataclass_fields__.items():
        assert item.metadata['description'], name
        assert 'unit' in item.metadata
    assert Settings().damping > 0.0


@pytest.mark.parametrize('weights', ['heavy', [1.0, 0.0], [1.0, math.inf], [1.0, 'x'], 5.0])
def test_weights_that_are_not_positive_are_refused(weights):
    with pytest.raises(SettingsError, match='weights must be positive numbers'):
        Settings(blend=0.0, weights=weights)


@pytest.mark.parametrize('weights', [[1e-300, 1e9], (1.1e12, 1)])
def test_weights_too_far_apart_are_refused(weights):
    with pytest.raises(SettingsError, match='weights must be within a factor of 1e'):
        Settings(blend=0.0, weights=weights)


def test_weights_must_fit_the_robot_and_the_settings_before_stay():
    controller = control(POSE_AND_POSTURE)
    before = controller.settings
    with pytest.raises(SettingsError, match='weights needs 7 numbers.*panda_joint1.*got 2'):
        controller.settings = Settings(blend=0.0, weights=(1.0, 2.0))
    assert controller.settings is before
    controller.update(READY, 0.0)
    with pytest.raises(SettingsError, match='weights needs 7'):
        control(POSE_AND_POSTURE, options=Settings(blend=0.0, weights=(1.0,)))


def test_settings_that_are_replaced_act_in_the_next_cycle():
    robot = robots.panda()
    controller = control(f'- tool: {{type: position, frame: {TOOL}}}\n', robot)
    controller.update(READY, 0.0)
    state = robot.state(READY)
    J, v = state.jacobian(TOOL)[:3], np.array([0.03, 0.04, 0.02])
    controller.set_goal('tool', state.position(TOOL) + v, 0.0)
    np.testing.assert_allclose(controller.update(READY, 0.0).velocity, np.linalg.pinv(J) @ v,
                               atol=1e-9)
    controller.settings = replace(EXACT, weights=(9.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0))
    W_inverse = np.diag([1.0 / 9.0, 1, 0.5, 1, 1, 1, 1])
    np.testing.assert_allclose(controller.update(READY, 0.0).velocity,
                               W_inverse @ J.T @ np.linalg.solve(J @ W_inverse @ J.T, v),
                               atol=1e-9)
    controller.settings = Settings(blend=0.0, damping=0.5, singular_region=math.inf)
    np.testing.assert_allclose(controller.update(READY, 0.0).velocity,
                               J.T @ np.linalg.solve(J @ J.T + 0.25 * np.eye(3), v), atol=1e-9)
    controller.settings = Settings(blend=0.0, damping=0.0, weights=())
    np.testing.assert_allclose(controller.update(READY, 0.0).velocity, np.linalg.pinv(J) @ v,
                               atol=1e-9)


# Found by trying to break it


# Gains and tolerances of tasks -------------------------------------------------------------

GAINS = """
- inside: {type: joint_limits}
- tip: {type: position, frame: link3, axes: xy, tolerance: 0.1}
- both: {type: pose, frame: link3, axes: [x, rz]}
- drift: {type: joint_velocity}
"""


@pytest.mark.parametrize('gain', [3.0, [2.0, 5.0]])
def test_gain_that_is_set_acts_in_the_next_cycle_as_that_of_another_stack(gain):
    planar = robots.planar()
    text = '- swing: {type: joint, joints: [joint1, joint2], target: [1.0, 0.5], gain: %s}'
    settings = Settings(blend=0.0)
    first, second = (Controller(planar, Stack.from_yaml(text % value, planar), settings)
                     for value in (1.0, gain))
    for controller in (first, second):
        controller.update(robots.PLANAR_START, 0.0)
    first.set_gain('swing', gain)
    velocities = [controller.update(robots.PLANAR_START, 0.01).velocity
                  for controller in (first, second)]
    assert np.any(velocities[0])
    np.testing.assert_allclose(*velocities, atol=1e-12)
    # The stack that YAML gives has the gain of the other one: nothing is left to be blended.
    announced = []
    first._changes.announce = announced.append
    first.replace_stack(Stack.from_yaml(text % gain, planar))
    assert not announced


def test_gain_that_is_set_again_is_no_change():
    controller = Controller(robots.planar(), Stack.from_yaml(GAINS, robots.planar()))
    announced = []
    controller._changes.announce = announced.append
    for gain in (2.0, 2.0, [2.0, 3.0], [2.0, 3.0]):
        controller.set_gain('tip', gain)
        controller.set_gain('tip', controller.stack.tasks['tip'].gain)
    assert announced == [1, 1]
    # Whether a goal counts as reached moves nothing; nor does a task that is left out.
    controller.set_tolerance('tip', 0.5)
    controller.enable('tip', False)
    announced.clear()
    controller.set_gain('tip', 4.0)
    assert announced == []


@pytest.mark.parametrize('name, gain, told', [
    ('tip', 0.0, 'gain of task tip must be positive, got 0'),
    ('tip', [1.0, 2.0, 3.0], 'gain of task tip needs one number, or one for each of the 2 rows'),
    ('tip', float('nan'), 'gain of task tip needs a number of at most'),
    ('inside', 200.0, 'gain 200 of task inside must be at most 1/period = 100, or its bounds'),
    ('drift', 1.0, 'task drift of the type joint_velocity has no gain'),
    ('nobody', 1.0, "unknown task 'nobody'"),
])
def test_gain_that_is_refused_leaves_the_one_in_force(name, gain, told):
    controller = Controller(robots.planar(), Stack.from_yaml(GAINS, robots.planar()))
    before = [task.gain for task in controller.stack.tasks.values() if hasattr(task, 'gain')]
    with pytest.raises((SettingsError, GoalError)) as error:
        controller.set_gain(name, gain)
    assert told in str(error.value)
    assert before == [task.gain for task in controller.stack.tasks.values()
                      if hasattr(task, 'gain')]


def tolerances(controller, name):
    """Return {unit: tolerance} as the report says."""
    report = controller.update(robots.PLANAR_START, 0.0).report
    task, = (task for task in report.tasks if task.name == name)
    return {unit: tolerance for _, unit, tolerance in task.errors}


def test_tolerance_can_be_set_for_one_unit_or_all():
    controller = Controller(robots.planar(), Stack.from_yaml(GAINS, robots.planar()))
    controller.set_tolerance('both', 0.5)
    assert tolerances(controller, 'both') == {'m': 0.5, 'rad': 0.5}
    controller.set_tolerance('both', {'rad': 0.25})
    assert tolerances(controller, 'both') == {'m': 0.5, 'rad': 0.25}
    controller.set_tolerance('tip', {'m': 0.25})
    assert tolerances(controller, 'tip') == {'m': 0.25}


@pytest.mark.parametrize('tolerance, told', [
    (0.0, 'tolerance of task both must be positive, got 0'),
    ({'km': 1.0}, "tolerance of task both unknown unit 'km'; valid: m, rad, 1"),
    ('wide', "tolerance of task both needs a number of at most 1e+06, got 'wide'")])
def test_tolerance_that_is_refused_leaves_the_one_in_force(tolerance, told):
    controller = Controller(robots.planar(), Stack.from_yaml(GAINS, robots.planar()))
    before = tolerances(controller, 'both')
    with pytest.raises(SettingsError) as error:
        controller.set_tolerance('both', tolerance)
    assert str(error.value) == told and tolerances(controller, 'both') == before


def test_rounding_towards_a_limit_does_not_stop_the_robot():
    robot = robots.panda()
    # The tool lies on the axis of joint 7, which the task therefore moves by rounding only; the
    # joint stands at its limit, or is measured a little beyond it.
    for beyond in (0.0, 1e-5):
        controller = control(f'- tool: {{type: position, frame: {TOOL}, gain: 2}}\n', robot)
        q = READY.copy()
        q[6] = robot.upper[6] + beyond
        for seed in range(10):
            start = q + np.r_[np.random.default_rng(seed).uniform(-0.3, 0.3, 6), 0.0]
            place = robot.state(start).position(TOOL)
            controller.set_goal('tool', place + [0.02, -0.03, 0.01], 0.0)
            assert controller.update(start, 0.0).report.scale > 0.5


@pytest.mark.parametrize('kind', ['position', 'orientation', 'pose', 'joint', 'posture'])
def test_robot_with_one_joint_is_controlled_like_any_other(kind):
    robot = Robot.from_dh([{'name': 'only', 'a': 0.5, 'velocity': 1.0}])
    where = {'joint': ', joints: only', 'posture': ''}.get(kind, ', frame: link1')
    controller = control(f'- task: {{type: {kind}{where}}}\n', robot)
    controller.update([0.3], 0.0)
    state = robot.state([0.5])
    goal = {'position': state.position('link1'), 'orientation': state.rotation('link1'),
            'pose': state.pose('link1')}.get(kind, [0.5])
    controller.set_goal('task', goal, 0.0)
    assert controller.update([0.3], 0.0).velocity[0] > 0.15
    q = run(controller, [0.3], 800)[-1]
    assert q == pytest.approx([0.5], abs=1e-3)


def test_default_goal_is_not_inherited_by_a_task_about_another_frame():
    robot = robots.panda()
    controller = control(f'- tool: {{type: position, frame: {TOOL}}}\n', robot)
    controller.update(READY, 0.0)
    controller.replace_stack(Stack.from_yaml('- tool: {type: position, frame: panda_link4}\n',
                                             robot))
    assert controller.update(READY, 0.1).velocity == pytest.approx(np.zeros(7), abs=1e-12)


def test_default_goal_of_a_posture_is_still_a_default_in_the_next_stack():
    robot = robots.panda()
    controller = control('- posture: {type: posture}\n', robot)
    controller.update(READY, 0.0)
    controller.replace_stack(Stack.from_yaml('- posture: {type: posture, gain: 2}\n', robot))
    assert controller.update(READY + 0.1, 0.1).velocity == pytest.approx(np.full(7, -0.2))
    controller.restart()
    assert controller.update(READY + 0.1, 0.2).velocity == pytest.approx(np.zeros(7), abs=1e-12)


def test_task_that_is_enabled_again_keeps_its_current_value_unless_it_has_a_goal():
    controller = control('- a: {type: joint, joints: panda_joint1}\n'
                         '- b: {type: joint, joints: panda_joint2, target: [-0.7]}\n')
    controller.update(READY, 0.0)
    for name in 'ab':
        controller.enable(name, False)
    for name in 'ab':
        controller.enable(name, True)
    velocity = controller.update(READY + 0.1, 0.1).velocity
    assert velocity[0] == pytest.approx(0.0, abs=1e-12)
    assert velocity[1] == pytest.approx(-0.7 - READY[1] - 0.1)


def test_reason_of_a_task_alone_never_speaks_of_higher_levels():
    robot = Robot.from_file(robots.PLANAR_DH)
    controller = control('- tip: {type: position, frame: link3, axes: xy}\n', robot,
                         options=Settings(blend=0.0))
    stretched = np.array([0.0, 1e-3, 0.0])
    controller.update(stretched, 0.0)
    tip = robot.state(stretched).position('link3')
    controller.set_goal('tip', tip - [0.002, 0.0, 0.0], 0.0)
    task, = controller.update(stretched, 0.0).report.tasks
    assert task.achieved_speed < 0.1 * task.demanded_speed
    assert 'near a singularity' in task.reason


def test_speed_limit_of_zero_is_named_and_slows_no_other_joint():
    robot = Robot.from_file(robots.PANDA_DH, limits={'panda_joint3': {'velocity': 0.0}})
    controller = control('- j: {type: joint, joints: [panda_joint1, panda_joint3]}\n', robot)
    controller.update(READY, 0.0)
    controller.set_goal('j', [0.5, 0.5], 0.0)
    command = controller.update(READY, 0.0)
    # The other joint does its part.
    assert command.velocity.tolist() == pytest.approx([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert command.report.limiting == ''
    assert command.report.tasks[0].reason == 'panda_joint3 at its velocity limit'


def test_continuous_joint_that_is_given_limits_stays_within_them_on_the_long_way():
    robot = Robot.from_dh([{'name': 'turn', 'type': 'continuous', 'a': 0.3, 'velocity': 2.0}],
                          limits={'turn': {'lower': -3.0, 'upper': 3.0}})
    controller = control('- j: {type: joint, joints: turn, target: [2.9]}\n', robot)
    assert run(controller, [-2.9], 1200)[-1] == pytest.approx([2.9], abs=1e-2)


@pytest.mark.parametrize('frame', [np.eye(3), np.full((4, 4), math.nan), 5, np.diag([1, 1, 1, 5]),
                                   np.diag([1.0, 1.0, -1.0, 1.0])])
def test_frame_that_is_no_pose_is_refused_and_the_goal_stays(frame):
    controller = control(f'- tool: {{type: pose, frame: {TOOL}}}\n')
    before = controller.update(READY, 0.0).velocity
    with pytest.raises(GoalError, match='frame of a goal'):
        controller.set_goal('tool', np.eye(4), 0.0, frame=frame)
    assert controller.update(READY, 0.1).velocity == pytest.approx(before)


def test_first_cycle_makes_no_state_as_that_takes_too_long(monkeypatch):
    robot = robots.planar()
    controller = Controller(robot, Stack.from_yaml('- rest: {type: posture}', robot))
    monkeypatch.delattr(Robot, 'state')
    with pytest.raises(RobotError):
        controller.update([math.nan] * 3, 0.0)
    controller.update([0.1, 0.2, 0.3], 0.0)
    assert controller.stack.tasks['rest'].goal.tolist() == [0.1, 0.2, 0.3]

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Situations that made other controllers stop, shake or break a limit.

Each names where it was reported, and runs in a closed loop with a robot that does as it is told.
"""

import numpy as np
import pytest
import robots
from tp_controller import Controller, Level, Robot, Settings, Stack
from tp_controller.solver.solve import solve_cycle

PERIOD = 0.01
TOOL = robots.PANDA_TOOL
READY = np.array(robots.PANDA_READY)
POSE_AND_POSTURE = ('- tool: {type: pose, frame: panda_hand_tcp, gain: 2.0}\n'
                    '- posture: {type: posture, gain: 0.5}\n')
POSITION_AND_POSTURE = ('- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
                        '- posture: {type: posture, gain: 0.5}\n')


class Loop:
    """A controller and a robot that does exactly what it is told."""

    def __init__(self, robot, text, q, settings=None):
        self.robot = robot
        self.settings = settings or Settings(period=PERIOD)
        self.controller = Controller(robot, Stack.from_yaml(text, robot), self.settings)
        self.q, self.now = np.array(q, float), 0.0
        self.positions, self.velocities = [self.q], []
        self.step()

    def step(self):
        """Run one cycle."""
        self.command = self.controller.update(self.q, self.now)
        self.q = self.q + self.settings.period * self.command.velocity
        self.now += self.settings.period
        self.positions.append(self.q)
        self.velocities.append(self.command.velocity)

    def run(self, seconds, each=None):
        """Run for a time; `each` is called after every cycle."""
        for _ in range(round(seconds / self.settings.period)):
            self.step()
            if each is not None:
                each()

    def task(self, name):
        """Return the report of a task."""
        return next(task for task in self.command.report.tasks if task.name == name)

    def seconds_until_reached(self, name, most):
        """Return how long it takes until a task is at its goal."""
        began = self.now
        while self.now < began + most:
            self.step()
            if self.task(name).reached:
                return self.now - began
        return np.inf

    def check_limits(self, acceleration=np.inf):
        """Check everything that was commanded."""
        v, q = np.array(self.velocities), np.array(self.positions)
        assert (np.abs(v) <= self.robot.velocity).all()
        assert (q >= np.minimum(self.robot.lower, q[0]) - 1e-12).all()
        assert (q <= np.maximum(self.robot.upper, q[0]) + 1e-12).all()
        changes = np.abs(np.diff(v, axis=0)) / self.settings.period
        assert changes.max() <= acceleration * (1.0 + 1e-9)


def limited_panda(acceleration):
    """Return a Panda with the same acceleration limit for all joints, or without one."""
    limits = None if acceleration is None else {
        name: {'acceleration': acceleration} for name in robots.panda().joint_names}
    return Robot.from_file(robots.PANDA_DH, limits=limits)


# pink, issue 206: a robot that starts outside its position limits

@pytest.mark.parametrize('acceleration', [None, 10.0])
@pytest.mark.parametrize('outside', [1e-4, 0.02, 0.3])
def test_a_start_outside_the_position_limits_leads_back_inside_while_the_task_goes_on(
        outside, acceleration):
    robot = limited_panda(acceleration)
    q = READY.copy()
    q[0] = robot.upper[0] + outside
    q[4] = robot.lower[4] - outside
    loop = Loop(robot, POSITION_AND_POSTURE, q)
    goal = robot.state(0.8 * np.clip(q, robot.lower, robot.upper)).position(TOOL)
    loop.controller.set_goal('tool', goal, loop.now)
    loop.run(8.0)
    loop.check_limits(acceleration or np.inf)
    assert (loop.q >= robot.lower - 1e-9).all() and (loop.q <= robot.upper + 1e-9).all()
    assert loop.task('tool').reached
    # On the way back it is never faster than that.
    q, v = np.array(loop.positions[:-1]), np.array(loop.velocities)
    back = np.where(q > robot.upper, -v, np.where(q < robot.lower, v, 0.0))
    assert back.min() >= -1e-12


def test_a_start_outside_the_limits_comes_back_without_any_task():
    robot = robots.panda()
    q = READY.copy()
    q[1] = robot.upper[1] + 0.2
    loop = Loop(robot, '[]', q)
    loop.run(3.0)
    assert loop.q[1] <= robot.upper[1] + 1e-9
    assert np.abs(np.array(loop.velocities)).max() <= 0.2 * robot.velocity[1] + 1e-12


# mink, issue 109: position and velocity limits that meet

@pytest.mark.parametrize('period', [0.001, 0.01, 0.05])
def test_a_joint_that_runs_at_full_speed_into_its_position_limit_stops_there(period):
    robot = limited_panda(10.0)
    settings = Settings(period=period, braking_gain=min(20.0, 1.0 / period))
    loop = Loop(robot, '- push: {type: joint_velocity, timeout: 100}\n', READY, settings)
    loop.controller.set_goal('push', np.where(np.arange(7) % 2, -9.0, 9.0), loop.now)
    loop.run(8.0)
    loop.check_limits(10.0)
    at_limit = np.minimum(loop.q - robot.lower, robot.upper - loop.q)
    assert at_limit.max() < 1e-3
    v = np.abs(np.array(loop.velocities))
    assert (v.max(axis=0) > 0.95 * robot.velocity).any()


# moveit2, issues 3411 and 3573: out of reach, and back

@pytest.mark.parametrize('text', [POSE_AND_POSTURE, POSITION_AND_POSTURE],
                         ids=['pose', 'position'])
@pytest.mark.parametrize('acceleration', [None, 15.0])
def test_a_goal_out_of_reach_stretches_the_arm_and_the_way_back_is_open(text, acceleration):
    robot = limited_panda(acceleration)
    loop = Loop(robot, text, READY)
    pose = robot.state(READY).pose(TOOL).copy()

    def send(point):
        pose[:3, 3] = point
        loop.controller.set_goal('tool', pose if text is POSE_AND_POSTURE else point, loop.now)

    send([2.0, 0.0, 0.5])
    loop.run(4.0)
    reach = np.linalg.norm(robot.state(loop.q).position(TOOL) - [0.0, 0.0, 0.333])
    assert reach > 0.84
    assert np.abs(loop.velocities[-1]).max() < 0.05
    assert any(words in loop.task('tool').reason
               for words in ('singularity', 'limit', 'out of reach by'))
    send([0.45, 0.25, 0.45])
    assert loop.seconds_until_reached('tool', 10.0) < 7.0
    loop.check_limits(acceleration or np.inf)


# A wrist that passes its singularity on a line

@pytest.mark.slow
@pytest.mark.parametrize('offset', [0.0, 0.001, 0.02])
def test_a_wrist_crosses_its_singularity_on_a_line(offset):
    robot = robots.urdf_robot('ur5')
    # Joint 5 passes zero while the tool goes along the line.
    before = np.array([0.0, -1.4, 1.6, -1.8, 0.25, 0.0])
    after = before + [0.0, 0.1, 0.1, 0.0, -0.5, 0.0]
    settings = Settings(period=1e-3, braking_gain=50.0)
    loop = Loop(robot, '- position: {type: position, frame: tool0, gain: 5.0}\n'
                       '- orientation: {type: orientation, frame: tool0, gain: 5.0}\n',
                before, settings)
    first, last = (robot.state(q).pose('tool0').copy() for q in (before, after))
    line = last[:3, 3] - first[:3, 3] + [0.0, offset, 0.0]
    errors = []
    for step in range(3000):
        share = step / 3000
        loop.controller.set_goal('position', first[:3, 3] + share * line, loop.now)
        loop.controller.set_feed_forward('position', [*(line / 3.0), 0.0, 0.0, 0.0], loop.now)
        loop.step()
        if step > 600:
            errors.append(np.linalg.norm(
                robot.state(loop.q).position('tool0') - first[:3, 3] - share * line))
    assert max(errors) < 1e-3
    assert np.abs(np.diff(loop.velocities[5:], axis=0)).max() < 0.05
    loop.check_limits()


# Two tasks that become contradictory and separate again

@pytest.mark.parametrize('acceleration', [None, 15.0])
def test_tasks_that_contradict_each_other_for_a_while_let_the_upper_one_through(acceleration):
    robot = limited_panda(acceleration)
    loop = Loop(robot, '- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
                       '- wrist: {type: position, frame: panda_link7, gain: 2.0}\n'
                       '- posture: {type: posture, gain: 0.5}\n', READY)
    state = robot.state(READY)
    tool, wrist = (state.position(name).copy() for name in (TOOL, 'panda_link7'))
    loop.controller.set_goal('wrist', wrist, loop.now)
    # Farther from the wrist than the hand is long: both cannot be had.
    errors = []
    for step in range(1200):
        away = 0.3 * np.sin(np.pi * step / 600.0) ** 2 * np.array([0.0, 1.0, 0.0])
        loop.controller.set_goal('tool', tool + away, loop.now)
        loop.step()
        errors.append(np.linalg.norm(robot.state(loop.q).position(TOOL) - tool - away))
    # The goal moves at up to 0.79 m/s²; with the gain 2 /s it is followed half a second late.
    assert max(errors) < 0.26
    loop.run(6.0)
    assert loop.task('tool').reached and loop.task('wrist').reached
    loop.check_limits(acceleration or np.inf)
    assert np.abs(np.diff(loop.velocities, axis=0)).max() < 0.3


# A joint that must not move at all

@pytest.mark.parametrize('joint', range(7))
def test_a_joint_with_zero_allowed_speed_leaves_the_task_to_the_others(joint):
    name = robots.panda().joint_names[joint]
    robot = Robot.from_file(robots.PANDA_DH, limits={name: {'velocity': 0.0}})
    loop = Loop(robot, POSITION_AND_POSTURE, READY)
    goal = robot.state(READY).position(TOOL) + [0.03, 0.03, -0.04]
    loop.controller.set_goal('tool', goal, loop.now)
    loop.run(6.0)
    assert loop.task('tool').reached
    assert not np.array(loop.velocities)[:, joint].any()


# The exact start on a singularity: a straight arm that is to come straight back

@pytest.mark.parametrize('text', ['- tip: {type: position, frame: link10, gain: 2.0}\n',
                                  '- tip: {type: position, frame: link10, gain: 2.0}\n'
                                  '- posture: {type: posture, gain: 0.5}\n'])
@pytest.mark.parametrize('goal', [1.5, 0.1])
def test_a_straight_arm_finds_the_way_straight_back(text, goal):
    robot = Robot.from_dh([{'name': f'j{number}', 'a': 0.2, 'velocity': 2.0}
                           for number in range(10)])
    loop = Loop(robot, text, np.zeros(10))
    loop.controller.set_goal('tip', [goal, 0.0, 0.0], loop.now)
    assert loop.seconds_until_reached('tip', 20.0) < 6.0
    loop.check_limits()


def test_an_arm_that_cannot_move_towards_its_goal_is_nudged_three_times_and_then_left_alone():
    robot = Robot.from_dh([{'name': f'j{number}', 'a': 0.2, 'velocity': 2.0}
                           for number in range(4)])
    loop = Loop(robot, '- tip: {type: position, frame: link4, gain: 1.0}\n'
                       '- posture: {type: posture, gain: 2.0}\n', np.zeros(4))
    loop.controller.set_goal('tip', [0.8, 0.0, 0.3], loop.now)
    loop.run(0.8)
    assert loop.task('tip').reason.endswith('leaving a singularity')
    loop.run(20.0)
    assert loop.task('tip').reason == 'out of reach by 0.3 m'
    assert 'leaving' not in loop.task('tip').reason
    speeds = np.abs(np.array(loop.velocities)).max(axis=1)
    assert 0.005 < speeds.max() < 0.1
    assert speeds[-500:].max() < 1e-6
    # A new goal is a new chance.
    loop.controller.set_goal('tip', [0.7, 0.1, 0.3], loop.now)
    loop.run(12.0)
    np.testing.assert_allclose(robot.state(loop.q).position('link4')[:2], [0.7, 0.1], atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize('rests, nudged', [((0.16,), False), ((0.05, 0.16, 0.12), False),
                                           ((0.16, 0.24), True)])
def test_only_an_arm_that_has_stood_still_for_a_while_is_nudged(rests, nudged):
    """Between the rests it moves for one cycle, while it is measured where it was all the time."""
    robot = Robot.from_dh([{'name': f'j{number}', 'a': 0.2, 'velocity': 2.0}
                           for number in range(4)])
    loop = Loop(robot, '- tip: {type: position, frame: link4, gain: 1.0}\n'
                       '- drift: {type: joint_velocity}\n', np.zeros(4))
    loop.controller.set_goal('tip', [0.5, 0.0, 0.0], loop.now)
    pulses = np.cumsum([rests[number % len(rests)] for number in range(40)])
    reasons = []
    while loop.now < 3.0:
        pulse = np.abs(pulses - loop.now).min() < 0.5 * PERIOD
        loop.controller.set_goal('drift', np.full(4, 0.2 * pulse), loop.now)
        loop.q = np.zeros(4)
        loop.step()
        assert nudged or not pulse or np.abs(loop.velocities[-1]).max() > 1e-2
        reasons.append(loop.task('tip').reason)
    assert any('leaving a singularity' in reason for reason in reasons[60:]) == nudged


# Speed that is kept ready, and the mode of a task

@pytest.mark.parametrize('slow', [None, 'panda_joint1'])
def test_only_a_joint_with_an_acceleration_limit_is_kept_ready(slow):
    limits = {slow: {'acceleration': 1000.0}} if slow else None
    robot = Robot.from_file(robots.PANDA_DH, limits=limits)
    loop = Loop(robot, '- hold: {type: position, frame: panda_link1}\n'
                       '- turn: {type: joint_velocity, timeout: 9}\n', READY)
    loop.controller.set_goal('turn', robot.velocity, loop.now)
    loop.run(0.45)
    fastest = np.array([1.0 - loop.settings.reserve if name == slow else 1.0
                        for name in robot.joint_names]) * robot.velocity
    np.testing.assert_allclose(np.max(loop.velocities, axis=0), fastest, rtol=1e-9)


@pytest.mark.parametrize('text', [
    '- turn: {type: joint_velocity, timeout: 9, mode: scale}\n',
    '- - turn: {type: joint_velocity, timeout: 9, mode: scale}\n'
    '  - still: {type: joint_velocity, joints: panda_joint1, timeout: 9, mode: scale}\n'])
def test_a_task_of_mode_scale_keeps_its_direction(text):
    robot = robots.panda()
    loop = Loop(robot, text, READY, Settings(period=PERIOD, blend=0.0))
    demand = np.array([0.0, 0.5, -2.0, 0.3, 9.0, 0.1, 0.4])
    loop.controller.set_goal('turn', demand, loop.now)
    loop.step()
    v = loop.velocities[-1]
    assert v[4] == robot.velocity[4]
    np.testing.assert_allclose(v, v[4] / 9.0 * demand, rtol=0, atol=1e-6)


def test_a_new_goal_is_a_new_reason_to_nudge_an_arm():
    robot = Robot.from_dh([{'name': f'j{number}', 'a': 0.2, 'velocity': 2.0}
                           for number in range(4)])
    loop = Loop(robot, '- tip: {type: position, frame: link4, gain: 1.0}\n'
                       '- posture: {type: posture, gain: 2.0}\n', np.zeros(4))
    for height in (0.3, 0.4):
        # Out of the plane, and three nudges do not help.
        loop.controller.set_goal('tip', [0.8, 0.0, height], loop.now)
        loop.run(0.8)
        assert loop.task('tip').reason.endswith('leaving a singularity')
        loop.run(10.0)
        assert 'leaving' not in loop.task('tip').reason


def test_the_report_names_the_limits_that_matter_most_first():
    robot = robots.panda()
    loop = Loop(robot, '- turn: {type: joint_velocity, timeout: 9}\n', READY,
                Settings(period=PERIOD, blend=0.0))
    loop.controller.set_goal('turn', robot.velocity + [0.8, 2.8, -1.0, 0.3, 6.4, -1.0, -1.0],
                             loop.now)
    loop.step()
    # Without that of joint 1 less than 1 % of what is missing would come back, without that of
    # joint 2 less than a tenth.
    assert loop.task('turn').reason == 'panda_joint5 at its velocity limit'
    assert [cause.name for cause in loop.task('turn').causes] == ['panda_joint5', 'panda_joint2']


def test_the_report_names_the_limit_that_leads_a_task_astray():
    robot = robots.panda()
    q = READY.copy()
    q[0] = robot.upper[0] + 0.02
    loop = Loop(robot, '- turn: {type: joint_velocity, timeout: 9}\n', q,
                Settings(period=PERIOD, blend=0.0))
    loop.controller.set_goal('turn', [0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0], loop.now)
    loop.step()
    # Joint 1 has to go back; joint 2 does all that is demanded of it.
    assert loop.task('turn').reason == 'panda_joint1 at its upper position limit'


@pytest.mark.parametrize('reserve', [0.4, 1.0])
def test_a_stop_keeps_to_the_acceleration_limit_whatever_is_reserved(reserve):
    # Two tasks that stop together ask for exactly what the reserve leaves the second: nothing.
    robot = Robot.from_file(robots.PANDA_DH, limits={
        joint: {'acceleration': 15.0} for joint in robots.panda().joint_names})
    controller = Controller(robot, Stack.from_yaml("""
- first: {type: joint_velocity, joints: panda_joint1}
- second: {type: joint_velocity, joints: panda_joint2}
""", robot), Settings(reserve=reserve, blend=0.0))
    q, before = READY, np.zeros(robot.n)
    for cycle in range(60):
        now = 0.01 * cycle
        controller.set_goal('first', [1.0 if cycle < 30 else 0.0], now)
        controller.set_goal('second', [0.0], now)
        velocity = controller.update(q, now).velocity
        assert np.abs(velocity - before).max() <= 15.0 * 0.01 + 1e-12
        q, before = q + 0.01 * velocity, velocity
    assert not before.any()


@pytest.mark.parametrize('links', [3, 4, 6])
@pytest.mark.parametrize('direction', [-2.6, -1.0, 0.4, 1.9, 3.0])
@pytest.mark.parametrize('period', [0.01, 0.001])
@pytest.mark.slow
def test_a_tool_that_pushes_against_a_wall_comes_to_rest_at_it(links, direction, period):
    options, memory = Settings(period=period).solver(links), ()
    bound, length = np.full(links, 2.0), 2.0 / links
    q = np.linspace(0.9, -0.7, links)
    normal = np.array([np.cos(direction), np.sin(direction)])
    wall = goal = None
    deepest, velocities = 0.0, []
    for _ in range(int(6.0 / period)):
        angles = np.cumsum(q)
        ends = length * np.array([np.cos(angles), np.sin(angles)])
        x, y = np.cumsum(ends[:, ::-1], axis=1)[:, ::-1]
        tool, J = ends.sum(axis=1), np.array([-y, x])
        if wall is None:
            wall, goal = normal @ tool - 0.05, tool - 0.8 * normal + 0.2 * normal[::-1] * (1, -1)
        clearance = normal @ tool - wall
        solution = solve_cycle([
            Level((normal @ J)[np.newaxis], lower=np.array([-10.0 * clearance]),
                  upper=np.array([np.inf])),
            Level(J, 3.0 * (goal - tool)), Level(np.ones((1, links)), -q.sum(keepdims=True)),
            Level.of_joints(-0.2 * q)], -bound, bound, options, period, None, memory)
        velocity, memory = solution.velocity, solution.memory
        deepest = min(deepest, clearance)
        velocities.append(velocity)
        q = q + period * velocity
    assert clearance < 2e-3 and deepest > -1e-3
    changes = np.diff(velocities[-100:], axis=0)
    assert np.abs(changes).max() < 0.02


@pytest.mark.parametrize('axes, goal', [
    ('z', [0.0, 0.0, 2.0]), ('x', [1.5, 0.0, 0.0]), ('xy', [1.5, 0.0, 0.4])])
@pytest.mark.parametrize('below', ['', '- posture: {type: posture, gain: 0.5}'])
@pytest.mark.parametrize('period', [0.05, 0.01])
def test_a_tool_that_reaches_along_few_axes_for_what_is_out_of_reach_comes_to_rest(
        axes, goal, below, period):
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    stack = (f'- tool: {{type: position, frame: {robots.PANDA_TOOL}, axes: {axes}, gain: 2.0}}\n'
             + below)
    controller = Controller(robot, Stack.from_yaml(stack, robot),
                            Settings(period=period, braking_gain=10.0))
    controller.update(q, 0.0)
    controller.set_goal('tool', goal, 0.0)
    commands = []
    for cycle in range(int(12.0 / period)):
        commands.append(controller.update(q, cycle * period).velocity)
        q = q + period * commands[-1]
    # It may creep on.
    assert np.abs(np.diff(commands[-100:], axis=0)).max() < 5e-3

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Jerk limits: no choice within the bounds leads out of them, and no command exceeds them."""

import math
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.jerk_limit import JerkLimit
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import bounded, VelocityLimits
from tp_controller.model.limits import LIMIT_KEYS
from tp_controller.solver.compiled import core

SEEDS = st.integers(0, 2 ** 32 - 1)
STRATEGIES = ('up', 'down', 'alternating', 'random', 'change of mind', 'aims')
T = 0.01


def limits_of(period=T, gain=None, **values):
    """Return `VelocityLimits` of joints with these limits; gain 1/period by default."""
    n = len(next(iter(values.values())))
    its = {key: np.array(values.get(key, [-math.inf if key == 'lower' else math.inf] * n), float)
           for key in LIMIT_KEYS}
    return VelocityLimits(SimpleNamespace(limits=its), period, gain or 1.0 / period)


class Joints:
    """Joints that follow their commands, with what their limits have to know."""

    def __init__(self, limits, q, period=T):
        self.limits, self.q, self.period = limits, np.array(q, float), period
        self.v = self.a = 0.0 * self.q
        self.h = self.before = period
        self.second = 0.0 * self.q

    def bounds(self, demand=None, at=None, demanded=None):
        """Return the bounds of the next command."""
        motion = JointMotion(self.q, self.v, self.h, (), self.period, self.a, self.before, demand,
                             demanded)
        return (at or self.limits.box)(motion)

    def follow(self, command, hold):
        """Move with a command for a time."""
        change = (command - self.v) / self.h
        self.second = np.abs(change - self.a) / (0.5 * (self.h + self.before))
        self.before, self.v, self.a, self.h = self.h, command, change, hold
        self.q = self.q + hold * command


@pytest.mark.slow
@given(SEEDS, st.floats(1e-3, 0.05), st.sampled_from(STRATEGIES), st.booleans(), st.booleans())
def test_no_choice_within_the_bounds_leaves_a_limit(seed, period, strategy, hurried, demanding):
    rng, n = np.random.default_rng(seed), 8
    reach, velocity = 10.0 ** rng.uniform(-4.0, 0.5, n), 10.0 ** rng.uniform(-1, 1, n)
    acceleration = 10.0 ** rng.uniform(-0.5, 2.0, n)
    jerk = acceleration / 10.0 ** rng.uniform(-2.5, 0.5, n)
    acceleration[0] = math.inf
    limits = limits_of(period, rng.choice([1.0, rng.uniform(0.02, 1.0)]) / period, lower=-reach,
                       upper=reach, velocity=velocity, acceleration=acceleration, jerk=jerk)
    joints = Joints(limits, rng.uniform(-1.0, 1.0, n) * reach, period)
    aim = np.zeros(n)
    for step in range(250):
        if step % 40 == 0:
            aim = rng.uniform(-1.2, 1.2, n) * velocity
        lower, upper = joints.bounds(aim if demanding else None)
        assert (lower <= upper).all()
        share = {'up': 1.0, 'down': 0.0, 'alternating': step % 2, 'aims': 1.0,
                 'random': rng.random(n), 'change of mind': (step // 40) % 2}[strategy]
        command = np.clip(aim, lower, upper) if strategy == 'aims' else np.where(
            share == 1.0, upper, lower + share * (upper - lower))
        joints.follow(command, period * rng.uniform(0.05, 1.0) if hurried else period)
        assert (np.abs(command) <= velocity * (1.0 + 1e-12)).all()
        assert (np.abs(joints.a) <= acceleration * (1.0 + 1e-9)).all()
        assert (joints.second <= jerk * (1.0 + 1e-6)).all()
        assert (np.abs(joints.q) <= reach + 1e-12).all()


def test_the_first_command_from_rest_changes_by_jerk_times_period_squared():
    joints = Joints(limits_of(velocity=[9.0, 9.0], jerk=[100.0, math.inf]), [0.0, 0.0])
    lower, upper = joints.bounds()
    assert (lower[0], upper[0]) == pytest.approx((-0.01, 0.01))
    # The other has no such limit.
    assert (lower[1], upper[1]) == (-9.0, 9.0)
    joints.follow(np.array([0.01, 0.0]), T)
    assert joints.bounds()[1][0] == pytest.approx(0.03)
    assert joints.bounds()[0][0] == pytest.approx(0.01)


def test_the_second_difference_is_taken_at_the_mean_of_two_times():
    joints = Joints(limits_of(velocity=[9.0], jerk=[100.0]), [0.0])
    joints.follow(np.array([0.01]), 0.002)
    # An acceleration of 1 before, and 0.6 s/100 later at most 1 ± 0.6.
    lower, upper = joints.bounds()
    assert (lower[0], upper[0]) == pytest.approx((0.01 + 0.002 * 0.4, 0.01 + 0.002 * 1.6))


def test_a_cycle_that_is_late_changes_commands_as_one_in_time():
    joints = Joints(limits_of(velocity=[9.0], jerk=[100.0]), [0.0])
    on_time = joints.bounds()
    joints.h = joints.before = 0.05
    assert np.array_equal(on_time, joints.bounds())


@pytest.mark.parametrize('jerk', [20.0, 100.0, 5000.0])
def test_a_demand_is_reached_soon_and_not_passed(jerk):
    limits = limits_of(velocity=[3.0], acceleration=[8.0], jerk=[jerk])
    joints, demand, times = Joints(limits, [0.0]), np.array([2.0]), 0
    for cycle in range(400):
        lower, upper = joints.bounds(demand)
        joints.follow(np.clip(demand, lower, upper), T)
        assert joints.v[0] <= demand[0] + 1e-12
        times += joints.v[0] < demand[0] - 1e-3
    fastest = 2.0 / 8.0 + 8.0 / jerk if 2.0 > 8.0 ** 2 / jerk else 2.0 * math.sqrt(2.0 / jerk)
    assert times * T == pytest.approx(fastest, abs=4.0 * T)


def test_the_other_way_is_free_as_far_as_one_cycle_takes_back():
    joints = Joints(limits_of(velocity=[9.0], jerk=[100.0]), [0.0])
    lower, upper = joints.bounds(np.zeros(1))
    # The jerk alone allows up to 0.01, and then 0.02.
    assert (lower[0], upper[0]) == pytest.approx((-0.005, 0.005))
    joints.follow(np.array([0.005]), T)
    assert joints.bounds(np.zeros(1))[1][0] == pytest.approx(0.005)


def test_a_joint_compensates_up_to_half_of_what_the_fastest_demands():
    joints = Joints(limits_of(velocity=[9.0, 3.0, math.inf], jerk=[100.0] * 3), np.zeros(3))
    demand, found = np.array([1.8, 0.0, 0.0]), []
    for _ in range(100):
        command = joints.bounds(demand)[0]
        # A change of v takes up to j T of acceleration back.
        assert (command >= joints.v - 0.01 - 1e-12)[1:].all()
        joints.follow(command, T)
        found.append(command)
    # A fifth of the velocity limit is demanded.
    assert found[-1][1:] == pytest.approx([-0.3 - 0.005, -0.005])


@pytest.mark.parametrize('share', [0.25, 1.0])
def test_a_demand_that_falls_as_the_joint_moves_is_not_passed_by_as_much(share):
    # Bounds that know how fast the demand falls end the acceleration earlier.
    joints = Joints(limits_of(velocity=[9.0], jerk=[100.0]), [0.0])
    joints.v, joints.a = np.array([1.0]), np.array([2.0])
    known = joints.bounds(np.array([1.05]), demanded=np.array([1.05 + 0.1 * share]))[1][0]
    unknown = joints.bounds(np.array([1.05]))[1][0]
    # Half of the fall of 10 or 2.5 rad/s² is expected to last.
    gap, fall = 0.05, 5.0 * share
    assert known == pytest.approx(max(
        1.0 + T * (math.sqrt(200.0 * (gap + T * fall)) - 0.5 - fall), 1.0 + T * 1.0))
    assert known < unknown
    rising = joints.bounds(np.array([1.05]), demanded=np.array([0.95]))[1][0]
    assert rising == pytest.approx(unknown)


def test_a_lowered_velocity_limit_is_approached_without_a_jump():
    wide = limits_of(velocity=[2.0], acceleration=[8.0], jerk=[100.0])
    joints = Joints(wide, [0.0])
    for _ in range(100):
        joints.follow(joints.bounds()[1], T)
    assert joints.v[0] == pytest.approx(2.0)
    joints.limits = limits_of(velocity=[0.5], acceleration=[8.0], jerk=[100.0])
    for _ in range(60):
        joints.follow(joints.bounds(np.array([0.5]))[1], T)
        assert joints.second[0] <= 100.0 * (1.0 + 1e-9) and joints.v[0] >= 0.5 - 1e-9
    assert joints.v[0] == pytest.approx(0.5)


def test_a_joint_outside_its_range_returns_within_its_jerk():
    limits = limits_of(lower=[-1.0], upper=[1.0], velocity=[2.0], acceleration=[8.0], jerk=[100.0])
    joints = Joints(limits, [1.2])
    for _ in range(200):
        demand = np.array([-0.4 if joints.q[0] > 1.0 else 2.0])
        lower, upper = joints.bounds(demand)
        joints.follow(np.clip(2.0, lower, upper), T)
        assert joints.second[0] <= 100.0 * (1.0 + 1e-9) and joints.v[0] >= -0.4 - 1e-9
    assert joints.q[0] == pytest.approx(1.0, abs=1e-3)


def test_settled_bounds_take_no_time_for_the_jerk(monkeypatch):
    limits = limits_of(lower=[-1.0], upper=[1.0], velocity=[2.0], acceleration=[8.0], jerk=[100.0])
    motion = JointMotion(np.array([0.9]), np.array([0.5]), T, (), T)
    bounds = limits.at(motion)
    monkeypatch.setattr(JerkLimit, 'interval', None)
    lower, upper = bounded({
        limit: limit.interval(motion) for limit in limits.all if not limit.transient})
    assert bounds.settled.lower == lower == -2.0
    assert bounds.settled.upper == upper < 2.0


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
@given(SEEDS, st.integers(0, 3))
def test_the_core_has_the_same_bounds(seed, delay):
    rng, n = np.random.default_rng(seed), 20
    period = 10.0 ** rng.uniform(-3.0, -1.0)
    upper = np.where(rng.random(n) < 0.2, np.inf, 10.0 ** rng.uniform(-2.0, 0.5, n))
    acceleration = np.where(rng.random(n) < 0.2, np.inf, rng.uniform(0.1, 20.0, n))
    jerk = np.where(rng.random(n) < 0.2, np.inf, 10.0 ** rng.uniform(0.0, 4.0, n))
    jerk[0] = 1.0
    limits = limits_of(period, rng.uniform(0.05, 1.0) / period, lower=-upper, upper=upper,
                       velocity=rng.choice([0.0, math.inf, *rng.uniform(0.1, 5.0, 8)], n),
                       acceleration=acceleration, jerk=jerk)
    assert limits.compiled is not None
    motion = JointMotion(
        rng.uniform(-1.2, 1.2, n) * np.minimum(upper, 10.0), rng.normal(size=n),
        rng.uniform(1e-4, 0.2), tuple(rng.normal(size=(delay, n))), rng.uniform(1e-4, period),
        rng.normal(size=n) * 5.0, rng.uniform(1e-4, 0.2),
        *(rng.normal(size=n) if rng.random() < 0.7 else None for _ in range(2)))
    np.testing.assert_allclose(limits.box(motion), limits.box_by_reference(motion),
                               rtol=1e-12, atol=1e-12)


def test_the_bound_is_named():
    limits = limits_of(velocity=[9.0], acceleration=[8.0], jerk=[100.0])
    bounds = limits.at(JointMotion(np.zeros(1), np.zeros(1), T))
    assert bounds.limits(0, True) == ['jerk limit'] == bounds.limits(0, False)
    accelerated = JointMotion(np.zeros(1), np.zeros(1), T, acceleration=np.array([7.9]))
    assert limits.at(accelerated).limits(0, True) == ['acceleration limit', 'jerk limit']
    # It is gone in the cycle that lasts.
    assert bounds.settled.upper[0] == 9.0


def jerky(jerk=300.0, **more):
    """Return a Panda whose joints have a jerk limit."""
    names = robots.panda().joint_names
    return Robot.from_file(robots.PANDA_DH, limits={
        name: {'acceleration': 7.5, 'jerk': jerk, **more} for name in names})


STACK = (f'- limits: {{type: joint_limits}}\n- tool: {{type: pose, frame: {robots.PANDA_TOOL}, '
         'gain: 2.0}\n- posture: {type: posture, gain: 0.5}\n')
OTHER = STACK.replace('gain: 2.0', 'gain: 4.0').replace('posture, gain', 'posture, gain')


@pytest.mark.slow
@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.parametrize('blend', [0.0, 0.2])
@pytest.mark.parametrize('compiled', [True, False])
@pytest.mark.parametrize('delay', [0, 2])
def test_no_command_exceeds_the_jerk_whatever_changes(scaling, blend, compiled, delay):
    robot, rng = jerky(), np.random.default_rng(3)
    controller = Controller(robot, Stack.from_yaml(STACK, robot), Settings(
        period=T, scaling=scaling, blend=blend, command_delay=delay))
    if not compiled:
        controller._core.solve = lambda *given: None
    q, v, a, now, h0 = np.array(robots.PANDA_READY), np.zeros(7), np.zeros(7), 0.0, T
    most, pending = 0.0, [np.zeros(7)] * (1 + delay)
    for cycle in range(400):
        if cycle % 40 == 5:
            goal = robot.state(rng.uniform(0.8 * robot.lower, 0.8 * robot.upper)).pose(
                robots.PANDA_TOOL)
            controller.set_goal('tool', goal, now)
        if cycle == 130:
            controller.set_velocity_limits(dict.fromkeys(robot.velocity_names, 0.4))
        if cycle == 220:
            controller.replace_stack(Stack.from_yaml(OTHER, robot))
        if cycle == 260:
            controller.set_velocity_limits(dict.fromkeys(robot.velocity_names, 2.0))
        h = T * (1.0 if cycle < 2 else rng.uniform(0.3, 1.0))
        now += h
        q = q + pending[0] * h
        command = controller.update(q, now).velocity
        # The first command may change by what a period allows.
        change = (command - v) / (T if cycle == 0 else h)
        most = max(most, float((np.abs(change - a) / (0.5 * (h + h0))).max()))
        assert (np.abs(change) <= 7.5 * (1.0 + 1e-9)).all()
        v, a, h0 = command, change, h
        pending = [*pending[1:], command]
        assert (q <= robot.upper + 1e-9).all() and (q >= robot.lower - 1e-9).all()
    # It is used, and not exceeded.
    assert 0.99 * 300.0 < most <= 300.0 * (1.0 + 1e-6)


def test_a_robot_leaves_a_singularity_within_its_jerk():
    names = robots.planar().joint_names
    robot = Robot.from_file(robots.PLANAR_DH, limits={
        name: {'acceleration': 5.0, 'jerk': 40.0} for name in names})
    frame = robot.frame_names[-1]
    controller = Controller(robot, Stack.from_yaml(
        f'- tip: {{type: position, frame: {frame}, axes: xy, gain: 2.0}}', robot),
        Settings(period=T))
    q = np.zeros(robot.n)
    tip = robot.state(q).pose(frame)[:3, 3]
    controller.set_goal('tip', 0.5 * tip, 0.0)
    v, a, left = np.zeros(robot.n), np.zeros(robot.n), False
    for cycle in range(600):
        command = controller.update(q, T * cycle)
        left = left or 'singularity' in command.report._solved.outcome.override
        change = (command.velocity - v) / T
        assert (np.abs(change - a) <= 40.0 * T * (1.0 + 1e-6)).all()
        v, a = command.velocity, change
        q = q + T * v
    assert left
    assert np.linalg.norm(robot.state(q).pose(frame)[:2, 3] - 0.5 * tip[:2]) < 1e-2


def test_commands_lag_by_a_part_of_the_time_to_the_largest_acceleration():
    limits = limits_of(velocity=[2.0, 2.0, math.inf, 1.0], acceleration=[8.0, math.inf, 9.0, 9.0],
                       jerk=[100.0, 50.0, math.inf, math.inf])
    # Without an acceleration limit, what leads to the velocity limit.
    assert limits.response == pytest.approx(0.03 * 10.0 / 50.0)
    assert limits_of(velocity=[math.inf], jerk=[100.0]).response == 0.0


@pytest.mark.parametrize(('rate', 'jerk'), [(100, 300.0), (100, 100.0), (500, 1000.0)])
def test_an_arm_that_a_goal_stretches_comes_to_rest(rate, jerk):
    names = robots.planar().joint_names
    robot = Robot.from_file(robots.PLANAR_DH, limits={
        name: {'acceleration': 15.0, 'jerk': jerk} for name in names})
    controller = Controller(robot, Stack.from_yaml(
        '- tip: {type: position, frame: link3, axes: xy, gain: 2.0}\n'
        '- posture: {type: posture, gain: 0.5}\n', robot), Settings(period=1.0 / rate))
    q = np.array([0.3, 1.0, 0.5])
    controller.update(q, 0.0)
    tip = robot.state(np.array([0.8, 0.0, 0.0])).pose('link3')[:3, 3]
    controller.set_goal('tip', 1.4 * tip, 0.0)
    fastest = []
    for cycle in range(10 * rate):
        command = controller.update(q, cycle / rate)
        q = q + command.velocity / rate
        fastest.append(np.abs(command.velocity).max())
    assert max(fastest[:rate]) > 0.5
    assert max(fastest[-rate:]) < 3e-3


@pytest.mark.parametrize('compiled', [True, False])
def test_what_a_jerk_limit_prevents_for_a_moment_damps_nothing_later(compiled):
    robot = jerky()
    controller = Controller(robot, Stack.from_yaml(STACK, robot), Settings(period=T, blend=0.0))
    if not compiled:
        controller._core.solve = lambda *given: None
    q = np.array(robots.PANDA_READY)
    controller.update(q, 0.0)
    goal = robot.state(q).pose(robots.PANDA_TOOL).copy()
    goal[2, 3] -= 0.05
    controller.set_goal('tool', goal, 0.0)
    _, tool, _ = controller.update(q, T).report.tasks
    assert tool.achieved_speed < 0.5 * tool.demanded_speed
    assert controller._memory.damping[1] == 0.0


def test_after_a_stop_a_robot_starts_from_rest():
    robot = jerky()
    controller = Controller(robot, Stack.from_yaml(STACK, robot), Settings(period=T, blend=0.0))
    q = np.array(robots.PANDA_READY)
    goal = robot.state(q).pose(robots.PANDA_TOOL).copy()
    goal[2, 3] -= 0.3
    controller.set_goal('tool', goal, 0.0)
    for cycle in range(30):
        command = controller.update(q, T * cycle).velocity
        q = q + T * command
    assert np.abs(command).max() > 0.1
    controller.halt(0.3)
    after = controller.update(q, 0.31).velocity
    assert 0.0 < np.abs(after).max() <= 300.0 * T * T * (1.0 + 1e-9)
    # A ramp leaves the joints with its deceleration.
    for cycle in range(32, 60):
        moving = controller.update(q, T * cycle).velocity
    slower = controller.slow_down(q, 0.6, 2.0)
    change = (slower - moving) / T
    again = controller.update(q, 0.61).velocity
    assert (np.abs((again - slower) / T - change) <= 300.0 * T * (1.0 + 1e-9)).all()

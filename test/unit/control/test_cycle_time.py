# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Clocks that stand still, go back, tick seldom or make no sense, and the commands that result."""

from decimal import Decimal
import math

import numpy as np
import pytest
import robots
from tp_controller import (
    Controller,
    GoalError,
    Robot,
    RobotError,
    Settings,
    Stack,
    TimeError,
)
from tp_controller.control.cycle_time import CycleTime

PERIOD = 0.01
READY = np.array(robots.PANDA_READY)
TOOL = robots.PANDA_TOOL
ACCELERATION = 15.0
NO_TIMES = [math.nan, math.inf, -math.inf, 10 ** 400, None, '0.1', 1j, [0.1], object()]


def arm():
    """Return a Panda with acceleration limits."""
    return Robot.from_file(robots.PANDA_DH, limits={
        name: {'acceleration': ACCELERATION} for name in robots.panda().joint_names})


def control(text, robot, **settings):
    """Return a controller of a stack."""
    return Controller(robot, Stack.from_yaml(text, robot), Settings(period=PERIOD, **settings))


# Times between commands

class Clock:
    """Time that is advanced by one command after the other."""

    def __init__(self, period):
        self.period, self.value = period, CycleTime(0.0, period, period)

    def advance(self, measured):
        """Return the duration of a command."""
        elapsed, self.value = self.value.advance(measured, self.period)
        return elapsed


def test_time_that_is_measured_is_the_one_that_counts():
    time = Clock(PERIOD)
    assert [time.advance(measured) for measured in (0.004, 0.01, 0.5, 1e-9)] == pytest.approx(
        [0.004, 0.01, 0.5, 1e-9])
    assert time.value.now == pytest.approx(0.514)


@pytest.mark.parametrize('measured', [0.0, -1e-3, -1e9])
def test_clock_that_does_not_advance_is_taken_to_go_on_as_before(measured):
    time = Clock(PERIOD)
    assert [time.advance(measured) for _ in range(3)] == [PERIOD] * 3
    time.advance(0.002)
    assert time.advance(0.004) == 0.004
    assert [time.advance(measured) for _ in range(1000)] == [0.004] * 1000
    assert time.value.now == pytest.approx(3 * PERIOD + 0.0005 + 0.004 + 4.0, rel=1e-9)


def test_clock_that_ticks_less_often_than_the_cycle_runs_counts_as_it_ticks():
    time, ticks = Clock(0.1), []
    for _ in range(50):
        ticks.append(sum(time.advance(measured) for measured in [0.01] + [0.0] * 9))
    # Nothing is known before the second tick.
    assert ticks[2:] == pytest.approx([0.01] * 48)
    assert time.value.mean < 0.002
    # Where cycles come twice as fast all of a sudden, one tick counts double.
    faster = sum(time.advance(measured) for measured in [0.01] + [0.0] * 19)
    assert 0.01 < faster < 0.021
    assert sum(time.advance(measured) for measured in [0.01] + [0.0] * 19) == pytest.approx(0.01)


def test_pause_counts_no_longer_than_a_period_in_the_mean():
    time = Clock(PERIOD)
    for measured in [0.002] * 400:
        time.advance(measured)
    assert time.value.mean == pytest.approx(0.002, rel=1e-6)
    time.advance(60.0)
    assert 0.002 < time.value.mean < 0.0025
    assert time.advance(0.0) == PERIOD
    for _ in range(1000):
        time.advance(60.0)
    assert time.value.mean == pytest.approx(PERIOD)


def test_damping_takes_slow_cycles_for_no_longer_than_a_period():
    """The longer a command is applied, the more is damped near a singularity."""
    velocities = []
    for seconds in (PERIOD, 100.0 * PERIOD):
        robot = robots.planar()
        controller = control('- tip: {type: position, frame: link3, axes: xy, gain: 2.0}\n',
                             robot, blend=0.0)
        q = np.array([0.3, 0.02, 0.02])
        controller.update(q, 0.0)
        controller.set_goal('tip', [0.2, 0.1, 0.0], 0.0)
        for cycle in range(300):
            command = controller.update(q, seconds * cycle)
        velocities.append(command.velocity)
    assert np.abs(velocities[0]).max() > 1e-3
    np.testing.assert_allclose(velocities[0], velocities[1], rtol=1e-6)


# What a controller makes of it

CLOCKS = {'stands still': lambda cycle: 5.0, 'goes back': lambda cycle: -PERIOD * cycle,
          'is set back now and then': lambda cycle: PERIOD * (cycle % 7),
          'is set back by an hour': lambda cycle: PERIOD * cycle - (3600.0 if cycle > 70 else 0.0)}


@pytest.mark.parametrize('clock', CLOCKS)
def test_no_joint_passes_a_limit_and_none_freezes_whatever_the_clock_does(clock):
    robot = arm()
    controller = control('- posture: {type: posture, gain: 5.0}\n', robot)
    middle = 0.5 * (robot.lower + robot.upper)
    q, before = middle.copy(), np.zeros(7)
    controller.update(q, CLOCKS[clock](0))
    rng = np.random.default_rng(0)
    for cycle in range(1, 2001):
        now = CLOCKS[clock](cycle)
        if cycle % 400 == 1:
            goal = np.where(rng.integers(0, 2, 7), robot.upper, robot.lower)
            controller.set_goal('posture', goal, now)
        velocity = controller.update(q, now).velocity
        assert (np.abs(velocity - before) <= ACCELERATION * PERIOD + 1e-12).all()
        # The robot moves on by the true time, whatever the clock says.
        q, before = q + PERIOD * velocity, velocity
        assert (q >= robot.lower - 1e-9).all() and (q <= robot.upper + 1e-9).all()
        if cycle % 400 == 0:
            np.testing.assert_allclose(q, goal, atol=0.02)


@pytest.mark.parametrize('clock', CLOCKS)
def test_change_fades_out_without_a_jump_whatever_the_clock_does(clock):
    robot = robots.panda()
    text = ('- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
            '- posture: {type: posture, gain: 1.0}\n')
    controller = control(text, robot, blend=0.4)
    q, velocities, speed = READY.copy(), [], np.array([0.0, 0.1, 0.0])
    controller.update(q, 0.0)
    goal = robot.state(q).position(TOOL).copy()
    for cycle in range(1, 200):
        now = PERIOD * min(cycle, 60)
        if cycle > 60:
            now += CLOCKS[clock](cycle) - CLOCKS[clock](60)
        controller.set_goal('tool', goal + speed * PERIOD * cycle, now)
        if cycle == 55:
            controller.set_goal('posture', READY + 0.5, now)
        velocities.append(controller.update(q, now).velocity)
        q = q + PERIOD * velocities[-1]
    # Of the change of 0.5 rad/s at most 1.5 / 40 are made in one cycle.
    assert np.abs(np.diff(velocities[20:], axis=0)).max() < 0.03
    fresh = control(text.replace('1.0}', f'1.0, target: {(READY + 0.5).tolist()}}}'), robot)
    fresh.set_goal('tool', goal + speed * PERIOD * 199, 0.0)
    controller.set_goal('tool', goal + speed * PERIOD * 199, now)
    np.testing.assert_allclose(controller.update(q, now).velocity, fresh.update(q, 0.0).velocity,
                               atol=1e-12)


# Times that are none

CALLS = {
    'update': ('now', TimeError, lambda controller, time: controller.update(READY + 0.1, time)),
    'elapsed': ('elapsed', TimeError, lambda controller, time: controller.update(
        READY + 0.1, 0.02, elapsed=time)),
    'halt': ('now', TimeError, lambda controller, time: controller.halt(time)),
    'goal': ('now', GoalError, lambda controller, time: controller.set_goal(
        'tool', [0.3, 0.3, 0.3], time)),
    'feed-forward': ('now', GoalError, lambda controller, time: controller.set_feed_forward(
        'tool', np.ones(6), time)),
}


@pytest.mark.parametrize('what, time', [
    (what, time) for what in CALLS for time in NO_TIMES if (what, time) != ('elapsed', None)])
def test_time_that_is_none_is_refused_by_name_and_changes_nothing(what, time):
    (name, error, call), commands = CALLS[what], []
    for refused in (False, True):
        controller = control('- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
                             '- posture: {type: posture}\n', arm())
        controller.update(READY, 0.0)
        goal = controller.robot.state(READY).position(TOOL) + [0.1, 0.0, 0.1]
        controller.set_goal('tool', goal, 0.01)
        controller.update(READY, 0.01)
        if refused:
            with pytest.raises(error, match=f'^{name} must be a finite number'):
                call(controller, time)
        commands.append([controller.update(READY, 0.01 * cycle).velocity
                         for cycle in range(2, 60)])
    np.testing.assert_array_equal(*commands)
    assert np.abs(commands[0]).max() > 0.05


@pytest.mark.parametrize('passive', [[math.nan], [0.0, 0.0], 'x', [math.inf]])
def test_passive_positions_that_are_none_are_refused_and_change_nothing(passive):
    robot = Robot.from_file(robots.PANDA_DH, joints=[f'panda_joint{k}' for k in range(1, 7)])
    controller = control('- tool: {type: position, frame: panda_hand_tcp}\n', robot)
    first = controller.update(READY[:6], 0.0, [0.5]).velocity
    with pytest.raises(RobotError, match='passive'):
        controller.update(READY[:6] + 0.1, 0.01, passive)
    np.testing.assert_array_equal(controller.update(READY[:6], 0.01).velocity, first)


@pytest.mark.parametrize('time', [0, np.float32(0.25), np.int64(1), Decimal('0.5'), np.array(0.5)])
def test_every_finite_number_is_a_time(time):
    controller = control('- posture: {type: posture}\n', robots.panda())
    controller.set_goal('posture', READY, time)
    controller.halt(time)
    assert np.isfinite(controller.update(READY, time, elapsed=time).velocity).all()


@pytest.mark.parametrize('enabled', [None, 'no', math.nan, 2, [], object()])
def test_what_is_neither_true_nor_false_enables_nothing(enabled):
    controller = control('- posture: {type: posture}\n', robots.panda())
    for before in (True, False):
        controller.enable('posture', before)
        with pytest.raises(GoalError, match='enabled must be True or False'):
            controller.enable('posture', enabled)
        assert controller.stack.disabled == (set() if before else {'posture'})
    controller.enable('posture', np.bool_(True))
    assert not controller.stack.disabled

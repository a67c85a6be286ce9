# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ramped stops, and starts outside of the limits, in computed time."""

from fault_table import (
    AT_ONCE,
    BY_ITSELF,
    fault_text,
    NOTHING,
    Outcome,
    outcomes,
    RAMPED,
    START,
)
import numpy as np
import pytest
from robots import PANDA_DH, PANDA_READY
from test_joint_states import JOINTS, make_world, ROBOT, runs
from tp_controller import Robot
from tp_controller.ros.declarations.controller import OUTPUTS
from world import STATE_PERIOD, World

DECELERATION = 4.0
RATES = 20.0, 100.0, 0.0, 1000.0
SEEDS = range(5)
WHOLE = Robot.from_file(PANDA_DH)


def moving_world(patch, rate, seed=0, **values):
    """Return a world whose robot moves fast."""
    random = np.random.default_rng(seed)
    world = make_world(patch, random, rate=rate, **values)
    assert world.run(3.0, until=lambda: np.abs(world.velocity).max() > 0.8)
    return world, random


@fault_text('`~/stop` is called')
def stop(world):
    """Stop as ~/stop does."""
    world.loop.hold = 'stopped'


@fault_text('the node is deactivated')
def deactivate(world):
    """Deactivate the loop."""
    world.loop.come_to_rest('inactive')


@fault_text('a task fails, and `task_faults` is `stop`')
def fail(world):
    """Let a task fail in each cycle from now on."""
    def evaluate(state, now):
        raise ZeroDivisionError('division by zero')
    for task in world.controller.stack.tasks.values():
        task.evaluate = evaluate


@fault_text('a listener or watchdog that is required goes')
def unmet(world):
    """Take away a listener that is required."""
    world.loop.unmet = 'no node listens'


# What ends each of them, and part of the reason.
ACTS = {stop: (START, 'stopped'), deactivate: ('activation', 'inactive'),
        fail: (START, 'ZeroDivisionError'), unmet: (BY_ITSELF, 'no node listens')}


@outcomes('Decisions', (Outcome(act.text, RAMPED, *ends, 0.02)
                        for act, ends in ACTS.items()))
@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 1))
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('act', ACTS)
def test_a_stop_is_ramped_where_positions_are_known(monkeypatch, act, rate, output, seed):
    world, _ = moving_world(monkeypatch, rate, seed, stop_deceleration=DECELERATION, output=output)
    before, count, began = world.velocity.copy(), len(world.monitor.commands), world.now
    act(world)
    assert world.run(2.0, until=lambda: not world.velocity.any())
    commands = np.array([velocity for _, velocity, _ in world.monitor.commands[count:]])
    times = np.array([time for time, *_ in world.monitor.commands[count:]])
    # The fastest joint has the deceleration, the others keep their share of its speed.
    fastest = np.abs(before).max()
    assert world.now - began <= fastest / DECELERATION + 2.0 * world.period + 0.02
    steps = -np.diff(np.abs(np.vstack((before, commands))).max(axis=1))
    longest = max(world.period if rate else 2.0 * STATE_PERIOD, 0.011)
    assert (steps >= -1e-9).all() and steps.max() <= DECELERATION * longest + 1e-9
    for command in commands:
        share = np.abs(command).max() / fastest
        np.testing.assert_allclose(command, share * before, atol=1e-9)
    assert times[-1] - began >= fastest / DECELERATION - longest
    world.run(0.5)
    assert not world.velocity.any() and ACTS[act][1] in world.loop.stop_reason


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', RATES)
def test_a_ramped_stop_passes_no_position_limit(monkeypatch, rate, output):
    # A stop that would take 2 rad, in front of a limit.
    world = World(monkeypatch, WHOLE, f'- reach: {{type: joint, joints: [{", ".join(JOINTS)}], '
                  'gain: 5.0}\n', PANDA_READY, rate=rate, stop_deceleration=0.5, output=output)
    goal = np.array(PANDA_READY)
    goal[0] = WHOLE.upper[0]
    assert world.run(1.0, until=lambda: not world.stopped())
    world.controller.set_goal('reach', goal, world.now)
    assert world.run(3.0, until=lambda: world.q[0] > 2.2)
    assert world.velocity[0] > 1.0
    stop(world)
    world.run(4.0)
    assert not world.velocity.any()
    # Where joint states set the pace, one cycle may begin with positions a moment old.
    assert world.q[0] <= WHOLE.upper[0] + 1e-3


@pytest.mark.parametrize('output', OUTPUTS)
def test_a_velocity_limit_that_is_lowered_during_a_ramp_makes_no_jump(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, stop_deceleration=DECELERATION, output=output)
    stop(world)
    world.run(0.05)
    count = len(world.monitor.commands)
    world.controller.set_velocity_limits(dict.fromkeys(JOINTS, 0.1))
    assert world.run(1.0, until=lambda: not world.velocity.any())
    commands = np.array([each[1] for each in world.monitor.commands[count - 1:]])
    assert np.abs(np.diff(commands, axis=0)).max() <= DECELERATION * 0.011 + 1e-9


@pytest.mark.parametrize('output', OUTPUTS)
def test_no_ramp_lasts_longer_than_two_seconds(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, stop_deceleration=1e-3, output=output)
    stop(world)
    world.run(1.0)
    assert world.velocity.any()
    assert world.run(1.1, until=lambda: not world.velocity.any())


@pytest.mark.parametrize('output', OUTPUTS)
def test_a_robot_that_passes_a_limit_during_a_ramp_is_stopped_at_once(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, stop_deceleration=0.5, output=output)
    stop(world)
    world.run(0.1)
    world.report = lambda world: [world.state(np.where(
        np.arange(7) == 3, ROBOT.upper[3] + 0.06, world.q))]
    world.loop.measurements.joints.discard()
    assert world.run(0.05, until=lambda: not world.velocity.any())


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('report', ['silent', 'jumping'])
def test_zeros_come_at_once_where_positions_are_not_known(monkeypatch, rate, report, output):
    world, _ = moving_world(monkeypatch, rate, stop_deceleration=0.5, output=output)
    reports = {'silent': lambda world: [], 'jumping': lambda world: [world.state(world.q + 1.0)]}
    world.report = reports[report]
    count = len(world.monitor.commands)
    assert world.run(1.0, until=world.stopped)
    if world.holds:
        # Without a ramp: with the acceleration limits.
        longest = (np.abs(world.velocity) / ROBOT.acceleration[ROBOT.joint_columns]).max()
        assert world.run(longest + 2.0 * world.period + 0.02,
                         until=lambda: not world.velocity.any())
        return
    world.run(2.0 * world.period if rate else 0.02)
    speeds = [np.abs(velocity).max() for _, velocity, _ in world.monitor.commands[count:]]
    first = next(index for index, speed in enumerate(speeds) if speed == 0.0)
    assert min(speeds[:first], default=1.0) > 0.5 and not any(speeds[first:])


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', RATES)
def test_joint_states_that_stop_coming_end_a_ramp_with_zeros(monkeypatch, rate, output):
    world, _ = moving_world(monkeypatch, rate, stop_deceleration=0.5, output=output)
    stop(world)
    world.run(0.1)
    assert np.abs(world.velocity).max() > 0.3
    world.report = lambda world: []
    assert world.run(world.values['state_timeout'] + world.period + 0.06,
                     until=lambda: not world.velocity.any())


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', RATES)
def test_a_robot_that_is_started_during_the_ramp_goes_on_without_a_jump(monkeypatch, rate, output):
    world, _ = moving_world(monkeypatch, rate, stop_deceleration=1.0, output=output)
    world.loop.unmet = 'not enabled'
    world.run(0.1)
    assert world.velocity.any()
    count = len(world.monitor.commands)
    world.loop.unmet = ''
    world.loop.stops._settle = 0.0
    assert world.run(1.0, until=lambda: not world.stopped())
    world.run(0.1)
    commands = np.array([each[1] for each in world.monitor.commands[count - 1:]])
    assert commands.any(axis=1).all()
    # The limits of acceleration hold from the velocity of the ramp on.
    assert np.abs(np.diff(commands, axis=0)).max() <= 20.0 * max(
        world.period if rate else 2.0 * STATE_PERIOD, 0.011) + 1e-9


# Starts ---------------------------------------------------------------------------------------

@fault_text('positions are in degrees')
def degrees(q):
    """Report degrees."""
    return np.degrees(q)


@fault_text('positions are zero, where a joint cannot be')
def zeros(q):
    """Report zeros: joint 4 cannot be there."""
    return np.zeros_like(q)


@fault_text('one joint is far outside its limits')
def far_off(q):
    """Report one joint far off."""
    return np.where(np.arange(7) == 0, 100.0, q)


@fault_text('one joint is outside its limits by more than `limit_tolerance`')
def offset(q):
    """Report one joint a little too far."""
    return np.where(np.arange(7) == 5, ROBOT.upper[5] + 0.06, q)


OUTSIDE, SOON = (degrees, zeros, far_off, offset), 0.2


@outcomes('At a start', (Outcome(wrong.text, AT_ONCE, START, 'wrong unit or offset?', SOON,
                                 NOTHING) for wrong in OUTSIDE))
@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('wrong', OUTSIDE)
def test_a_robot_that_is_outside_its_limits_at_a_start_is_not_moved(monkeypatch, wrong, rate,
                                                                    output):
    world = World(monkeypatch, ROBOT, '- posture: {type: posture}\n', PANDA_READY, rate=rate,
                  output=output)
    world.report = lambda world: [world.state(wrong(world.q))]
    assert world.run(SOON, until=lambda: 'wrong unit or offset?' in world.stopped())
    world.run(3.0)
    # Positions are commanded from the first motion on.
    assert world.target is None
    assert (world.q == PANDA_READY).all() and 'call ~/start to go on' in world.stopped()
    assert 'outside its position limits' in world.loop.lasting()
    # The driver is put right.
    world.report = lambda world: [world.state()]
    world.run(1.2)
    assert world.stopped() and world.loop.lasting() == ''
    world.loop.restart()
    assert world.run(1.0, until=lambda: not world.stopped())


@pytest.mark.parametrize('output', OUTPUTS)
def test_a_robot_that_stands_a_little_outside_is_led_back(monkeypatch, output):
    q = np.array(PANDA_READY)
    q[5] = ROBOT.upper[5] + 0.04
    world = World(monkeypatch, ROBOT, '- posture: {type: posture}\n', q, output=output)
    world.run(3.0)
    assert not world.stopped() and world.q[5] <= ROBOT.upper[5] + 1e-6


@pytest.mark.parametrize('output', OUTPUTS)
def test_a_robot_that_was_moved_outside_while_stopped_is_not_moved(monkeypatch, output):
    world, random = moving_world(monkeypatch, 100.0, output=output)
    stop(world)
    world.run(0.1)
    world.settle()
    # By hand: the drives do not go back.
    world.q[3] = 0.3
    world.setpoint = world.q.copy()
    world.run(1.5)
    there = world.q.copy()
    world.loop.measurements.joints.forget()
    world.loop.stops.clear()
    world.loop.hold = ''
    world.run(1.0)
    assert (world.q == there).all() and 'wrong unit or offset?' in world.stopped()


# Drift ----------------------------------------------------------------------------------------

SLIPPED = 0.35


@outcomes('Joint states', [Outcome('an encoder slips, in small steps', AT_ONCE, START, 'jumped by',
                                   SLIPPED)])
@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 1))
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('speed', [-20.0, 10.0, 20.0])
def test_an_encoder_that_slips_in_small_steps_stops_the_robot(monkeypatch, speed, rate, output,
                                                              seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=rate, output=output)
    began, joint = world.now, random.integers(7)
    slip = np.where(np.arange(7) == joint, speed, 0.0)
    world.report = lambda world: [world.state(world.q + slip * (world.now - began))]
    assert world.run(SLIPPED + world.period, until=world.stopped)
    assert 'jumped by' in world.stopped() and 'call ~/start to go on' in world.stopped()


FARTHER = 2.5


@outcomes('Robot', [Outcome('joints move much farther than commanded', AT_ONCE, START,
                            'does not follow', FARTHER)])
@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 1))
@pytest.mark.parametrize('rate', RATES)
def test_a_robot_that_moves_farther_than_commanded_is_stopped(monkeypatch, rate, output, seed):
    random = np.random.default_rng(seed)
    # Slowly, so that no velocity limit gives it away, and all the way in one direction.
    world = World(monkeypatch, ROBOT, f'- reach: {{type: joint, joints: [{", ".join(JOINTS)}], '
                  'gain: 0.04}\n', PANDA_READY, rate=rate, output=output)
    assert world.run(1.0, until=lambda: not world.stopped())
    goal = np.array(PANDA_READY)
    goal[random.integers(3)] += random.choice([-1.0, 1.0])
    world.controller.set_goal('reach', goal, world.now)
    world.run(0.5)
    world.plant = lambda velocity: 10.0 * velocity
    assert world.run(FARTHER, until=lambda: 'does not follow' in world.stopped()), world.stopped()
    assert 'call ~/start to go on' in world.stopped()

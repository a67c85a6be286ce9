# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robots that are commanded positions: stops, starts and a bounded lead, in computed time."""

from types import SimpleNamespace

from fault_table import BRAKING, Outcome, outcomes, START
import numpy as np
import pytest
from robots import PANDA_DH, PANDA_READY
from test_joint_states import check, Drives, JOINTS, make_world, noisy, ROBOT, send_goal, STACKS
from test_stops import ACTS, moving_world, RATES
from tp_controller import Robot
from world import STATE_PERIOD, World

HOLDING = 'position', 'trajectory'
LIMITS = ROBOT.acceleration[ROBOT.joint_columns]
# Half a second until an acceleration is there.
JERK = 2.0 * LIMITS
SMOOTH = Robot.from_file(PANDA_DH, limits={
    name: {'acceleration': limit, 'jerk': jerk}
    for name, limit, jerk in zip(JOINTS, LIMITS.tolist(), JERK.tolist())})


def targets(world, count=0):
    """Return the positions that were commanded since there were `count` of them."""
    return np.array([positions for _, positions, _ in world.monitor.targets[count:]]
                    ).reshape(-1, 7)


def measured(error):
    """Return joint states with errors that a function returns, which may be believed."""
    def report(world):
        world.monitor.heard.append(world.now)
        return [world.state(world.q + error())]
    return report


def stop(world):
    """Stop as ~/stop does, and let the robot come to rest."""
    world.loop.hold = 'stopped'
    world.run(1.0)
    assert not world.velocity.any()


def start(world):
    """Start as ~/start does."""
    assert world.loop.lasting() == ''
    world.loop.restart()
    world.loop.hold = ''


@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('output', HOLDING)
@pytest.mark.parametrize('act', ACTS)
def test_a_stop_brakes_within_the_acceleration_limits_and_holds(monkeypatch, act, output, rate):
    world, _ = moving_world(monkeypatch, rate, output=output)
    before, began = world.velocity.copy(), world.now
    act(world)
    # Each joint brakes with its own limit.
    longest = (np.abs(before) / LIMITS).max()
    period = world.period if rate else 2.0 * STATE_PERIOD
    world.run(longest + 3.0 * period + 0.01)
    assert world.loop.commands.output.at_rest and ACTS[act][1] in world.loop.stop_reason
    still, count = world.target.copy(), len(world.monitor.targets)
    moved = still - next(q for time, q, _ in world.monitor.targets if time >= began - period)
    assert (np.abs(moved) <= before ** 2 / (2.0 * LIMITS) + 2.0 * period * np.abs(before)).all()
    assert (np.abs(moved) >= 0.3 * before ** 2 / (2.0 * LIMITS)).all()
    world.run(0.5)
    assert (targets(world, count) == still).all()
    assert len(targets(world, count)) >= (0 if act.text.startswith('the node') else 8)
    np.testing.assert_allclose(world.q, still, atol=1e-6)
    check(world)


def smooth_world(monkeypatch, **values):
    """Return a world whose robot moves fast, within jerk limits."""
    world = World(monkeypatch, SMOOTH, STACKS['joint'], PANDA_READY, **values)
    assert world.run(1.0, until=lambda: not world.stopped())
    send_goal(world, np.random.default_rng(1))
    assert world.run(3.0, until=lambda: np.abs(world.velocity).max() > 0.6)
    return world


def check_smooth(world):
    """Check that commanded positions keep the limits of acceleration and jerk."""
    times, q = (np.array(each) for each in list(zip(*world.monitor.targets))[:2])
    h = np.diff(times)[:, None]
    changes = np.diff(np.diff(q, axis=0) / h, axis=0) / h[1:]
    jerks = 2.0 * np.diff(changes, axis=0) / (h[2:] + h[1:-1])
    assert (np.abs(changes).max(0) <= LIMITS * (1.0 + 1e-6)).all()
    assert (np.abs(jerks).max(0) <= JERK * (1.0 + 1e-5)).all()
    assert (np.abs(jerks).max(0) > 0.9 * JERK).any()


@pytest.mark.parametrize('deceleration', [0.0, 3.0])
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('output', HOLDING)
def test_stop_and_start_of_positions_keep_the_jerk_limits(monkeypatch, output, rate,
                                                          deceleration):
    world = smooth_world(monkeypatch, rate=rate, output=output, stop_deceleration=deceleration)
    stop(world)
    output = world.loop.commands.output
    assert output.at_rest
    start(world)
    # What the tasks demand passes as it is.
    for _ in range(20):
        world.run(0.05)
        np.testing.assert_allclose(output.velocity, world.controller.velocity, atol=1e-9)
    # A fault: no ramp, but that of the output.
    assert np.abs(world.velocity).max() > 0.2
    world.loop.stops.latch('a fault')
    world.run(1.5)
    assert not world.velocity.any()
    check_smooth(world)
    check(world)


@pytest.mark.parametrize('rate', RATES)
def test_bounded_lead_keeps_the_jerk_limits(monkeypatch, rate):
    world = smooth_world(monkeypatch, rate=rate, output='position', follow_window=0.0)
    ideal, world.plant = world.plant, lambda velocity: 0.0 * velocity
    world.run(4.0)
    assert not world.stopped() and np.abs(world.velocity).max() < 1e-3
    assert 0.95 < world.loop.commands.output.lead <= 1.0 + 1e-9
    world.plant = ideal
    assert world.run(1.0, until=world.moving)
    world.run(1.0)
    check_smooth(world)


@pytest.mark.parametrize('output', HOLDING)
def test_a_joint_without_an_acceleration_limit_brakes_with_the_deceleration_of_stops(
        monkeypatch, output):
    robot = ROBOT.__class__.from_urdf(ROBOT.urdf)
    assert np.isinf(robot.acceleration[robot.joint_columns]).all()
    for deceleration in (0.0, 4.0):
        world = World(monkeypatch, robot, '- twist: {type: joint_velocity}\n', PANDA_READY,
                      stop_deceleration=deceleration, output=output)
        assert world.run(1.0, until=lambda world=world: not world.stopped())
        world.controller.set_goal('twist', [0.0] * 6 + [1.0], world.now)
        world.run(0.4)
        assert world.velocity[6] == pytest.approx(1.0)
        # Nothing is known any more: no ramp, but that of the output.
        world.loop.stops.latch('a fault')
        count = len(world.monitor.targets)
        world.run(0.6)
        moved = np.abs(targets(world, count)[-1] - targets(world, count - 1)[0])
        assert moved[6] == pytest.approx(0.5 / deceleration - 0.005 if deceleration else 0.0,
                                         abs=1e-3)


@pytest.mark.parametrize('droop', [0.0, 0.04])
@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('output', HOLDING)
def test_a_start_goes_on_from_the_last_positions(monkeypatch, output, rate, droop):
    world, _ = moving_world(monkeypatch, rate, output=output)
    # The drives hold the joints a little off, in motion as at rest.
    world.report = measured(lambda: -droop)
    stop(world)
    still, count = world.target.copy(), len(world.monitor.targets)
    start(world)
    assert world.run(1.0, until=world.moving)
    assert (np.abs(np.diff(np.vstack((still, targets(world, count))), axis=0))
            <= LIMITS * (2.0 * max(world.period if rate else 0.01, 0.01)) ** 2
            + 0.3 * 0.05).all()
    world.run(0.5)
    check(world)


@pytest.mark.parametrize('rate', RATES)
@pytest.mark.parametrize('output', HOLDING)
def test_a_stopped_robot_that_is_moved_is_left_alone_and_starts_where_it_is(monkeypatch, output,
                                                                            rate):
    world, _ = moving_world(monkeypatch, rate, output=output)
    stop(world)
    moved = np.clip(world.q + 0.1, ROBOT.lower + 0.01, ROBOT.upper - 0.01)
    for share in np.linspace(0.0, 1.0, 100):
        world.q = world.setpoint = world.setpoint + share * (moved - world.setpoint)
        world.run(0.002)
    count = len(world.monitor.targets)
    world.run(0.5)
    # Nothing pulls it back.
    assert len(world.monitor.targets) == count and world.is_at(moved)
    start(world)
    assert world.run(1.0, until=world.moving)
    assert (np.abs(targets(world, count)[0] - moved) <= LIMITS * 0.05 ** 2).all()


@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_that_is_not_seen_gets_no_command_until_it_is_known_to_be_there(monkeypatch,
                                                                                output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    stop(world)
    still, world.report = world.target, lambda world: []
    world.run(0.6)
    count = len(world.monitor.targets)
    world.run(1.0)
    assert len(world.monitor.targets) == count
    world.report = lambda world: [world.state()]
    world.run(0.2)
    assert len(world.monitor.targets) > count and (world.target == still).all()
    # The same after an activation.
    world.loop.deactivate('inactive')
    count, world.report = len(world.monitor.targets), lambda world: []
    world.loop.activate()
    world.run(0.2)
    assert len(world.monitor.targets) == count


@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_whose_node_ends_in_motion_brakes_first(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    before, began = world.velocity.copy(), world.q.copy()

    def sleep(seconds):
        for _ in range(round(seconds / 1e-3)):
            world._step()

    monkeypatch.setattr('tp_controller.ros.loop.commands.time', SimpleNamespace(sleep=sleep))
    world.loop.deactivate('ended by SIGTERM')
    assert not world.loop.commands.output.at_rest
    world.loop.commands.come_to_rest()
    assert world.loop.commands.output.at_rest
    world.run(0.3)
    assert (np.abs(world.q - began) >= 0.5 * before ** 2 / (2.0 * LIMITS)).all()
    check(world)


@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_that_has_stopped_by_itself_is_not_moved_on_by_a_stop(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    last, world.frozen = world.target, True
    world.run(0.045)
    world.loop.commands.interrupt()
    assert (world.target == last).all() and world.loop.commands.output.at_rest


@pytest.mark.parametrize('output', HOLDING)
def test_a_steady_error_of_the_drives_does_not_move_commanded_positions(monkeypatch, output):
    world = make_world(monkeypatch, np.random.default_rng(0), output=output)
    world.report = measured(lambda: -0.04)
    world.controller.set_goal('reach', PANDA_READY, world.now)
    world.run(5.0)
    assert not world.stopped()
    np.testing.assert_allclose(world.target, PANDA_READY, atol=2e-3)


@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_is_not_commanded_before_its_first_motion(monkeypatch, output):
    world = World(monkeypatch, ROBOT, '- posture: {type: posture}\n', PANDA_READY, output=output)
    world.loop.hold = 'stopped'
    world.run(0.5)
    assert world.target is None and world.loop.commands.stopped == 'no positions'
    world.loop.hold = ''
    world.run(0.5)
    np.testing.assert_allclose(world.target, PANDA_READY, atol=1e-9)
    assert world.loop.commands.stopped == 'the last positions'


@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_that_is_left_to_another_node_gets_no_further_command(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    count = len(world.monitor.targets)
    world.loop.stops.latch('another node publishes, too')
    world.loop.commands.withdraw()
    world.run(0.5)
    assert len(world.monitor.targets) == count
    assert 'commanding' not in world.loop.commands.stopped == 'nothing'
    # It is given back somewhere else.
    world.q = world.setpoint = world.q - 0.015
    world.run(0.2)
    world.loop.commands.silent = False
    start(world)
    assert world.run(1.0, until=world.moving)
    np.testing.assert_allclose(targets(world, count)[0], world.monitor.targets[count][2],
                               atol=5e-3)


@pytest.mark.parametrize('rate', [100.0, 1000.0, 0.0])
@pytest.mark.parametrize('output', HOLDING)
def test_commands_do_not_run_away_from_a_robot_that_is_blocked(monkeypatch, output, rate):
    world, random = moving_world(monkeypatch, rate, output=output, follow_window=0.0)
    world.controller.set_goal('reach', np.where(
        world.q > 0.5 * (ROBOT.lower + ROBOT.upper), ROBOT.lower, ROBOT.upper), world.now)
    ideal, world.plant = world.plant, lambda velocity: 0.0 * velocity
    world.report = measured(lambda: random.normal(0.0, 1e-3, 7))
    world.run(4.0)
    # Within the lead, as the monitor knows it, and at rest there but for the noise.
    check(world)
    assert not world.stopped() and np.abs(world.velocity).max() < 0.1
    assert world.loop.commands.output.lead > 0.95
    # Once it is free it goes on.
    world.plant = ideal
    assert world.run(1.0, until=world.moving)
    world.run(1.0)
    check(world)


COMES = 3.5


@outcomes('Robot', [Outcome('a joint does not come to commanded positions', '', START,
                            'away from its commanded position', COMES, BRAKING)])
@pytest.mark.parametrize('output', HOLDING)
def test_a_joint_that_does_not_come_to_its_positions_stops_the_robot(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    stop(world)
    start(world)
    assert world.run(1.0, until=lambda: not world.stopped())
    # More than a joint has to move that follows, and yet it never arrives.
    share = np.where(np.arange(7) == 3, 0.3, 1.0)
    world.plant = lambda velocity: share * velocity
    world.controller.set_goal('reach', np.where(np.arange(7) == 3, ROBOT.lower, world.q),
                              world.now)
    assert world.run(COMES, until=world.stopped)
    assert 'panda_joint4 does not follow: 0.' in world.stopped()
    assert 'away from its commanded position for 1 s' in world.stopped()
    assert world.loop.stops.joint == 'panda_joint4'


@pytest.mark.parametrize('rate', [100.0, 1000.0])
@pytest.mark.parametrize('output', HOLDING)
def test_a_robot_that_lags_and_is_measured_with_noise_follows_at_full_speed(monkeypatch, output,
                                                                            rate):
    reached = []
    for given in ('velocity', output):
        random = np.random.default_rng(5)
        world = make_world(monkeypatch, random, rate=rate, output=given)
        world.report, world.plant = noisy(random), Drives(0.02, 0.1)
        world.told.clear()
        world.run(1.0)
        assert world.told == []
        reached.append(np.abs(world.velocity))
    assert reached[1].max() > 0.5


@pytest.mark.parametrize('output', HOLDING)
def test_positions_keep_pace_with_a_robot_that_is_slowed_down(monkeypatch, output):
    world, _ = moving_world(monkeypatch, 100.0, output=output)
    limits = ROBOT.velocity[ROBOT.joint_columns]
    monkeypatch.setattr(type(world.loop.permits), 'speed', 0.3)
    world.run(0.4)
    assert not world.stopped() and world.moving()
    assert (np.abs(world.velocity) <= 0.3 * limits + 1e-9).all()
    # Without a jump, and the robot counts as one that follows.
    world.run(2.0)
    assert not world.stopped()
    check(world)

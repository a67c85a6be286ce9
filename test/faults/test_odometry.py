# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Odometry and bases at fault, in computed time, on every kind of base and from 20 Hz to 1 kHz.

The base goes on as it was told last, until the next command; the world knows where it truly is.
"""

import math

from fault_table import AT_ONCE, BY_ITSELF, fault_text, Outcome, outcomes, START
import numpy as np
import pytest
from robots import PANDA_DH, PANDA_READY
from scipy.spatial.transform import Rotation
from tp_controller import Robot
from world import World

SEEDS = range(2)
BASES = 'planar', 'differential', 'floating', 'underwater'
RATES = 20.0, 100.0, 0.0, 1000.0
ROBOTS = {base: Robot.from_file(PANDA_DH, base=base) for base in BASES}
STACK = '- drive: {type: base_pose, gain: 1.0}\n- posture: {type: posture, gain: 0.5}\n'
# Each base at each rate, and each output for the joints.
OUTPUTS = ('planar', 'position', 100.0), ('floating', 'trajectory', 0.0)
CASES = [*((base, 'velocity', rate) for base in BASES for rate in RATES), *OUTPUTS]
EACH_BASE = [*((base, 'velocity', 100.0) for base in BASES), *OUTPUTS]
# What a computed clock and its steps may add to a timeout [s].
STEPS = 0.02


def make_world(patch, base, rate, **values):
    """Return a world whose base is on its way to a place far ahead."""
    world = World(patch, ROBOTS[base], STACK, PANDA_READY, rate=rate, **values)
    goal = np.eye(4)
    goal[0, 3] = 30.0
    world.controller.set_goal('drive', goal, world.now)
    assert world.run(1.0, until=lambda: drives(world)), world.stopped()
    world.run(0.5)
    return world


def drives(world):
    """Return whether the base is commanded to move, by more than a little."""
    return bool(np.abs(world.twist).max() > 0.2)


# Faults ---------------------------------------------------------------------------------------

@fault_text('no odometry arrives')
def silence(world, random):
    """Send nothing."""
    return lambda world: []


@fault_text('the same message arrives again and again')
def repeated(world, random):
    """Send the same message again and again."""
    base, stamp = world.base.copy(), world.now
    return lambda world: [world.odometry(base, stamp)]


@fault_text('all stamps are old')
def old(world, random):
    """Stamp everything as if it were old."""
    shift = 10.0 ** random.uniform(-0.6, 3.0)
    return lambda world: [world.odometry(stamp=world.now - shift)]


@fault_text('all stamps are ahead of time')
def ahead(world, random):
    """Stamp everything as if it came from the future."""
    shift = 10.0 ** random.uniform(-0.6, 3.0)
    return lambda world: [world.odometry(stamp=world.now + shift)]


@fault_text('a position is no number')
def not_a_number(world, random):
    """Send a position that is no number."""
    def report(world):
        message = world.odometry()
        message.pose.pose.position.y = math.nan
        return [message]
    return report


LATE, TIMEOUT = (silence, repeated, old, ahead, not_a_number), 0.1


@outcomes('Odometry', (Outcome(fault.text, AT_ONCE, BY_ITSELF, 'no odometry', TIMEOUT)
                       for fault in LATE))
@pytest.mark.parametrize('seed', SEEDS[:1])
@pytest.mark.parametrize(('base', 'output', 'rate'), CASES)
@pytest.mark.parametrize('fault', LATE)
def test_odometry_that_is_late_or_no_pose_stops_the_robot(monkeypatch, fault, base, output, rate,
                                                          seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, base, rate, output=output)
    world.locate = fault(world, random)
    assert world.run(TIMEOUT + world.period + STEPS,
                     until=lambda: world.stopped().startswith('no odometry')), world.stopped()
    assert not world.twist.any()
    world.settle()
    stopped_at = world.base.copy()
    world.run(0.9 if world.holds else 1.5)
    assert (world.base == stopped_at).all()
    world.locate = lambda world: [world.odometry()]
    assert world.run(1.0, until=lambda: drives(world)), world.stopped()


@outcomes('Odometry', [Outcome('the pose jumps', AT_ONCE, START, 'odometry jumped by', STEPS)])
@pytest.mark.parametrize(('base', 'output', 'rate'), CASES)
@pytest.mark.parametrize('distance', [0.5, 5.0])
def test_odometry_that_jumps_stops_the_robot_until_a_start(monkeypatch, base, output, rate,
                                                           distance):
    world = make_world(monkeypatch, base, rate, output=output)
    world.base = world.robot.integrate(
        np.concatenate((world.base, world.q)),
        np.concatenate((np.eye(len(world.twist))[0], np.zeros(7))), distance)[:len(world.base)]
    assert world.run(world.period + STEPS, until=world.stopped)
    assert 'odometry jumped by' in world.stopped() and not world.twist.any()
    stopped_at = world.base.copy()
    world.run(1.1)
    assert (world.base == stopped_at).all() and 'call ~/start to go on' in world.stopped()
    assert world.loop.lasting() == ''
    world.loop.restart()
    assert world.run(0.5, until=lambda: drives(world))


RUNS_AWAY = 0.4


@outcomes('Odometry', [Outcome('the pose runs away in small steps', AT_ONCE, START,
                               'odometry jumped by', RUNS_AWAY)])
@pytest.mark.parametrize(('base', 'output', 'rate'), CASES)
def test_odometry_that_runs_away_in_small_steps_stops_the_robot(monkeypatch, base, output, rate):
    world = make_world(monkeypatch, base, rate, output=output)
    # Each step is far below what may lie between two messages.
    world.slip = lambda velocity: 6.0 * np.ones_like(velocity)
    assert world.run(RUNS_AWAY, until=world.stopped), world.base
    assert 'odometry jumped by' in world.stopped() and not world.twist.any()


@fault_text('the pose stands still while its stamps go on')
def frozen(world):
    """Report one place with stamps that go on."""
    place = world.base.copy()
    world.locate = lambda world: [world.odometry(place)]


@fault_text('the wheels are blocked')
def blocked(world):
    """Block the wheels."""
    world.slip = np.zeros_like


@fault_text('the base drives the other way')
def reversed_(world):
    """Let the base drive the other way."""
    world.slip = np.negative


@fault_text('the base drives three times as fast')
def fast(world):
    """Let the base drive three times as fast."""
    world.slip = lambda velocity: 3.0 * velocity


# One window of 1 s, the lag of 0.3 s, and at 20 Hz 27 cycles.
ASTRAY, FOLLOWS = (frozen, blocked, reversed_, fast), 1.5


@outcomes('Odometry', (Outcome(fault.text, AT_ONCE, START, 'does not follow', FOLLOWS)
                       for fault in ASTRAY))
@pytest.mark.parametrize(('base', 'output', 'rate'), CASES)
@pytest.mark.parametrize('fault', ASTRAY)
def test_a_base_that_does_not_follow_is_stopped_until_a_start(monkeypatch, fault, base, output,
                                                              rate):
    world = make_world(monkeypatch, base, rate, output=output)
    fault(world)
    assert world.run(FOLLOWS, until=world.stopped)
    assert 'base_x does not follow' in world.stopped() and not world.twist.any()
    assert world.loop.stops.joint == 'base_x'
    assert 'call ~/start to go on' in world.stopped()


# Less than 1.5 times the tolerance of jumps in a window: five windows of 1 s, and a lag of 0.3 s.
SLOWER, FOLLOWS_SLOWLY = (0.3, 0.1), 5.5


@outcomes('Odometry', (Outcome(f'{fault.text}, and the base is slower than 0.375 m/s', AT_ONCE,
                               START, 'does not follow', FOLLOWS_SLOWLY)
                       for fault in (frozen, blocked)))
@pytest.mark.parametrize(('base', 'output', 'rate'), [
    *((base, 'velocity', rate) for base in BASES for rate in RATES[:2]), *OUTPUTS])
@pytest.mark.parametrize('speed', SLOWER)
@pytest.mark.parametrize('fault', [frozen, blocked])
def test_a_slow_base_that_does_not_follow_is_stopped_later(monkeypatch, fault, speed, base, output,
                                                           rate):
    world = make_world(monkeypatch, base, rate, output=output)
    world.controller.set_velocity_limits({'base_x': speed})
    world.run(1.0)
    assert np.abs(world.twist).max() == pytest.approx(speed, rel=0.01)
    fault(world)
    assert world.run(FOLLOWS_SLOWLY, until=world.stopped)
    assert 'base_x does not follow' in world.stopped() and not world.twist.any()


@pytest.mark.parametrize(('base', 'output', 'rate'), EACH_BASE)
def test_a_base_that_moves_slowly_has_to_follow_as_well(monkeypatch, base, output, rate):
    world = make_world(monkeypatch, base, rate, output=output)
    ahead = world.robot.integrate(np.concatenate((world.base, world.q)), np.concatenate((
        np.eye(len(world.twist))[0], np.zeros(7))), 0.4)
    T = np.eye(4)
    T[:2, 3] = ahead[:2]
    world.controller.set_goal('drive', T, world.now)
    world.run(1.0)
    frozen(world)
    assert 0.0 < np.abs(world.twist).max() < 0.2
    assert world.run(8.0, until=world.stopped) and 'does not follow' in world.stopped()


# Backlog --------------------------------------------------------------------------------------

class Turns:
    """One message each time that a slow executor comes round, whatever waits."""

    def __init__(self, queue, every):
        self._queue, self._turn, self._every = queue, 0, every

    def __getattr__(self, name):
        """Return what the queue has."""
        return getattr(self._queue, name)

    def run(self):
        """Call back with the oldest message, if it is its turn."""
        self._turn += 1
        taken = self._queue.take_message(None, None) if self._turn % self._every == 0 else None
        if taken is not None:
            self._queue.callback(taken[0])


@pytest.mark.parametrize(('output', 'rate'), [*(('velocity', rate) for rate in RATES[1:]),
                                              *(case[1:] for case in OUTPUTS)])
def test_of_messages_that_have_waited_the_newest_counts(monkeypatch, output, rate):
    world = make_world(monkeypatch, 'planar', rate, output=output)
    # Every 5 ms a message comes, every 20 ms one would be taken.
    world.node.queues[:] = [Turns(queue, 20) for queue in world.node.queues]
    world.told.clear()
    world.run(2.0)
    assert world.told == [] and drives(world)


# No false alarms ------------------------------------------------------------------------------

def estimated(random, rate, correction):
    """Return odometry of an estimator: noise, a slow drift, and corrections of it."""
    offset, due, heard = np.zeros(3), [random.uniform(0.5, 2.0)], [-1.0]

    def report(world):
        if world.now - heard[0] < 1.0 / rate - 1e-9:
            return []
        heard[0] = world.now
        if due[0] < world.now - 100.0:
            due[0] += random.uniform(0.5, 2.0)
            offset[:] = random.uniform(-0.5, 0.5, 3) * correction
        message = world.odometry(world.base)
        world.located.append(world.now)
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        place.x += offset[0] + random.normal(0.0, 0.005)
        place.y += offset[1] + random.normal(0.0, 0.005)
        yaw = Rotation.from_euler('z', offset[2] + random.normal(0.0, 0.005))
        turn.x, turn.y, turn.z, turn.w = (
            yaw * Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])).as_quat()
        return [message]
    return report


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize(('base', 'output', 'rate'), CASES)
@pytest.mark.parametrize('correction', [0.0, 0.2])
def test_an_estimator_that_corrects_itself_stops_nothing(monkeypatch, base, output, rate, seed,
                                                         correction):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, base, rate, output=output)
    world.locate = estimated(random, random.choice([30.0, 50.0, 200.0]), correction)
    lag = np.zeros(len(world.twist))

    def drive(velocity):
        # As a base whose motors take 0.1 s.
        lag[:] += 0.01 * (velocity - lag)
        return lag

    world.slip = drive
    world.told.clear()
    world.run(3.0)
    # And near its goal.
    T = np.eye(4)
    T[:2, 3] = world.base[:2] + [0.5, 0.0]
    world.controller.set_goal('drive', T, world.now)
    world.run(2.0)
    assert world.told == []

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states that cannot be believed are noticed, and no others: streams drawn at random."""

import math
import re

import numpy as np
import pytest
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer
from tp_controller.ros.loop.stamp_age import StampAge
from tp_controller.ros.loop.state_checks import FollowCheck, Following, LimitCheck
from tp_controller.ros.loop.stop_reasons import MOST_LATCHED, Stops

LIMIT = 0.1
SEEDS = range(20)


def stamps(seed, seconds=20.0, rate=100.0, jitter=0.004, drift=0.0, offset=1.7e9):
    """Yield (stamp, time of receipt) of a publisher with a clock of its own."""
    rng = np.random.default_rng(seed)
    for time in np.arange(0.0, seconds, 1.0 / rate):
        yield offset + time * (1.0 + drift), time + jitter * rng.exponential()


# Stamps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('offset', [-1e3, 1.0, 1.7e9])
@pytest.mark.parametrize('drift', [-0.01, 0.0, 0.01])
def test_any_clock_that_goes_on_is_believed(seed, offset, drift):
    age = StampAge(LIMIT)
    assert not [fault for stamp, received in stamps(seed, drift=drift, offset=offset)
                if (fault := age.fault(stamp, received))]


def test_a_message_without_a_stamp_has_no_age():
    age = StampAge(LIMIT)
    assert not any(age.fault(0.0, time) for time in (0.0, 5.0, 100.0))


@pytest.mark.parametrize('seed', SEEDS)
def test_stamps_that_stand_still_are_too_old_after_the_limit(seed):
    age, last = StampAge(LIMIT), 0.0
    for stamp, received in stamps(seed):
        assert not age.fault(stamp, received)
        last, since = stamp, received
    ages = np.arange(0.0, 10.0, 0.01)
    faults = [age.fault(last, since + later) for later in ages]
    assert not any(faults[:int(0.8 * LIMIT / 0.01)])
    # For ever: a stamp that stands still is no other clock.
    assert all('by its stamp' in fault for fault in faults[int(1.2 * LIMIT / 0.01):])


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('shift', [-0.5, -30.0, 0.5, 30.0])
def test_stamps_of_another_time_are_left_out_until_the_clock_has_gone_on_for_a_while(seed, shift):
    age = StampAge(LIMIT)
    for stamp, received in stamps(seed):
        age.fault(stamp, received)
    faults = [age.fault(stamp + shift + 20.0, received + 20.0)
              for stamp, received in stamps(seed, seconds=4.0)]
    assert all(('old' if shift < 0.0 else 'ahead') in fault for fault in faults[:190])
    assert not any(faults[215:])


def test_the_age_by_a_clock_that_was_set_counts_from_its_first_stamp_that_is_believed():
    age = StampAge(LIMIT)
    times = 100.0 + np.arange(0.0, 12.0, 0.01)
    # The smallest difference of the last 2.5 s has just been kept.
    faults = [age.fault(time + (30.0 if time > 107.6 else 0.0), time) for time in times]
    assert all(faults[762:959]) and not any(faults[:760]) and not any(faults[963:])
    assert age.offset == pytest.approx(-30.0)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('delay', [0.15, 0.5, 30.0])
def test_messages_that_stay_late_are_never_believed_and_are_once_they_are_not(seed, delay):
    age = StampAge(LIMIT)
    for stamp, received in stamps(seed):
        age.fault(stamp, received)
    # Their stamps go on where they were, which those of a clock that was set do not.
    faults = [age.fault(stamp + 20.0, received + 20.0 + delay) for stamp, received in stamps(seed)]
    assert all('by its stamp' in fault for fault in faults)
    assert not any(age.fault(stamp + 40.0 + delay, received + 40.0 + delay)
                   for stamp, received in stamps(seed))


@pytest.mark.parametrize('seed', SEEDS)
def test_messages_that_queued_up_are_old_and_the_newest_is_not(seed):
    age = StampAge(LIMIT)
    messages = list(stamps(seed, seconds=10.0))
    for stamp, received in messages[:500]:
        age.fault(stamp, received)
    # Nothing was read for two seconds; then everything at once.
    woken = messages[700][1]
    faults = [age.fault(stamp, woken) for stamp, _ in messages[500:700]]
    assert all(faults[:180]) and not any(faults[195:])


# Motion ----------------------------------------------------------------------------------------


def drive(seed, check, *, lag=0.0, delay=0, noise=0.0, quantum=0.0, dropped=0.0, rate=100.0,
          seconds=8.0, follows=1.0, amplitude=1.0):
    """Return the faults of a joint that is commanded to swing to and fro, and rest in between."""
    rng = np.random.default_rng(seed)
    dt, q, actual, measured = 1.0 / rate, 0.0, 0.0, 0.0
    frequency, phase = rng.uniform(0.05, 1.0), rng.uniform(0.0, 6.28)
    commands, faults = [0.0] * (delay + 1), []
    for step in range(int(seconds * rate)):
        time = step * dt
        moves = (time // 2.0) % 2.0 == 0.0
        commands.append(amplitude * math.sin(frequency * 6.28 * time + phase) if moves else 0.0)
        faults.append(check.check(np.array([measured]), np.array([commands[-1]]), time))
        actual += (commands[-1 - delay] - actual) * (-math.expm1(-dt / lag) if lag else 1.0)
        q += follows * actual * dt
        if rng.random() >= dropped:
            measured = q + noise * rng.standard_normal()
            measured = round(measured / quantum) * quantum if quantum else measured
    return list(filter(None, faults))


def checker(endless=False, **values):
    """Return a check of one joint."""
    return FollowCheck(('joint1',), np.array([endless]), Following(**values))


def limits():
    """Return a check of the position limits of one joint."""
    return LimitCheck(('joint1',), np.array([-1.0]), np.array([1.0]), 0.05)


def test_a_joint_that_passes_a_limit_is_named_and_one_that_starts_outside_is_not():
    check = limits()
    assert not check.passed(np.array([1.2]))
    assert not check.passed(np.array([1.0])) and not check.passed(np.array([1.04]))
    assert check.passed(np.array([1.06])) == 'joint1 has passed its position limit, at 1.06'
    check.forget()
    assert not check.passed(np.array([1.06]))


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('rate', [20.0, 100.0, 1000.0])
@pytest.mark.parametrize('plant', [
    {}, {'lag': 0.1}, {'delay': 2}, {'noise': 1e-3}, {'quantum': 5e-3}, {'dropped': 0.1},
    {'lag': 0.05, 'delay': 1, 'noise': 1e-4, 'quantum': 1e-3, 'dropped': 0.1},
    {'amplitude': 0.05, 'noise': 1e-3, 'quantum': 5e-3}, {'amplitude': 0.0, 'noise': 2e-3}])
def test_a_robot_that_moves_late_or_is_measured_badly_follows(seed, rate, plant):
    assert not drive(seed, checker(), rate=rate, **plant)


@pytest.mark.parametrize('rate', [20.0, 100.0, 1000.0])
@pytest.mark.parametrize('follows', [0.0, 0.1, -1.0])
def test_a_robot_that_stands_still_or_moves_the_wrong_way_does_not_follow(rate, follows):
    check, q, dt = checker(), 0.0, 1.0 / rate
    for step in range(int(10.0 * rate)):
        fault = check.check(np.array([q]), np.array([0.3]), step * dt)
        if fault:
            break
        q += follows * 0.3 * dt
    assert re.match(r'joint1 does not follow: commanded to move by 0\.(3|27),', fault)
    # One window, and as much as the robot may be late.
    assert 1.1 <= step * dt <= 1.5


def test_a_joint_that_wraps_follows():
    check = checker(endless=True)
    for step in range(1000):
        angle = math.remainder(0.01 * step, math.tau)
        assert not check.check(np.array([angle]), np.ones(1), 0.01 * step)


def test_a_command_counts_for_the_time_that_it_is_in_force():
    # Pulses of 1 rad/s that a late cycle keeps in force for 0.4 s, three times in the window.
    check, q, now = checker(window=2.0), 0.0, 0.0
    for _ in range(30):
        for velocity, lasts in [*[(0.0, 0.02)] * 20, (1.0, 0.4)]:
            assert not check.check(np.array([q]), np.array([velocity]), now)
            q, now = q + velocity * lasts, now + lasts


def test_a_clock_that_is_set_back_hides_no_joint_that_stands_still():
    check = checker()
    check.check(np.zeros(1), np.ones(1), 1000.0)
    assert any(check.check(np.zeros(1), np.ones(1), 0.01 * step) for step in range(200))


def test_a_joint_that_is_led_back_with_noise_has_not_passed_its_limit():
    check, random = limits(), np.random.default_rng(0)
    for outside in np.linspace(0.06, -0.01, 2000):
        assert not check.passed(np.array([1.0 + outside + 1e-3 * random.standard_normal()]))


def test_what_was_before_a_start_is_forgotten():
    check = checker()
    for step in range(130):
        assert not check.check(np.zeros(1), np.array([0.3]), 0.01 * step)
    check.forget()
    for step in range(130, 250):
        assert not check.check(np.zeros(1), np.array([0.3]), 0.01 * step)


@pytest.mark.parametrize('moved, fault', [(0.09, False), (0.12, True), (-0.12, True)])
def test_a_joint_that_moves_without_a_command_does_not_follow(moved, fault):
    check, found = checker(excess=0.1), []
    for cycle in range(400):
        q = moved * min(max(cycle - 250, 0) / 50.0, 1.0)
        found.append(check.check(np.array([q]), np.zeros(1), 0.01 * cycle))
    assert any(found) == fault


def test_a_window_of_zero_checks_nothing():
    check = checker(window=0.0)
    assert not any(check.check(np.zeros(1), np.ones(1), 0.01 * step) for step in range(1000))


# Stops -----------------------------------------------------------------------------------------


def test_what_passes_stops_until_it_has_been_over_for_a_while():
    stops = Stops(0.5)
    # Not before the first motion: a node starts at once.
    assert stops.reason('no joint states', -1.0) == 'no joint states'
    assert stops.reason('', 0.0) == ''
    assert stops.reason('late', 1.0) == 'late'
    assert stops.reason('', 1.4) == 'late, until a moment ago'
    assert stops.reason('late', 1.45) == 'late'
    assert stops.reason('', 1.9) == 'late, until a moment ago'
    assert stops.reason('', 1.95) == ''


def test_what_latches_stops_until_it_is_taken_back():
    stops = Stops(0.5)
    stops.latch('joint1 jumped')
    stops.latch('joint2 jumped')
    assert stops.reason('', 0.0) == 'joint1 jumped; call ~/start to go on'
    assert stops.reason('', 1e6)
    stops.clear()
    assert stops.reason('', 2e6) == ''


def test_first_fault_can_be_taken_back_alone_and_names_its_joint():
    stops = Stops(0.5)
    stops.latch('joint1 does not follow', joint='joint1')
    for _ in range(20):
        stops.latch('joint2 jumped', joint='')
    assert (stops.joint, stops.further) == ('joint1', 'joint2 jumped')
    assert stops.reason('', 0.0) == ('joint1 does not follow; call ~/start to go on, or ~/lock to '
                                     'go on without it')
    stops.clear_first()
    assert stops.reason('', 0.0) == 'joint2 jumped; call ~/start to go on'
    assert (stops.joint, stops.further) == ('', '')
    # As faults that others cause, each with another text.
    for number in range(1000):
        stops.latch(f'node {number} publishes')
    for _ in range(MOST_LATCHED):
        assert stops.latched
        stops.clear_first()
    assert not stops.latched


def test_an_interruption_is_told_and_not_what_it_brings_with_it():
    stops = Stops(0.3)
    assert stops.reason('', 0.0) == ''
    stops.interrupt('stood still', 1.0)
    assert stops.reason('nothing heard', 1.0) == 'stood still'
    assert stops.reason('', 1.1) == 'stood still, until a moment ago'
    assert stops.reason('nothing heard', 1.2) == 'stood still'
    assert stops.reason('nothing heard', 1.3) == 'nothing heard'
    assert stops.reason('', 1.4) == 'nothing heard, until a moment ago'
    assert stops.reason('', 1.6) == ''


def test_before_the_first_motion_what_is_missing_stops_after_an_interruption_too():
    stops = Stops(0.3)
    stops.interrupt('stood still', 1.0)
    assert stops.reason('', 1.05) == ''
    assert stops.reason('nothing heard', 1.1) == 'nothing heard'


def test_the_age_of_a_message_is_that_of_its_stamp_and_zero_where_nobody_asks():
    age, never = StampAge(0.1), StampAge(math.inf)
    for stamp, received in ((0.0, 0.0), (1.0, 11.0), (1.1, 11.15), (1.05, 11.13)):
        assert age.fault(stamp, received) == never.fault(stamp, received) == ''
        assert never.age == 0.0
    assert age.age == pytest.approx(0.08)


def test_a_message_counts_as_heard_when_it_was_true():
    buffer = JointStateBuffer(['a'], [], [], late=0.1)
    assert buffer.put(['a'], [0.0], 11.0, 1.0) == ''
    assert buffer.put(['a'], [0.0], 11.09, 1.0) == ''
    assert buffer.missing(11.1, 0.1) == []
    assert buffer.missing(11.12, 0.1) == ['a']


def test_a_message_that_was_overtaken_does_not_take_the_place_of_the_newer_one():
    buffer = JointStateBuffer(['a'], [], [], np.array([2.0]), late=0.1)
    for stamp, received, position in ((1.0, 11.0, 0.0), (1.02, 11.02, 0.04), (1.01, 11.03, 0.02)):
        assert buffer.put(['a'], [position], received, stamp) == ''
    assert buffer.q == [0.04] and not buffer.contradiction
    # The robot is where the newest message says, and that is how old what is known is.
    assert buffer.missing(11.11, 0.1) == [] and buffer.missing(11.13, 0.1) == ['a']
    # Of another publisher, which is a little behind, it is still seen that it disagrees.
    buffer.put(['a'], [1.0], 11.04, 1.015)
    assert 'jumped' in buffer.contradiction


def test_after_a_clock_was_set_back_its_messages_count_again():
    buffer = JointStateBuffer(['a'], [], [], late=0.1)
    times = np.arange(0.0, 3.0, 0.02)
    for shift, later in ((0.0, 0.0), (-30.0, 5.0)):
        for time in times:
            buffer.put(['a'], [time + later], 11.0 + time + later, 100.0 + shift + time + later)
    assert buffer.q == [times[-1] + 5.0]


def follow(check, q, start, share=1.0, period=0.01):
    """Return the faults of 2 s, from `q`, of a joint that moves by a share of its command."""
    faults = []
    for cycle in range(200):
        faults.append(check.check(q.copy(), np.array([0.1]), start + period * cycle))
        q += share * 0.1 * period
    return [fault for fault in faults if fault]


@pytest.mark.parametrize('leap', [0.3, 0.6, 0.9, 10.0, 1e9, -5.0])
def test_a_clock_that_leaps_is_no_robot_that_does_not_follow(leap):
    check, q = checker(), np.array([-0.9])
    assert not follow(check, q, 0.0)
    # Commands were in force for a cycle only, whatever the clock says.
    assert not follow(check, q, 2.0 + leap)
    # One that stops following is still noticed.
    assert 'joint1 does not follow' in follow(check, q, 4.0 + leap, share=0.0)[0]

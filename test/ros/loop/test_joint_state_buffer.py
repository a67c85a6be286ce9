# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states, merged by name."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer


@pytest.fixture
def buffer():
    """Return a buffer of two driven joints and a passive one."""
    return JointStateBuffer(('a', 'b'), ('hand',), (0.2,))


def test_positions_are_sorted_by_name_whatever_the_order(buffer):
    assert buffer.put(['hand', 'b', 'a'], [3.0, 2.0, 1.0], 0.0) == ''
    np.testing.assert_array_equal(buffer.q, [1.0, 2.0])
    np.testing.assert_array_equal(buffer.passive, [3.0])


def test_publishers_complement_each_other(buffer):
    buffer.put(['a'], [1.0], 0.0)
    assert buffer.missing(0.0, 0.1) == ['b']
    buffer.put(['b', 'hand'], [2.0, 3.0], 0.05)
    assert buffer.missing(0.05, 0.1) == []
    np.testing.assert_array_equal(buffer.q, [1.0, 2.0])


def test_joints_that_the_robot_does_not_have_are_ignored(buffer):
    assert buffer.put(['wheel', 'a', 'b'], [math.nan, 1.0, 2.0], 0.0) == ''
    np.testing.assert_array_equal(buffer.q, [1.0, 2.0])


def test_a_message_without_any_joint_changes_nothing(buffer):
    for names, positions in (([], []), (['wheel'], [1.0])):
        assert buffer.put(names, positions, 0.0) == ''
    assert buffer.missing(0.0, 0.1) == ['a', 'b']
    assert not buffer.take_complete()


@pytest.mark.parametrize('positions, fault', [
    ([1.0], '2 joints with 1 positions'),
    ([1.0, 2.0, 3.0], '2 joints with 3 positions'),
    ([], '2 joints with 0 positions'),
    ([1.0, math.nan], 'position not finite, or beyond 1e+06: a'),
    ([math.inf, 2.0], 'position not finite, or beyond 1e+06: b'),
    ([1e200, 1.1e6], 'position not finite, or beyond 1e+06: b, a'),
])
def test_a_faulty_message_is_named_and_ignored_as_a_whole(buffer, positions, fault):
    buffer.put(['a', 'b'], [0.5, 0.6], 0.0)
    buffer.take_complete()
    assert buffer.put(['b', 'a'], positions, 1.0) == fault
    np.testing.assert_array_equal(buffer.q, [0.5, 0.6])
    assert buffer.missing(1.0, 0.5) == ['a', 'b']
    assert not buffer.take_complete()


def test_every_joint_ages_on_its_own(buffer):
    buffer.put(['a', 'b'], [1.0, 2.0], 0.0)
    buffer.put(['b'], [2.0], 1.0)
    assert buffer.missing(0.1, 0.1) == []
    assert buffer.missing(1.0, 0.1) == ['a']
    assert buffer.missing(1.2, 0.1) == ['a', 'b']


def test_a_passive_joint_is_not_waited_for(buffer):
    buffer.put(['a', 'b'], [1.0, 2.0], 0.0)
    assert buffer.missing(0.0, 0.1) == []
    assert buffer.take_complete()


def test_the_state_is_complete_once_per_round_of_all_joints(buffer):
    buffer.put(['a'], [1.0], 0.0)
    buffer.put(['a'], [1.1], 0.01)
    assert not buffer.take_complete()
    buffer.put(['b'], [2.0], 0.02)
    assert buffer.take_complete()
    assert not buffer.take_complete()


def test_names_that_change_all_the_time_neither_confuse_nor_fill_the_memory(buffer):
    for number in range(1000):
        assert buffer.put(['a', f'other{number}', 'b'], [number, 7.0, -number], 0.0) == ''
        np.testing.assert_array_equal(buffer.q, [number, -number])
    assert len(buffer._layouts) <= 100


# Contradictions -------------------------------------------------------------------------------


@pytest.fixture
def checked():
    """Return a buffer of two joints at up to 1/s, the second of which turns without end."""
    return JointStateBuffer(['a', 'b'], ['p'], [0.0], np.ones(2), np.array([False, True]),
                            late=0.1, tolerance=0.05)


@pytest.mark.parametrize(('seconds', 'moved', 'contradicts'), [
    (0.01, 0.15, False), (0.01, 0.17, True), (1.0, 1.14, False), (1.0, -1.16, True)])
def test_a_joint_contradicts_itself_if_it_moves_farther_than_it_can(
        checked, seconds, moved, contradicts):
    assert checked.put(['b', 'a'], [0.0, 0.5], 5.0) == ''
    assert checked.put(['b', 'a'], [0.0, 0.5 + moved], 5.0 + seconds) == ''
    assert bool(checked.contradiction) == contradicts
    if contradicts:
        assert checked.contradiction == f'a jumped by {abs(moved):.2g} in {seconds:.2g} s'
    # What came last is where it is.
    assert checked.q[0] == 0.5 + moved


def test_whole_turns_of_a_joint_without_end_are_no_motion(checked):
    checked.put(['a', 'b'], [0.0, 3.14], 0.0)
    checked.put(['a', 'b'], [0.0, -3.14], 0.01)
    assert not checked.contradiction
    checked.put(['a', 'b'], [0.0, 0.0], 0.02)
    assert 'b jumped by 3.1' in checked.contradiction


def test_passive_joints_may_be_anywhere(checked):
    for position in (0.0, 9.0):
        checked.put(['a', 'b', 'p'], [0.0, 0.0, position], 0.0)
    assert not checked.contradiction


def test_a_contradiction_lasts_for_a_second_and_is_known_until_it_is_forgotten(checked):
    for position in (0.0, 5.0):
        checked.put(['a', 'b'], [position, 0.0], 1.0)
    assert checked.lasting(1.9) == checked.contradiction == 'a jumped by 5 in 0 s'
    assert checked.lasting(2.1) == '' != checked.contradiction
    checked.forget()
    assert not checked.contradiction


def test_the_last_message_that_was_ignored_is_told_for_a_while(checked):
    assert checked.put(['a', 'b', 'a'], [0.0, 0.0, 0.0], 1.0) == 'a is named twice'
    assert checked.missing(1.0, 0.1) == ['a', 'b']
    assert checked.dropped.remark(1.05, 0.1) == ' (ignored: a is named twice)'
    # As with messages that come less often than joint states may be late.
    assert checked.dropped.remark(1.9, 0.1) == checked.dropped.remark(1.05, 0.1)
    assert checked.dropped.remark(2.1, 0.1) == ''
    assert checked.dropped.remark(2.9, 2.0) == ' (ignored: a is named twice)'


def test_messages_of_another_time_are_ignored(checked):
    assert checked.put(['a', 'b'], [0.0, 0.0], 1.0, stamp=50.0) == ''
    assert 'by its stamp' in checked.put(['a', 'b'], [0.1, 0.0], 1.3, stamp=50.0)
    assert checked.q[0] == 0.0
    # Another publisher has a clock of its own.
    assert checked.put(['a'], [0.1], 1.3, stamp=9.0) == ''


def test_motion_is_judged_by_the_clock_of_the_robot(checked):
    checked.put(['a', 'b'], [0.0, 0.0], 0.0, received=10.0)
    checked.put(['a', 'b'], [0.9, 0.0], 0.01, received=11.0)
    assert not checked.contradiction


def test_a_clock_that_is_set_back_contradicts_nothing(checked):
    checked.put(['a', 'b'], [0.0, 0.0], 5.0, stamp=100.0, received=100.0)
    assert checked.put(['a', 'b'], [3.0, 0.0], 5.1, stamp=0.1, received=0.1) == ''
    assert not checked.contradiction


def test_stamps_are_not_judged_before_the_clock_begins(checked):
    for stamp in (500.0, 500.5, 501.0):
        assert checked.put(['a', 'b'], [0.0, 0.0], 5.0, stamp=stamp, received=0.0) == ''


def test_a_passive_joint_without_a_position_stays_where_it_was(buffer):
    assert buffer.put(['hand', 'a', 'b'], [math.nan, 1.0, 2.0], 0.0) == ''
    np.testing.assert_array_equal(buffer.q, [1.0, 2.0])
    np.testing.assert_array_equal(buffer.passive, [0.2])
    assert buffer.unheard() == ['hand']
    assert 'b' in buffer.put(['hand', 'a', 'b'], [math.nan, 1.0, math.nan], 0.0)


class Model:
    """What a buffer without stamps should know, written down joint by joint."""

    def __init__(self, driven, passive):
        self.driven, self.names = driven, driven + passive
        self.positions = dict.fromkeys(driven, math.nan) | dict.fromkeys(passive, 0.0)
        self.received = dict.fromkeys(self.names, -math.inf)
        self.taken = -math.inf

    def put(self, message, now):
        """Take a message, unless it says nothing about a driven joint that it has."""
        own = {name: position for name, position in message.items() if name in self.names}
        if any(math.isnan(own[name]) for name in own if name in self.driven):
            return
        for name, position in own.items():
            if not math.isnan(position):
                self.positions[name], self.received[name] = position, now

    def discard(self):
        """Take what was heard of driven joints for too old."""
        self.received.update(dict.fromkeys(self.driven, -math.inf))

    def missing(self, now, timeout):
        """Return the driven joints that were not heard for too long."""
        return [name for name in self.driven if self.received[name] < now - timeout]

    def take_complete(self):
        """Return True once after every driven joint got a new position."""
        times = [self.received[name] for name in self.driven]
        if min(times) <= self.taken:
            return False
        self.taken = max(times)
        return True


JOINTS = ['a', 'b', 'c', 'hand']
# Who speaks: all at once, or in parts that leave something out, overlap, or say too much.
SPEAKERS = [['a', 'b', 'c'], ['c', 'b', 'a', 'hand'], ['a'], ['b', 'c'], ['hand', 'a', 'wheel']]
POSITIONS = st.floats(-0.4, 0.4) | st.just(math.nan)
STEPS = st.lists(st.tuples(st.sampled_from(SPEAKERS), st.lists(POSITIONS, min_size=4, max_size=4),
                           st.booleans(), st.floats(1e-3, 0.3)), max_size=30)


@settings(max_examples=300)
@given(STEPS)
def test_whoever_speaks_every_joint_is_known_as_a_plain_model_knows_it(steps):
    buffer, model, now = JointStateBuffer(JOINTS[:3], JOINTS[3:], [0.0]), Model(
        JOINTS[:3], JOINTS[3:]), 100.0
    for names, positions, discarded, passed in steps:
        now += passed
        if discarded:
            buffer.discard()
            model.discard()
        message = dict(zip(names, positions))
        buffer.put(list(message), list(message.values()), now)
        model.put(message, now)
        for timeout in (0.05, 0.2, 1.0):
            assert buffer.missing(now + 0.04, timeout) == model.missing(now + 0.04, timeout)
        assert buffer.take_complete() == model.take_complete()
        assert buffer.unheard() == [
            name for name in JOINTS[3:] if model.received[name] == -math.inf]
        np.testing.assert_array_equal([*buffer.q, *buffer.passive],
                                      [model.positions[name] for name in JOINTS])


@pytest.mark.parametrize('first, then', [(['a', 'b'], ['b']), (['b'], ['b', 'a'])])
def test_a_jump_is_measured_by_the_clock_of_the_robot_since_the_joint_was_heard(first, then):
    buffer = JointStateBuffer(['a', 'b'], [], [], np.array([1.0, 1.0]), late=0.0)
    buffer.put(['a'], [0.0], 100.0, received=10.0)
    buffer.put(first, [0.0] * len(first), 101.0, received=11.0)
    # In 2 s of its own time, 20 s by the other clock: 1.9 rad are possible, and 2.1 are not.
    buffer.put(then, [1.9] * len(then), 121.0, received=13.0)
    assert buffer.contradiction == ''
    buffer.put(then, [4.0] * len(then), 141.0, received=15.0)
    assert 'b jumped by 2.1 in 2 s' in buffer.contradiction


def test_nobody_finds_a_joint_missing_while_its_message_is_taken(monkeypatch):
    buffer = JointStateBuffer(['a', 'b'], [], [])
    found = []
    note = JointStateBuffer._note

    def look(self, *arguments):
        found.append(self.missing(10.0, 1.0))
        note(self, *arguments)
        found.append(self.missing(10.0, 1.0))

    for name in 'ab':
        buffer.put([name], [0.0], 10.0)
    monkeypatch.setattr(JointStateBuffer, '_note', look)
    for name in 'ab':
        buffer.put([name], [0.5], 10.0)
    assert found and not any(found)

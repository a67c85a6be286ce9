# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states as they are expected skip the full checks, with the same outcome."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from tp_controller.ros.loop.expected_state import ExpectedState
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer
from tp_controller.ros.loop.joint_state_cdr import JointStateReader
from tp_controller.solver.compiled import core

NAMES = ['b', 'wheel', 'a']
POSITIONS = [0.2, 7.0, 0.1]
# Receipt, offset of the stamps, limit of the age, newest stamp [s].
TIMES = (5.0, 3.0, 0.1, 1.0)
MAKES = [ExpectedState] if core is None else [ExpectedState, core.ExpectedState]


def message(names, positions, stamp=2.0, velocities=()):
    """Return a serialized joint state."""
    found = JointState(name=names, position=positions, velocity=velocities)
    found.header.frame_id = 'base'
    found.header.stamp.sec = math.floor(stamp)
    found.header.stamp.nanosec = min(round(1e9 * (stamp - math.floor(stamp))), 999_999_999)
    return bytes(serialize_message(found))


LAST = message(NAMES, POSITIONS)


def mask_of(raw):
    """Return the mask of what counts before the positions of a message."""
    reader = JointStateReader()
    for _ in range(2):
        reader.read(raw)
    return reader.mask


def made(make):
    """Return what is expected after the last message, and positions (a, b, c) of a buffer."""
    positions = np.array([0.1, 0.2, 9.0])
    return make(LAST, mask_of(LAST), [0, 2], [1, 0], [0.25, 0.1], [0.1, 0.2], positions), positions


@pytest.fixture(params=MAKES)
def expected(request):
    """Return what is expected after the last message, and the positions of a buffer."""
    return made(request.param)


def test_a_message_as_expected_is_stored_joint_by_joint(expected):
    state, positions = expected
    assert state.read(message(NAMES, [0.29, math.nan, -0.09], 2.0), *TIMES) == 2.0
    np.testing.assert_array_equal(positions, [-0.09, 0.29, 9.0])
    # Now the distance to the last position counts, too.
    assert state.read(message(NAMES, [0.29, 7.0, 0.2], 2.0), *TIMES) is None
    np.testing.assert_array_equal(positions, [-0.09, 0.29, 9.0])


@pytest.mark.parametrize('raw', [
    message(NAMES, [0.31, 7.0, 0.1]),
    message(NAMES, [0.2, 7.0, math.nan]),
    message(NAMES, [0.2, 7.0, -math.inf]),
    message(NAMES, [0.14, 7.0, 0.1]),
    message(['a', 'wheel', 'b'], POSITIONS),
    message(NAMES, POSITIONS[:2]),
    message(NAMES, POSITIONS, velocities=[0.0]),
    message(NAMES, POSITIONS, 0.999),
    message(NAMES, POSITIONS, 1.89),
    message(NAMES, POSITIONS, 2.11),
    b'\x00\x00' + LAST[2:], LAST[:-1], LAST + b'\x00', b''], ids=[
    'too far', 'nan', 'infinite', 'far from the reference', 'names', 'fewer positions',
    'velocities', 'overtaken', 'late', 'ahead', 'byte order', 'shorter', 'longer', 'empty'])
def test_any_other_message_is_left_to_the_full_checks(expected, raw):
    state, positions = expected
    assert state.read(raw, *TIMES) is None
    np.testing.assert_array_equal(positions, [0.1, 0.2, 9.0])


def test_a_message_without_a_stamp_has_no_age(expected):
    state, _ = expected
    assert state.read(message(NAMES, POSITIONS, 0.0), *TIMES) == 0.0


BYTES = st.lists(st.tuples(st.integers(0, len(LAST) - 1), st.integers(0, 255)), max_size=2)
NUMBERS = st.floats(0.05, 0.35) | st.sampled_from([math.nan, math.inf, -math.inf, 1e300])
RAWS = st.builds(message, st.just(NAMES), st.lists(NUMBERS, min_size=3, max_size=3),
                 st.sampled_from([0.0, 0.5, 1.0, 1.9, 2.0, 2.1]) | st.floats(0.0, 4.0))


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
@settings(max_examples=500, deadline=None)
@given(st.lists(st.tuples(RAWS, BYTES, st.sampled_from([0.1, math.inf]),
                          st.sampled_from([3.0, 2.9, math.inf])), min_size=1, max_size=8))
def test_the_compiled_state_expects_what_its_reference_does(messages):
    (state, positions), (twin, others) = map(made, MAKES)
    for raw, changes, limit, offset in messages:
        changed = bytearray(raw)
        for index, value in changes:
            changed[index] = value
        given_times = (5.0, offset, limit, -math.inf)
        assert state.read(bytes(changed), *given_times) == twin.read(bytes(changed), *given_times)
        np.testing.assert_array_equal(positions, others)


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
@pytest.mark.parametrize('changes', [
    {'mask': b'x' * len(LAST)}, {'source': [0, 20]}, {'source': [0, -1]}, {'rows': [0, 3]},
    {'rows': [0]}, {'reference': [0.0]}, {'passable': []}, {'positions': np.zeros((2, 2))},
    {'positions': np.zeros(3, dtype=int)}, {'positions': None}, {'rows': ['a', 'b']}])
def test_the_compiled_state_refuses_what_does_not_fit(changes):
    given = {'raw': LAST, 'mask': mask_of(LAST), 'source': [0, 2], 'rows': [1, 0],
             'reference': [0.0, 0.0], 'passable': [1.0, 1.0], 'positions': np.zeros(3), **changes}
    with pytest.raises(ValueError, match='do not fit together'):
        core.ExpectedState(*given.values())


# Buffers ----------------------------------------------------------------------------------------


class Pair:
    """Two buffers that hear the same: one with and one without expectations."""

    def __init__(self):
        self.reader, self.expected = JointStateReader(), 0
        self.buffers = [JointStateBuffer(
            ['a', 'b'], ['p'], [0.0], np.ones(2), np.array([False, True]), late=0.1,
            tolerance=0.05) for _ in range(2)]

    def hear(self, raw, now, clock):
        """Take a message in both buffers; compare them."""
        one, other = self.buffers
        faults = []
        names, positions, stamp = self.reader.read(raw)
        if one.put_expected(raw, now, clock):
            self.expected += 1
            faults.append('')
        else:
            faults.append(one.put(names, positions, now, stamp, clock))
            one.expect(raw, self.reader.mask)
        faults.append(other.put(names, positions, now, stamp, clock))
        assert faults[0] == faults[1]
        self.compare(now)

    def discard(self):
        """Discard the positions of both."""
        for each in self.buffers:
            each.discard()

    def compare(self, now):
        """Compare what the buffers know."""
        one, other = self.buffers
        for buffer in self.buffers:
            buffer.known = [
                buffer.take_complete(), buffer.unheard(), buffer.contradiction,
                buffer.lasting(now), buffer.delay, buffer.whole_valid,
                [buffer.missing(now, timeout) for timeout in (0.01, 0.05)],
                [vars(receipt) for receipt in buffer._receipts], buffer._history.due]
        assert one.known == other.known
        np.testing.assert_array_equal(one._positions, other._positions)


def test_messages_of_one_publisher_are_expected_from_the_third_on():
    pair = Pair()
    for number in range(100):
        now = 10.0 + 0.01 * number
        pair.hear(message(['p', 'b', 'x', 'a'], [0.0, 0.003 * number, 5.0, -0.001 * number],
                          now), now, now)
    # A reference is replaced every 0.1 s.
    assert 85 <= pair.expected <= 90


def test_a_clock_that_is_set_back_is_noticed_by_a_message_as_expected():
    pair = Pair()
    raw = message(['a', 'b'], [0.0, 0.0], 0.0)
    for number in range(8):
        pair.hear(raw, 10.0 + 0.01 * number, 10.0 + 0.01 * number)
    pair.hear(raw, 10.08, 10.04)
    assert pair.expected == 6


def test_a_passive_joint_that_was_not_heard_is_once_it_is():
    pair = Pair()
    for number, position in enumerate([math.nan, math.nan, 0.01]):
        now = 10.0 + 0.01 * number
        pair.hear(message(['a', 'b', 'p'], [0.0, 0.0, position], now), now, now)
    assert not pair.buffers[0].unheard()


SPEAKERS = st.sampled_from([['a', 'b']] * 6 + [['b', 'x', 'a', 'p'], ['b'], ['a', 'a'], ['p']])
FAULTS = ['nan', 'jump', 'discard', 'late', 'overtaken', 'no stamp', 'ahead', 'set back',
          'short']
# Mostly nothing is wrong.
STEPS = st.lists(st.tuples(SPEAKERS, st.lists(st.floats(-0.06, 0.06), min_size=4, max_size=4),
                           st.sampled_from([''] * 12 + FAULTS)), min_size=1, max_size=40)


@settings(max_examples=300, deadline=None)
@given(STEPS, st.sampled_from([50.0, -0.065]))
def test_a_buffer_knows_the_same_with_and_without_expectations(steps, clock):
    pair, now = Pair(), 10.0
    for names, positions, wrong in steps:
        now, clock = now + 0.01, clock + 0.01
        positions, stamp = positions[:len(names)], 2.0 + clock
        if wrong == 'nan':
            positions[-1] = math.nan
        if wrong == 'jump':
            positions[0] += 1.0
        if wrong == 'short':
            positions.pop()
        if wrong == 'discard':
            pair.discard()
        clock -= 0.025 if wrong == 'set back' else 0.0
        stamp += {'late': -0.3, 'overtaken': -0.05, 'ahead': 0.3}.get(wrong, 0.0)
        pair.hear(message(names, positions, 0.0 if wrong == 'no stamp' else stamp), now, clock)

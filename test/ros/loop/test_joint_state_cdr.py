# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint states on the wire are read as rclpy reads them."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from tp_controller.ros.loop.joint_state_cdr import JointStateReader

TEXTS = st.text(st.characters(exclude_characters='\0', exclude_categories=['Cs']), max_size=9)
NUMBERS = st.lists(st.floats(allow_infinity=True, allow_nan=True), max_size=5)
MESSAGES = st.builds(
    lambda frame, name, position, velocity, stamp: make(frame, name, position, velocity, stamp),
    TEXTS, st.lists(TEXTS, max_size=5), NUMBERS, NUMBERS,
    st.tuples(st.integers(-2 ** 31, 2 ** 31 - 1), st.integers(0, 2 ** 32 - 1)))


def make(frame, name, position, velocity, stamp):
    """Return a joint state."""
    message = JointState(name=name, position=position, velocity=velocity)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    return message


def check(reader, message):
    """Compare what a reader says with the message."""
    raw = bytes(serialize_message(message))
    expected = deserialize_message(raw, JointState)
    names, positions, stamp = reader.read(raw)
    assert list(names) == expected.name
    np.testing.assert_array_equal(np.asarray(positions), expected.position)
    seconds = expected.header.stamp
    assert stamp == seconds.sec + 1e-9 * seconds.nanosec


@given(st.lists(MESSAGES, min_size=1, max_size=4))
def test_messages_that_alternate_are_read_as_rclpy_does(messages):
    reader = JointStateReader()
    for message in [*messages, *messages]:
        check(reader, message)


@given(st.lists(TEXTS, min_size=1, max_size=5), NUMBERS, NUMBERS)
def test_positions_are_found_whatever_their_number(names, one, other):
    reader = JointStateReader()
    for positions in (one, other, one):
        check(reader, make('', names, positions, [], (1, 2)))


def test_names_that_are_known_are_not_read_again(monkeypatch):
    reader = JointStateReader()
    message = make('base', ['a', 'bcd'], [1.0, 2.0], [3.0], (4, 5))
    check(reader, message)
    monkeypatch.setattr('tp_controller.ros.loop.joint_state_cdr.deserialize_message',
                        lambda *_: pytest.fail('read as objects'))
    for positions in ([0.5, 0.25], [], [1.0]):
        message.position = positions
        names, found, stamp = reader.read(bytes(serialize_message(message)))
        assert (names, list(found), stamp) == (('a', 'bcd'), positions, 4.000000005)


def test_publishers_that_change_their_names_do_not_fill_the_memory():
    reader = JointStateReader()
    for number in range(100):
        check(reader, make('x' * number, ['a'], [1.0], [], (0, 0)))
    assert len(reader._known) <= 10


@given(st.lists(st.binary(min_size=3, max_size=3), min_size=1, max_size=4))
def test_what_is_between_the_fields_says_nothing(fillers):
    frame, name = 'base', 'ab'
    raw = bytes(serialize_message(make(frame, [name], [1.0, 2.0], [], (3, 4))))
    behind = raw.index(frame.encode()) + len(frame) + 1
    reader = JointStateReader()
    for filler in fillers:
        names, positions, stamp = reader.read(raw[:behind] + filler + raw[behind + 3:])
        assert (list(names), list(positions), stamp) == ([name], [1.0, 2.0], 3.000000004)
    # Nor is it another beginning, which would have to be read as objects.
    assert len(reader._known) == 1

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages of numbers are those that rclpy would serialize."""

from types import SimpleNamespace

from geometry_msgs.msg import TwistStamped
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from std_msgs.msg import Float64MultiArray
from tp_controller.ros.loop.numbers_publisher import NumbersPublisher
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


@pytest.fixture
def sent():
    """Return the list of messages that the node of the same name publishes."""
    return []


@pytest.fixture
def node(sent):
    """Return what a publisher needs of a node."""
    return SimpleNamespace(create_publisher=lambda *_: SimpleNamespace(publish=sent.append))


@pytest.mark.parametrize('count', [0, 1, 7])
def test_numbers_are_those_that_were_given_last(node, sent, count):
    publisher = NumbersPublisher(node, Float64MultiArray(data=[0.0] * count), count, 'topic', 10)
    for numbers in (np.arange(float(count)), np.arange(2.0 * count)[::2]):
        publisher.publish(numbers)
        assert list(deserialize_message(sent[-1], Float64MultiArray).data) == list(numbers)
        assert publisher.is_own(sent[-1])
    assert not publisher.is_own(sent[-1] + b'\0')


def test_a_stamp_is_the_time_of_its_message(node, sent):
    times = iter([3_000_000_004, 2**31 * 10**9 - 1])
    clock = SimpleNamespace(now=lambda: Time(nanoseconds=next(times)))
    message = TwistStamped()
    message.header.frame_id = 'base'
    publisher = NumbersPublisher(node, message, 6, 'topic', 10, clock)
    for stamp in [(3, 4), (2**31 - 1, 10**9 - 1)]:
        publisher.publish(np.arange(6.0))
        found = deserialize_message(sent[-1], TwistStamped)
        assert (found.header.stamp.sec, found.header.stamp.nanosec) == stamp
        assert (found.header.frame_id, found.twist.angular.z) == ('base', 5.0)


@pytest.mark.parametrize('count', [0, 1, 7])
def test_a_trajectory_has_its_positions_and_its_time(node, sent, count):
    marks = np.pi * np.arange(1.0, count + 1.0)
    names = [f'joint{number}' for number in range(count)]
    message = JointTrajectory(joint_names=names, points=[JointTrajectoryPoint(positions=marks)])
    publisher = NumbersPublisher(node, message, count, 'topic', 10, marks=marks)
    for seconds in (0.02, 1.5):
        publisher.set_time_from_start(seconds)
        publisher.publish(np.arange(float(count)))
        found = deserialize_message(sent[-1], JointTrajectory)
        point, = found.points
        assert (found.joint_names, list(point.positions)) == (names, list(range(count)))
        assert not point.velocities and not point.accelerations and not point.effort
        if count:
            time = point.time_from_start
            assert time.sec + 1e-9 * time.nanosec == pytest.approx(seconds)
        assert len(sent[-1]) <= len(serialize_message(message))

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals as messages: what a client makes is what the controller reads."""

import math

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped, TwistStamped
import pytest
from sensor_msgs.msg import JointState
from tp_controller.errors import GoalError
from tp_controller.ros.client.goal_fields import FIELDS, make_message
from tp_controller.ros.interface.goal_messages import FEED_FORWARD, GOALS, messages_of
from tp_controller.tasks import BoundedTask, GradientTask, task_types

XYZ, QUAT_XYZW = (1.0, 2.0, 3.0), (0.1, 0.2, 0.3, 0.9)
LINEAR, ANGULAR = (0.1, 0.2, 0.3), (0.4, 0.5, 0.6)


@pytest.mark.parametrize('entry, fields, goal, feed_forward', [
    (GOALS['point'], {'xyz': XYZ}, XYZ, None),
    (GOALS['direction'], {'xyz': XYZ}, XYZ, None),
    (GOALS['quaternion'], {'quat_xyzw': QUAT_XYZW}, QUAT_XYZW, None),
    (GOALS['pose'], {'xyz': XYZ, 'quat_xyzw': QUAT_XYZW}, XYZ + QUAT_XYZW, None),
    (GOALS['joints'], {'joints': {'b': 2.0, 'a': 1.0}}, {'a': 1.0, 'b': 2.0}, None),
    (GOALS['joints'], {'velocities': {'b': 2.0}}, None, {'b': 2.0}),
    (GOALS['joints'], {'joints': {'a': 1.0}, 'velocities': {'a': 3.0}}, {'a': 1.0}, {'a': 3.0}),
    (GOALS['joint_velocities'], {'velocities': {'a': 1.0}}, {'a': 1.0}, None),
    (FEED_FORWARD['twist'], {'linear': LINEAR, 'angular': ANGULAR}, None, LINEAR + ANGULAR),
    (FEED_FORWARD['twist'], {'linear': LINEAR}, None, (*LINEAR, 0.0, 0.0, 0.0)),
    (FEED_FORWARD['twist'], {'angular': ANGULAR}, None, (0.0, 0.0, 0.0, *ANGULAR)),
])
def test_the_controller_reads_what_the_client_writes(entry, fields, goal, feed_forward):
    message = make_message('task', entry.kind, fields)
    assert type(message) is entry.kind
    assert entry.goal(message) == goal
    assert entry.feed_forward(message) == feed_forward


@pytest.mark.parametrize('kind, fields, told', [
    (PointStamped, {'quat_xyzw': QUAT_XYZW}, 'needs xyz (PointStamped), got quat_xyzw'),
    (PoseStamped, {'xyz': XYZ}, 'needs xyz and quat_xyzw (PoseStamped), got xyz'),
    (QuaternionStamped, {}, 'needs quat_xyzw (QuaternionStamped), got nothing'),
    (JointState, {'xyz': XYZ}, 'needs joints or velocities (JointState), got xyz'),
    (JointState, {}, 'got nothing'),
    (JointState, {'joints': {'a': 1.0}, 'velocities': {'b': 1.0}}, 'for the same joints'),
    (TwistStamped, {}, 'needs linear or angular (TwistStamped), got nothing'),
    (TwistStamped, {'linear': LINEAR, 'xyz': XYZ}, 'got linear and xyz'),
])
def test_a_goal_that_does_not_fit_the_task_is_refused_with_what_fits(kind, fields, told):
    with pytest.raises(GoalError) as error:
        make_message('task', kind, fields)
    assert told in str(error.value)


@pytest.mark.parametrize('message, told', [
    (JointState(name=['a', 'b'], position=[1.0]), '2 joints with 1 positions'),
    (JointState(name=['a'], position=[1.0, 2.0]), '1 joints with 2 positions'),
    (JointState(name=['a', 'a'], position=[1.0, 2.0]), 'a joint is named twice: a, a'),
])
def test_names_and_positions_must_match(message, told):
    with pytest.raises(GoalError) as error:
        GOALS['joints'].goal(message)
    assert str(error.value) == told


def test_joints_without_names_are_meant_in_their_order():
    assert GOALS['joints'].goal(JointState(position=[1.0, math.inf])) == [1.0, math.inf]


def test_an_empty_message_holds_neither_goal_nor_velocity():
    assert GOALS['joints'].goal(JointState(name=['a'])) is None
    assert GOALS['joints'].feed_forward(JointState(name=['a'])) is None


def test_every_type_of_task_can_be_told_what_to_do():
    for name, task_type in task_types().items():
        entries = messages_of(task_type)
        # Only inequality tasks, and those that maximize a function, take no goal.
        assert entries or issubclass(task_type, (BoundedTask, GradientTask)), name
        assert len({entry.topic for entry in entries}) == len(entries), name
        assert all(entry.kind in FIELDS for entry in entries if entry.topic != 'obstacles'), name

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The service that tells where the goals in force lead, and moves nothing."""

import json

from geometry_msgs.msg import PointStamped
from harness import Arm, Status
import numpy as np
import pytest
from robots import planar
from std_srvs.srv import Trigger

STACK = '- tip: {type: position, frame: link3, axes: xy}\n- last: {type: joint, joints: joint3}\n'


@pytest.fixture
def rig(any_harness):
    """Return a function that sends a goal and returns the answer of the service."""
    any_harness.controller(stack=STACK)
    status, arm = Status(any_harness), Arm(any_harness)
    any_harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    goals = any_harness.publisher(PointStamped, '/tp_controller/tip/goal')

    def ask(*place):
        accepted = int(status.task('tip')['goals accepted'] or 0)
        message = PointStamped()
        message.point.x, message.point.y = place
        goals.publish(message)
        any_harness.spin_until(
            lambda: int(status.task('tip')['goals accepted'] or 0) > accepted,
            meanwhile=arm.publish)
        return any_harness.call(Trigger, '/tp_controller/solve_position', arm.publish)

    return ask


def test_answer_is_the_configuration_at_which_the_goals_are_reached(rig):
    answer = rig(1.0, 0.6)
    assert answer.success
    found = json.loads(answer.message)
    assert list(found['q']) == ['joint1', 'joint2', 'joint3']
    np.testing.assert_allclose(
        planar().state(list(found['q'].values())).position('link3')[:2], [1.0, 0.6], atol=1e-6)


def test_reason_is_in_the_answer_where_a_goal_is_out_of_reach(rig):
    answer = rig(2.25, 0.0)
    assert not answer.success
    reasons = json.loads(answer.message)['reasons']
    assert reasons['tip'] == 'out of reach by 0.5 m'


def test_service_needs_joint_positions(any_harness):
    any_harness.controller(stack=STACK)
    answer = any_harness.trigger('solve_position')
    assert not answer.success
    assert answer.message == 'no joint positions yet'

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Deadlines and liveliness: what is promised about commands and requested of joint states."""

from geometry_msgs.msg import TwistStamped
from harness import Arm, COMMANDS, Status
import pytest
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile
from robots import PANDA_DH
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

Q = (0.0, 0.6, 0.3)
LEASE = Duration(seconds=1.0)


def profile(deadline=0.0, **policies):
    """Return what one side requests or promises."""
    qos = QoSProfile(depth=50, **policies)
    if deadline:
        qos.deadline = Duration(seconds=deadline)
    return qos


class Receiver:
    """Somebody who requests something about commands."""

    def __init__(self, harness, qos, kind=Float64MultiArray, topic=COMMANDS):
        self.messages, self.refused, self.missed, self.lost = [], [], [], []
        harness.node.create_subscription(
            kind, topic, self.messages.append, qos,
            event_callbacks=SubscriptionEventCallbacks(
                deadline=self.missed.append, incompatible_qos=self.refused.append,
                liveliness=self.lost.append))


@pytest.mark.parametrize('kind, topic, parameters', [
    (Float64MultiArray, COMMANDS, {}),
    (TwistStamped, '/cmd_vel', {'robot': str(PANDA_DH), 'base': 'planar',
                                'stack': '- rest: {type: posture}'})])
def test_receivers_get_what_they_request_where_it_is_promised(any_harness, kind, topic,
                                                              parameters):
    promised = Receiver(any_harness, profile(0.5, liveliness=LivelinessPolicy.AUTOMATIC,
                                             liveliness_lease_duration=LEASE), kind, topic)
    plain = Receiver(any_harness, 10, kind, topic)
    too_much = Receiver(any_harness, profile(0.1), kind, topic)
    controller = any_harness.controller(command_deadline=0.5, **parameters)
    any_harness.spin_until(lambda: len(promised.messages) > 5 and len(plain.messages) > 5
                           and too_much.refused)
    assert not promised.refused and not plain.refused and not promised.missed
    assert promised.lost[-1].alive_count == 1 and not too_much.messages
    # Nothing is commanded any more, but the node lives.
    controller.trigger_deactivate()
    any_harness.spin_until(lambda: promised.missed)
    assert promised.lost[-1].alive_count == 1
    any_harness.remove(controller)
    any_harness.spin_until(lambda: promised.lost[-1].alive_count == 0)


def test_without_a_parameter_no_deadline_is_promised(harness):
    plain, asking = Receiver(harness, 10), Receiver(harness, profile(5.0))
    harness.controller()
    harness.spin_until(lambda: len(plain.messages) > 5 and asking.refused)
    assert not asking.messages and not plain.refused


def missed(status):
    """Return how many deadlines were missed, as the status says."""
    values = {value.key: value.value for value in status.messages[-1].status[0].values}
    return int(values['missed deadlines'])


def test_a_deadline_that_joint_states_miss_is_counted_and_logged(any_harness, log):
    any_harness.controller(state_deadline=0.2, state_timeout=5.0)
    status = Status(any_harness)
    arm = Arm(any_harness, Q, qos=profile(0.1))
    any_harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    before = missed(status)
    any_harness.spin_until(lambda: missed(status) > before + 1)
    # It is no reason to stop: that is for `state_timeout`.
    assert status.head == 'running' or 'stood still' in status.head
    any_harness.spin_until(lambda: 'no joint state for 0.2 s (parameter state_deadline)' in log())


def test_a_publisher_that_promises_no_deadline_is_named_and_not_heard(any_harness, log):
    any_harness.controller(state_deadline=0.2)
    status, written = Status(any_harness), []
    arm = Arm(any_harness, Q, connected=False)

    def told():
        written.append(log())
        return 'incompatible QoS: a publisher of joint states offers no deadline' in ''.join(
            written)

    any_harness.spin_until(told, meanwhile=arm.publish)
    any_harness.spin_for_more(status.messages, 3, arm.publish)
    assert status.head == 'no joint states of joint1, joint2, joint3'


def test_the_simulator_promises_the_deadline_that_a_controller_requests(any_harness):
    """What promises none is not heard; see above."""
    any_harness.simulator(state_deadline=0.5)
    any_harness.controller(state_deadline=0.5)
    status, too_much = Status(any_harness), Receiver(any_harness, profile(0.1), JointState,
                                                     '/joint_states')
    any_harness.spin_until(lambda: status.head == 'running' and too_much.refused)
    assert not too_much.messages

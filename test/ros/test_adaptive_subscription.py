# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals and commands are heard whatever their publishers promise, and count once."""

from geometry_msgs.msg import TwistStamped
from harness import Arm, COMMANDS, JOINTS, Status
from nav_msgs.msg import Odometry
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Int32
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.watchdog_node import WatchdogNode

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_a_goal_of_a_best_effort_publisher_is_taken(any_harness):
    harness = any_harness
    harness.controller(state_timeout=5.0)
    arm, status = Arm(harness), Status(harness)
    publisher = harness.publisher(JointState, '/tp_controller/swing/goal', BEST_EFFORT)
    publisher.publish(JointState(name=['joint1'], position=[0.25]))
    harness.spin_until(lambda: status.task('swing')['goals accepted'] == '1',
                       meanwhile=arm.publish)


def test_the_simulator_receives_commands_of_best_effort_publishers(any_harness):
    harness = any_harness
    harness.simulator(base='planar')
    states = harness.record(JointState, '/joint_states')
    odometry = harness.record(Odometry, '/odom')
    commands = harness.publisher(Float64MultiArray, COMMANDS, BEST_EFFORT)
    drive = harness.publisher(TwistStamped, '/cmd_vel', BEST_EFFORT)
    message = TwistStamped()
    message.twist.linear.x = 0.2

    def publish():
        commands.publish(Float64MultiArray(data=[0.1] * len(JOINTS)))
        drive.publish(message)

    harness.spin_until(lambda: states and states[-1].velocity[0] > 0.0, 'motion', publish)
    harness.spin_until(lambda: odometry and odometry[-1].twist.twist.linear.x > 0.0, 'motion',
                       publish)


@pytest.mark.parametrize('kind, topic', [
    (Float64MultiArray, COMMANDS), (TwistStamped, '/cmd_vel')])
def test_a_watchdog_receives_commands_of_best_effort_publishers(harness, log, kind, topic):
    harness.make(WatchdogNode, base='planar', timeout=0.1)
    publisher, message = harness.publisher(kind, topic, BEST_EFFORT), kind()
    if kind is TwistStamped:
        message.twist.linear.x = 0.2
    else:
        message.data = [0.1]
    publisher.publish(message)
    harness.spin_until_logged(log, f'no command on {topic} for 0.1 s; publishing zeros')


def test_messages_of_both_kinds_of_publishers_count_once_each(harness):
    taken = []
    subscription = AdaptiveSubscription(harness.node, Int32, '/numbers', taken.append)
    reliable = harness.publisher(Int32, '/numbers', 50)
    assert len(list(harness.node.subscriptions)) == 1
    best_effort = harness.publisher(Int32, '/numbers', BEST_EFFORT)
    harness.spin_until(lambda: reliable.get_subscription_count() == 2, 'the second subscription')
    assert len(list(harness.node.subscriptions)) == 2
    for number in range(0, 20, 2):
        for publisher, data in ((reliable, number), (best_effort, number + 1)):
            publisher.publish(Int32(data=data))
            harness.spin_until(lambda data=data: data in [each.data for each in taken])
    reliable.publish(Int32(data=20))
    harness.spin_until(lambda: taken[-1].data == 20)
    assert sorted(each.data for each in taken) == list(range(21))
    subscription.close()
    assert not list(harness.node.subscriptions)


def test_a_second_best_effort_publisher_needs_no_third_subscription(harness):
    subscription = AdaptiveSubscription(harness.node, Int32, '/numbers', lambda message: None)
    publishers = [harness.publisher(Int32, '/numbers', BEST_EFFORT) for _ in range(3)]
    for _ in range(20):
        harness.executor.spin_once(timeout_sec=0.005)
    assert [each.get_subscription_count() for each in publishers] == [1, 1, 1]
    assert len(list(harness.node.subscriptions)) == 2
    subscription.close()

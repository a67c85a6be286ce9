# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Answers every joint state with a command at once: the least that a node can do."""

from array import array

import rclpy
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller.ros.loop.deadlines import state_qos
from tp_controller.ros.loop.outputs import VelocityOutput
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.ros.runner import make_executor, SPIN_SECONDS


def main():
    """Answer until somebody ends the process."""
    set_up_fast_dds()
    rclpy.init()
    node = Node('echo')
    answer = Float64MultiArray(data=array('d', bytes(8 * 7)))
    publisher = node.create_publisher(Float64MultiArray, VelocityOutput.topic, 10)
    node.create_subscription(JointState, 'joint_states', lambda _: publisher.publish(answer),
                             state_qos(0.0))
    executor = make_executor(node.context)
    executor.add_node(node)
    executor.spin_until_future_complete(Future(executor=executor), SPIN_SECONDS)


if __name__ == '__main__':
    main()

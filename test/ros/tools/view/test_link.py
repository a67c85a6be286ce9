# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page finds the topics of the controller's robot, by whatever names."""

from harness import parts
import pytest
from robots import moving_panda, PANDA_DH
from tp_controller.ros.client.client import Client
from tp_controller.ros.controller_node import ControllerNode
from tp_controller.ros.simulator_node import SimulatorNode
from tp_controller.tools.view.link import Link

STACK = '- rest: {type: posture}'
TOPICS = 'joint_states', 'robot_description', 'odom'
REMAPPED = [word for topic in TOPICS for word in ('-r', f'{topic}:=another/{topic}')]


@pytest.fixture
def link(harness):
    """Return a link to a controller of this name."""
    client = Client(context=harness.context)
    yield Link(client)
    client.close()


@pytest.mark.parametrize('arguments', [(), ('--ros-args', *REMAPPED)], ids=['usual', 'remapped'])
@pytest.mark.parametrize('base', ['fixed', 'planar'])
def test_robot_and_its_configuration_are_found_by_whatever_names(harness, link, arguments, base):
    harness.make(SimulatorNode, arguments=arguments, robot=str(PANDA_DH), base=base)
    controller = harness.make(ControllerNode, arguments=arguments, stack=STACK, base=base,
                              exclusive=False)
    # The graph is known to the page before it has a robot.
    harness.spin_until(lambda: all(
        link.client.node.get_subscriber_names_and_types_by_node(each.get_name(), '/')
        for each in parts(controller)), 'the topics of the controller')

    def is_shown():
        link.update()
        link.watch(True)
        return link.q is not None

    harness.spin_until(is_shown, 'the configuration')
    assert link.robot.joint_names == moving_panda('planar').joint_names
    assert link.q.size == (7 if base == 'fixed' else link.robot.nq)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A moving base with an arm: killed controllers, killed and suspended watchdogs, by output."""

import re
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from test_position_processes import Positions
from test_processes import heads, JOINTS, LIMITED
from tp_controller.ros.declarations.controller import OUTPUTS
from tp_controller.ros.loop.base_topics import twist_of
from tp_controller.ros.loop.outputs import output_type

__all__ = ['heads']
STACK = '[{drive: {type: base_pose}}, {swing: {type: joint, joints: [joint1, joint2, joint3], ' \
    'target: [300, 200, 100]}}]'
# Motion that goes on for as long as any test takes, of joints that do not turn the shorter way.
WIDE = [each for name in JOINTS for each in ('-p', f'limits.{name}.lower:=-400.0',
                                             '-p', f'limits.{name}.upper:=400.0')]
FAR = {'xyz': (1000.0, 0.0, 0.0), 'quat_xyzw': (0.0, 0.0, 0.0, 1.0)}
PLANAR = '-p', 'base:=planar'
# A busy machine does not stop the robot for some seconds.
TIRELESS = '-p', 'state_timeout:=5.0', '-p', 'watchdog_timeout:=5.0'
# From the end of a watchdog to the stop of the robot, as docs/safety.md has it [s].
NOTICED = 1.2


class Vehicle:
    """What a base and its arm are commanded, and how they move."""

    def __init__(self, listener, output):
        self._listener = listener
        self.holds = output != 'velocity'
        self.positions = Positions(listener)
        # (time [s], whether it moves the base), and the same of odometry.
        self.base, self.driven = [], []
        self._told = []
        node = listener.client.node
        node.create_subscription(
            TwistStamped, '/cmd_vel', lambda message, info: self.base.append(
                (1e-9 * info['source_timestamp'], twist_of(message.twist).any())), 5000)
        node.create_subscription(
            Odometry, '/odom', lambda message, info: self.driven.append(
                (1e-9 * info['source_timestamp'], twist_of(message.twist.twist).any())), 5000)
        node.create_subscription(
            DiagnosticArray, '/tp_controller/status',
            lambda message, info: self._told.append(1e-9 * info['source_timestamp']), 5000)

    def moving(self):
        """Return whether base and joints are commanded to move."""
        return bool(self.base) and self.base[-1][1] and (
            self.positions.moving() and not self.positions.stand() if self.holds
            else self._listener.moving())

    def commanded_to_rest(self):
        """Return whether base and joints are commanded to be at rest."""
        return not self.base[-1][1] and (self.positions.stand() if self.holds
                                         else not self._listener.moving())

    def at_rest(self):
        """Return whether base and joints stand still, the joints at the last positions, if any."""
        if not self.driven or not self._listener.states:
            # Nothing of the simulator has arrived yet.
            return False
        q, velocity = self._listener.states[-1]
        return not self.driven[-1][1] and not velocity.any() and (
            not self.holds or np.allclose(q, self.positions.sent[-1][1], atol=0.05))

    def joint_commands(self):
        """Return the number of commands for the joints so far, on any topic."""
        return len(self.positions.sent) + len(self._listener.commands)

    def delay(self, begin):
        """Return the longest times without a status and without a command since a time [s]."""
        return sum(np.diff([begin, *(sent for sent in times if sent > begin)]).max()
                   for times in (self._told, [sent for sent, _ in self.base]))


@pytest.fixture(params=OUTPUTS)
def output(request):
    """Return the output of a controller."""
    return request.param


@pytest.fixture
def vehicle(listener, output):
    """Return what is known of the vehicle."""
    return Vehicle(listener, output)


@pytest.fixture
def drive(start, listener, vehicle, output):
    """Return what starts a controller and a simulator, and has them drive."""
    def drive(*arguments, **options):
        nodes = [start('controller_node', '-p', f"stack:='{STACK}'", '-p', f'output:={output}',
                       *PLANAR, *WIDE, *arguments),
                 start('simulator_node', *PLANAR, *WIDE,
                       *(each for name, value in options.items()
                         for each in ('-p', f'{name}:={value}')))]
        listener.client.send('drive', **FAR, wait=60.0)
        return nodes
    return drive


def test_zeros_for_the_base_replace_a_killed_controller_and_joints_stay(
        start, drive, listener, vehicle, heads, output):
    nodes = drive(*TIRELESS, command_timeout=10.0)
    controller, simulator = nodes
    watchdog = start('watchdog_node', '-p', 'timeout:=1.0', *PLANAR, robot=None)
    nodes.append(watchdog)
    node = listener.client.node
    listener.wait(lambda: len(node.get_publishers_info_by_topic('/cmd_vel')) == 2, 'the watchdog',
                  nodes)
    listener.wait(vehicle.moving, 'motion', nodes)
    # It leaves a controller alone that is there.
    begin = time.time()
    listener.wait(lambda: time.time() > begin + 1.5, 'the end', nodes)
    assert all(moves for sent, moves in vehicle.base if sent > begin)
    controller.process.kill()
    controller.process.wait()
    killed = time.time()
    listener.wait(lambda: vehicle.at_rest() and vehicle.driven[-1][0] > killed, 'rest',
                  [simulator, watchdog])
    listener.wait(lambda: 'no command on /cmd_vel for 1 s' in watchdog.output(), 'the warning',
                  [simulator, watchdog])
    listener.catch_up()
    assert vehicle.driven[-1][0] - killed < 9.0
    topic = f'/{output_type(output).topic}'
    if vehicle.holds:
        # Nobody sends positions, or velocities, in place of the controller.
        assert not listener.commands and vehicle.positions.sent[-1][0] < killed
        assert not [each for each in node.get_publishers_info_by_topic(topic)
                    if each.node_name.endswith('watchdog')]
        vehicle.positions.check()
    else:
        assert f'no command on {topic} for 1 s' in watchdog.output()
    # A new one does not take it for somebody who commands the robot.
    nodes[0], seen = start('controller_node', '-p', f"stack:='{STACK}'", '-p',
                           f'output:={output}', *PLANAR, *WIDE), len(heads)
    begin, count = time.time(), vehicle.joint_commands()
    listener.wait(lambda: vehicle.joint_commands() > count + 10, 'motion', nodes)
    listener.wait(lambda: time.time() > begin + 2.0, 'the end', nodes)
    listener.wait(lambda: heads[seen:] and heads[-1] == 'running', 'the status', nodes)
    assert not [head for head in heads[seen:] if re.search('publish.*, too', head)]


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM])
def test_a_watchdog_of_a_base_that_is_killed_or_suspended_stops_base_and_joints(
        start, drive, listener, vehicle, heads, number):
    nodes = drive('-p', 'require_watchdog:=true', '-p', 'status_rate:=50.0',
                  *(LIMITED if vehicle.holds else ()))
    topic = '/cmd_vel' if vehicle.holds else '/velocity_controller/commands'
    missing = f'no watchdog listens to {topic}'
    listener.wait(lambda: missing in heads, 'the reason', nodes)
    assert not any(moves for _, moves in vehicle.base) and not vehicle.positions.sent
    watchdog = start('watchdog_node', *PLANAR, robot=None)
    listener.wait(vehicle.moving, 'motion', [*nodes, watchdog])
    began = len(heads)
    begin = time.time()
    watchdog.process.send_signal(number)
    listener.wait(lambda: missing in heads[began:], 'the reason', nodes)
    listener.wait(lambda: vehicle.commanded_to_rest() and vehicle.at_rest(), 'rest', nodes)
    stopped = max(sent for sent, moves in vehicle.base if moves)
    # But for what a busy machine is late.
    assert stopped - begin < NOTICED + vehicle.delay(begin)
    if vehicle.holds:
        # The joints brake from 0.6 rad/s with 2 rad/s², 0.09 rad.
        sent = vehicle.positions.since(stopped)
        assert 0.02 < np.abs(sent[-1] - sent[0]).max() < 0.5 or vehicle.positions.late(begin)
        vehicle.positions.check()
    if number == signal.SIGSTOP:
        # ROS takes its topics for there: nothing but its silence tells.
        watchdog.process.send_signal(signal.SIGCONT)
        listener.wait(vehicle.moving, 'motion', [*nodes, watchdog])

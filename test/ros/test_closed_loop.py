# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Controller and simulator together: the loop is closed, on simulated time."""

from geometry_msgs.msg import PoseStamped
from harness import Status
import numpy as np
import pytest
from robots import CONFIG, panda, PANDA_DH, PANDA_READY, PANDA_TOOL
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller.model.spatial import quaternion_from_rotation, rotation_from_rpy
from tp_controller.ros.client.goal_fields import make_message
from trajectory_msgs.msg import JointTrajectory

START = str(dict(zip(panda().joint_names, PANDA_READY)))
STACK = (CONFIG / 'demo_stack.yaml').read_text()
GOAL = {'xyz': (0.45, 0.25, 0.45),
        'quat_xyzw': quaternion_from_rotation(rotation_from_rpy(3.1416, 0.0, 0.4)).tolist()}


class Loop:
    """
    A Panda with the stack of the demo, on simulated time.

    Where the robot has to arrive somewhere, at the speed of real time: all nodes share a thread,
    which takes 0.1 s for a turn on a busy machine, and five times as fast the robot would swing
    around its goal for ever.
    """

    def __init__(self, harness, speed=1.0, rate=50.0, output='velocity', **simulated):
        self.harness = harness
        # Simulated time does not wait for a busy machine, so joint states would be old by stamps.
        # At rate 0 the timeout counts as the period, which bounds the gains.
        harness.controller(robot=str(PANDA_DH), stack=STACK, use_sim_time=True, rate=rate,
                           status_rate=100.0, check_stamps=False,
                           state_timeout=0.3 if rate else 0.1, output=output)
        harness.simulator(robot=str(PANDA_DH), speed=speed, publish_clock=True, rate=50.0,
                          initial_positions=START, **simulated)
        self.commands, self.status = harness.commands(), Status(harness)
        self.states = harness.record(JointState, '/joint_states', 500)
        self._goal = harness.publisher(PoseStamped, '/tp_controller/tool/goal')
        harness.spin_until(lambda: self.status.head == 'running')

    def positions(self):
        """Return lists that grow by commanded positions, and by the times to go there."""
        positions, times = [], []

        def on_point(message):
            point, = message.points
            assert message.joint_names == list(panda().joint_names)
            assert message.header.stamp.sec == message.header.stamp.nanosec == 0
            assert not (point.velocities or point.accelerations or point.effort)
            positions.append(list(point.positions))
            times.append(point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec)

        node = self.harness.node
        node.create_subscription(Float64MultiArray, '/position_controller/commands',
                                 lambda message: positions.append(list(message.data)), 500)
        node.create_subscription(JointTrajectory, '/joint_trajectory_controller/joint_trajectory',
                                 on_point, 500)
        return positions, times

    def send(self, **goal):
        """Send a goal for the tool, and wait for the answer."""
        before = self.status.task('tool')['goals accepted']
        self._goal.publish(make_message('tool', PoseStamped, goal))
        self.harness.spin_until(
            lambda: self.status.task('tool')['goals accepted'] not in ('', before))

    def position(self):
        """Return where the tool is."""
        return panda().state(self.states[-1].position).position(PANDA_TOOL)

    def spin_until_reached(self):
        """Spin until the tool is where it was sent."""
        self.harness.spin_until(lambda: self.status.task('tool')['status'] == 'reached')


@pytest.mark.parametrize('rate', [50.0, 0.0])
def test_a_pose_goal_is_reached_without_exceeding_any_limit(any_harness, rate):
    loop = Loop(any_harness, rate=rate)
    loop.send(**GOAL)
    loop.spin_until_reached()
    # Joint states may still be on their way to this listener.
    any_harness.spin_until(lambda: np.allclose(loop.position(), GOAL['xyz'], atol=2e-3))
    state = panda().state(loop.states[-1].position)
    np.testing.assert_allclose(state.rotation(PANDA_TOOL), rotation_from_rpy(3.1416, 0.0, 0.4),
                               atol=1e-2)
    assert (np.abs(loop.commands) <= panda().velocity).all()
    q = np.array([message.position for message in loop.states])
    # While a busy machine delays the controller, the simulated robot goes on with the last
    # command, for up to half a second.
    beyond = np.maximum(panda().lower - q, q - panda().upper).max(axis=0)
    delayed = len(loop.commands) < 0.95 * len(loop.states)
    assert (beyond < (0.5 * panda().velocity if delayed else 0.0)).all()


@pytest.mark.parametrize('output', ['position', 'trajectory'])
@pytest.mark.parametrize('rate', [50.0, 0.0])
def test_a_pose_goal_is_reached_by_commanded_positions_which_a_stop_holds(harness, rate, output):
    loop = Loop(harness, rate=rate, output=output, lag=0.05)
    positions, times = loop.positions()
    # They begin where the robot is.
    harness.spin_for_more(positions)
    np.testing.assert_allclose(positions[0], PANDA_READY, atol=1e-2)
    loop.send(**GOAL)
    loop.spin_until_reached()
    harness.spin_until(lambda: np.allclose(loop.position(), GOAL['xyz'], atol=2e-3))
    assert harness.trigger('stop').success
    harness.spin_until(lambda: loop.status.head.startswith('stopped'))
    still = harness.spin_for_more(positions, 20)
    assert still[-1] == still[-10] and not loop.commands
    # And the robot is there, which goes on from there.
    harness.spin_until(lambda: np.allclose(loop.states[-1].position, still[-1], atol=1e-3))
    assert harness.trigger('start').success
    harness.spin_until(lambda: loop.status.head == 'running')
    harness.spin_for_more(positions, 20)
    np.testing.assert_allclose(positions[-20:], still[-1:] * 20, atol=5e-3)
    found = np.array(positions)
    assert (found >= panda().lower - 1e-9).all() and (found <= panda().upper + 1e-9).all()
    assert bool(times) == (output == 'trajectory')
    assert all(0.02 <= seconds <= 0.31 for seconds in times)


def test_the_error_of_the_tool_decays_with_its_gain(harness):
    loop = Loop(harness)
    loop.send(xyz=(0.35, 0.02, 0.55), quat_xyzw=GOAL['quat_xyzw'])
    del loop.status.messages[:]
    loop.spin_until_reached()
    # On a busy machine the robot may be stopped for a moment.
    entries = [{value.key: value.value for value in message.status[1].values}
               for message in loop.status.messages if message.status[0].message == 'running']
    errors = np.array([float(entry['error [m]']) for entry in entries])
    assert errors[-1] < 1e-3 < errors[0]
    assert (np.diff(errors) <= 1e-4).all()
    # The achieved speed is the demanded one, except where a limit reduces it.
    for entry in entries:
        if not entry['reason']:
            assert float(entry['achieved speed']) == pytest.approx(
                float(entry['wanted speed']), rel=0.02, abs=1e-3)


def test_goals_that_change_all_the_time_never_make_a_command_beyond_a_limit(harness):
    loop = Loop(harness, 2.0)
    random = np.random.default_rng(5)

    def send():
        quat_xyzw = random.standard_normal(4)
        loop._goal.publish(make_message('tool', PoseStamped, {
            'xyz': random.uniform(-1.5, 1.5, 3),
            'quat_xyzw': quat_xyzw / np.linalg.norm(quat_xyzw)}))

    harness.spin_for_more(loop.commands, 150, meanwhile=send)
    assert np.isfinite(loop.commands).all()
    assert (np.abs(loop.commands) <= panda().velocity).all()
    assert np.abs(loop.commands).max() > 1.0


def test_a_goal_out_of_reach_is_approached_and_said_so(harness):
    loop = Loop(harness, 2.0)
    loop.send(xyz=(2.0, 0.0, 0.5), quat_xyzw=GOAL['quat_xyzw'])
    harness.spin_until(lambda: loop.status.task('tool')['status'] == 'limited')
    harness.spin_until(lambda: loop.position()[0] > 0.6)

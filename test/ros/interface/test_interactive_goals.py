# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals that are dragged in RViz: with a stand-in for its package, and with the package."""

import sys
from types import ModuleType

from geometry_msgs.msg import Pose
from harness import Arm, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from tp_controller.model.spatial import quaternion_from_rotation, rotation_from_rpy
from visualization_msgs.msg import (
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    InteractiveMarkerUpdate,
)

STACK = """
- hand: {type: pose, frame: link3}
- tip: {type: position, frame: link3, reference: link1, axes: xy}
- [turn: {type: orientation, frame: link3, axes: z}, joint: {type: joint, joints: joint1}]
- fence: {type: keep_in, frame: link2, shape: {sphere: 9.0}}
"""
Q = (0.0, 0.6, 0.3)
NAMESPACE = '/tp_controller/interactive_goals'


class Rig:
    """A controller of the planar arm at rest, and what shows its goals."""

    def __init__(self, harness, connected=True, **parameters):
        self.harness = harness
        self.controller = harness.controller(stack=STACK, **parameters)
        self.status, self.arm = Status(harness), Arm(harness, Q)
        self.updates = harness.record(InteractiveMarkerUpdate, f'{NAMESPACE}/update', 100)
        self._feedback = harness.publisher(InteractiveMarkerFeedback, f'{NAMESPACE}/feedback',
                                           connected=connected)
        # {name: InteractiveMarker}, as RViz has them
        self.markers, self._read = {}, 0

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def look(self):
        """Take in all updates, and return the markers."""
        for update in self.updates[self._read:]:
            self._read += 1
            for marker in update.markers:
                self.markers[marker.name] = marker
            for moved in update.poses:
                self.markers[moved.name].pose = moved.pose
            for name in update.erases:
                del self.markers[name]
        return self.markers

    def wait_for(self, names):
        """Wait for there to be markers of these names, and no others."""
        self.spin_until(lambda: set(self.look()) == names)

    def place(self, name):
        """Return where a marker is (3,)."""
        point = self.look()[name].pose.position
        return np.array([point.x, point.y, point.z])

    def goal(self, name):
        """Return the goal of a task."""
        return self.controller._robot.controller.stack.tasks[name].goal

    def drag(self, name, xyz, rpy=(0.0, 0.0, 0.0), frame='base_link', key='goals accepted'):
        """
        Drag a marker, until a goal has been counted.

        As RViz does, say where it is again and again: the package takes nothing in the first
        second of a marker.
        """
        def meanwhile():
            self.arm.publish()
            self.feedback(name, xyz, rpy, frame=frame)

        self.harness.spin_until(lambda: self.status.task(name)[key] not in ('', '0'),
                                meanwhile=meanwhile)

    def feedback(self, name, xyz, rpy=(0.0, 0.0, 0.0), frame='base_link',
                 event=InteractiveMarkerFeedback.POSE_UPDATE):
        """Say what somebody does with a marker."""
        message = InteractiveMarkerFeedback(client_id='/rviz', marker_name=name, event_type=event)
        message.header.frame_id, message.pose = frame, to_pose(xyz, rpy)
        self._feedback.publish(message)


def to_pose(xyz, rpy):
    """Return a pose message."""
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = map(float, xyz)
    turn = quaternion_from_rotation(rotation_from_rpy(*rpy)).tolist()
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = turn
    return pose


class StandIn:
    """What this package uses of InteractiveMarkerServer, with the same topics and meanings."""

    def __init__(self, node, namespace):
        self.node, self.markers, self.callbacks, self.pending = node, {}, {}, {}
        self.update_pub = node.create_publisher(InteractiveMarkerUpdate, f'{namespace}/update',
                                                100)
        self.feedback_sub = node.create_subscription(
            InteractiveMarkerFeedback, f'{namespace}/feedback', self.on_feedback, 1)

    def insert(self, marker, *, feedback_callback):
        """Add or replace a marker."""
        self.pending[marker.name], self.callbacks[marker.name] = marker, feedback_callback

    def erase(self, name):
        """Remove a marker."""
        assert name in self.markers
        self.pending[name] = None

    def setPose(self, name, pose):  # noqa: N802, as it is called there
        """Move a marker."""
        assert name in self.markers and name not in self.pending
        self.pending[name] = pose

    def applyChanges(self):  # noqa: N802
        """Publish what has changed."""
        update = InteractiveMarkerUpdate(type=InteractiveMarkerUpdate.UPDATE)
        for name, change in self.pending.items():
            if change is None:
                del self.markers[name]
                update.erases.append(name)
            else:
                if isinstance(change, Pose):
                    self.markers[name].pose = change
                else:
                    self.markers[name] = change
                update.markers.append(self.markers[name])
        if self.pending:
            self.pending = {}
            self.update_pub.publish(update)

    def on_feedback(self, feedback):
        """Hand on what was dragged."""
        if feedback.marker_name in self.markers:
            self.callbacks[feedback.marker_name](feedback)

    def shutdown(self):
        """Remove everything."""
        self.node.destroy_publisher(self.update_pub)
        self.node.destroy_subscription(self.feedback_sub)


@pytest.fixture(params=['stand-in', 'package'])
def server(request, monkeypatch):
    """Have goals that can be dragged, by a stand-in or by the package itself."""
    if request.param == 'package':
        pytest.importorskip('interactive_markers', reason='needs the ROS package '
                            'interactive_markers, which is not on PyPI')
        return
    module = ModuleType('interactive_markers')
    module.InteractiveMarkerServer = StandIn
    monkeypatch.setitem(sys.modules, 'interactive_markers', module)


def test_tasks_whose_goal_is_a_pose_or_a_point_have_a_marker_there(server, harness):
    rig = Rig(harness)
    rig.wait_for({'hand', 'tip', 'fence'})
    state = rig.controller._robot.controller.robot.state(Q)
    for name in ('hand', 'tip'):
        np.testing.assert_allclose(rig.place(name), state.position('link3'), atol=1e-9)
    np.testing.assert_allclose(rig.place('fence'), 0.0, atol=1e-12)
    modes = {name: [control.interaction_mode for control in rig.markers[name].controls]
             for name in rig.markers}
    move, turn = InteractiveMarkerControl.MOVE_AXIS, InteractiveMarkerControl.ROTATE_AXIS
    assert sorted(modes['hand']) == sorted(modes['fence']) == sorted([move, turn] * 3)
    assert modes['tip'] == [move] * 3
    for marker in rig.markers.values():
        assert marker.header.frame_id == 'base_link' and marker.header.stamp.sec == 0
        for control in marker.controls:
            # x turned by the orientation is the axis that the name says.
            w, *xyz = (getattr(control.orientation, each) for each in 'wxyz')
            axis = np.array([1.0, 0.0, 0.0])
            turned = axis + 2.0 * np.cross(xyz, np.cross(xyz, axis) + w * axis)
            assert np.abs(turned).argmax() == 'xyz'.index(control.name[-1])


def test_pose_that_is_dragged_is_a_goal(server, harness):
    rig = Rig(harness)
    rig.wait_for({'hand', 'tip', 'fence'})
    rig.drag('hand', (0.5, 0.4, 0.0), (0.0, 0.0, 0.7))
    np.testing.assert_allclose(rig.goal('hand')[:3, 3], (0.5, 0.4, 0.0))
    np.testing.assert_allclose(rig.goal('hand')[:3, :3], rotation_from_rpy(0.0, 0.0, 0.7),
                               atol=1e-9)
    rig.spin_until(lambda: np.allclose(rig.place('hand'), (0.5, 0.4, 0.0)))


def test_point_that_is_dragged_is_a_goal_in_its_frame(server, harness):
    rig = Rig(harness)
    rig.wait_for({'hand', 'tip', 'fence'})
    rig.drag('tip', (0.3, 0.2, 0.0))
    T = rig.controller._robot.controller.robot.state(Q).pose('link1')
    np.testing.assert_allclose(T[:3, :3] @ rig.goal('tip') + T[:3, 3], (0.3, 0.2, 0.0),
                               atol=1e-9)
    rig.spin_until(lambda: np.allclose(rig.place('tip'), (0.3, 0.2, 0.0)))


@pytest.mark.parametrize('frame, xyz, reason', [
    ('base_link', (5.0, 0.0, 0.0), 'workspace'), ('nowhere', (0.5, 0.1, 0.0), 'nowhere'),
    ('base_link', (np.nan, 0.0, 0.0), 'finite')])
def test_goal_that_is_refused_is_counted_and_the_marker_returns(server, harness, frame, xyz,
                                                                reason):
    rig = Rig(harness, workspace=[-2.0, -2.0, -2.0, 2.0, 2.0, 2.0])
    rig.wait_for({'hand', 'tip', 'fence'})
    before, goal = rig.place('hand'), rig.goal('hand')
    rig.drag('hand', xyz, frame=frame, key='goals refused')
    assert reason in rig.status.task('hand')['last refusal']
    assert rig.goal('hand') is goal
    count = len(rig.updates)
    rig.spin_until(lambda: len(rig.updates) > count)
    rig.spin_until(lambda: np.allclose(rig.place('hand'), before))


def test_only_a_drag_is_a_goal(server, harness):
    rig = Rig(harness)
    rig.wait_for({'hand', 'tip', 'fence'})
    rig.drag('tip', (0.3, 0.2, 0.0))
    before = int(rig.status.task('tip')['goals accepted'])
    drag, drop = InteractiveMarkerFeedback.POSE_UPDATE, InteractiveMarkerFeedback.MOUSE_UP
    for name, event in (('hand', drop), ('nobody', drop), ('turn', drag)):
        rig.feedback(name, (0.5, 0.4, 0.0), event=event)
        # Only the last one waits where they come faster than they are taken.
        harness.spin_for_more(rig.status.messages, 3, rig.arm.publish)
    rig.feedback('tip', (0.3, 0.3, 0.0))
    rig.spin_until(lambda: int(rig.status.task('tip')['goals accepted']) > before)
    assert rig.status.task('hand')['goals accepted'] == '0'
    assert rig.status.task('turn')['goals accepted'] == '0'


def test_markers_follow_the_stack(server, harness):
    rig = Rig(harness)
    rig.wait_for({'hand', 'tip', 'fence'})
    harness.enable('hand', False)
    rig.wait_for({'tip', 'fence'})
    stack = Parameter('stack', value='- tip: {type: pose, frame: link2}')
    assert rig.controller.set_parameters_atomically([stack]).successful
    rig.wait_for({'tip'})
    rig.spin_until(lambda: len(rig.look()['tip'].controls) == 6)
    rig.controller.trigger_deactivate()
    rig.controller.trigger_cleanup()
    rig.wait_for(set())


def test_nothing_is_there_without_the_package(harness, monkeypatch, log):
    monkeypatch.setitem(sys.modules, 'interactive_markers', None)
    rig = Rig(harness, connected=False)
    rig.spin_until(lambda: rig.status.head == 'running')
    assert rig.controller.count_subscribers(f'{NAMESPACE}/feedback') == 0
    assert rig.controller.count_publishers(f'{NAMESPACE}/update') == 0
    assert 'interactive' not in log()


def test_package_that_does_not_work_is_named_and_harms_nothing(harness, monkeypatch, log):
    monkeypatch.setitem(sys.modules, 'interactive_markers', ModuleType('interactive_markers'))
    sys.modules['interactive_markers'].InteractiveMarkerServer = lambda *_: 1 / 0
    rig = Rig(harness, connected=False)
    rig.spin_until(lambda: rig.status.head == 'running')
    assert 'goals cannot be dragged in RViz: ZeroDivisionError' in log()

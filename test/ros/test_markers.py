# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What the controller draws: the markers of its tasks."""

from collections import Counter

from geometry_msgs.msg import PointStamped
from harness import Arm, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from tp_controller.model.spatial import pose, rotation_from_quaternion
from tp_controller.nodes.client import make_message
from visualization_msgs.msg import Marker, MarkerArray

STACK = """
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
- [turn: {type: orientation, frame: link3, axes: z}, slow: {type: joint, joints: joint1}]
- rest: {type: posture, target: [0.0, 0.0, 0.0]}
"""
Q = (0.0, 0.6, 0.3)
TOPIC = '/tp_controller/markers'


class Rig:
    """A controller of the planar arm at rest, and what it draws."""

    def __init__(self, harness, stack=STACK, **parameters):
        self.harness = harness
        self.controller = harness.controller(stack=stack, **parameters)
        self.status, self.arm = Status(harness), Arm(harness, Q)
        self.arrays = harness.record(MarkerArray, TOPIC)

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def drawn(self):
        """Return {namespace: list of markers} of a message that is still to come."""
        del self.arrays[:]
        self.spin_until(lambda: self.arrays and self.arrays[-1].markers)
        found = {}
        for marker in self.arrays[-1].markers:
            found.setdefault(marker.ns, []).append(marker)
        return found

    @property
    def state(self):
        """Return the state of the arm."""
        return self.controller._controller.robot.state(self.arm.q)


def pose_of(marker):
    """Return the pose (4, 4) of a marker."""
    point, turn = marker.pose.position, marker.pose.orientation
    return pose(rotation_from_quaternion([turn.x, turn.y, turn.z, turn.w]),
                [point.x, point.y, point.z])


def points_of(marker):
    """Return the points (k, 3) of a marker, in its frame."""
    T = pose_of(marker)
    return np.array([(point.x, point.y, point.z) for point in marker.points]) @ T[:3, :3].T \
        + T[:3, 3]


def test_every_marker_is_in_the_root_and_disappears_when_it_is_not_renewed(harness):
    rig = Rig(harness)
    drawn = rig.drawn()
    assert set(drawn) == {'tip/frame', 'tip/goal', 'turn/frame', 'turn/goal'}
    for marker in rig.arrays[-1].markers:
        assert marker.header.frame_id == 'base_link' and marker.action == Marker.ADD
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0)
        assert marker.header.stamp.sec > 0


@pytest.mark.parametrize('rate, seconds', [(0.5, 6.0), (50.0, 1.0), (2.0, 1.5)])
def test_markers_last_for_three_periods(harness, rate, seconds):
    rig = Rig(harness, status_rate=rate)
    rig.spin_until(lambda: rig.arrays and rig.arrays[-1].markers)
    life = rig.arrays[-1].markers[0].lifetime
    assert life.sec + 1e-9 * life.nanosec == pytest.approx(seconds)


def test_arrow_leads_from_the_frame_to_the_goal(harness):
    rig = Rig(harness)
    publisher = harness.publisher(PointStamped, '/tp_controller/tip/goal')
    goal = (0.5, 1.0, 0.25)
    publisher.publish(make_message('tip', PointStamped, {'xyz': goal}))
    rig.spin_until(lambda: rig.status.task('tip')['goals accepted'] == '1')
    rig.spin_until(lambda: rig.status.head == 'running')
    drawn = rig.drawn()
    arrow, = drawn['tip/error']
    place = rig.state.position('link3')
    # z does not count.
    np.testing.assert_allclose(points_of(arrow), [place, [*goal[:2], place[2]]], atol=1e-12)
    np.testing.assert_allclose(pose_of(drawn['tip/goal'][0])[:3, 3], goal, atol=1e-12)
    np.testing.assert_allclose(pose_of(drawn['tip/frame'][0]), rig.state.pose('link3'),
                               atol=1e-12)


def test_what_is_not_there_any_more_is_deleted_once(harness):
    rig = Rig(harness)
    rig.drawn()
    harness.enable('tip', False)
    rig.spin_until(lambda: any(marker.action == Marker.DELETE for array in rig.arrays
                               for marker in array.markers))
    harness.spin_for_more(rig.arrays, 3, rig.arm.publish)
    counts = Counter((marker.ns, marker.id) for array in rig.arrays for marker in array.markers
                     if marker.action == Marker.DELETE)
    assert counts == {('tip/frame', 0): 1, ('tip/goal', 0): 1}
    assert set(rig.drawn()) == {'turn/frame', 'turn/goal'}


def test_markers_are_not_made_where_nobody_looks(harness, monkeypatch):
    monkeypatch.setattr('tp_controller.control.sketcher.Sketcher.sketch',
                        lambda *_: pytest.fail('made without need'))
    controller = harness.controller(stack=STACK)
    status, arm = Status(harness), Arm(harness, Q)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    harness.spin_for_more(status.messages, 3, arm.publish)
    assert controller is not None


def test_markers_of_a_stack_that_has_not_run_yet_are_no_garbage(harness):
    rig = Rig(harness)
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.trigger('stop')
    stack = STACK.replace('tip', 'end').replace('turn', 'twist')
    assert rig.controller.set_parameters_atomically([Parameter('stack', value=stack)]).successful
    harness.spin_for_more(rig.arrays, 3)
    for array in rig.arrays:
        for marker in array.markers:
            assert np.isfinite(pose_of(marker)).all()

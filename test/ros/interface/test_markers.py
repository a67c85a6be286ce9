# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the controller draws: the markers of its tasks."""

from collections import Counter

from geometry_msgs.msg import PointStamped, QuaternionStamped, Vector3Stamped
from harness import Arm, JOINTS, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.time import Time
import robots
from tp_controller.model.shapes import Sphere
from tp_controller.model.spatial import pose, rotation_from_quaternion
from tp_controller.ros.client.goal_fields import make_message
from tp_controller.ros.interface.markers import Markers
from tp_controller.tasks.primitives import colour_of
from tp_controller.tasks.sketch import Arrow, Body, Cone, Dot, Gaps, Path, Triad
from visualization_msgs.msg import Marker, MarkerArray

STACK = """
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
- [turn: {type: orientation, frame: link3, axes: z}, slow: {type: joint, joints: joint1}]
- rest: {type: posture, target: [0.0, 0.0, 0.0]}
"""
Q = (0.0, 0.6, 0.3)
TOPIC = '/tp_controller/markers'
CAPSULES = str(robots.CONFIG / 'panda_capsules.yaml')
PANDA = {'robot': str(robots.PANDA_DH), 'q': robots.PANDA_READY,
         'names': [f'panda_joint{number}' for number in range(1, 8)]}
TOOL, ELBOW = robots.PANDA_TOOL, 'panda_link4'
EVERYTHING = f"""
- [inside: {{type: keep_in, frame: {TOOL}, shape: {{box: [2, 3, 4]}}, at: [0.1, 0.2, 0.3],
             radius: 0.05}},
   outside: {{type: keep_out, frame: {TOOL}, shape: {{cylinder: [0.1, 0.4]}},
              at: [0.5, 0.5, 0.1]}},
   floor: {{type: keep_out, frame: {TOOL}, shape: half_space, at: [0, 0, -1]}},
   range: {{type: orientation_range, frame: {TOOL}, axes: xy, maximum: 3.0}},
   upright: {{type: tilt, frame: {TOOL}, within: 3.0}},
   span: {{type: distance, frame: {TOOL}, reference: {ELBOW}, minimum: 0.1, maximum: 2.0}},
   view: {{type: field_of_view, frame: {TOOL}, half_angle: 0.4, target: [0.4, 0.1, 0.0]}},
   clear: {{type: obstacles, capsules: {CAPSULES}, within: 0.6, obstacles: {{
     ball: {{shape: {{sphere: 0.1}}, at: [0.6, 0.4, 0.3]}},
     table: {{shape: {{box: [0.4, 0.6, 0.1]}}, at: [0.6, 0.0, -0.2]}}}}}}]
- look: {{type: pointing, frame: {TOOL}, towards: point, target: [0.7, 0.0, 0.1]}}
- turn: {{type: orientation, frame: {TOOL}}}
- between: {{type: relative_position, frame: {TOOL}, reference: {ELBOW}}}
- rest: {{type: posture}}
"""


class Rig:
    """A controller of an arm at rest, by default the planar one, and what it draws."""

    def __init__(self, harness, stack=STACK, q=Q, names=JOINTS, **parameters):
        self.harness = harness
        self.controller = harness.controller(stack=stack, **parameters)
        self.status, self.arm = Status(harness), Arm(harness, q, names)
        self.arrays = harness.record(MarkerArray, TOPIC)

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def drawn(self):
        """Return {namespace: list of markers} of a message still to come, of tasks with goals."""
        self.spin_until(lambda: self.controller._robot.loop.report is not None)
        now = self.harness.node.get_clock().now()
        # Those before may still be on their way.
        self.spin_until(lambda: self.arrays and self.arrays[-1].markers and Time.from_msg(
            self.arrays[-1].markers[0].header.stamp) > now)
        found = {}
        for marker in self.arrays[-1].markers:
            found.setdefault(marker.ns, []).append(marker)
        return found

    @property
    def state(self):
        """Return the state of the arm."""
        return self.controller._robot.controller.robot.state(self.arm.q)

    @property
    def tip(self):
        """Return the task of the tip."""
        return self.controller._robot.controller.stack.tasks['tip']


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
    # z does not count: the goal is drawn where the frame is.
    counting = [*goal[:2], place[2]]
    np.testing.assert_allclose(points_of(arrow), [place, counting], atol=1e-12)
    np.testing.assert_allclose(pose_of(drawn['tip/goal'][0])[:3, 3], counting, atol=1e-12)
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
    assert counts == {('tip/frame', 0): 1, ('tip/goal', 0): 1, ('tip/goal', 1): 1}
    assert set(rig.drawn()) == {'turn/frame', 'turn/goal'}


def test_markers_are_not_made_where_nobody_looks(harness, monkeypatch):
    monkeypatch.setattr('tp_controller.control.sketcher.Sketcher.sketch',
                        lambda *_: pytest.fail('made without need'))
    controller = harness.controller(stack=STACK)
    status, arm = Status(harness), Arm(harness, Q)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    harness.spin_for_more(status.messages, 3, arm.publish)
    assert controller is not None


def test_frames_follow_a_stopped_robot_that_somebody_else_moves(harness):
    rig = Rig(harness)
    rig.spin_until(lambda: rig.status.head == 'running')
    harness.trigger('stop')
    rig.arm.q = [0.5, 0.2, -0.3]
    end = rig.state.pose('link3')
    rig.spin_until(lambda: np.allclose(pose_of(rig.drawn()['tip/frame'][0]), end, atol=1e-9))
    # The goal stays where it is.
    np.testing.assert_allclose(
        pose_of(rig.drawn()['tip/goal'][0])[:3, 3],
        rig.controller._robot.controller.robot.state(Q).position('link3'), atol=1e-9)


def test_nothing_is_drawn_of_a_robot_that_nothing_is_heard_of(harness):
    rig = Rig(harness)
    harness.spin_for_more(rig.arrays, 3)
    assert not any(array.markers for array in rig.arrays)
    rig.arm.q = [1e300, 0.0, 0.0]
    harness.spin_for_more(rig.arrays, 3, rig.arm.publish)
    assert not any(array.markers for array in rig.arrays)


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


# What the markers look like

@pytest.fixture
def panda(harness):
    """Return what is drawn of a Panda whose tasks have all parts that there are."""
    rig = Rig(harness, EVERYTHING, **PANDA)
    rig.found = rig.drawn()
    return rig


def only(rig, name):
    """Return the one marker of a namespace."""
    marker, = rig.found[name]
    return marker


def angles(points, axis):
    """Return the angles of rows (k, 3) with an axis (3,) [rad]."""
    return np.arccos(np.clip(points @ axis / np.linalg.norm(points, axis=1), -1.0, 1.0))


def test_goals_of_bounds_arrive_in_frames_of_the_robot(harness):
    rig = Rig(harness, EVERYTHING, **PANDA)
    rig.spin_until(lambda: rig.status.head == 'running')
    half = np.sqrt(0.5)
    for task, kind, fields in (
            ('upright', Vector3Stamped, {'xyz': (0.0, 2.0, 0.0)}),
            ('span', PointStamped, {'xyz': (0.1, 0.2, 0.3)}),
            ('range', QuaternionStamped, {'quat_xyzw': (half, 0.0, 0.0, half)})):
        message = make_message(task, kind, fields)
        message.header.frame_id = ELBOW
        harness.publisher(kind, f'/tp_controller/{task}/goal').publish(message)
        rig.spin_until(lambda task=task: rig.status.task(task)['goals accepted'] == '1')
    drawn, T = rig.drawn(), rig.state.pose(ELBOW)
    np.testing.assert_allclose(pose_of(drawn['upright/cone'][0])[:3, 2], T[:3, 1], atol=1e-9)
    np.testing.assert_allclose(pose_of(drawn['span/goal'][0])[:3, 3],
                               (T @ [0.1, 0.2, 0.3, 1.0])[:3], atol=1e-9)
    turned = T[:3, :3] @ rotation_from_quaternion([half, 0.0, 0.0, half])
    np.testing.assert_allclose(pose_of(drawn['range/goal'][0])[:3, :3], turned, atol=1e-9)


def test_every_part_has_a_namespace_of_its_own(panda):
    assert set(panda.found) == {
        f'{task}/{part}' for task, parts in {
            'inside': 'frame goal region sphere', 'outside': 'frame goal region',
            'floor': 'frame goal region', 'view': 'frame goal axis sight cone',
            'upright': 'frame goal axis sight cone',
            'range': 'frame goal range/x range/y',
            'span': 'frame goal reference line region/minimum region/maximum',
            'clear': 'obstacle/ball obstacle/table distance',
            'look': 'frame goal axis sight cone turn', 'turn': 'frame goal',
            'between': 'frame goal reference'}.items() for part in parts.split()}
    assert [(marker.id, marker.type) for marker in panda.found['clear/distance']] == [
        (0, Marker.LINE_LIST), (1, Marker.TEXT_VIEW_FACING)]
    assert all(name == 'clear/distance' or name.endswith('/goal')
               for name, markers in panda.found.items() if len(markers) > 1)
    assert all(marker.id == number for markers in panda.found.values()
               for number, marker in enumerate(markers))


def test_goals_and_the_lines_to_them_differ_from_frames(panda):
    goal, ball = panda.found['turn/goal']
    frame, = panda.found['turn/frame']
    assert ball.type == Marker.SPHERE and goal.scale.x > 1.5 * frame.scale.x
    np.testing.assert_allclose([getattr(ball.pose.position, axis) for axis in 'xyz'],
                               [getattr(goal.pose.position, axis) for axis in 'xyz'])
    colours = [colour_of(part) for part in ('goal', 'error', 'frame')]
    assert colours[0] == colours[1] != colours[2]


def test_axes_are_red_green_and_blue_from_the_frame(panda):
    T = panda.state.pose(TOOL)
    for name, length in (('turn/goal', 0.08), ('turn/frame', 0.04)):
        marker = panda.found[name][0]
        assert marker.type == Marker.LINE_LIST
        ends = T[:3, 3] + length * T[:3, :3].T
        np.testing.assert_allclose(points_of(marker)[1::2], ends, atol=1e-9)
        np.testing.assert_allclose(points_of(marker)[::2], [T[:3, 3]] * 3, atol=1e-9)
        strongest = [int(np.argmax([colour.r, colour.g, colour.b])) for colour in marker.colors]
        assert strongest == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize('name, kind, place, size', [
    ('inside/region', Marker.CUBE, (0.1, 0.2, 0.3), (2.0, 3.0, 4.0)),
    ('outside/region', Marker.CYLINDER, (0.5, 0.5, 0.1), (0.2, 0.2, 0.4)),
    ('floor/region', Marker.CUBE, (0.0, 0.0, -1.0), (2.0, 2.0, 0.002)),
    ('clear/obstacle/ball', Marker.SPHERE, (0.6, 0.4, 0.3), (0.2, 0.2, 0.2)),
    ('clear/obstacle/table', Marker.CUBE, (0.6, 0.0, -0.2), (0.4, 0.6, 0.1))])
def test_shapes_are_where_they_are_and_as_large(panda, name, kind, place, size):
    marker = only(panda, name)
    assert marker.type == kind
    np.testing.assert_allclose(pose_of(marker)[:3, 3], place, atol=1e-9)
    np.testing.assert_allclose([marker.scale.x, marker.scale.y, marker.scale.z], size)
    # What the robot may be inside of is green, the rest is red; one sees through both.
    colour = marker.color
    assert (colour.g > colour.r) == (name == 'inside/region') and 0.1 < colour.a < 0.6


def test_sphere_around_a_frame_is_drawn(panda):
    marker = only(panda, 'inside/sphere')
    assert marker.type == Marker.SPHERE and marker.scale.x == marker.scale.z == 0.1
    np.testing.assert_allclose(pose_of(marker)[:3, 3], panda.state.position(TOOL), atol=1e-9)


def test_cone_of_a_camera_is_what_is_in_view(panda):
    marker, T = only(panda, 'view/cone'), panda.state.pose(TOOL)
    assert marker.type == Marker.TRIANGLE_LIST and len(marker.points) % 3 == 0
    assert marker.scale.x == marker.scale.y == marker.scale.z == 1.0
    points = points_of(marker) - T[:3, 3]
    np.testing.assert_allclose(points[::3], 0.0, atol=1e-9)
    rim = np.concatenate([points[1::3], points[2::3]])
    np.testing.assert_allclose(angles(rim, T[:3, 2]), 0.4, atol=1e-9)
    # All around the axis.
    np.testing.assert_allclose(rim.mean(axis=0) @ T[:3, :2], 0.0, atol=1e-9)


def test_axis_that_points_is_on_the_cone_about_the_line_of_sight(panda):
    T, target = panda.state.pose(TOOL), np.array([0.7, 0.0, 0.1])
    sight = points_of(only(panda, 'look/sight'))
    np.testing.assert_allclose(sight, [T[:3, 3], target], atol=1e-9)
    axis = points_of(only(panda, 'look/axis'))
    np.testing.assert_allclose(axis, [T[:3, 3], T[:3, 3] + 0.3 * T[:3, 2]], atol=1e-9)
    direction = (target - T[:3, 3]) / np.linalg.norm(target - T[:3, 3])
    cone = points_of(only(panda, 'look/cone')) - T[:3, 3]
    np.testing.assert_allclose(angles(np.delete(cone, slice(None, None, 3), axis=0), direction),
                               angles(T[:3, 2][np.newaxis], direction)[0], atol=1e-7)
    arc = points_of(only(panda, 'look/turn')) - T[:3, 3]
    np.testing.assert_allclose([arc[0], arc[-1]], [0.3 * T[:3, 2], 0.3 * direction], atol=1e-7)


def test_line_leads_from_the_reference_to_the_goal(panda):
    state = panda.state
    np.testing.assert_allclose(points_of(only(panda, 'between/reference')),
                               [state.position(ELBOW), state.position(TOOL)], atol=1e-9)


@pytest.mark.parametrize('way', [(0.02, 0, 0), (0.01, 0, -0.1), (0.0, 0, 0.08), (0.03, 0, 0.02)])
def test_text_of_a_short_distance_is_beside_its_line_and_not_where_its_arrow_points(way):
    start, end = np.array([0.4, 0.2, 0.6]), np.array([0.4, 0.2, 0.6]) - way
    gaps = Gaps('distance', start[np.newaxis], end[np.newaxis], np.ones(1), 0.0, 1.0)
    _, text = Markers(0.1, None).message(Time().to_msg(), 'base', {'clear': [gaps]}).markers
    p = pose_of(text)[:3, 3]
    np.testing.assert_allclose(p[:2], 0.5 * (start + end)[:2])
    # What changes the distance is an arrow from the end to the start, and beyond.
    if way[2] > 0.0:
        assert p[2] + 0.5 * text.scale.z < end[2]
    else:
        assert p[2] - 0.5 * text.scale.z > max(start[2], end[2])
    assert abs(p[2] - 0.5 * (start + end)[2]) < 0.1


def test_distances_are_lines_in_colours_and_the_smallest_is_written(panda):
    lines, text = panda.found['clear/distance']
    points = points_of(lines)
    lengths = np.linalg.norm(points[1::2] - points[::2], axis=1)
    assert len(points) == len(lines.colors) > 2
    assert (np.diff(lengths) >= 0.0).all() and text.text == f'{lengths[0]:.3f} m'
    np.testing.assert_allclose(pose_of(text)[:2, 3], points[:2, :2].mean(axis=0), atol=1e-9)
    # From red at the distance that is kept, 0.02 m, to green at 0.6 m.
    for length, one, other in zip(lengths, lines.colors[::2], lines.colors[1::2]):
        share = (length - 0.02) / 0.58
        assert (one.r, one.g) == (other.r, other.g) == pytest.approx(
            (min(1.0, 2.0 - 2.0 * share), min(1.0, 2.0 * share)), abs=1e-6)
    assert text.color.r == lines.colors[0].r


# What types of other packages may return

@pytest.mark.parametrize('parts, fault', [
    (None, 'sketch raised TypeError'), ([3], 'its sketch cannot be drawn'),
    ([Triad('frame', np.full((4, 4), np.nan))], 'its numbers are not finite'),
    ([Triad('frame', np.eye(3))], 'needs an array of shape (4, 4), got (3, 3)'),
    ([Triad('frame', 'here')], 'its sketch cannot be drawn'),
    ([Triad('\ud800', np.eye(4))], 'its sketch cannot be drawn'),
    ([Dot('frame', None)], 'its sketch cannot be drawn'),
    ([Arrow('error', np.zeros(3), np.zeros(2))], 'needs an array of shape (3,), got (2,)'),
    ([Path('reference', np.zeros((0, 3)))], 'its sketch cannot be drawn'),
    ([Path('reference', np.zeros((3000, 3)))], 'needs at most 2000 points, got 3000'),
    ([Cone('cone', np.eye(4), np.inf, 1.0)], 'its numbers are not finite'),
    ([Body('region', np.eye(4), 'box')], 'str is not a shape'),
    ([Body('region', np.eye(4), Sphere(np.nan))], 'its numbers are not finite'),
    ([Gaps('distance', np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0, 1.0)],
     'its sketch cannot be drawn'),
    ([Gaps('distance', np.zeros((2, 3)), np.zeros((1, 3)), np.zeros(2), 0.0, 1.0)],
     'its sketch cannot be drawn')])
def test_task_that_cannot_be_drawn_is_named_and_harms_nothing(harness, log, monkeypatch, parts,
                                                              fault):
    rig = Rig(harness)
    rig.drawn()
    monkeypatch.setattr(rig.tip, 'sketch', lambda _: parts)
    told = harness.spin_until_logged(log, 'task tip is not drawn: ', rig.arm.publish)
    rig.spin_until(lambda: {marker.ns for marker in rig.arrays[-1].markers} == {
        'turn/frame', 'turn/goal'})
    assert fault in told


def test_task_that_cannot_be_drawn_is_named_once(harness, log, monkeypatch):
    rig = Rig(harness)
    rig.drawn()
    monkeypatch.setattr(rig.tip, 'sketch', lambda _: 1 / 0)
    harness.spin_until_logged(log, 'task tip is not drawn: sketch raised ', rig.arm.publish)
    # Whatever repeats is written every second.
    harness.spin_for_more(rig.arrays, 60, rig.arm.publish)
    assert 'is not drawn' not in log()


def test_part_that_nobody_knows_is_drawn_all_the_same(harness, monkeypatch):
    rig = Rig(harness)
    rig.drawn()
    parts = [Dot('mark', np.zeros(3)), Dot('mark', np.ones(3))]
    monkeypatch.setattr(rig.tip, 'sketch', lambda _: parts)
    rig.spin_until(lambda: 'tip/mark' in rig.drawn())
    first, second = rig.drawn()['tip/mark']
    assert (first.id, second.id) == (0, 1) and first.color.a > 0.0

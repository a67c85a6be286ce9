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

"""The page shows what a controller does, and what is done on it arrives there."""

from html import unescape
import time

from geometry_msgs.msg import (
    Point,
    PointStamped,
    PoseStamped,
    QuaternionStamped,
    Vector3Stamped,
)
import numpy as np
import pytest
from robots import PLANAR_START
from scipy.spatial.transform import Rotation
from tp_controller.model.spatial import pose, rotation_from_rpy
from visualization_msgs.msg import Marker, MarkerArray
import yaml

viser = pytest.importorskip('viser', reason="needs pip install '.[view]'")

from tp_controller.nodes.client import Client  # noqa: E402
from tp_controller.view.gizmos import Gizmos, PATIENCE, PERIOD, places_of  # noqa: E402
from tp_controller.view.link import Link  # noqa: E402
from tp_controller.view.page import Page, RATE  # noqa: E402
from tp_controller.view.server import open_server  # noqa: E402

STACK = """\
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
# The rest.
- [turn: {type: orientation, frame: link3, axes: z}, slow: {type: joint, joints: [joint1]}]
- rest: {type: posture, gain: 1.0}
"""
START = f'{{joint1: {PLANAR_START[0]}, joint2: {PLANAR_START[1]}, joint3: {PLANAR_START[2]}}}'
BROWSER = 1


@pytest.fixture(scope='module')
def server():
    """Return a server whose page nobody opens."""
    found = open_server()
    yield found
    found.stop()


class Rig:
    """A simulated planar arm, its controller, and the page; a browser is looking."""

    def __init__(self, harness, server, stack=STACK):
        server.scene.reset()
        server.gui.reset()
        self.harness, self.looking = harness, True
        # Drawing takes its time on the thread of the test, and nothing is to stop for that.
        self.simulator = harness.simulator(initial_positions=START, rate=50.0,
                                           command_timeout=5.0)
        self.controller = harness.controller(
            stack=stack, limits__joint1__velocity=0.5, state_timeout=5.0, check_stamps=False)
        self._due = 0.0
        self.client = Client(context=harness.context)
        self.link = Link(self.client)
        self.page = Page(server, self.link)
        server.get_clients = lambda: {BROWSER: None} if self.looking else {}

    def spin_until(self, condition, what='the condition'):
        """Spin, with the page, until a condition holds."""
        self.harness.spin_until(condition, what, meanwhile=self.update)

    def update(self):
        """Update the page as often as it is meant to be."""
        if time.monotonic() > self._due:
            self.page.update()
            self._due = time.monotonic() + 1.0 / RATE

    def ready(self):
        """Spin until the page shows all there is."""
        self.spin_until(lambda: self.page.stack.rows and self.link.running
                        and len(self.link.gains()) > 1 and self.page.gizmos.gizmos, 'the page')
        return self

    @property
    def names(self):
        """Return the tasks in the order in which they are shown."""
        rows = self.page.stack.rows
        return sorted(rows, key=lambda name: rows[name].folder.order)

    @property
    def q(self):
        """Return the configuration that the simulator has."""
        return self.simulator._simulator.q

    @property
    def stack(self):
        """Return the stack that the controller has."""
        return self.controller._controller.stack


@pytest.fixture
def rig(harness, server):
    """Return the rig, once it runs."""
    found = Rig(harness, server)
    yield found.ready()
    found.client.close()


def act(handle, value=True):
    """Do to an input what a browser would."""
    handle._impl.value = value
    for callback in handle._impl.update_cb:
        callback(viser.GuiEvent(client=None, client_id=BROWSER, target=handle))


def test_robot_is_shown_where_it_is_while_it_moves(rig):
    rig.page.gizmos.gizmos['tip/goal'].drag(pose(np.eye(3), [0.6, 0.8, 0.0]))
    start = np.array(rig.q)
    rig.spin_until(lambda: np.abs(rig.q - start).max() > 0.2, 'motion')
    rig.spin_until(lambda: np.abs(rig.page._robot.state.q - rig.q).max() < 0.02, 'the picture')


def test_robot_has_the_base_joints_and_limits_of_the_controller(rig):
    ours, theirs = rig.link.robot, rig.controller._controller.robot
    assert ours.joint_names == theirs.joint_names and ours.base == theirs.base
    np.testing.assert_array_equal(ours.velocity, theirs.velocity)
    assert ours.velocity[0] == 0.5


def test_rows_tell_the_tasks_by_priority_with_errors_and_gains(rig):
    assert rig.names == ['tip', 'turn', 'slow', 'rest']
    row = rig.page.stack.rows['tip']
    rig.spin_until(lambda: 'data-status="reached"' in row.text.content, 'reached')
    assert row.folder.label == '1 · tip  (position)' and 'mm' in row.text.content
    assert row.gain.value == 2.0 and row.enabled.value


def test_button_moves_a_level_up_and_goals_and_gains_stay(rig):
    goal = pose(np.eye(3), [0.7, 0.6, 0.0])
    rig.page.gizmos.gizmos['tip/goal'].drag(goal)
    rig.spin_until(lambda: np.allclose(rig.stack.tasks['tip'].goal[:2], goal[:2, 3]), 'the goal')
    act(rig.page.stack.rows['tip'].gain, 1.25)
    rig.spin_until(lambda: rig.stack.tasks['tip'].gain == 1.25, 'the gain')
    rig.spin_until(lambda: rig.link.gains()['tip'] == 1.25, 'the gain on the page')
    act(rig.page.stack.rows['rest'].order, '▲ up')
    rig.spin_until(lambda: rig.names == ['tip', 'rest', 'turn', 'slow'], 'the other order')
    assert [[task.name for task in group] for group in rig.stack.groups] == [
        ['tip'], ['rest'], ['turn', 'slow']]
    assert '# The rest.' in rig.stack.text
    assert yaml.safe_load(rig.stack.text)[2] == yaml.safe_load(STACK)[1]
    np.testing.assert_allclose(rig.stack.tasks['tip'].goal[:2], goal[:2, 3])
    rig.spin_until(lambda: rig.stack.tasks['tip'].gain == 1.25, 'the gain again')


def test_stop_stops_and_start_goes_on(rig):
    act(rig.page.stop_button)
    rig.spin_until(lambda: 'stopped' in rig.page.state_text.content, 'the stop')
    assert rig.controller._stopped and not rig.page.start_button.disabled
    act(rig.page.start_button)
    rig.spin_until(lambda: 'running' in rig.page.state_text.content, 'the start')
    assert rig.page.start_button.disabled


def test_task_that_is_switched_off_leaves_the_stack_and_comes_back(rig):
    row = rig.page.stack.rows['slow']
    act(row.enabled, False)
    rig.spin_until(lambda: rig.stack.disabled == {'slow'}, 'the task out')
    rig.spin_until(lambda: 'data-status="disabled"' in row.text.content, 'the row')
    act(row.enabled, True)
    rig.spin_until(lambda: not rig.stack.disabled, 'the task back')


def test_box_follows_what_others_switch_off(rig):
    rig.controller._controller.enable('slow', False)
    rig.spin_until(lambda: not rig.page.stack.rows['slow'].enabled.value, 'the box')


def test_gain_that_is_refused_is_said_with_its_reason_and_shown_as_it_was(rig):
    row = rig.page.stack.rows['rest']
    act(row.gain, -3.0)
    rig.spin_until(lambda: 'out of range' in rig.page.notice.content, 'the reason')
    rig.spin_until(lambda: row.gain.value == 1.0, 'the gain that is in force')


def test_goal_that_is_refused_is_said_with_its_reason(rig):
    rig.page.gizmos.gizmos['tip/goal'].drag(pose(np.eye(3), [np.nan, 0.0, 0.0]))
    rig.spin_until(lambda: 'goal for task tip refused' in rig.page.notice.content, 'the reason')
    assert rig.controller._topics.records['tip'].refusal in unescape(
        rig.page.notice.content)


def test_slider_of_a_joint_is_a_goal_of_the_chosen_task(rig):
    rig.spin_until(lambda: rig.page.joints.task.options == ('slow', 'rest'), 'the tasks')
    act(rig.page.joints.task, 'rest')
    act(rig.page.joints.sliders['joint3'], 0.9)
    rig.spin_until(lambda: rig.stack.tasks['rest'].goal[2] == 0.9, 'the goal')
    # The others show where the joints are.
    rig.spin_until(lambda: abs(rig.page.joints.sliders['joint2'].value - rig.q[1]) < 0.02)
    assert rig.page.joints.sliders['joint3'].value == 0.9


def test_nothing_is_asked_of_the_controller_while_nobody_looks(rig):
    rig.looking = False
    count = rig.harness.node.count_subscribers
    rig.spin_until(lambda: not count('/tp_controller/markers'), 'nobody listening')
    assert count('/joint_states') == 1
    rig.looking = True
    rig.spin_until(lambda: count('/tp_controller/markers') == 1, 'the page listening')
    assert count('/joint_states') == 2


def test_controller_that_is_gone_is_said_to_be_gone(rig):
    rig.harness.remove(rig.controller)
    rig.spin_until(lambda: '/tp_controller is not heard' in rig.page.state_text.content)


def test_plots_have_a_curve_for_each_error_and_joint(rig):
    plots = rig.page.plots
    rig.spin_until(lambda: plots.velocities.names and plots.errors.names, 'the curves')
    assert set(plots.velocities.names) == {'joint1', 'joint2', 'joint3'}
    assert set(plots.errors.names) == {'tip [m]', 'turn [rad]', 'slow [rad]', 'rest [rad]'}
    state = rig.link.robot.state(rig.link.q)
    J = state.jacobian('link3')[[0, 1, 5]]
    rig.spin_until(lambda: len(plots.manipulability._rows) > 1)
    assert plots.manipulability._rows[-1][0] == pytest.approx(
        np.sqrt(np.linalg.det(J @ J.T)), rel=1e-3)


# What is dragged, without a controller ----------------------------------------------------------

T = pose(rotation_from_rpy(0.3, -0.4, 1.1), [0.4, -0.2, 0.7])


def marker(ns, kind=Marker.LINE_LIST, at=(1.0, 2.0, 3.0)):
    """Return a marker in the frame base, without rotation."""
    found = Marker(ns=ns, type=kind, action=Marker.ADD)
    found.header.frame_id = 'base'
    found.pose.position.x, found.pose.position.y, found.pose.position.z = at
    found.pose.orientation.w = 1.0
    found.scale.x = found.scale.y = found.scale.z = 0.1
    return found


def quaternion(turn):
    """Return the rotation matrix (3, 3) of a message."""
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()


@pytest.mark.parametrize('kind, part', [
    (PointStamped, 'goal'), (PoseStamped, 'goal'), (QuaternionStamped, 'goal'),
    (PoseStamped, 'region')])
def test_dragged_goal_becomes_the_message_that_its_task_takes(kind, part):
    place, = places_of([marker(f'task/{part}')], {'task': {'goal': kind}})
    topic, message = place.message(T)
    assert topic == 'goal' and isinstance(message, kind) and message.header.frame_id == 'base'
    body = message.pose if kind is PoseStamped else message
    point = getattr(body, 'position', None) or getattr(body, 'point', None)
    turn = getattr(body, 'orientation', None) or getattr(body, 'quaternion', None)
    if point is not None:
        np.testing.assert_allclose([point.x, point.y, point.z], T[:3, 3])
    if turn is not None:
        np.testing.assert_allclose(quaternion(turn), T[:3, :3], atol=1e-9)


def test_direction_is_dragged_by_the_tip_of_its_arrow():
    arrow = marker('look/sight', Marker.ARROW)
    arrow.points = [Point(), Point(y=0.3)]
    place, = places_of([arrow], {'look': {'goal': Vector3Stamped}})
    np.testing.assert_allclose(place.T[:3, 3], [1.0, 2.3, 3.0])
    _, message = place.message(pose(np.eye(3), [1.0, 2.0, 3.5]))
    assert (message.vector.x, message.vector.y, message.vector.z) == (0.0, 0.0, 0.5)


def test_obstacle_that_is_dragged_keeps_its_name_and_shape_and_stays():
    box = marker('avoid/obstacle/shelf/2', Marker.CUBE)
    box.lifetime.sec, box.id = 1, 0
    place, = places_of([box], {})
    topic, message = place.message(T)
    moved, = message.markers
    assert topic == 'obstacles' and isinstance(message, MarkerArray)
    assert (moved.ns, moved.id, moved.type) == ('shelf/2', 0, Marker.CUBE)
    assert (moved.lifetime.sec, moved.header.frame_id) == (0, 'base')
    assert moved.pose.position.x == 0.4 and moved.scale == box.scale
    # What the controller draws stays as it was.
    assert box.pose.position.x == 1.0


def test_region_is_dragged_by_itself_and_not_by_its_goal():
    markers = [marker('keep/goal'), marker('keep/region', Marker.CUBE), marker('tip/goal')]
    found = places_of(markers, dict.fromkeys(('keep', 'tip'), {'goal': PoseStamped}))
    assert [place.name for place in found] == ['keep/region', 'tip/goal']


def test_what_is_dragged_bears_a_name():
    markers = [marker('tip/goal'), marker('avoid/obstacle/shelf/2', Marker.CUBE)]
    assert [place.title for place in places_of(markers, {'tip': {'goal': PoseStamped}})] == [
        'tip', 'shelf/2']


def test_what_cannot_be_told_cannot_be_dragged():
    markers = [marker('a/frame'), marker('a/error'), marker('b/goal'), marker('c/region')]
    assert places_of(markers, {'a': {'goal': PoseStamped}, 'c': {'goal': PointStamped}}) == []


class Dragged:
    """A goal that is dragged, on a clock that the test sets."""

    def __init__(self, server):
        server.scene.reset()
        self.now, self.sent = 0.0, []
        self.gizmos = Gizmos(server.scene, self.publish, lambda: self.now)
        self.follow(0.0)
        self.gizmo = self.gizmos.gizmos['tip/goal']

    def publish(self, task, topic, message):
        """Keep what is sent."""
        self.sent.append((task, topic, message.point.x))

    def follow(self, x):
        """Let the controller have the goal at x."""
        self.gizmos.follow(places_of([marker('tip/goal', at=(x, 0.0, 0.0))],
                                     {'tip': {'goal': PointStamped}}))

    def drag(self, x):
        """Drag it to x."""
        self.gizmo.drag(pose(np.eye(3), [x, 0.0, 0.0]))


def test_not_every_step_of_a_drag_is_sent_but_the_last_one_is(server):
    dragged = Dragged(server)
    for step in range(100):
        dragged.now = 1.0 + 0.01 * step
        dragged.drag(step)
        dragged.gizmos.send()
    while dragged.now < 3.0:
        dragged.now += 0.01
        dragged.gizmos.send()
    assert 0.9 / PERIOD <= len(dragged.sent) <= 1.0 / PERIOD + 2
    assert dragged.sent[-1] == ('tip', 'goal', 99.0)


def test_gizmo_stays_in_the_hand_and_then_goes_where_the_controller_has_it(server):
    dragged = Dragged(server)
    dragged.now = 5.0
    dragged.drag(2.0)
    dragged.gizmo.handle.position = (2.0, 0.0, 0.0)
    dragged.gizmos.send()
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 2.0
    dragged.now = 5.1 + PATIENCE
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 0.5


def test_what_is_not_to_be_dragged_or_gone_has_no_gizmo(server):
    dragged = Dragged(server)
    dragged.gizmos.shown['goals'] = False
    dragged.follow(0.0)
    assert not dragged.gizmos.gizmos
    dragged.gizmos.shown['goals'] = True
    dragged.follow(0.0)
    assert list(dragged.gizmos.gizmos) == ['tip/goal']
    dragged.gizmos.follow([])
    assert not dragged.gizmos.gizmos

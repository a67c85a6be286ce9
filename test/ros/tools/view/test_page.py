# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page shows what a controller does, and what is done on it arrives there."""

from dataclasses import replace
from html import unescape
import math
import re
import time

from builtin_interfaces.msg import Time
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
from std_srvs.srv import Trigger
from tp_controller.model.spatial import pose, rotation_from_rpy
from tp_controller.ros.client.client import Client
from tp_controller.ros.client.status import received
from tp_controller.ros.client.trajectory_fields import make_trajectory
from tp_controller.ros.interface.markers import Markers
from tp_controller.ros.interface.status import diagnostics
from tp_controller.tasks.sketch import Cone, Gaps
from tp_controller.tools.view.camera import first_view
from tp_controller.tools.view.draggables import draggables_of
from tp_controller.tools.view.gizmos import FOLLOW_DELAY, Gizmos, SEND_PERIOD
from tp_controller.tools.view.joint_sliders import span
from tp_controller.tools.view.link import Link
from tp_controller.tools.view.markers import MarkerScene
from tp_controller.tools.view.page import Page, RATE
from tp_controller.tools.view.server import open_server
from tp_controller.tools.view.skeleton import JOINT_COLOUR
from tp_controller.tools.view.status import BAD, error_text, GONE
import viser
from visualization_msgs.msg import Marker, MarkerArray
import yaml

STACK = """\
- tip: {type: position, frame: link3, axes: xy, gain: 2.0}
# The rest.
- [turn: {type: orientation, frame: link3, axes: z}, slow: {type: joint, joints: [joint1]}]
- rest: {type: posture, gain: 1.0}
"""
# A camera that has a point in view, and an object beside it.
SURROUNDED = """\
- eye: {type: field_of_view, frame: link3, axis: x, half_angle: 0.6, target: [2.0, 1.4, 0]}
- avoid: {type: obstacles, links: link3, within: 0.9,  # wide
          capsules: {link3: {from: [0, 0, 0], radius: 0.05}},
          obstacles: {post: {shape: {sphere: 0.1}, at: [1.2, 1.2, 0]}}}
- tip: {type: position, frame: link3, axes: xy, gain: [2.0, 1.5]}
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

    def __init__(self, harness, server, stack=STACK, **parameters):
        server.scene.reset()
        server.gui.reset()
        self.harness, self.looking = harness, True
        # Drawing takes its time on the thread of the test, and nothing is to stop for that.
        self.simulator = harness.simulator(initial_positions=START, rate=50.0,
                                           command_timeout=5.0)
        self.controller = harness.controller(
            stack=stack, limits__joint1__velocity=0.5, state_timeout=5.0, check_stamps=False,
            **parameters)
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
                        and len(self.link.gains()) > 1 and self.page.gizmos.gizmos
                        and any(row.gains for row in self.page.stack.rows.values()), 'the page')
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
        return self.controller._robot.controller.stack


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


def test_what_the_controller_draws_of_its_tasks_is_shown_where_it_is(rig):
    shown = rig.page._markers._drawn
    rig.page.gizmos.gizmos['tip/goal'].drag(pose(np.eye(3), [0.6, 0.8, 0.0]))
    rig.spin_until(lambda: {('tip/goal', 0), ('tip/frame', 0), ('turn/goal', 0)} <= set(shown)
                   and np.allclose(shown['tip/goal', 0].handle.position[:2], [0.6, 0.8]),
                   'the goal where it was dragged')
    np.testing.assert_allclose(rig.stack.tasks['tip'].goal[:2], [0.6, 0.8])
    rig.spin_until(lambda: np.abs(shown['tip/frame', 0].handle.position[:2]
                                  - [0.6, 0.8]).max() < 0.01, 'the frame at the goal')


def test_robot_has_the_base_joints_and_limits_of_the_controller(rig):
    ours, theirs = rig.link.robot, rig.controller._robot.controller.robot
    assert ours.joint_names == theirs.joint_names and ours.base == theirs.base
    np.testing.assert_array_equal(ours.velocity, theirs.velocity)
    assert ours.velocity[0] == 0.5


def test_robot_stands_on_the_ground_once_it_is_known_where_it_is(rig):
    # Its joints turn about drums, half of each of which is below the root.
    drums = [part for parts in rig.page._robot.parts.values() for part in parts
             if part.colour == JOINT_COLOUR]
    assert rig.page._ground.position[2] == pytest.approx(
        -drums[0].mesh.vertices[:, 2].max())


def test_who_opens_the_page_sees_the_robot_where_it_is_and_not_at_zero(rig):
    points = np.concatenate((rig.page._robot.outer_points(), rig.page.gizmos.tips()))
    view = rig.page.server.initial_camera
    start = rig.link.robot.state(PLANAR_START)
    middle = np.mean([start.position(f'link{number}') for number in (1, 2, 3)], axis=0)
    assert np.linalg.norm(view.look_at[:2] - middle[:2]) < 0.5 * np.ptp(points, axis=0).max()
    np.testing.assert_allclose([view.position, view.look_at], first_view(points), atol=1e-2)
    zero = rig.link.robot.state(np.zeros(3)).position('link3')
    assert np.linalg.norm(zero - start.position('link3')) > 0.5


def test_rows_tell_the_tasks_by_priority_with_errors_and_gains(rig):
    assert rig.names == ['tip', 'turn', 'slow', 'rest']
    row = rig.page.stack.rows['tip']
    rig.spin_until(lambda: 'data-status="reached"' in row.text.content, 'reached')
    assert row.folder.label == '1 · tip  (position)' and 'mm' in row.text.content
    assert [gain.value for gain in row.gains] == [2.0] and row.enabled.value


def test_button_moves_a_level_up_and_goals_and_gains_stay(rig):
    goal = pose(np.eye(3), [0.7, 0.6, 0.0])
    rig.page.gizmos.gizmos['tip/goal'].drag(goal)
    rig.spin_until(lambda: np.allclose(rig.stack.tasks['tip'].goal[:2], goal[:2, 3]), 'the goal')
    act(rig.page.stack.rows['tip'].gains[0], 1.25)
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


def test_joint_that_has_stopped_the_robot_is_locked_and_unlocked(rig):
    lock, unlock = rig.page.locks.lock_button, rig.page.locks.unlock_button
    assert not lock.visible and not unlock.visible
    rig.controller._robot.loop.stops.latch('joint2 does not follow: made up', joint='joint2')
    rig.spin_until(lambda: lock.visible and 'joint2 does not follow' in
                   rig.page.state_text.content, 'the stop')
    assert lock.label == 'Lock joint2 and go on' and not unlock.visible
    act(lock)
    rig.spin_until(lambda: unlock.visible and rig.link.running, 'the lock')
    assert unlock.label == 'Unlock joint2' and not lock.visible
    assert list(rig.controller._robot.controller.locked) == ['joint2']
    assert 'locked joint2, the others go on' in rig.page.notice.content
    act(unlock)
    rig.spin_until(lambda: not unlock.visible, 'the joint unlocked')
    assert not rig.controller._robot.controller.locked


def test_lock_that_is_refused_is_said_with_its_reason_and_a_controller_that_is_gone_has_none(rig):
    act(rig.page.locks.lock_button)
    rig.spin_until(lambda: 'nothing locked: no joint' in rig.page.notice.content, 'the reason')
    rig.link.set_parameters({'locked_joints': ['joint1', 'joint3']}, rig.page._show_answer)
    rig.spin_until(lambda: rig.page.locks.unlock_button.visible, 'the locks')
    assert rig.page.locks.unlock_button.label == 'Unlock joint1, joint3'
    rig.harness.remove(rig.controller)
    rig.spin_until(lambda: not rig.page.locks.unlock_button.visible, 'the end')


def test_task_that_is_switched_off_leaves_the_stack_and_comes_back(rig):
    row = rig.page.stack.rows['slow']
    act(row.enabled, False)
    rig.spin_until(lambda: rig.stack.disabled == {'slow'}, 'the task out')
    rig.spin_until(lambda: 'data-status="disabled"' in row.text.content, 'the row')
    act(row.enabled, True)
    rig.spin_until(lambda: not rig.stack.disabled, 'the task back')


def test_box_follows_what_others_switch_off(rig):
    rig.controller._robot.controller.enable('slow', False)
    rig.spin_until(lambda: not rig.page.stack.rows['slow'].enabled.value, 'the box')


def test_progress_of_a_trajectory_is_shown_while_it_lasts(rig):
    text = rig.page.stack.rows['tip'].text
    assert 'of its trajectory' not in text.content
    message = make_trajectory('tip', rig.client.tasks()['tip'], [
        {'xyz': (0.5, 0.8, 0.0)}, {'xyz': (0.6, 0.7, 0.0)}], times=[0.5, 60.0], speed=0.0)
    rig.harness.publisher(type(message), '/tp_controller/tip/trajectory').publish(message)
    rig.spin_until(lambda: re.search(r'>[1-9][0-9]?% of its trajectory<', text.content),
                   'the progress')
    rig.harness.call(Trigger, '/tp_controller/tip/trajectory/cancel', meanwhile=rig.update)
    rig.spin_until(lambda: 'of its trajectory' not in text.content, 'the end')


def test_gain_that_is_refused_is_said_with_its_reason_and_shown_as_it_was(rig):
    row = rig.page.stack.rows['rest']
    act(row.gains[0], -3.0)
    rig.spin_until(lambda: 'must be from' in rig.page.notice.content, 'the reason')
    rig.spin_until(lambda: row.gains[0].value == 1.0, 'the gain that is in force')


def test_goal_that_is_refused_is_said_with_its_reason(rig):
    rig.page.gizmos.gizmos['tip/goal'].drag(pose(np.eye(3), [np.nan, 0.0, 0.0]))
    rig.spin_until(lambda: 'goal for task tip refused' in rig.page.notice.content, 'the reason')
    assert rig.controller._robot.topics.records['tip'].refusal in unescape(
        rig.page.notice.content)


def test_slider_of_a_joint_is_a_goal_of_the_chosen_task(rig):
    rig.spin_until(lambda: rig.page.joints.task.options == ('slow', 'rest'), 'the tasks')
    act(rig.page.joints.task, 'rest')
    act(rig.page.joints.sliders['joint3'], 0.9)
    rig.spin_until(lambda: rig.stack.tasks['rest'].goal[2] == 0.9, 'the goal')
    # The others show where the joints are.
    rig.spin_until(lambda: abs(rig.page.joints.sliders['joint2'].value - rig.q[1]) < 0.02)
    assert rig.page.joints.sliders['joint3'].value == 0.9


@pytest.fixture
def limited(harness, server):
    """Return the rig with position limits of one joint, once it runs."""
    found = Rig(harness, server, limits__joint2__lower=-2.5, limits__joint2__upper=1.25)
    yield found.ready()
    found.client.close()


def test_slider_has_the_range_of_the_limits_of_the_controller(limited):
    sliders = limited.page.joints.sliders
    assert (sliders['joint2'].min, sliders['joint2'].max) == (-2.5, 1.25)
    assert (sliders['joint3'].min, sliders['joint3'].max) == (-3.141, 3.141)


@pytest.mark.parametrize('lower, upper, low, high, decimals', [
    (-2.8973, 2.8973, -2.897, 2.897, 3), (0.0, 0.04, 0.0, 0.04, 3), (-6.2832, 9.9, -6.283, 9.9, 3),
    (-12.3456, 3.0, -12.34, 3.0, 2), (-np.inf, np.inf, -3.141, 3.141, 3),
    # Beyond what a slider is of use for.
    (-1000.0, 1000.0, -3.141, 3.141, 3), (-1000.0, -100.55, -106.8, -100.6, 1),
    (20.0, np.inf, 20.0, 26.28, 2),
    # Joints that cannot move.
    (0.12345, 0.12345, 0.12345, 0.12345, 3)])
def test_slider_moves_a_joint_within_its_limits_by_what_is_seen_of_its_position(
        lower, upper, low, high, decimals):
    np.testing.assert_allclose(span(lower, upper), (low, high, decimals), atol=1e-12)
    assert lower <= low and high <= upper


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
    rig.spin_until(lambda: GONE in rig.page.state_text.content)
    assert rig.page.start_button.disabled
    assert 'opacity' in rig.page.stack.rows['tip'].text.content


def test_a_short_stop_keeps_the_last_report_in_grey_and_is_no_fault(rig):
    rig.spin_until(lambda: rig.link.running and 'opacity' not in
                   rig.page.stack.rows['tip'].text.content, 'a report of a running robot')
    before = rig.link.rows
    status = rig.client.status
    # What the node sends where a joint state is late for a moment.
    node = rig.controller
    late = diagnostics(Time(), 'tp_controller', 'joint states are late', None,
                       node._robot.controller, node._robot.topics.records, {}, lambda: None)
    rig.client.catch_up = lambda: None
    rig.client.status = received(late)
    rig.page._texts_due = 0.0
    rig.page.update()
    text = rig.page.stack.rows['tip'].text.content
    assert rig.link.rows[0].status == 'stopped' and math.isnan(rig.link.rows[0].errors['m'])
    assert error_text(before[0]) in text and 'opacity' in text
    assert 'paused: joint states are late' in rig.page.state_text.content
    assert BAD not in rig.page.state_text.content
    del rig.client.catch_up
    rig.client.status = status


def test_a_controller_that_has_been_started_anew_is_said_to_have_no_goals(rig):
    rig.page.gizmos.gizmos['tip/goal'].drag(pose(np.eye(3), [1.2, 0.6, 0.0]))
    rig.spin_until(lambda: any(row.accepted for row in rig.link.rows), 'the goal')
    rig.harness.remove(rig.controller)
    rig.spin_until(lambda: not rig.link.present, 'the end')
    rig.controller = rig.harness.controller(stack=STACK, state_timeout=5.0, check_stamps=False)
    rig.spin_until(lambda: 'has no goals' in rig.page.notice.content, 'the notice')


def test_a_demo_that_has_finished_shows_its_last_report(rig):
    rig.page.update()
    # Newer than what the page shows, which has few texts a second.
    rig.link.rows = [replace(row, reason='the very last one') for row in rig.link.rows]
    rig.page.conclude('The demo has finished')
    assert 'the very last one' in rig.page.stack.rows['tip'].text.content


def test_results_of_a_demo_stay_when_its_controller_ends(rig):
    rig.page.conclude('The demo has finished\n5 of 5 <goals> reached')
    rig.harness.remove(rig.controller)
    rig.spin_until(lambda: not rig.link.present, 'the end')
    rig.page._texts_due = 0.0
    rig.page.update()
    text = rig.page.state_text.content
    assert 'The demo has finished' in text and '5 of 5 &lt;goals&gt; reached' in text
    assert not rig.page.stop_button.visible and not rig.page.start_button.visible
    assert 'opacity' not in rig.page.stack.rows['tip'].text.content


def test_axis_of_errors_has_a_line_for_each_power_of_ten_around_them(rig):
    plot = rig.page.plots.errors
    rig.spin_until(lambda: plot.names and plot._plot is not None, 'the plot')
    axis, scale = plot._plot.axes[1], plot._plot.scales['y']
    assert (scale['range'][0], scale['range'][1]) == (axis['splits'][0], axis['splits'][-1])
    values = np.array(plot._plot.data[1:])
    assert scale['range'][0] <= values.min() and values.max() <= scale['range'][1]
    np.testing.assert_allclose(np.diff(np.log10(axis['splits'])), 1.0)
    assert len(axis['values']) == len(axis['splits']) and any(axis['values'])


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


@pytest.fixture
def surrounded(harness, server):
    """Return a rig with a cone of view and an obstacle, once it runs."""
    found = Rig(harness, server, SURROUNDED)
    found.ready()
    found.spin_until(lambda: {'eye/cone', 'avoid/distance'} <= set(found.page.gizmos.gizmos),
                     'cone and distance')
    yield found
    found.client.close()


def test_opening_and_least_distance_are_dragged_and_the_rest_of_the_stack_stays(surrounded):
    rig, gizmos = surrounded, surrounded.page.gizmos.gizmos
    rig.link.set_parameters({'tasks.tip.tolerance': 0.01}, lambda worked, reason: None)
    act(rig.page.stack.rows['tip'].gains[1], 0.75)
    rig.spin_until(lambda: rig.link.gains()['tip'] == [2.0, 0.75]
                   and rig.link.values['tasks.tip.tolerance'] == 0.01, 'both on the page')
    moves = {name: gizmos[name].element for name in ('eye/cone', 'avoid/distance')}
    for name, place in moves.items():
        end = pose(place.T[:3, :3], place.T[:3, 3] + 0.06 * place.T[:3, 0])
        gizmos[name].begin_drag()
        gizmos[name].drag(end)
    rig.spin_until(lambda: rig.stack.tasks['avoid'].distance == 0.08
                   and rig.stack.tasks['eye'].upper > 0.6, 'both')
    wanted = moves['eye/cone'].value_at(
        pose(np.eye(3), moves['eye/cone'].T[:3, 3] + 0.06 * moves['eye/cone'].T[:3, 0]))
    assert rig.stack.tasks['eye'].upper == pytest.approx(wanted, abs=1e-4)
    rig.spin_until(lambda: rig.stack.tasks['tip'].gain.tolist() == [2.0, 0.75]
                   and rig.stack.tasks['tip'].groups[0].tolerance == 0.01, 'both again')
    assert '# wide' in rig.stack.text
    changed = yaml.safe_load(SURROUNDED)
    changed[0]['eye']['half_angle'] = rig.stack.tasks['eye'].upper
    changed[1]['avoid']['distance'] = 0.08
    assert yaml.safe_load(rig.stack.text) == changed
    rig.spin_until(lambda: gizmos['avoid/distance'].label.text == 'avoid: 80.0 mm', 'the label')


def test_least_distance_that_is_refused_is_said_and_stays_as_it_was(surrounded):
    gizmo = surrounded.page.gizmos.gizmos['avoid/distance']
    start = gizmo.element.T
    gizmo.begin_drag()
    gizmo.drag(pose(start[:3, :3], start[:3, 3] + 1.5 * start[:3, 0]))
    surrounded.spin_until(lambda: 'must be more than distance = 1.52'
                          in unescape(surrounded.page.notice.content), 'the reason')
    assert surrounded.stack.tasks['avoid'].distance == 0.02
    # What comes after it is taken, every time.
    for distance in (0.05, 0.07):
        # As in one drag.
        gizmo.drag(pose(start[:3, :3], start[:3, 3] + (distance - 0.02) * start[:3, 0]))
        surrounded.spin_until(
            lambda: surrounded.stack.tasks['avoid'].distance == distance, 'the distance')
    assert surrounded.page.notice.content == ''


def test_gain_with_a_number_for_each_row_is_changed_row_by_row(surrounded):
    row = surrounded.page.stack.rows['tip']
    assert [gain.value for gain in row.gains] == [2.0, 1.5]
    act(row.gains[0], 1.0)
    act(row.gains[1], 0.5)
    surrounded.spin_until(lambda: surrounded.stack.tasks['tip'].gain.tolist() == [1.0, 0.5],
                          'the gains')
    act(row.gains[1], 0.0)
    surrounded.spin_until(lambda: 'gain of task tip must be positive'
                          in surrounded.page.notice.content, 'the reason')
    surrounded.spin_until(lambda: row.gains[1].value == 0.5, 'the gain that is in force')


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


def told(place, T):
    """Return what is published when a place is dragged to a pose: the topic and the message."""
    published = []
    place.apply(T, lambda *message: published.append(message), None)
    (task, topic, message), = published
    assert task == place.task
    return topic, message


def quaternion(turn):
    """Return the rotation matrix (3, 3) of a message."""
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()


@pytest.mark.parametrize('kind, part', [
    (PointStamped, 'goal'), (PoseStamped, 'goal'), (QuaternionStamped, 'goal'),
    (PoseStamped, 'region')])
def test_dragged_goal_becomes_the_message_that_its_task_takes(kind, part):
    place, = draggables_of([marker(f'task/{part}')], {'task': {'goal': kind}}, {})
    topic, message = told(place, T)
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
    place, = draggables_of([arrow], {'look': {'goal': Vector3Stamped}}, {})
    np.testing.assert_allclose(place.T[:3, 3], [1.0, 2.3, 3.0])
    _, message = told(place, pose(np.eye(3), [1.0, 2.0, 3.5]))
    assert (message.vector.x, message.vector.y, message.vector.z) == (0.0, 0.0, 0.5)


def test_obstacle_that_is_dragged_keeps_its_name_and_shape_and_stays():
    box = marker('avoid/obstacle/shelf/2', Marker.CUBE)
    box.lifetime.sec, box.id = 1, 0
    place, = draggables_of([box], {}, {})
    topic, message = told(place, T)
    moved, = message.markers
    assert topic == 'obstacles' and isinstance(message, MarkerArray)
    assert (moved.ns, moved.id, moved.type) == ('shelf/2', 0, Marker.CUBE)
    assert (moved.lifetime.sec, moved.header.frame_id) == (0, 'base')
    assert moved.pose.position.x == 0.4 and moved.scale == box.scale
    # What the controller draws stays as it was.
    assert box.pose.position.x == 1.0


def test_region_is_dragged_by_itself_and_not_by_its_goal():
    markers = [marker('keep/goal'), marker('keep/region', Marker.CUBE), marker('tip/goal')]
    found = draggables_of(markers, dict.fromkeys(('keep', 'tip'), {'goal': PoseStamped}), {})
    assert [place.name for place in found] == ['keep/region', 'tip/goal']


def test_what_is_dragged_bears_a_name():
    markers = [marker('tip/goal'), marker('avoid/obstacle/shelf/2', Marker.CUBE)]
    assert [place.title for place in draggables_of(
        markers, {'tip': {'goal': PoseStamped}}, {})] == [
        'tip', 'shelf/2']


def drawn(sketch):
    """Return a sketch of the task `task` as the markers that the controller draws."""
    return Markers(0.1, None).message(Time(), 'base', {'task': [sketch]}).markers


def key_set(place, T):
    """Return the key and the value that are set when a place is dragged to a pose."""
    keys = []
    place.apply(T, None, lambda *key: keys.append(key))
    (task, key, value), = keys
    assert task == place.task
    return key, value


@pytest.mark.parametrize('opening', [0.2, 1.4, 2.5])
@pytest.mark.parametrize('key', ['half_angle', 'within'])
def test_rim_of_a_cone_is_dragged_to_another_opening(opening, key):
    place, = draggables_of(drawn(Cone('cone', T, opening, 0.5)), {}, {'task': {key: opening}})
    tip, axis = T[:3, 3], T[:3, 2]

    def angle(p):
        return np.arccos((p - tip) @ axis / np.linalg.norm(p - tip))

    rim = place.T[:3, 3]
    assert place.group == 'cones' and place.title == f'task: {np.degrees(opening):.1f}°'
    assert np.linalg.norm(rim - tip) == pytest.approx(0.5)
    assert angle(rim) == pytest.approx(opening)
    # Along its x axis, which is at right angles to the surface.
    outside = pose(place.T[:3, :3], rim + 0.05 * place.T[:3, 0])
    assert angle(outside[:3, 3]) == pytest.approx(opening + np.arctan(0.1))
    assert key_set(place, outside) == (key, round(opening + np.arctan(0.1), 4))
    ahead, behind = (key_set(place, pose(np.eye(3), tip + way * axis)) for way in (1.0, -1.0))
    assert 0.0 < ahead[1] < 0.02 and np.pi - 0.02 < behind[1] < np.pi


def test_least_distance_is_dragged_along_the_shortest_line_from_the_second_object():
    starts, ends = np.array([[0.1, 0.2, 0.3], [5.0, 0.0, 0.0]]), np.array([[0.1, 0.2, 0.9]] * 2)
    gaps = Gaps('distance', starts, ends, np.array([0.6, 5.0]), 0.2, 1.0)
    place, = draggables_of(drawn(gaps), {}, {'task': {'distance': 0.2}})
    assert place.group == 'distances' and place.title == 'task: 200.0 mm'
    np.testing.assert_allclose(place.T[:3, 3], [0.1, 0.2, 0.7])
    np.testing.assert_allclose(place.T[:3, 0], [0.0, 0.0, -1.0], atol=1e-12)
    assert np.linalg.det(place.T[:3, :3]) == pytest.approx(1.0)
    assert key_set(place, pose(np.eye(3), [0.1, 0.2, 0.65])) == ('distance', 0.25)
    assert key_set(place, pose(np.eye(3), [0.1, 0.2, 2.0])) == ('distance', 0.0)


def test_distances_are_changed_where_they_are_and_not_removed_and_added(server):
    server.scene.reset()
    shown = MarkerScene(server.scene)
    removed, handles = [], {}
    for lengths in ([0.1], [0.2, 0.3, 0.8], [0.4, 0.5]):
        starts = np.array([[0.0, number, 0.0] for number in range(len(lengths))])
        ends = starts + np.outer(lengths, [1.0, 0.0, 0.0])
        lines, text = drawn(Gaps('distance', starts, ends, np.array(lengths), 0.05, 1.0))
        shown.draw([lines, text])
        before, handles = handles, {key: each.handle for key, each in shown._drawn.items()}
        removed += [key for key, handle in before.items() if handles[key] is not handle]
        line, label = handles['task/distance', 0], handles['task/distance', 1]
        assert label.text == text.text == f'{lengths[0]:.3f} m'
        np.testing.assert_allclose(line.points, np.stack([starts, ends], axis=1), atol=1e-6)
        # Browsers get linear colours.
        np.testing.assert_allclose(
            line.colors.reshape(-1, 3), [[255.0 * each.r ** 2.2, 255.0 * each.g ** 2.2,
                                          255.0 * each.b ** 2.2] for each in lines.colors],
            atol=0.51)
    assert not removed


def test_cone_that_is_as_wide_as_an_error_and_distance_without_a_key_cannot_be_dragged():
    point = np.zeros((1, 3))
    markers = [*drawn(Cone('cone', T, 0.3, 0.5)),
               *drawn(Gaps('distance', point, point + 1.0, np.ones(1), 0.2, 1.0))]
    assert draggables_of(markers, {}, {'task': {'gain': 1.0}}) == []
    # Objects that touch each other show no direction.
    touching = drawn(Gaps('distance', point, point, np.zeros(1), 0.2, 1.0))
    assert draggables_of(touching, {}, {'task': {'distance': 0.2}}) == []


def test_what_cannot_be_told_cannot_be_dragged():
    markers = [marker('a/frame'), marker('a/error'), marker('b/goal'), marker('c/region')]
    topics = {'a': {'goal': PoseStamped}, 'c': {'goal': PointStamped}}
    assert draggables_of(markers, topics, {}) == []


class Dragged:
    """A goal that is dragged, on a clock that the test sets."""

    def __init__(self, server):
        server.scene.reset()
        self.now, self.sent = 0.0, []
        self.gizmos = Gizmos(server.scene, self.publish, self.set_key, lambda: self.now)
        self.follow(0.0)
        self.gizmo = self.gizmos.gizmos['tip/goal']

    def publish(self, task, topic, message):
        """Keep what is sent."""
        self.sent.append((task, topic, message.point.x))

    def set_key(self, task, key, value):
        """Keep what is set."""
        self.sent.append((task, key, value))

    def follow(self, x):
        """Let the controller have the goal at x."""
        self.gizmos.follow(draggables_of([marker('tip/goal', at=(x, 0.0, 0.0))],
                                         {'tip': {'goal': PointStamped}}, {}))

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
    assert 0.9 / SEND_PERIOD <= len(dragged.sent) <= 1.0 / SEND_PERIOD + 2
    assert dragged.sent[-1] == ('tip', 'goal', 99.0)


def test_gizmo_stays_in_the_hand_and_then_goes_where_the_controller_has_it(server):
    dragged = Dragged(server)
    dragged.now = 5.0
    dragged.drag(2.0)
    dragged.gizmo.handle.position = (2.0, 0.0, 0.0)
    dragged.gizmos.send()
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 2.0
    dragged.now = 5.1 + FOLLOW_DELAY
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 0.5


def test_gizmo_that_somebody_holds_stays_and_is_told_even_if_it_is_not_drawn_for_a_moment(server):
    dragged = Dragged(server)
    dragged.now = 5.0
    dragged.gizmo.begin_drag()
    dragged.now = 7.0 + FOLLOW_DELAY
    dragged.gizmos.follow([])
    dragged.follow(0.5)
    assert dragged.gizmos.gizmos == {'tip/goal': dragged.gizmo}
    dragged.gizmos.follow([])
    dragged.drag(2.0)
    dragged.gizmo.end_drag()
    dragged.gizmos.send()
    assert dragged.sent == [('tip', 'goal', 2.0)]
    dragged.gizmos.follow([])
    assert dragged.gizmos.gizmos
    dragged.now += 0.1 + FOLLOW_DELAY
    dragged.gizmos.follow([])
    assert not dragged.gizmos.gizmos


def test_gizmo_that_somebody_holds_does_not_move_by_itself(server):
    dragged = Dragged(server)
    dragged.gizmo.begin_drag()
    dragged.now = 1.0 + FOLLOW_DELAY
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 0.0
    dragged.gizmo.end_drag()
    dragged.follow(0.5)
    assert dragged.gizmo.handle.position[0] == 0.5


def gap(length, distance=0.2):
    """Return where the least distance is shown on a line of a length along x."""
    return draggables_of(drawn(Gaps(
        'distance', np.zeros((1, 3)), np.array([[length, 0.0, 0.0]]), np.array([length]),
        distance, 9.0)), {}, {'task': {'distance': distance}})


def test_distance_changes_by_as_much_as_it_is_dragged_while_the_robot_moves(server):
    dragged = Dragged(server)
    dragged.gizmos.follow(gap(1.0))
    gizmo, = dragged.gizmos.gizmos.values()
    for turn in (1, 2):
        gizmo.begin_drag()
        start = gizmo.element.T[:3, 3]
        dragged.gizmos.follow(gap(1.0 + turn))
        gizmo.drag(pose(np.eye(3), start - (0.05, 0.0, 0.0)))
        dragged.now += 1.0
        dragged.gizmos.send()
    assert dragged.sent == [('task', 'distance', 0.25)] * 2


@pytest.mark.parametrize('kind, axes, planes, turns', [
    (PointStamped, True, True, False), (PoseStamped, True, True, True),
    (QuaternionStamped, False, False, True), (None, True, False, False)])
def test_gizmo_has_handles_for_what_can_be_changed(server, kind, axes, planes, turns):
    dragged = Dragged(server)
    places = gap(1.0) if kind is None else draggables_of(
        [marker('task/goal')], {'task': {'goal': kind}}, {})
    dragged.gizmos.follow(places)
    gizmo, = dragged.gizmos.gizmos.values()
    handle = gizmo.handle
    assert (handle.disable_axes, handle.disable_sliders, handle.disable_rotations) == (
        not axes, not planes, not turns)
    assert handle.active_axes == (True, kind is not None, kind is not None)


def test_label_of_a_key_follows_its_value(server):
    dragged = Dragged(server)
    for distance in (0.2, 0.25):
        dragged.gizmos.follow(gap(1.0, distance))
        gizmo, = dragged.gizmos.gizmos.values()
        assert gizmo.label.text == f'task: {1e3 * distance:.1f} mm'


@pytest.mark.parametrize('end', [(0, 0, 1), (0, 0, -1), (1, 0, 0), (1, 0, -0.5), (1, 0, 0.5)])
def test_label_of_a_distance_covers_neither_its_arrow_nor_its_line_nor_its_text(server, end):
    dragged = Dragged(server)
    end = 0.02 * np.array([end], dtype=float)
    text, = (found for found in drawn(Gaps(
        'distance', np.zeros((1, 3)), end, np.array([0.02]), 0.005, 9.0)) if found.text)
    dragged.gizmos.follow(draggables_of(
        drawn(Gaps('distance', np.zeros((1, 3)), end, np.array([0.02]), 0.005, 9.0)), {},
        {'task': {'distance': 0.005}}))
    gizmo, = dragged.gizmos.gizmos.values()
    T_root_handle = pose(Rotation.from_quat(np.roll(gizmo.handle.wxyz, -1)).as_matrix(),
                         gizmo.handle.position)
    label, tip = ((T_root_handle @ [*point, 1.0])[2] for point in (
        gizmo.label.position, (gizmo.handle.scale, 0.0, 0.0)))
    start = T_root_handle[2, 3]
    above = gizmo.label.anchor == 'bottom-center'
    clear = 0.5 * gizmo.handle.scale - 1e-9
    assert label >= max(start, tip) + clear if above else label <= min(start, tip) - clear
    # The other one is on the other side.
    assert (text.pose.position.z < min(0.0, end[0, 2])) == above


def test_label_of_a_goal_is_above_it_however_it_is_turned(server):
    dragged = Dragged(server)
    for turn in (0.0, 1.0, np.pi):
        goal = marker('tip/goal')
        goal.pose.orientation.x, goal.pose.orientation.w = np.sin(0.5 * turn), np.cos(0.5 * turn)
        dragged.gizmos.follow(draggables_of([goal], {'tip': {'goal': PoseStamped}}, {}))
        gizmo, = dragged.gizmos.gizmos.values()
        R = Rotation.from_quat(np.roll(gizmo.handle.wxyz, -1))
        np.testing.assert_allclose(R.apply(gizmo.label.position), [0.0, 0.0, 0.11], atol=1e-6)
        assert gizmo.label.anchor == 'bottom-center'


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

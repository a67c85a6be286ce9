# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page in a real browser: what is seen, dragged and clicked there."""

from contextlib import contextmanager
import math
import os
from pathlib import Path
import re
import subprocess
import sys
import threading
import warnings

from browser_harness import NEEDS_BROWSER, SECONDS
from monitor import promise_of
import numpy as np
from PIL import Image
from processes_harness import Listener
import pytest
from robots import CONFIG, panda
from scipy.spatial.transform import Rotation
from tp_controller.resources import load_yaml
from tp_controller.tools.demos.chromium import chromium_flags, find_chromium
from tp_controller.tools.demos.processes import NodeProcess, own_domain
import yaml

SIZE = {'width': 960, 'height': 680}
# Where the camera is when the page opens.
POSITION, LOOK_AT, FIELD = np.array([1.9, -1.5, 1.3]), np.array([0.25, 0.05, 0.4]), 0.7
# Ground that the robot does not hide, nor shade.
BESIDE = np.array([[0.6, -0.6, 0.0], [0.9, -0.3, 0.0]])
# Share of a gizmo's size at which its arrows are taken hold of, and its size [m].
ARROW, GIZMO = 0.75, 0.22
# Of those on the rim of a cone and on the line between objects.
SMALL_GIZMO = 0.12
# Goals [m], which cannot be reached at once.
GOALS = {goal['task']: np.array(goal['xyz']) for goal in load_yaml(
    (CONFIG / 'conflict_goals.yaml').read_text())[0]}
# A camera in the hand that sees a point, and an object below the hand: both as they are to be.
OPENING, DISTANCE, RADIUS = 0.35, 0.05, 0.04
SURROUNDED = """
- eye: {{type: field_of_view, frame: panda_hand, half_angle: {opening}, target: {seen}}}
- avoid: {{type: obstacles, links: panda_hand, distance: {distance}, within: 0.6,
          capsules: {{panda_hand: {{from: [0, 0, 0], radius: {radius}}}}},
          obstacles: {{ball: {{shape: {{sphere: {radius}}}, at: {ball}}}}}}}
- rest: {{type: posture}}
"""
# Environment variable that names a folder where pictures are kept, and are sharp.
FOLDER = 'TP_CONTROLLER_SCREENSHOTS'

pytestmark = NEEDS_BROWSER


class View:
    """
    A controller with two tasks in conflict, and the page that shows it in a Chromium.

    Attributes
    ----------
    page : playwright.sync_api.Page
    client : Client
        Hears what the controller says, past the page.
    faults : list of str
        Errors on the console of the page.
    commands : list of ndarray
        Commands so far.
    markers : dict
        {namespace: marker} of the first of each that the controller draws.

    """

    def __init__(self, page, client, folder):
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray
        from visualization_msgs.msg import MarkerArray
        self.page, self.client, self._folder = page, client, folder
        self.faults, self.commands, self.markers = [], [], {}
        self.robot = panda()
        self._q = {}
        client.node.create_subscription(JointState, '/joint_states', self._on_state, 10)
        client.node.create_subscription(
            Float64MultiArray, '/velocity_controller/commands',
            lambda message: self.commands.append(np.array(message.data)), 10)
        client.node.create_subscription(
            MarkerArray, '/tp_controller/markers', lambda message: self.markers.update(
                (marker.ns, marker) for marker in message.markers if marker.id == 0), 10)
        page.on('pageerror', lambda error: self.faults.append(str(error)))
        page.on('console', lambda message: self.faults.append(message.text)
                if message.type == 'error' else None)

    def _on_state(self, message):
        """Take a joint state."""
        self._q.update(zip(message.name, message.position))

    def is_known(self):
        """Return whether it is known where the robot is."""
        return set(self.robot.joint_names) <= set(self._q)

    def state(self):
        """Return where the robot is."""
        return self.robot.state([self._q[name] for name in self.robot.joint_names])

    def place(self, frame):
        """Return where a frame is (3,) [m]."""
        return self.state().position(frame)

    def status(self, task):
        """Return the status of a task."""
        return self.client.task_status(task).status

    def stack(self):
        """Return the tasks that the controller has."""
        from rcl_interfaces.srv import GetParameters
        future = self.client.call(GetParameters, 'get_parameters',
                                  GetParameters.Request(names=['stack']))
        self.wait(future.done, 'the stack')
        return {name: keys for task in yaml.safe_load(future.result().values[0].string_value)
                for name, keys in task.items()}

    def set_stack(self, text):
        """Give the controller another stack."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter
        future = self.client.call(SetParameters, 'set_parameters', SetParameters.Request(
            parameters=[Parameter('stack', value=text).to_parameter_msg()]))
        self.wait(future.done, 'the other stack')
        assert future.result().results[0].successful, future.result().results[0].reason

    def wait(self, condition, what):
        """Wait until a condition holds, while page and controller go on."""
        def ready():
            # Events of the page are handled meanwhile.
            self.page.wait_for_timeout(1)
            return condition()

        if not self.client.wait(ready, SECONDS):
            self.picture('failed')
            pytest.fail(f'{what} did not come about within {SECONDS:g} s')

    def row(self, task, status=''):
        """Return the row of a task on the page, with a status perhaps."""
        return self.page.locator(f'[data-task="{task}"]'
                                 + (f'[data-status="{status}"]' if status else ''))

    def picture(self, name):
        """Keep a picture of the page, and return it."""
        path = self._folder / f'{name}.png'
        self.page.screenshot(path=path)
        if FOLDER in os.environ:
            kept = Path(os.environ[FOLDER])
            kept.mkdir(parents=True, exist_ok=True)
            (kept / path.name).write_bytes(path.read_bytes())
        return np.asarray(Image.open(path).convert('RGB')).astype(int)

    def pixel(self, point):
        """Return where a point (3,) is on the page [pixels]."""
        forward = LOOK_AT - POSITION
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        box = self.page.locator('canvas').first.bounding_box()
        x, y, z = np.array([right, np.cross(forward, right), forward]) @ (point - POSITION)
        scale = 0.5 * box['height'] / np.tan(0.5 * FIELD) / z
        return (box['x'] + 0.5 * box['width'] + scale * x,
                box['y'] + 0.5 * box['height'] + scale * y)

    def drag(self, start, end):
        """Drag with the mouse from a point (3,) to another [m]."""
        mouse = self.page.mouse
        mouse.move(*self.pixel(start))
        mouse.move(*self.pixel(start + 0.01 * (end - start)))
        mouse.down()
        for share in np.linspace(0.1, 1.0, 6):
            mouse.move(*self.pixel(start + share * (end - start)))
        mouse.up()

    def come_to_rest(self):
        """Wait until the robot stands still, and the page says so."""
        self.wait(lambda: self.commands and np.abs(self.commands[-1]).max() < 1e-3, 'rest')
        self.page.locator('[data-task="posture"]').filter(
            has_not_text='accelerat').wait_for()
        # Not in a pause, as where the machine has much to do.
        self.page.wait_for_selector('[data-state="running"]')

    def start(self):
        """Click Start, again where it is refused: on a busy machine joint states may be late."""
        button = self.page.get_by_role('button', name='Start')
        running = self.page.locator('[data-state="running"]')
        refused = self.page.get_by_text('not started')
        button.click()

        def runs():
            if refused.count() and not running.count():
                button.dispatch_event('click')
            return running.count()

        self.wait(runs, 'the start')

    def click(self, task, text):
        """Click a button in the row of a task."""
        self.page.locator(f'xpath=//*[@data-task="{task}"]/following::button'
                          f'[normalize-space()="{text}"]').first.click()


@contextmanager
def watched():
    """Let a monitor hear every command meanwhile, on a thread of its own."""
    listener, ended = Listener(), threading.Event()
    listener.promise = promise_of(panda(), 0.1, math.inf)
    thread = threading.Thread(target=listener.client.wait, args=(ended.is_set, math.inf))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        listener.client.close()
    assert len(listener.commands) > 100
    listener.check()


@pytest.fixture(scope='module')
def view(tmp_path_factory):
    """Return the page of the controller, once the robot is seen on it."""
    from playwright.sync_api import sync_playwright
    from tp_controller.ros.client.client import Client
    folder = tmp_path_factory.mktemp('view')
    with warnings.catch_warnings():
        # What it imports is deprecated in some versions of Python.
        warnings.simplefilter('ignore')
        import rosidl_generator_py  # noqa: F401
    arguments = ['--params-file', str(CONFIG / 'conflict.yaml')]
    with own_domain() as environment, pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            patch.setenv(name, value)
        with NodeProcess('simulator_node', arguments, environment, folder / 'simulator.log'), \
                NodeProcess('controller_node', arguments, environment,
                            folder / 'controller.log'), \
                watched(), sync_playwright() as playwright, Client() as client:
            server = subprocess.Popen(
                [sys.executable, '-m', 'tp_controller', 'view', '--node', 'tp_controller'],
                env=environment, stdout=subprocess.PIPE, text=True)
            browser = None
            try:
                address = re.search(r'http://\S+', server.stdout.readline()).group()
                browser = playwright.chromium.launch(
                    executable_path=find_chromium(), args=chromium_flags())
                page = browser.new_page(viewport=SIZE)
                page.set_default_timeout(1e3 * SECONDS)
                view = View(page, client, folder)
                camera = {'Position': POSITION, 'LookAt': LOOK_AT, 'Fov': [FIELD]}
                page.goto(f'{address}/?fixedDpr={1 if FOLDER in os.environ else 0.5}&' + '&'.join(
                    f'initialCamera{name}=' + ','.join(f'{value:g}' for value in values)
                    for name, values in camera.items()))
                page.wait_for_selector('[data-state="running"]')
                view.wait(lambda: view.row('hand').count() and view.is_known(), 'the first row')
                # That there is no graphics card is not what pictures are to show.
                notice = page.locator('.mantine-Notification-closeButton')
                if notice.count():
                    notice.first.click()
                for task, goal in GOALS.items():
                    client.send(task, xyz=goal.tolist())
                view.wait(lambda: view.status('hand') == 'reached', 'the first goal')
                yield view
            finally:
                if browser is not None:
                    browser.close()
                server.terminate()
                server.communicate()


def contrast(view, picture, point):
    """Return how much the pixels around a point (3,) differ, of 255."""
    column, row = map(round, view.pixel(point))
    return picture[row - 15:row + 15, column - 15:column + 15].std(axis=(0, 1)).max()


def redness(view, picture, point):
    """Return how much redder than green and blue a pixel near a point (3,) is, of 255."""
    column, row = map(round, view.pixel(point))
    around = picture[row - 2:row + 3, column - 2:column + 3]
    return (around[..., 0] - around[..., 1:].max(axis=2)).max()


def changed(before, after):
    """Return how many pixels of two pictures differ."""
    return int((np.abs(before - after).max(axis=2) > 40).sum())


def test_page_shows_the_robot_and_its_tasks_without_errors_on_the_console(view):
    links = [f'panda_link{number}' for number in (1, 3, 4, 6)]

    def robot_is_seen():
        picture = view.picture('robot')
        return all(contrast(view, picture, view.place(link)) > 20.0 for link in links)

    view.wait(robot_is_seen, 'the robot')
    # The ground beside it has faint lines, and nothing else.
    picture = view.picture('robot')
    assert all(contrast(view, picture, place) < 20.0 for place in BESIDE)
    assert [view.row(task).count() for task in ('hand', 'elbow', 'posture')] == [1, 1, 1]
    assert view.faults == []


def test_a_goal_that_is_dragged_takes_the_robot_along(view):
    goal = GOALS['hand']
    before = view.place('panda_hand_tcp')
    picture = view.picture('before')
    up = np.array([0.0, 0.0, 1.0])
    view.drag(goal + ARROW * GIZMO * up, goal + ARROW * GIZMO * up - 0.15 * up)

    def has_followed():
        return view.place('panda_hand_tcp')[2] < before[2] - 0.1 \
            and view.status('hand') == 'reached'

    view.wait(has_followed, 'the hand below')
    # Along the arrow that was dragged, and not aside.
    view.picture('dragged')
    after = view.place('panda_hand_tcp')
    np.testing.assert_allclose(after[:2], goal[:2], atol=5e-3)
    view.row('hand', 'reached').wait_for()
    view.wait(lambda: changed(picture, view.picture('dragged')) > 500, 'another picture')


def test_the_task_that_is_moved_up_wins_from_the_one_below(view):
    view.wait(lambda: view.status('hand') == 'reached' and view.status('elbow') == 'limited',
              'the hand at its goal')
    view.row('elbow', 'limited').wait_for()
    view.come_to_rest()
    elbow = view.place('panda_link4')
    view.picture('hand_first')
    view.click('hand', '▼ down')
    view.wait(lambda: view.status('elbow') == 'reached' and view.status('hand') == 'limited',
              'the elbow at its goal')
    view.row('elbow', 'reached').wait_for()
    view.row('hand', 'limited').wait_for()
    view.wait(lambda: view.client.task_names()[:2] == ['elbow', 'hand'], 'the other order')
    view.come_to_rest()
    view.picture('elbow_first')
    np.testing.assert_allclose(view.place('panda_link4'), GOALS['elbow'], atol=5e-3)
    assert np.linalg.norm(elbow - GOALS['elbow']) > 0.03


def test_stop_stops_and_start_goes_on(view):
    view.page.get_by_role('button', name='Stop').click()
    view.page.locator('[data-state^="stopped"]').wait_for()
    del view.commands[:]
    view.wait(lambda: view.commands, 'a command')
    assert not np.any(view.commands)
    view.picture('stopped')
    view.start()
    assert view.faults == []


def place_of(pose, point):
    """Return where a point of a marker is (3,) [m]."""
    p, turn = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z]) + Rotation.from_quat(
        [turn.x, turn.y, turn.z, turn.w]).apply([point.x, point.y, point.z])


def drag_arrow(view, p, out, way):
    """Drag the arrow of a small gizmo at p (3,) along it [m], once it is seen: it is red."""
    start = p + ARROW * SMALL_GIZMO * out
    view.wait(lambda: redness(view, view.picture('arrow'), start) > 60.0, 'the arrow')
    view.drag(start, start + way * out)


def test_opening_of_a_cone_and_least_distance_are_dragged_by_their_arrows(view):
    view.come_to_rest()
    hand, up = view.state().pose('panda_hand'), np.array([0.0, 0.0, 1.0])
    tip, axis = hand[:3, 3], hand[:3, 2]
    ball = tip - 0.5 * up
    view.set_stack(SURROUNDED.format(
        opening=OPENING, distance=DISTANCE, radius=RADIUS, ball=ball.tolist(),
        seen=(tip + 0.5 * axis).tolist()))
    view.wait(lambda: {'eye/cone', 'avoid/distance'} <= set(view.markers), 'cone and distance')
    view.row('avoid', 'satisfied').wait_for()
    # The arrow on the rim of the cone is at right angles to its surface, which ends there.
    cone = view.markers['eye/cone']
    rim = place_of(cone.pose, cone.points[1])
    side = (rim - tip) / np.linalg.norm(rim - tip)
    across = (side - np.cos(OPENING) * axis) / np.sin(OPENING)
    drag_arrow(view, rim, np.cos(OPENING) * across - np.sin(OPENING) * axis, 0.06)
    wider = OPENING + np.arctan(0.06 / np.linalg.norm(rim - tip))
    view.wait(lambda: abs(view.stack()['eye']['half_angle'] - wider) < 0.01, 'the opening')
    # That on the line is as far from the ball as the hand is to stay.
    drag_arrow(view, ball + (RADIUS + DISTANCE) * up, up, 0.05)
    view.wait(lambda: abs(view.stack()['avoid']['distance'] - DISTANCE - 0.05) < 0.005,
              'the distance')
    assert view.stack()['eye']['half_angle'] == pytest.approx(wider, abs=0.01)
    view.picture('surrounded')
    assert view.faults == []

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The first view of a page has the robot and all that can be dragged beside the panel."""

from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
import numpy as np
from pages import CONTROLLER, MadeUpController
import pytest
from robots import CONFIG, panda, planar
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from tp_controller import Robot
from tp_controller.tools.view.camera import FIELD_OF_VIEW
from tp_controller.tools.view.draggables import GOALS
from tp_controller.tools.view.gizmos import SIZES
from tp_controller.tools.view.page import VIEW_SECONDS
from tp_controller.tools.view.server import LOCAL, open_server, PANEL_WIDTH, unused_port
from visualization_msgs.msg import Marker, MarkerArray

# Between the scene and the panel [pixels].
EDGE = 4
WINDOWS = [(800, 600), (1024, 768), (1280, 800), (1920, 1080), (2560, 1440)]
TASK = {'type': 'pose', 'level': '1', 'status': 'moving'}
# {robot: (what makes it, frames with a goal)}
ROBOTS = {
    'panda': (panda, ('panda_hand_tcp',)),
    'planar': (planar, ('link3',)),
    'two arms': (lambda: Robot.from_file(CONFIG / 'robots' / 'two_arms.urdf'), ()),
}


@pytest.fixture(scope='module')
def server():
    """Return a server whose page nobody opens."""
    found = open_server(LOCAL, unused_port())
    yield found
    found.stop()


def goal(task, p, turn):
    """Return the marker of a goal."""
    x, y, z, w = turn.as_quat().tolist()
    found = Marker(ns=f'{task}/goal', type=Marker.SPHERE, pose=Pose(
        position=Point(x=p[0], y=p[1], z=p[2]), orientation=Quaternion(x=x, y=y, z=z, w=w)))
    found.scale.x = found.scale.y = found.scale.z = 0.1
    found.color.a = 1.0
    return found


def opened(server, robot, goals):
    """Return the page of a robot whose configuration is heard before its goals."""
    page = MadeUpController(server, robot)
    page.tell(**dict.fromkeys(goals, TASK))
    page.client.topics = {task: {'goal': PoseStamped} for task in goals}
    page.hear('/joint_states', JointState(name=robot.joint_names,
                                          position=np.zeros(robot.n).tolist()))
    page.update()
    page.hear(f'/{CONTROLLER}/markers', MarkerArray(markers=list(goals.values())))
    page.update()
    return page


def pixels(camera, points, width, height):
    """Return where points are in a window [pixels]; viser keeps z upright."""
    position, forward = np.array(camera.position), np.array(camera.look_at) - camera.position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    x, y, z = np.array([right, np.cross(forward, right), forward]) @ (points - position).T
    assert (z > 0.0).all()
    # The field of view is that of the height; the scene is as wide as the panel leaves.
    unit = 0.5 * height / np.tan(0.5 * FIELD_OF_VIEW)
    return 0.5 * (width - PANEL_WIDTH - EDGE) + unit * x / z, 0.5 * height + unit * y / z


@pytest.mark.parametrize('name', sorted(ROBOTS))
@pytest.mark.parametrize('seed', range(6))
def test_arrows_of_all_gizmos_are_left_of_the_panel(server, name, seed):
    robot, frames = ROBOTS[name][0](), ROBOTS[name][1]
    random = np.random.default_rng(seed)
    state = robot.state(robot.neutral())
    places = [state.position(frame) for frame in frames or robot.frame_names[-1:]]
    # Goals are where the tools are, or up to a metre away, turned in any way.
    far = 0.0 if seed == 0 else 1.0
    turns = Rotation.random(len(places) + 1, random_state=seed)
    goals = {f't{number}': goal(f't{number}', (p + far * random.uniform(-1.0, 1.0, 3)).tolist(),
                                turns[number])
             for number, p in enumerate([*places, places[0]])}
    page = opened(server, robot, goals)
    poses = [(np.array([each.pose.position.x, each.pose.position.y, each.pose.position.z]),
              turns[number].as_matrix()) for number, each in enumerate(goals.values())]
    tips = np.concatenate([p + SIZES[GOALS] * R.T for p, R in poses])
    assert len(page.page.gizmos.gizmos) == len(goals)
    for width, height in WINDOWS:
        x, y = pixels(server.initial_camera, tips, width, height)
        assert x.min() > 0.0 and x.max() < width - PANEL_WIDTH - EDGE
        assert y.min() > 0.0 and y.max() < height


def test_view_of_a_robot_without_goals_waits_no_longer_than_it_says(server, monkeypatch):
    camera, before = server.initial_camera, (5.0, 6.0, 7.0)
    page = opened(server, planar(), {})
    camera.position = before
    page.update()
    assert tuple(camera.position) == before
    now = page.page._view_due
    monkeypatch.setattr('tp_controller.tools.view.page.time.monotonic', lambda: now + 0.1)
    page.update()
    assert tuple(camera.position) != before
    assert 0.0 < VIEW_SECONDS <= 5.0
    # From then on the view is the user's.
    camera.position = before
    page.update()
    assert tuple(camera.position) == before

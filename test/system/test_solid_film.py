# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The film of a solid robot, rendered in a real browser."""

import numpy as np
from PIL import Image
import pytest
from robots import CONFIG, panda
from tp_controller import Robot, Stack, TpControllerError
from tp_controller.model.shapes import Box
from tp_controller.tools.demos.chromium import (
    chromium_flags,
    find_chromium,
    NO_FRAME_LIMIT,
    open_page,
)
from tp_controller.tools.demos.motion import FixedObject, Look, Motion

STACK = """\
- clear: {type: keep_out, frame: panda_hand_tcp, shape: {cylinder: [0.1, 0.8]},
          at: [0.6, 0.3, 0.4]}
- tool: {type: position, frame: panda_hand_tcp}
"""
# The parts of a film apart from each other, seen from the front, about a robot on the left.
APART = """\
- out: {type: keep_out, frame: tool, shape: {box: [0.4, 0.4, 0.4]}, at: [0.0, 2.0, 0.2]}
- in: {type: keep_in, frame: tool, shape: {box: [0.6, 0.6, 0.6]}, at: [0.0, 3.0, 0.3]}
- seen: {type: field_of_view, frame: tool, half_angle: 0.4, target: [5.0, 0.0, 0.5]}
- tool: {type: pose, frame: tool}
"""
# Size of the band with the caption [pixels].
BAND = 54
# Pictures until nothing else is drawn any more.
TRIES = 100

film = pytest.importorskip('tp_controller.tools.demos.film', reason='needs viser')
stage = pytest.importorskip('tp_controller.tools.demos.stage')
pytestmark = [
    pytest.mark.skipif(find_chromium() is None, reason='needs a Chromium on the PATH')]


def pictures_of(motion, folder):
    """Return the pictures (h, w, 3) of the film of a motion, captions included."""
    path = film.write_film(folder / 'film.webp', motion)
    with Image.open(path) as picture:
        assert picture.size == film.SIZE and picture.n_frames == len(motion.times)
        pictures = []
        for frame in range(picture.n_frames):
            picture.seek(frame)
            pictures.append(np.asarray(picture.convert('RGB')).astype(int))
    return pictures


def share(picture, colour, tolerance):
    """Return the share of pixels near a colour [%]."""
    return 100.0 * (np.abs(picture - np.array(colour)).max(axis=2) < tolerance).mean()


def test_film_shows_a_solid_robot_that_moves_its_goal_and_an_obstacle(tmp_path):
    robot = panda()
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8]) + np.outer([0.0, 1.0], [0.6, *6 * [0.0]])
    first, last = pictures = [picture[:-BAND] for picture in pictures_of(Motion(
        'title', robot, np.array([0.0, 1.0]), q, Stack.from_yaml(STACK, robot),
        Look(('panda_hand_tcp',)), goals=[(0.5, 'tool', [0.4, -0.3, 0.5])]),
        tmp_path)]
    moved = np.abs(first - last).max(axis=2) > 40
    assert 0.03 < moved.mean() < 0.5
    # Nothing of it is cut off at an edge.
    assert not any(edge.any() for edge in (moved[0], moved[-1], moved[:, 0], moved[:, -1]))
    brown = [(each[..., 0] > each[..., 2] + 60) & (each[..., 1] > 60) for each in pictures]
    assert all(0.02 < each.mean() < 0.3 for each in brown)
    orange = [share(each, (200, 90, 15), 60) for each in pictures]
    assert orange[1] > orange[0] + 0.01


def test_a_browser_that_still_shows_the_page_of_a_demo_does_not_get_into_its_film():
    from tp_controller.tools.view.server import PORTS
    # It connects again to whatever is at the address of the page.
    with film._server() as server:
        assert server.get_port() not in PORTS


def test_every_part_is_where_it_belongs(tmp_path):
    robot = Robot.from_file(CONFIG / 'robots' / 'mobile_arm.urdf', base='planar')
    q = np.tile(robot.neutral(), (2, 1))
    q[0, 1] = -1.0
    motion = Motion(
        'title', robot, np.array([0.0, 1.0]), q, Stack.from_yaml(APART, robot), Look(
            ('tool',), (FixedObject('base_link', Box(0.3, 0.3, 0.3), (0.0, 0.8, 0.15)),),
            (('laser', 'tool'),), view=(0.0, 30.0)),
        goals=[(0.0, 'tool', [0.5, -1.8, 0.6, 0.0, 0.0, 0.0, 1.0])])
    camera = stage.camera_of(motion, [0, 1], 4.0 / 3.0)
    before, after = pictures_of(motion, tmp_path)
    state = robot.state(q[1])
    tool, laser = state.position('tool'), state.position('laser')

    def colour(point, picture=after):
        """Return red, green and blue where a point (3,) is seen."""
        right, down, forward = (np.array(point) - camera.position) @ camera.R
        scale = film.SIZE[1] / 2.0 / np.tan(film.FILM_FOV / 2.0) / forward
        x = round(film.SIZE[0] / 2.0 + scale * right)
        y = round(film.SIZE[1] / 2.0 + scale * down)
        return np.median(picture[y - 1:y + 2, x - 1:x + 2], axis=(0, 1)).tolist()

    def is_like(found, expected):
        """Say whether it is a colour, in light or in shadow."""
        found, expected = (np.array(each) / np.linalg.norm(each) for each in (found, expected))
        return found @ expected > 0.985

    axes = 0.05 * camera.distance * np.eye(3)
    goal = np.array([0.5, -1.8, 0.6])
    assert is_like(colour(goal), (213, 94, 0))
    for number, axis in enumerate(axes):
        # x is red, y green, z blue.
        shade = colour(goal + axis)
        assert shade[number] > 1.8 * max(np.delete(shade, number)), shade
    assert is_like(colour((0.2, 2.0, 0.2)), (176, 122, 66))
    assert is_like(colour((0.15, 0.8, 0.15)), (204, 121, 167))
    assert is_like(colour((0.15, -0.2, 0.15), before), (204, 121, 167))
    assert is_like(colour(0.5 * (tool + laser)), (204, 121, 167))
    # A thin line.
    red, _, blue = colour(tool - (0.0, 0.5, 0.0))
    assert blue - red > 80
    # The front of the base, which comes, beside what the tool carries.
    assert is_like(colour((0.25, 0.15, 0.1)), (51, 74, 99))
    assert is_like(colour((0.25, -0.85, 0.1), before), (51, 74, 99))
    assert min(colour((0.25, -0.85, 0.1))) > 150
    # The sky is the same from corner to corner, wherever the camera is.
    corners = np.concatenate((after[5:20, 5:20], after[5:20, -20:-5]))
    assert np.ptp(corners.reshape(-1, 3), axis=0).max() < 10
    # Green is seen through, as blue is; the ground is grey.
    red, green, _ = colour((0.0, 3.0, 0.3))
    assert green - red > 12
    red, _, blue = colour(tool + (0.0, 0.0, 0.3))
    assert blue - red > 20
    ground = colour((0.5, -0.4, 0.0))
    assert max(ground) - min(ground) < 20 and 150 < min(ground) < 250


def test_nothing_is_drawn_but_the_pictures():
    playwright = pytest.importorskip('playwright.sync_api')
    from tp_controller.tools.view.server import address
    camera = film.Camera(np.array([0.0, 0.0, 3.0]), np.diag([1.0, -1.0, -1.0]), 3.0)
    with film._server() as server, playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=find_chromium(),
                                         args=[*chromium_flags(), NO_FRAME_LIMIT])
        page = browser.new_page(viewport={'width': 160, 'height': 120})
        page.goto(address(server))
        client = film._client(server, HeadlessPage())

        def picture():
            """Take a picture, after something has changed."""
            server.scene.add_icosphere('/ball', 0.1)
            film._picture(client, HeadlessPage(), camera, (80, 60))
            return page.evaluate('window.__viserTestpoints.rendererInfo.render.frame')

        page.wait_for_function(
            "document.querySelector('#root').getBoundingClientRect().top > innerHeight")
        # What was begun before that is drawn to its end.
        first = picture()
        for _ in range(TRIES):
            before, first = first, picture()
            if first == before + 1:
                break
        assert [picture() - first for _ in range(4)] == [1, 2, 3, 4]
        browser.close()


class HeadlessPage:
    """A page that never ends."""

    def check(self):
        """Find no fault."""


def test_a_browser_that_ends_says_what_it_said_last():
    # Any program that is there will do.
    with open_page('false', 'http://127.0.0.1:1', 100, 100) as page:
        page._process.wait()
        with pytest.raises(TpControllerError, match=r'Chromium ended \(exit code 1\)'):
            page.check()

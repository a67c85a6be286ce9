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

"""Films drawn with lines show what they should; solid ones are tested in test/system."""

import contextlib
from types import SimpleNamespace

from matplotlib.colors import to_rgb
import numpy as np
from PIL import Image
import pytest
from robots import CONFIG, planar, urdf_robot
from tp_controller import Robot, Stack
from tp_controller.model.shapes import Box
from tp_controller.tasks.sketch import Arrow, Body, Dot
from tp_controller.tools.cli.demo import FILM, NO_FILM
from tp_controller.tools.demos import film, film_lines, film_solid
from tp_controller.tools.demos.motion import FixedObject, Motion, Playback
from tp_controller.tools.extras import install_command
from tp_controller.tools.plots import drawing
from viser import ViserServer

TIMES = np.linspace(0.0, 10.0, 300)
CAMERA = film_solid.Camera(np.zeros(3), np.eye(3), 1.0)
TOOL = '- tool: {{type: position, frame: {}}}\n'
AROUND = """\
- clear: {type: keep_out, frame: tool, shape: {cylinder: [0.2, 1.0]}, at: [1.5, 0.5, 0.5]}
- stay: {type: keep_in, frame: tool, shape: {box: [4, 4, 4]}}
- base: {type: base_pose}
"""


def swing(robot, amplitude=0.4):
    """Return positions (300, n) of a slow swing."""
    rates = np.linspace(0.4, 1.0, robot.n)
    return robot.neutral() + amplitude * np.sin(TIMES[:, None] * rates)


def motion_of(robot, q, times=TIMES, frame=None, stack='', **options):
    """Return a motion of which one frame is followed."""
    frame = frame or robot.frame_names[-1]
    return Motion('title', robot, times, q, Stack.from_yaml(TOOL.format(frame) + stack, robot),
                  (frame,), **options)


def pixels(path, frame=0):
    """Return a picture (h, w, 3) of a film without its caption, in 0 to 1."""
    with Image.open(path) as picture:
        picture.seek(frame)
        return np.asarray(picture.convert('RGB'))[:-60] / 255.0


def count(picture, colour, tolerance=0.12):
    """Return how many pixels have a colour, as nearly as WebP has it."""
    return int((np.abs(picture - np.array(to_rgb(colour))).max(axis=2) < tolerance).sum())


def test_a_film_says_how_far_it_is_and_can_be_left_out(tmp_path, monkeypatch, capsys):
    robot = planar()
    drawn = []
    monkeypatch.setattr(film, 'progress', lambda total, what: contextlib.nullcontext(
        SimpleNamespace(advance=lambda: drawn.append(total))))
    motion = motion_of(robot, swing(robot)[:20], TIMES[:20])
    path, = film.films(tmp_path / 'arm.webp', motion)
    assert path.is_file() and drawn == [20] * 20
    assert '20 pictures' in capsys.readouterr().out
    monkeypatch.setenv(film.CHOICE, film.NONE)
    assert film.films(tmp_path / 'none.webp', motion) == ()
    assert (FILM, NO_FILM) == (film.CHOICE, film.NONE)
    assert capsys.readouterr().out == '' and not (tmp_path / 'none.webp').exists()


def test_film_of_a_planar_arm_shows_arm_path_and_goal(tmp_path):
    robot = planar()
    path = film.write_film(tmp_path / 'arm.webp', motion_of(
        robot, swing(robot), goals=[(5.0, 'tool', [1.0, 0.5, 0.0])]))
    with Image.open(path) as picture:
        assert picture.size == film.SIZE
        assert picture.n_frames == film.MAX_FRAMES
        picture.load()
        assert picture.n_frames * picture.info['duration'] == pytest.approx(10000, rel=0.1)
    first, last = pixels(path), pixels(path, film.MAX_FRAMES - 1)
    assert np.abs(first - last).max() > 0.5
    assert count(last, drawing.GOAL_COLOUR, 0.2) > count(first, drawing.GOAL_COLOUR, 0.2) + 30
    assert count(last, drawing.PATH_COLOUR, 0.25) > count(first, drawing.PATH_COLOUR, 0.25) + 30
    assert count(last, drawing.ARM_COLOUR) > 300
    assert path.stat().st_size < 1_000_000


@pytest.mark.parametrize('name', ['panda', 'tiago'])
def test_film_in_space_is_small(tmp_path, name):
    robot = urdf_robot(name)
    path = film.write_film(tmp_path / 'arm.webp', motion_of(
        robot, swing(robot, 0.2)[::10], TIMES[::10]))
    with Image.open(path) as picture:
        assert picture.n_frames == 30
    assert path.stat().st_size < 1_000_000


def test_film_shows_the_base_the_carried_object_and_its_surroundings(tmp_path):
    robot = Robot.from_file(CONFIG / 'robots' / 'mobile_arm.urdf', base='planar')
    q = np.tile(robot.neutral(), (20, 1))
    q[:, 0] = np.linspace(0.0, 1.0, 20)
    bare = film.write_film(tmp_path / 'bare.webp', motion_of(robot, q, TIMES[:20]))
    full = film.write_film(tmp_path / 'full.webp', motion_of(
        robot, q, TIMES[:20], stack=AROUND, carried=(('laser', 'tool'),)))
    for colour in (film_lines.CARRIED_COLOUR, film_lines.AROUND_COLOUR):
        assert count(pixels(bare), colour) < 10
        assert count(pixels(full), colour) > 100
    # It is seen to move.
    assert np.abs(pixels(bare) - pixels(bare, 19)).max() > 0.5


@pytest.mark.parametrize('samples', [1, 2])
def test_the_shortest_motions_can_be_drawn(tmp_path, samples):
    path = film.write_film(tmp_path / 'e.webp', motion_of(
        planar(), swing(planar())[:samples], TIMES[:samples]))
    with Image.open(path) as picture:
        assert picture.n_frames == samples


def test_caption_is_that_of_the_last_step_that_began():
    robot = planar()
    motion = motion_of(robot, swing(robot), captions=[(2.0, 'first'), (5.0, 'second')])
    at = {time: motion.caption(int(np.searchsorted(TIMES, time))) for time in (0.0, 2.1, 4.9, 9.0)}
    assert at == {0.0: '', 2.1: 'first', 4.9: 'first', 9.0: 'second'}


def band(path, frame):
    """Return whether each pixel (54, w) of the band below a picture has ink on it."""
    with Image.open(path) as picture:
        picture.seek(frame)
        return np.asarray(picture.convert('L'))[-54:] < 110


def test_caption_of_each_step_and_the_time_are_below_the_picture(tmp_path):
    robot = planar()
    path = film.write_film(tmp_path / 'arm.webp', motion_of(
        robot, swing(robot)[:3], TIMES[:3], captions=[
            (TIMES[1], 'second'), (TIMES[2], 'the third step, which has a very long caption: ' + (
                'it has to leave as much of the band as the time needs for itself'))]))
    inks = [band(path, frame) for frame in range(3)]
    clock = [np.flatnonzero(ink.any(axis=0))[-1] for ink in inks]
    assert max(clock) < film.SIZE[0] and min(clock) > film.SIZE[0] - 20
    # Title, caption, and one in two lines.
    ends = []
    for ink in inks:
        columns = np.flatnonzero(ink.any(axis=0))
        assert 8 < columns[0] < 24
        gap = np.diff(columns)
        ends.append(columns[gap.argmax()])
        assert gap.max() > 20
        assert not ink[:2].any() and not ink[-1].any()
    assert ends[0] < ends[1] < ends[2] > 600
    # A blank row between the two lines.
    rows = inks[2][:, :ends[2] + 1].any(axis=1)
    first, last = np.flatnonzero(rows)[[0, -1]]
    assert not rows[first:last].all()
    assert inks[0][:, :ends[0]].any(axis=1).sum() < rows.sum()


def test_playback_shows_goals_from_when_they_are_given_and_regions_throughout():
    robot = Robot.from_file(CONFIG / 'robots' / 'mobile_arm.urdf', base='planar')
    motion = motion_of(robot, np.tile(robot.neutral(), (300, 1)), stack=AROUND, frame='tool',
                       goals=[(5.0, 'tool', [1.0, 2.0, 0.5])])
    playback = Playback(motion)
    assert playback.goals() == []
    assert [body.part for body in playback.bodies()] == ['region', 'region']
    playback.seek(299)
    goal, = playback.goals()
    np.testing.assert_allclose(goal, [1.0, 2.0, 0.5])
    shown = [type(sketch) for parts in playback.sketches().values() for sketch in parts]
    # A point, without axes that would turn with the tool.
    assert shown.count(Dot) == 1 and shown.count(Body) == 2 and len(shown) == 4
    # A line leads there.
    line, = (sketch for parts in playback.sketches().values() for sketch in parts
             if isinstance(sketch, Arrow))
    np.testing.assert_allclose(line.end, [1.0, 2.0, 0.5])
    np.testing.assert_allclose(line.start, playback.state.position('tool'))
    # The stack of the motion stays as it was.
    assert motion.stack.tasks['tool'].goal is None


@pytest.mark.parametrize('fault', ['no Chromium', 'no viser'])
def test_film_is_drawn_with_lines_where_nothing_solid_can_be_and_the_reason_is_said(
        tmp_path, monkeypatch, capsys, fault):
    monkeypatch.delenv(film.CHOICE)
    if fault == 'no viser':
        monkeypatch.setitem(__import__('sys').modules, 'viser', None)
        monkeypatch.delitem(__import__('sys').modules, film_solid.__name__)
    monkeypatch.setattr(film_solid, 'find_chromium', lambda: None)
    path = film.write_film(tmp_path / 'arm.webp', motion_of(planar(), swing(planar())[:2],
                                                            TIMES[:2]))
    said = capsys.readouterr().err
    assert said.startswith('The film is drawn with lines: ') and said.count('\n') == 1
    assert ('chromium' in said) is (fault == 'no Chromium')
    assert (install_command('view') in said) is (fault == 'no viser')
    assert count(pixels(path), drawing.ARM_COLOUR) > 300


@pytest.mark.parametrize('ground, height', [(None, -1.15), (-4.2, -4.2)])
def test_robot_of_a_solid_film_stands_on_the_ground_at_first_unless_it_is_said_where(
        ground, height):
    robot = Robot.from_urdf(
        '<robot name="leg"><link name="pelvis"/><link name="foot"><visual>'
        '<geometry><box size="0.1 0.1 0.3"/></geometry></visual></link>'
        '<joint name="hip" type="prismatic"><parent link="pelvis"/><child link="foot"/>'
        '<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>')
    server = ViserServer('127.0.0.1', 0, verbose=False)
    try:
        film_solid._Stage(server.scene, motion_of(
            robot, np.array([[-1.0], [-1.5]]), TIMES[:2], ground=ground), CAMERA, 720)
        shown = server.scene.get_handle_by_name('/ground')
        assert shown.position[2] == pytest.approx(height)
    finally:
        server.stop()


def test_all_that_a_solid_film_shows_is_in_its_picture():
    robot = planar()
    motion = motion_of(robot, swing(robot), goals=[(0.0, 'tool', [2.0, 2.0, 0.0])],
                       objects=(FixedObject('link3', Box(0.1, 0.1, 0.1)),))
    samples = film.shown_samples(TIMES)
    seen, sketches = film_solid._seen(motion, samples)
    seen = np.concatenate([seen, *(film_solid.extent(sketch, 1.0) for sketch in sketches)])
    assert seen.max(axis=0) == pytest.approx([2.0, 2.0, 0.1], abs=0.2)
    for view in ((-90.0, 90.0), (-45.0, 25.0), (130.0, -20.0)):
        camera = film_solid.camera_for(seen, view, 4.0 / 3.0)
        right, down, forward = ((seen - camera.position) @ camera.R).T
        half = np.tan(0.5 * film_solid.FILM_FOV)
        assert np.abs(right / forward).max() < half * 4.0 / 3.0 * 0.95
        height = down / forward / half
        # Something is at the edge that is left free, or the camera could be nearer.
        assert -0.9 - 1e-6 < height.min() and height.max() < 0.76 + 1e-6
        assert np.linalg.det(camera.R) == pytest.approx(1.0)
        assert camera.R[2, 1] <= 1e-12

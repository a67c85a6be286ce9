# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Films: captions, length, camera and goals; their pictures are tested in test/system."""

import contextlib
import sys
from types import SimpleNamespace

import numpy as np
from PIL import Image
import pytest
from robots import CONFIG, planar
from tp_controller import Robot, Stack
from tp_controller.model.shapes import Box
from tp_controller.tasks.sketch import Arrow, Body, Dot, Triad
from tp_controller.tools.cli.demo import FILM, NO_FILM
from tp_controller.tools.demos import film, stage
from tp_controller.tools.demos.motion import FixedObject, Look, Motion, Playback
from tp_controller.tools.demos.outcome import FILM_VARIABLE, films, NONE
from tp_controller.tools.extras import install_command
from viser import ViserServer

TIMES = np.linspace(0.0, 10.0, 300)
CAMERA = film.Camera(np.zeros(3), np.eye(3), 1.0)
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


def motion_of(robot, q, times=TIMES, frame=None, stack='', goals=(), captions=(), **look):
    """Return a motion of which one frame is followed."""
    frame = frame or robot.frame_names[-1]
    return Motion('title', robot, times, q, Stack.from_yaml(TOOL.format(frame) + stack, robot),
                  Look((frame,), **look), goals, captions)


@pytest.fixture
def blank(monkeypatch):
    """Let films have pictures of a growing bar, which need no browser."""
    def pictures(motion, samples):
        for sample in samples:
            picture = Image.new('RGB', film.SIZE, 'white')
            # Equal pictures would become one.
            picture.paste('black', (0, 0, 3 * sample + 1, 20))
            yield picture

    monkeypatch.setattr(film, 'pictures', pictures)


@pytest.mark.slow
def test_a_film_shows_its_progress_and_can_be_left_out(tmp_path, monkeypatch, blank):
    robot = planar()
    drawn = []
    monkeypatch.setattr(film, 'progress', lambda total, what: contextlib.nullcontext(
        SimpleNamespace(advance=lambda: drawn.append(total))))
    motion = motion_of(robot, swing(robot)[:20], TIMES[:20])
    monkeypatch.delenv(FILM_VARIABLE)
    assert films(tmp_path / 'arm.webp', motion) == (tmp_path / 'arm.webp',)
    assert drawn == [20] * 20
    assert (FILM, NO_FILM) == (FILM_VARIABLE, NONE)
    monkeypatch.setenv(FILM, NO_FILM)
    assert films(tmp_path / 'none.webp', motion) == ()
    assert [path.name for path in tmp_path.iterdir()] == ['arm.webp']


@pytest.mark.parametrize('samples', [1, 2, 300])
@pytest.mark.slow
def test_a_film_lasts_as_long_as_its_motion_with_at_most_a_hundred_pictures(
        tmp_path, blank, samples):
    path = film.write_film(tmp_path / 'new' / 'arm.webp', motion_of(
        planar(), swing(planar())[:samples], TIMES[:samples]))
    with Image.open(path) as picture:
        assert picture.size == film.SIZE
        assert picture.n_frames == min(samples, film.MAX_FRAMES)
        picture.load()
        # A single picture has no duration.
        assert samples == 1 or picture.n_frames * picture.info['duration'] == pytest.approx(
            max(1000.0 * TIMES[samples - 1], 100.0), rel=0.1)


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


def test_caption_of_each_step_and_the_time_are_below_the_picture(tmp_path, blank):
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
    before = [sketch for parts in playback.sketches().values() for sketch in parts]
    assert not any(isinstance(sketch, Triad | Dot) for sketch in before)
    assert [body.part for body in before if isinstance(body, Body)] == ['region', 'region']
    playback.seek(299)
    goal, = (sketch.p for sketch in playback.sketches()['tool'] if isinstance(sketch, Dot))
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
def test_without_a_film_the_demo_says_what_to_install(tmp_path, monkeypatch, capsys, fault):
    monkeypatch.delenv(FILM_VARIABLE)
    if fault == 'no viser':
        monkeypatch.setitem(sys.modules, 'viser', None)
        monkeypatch.delitem(sys.modules, film.__name__)
    monkeypatch.setattr(film, 'find_chromium', lambda: None)
    assert films(tmp_path / 'arm.webp', motion_of(planar(), swing(planar())[:2],
                                                  TIMES[:2])) == ()
    said = capsys.readouterr()
    assert said.err.startswith('No film is drawn: ') and said.err.count('\n') == 1
    assert ('apt install chromium' in said.err) is (fault == 'no Chromium')
    assert (install_command('view') in said.err) is (fault == 'no viser')
    assert said.out == '' and not list(tmp_path.iterdir())


@pytest.mark.parametrize('ground, height', [(None, -1.15), (-4.2, -4.2)])
def test_robot_of_a_film_stands_on_the_ground_at_first_unless_it_is_said_where(
        ground, height):
    robot = Robot.from_urdf(
        '<robot name="leg"><link name="pelvis"/><link name="foot"><visual>'
        '<geometry><box size="0.1 0.1 0.3"/></geometry></visual></link>'
        '<joint name="hip" type="prismatic"><parent link="pelvis"/><child link="foot"/>'
        '<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>')
    server = ViserServer('127.0.0.1', 0, verbose=False)
    try:
        stage.Stage(server.scene, motion_of(
            robot, np.array([[-1.0], [-1.5]]), TIMES[:2], ground=ground), CAMERA, 720)
        shown = server.scene.get_handle_by_name('/ground')
        assert shown.position[2] == pytest.approx(height)
    finally:
        server.stop()


def test_all_that_a_film_shows_is_in_its_picture():
    robot = planar()
    motion = motion_of(robot, swing(robot), goals=[(0.0, 'tool', [2.0, 2.0, 0.0])],
                       objects=(FixedObject('link3', Box(0.1, 0.1, 0.1)),))
    samples = film.shown_samples(TIMES)
    seen, sketches = stage.seen(motion, samples)
    seen = np.concatenate([seen, *(stage.extent(sketch, 1.0) for sketch in sketches)])
    assert seen.max(axis=0) == pytest.approx([2.0, 2.0, 0.1], abs=0.2)
    for view in ((-90.0, 90.0), (-45.0, 25.0), (130.0, -20.0)):
        camera = stage.camera_for(seen, view, 4.0 / 3.0)
        right, down, forward = ((seen - camera.position) @ camera.R).T
        half = np.tan(0.5 * film.FILM_FOV)
        assert np.abs(right / forward).max() < half * 4.0 / 3.0 * 0.95
        height = down / forward / half
        # Something is at the edge that is left free, or the camera could be nearer.
        assert -0.9 - 1e-6 < height.min() and height.max() < 0.76 + 1e-6
        assert np.linalg.det(camera.R) == pytest.approx(1.0)
        assert camera.R[2, 1] <= 1e-12

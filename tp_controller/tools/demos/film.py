# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Films of a moving robot: animated WebP, rendered by a headless Chromium."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap
import time

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tp_controller.errors import TpControllerError
from tp_controller.model.spatial import Array
from tp_controller.tools.demos.chromium import find_chromium, HeadlessPage, open_page
from tp_controller.tools.demos.motion import Motion
from tp_controller.tools.demos.processes import ended_by_sigterm
from tp_controller.tools.demos.stage import camera_of, Stage
from tp_controller.tools.files import new_file
from tp_controller.tools.progress import progress
from tp_controller.tools.view.camera import Camera, FILM_FOV
from tp_controller.tools.view.parts import wxyz
from tp_controller.tools.view.server import address, open_server, unused_port
import viser

SIZE = 960, 720
# Largest number of pictures, and longest duration of a film [s].
MAX_FRAMES = 100
MAX_SECONDS = 10.0
# WebP quality, 0 to 100, and effort, 0 (fast) to 6 (small).
QUALITY, EFFORT = 65, 4
INK, PAPER = (33, 41, 52), (255, 255, 255, 205)
LARGE, SMALL, MARGIN = 26, 20, 14
FONT = Path(matplotlib.get_data_path()) / 'fonts' / 'ttf' / 'DejaVuSans.ttf'
# Timeouts of the start (usually 2 s) and of a picture (0.2 s; more than 60 s where 30 processes
# share two processors), and polling period [s].
START_SECONDS, PICTURE_SECONDS, CLIENT_POLL_SECONDS = 180.0, 180.0, 0.1
# Size of the window, independent of that of the pictures [pixels].
WINDOW_SIZE = 160, 120
# Hides the window: viser would draw its content repeatedly for 0.25 s.
OUT_OF_VIEW = '<style>#root { position: fixed; top: 300vh; }</style>'
# Largest number of pictures until the scene is complete.
MOST_TRIES = 20
# Ambient and directional intensity; position of the lamp relative to the camera, in distances.
AMBIENT, LAMP_BRIGHTNESS, LAMP = 1.25, 2.4, np.array([0.0, 0.0, 1.2])
NO_CHROMIUM = ('there is no Chromium on the PATH (Debian: sudo apt install chromium; Ubuntu: '
               'sudo snap install chromium)')


def write_film(path: str | Path, motion: Motion) -> Path:
    """
    Write a film of a motion in real time, or faster if it exceeds ten seconds.

    Parameters
    ----------
    path : str or pathlib.Path
        File to write, ``.webp``; its folder is created.
    motion : Motion
        Motion to show.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    TpControllerError
        Chromium is not installed, or fails.

    """
    samples = shown_samples(motion.times)
    seconds = float(min(max(motion.times[-1] - motion.times[0], 0.1), MAX_SECONDS))
    drawn = []
    with progress(len(samples), 'drawing the film') as bar:
        for sample, picture in zip(samples, pictures(motion, samples)):
            _add_caption(picture, motion, sample, seconds)
            drawn.append(picture)
            bar.advance()
    return save_animation(path, drawn, 1000.0 * seconds / len(samples))


def shown_samples(times: Array) -> list[int]:
    """Return the samples nearest to equally spaced times."""
    moments = np.linspace(times[0], times[-1], min(len(times), MAX_FRAMES))
    return np.unique(np.searchsorted((times[1:] + times[:-1]) / 2.0, moments)).tolist()


def save_animation(path: str | Path, pictures: Sequence[Image.Image],
                   milliseconds: float) -> Path:
    """Write pictures, each shown for a time [ms], as a WebP that repeats; return its path."""
    with new_file(path) as file:
        pictures[0].save(file, 'WEBP', save_all=True, append_images=pictures[1:], loop=0,
                         duration=max(round(milliseconds), 20), quality=QUALITY, method=EFFORT)
    return Path(path)


def _add_caption(picture: Image.Image, motion: Motion, sample: int, seconds: float) -> None:
    """Draw title or caption and time of a sample, for a film of a duration [s]."""
    speed = (motion.times[-1] - motion.times[0]) / seconds
    fast = f'   {speed:.1f} × real time' if speed > 1.05 else ''
    small = ImageFont.truetype(FONT, SMALL)
    draw = ImageDraw.Draw(picture, 'RGBA')
    width, height = picture.size
    top = height - LARGE - 2 * MARGIN
    draw.rectangle((0, top, width, height), fill=PAPER)
    middle = (top + height) // 2
    clock = f't = {max(motion.times[sample], 0.0):4.1f} s{fast}'
    draw.text((width - MARGIN, middle), clock, INK, small, 'rm')
    text, font = _fitted(draw, motion.caption(sample) or motion.title,
                         width - 3 * MARGIN - draw.textlength(clock, small))
    draw.text((MARGIN, middle), text, INK, font, 'lm', spacing=2)


def _fitted(draw: ImageDraw.ImageDraw, text: str,
            width: float) -> tuple[str, ImageFont.FreeTypeFont]:
    """Return a text in one or two lines of a width [pixels], and its font."""
    large, small = (ImageFont.truetype(FONT, size) for size in (LARGE, SMALL))
    if draw.textlength(text, large) <= width:
        return text, large
    # Characters differ in width: a line fits fewer than the average width suggests.
    letters = int(0.95 * len(text) * width / draw.textlength(text, small))
    lines = [text] if draw.textlength(text, small) <= width \
        else wrap(text, letters, max_lines=2, placeholder=' …')
    return '\n'.join(lines), small


def pictures(motion: Motion, samples: Sequence[int]) -> Iterator[Image.Image]:
    """
    Yield pictures of a solid robot on the ground, with goals, regions, obstacles and paths.

    Parameters
    ----------
    motion : Motion
        Motion to draw.
    samples : sequence of int
        Samples to draw, one per picture, in order of time.

    Yields
    ------
    PIL.Image.Image

    Raises
    ------
    TpControllerError
        Chromium is not installed, or fails.

    """
    program = find_chromium()
    if program is None:
        raise TpControllerError(NO_CHROMIUM)
    print(f'Drawing the film, {len(samples)} pictures (--no-film: none) ...', flush=True)
    with ended_by_sigterm() as all_started, _server() as server:
        camera = camera_of(motion, samples, SIZE[0] / SIZE[1])
        stage = Stage(server.scene, motion, camera, SIZE[1])
        _add_lights(server.scene, camera)
        with open_page(program, address(server), *WINDOW_SIZE) as page:
            all_started()
            client = _client(server, page)
            for sample in samples:
                with server.atomic():
                    stage.show(sample)
                if sample == samples[0]:
                    _wait_until_still(lambda: _picture(client, page, camera))
                yield _picture(client, page, camera)


def _add_lights(scene: viser.SceneApi, camera: Camera) -> None:
    """Add ambient light, and a lamp above the camera that casts shadows."""
    # An environment map would double the time of a picture, and take 5 s at the start.
    scene.configure_environment_map(None)
    scene.configure_default_lights(False)
    scene.add_light_ambient('/lights/all', intensity=AMBIENT)
    lamp_position = camera.position + camera.distance * (LAMP - 0.4 * camera.R[:, 0])
    scene.add_light_directional('/lights/lamp', intensity=LAMP_BRIGHTNESS, cast_shadow=True,
                                position=tuple(lamp_position.tolist()))


@contextmanager
def _server() -> Iterator[viser.ViserServer]:
    """Run a local server on an unused port."""
    server = open_server(port=unused_port(), pictures=True)
    server.gui.add_html(OUT_OF_VIEW)
    try:
        yield server
    finally:
        server.stop()


def _client(server: viser.ViserServer, page: HeadlessPage) -> viser.ClientHandle:
    """Return the client of the page once it is connected."""
    for _ in range(round(START_SECONDS / CLIENT_POLL_SECONDS)):
        clients = server.get_clients()
        if clients:
            return next(iter(clients.values()))
        page.check()
        time.sleep(CLIENT_POLL_SECONDS)
    raise TpControllerError(f'Chromium did not open the page within {START_SECONDS:.0f} s')


def _wait_until_still(take: Callable[[], Image.Image]) -> None:
    """Render until two pictures are equal: meshes load asynchronously."""
    picture = take()
    for _ in range(MOST_TRIES):
        before, picture = picture, take()
        if picture == before:
            return


def _picture(client: viser.ClientHandle, page: HeadlessPage, camera: Camera,
             size: tuple[int, int] = SIZE) -> Image.Image:
    """Render the picture of a camera."""
    try:
        pixels = client.get_render(
            size[1], size[0], wxyz=wxyz(camera.R), position=camera.position, fov=FILM_FOV,
            timeout=PICTURE_SECONDS)
    except (RuntimeError, TimeoutError) as error:
        page.check()
        raise TpControllerError(f'Chromium draws nothing: {error}') from error
    return Image.fromarray(pixels[..., :3])

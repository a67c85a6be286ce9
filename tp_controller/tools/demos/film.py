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

"""Films of a moving robot: animated WebP, supported by every browser."""

from collections.abc import Iterable, Iterator, Sequence
import os
from pathlib import Path
import sys
from textwrap import wrap

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tp_controller.errors import TpControllerError
from tp_controller.model.spatial import Array
from tp_controller.tools.demos.film_lines import line_pictures
from tp_controller.tools.demos.motion import Motion
from tp_controller.tools.extras import install_command
from tp_controller.tools.files import new_file
from tp_controller.tools.progress import progress

# Environment variable of the style of films, and its values other than the default.
CHOICE, LINES, NONE = 'TP_CONTROLLER_FILM', 'lines', 'none'
SIZE = 960, 720
# Largest number of pictures, and longest duration of a film [s].
MAX_FRAMES = 100
MAX_SECONDS = 10.0
# WebP quality, 0 to 100, and effort, 0 (fast) to 6 (small).
QUALITY, EFFORT = 65, 4
INK, PAPER = (33, 41, 52), (255, 255, 255, 205)
LARGE, SMALL, MARGIN = 26, 20, 14
FONT = Path(matplotlib.get_data_path()) / 'fonts' / 'ttf' / 'DejaVuSans.ttf'


def films(path: Path, motion: Motion) -> tuple[Path, ...]:
    """Return the path of the film of a motion; empty with ``TP_CONTROLLER_FILM=none``."""
    return () if os.environ.get(CHOICE) == NONE else (write_film(path, motion),)


def write_film(path: str | Path, motion: Motion) -> Path:
    """
    Write a film of a motion in real time, or faster if it exceeds ten seconds.

    The robot is solid if viser and a Chromium are installed; else it is drawn with lines, with the
    reason on standard error. ``TP_CONTROLLER_FILM=lines`` in the environment always selects lines,
    which is faster.

    Parameters
    ----------
    path : str or pathlib.Path
        File to write, ``.webp``; its folder is created.
    motion : Motion
        Motion to show.

    Returns
    -------
    pathlib.Path

    """
    samples = shown_samples(motion.times)
    print(f'Drawing the film, {len(samples)} pictures (--no-film: none) ...', flush=True)
    pictures: list[Image.Image] = []
    if os.environ.get(CHOICE) != LINES:
        try:
            pictures = _drawn(motion, samples, _solid(motion, samples))
        except TpControllerError as error:
            print(f'The film is drawn with lines: {error}', file=sys.stderr)
    if not pictures:
        pictures = _drawn(motion, samples, line_pictures(motion, samples, SIZE))
    return save_animation(path, pictures, 1000.0 * _seconds(motion.times) / len(samples))


def _drawn(motion: Motion, samples: Sequence[int],
           pictures: Iterable[Image.Image]) -> list[Image.Image]:
    """Return pictures with captions, and show the progress."""
    done = []
    with progress(len(samples), 'drawing the film') as bar:
        for picture in _captioned(motion, samples, pictures):
            done.append(picture)
            bar.advance()
    return done


def shown_samples(times: Array) -> list[int]:
    """Return the samples nearest to equally spaced times."""
    moments = np.linspace(times[0], times[-1], min(len(times), MAX_FRAMES))
    return np.unique(np.searchsorted((times[1:] + times[:-1]) / 2.0, moments)).tolist()


def _seconds(times: Array) -> float:
    """Return the duration of a film [s]."""
    return float(min(max(times[-1] - times[0], 0.1), MAX_SECONDS))


def _solid(motion: Motion, samples: Sequence[int]) -> Iterator[Image.Image]:
    """Return pictures of a solid robot; raise `TpControllerError` if it is impossible."""
    try:
        from tp_controller.tools.demos.film_solid import solid_pictures
    except ModuleNotFoundError as error:
        raise TpControllerError(f'{error.name} is missing: {install_command("view")}') from error
    return solid_pictures(motion, samples, SIZE)


def _captioned(motion: Motion, samples: Sequence[int],
               pictures: Iterable[Image.Image]) -> Iterator[Image.Image]:
    """Yield pictures with title, caption and time."""
    speed = (motion.times[-1] - motion.times[0]) / _seconds(motion.times)
    fast = f'   {speed:.1f} × real time' if speed > 1.05 else ''
    small = ImageFont.truetype(FONT, SMALL)
    for sample, picture in zip(samples, pictures):
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
        yield picture


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


def save_animation(path: str | Path, pictures: Sequence[Image.Image],
                   milliseconds: float) -> Path:
    """
    Write pictures as an animated WebP that repeats, and return its path.

    Parameters
    ----------
    path : str or pathlib.Path
        File to write; its folder is created.
    pictures : sequence of PIL.Image.Image
        Pictures of equal size.
    milliseconds : float
        Display time of each picture [ms].

    Returns
    -------
    pathlib.Path

    """
    path = Path(path)
    with new_file(path) as file:
        pictures[0].save(file, 'WEBP', save_all=True, append_images=pictures[1:], loop=0,
                         duration=max(round(milliseconds), 20), quality=QUALITY, method=EFFORT)
    return path

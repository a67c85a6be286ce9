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

"""Films of a moving robot, written as GIF."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.text import Text
import numpy as np
from numpy.typing import ArrayLike
from PIL import Image
from tp_controller import Robot, RobotState
from tp_controller.demos.outlines import base_outline
from tp_controller.demos.outlines import joined as joined_lines
from tp_controller.files import new_file
from tp_controller.model.urdf import parse
from tp_controller.plots.drawing import (
    ARM_COLOUR,
    Array,
    FLAT,
    GOAL_COLOUR,
    make_scene,
    PATH_COLOUR,
    SHADOW_COLOUR,
)

# Line2D or Line3D, which has no types.
Line = Any

AROUND_COLOUR = '#8C5A2B'
CARRIED_COLOUR = '#009E73'
MEANINGFUL = (GOAL_COLOUR, PATH_COLOUR, ARM_COLOUR, AROUND_COLOUR, CARRIED_COLOUR)
MAX_FRAMES = 80
# Longest film [s].
LONGEST = 10.0


@dataclass(frozen=True)
class _Motion:
    """
    Where everything is at each time [m].

    Attributes
    ----------
    segments : ndarray (T, k, 2, 3)
        Ends of the links, without those of no length.
    joints, tools : ndarray (T, k, 3)
        Origins of the driven links, and of the frames whose path is drawn.
    goals : ndarray (T, 3)
        Not a number where there is none.
    bases, carried : ndarray (T, k, 3)
        Lines: the outline of a base that moves, and what pairs of frames hold.

    """

    segments: Array
    joints: Array
    tools: Array
    goals: Array
    bases: Array
    carried: Array

    def points(self, around: Sequence[Array]) -> Array:
        """Return all (k, 3) that the scene has to have a place for."""
        points = np.concatenate([each.reshape(-1, 3) for each in (
            self.segments, self.tools, self.goals, self.bases, *around)])
        return points[np.isfinite(points).all(axis=1)]


def animate_arm(path: str | Path, robot: Robot, qs: ArrayLike, times: ArrayLike,
                frames: Sequence[str] | None = None, goals: ArrayLike = np.nan, *,
                title: str | None = None, carried: Sequence[tuple[str, str]] = (),
                around: Sequence[Array] = ()) -> Path:
    """
    Write an animation of the moving robot as a GIF of at most `MAX_FRAMES` pictures.

    Links are drawn as straight lines between their origins, and a base that moves by its outline.
    The view is from above where the robot moves in a horizontal plane, else in space, with its
    shadow on the ground. The motion plays at its true speed, but in no more than ten seconds.

    Parameters
    ----------
    path : str or pathlib.Path
        File to write; its folder is made where it is missing.
    robot : Robot
        Whose links are drawn.
    qs : ndarray (T, nq)
        Configurations [rad or m].
    times : ndarray (T,)
        [s]
    frames : sequence of str, optional
        Frames whose path is drawn; the one at the end of the longest chain by default.
    goals : ndarray (T, 3) or (3,), optional
        Goal in force at each time, in the root frame [m]; not a number where there is none.
    title : str, optional
        The robot's name by default.
    carried : sequence of (str, str), optional
        Pairs of frames that hold one object, which is drawn as a line between them.
    around : sequence of ndarray (k, 3), optional
        Outlines of what stands around, in the root frame; see `tp_controller.demos.outlines` [m].

    Returns
    -------
    pathlib.Path

    """
    times, qs = np.asarray(times, dtype=float), np.asarray(qs, dtype=float)
    links, driven = links_of(robot)
    frames = [_tip(robot, links)] if frames is None else frames
    motion = _Motion(
        _segments(robot, qs, links), _origins(robot, qs, driven), _origins(robot, qs, frames),
        np.broadcast_to(np.asarray(goals, dtype=float), (len(times), 3)),
        _bases(robot, qs), _carried(robot, qs, carried))
    scene = _ArmScene(motion, title or robot.name, around)
    # The samples nearest to moments equally spaced in time, which the samples need not be.
    moments = np.linspace(times[0], times[-1], min(len(times), MAX_FRAMES))
    shown = np.unique(np.searchsorted((times[1:] + times[:-1]) / 2.0, moments))
    duration = times[-1] - times[0]
    seconds = min(max(duration, 0.1), LONGEST)
    speed = duration / seconds
    note = f'   ({speed:.1f} × real time)' if speed > 1.05 else ''
    pictures = [scene.picture(sample, f't = {times[sample]:.1f} s{note}')
                for sample in shown.tolist()]
    return _save_gif(path, pictures, 1000.0 * seconds / len(shown))


class _ArmScene:
    """Axes with everything that stays, and the lines that move, drawn over a kept background."""

    def __init__(self, motion: _Motion, title: str, around: Sequence[Array]) -> None:
        self._motion = motion
        self._scene = make_scene(motion.points(around), title, size=(5.2, 5.4), dpi=88)
        self._canvas = FigureCanvasAgg(self._scene.figure)
        for index, line in enumerate(around):
            self._scene.axis.plot(*self._scene.columns(line), color=AROUND_COLOUR, linewidth=1.0,
                                  label=None if index else 'obstacle')
        # The order is that in which they cover each other.
        self._shadow = self._line(color=SHADOW_COLOUR, linewidth=4, solid_capstyle='round')
        count = motion.tools.shape[1]
        label = 'paths' if count > 1 else 'tool path'
        self._paths = [self._line(color=PATH_COLOUR, linewidth=1.2, label=None if index else label)
                       for index in range(count)]
        self._base = self._line(color=ARM_COLOUR, linewidth=1.0)
        self._arm = self._line(color=ARM_COLOUR, linewidth=4, solid_capstyle='round',
                               label='robot')
        self._carried = self._line(color=CARRIED_COLOUR, linewidth=5, solid_capstyle='round',
                                   label='object' if motion.carried.size else None)
        self._joints = self._line('o', color='white', markersize=6.5, markeredgewidth=2,
                                  markeredgecolor=ARM_COLOUR, label='joints')
        self._ends = self._line('o', color=ARM_COLOUR, markersize=7)
        self._goal = self._line('x', color=GOAL_COLOUR, markersize=11, markeredgewidth=3,
                                label='goal')
        self._clock = self._text()
        self._moving = [self._shadow, *self._paths, self._base, self._arm, self._joints,
                        self._carried, self._ends, self._goal, self._clock]
        self._keep_background()

    def picture(self, sample: int, clock: str) -> Image.Image:
        """Return the picture of one sample."""
        motion = self._motion
        chain = joined_lines(motion.segments[sample])
        self._set(self._arm, chain)
        self._set(self._base, motion.bases[sample])
        self._set(self._carried, motion.carried[sample])
        self._set(self._joints, motion.joints[sample])
        self._set(self._ends, motion.tools[sample])
        if self._scene.floor is not None:
            self._set(self._shadow, np.column_stack((
                chain[:, :2], np.where(np.isnan(chain[:, 0]), np.nan, self._scene.floor))))
        for index, line in enumerate(self._paths):
            self._set(line, motion.tools[:sample + 1, index])
        self._set(self._goal, motion.goals[sample:sample + 1])
        self._clock.set_text(clock)
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            self._scene.axis.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())[..., :3].copy())

    def _line(self, *style: str, **options: Any) -> Line:
        """Return a line without points."""
        blank = [[np.nan]] * self._scene.dimensions
        return self._scene.axis.plot(*blank, *style, **options)[0]

    def _text(self) -> Text:
        """Return a text in the upper left corner."""
        axis, height = self._scene.axis, 0.96 if self._scene.floor is None else 0.97
        # Of the base class: an axis with three dimensions would put the text into them.
        return Axes.text(axis, 0.02, height, '', transform=axis.transAxes)

    def _keep_background(self) -> None:
        """Draw everything that stays, and keep it."""
        self._scene.figure.legend(*self._scene.axis.get_legend_handles_labels(),
                                  loc='outside lower center', ncols=5, columnspacing=1.2,
                                  frameon=False)
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self._scene.figure.bbox)

    def _set(self, line: Line, points: Array) -> None:
        """Give a line its points (k, 3)."""
        columns = self._scene.columns(points)
        if self._scene.floor is None:
            line.set_data(*columns)
        else:
            line.set_data_3d(*columns)


def links_of(robot: Robot) -> tuple[list[tuple[str, str]], list[str]]:
    """Return (parent, child) of every joint of the description, and the children that move."""
    joints = parse(robot.urdf).findall('joint')
    links = [(_link(joint, 'parent'), _link(joint, 'child')) for joint in joints]
    driven = [child for joint, (_, child) in zip(joints, links)
              if joint.get('name') in robot.joint_names]
    return links, driven


def _link(joint: Element, side: str) -> str:
    """Return the link on one side of a joint."""
    return next(joint.iter(side)).attrib['link']


def _tip(robot: Robot, links: Sequence[tuple[str, str]]) -> str:
    """Return the frame at the end of the chain with the most joints."""
    parents = {child: parent for parent, child in links}

    def depth(frame: str) -> int:
        return 1 + depth(parents[frame]) if frame in parents else 0

    return max(robot.frame_names, key=depth)


def _over_time(robot: Robot, qs: Array, measure: Callable[[RobotState], ArrayLike]) -> Array:
    """Return what a function makes of the state of each configuration (T, …)."""
    state = robot.state(qs[0])
    rows = []
    for q in qs:
        state.update(q)
        rows.append(np.array(measure(state), dtype=float))
    return np.stack(rows)


def _segments(robot: Robot, qs: Array, links: Sequence[tuple[str, str]]) -> Array:
    """Return the ends of the links that have a length (T, k, 2, 3) [m]."""
    ends = _over_time(robot, qs, lambda state: np.reshape([
        (state.position(parent), state.position(child)) for parent, child in links], (-1, 2, 3)))
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).max(axis=0)
    return ends[:, lengths > FLAT]


def _origins(robot: Robot, qs: Array, frames: Sequence[str]) -> Array:
    """Return the origins of frames (T, k, 3) [m]."""
    return _over_time(robot, qs, lambda state: np.reshape([
        state.position(frame) for frame in frames], (-1, 3)))


def _carried(robot: Robot, qs: Array, pairs: Sequence[tuple[str, str]]) -> Array:
    """Return lines between the frames of pairs (T, k, 3) [m]."""
    gap = np.full(3, np.nan)
    return _over_time(robot, qs, lambda state: np.reshape([
        (state.position(one), state.position(other), gap) for one, other in pairs], (-1, 3)))


def _bases(robot: Robot, qs: Array) -> Array:
    """Return the outline of a base that moves (T, k, 3) [m]; none of another."""
    if not robot.moves:
        return np.empty((len(qs), 0, 3))
    own = base_outline(robot)

    def placed(state: RobotState) -> Array:
        T = state.pose(robot.base_frame)
        return own @ T[:3, :3].T + T[:3, 3]

    return _over_time(robot, qs, placed)


def _save_gif(path: str | Path, pictures: Sequence[Image.Image], milliseconds: float) -> Path:
    """Write pictures as an animation that repeats, and return its path."""
    path = Path(path)
    palette = _palette(pictures[-1])
    first, *others = (picture.quantize(palette=palette, dither=Image.Dither.NONE)
                      for picture in pictures)
    with new_file(path) as file:
        first.save(file, 'GIF', save_all=True, append_images=others, loop=0,
                   duration=max(round(milliseconds, -1), 20))
    return path


def _palette(picture: Image.Image) -> Image.Image:
    """
    Return the palette for all pictures of a film, from the last, which has every colour in it.

    One for all: what does not change between two pictures then takes no space. What is almost
    white shall not tint the background, and the colours that carry meaning shall not be mixed
    with others.
    """
    # 64 colours in all need 6 bits.
    count = 64 - len(MEANINGFUL)
    palette = picture.quantize(count, dither=Image.Dither.NONE)
    colours = np.array((palette.getpalette() or [])[:3 * count]).reshape(-1, 3)
    colours[colours.min(axis=1) > 245] = 255
    kept = [round(255.0 * part) for colour in MEANINGFUL for part in to_rgb(colour)]
    palette.putpalette(colours.ravel().tolist() + kept)
    return palette

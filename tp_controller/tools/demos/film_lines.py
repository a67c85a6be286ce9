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

"""Line drawings of a moving robot, for films without a solid renderer."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element

from matplotlib.backends.backend_agg import FigureCanvasAgg
import numpy as np
from numpy.typing import ArrayLike
from PIL import Image
from tp_controller import Robot, RobotState
from tp_controller.model.urdf import parse
from tp_controller.tools.demos.motion import Motion, Playback
from tp_controller.tools.demos.outlines import base_outline, joined, outline
from tp_controller.tools.plots.drawing import (
    ARM_COLOUR,
    Array,
    GOAL_COLOUR,
    make_scene,
    PATH_COLOUR,
    PLANAR_SPREAD,
    SHADOW_COLOUR,
)

# Line2D or Line3D, both untyped.
Line = Any

AROUND_COLOUR = '#8C5A2B'
CARRIED_COLOUR = '#009E73'
DPI = 100
GAP = np.full((1, 3), np.nan)


@dataclass(frozen=True)
class _Lines:
    """
    Line coordinates at each time [m].

    Attributes
    ----------
    segments : ndarray (T, k, 2, 3)
        Ends of the links with nonzero length.
    joints, tools : ndarray (T, k, 3)
        Origins of the driven links, and of the frames with a drawn path.
    bases : ndarray (T, k, 3)
        Outline of a mobile base.
    goals, bars : list of ndarray (k, 3)
        Goal points, and lines between pairs of frames, of each picture.

    """

    segments: Array
    joints: Array
    tools: Array
    bases: Array
    goals: Sequence[Array]
    bars: Sequence[Array]

    def points(self, around: Sequence[Array]) -> Array:
        """Return the coordinates (k, 3) of all lines."""
        points = np.concatenate([each.reshape(-1, 3) for each in (
            self.segments, self.tools, self.bases, *self.goals, *around)])
        return points[np.isfinite(points).all(axis=1)]


def line_pictures(motion: Motion, samples: Sequence[int],
                  size: tuple[int, int]) -> Iterator[Image.Image]:
    """
    Yield pictures of a robot whose links are straight lines between their origins.

    A robot that moves in a horizontal plane is shown from above, any other in perspective with its
    shadow on the ground. A mobile base is drawn as its outline.

    Parameters
    ----------
    motion : Motion
        Motion to draw.
    samples : sequence of int
        Samples to draw, one per picture.
    size : tuple of int
        Width and height [pixels].

    Yields
    ------
    PIL.Image.Image

    """
    robot, q, playback = motion.robot, motion.q, Playback(motion)
    links, driven = links_of(robot)
    around = [outline(body.shape, body.T) for body in playback.bodies()]
    goals, bars = [], []
    for sample in samples:
        playback.seek(sample)
        goals.append(np.reshape([GAP[0], *playback.goals()], (-1, 3)))
        bars.append(joined([GAP, *playback.bars()]))
    lines = _Lines(_segments(robot, q, links), _origins(robot, q, driven),
                   _origins(robot, q, motion.frames), _bases(robot, q), goals, bars)
    scene = _ArmScene(lines, motion.title, around, size)
    for number, sample in enumerate(samples):
        yield scene.picture(number, sample)


class _ArmScene:
    """Axes with a cached static background and moving lines."""

    def __init__(self, lines: _Lines, title: str, around: Sequence[Array],
                 size: tuple[int, int]) -> None:
        self._lines = lines
        self._scene = make_scene(lines.points(around), title, dpi=DPI,
                                 size=(size[0] / DPI, size[1] / DPI))
        self._canvas = FigureCanvasAgg(self._scene.figure)
        for index, line in enumerate(around):
            self._scene.axis.plot(*self._scene.columns(line), color=AROUND_COLOUR, linewidth=1.0,
                                  label=None if index else 'obstacle')
        # In the order of drawing.
        self._shadow = self._line(color=SHADOW_COLOUR, linewidth=4, solid_capstyle='round')
        count = lines.tools.shape[1]
        label = 'paths' if count > 1 else 'tool path'
        self._paths = [self._line(color=PATH_COLOUR, linewidth=1.2, label=None if index else label)
                       for index in range(count)]
        self._base = self._line(color=ARM_COLOUR, linewidth=1.0)
        self._arm = self._line(color=ARM_COLOUR, linewidth=4, solid_capstyle='round',
                               label='robot')
        has_bars = any(len(each) > 2 for each in lines.bars)
        self._bars = self._line(color=CARRIED_COLOUR, linewidth=5, solid_capstyle='round',
                                label='object' if has_bars else None)
        self._joints = self._line('o', color='white', markersize=6.5, markeredgewidth=2,
                                  markeredgecolor=ARM_COLOUR, label='joints')
        self._ends = self._line('o', color=ARM_COLOUR, markersize=7)
        self._goal = self._line('x', color=GOAL_COLOUR, markersize=11, markeredgewidth=3,
                                label='goal')
        self._moving = [self._shadow, *self._paths, self._base, self._arm, self._joints,
                        self._bars, self._ends, self._goal]
        self._cache_background()

    def picture(self, number: int, sample: int) -> Image.Image:
        """Return the picture with a number, of a sample."""
        lines = self._lines
        chain = joined(lines.segments[sample])
        self._set(self._arm, chain)
        self._set(self._base, lines.bases[sample])
        self._set(self._bars, lines.bars[number])
        self._set(self._joints, lines.joints[sample])
        self._set(self._ends, lines.tools[sample])
        if self._scene.floor is not None:
            self._set(self._shadow, np.column_stack((
                chain[:, :2], np.where(np.isnan(chain[:, 0]), np.nan, self._scene.floor))))
        for index, line in enumerate(self._paths):
            self._set(line, lines.tools[:sample + 1, index])
        self._set(self._goal, lines.goals[number])
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            self._scene.axis.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())[..., :3].copy())

    def _line(self, *style: str, **options: Any) -> Line:
        """Return a line without points."""
        blank = [[np.nan]] * self._scene.dimensions
        return self._scene.axis.plot(*blank, *style, **options)[0]

    def _cache_background(self) -> None:
        """Draw and cache the static background."""
        self._scene.figure.legend(*self._scene.axis.get_legend_handles_labels(),
                                  loc='outside upper center', ncols=6, columnspacing=1.2,
                                  frameon=False)
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self._scene.figure.bbox)

    def _set(self, line: Line, points: Array) -> None:
        """Set the points (k, 3) of a line."""
        columns = self._scene.columns(points)
        if self._scene.floor is None:
            line.set_data(*columns)
        else:
            line.set_data_3d(*columns)


def links_of(robot: Robot) -> tuple[list[tuple[str, str]], list[str]]:
    """Return (parent, child) of every joint of the description, and the driven children."""
    joints = parse(robot.urdf).findall('joint')
    links = [(_link(joint, 'parent'), _link(joint, 'child')) for joint in joints]
    driven = [child for joint, (_, child) in zip(joints, links)
              if joint.get('name') in robot.joint_names]
    return links, driven


def _link(joint: Element, side: str) -> str:
    """Return the link on one side of a joint."""
    return next(joint.iter(side)).attrib['link']


def _over_time(robot: Robot, qs: Array, measure: Callable[[RobotState], ArrayLike]) -> Array:
    """Return a function of the state for each configuration (T, …)."""
    state = robot.state(qs[0])
    rows = []
    for q in qs:
        state.update(q)
        rows.append(np.array(measure(state), dtype=float))
    return np.stack(rows)


def _segments(robot: Robot, qs: Array, links: Sequence[tuple[str, str]]) -> Array:
    """Return the ends of the links with nonzero length (T, k, 2, 3) [m]."""
    ends = _over_time(robot, qs, lambda state: np.reshape([
        (state.position(parent), state.position(child)) for parent, child in links], (-1, 2, 3)))
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).max(axis=0)
    return ends[:, lengths > PLANAR_SPREAD]


def _origins(robot: Robot, qs: Array, frames: Sequence[str]) -> Array:
    """Return the origins of frames (T, k, 3) [m]."""
    return _over_time(robot, qs, lambda state: np.reshape([
        state.position(frame) for frame in frames], (-1, 3)))


def _bases(robot: Robot, qs: Array) -> Array:
    """Return the outline of a mobile base (T, k, 3) [m]; empty for a fixed one."""
    if not robot.moves:
        return np.empty((len(qs), 0, 3))
    own = base_outline(robot)

    def placed(state: RobotState) -> Array:
        T = state.pose(robot.base_frame)
        return own @ T[:3, :3].T + T[:3, 3]

    return _over_time(robot, qs, placed)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Common parts of plots: colours, spatial axes, and files."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.spatial import Array
from tp_controller.tools.files import new_file
from tp_controller.untrusted.texts import plain

if TYPE_CHECKING:  # Not importable with mixed versions of matplotlib; plane plots do not need it.
    from mpl_toolkits.mplot3d import Axes3D


# Colours of Okabe and Ito for colour-blind readers, without their yellow, too light for lines.
LINE_COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#000000')
GOAL_COLOUR = '#D55E00'
ARM_COLOUR = '#2F3B4A'
LIMIT_COLOUR = '#B00020'
SHADOW_COLOUR = '#DDE1E6'
GUIDE_COLOUR = '#B8BEC6'
PLOT_DPI = 110
# Spread of the heights [m] below which a motion counts as planar.
PLANAR_SPREAD = 1e-6
# Scene in space: ratio of the shortest to the longest side; zoom of a cube, and exponent of the
# enlargement of flatter or thinner boxes [1].
LEAST_SIDE = 0.5
ZOOM, ZOOM_EXPONENT = 0.9, 0.1
# Ticks of the longest side, and distances of the axis labels from the numbers [pt].
TICKS, LABEL_PADS = 6, (9.0, 9.0, 10.0)
# Longest name in a plot [characters].
LONGEST_LABEL = 40
# View direction [deg].
ELEVATION, AZIMUTH = 22.0, -55.0


@dataclass(frozen=True)
class Scene:
    """
    Figure with one axis for a scene in the plane or in space.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
    axis : matplotlib.axes.Axes
        Two-dimensional, seen from above, or three-dimensional.
    floor : float or None
        Lowest height of a three-dimensional axis [m]; else None.

    """

    figure: Figure
    axis: Axes
    floor: float | None = None

    @property
    def dimensions(self) -> int:
        """Return 2 or 3."""
        return 2 if self.floor is None else 3

    def columns(self, points: ArrayLike) -> tuple[Array, ...]:
        """Return points (k, 3) as the arguments of a plot."""
        return tuple(np.asarray(points, dtype=float).T[:self.dimensions])


def make_scene(points: Array, title: str) -> Scene:
    """Return a scene with equal scales around points (k, 3), in the plane if they are."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    flat = upper[2] - lower[2] < PLANAR_SPREAD
    figure = Figure(figsize=(6.4, 6.0), dpi=PLOT_DPI, layout='constrained')
    FigureCanvasAgg(figure)
    axis: Axes = figure.add_subplot() if flat else figure.add_subplot(projection='3d')
    axis.set_title(title)
    axis.set(xlabel='x [m]', ylabel='y [m]')
    longest = max((upper - lower).max(), PLANAR_SPREAD)
    # In space each side has the length of its data: a long path would be tiny in a cube.
    sides = np.full(3, longest) if flat else np.maximum(upper - lower, LEAST_SIDE * longest)
    half, middle = 0.55 * sides, (lower + upper) / 2.0
    axis.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axis.set_ylim(middle[1] - half[1], middle[1] + half[1])
    if flat:
        axis.set_aspect('equal')
        tidy(axis)
        return Scene(figure, axis)
    _add_height(axis, lower[2], half)
    return Scene(figure, axis, lower[2])


def _add_height(axis: 'Axes3D', bottom: float, half: Array) -> None:
    """Set up the third dimension of an axis, as a box with half the sides (3,) [m]."""
    axis.set_zlim(bottom, bottom + 2.0 * half[2])
    axis.set_zlabel('z [m]')
    # A cube has the longest diagonal: a flatter or thinner box may be drawn larger.
    shape = half / half.max()
    # A tall box is drawn smaller: its lower corner would cover the items below.
    zoom = ZOOM * min((np.sqrt(3.0) / np.linalg.norm(shape)) ** ZOOM_EXPONENT,
                      _projected_height(np.ones(3)) / _projected_height(shape))
    axis.set_box_aspect(shape, zoom=zoom)
    for each, side, pad in zip((axis.xaxis, axis.yaxis, axis.zaxis), shape, LABEL_PADS):
        each.set_major_locator(MaxNLocator(max(round(TICKS * side), 2)))
        each.labelpad = pad
    axis.view_init(elev=ELEVATION, azim=AZIMUTH)


def _projected_height(shape: Array) -> float:
    """Return the height of a box with sides (3,) in the picture, relative to its diagonal."""
    elevation, azimuth = np.radians((ELEVATION, AZIMUTH))
    depth = np.abs((np.cos(azimuth), np.sin(azimuth))).dot(shape[:2])
    seen = np.cos(elevation) * shape[2] + np.sin(elevation) * depth
    return float(seen / np.linalg.norm(shape))


def tidy(axis: Axes) -> None:
    """Apply the common style: light grid, no upper and right spine."""
    axis.grid(color='#E6E8EB', linewidth=0.8)
    axis.set_axisbelow(True)
    for side in ('top', 'right'):
        axis.spines[side].set_visible(False)


def mark_bound(axis: Axes, bound: float, beyond: float) -> None:
    """Mark a bound, and shade the area beyond it."""
    axis.axhline(bound, color=LIMIT_COLOUR, linewidth=1.2, linestyle='--', zorder=1)
    axis.axhspan(bound, bound + beyond, color=LIMIT_COLOUR, alpha=0.06, zorder=0, linewidth=0.0)


def label(name: str, longest: int = LONGEST_LABEL) -> str:
    """Return a name for a plot, with escaped dollar signs, which would start a formula."""
    return plain(name, longest).replace('$', r'\$')


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure and return its path."""
    path = Path(path)
    with new_file(path) as file:
        figure.savefig(file, format=path.suffix[1:])
    return path

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Plots of a recorded motion, written to files.

Each figure has a canvas of its own: neither a display nor the global state of pyplot is used,
and figures can be made in any thread.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
import math
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple, TypeAlias

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import ArrayLike, NDArray
from tp_controller.tools.plots.drawing import (
    ARM_COLOUR,
    Array,
    GOAL_COLOUR,
    GUIDE_COLOUR,
    LIMIT_COLOUR,
    LINE_COLOURS,
    make_scene,
    mark_bound,
    PLOT_DPI,
    save,
    Scene,
    SHADOW_COLOUR,
    tidy,
)

# Causes that limit a task at one time.
Causes: TypeAlias = tuple[str, ...]
# Line styles: with the colours enough for 56 joints, as many as a humanoid with fingers has.
STYLES = ('-', '--', ':', '-.', (0, (8, 3)), (0, (1, 4)), (0, (6, 2, 1, 2, 1, 2)), (0, (3, 4)))
# Height of a legend entry, and of each further line of it [in].
LEGEND_LINE, NEXT_LINE = 0.24, 0.17
# Longest line of a cause [characters], and its largest number of lines.
LEGEND_WIDTH, LEGEND_LINES = 34, 3


def plot_errors(path: str | Path, times: Array, errors: Sequence[tuple[str, str, Array]], *,
                causes: Mapping[str, Sequence[Causes]] | None = None,
                title: str = 'Task errors', changes: Iterable[float] = (),
                log: bool = False) -> Path:
    """
    Plot errors over time, one axis for each unit, and below them the causes that limit tasks.

    Parameters
    ----------
    path : str or pathlib.Path
        Output file; a missing folder is created.
    times : ndarray (T,)
        [s]
    errors : sequence of (str, str, ndarray (T,))
        Name, unit and values; NaN without an error. A name has the same colour on every axis.
    causes : {str: sequence of tuple of str (T,)}, optional
        Causes that limit each task at each time.
    title : str
        Title of the whole figure.
    changes : sequence of float
        Times at which a goal changed [s], marked by vertical lines.
    log : bool
        Logarithmic error axes.

    Returns
    -------
    pathlib.Path

    """
    names = list(dict.fromkeys(name for name, _, _ in errors))
    units = list(dict.fromkeys(unit for _, unit, _ in errors))
    changes = list(changes)
    limited = {name: sets for name, sets in (causes or {}).items() if any(sets)}
    legend = _legend_of(times, limited)
    further = sum(label.count('\n') for label in legend.values())
    heights = [1.9] * len(units) + [NEXT_LINE * further + LEGEND_LINE * max(
        3 + len(legend), 2 + 2 * len(limited))] * bool(limited)
    figure, axes = _figure(title, len(heights), 2.0 + sum(heights), heights)
    for axis, unit in zip(axes, units):
        curves = [(name, np.abs(values)) for name, kind, values in errors if kind == unit]
        for name, values in curves:
            if log:
                values = np.where(values > 0.0, values, np.nan)
            axis.plot(times, values, label=name, **_line(names.index(name)))
        _mark_changes(axis, changes)
        axis.set_ylabel(f'error [{unit}]')
        _set_error_range(axis, [values for _, values in curves], log)
        _legend(axis)
    if limited:
        _add_causes(axes[-1], times, limited, legend)
        _mark_changes(axes[-1], changes)
        _legend(axes[-1])
    _finish_time_axes(figure, axes, times)
    return save(figure, path)


def plot_velocities(path: str | Path, times: Array, velocities: ArrayLike, limits: ArrayLike,
                    names: Sequence[str], *, units: Sequence[str] | None = None,
                    title: str = 'Joint velocities', changes: Iterable[float] = ()) -> Path:
    """
    Plot joint velocities with their limits.

    If all limits are equal, the velocities are plotted as they are, else as shares of the
    limits; joints without a limit have an axis of their own.

    Parameters
    ----------
    path, times, title, changes
        See `plot_errors`.
    velocities : ndarray (T, n)
        [rad/s or m/s]
    limits : ndarray (n,)
        Largest absolute velocities [rad/s or m/s], infinite where there is none.
    names : sequence of str
        Names of the joints.
    units : sequence of str, optional
        ``'rad'`` or ``'m'`` for each joint; ``'rad'`` by default.

    Returns
    -------
    pathlib.Path

    """
    velocities, limits = np.asarray(velocities, dtype=float), np.asarray(limits, dtype=float)
    units = list(units or ['rad'] * len(names))
    limited = np.flatnonzero(np.isfinite(limits) & (limits > 0.0))
    free = np.setdiff1d(np.arange(len(names)), limited)
    groups = [group for group in (limited, free) if len(group)]
    figure, axes = _figure(title, len(groups), height=2.0 + len(groups) * max(
        2.4, LEGEND_LINE * max(map(len, groups))))
    for axis, group in zip(axes, groups):
        alike = len({(limits[joint], units[joint]) for joint in group}) == 1
        unit = '/'.join(dict.fromkeys(units[joint] for joint in group))
        share = group is limited and not alike
        for joint in group:
            label = f'{names[joint]} (±{limits[joint]:g} {units[joint]}/s)' if share \
                else names[joint]
            scale = 100.0 / limits[joint] if share else 1.0
            axis.plot(times, scale * velocities[:, joint], label=label, **_line(joint))
        axis.axhline(0.0, color=GUIDE_COLOUR, linewidth=0.8, zorder=0)
        if group is limited:
            _mark_limits(axis, 100.0 if share else limits[group[0]])
        axis.set_ylabel('share of limit [%]' if share else f'velocity [{unit}/s]')
        _mark_changes(axis, changes)
        _legend(axis)
    _finish_time_axes(figure, axes, times)
    return save(figure, path)


def plot_positions(path: str | Path, times: Array, q: Array, names: Sequence[str], *,
                   title: str = 'Joint positions', changes: Iterable[float] = ()) -> Path:
    """
    Plot positions of revolute joints.

    Parameters
    ----------
    path, times, title, changes
        See `plot_errors`.
    q : ndarray (T, n)
        [rad]
    names : sequence of str
        Names of the joints.

    Returns
    -------
    pathlib.Path

    """
    figure, (axis,) = _figure(title, 1, height=4.2)
    for joint, name in enumerate(names):
        axis.plot(times, q[:, joint], label=name, **_line(joint))
    axis.set_ylabel('position [rad]')
    _mark_changes(axis, changes)
    _legend(axis)
    _finish_time_axes(figure, [axis], times)
    return save(figure, path)


class BoundedCurves(NamedTuple):
    """
    Curves of one quantity over time, with its bounds.

    Attributes
    ----------
    label : str
        Quantity with its unit.
    values : {str: ndarray (T,)}
        Values by the name of the curve.
    lower, upper : float
        Bounds; infinite without one.

    """

    label: str
    values: Mapping[str, Array]
    lower: float = -math.inf
    upper: float = math.inf


def plot_bounds(path: str | Path, times: Array, curves: Sequence[BoundedCurves], *, title: str,
                active: Mapping[str, Sequence[bool]] | None = None) -> Path:
    """
    Plot values over time with their bounds, one axis for each quantity.

    Parameters
    ----------
    path, times, title
        See `plot_errors`.
    curves : sequence of BoundedCurves
        Quantities from top to bottom, shaded beyond their bounds. A name has the same colour on
        every axis; a single curve without a name has that of its axis.
    active : {str: sequence of bool (T,)}, optional
        Rows of an axis below: a band wherever true.

    Returns
    -------
    pathlib.Path

    """
    names = list(dict.fromkeys(name for quantity in curves for name in quantity.values if name))
    heights = [1.5] * len(curves) + ([0.4 + 0.3 * len(active)] if active else [])
    figure, axes = _figure(title, len(heights), 1.0 + sum(heights), heights)
    for index, (axis, quantity) in enumerate(zip(axes, curves)):
        for name, values in quantity.values.items():
            axis.plot(times, values, label=name,
                      **_line(names.index(name) if name else index))
        _set_bounded_range(axis, quantity)
        axis.set_title(quantity.label, fontsize='medium', loc='left')
    if names:
        _legend(axes[0])
    if active:
        _add_bands(axes[-1], times, active)
    _finish_time_axes(figure, axes, times)
    return save(figure, path)


def _set_bounded_range(axis: Axes, quantity: BoundedCurves) -> None:
    """Show all values and bounds of a quantity, shaded beyond the bounds."""
    bounds = [bound for bound in (quantity.lower, quantity.upper) if np.isfinite(bound)]
    shown = np.concatenate([*quantity.values.values(), bounds])
    low, high = shown.min(), shown.max()
    margin = 0.08 * ((high - low) or 1.0)
    axis.set_ylim(low - margin, high + margin)
    for bound, end in zip((quantity.lower, quantity.upper), axis.get_ylim()):
        if np.isfinite(bound):
            mark_bound(axis, bound, end - bound)


def _add_bands(axis: Axes, times: Array, active: Mapping[str, Sequence[bool]]) -> None:
    """Draw a row for each name, with a band wherever it is active (T,)."""
    for row, (mask, colour) in enumerate(zip(active.values(), LINE_COLOURS)):
        axis.fill_between(times, row - 0.4, row + 0.4, where=list(mask), step='post',
                          linewidth=0.0, color=colour)
    axis.set_yticks(range(len(active)), list(active))
    axis.set_ylim(len(active) - 0.5, -0.5)
    axis.set_title('active bounds', fontsize='medium', loc='left')


def plot_tool_path(path: str | Path, points: ArrayLike, goals: ArrayLike | None = None, *,
                   title: str = 'Tool path', times: ArrayLike | None = None) -> Path:
    """
    Plot the path of a point, in the plane if its height is constant, else in space.

    Parameters
    ----------
    path, title
        See `plot_errors`.
    points : ndarray (T, 3)
        [m]
    goals : ndarray (k, 3), optional
        [m]
    times : ndarray (T,), optional
        Times of the points [s], which colour the path; by default its progress colours it.

    Returns
    -------
    pathlib.Path

    """
    track = np.asarray(points, dtype=float)
    marks = np.empty((0, 3)) if goals is None else np.atleast_2d(np.asarray(goals, dtype=float))
    marks = marks[np.isfinite(marks).all(axis=1)]
    scene = make_scene(np.concatenate((track, marks)), title)
    progress = np.linspace(0.0, 100.0, len(track)) if times is None \
        else np.asarray(times, dtype=float)
    shown = _thinned(len(track), 1500)
    track, progress = track[shown], progress[shown]
    axis = scene.axis
    if scene.floor is not None:
        axis.plot(track[:, 0], track[:, 1], scene.floor, color=SHADOW_COLOUR, linewidth=2)
    lines = _add_coloured_path(scene, track, progress)
    axis.plot(*scene.columns(track[:1]), 'o', color='white', markeredgecolor=ARM_COLOUR,
              markersize=9, markeredgewidth=2, label='start', zorder=5)
    axis.plot(*scene.columns(track[-1:]), 's', color=ARM_COLOUR, markersize=7, label='end',
              zorder=6)
    if len(marks):
        axis.plot(*scene.columns(marks), 'x', color=GOAL_COLOUR, markersize=10,
                  markeredgewidth=2.5, label='goal' if len(marks) == 1 else 'goals', zorder=7)
    bar = scene.figure.colorbar(lines, ax=axis, shrink=0.7,
                                pad=0.02 if scene.floor is None else 0.1)
    bar.set_label('time [s]' if times is not None else 'progress [%]')
    scene.figure.legend(*axis.get_legend_handles_labels(), loc='outside lower center', ncols=3,
                        frameon=False)
    return save(scene.figure, path)


def _add_coloured_path(scene: Scene, points: Array, values: Array) -> LineCollection:
    """Add a path (k, 3) whose colour follows values (k,), and return it."""
    points = np.column_stack(scene.columns(points))
    pieces = list(np.stack((points[:-1], points[1:]), axis=1))
    collection: LineCollection
    if scene.dimensions == 2:
        collection = LineCollection(pieces, cmap='viridis', linewidth=2, capstyle='round')
    else:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection
        collection = Line3DCollection(pieces, cmap='viridis', linewidth=2)
    collection.set_array(values[1:])
    scene.axis.add_collection(collection)
    return collection


def _legend_of(times: Array, limited: Mapping[str, Sequence[Causes]]) -> dict[str, str]:
    """Return {cause: label} of the causes with the longest durations, one for each colour."""
    drawn = Counter[str]()
    for sets in limited.values():
        for causes, duration in zip(sets, np.diff(times, append=times[-1])):
            for cause in causes:
                drawn[cause] += duration / len(causes)
    return {cause: '\n'.join(wrap(cause, LEGEND_WIDTH, max_lines=LEGEND_LINES, placeholder=' …'))
            for cause, _ in drawn.most_common(len(LINE_COLOURS))}


def _add_causes(axis: Axes, times: Array, limited: Mapping[str, Sequence[Causes]],
                legend: Mapping[str, str]) -> None:
    """Draw the causes that limit each task (T,) as bands: a row per task, a colour per cause."""
    lasts = np.diff(times, append=times[-1])
    colours, others = dict(zip(legend, LINE_COLOURS)), False
    for row, sets in enumerate(limited.values()):
        samples: dict[Causes, list[int]] = {}
        for sample, found in enumerate(sets):
            samples.setdefault(found, []).append(sample)
        for found, where in samples.items():
            # Simultaneous causes of a task share its row, always in the same order.
            causes = sorted(found, key=lambda cause: list(legend).index(cause) if cause in legend
                            else len(legend))
            for index, cause in enumerate(causes):
                others = others or cause not in legend
                axis.broken_barh(
                    np.column_stack([np.asarray(times)[where], lasts[where]]).tolist(),
                    (row - 0.4 + 0.8 * index / len(causes), 0.8 / len(causes)), linewidth=0.0,
                    color=colours.get(cause, GUIDE_COLOUR))
    for cause, label in legend.items():
        axis.plot([], [], color=colours[cause], linewidth=6.0, label=label)
    if others:
        axis.plot([], [], color=GUIDE_COLOUR, linewidth=6.0, label='other')
    axis.set_yticks(range(len(limited)), list(limited))
    axis.set_ylim(len(limited) - 0.4, -0.6)
    axis.set_ylabel('limited')


def _figure(title: str, rows: int, height: float,
            heights: Sequence[float] | None = None) -> tuple[Figure, list[Axes]]:
    """Return a figure and its axes, from top to bottom, with a common time axis."""
    figure = Figure(figsize=(8.2, height), dpi=PLOT_DPI, layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    axes = list(figure.subplots(
        rows, 1, sharex=True, squeeze=False, height_ratios=heights).ravel())
    for axis in axes:
        tidy(axis)
    return figure, axes


def _line(index: int) -> dict[str, Any]:
    """Return the colour and style of the line with an index."""
    return {'color': LINE_COLOURS[index % len(LINE_COLOURS)], 'linewidth': 1.8,
            'linestyle': STYLES[index // len(LINE_COLOURS) % len(STYLES)]}


def _legend(axis: Axes) -> None:
    """Place the legend beside the axis, where it covers nothing."""
    axis.legend(loc='upper left', bbox_to_anchor=(1.01, 1.02), frameon=False, borderaxespad=0.0)


def _mark_changes(axis: Axes, changes: Iterable[float]) -> None:
    """Mark the times of new goals; only the first mark has a legend entry."""
    for index, time in enumerate(changes):
        axis.axvline(time, color=GUIDE_COLOUR, linewidth=1.0, linestyle=(0, (2, 2)), zorder=0,
                     label=None if index else 'new goal')


def _mark_limits(axis: Axes, limit: float) -> None:
    """Mark ±limit, with a margin beyond it."""
    for index, value in enumerate((limit, -limit)):
        axis.axhline(value, color=LIMIT_COLOUR, linewidth=1.2, linestyle='--', zorder=1,
                     label=None if index else 'limit')
    axis.set_ylim(-1.12 * limit, 1.12 * limit)


def _set_error_range(axis: Axes, curves: Sequence[Array], log: bool) -> None:
    """Show zero on a linear axis; keep rounding errors from stretching a logarithmic one."""
    values = np.concatenate(curves)
    values = values[np.isfinite(values) & (values > 0.0)]
    top = values.max(initial=0.0)
    if log and top > 0.0:
        axis.set_yscale('log')
        axis.set_ylim(max(values.min(), 1e-7 * top) / 1.5, 1.5 * top)
    elif not log:
        # Begin slightly below zero, so that a curve at zero is visible.
        axis.set_ylim(-0.03 * (top or 1.0), 1.08 * (top or 1.0))


def _finish_time_axes(figure: Figure, axes: Sequence[Axes], times: Array) -> None:
    """Label the time axes."""
    for axis in axes:
        axis.set_xlim(times[0], times[-1] if times[-1] > times[0] else times[0] + 1.0)
    axes[-1].tick_params(labelbottom=True)
    figure.supxlabel('time [s]', fontsize='medium')


def _thinned(count: int, most: int) -> NDArray[np.intp]:
    """Return the indices of at most `most` samples, the first and the last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))

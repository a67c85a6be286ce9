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

"""
Figures of a recorded motion, written to files.

Everything is drawn on a canvas of its own, so neither a display nor the global state of pyplot
is touched, and figures can be made in any thread.
"""

from pathlib import Path
from xml.etree import ElementTree

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
import numpy as np
from PIL import Image
from tp_controller.demos.outlines import base_outline
from tp_controller.demos.outlines import joined as joined_lines

# Okabe and Ito's colours, which the colour-blind can tell apart; their yellow is too light for
# lines.
COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#000000')
STYLES = ('-', '--', ':', '-.')
GOAL_COLOUR = '#D55E00'
ARM_COLOUR = '#2F3B4A'
PATH_COLOUR = '#0072B2'
LIMIT_COLOUR = '#B00020'
FAINT = '#B8BEC6'
SHADOW_COLOUR = '#DDE1E6'
AROUND_COLOUR = '#8C5A2B'
THING_COLOUR = '#009E73'
MEANINGFUL = (GOAL_COLOUR, PATH_COLOUR, ARM_COLOUR, AROUND_COLOUR, THING_COLOUR)
DPI = 110
# Height of a line of a legend [in].
LEGEND_LINE = 0.24
MAX_FRAMES = 80
# Spread [m] below which a motion counts as lying in a plane.
FLAT = 1e-6
# Of a scene in space: shortest side per longest, and how much of the picture it fills, a cube and
# by how much more others.
LEAST_SIDE = 0.5
ZOOM, ENLARGED = 0.9, 0.1
# Ticks of the longest side.
TICKS = 6


def plot_errors(path, times, errors, *, title='Task errors', changes=(), log=False):
    """
    Draw errors over time, one axis for each unit.

    Parameters
    ----------
    path : str or pathlib.Path
        File to write; its folder is made where it is missing.
    times : ndarray (T,)
        [s]
    errors : sequence of (str, str, ndarray (T,))
        Name, unit and values; not a number where there is no error. A name keeps its colour on
        every axis.
    title : str
        Of the whole figure.
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
    figure, axes = _figure(title, len(units), height=2.0 + 1.9 * len(units))
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
    _finish_time_axes(axes, times)
    return save(figure, path)


def plot_velocities(path, times, velocities, limits, names, *, units=None,
                    title='Joint velocities', changes=()):
    """
    Draw joint velocities against their limits.

    Where all limits are equal the velocities are drawn as they are, else as shares of the
    limits; joints without a limit get an axis of their own.

    Parameters
    ----------
    path, times, title, changes
        See `plot_errors`.
    velocities : ndarray (T, n)
        [rad/s or m/s]
    limits : ndarray (n,)
        Largest absolute velocities [rad/s or m/s], infinite where there is none.
    names : sequence of str
        Of the joints.
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
        axis.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        if group is limited:
            _mark_limits(axis, 100.0 if share else limits[group[0]])
        axis.set_ylabel('share of limit [%]' if share else f'velocity [{unit}/s]')
        _mark_changes(axis, changes)
        _legend(axis)
    _finish_time_axes(axes, times)
    return save(figure, path)


def plot_positions(path, times, q, names, lower=None, upper=None, *, units=None,
                   title='Joint positions', changes=()):
    """
    Draw joint positions, each within its limits where there are any.

    Parameters
    ----------
    path, times, title, changes
        See `plot_errors`.
    q : ndarray (T, n)
        [rad or m]
    names, units
        See `plot_velocities`.
    lower, upper : ndarray (n,), optional
        Position limits [rad or m], infinite where there are none.

    Returns
    -------
    pathlib.Path

    """
    q, n = np.asarray(q, dtype=float), len(names)
    units = list(units or ['rad'] * n)
    lower = np.full(n, -np.inf) if lower is None else np.asarray(lower, dtype=float)
    upper = np.full(n, np.inf) if upper is None else np.asarray(upper, dtype=float)
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        figure, axes = _figure(title, 1, height=4.2)
        for joint, name in enumerate(names):
            axes[0].plot(times, q[:, joint], label=name, **_line(joint))
        axes[0].set_ylabel(f'position [{"/".join(dict.fromkeys(units))}]')
        _mark_changes(axes[0], changes)
        _legend(axes[0])
        _finish_time_axes(axes, times)
        return save(figure, path)
    columns = 1 if n < 3 else 2 if n < 9 else 3
    rows = -(-n // columns)
    figure, axes = _figure(title, rows, columns, height=1.0 + 1.35 * rows)
    for joint, axis in enumerate(axes[:n]):
        axis.plot(times, q[:, joint], **_line(0))
        _mark_range(axis, lower[joint], upper[joint])
        _mark_changes(axis, changes)
        axis.set_title(names[joint], loc='left', fontsize=9)
        axis.set_ylabel(f'[{units[joint]}]')
    for axis in axes[n:]:
        axis.remove()
    _finish_time_axes(axes[:n], times, columns)
    figure.legend(*axes[n - 1].get_legend_handles_labels(), loc='outside upper right', ncols=2,
                  frameon=False)
    return save(figure, path)


def plot_bounds(path, times, curves, *, title):
    """
    Draw values over time with the bounds they are to keep, one axis for each.

    Parameters
    ----------
    path, times, title
        See `plot_errors`.
    curves : sequence of (str, ndarray (T,), float, float)
        Label with the unit, values, lower and upper bound; infinite where there is none. Beyond
        a bound the axis is shaded.

    Returns
    -------
    pathlib.Path

    """
    figure, axes = _figure(title, len(curves), height=1.0 + 1.5 * len(curves))
    for index, (axis, (label, values, lower, upper)) in enumerate(zip(axes, curves)):
        axis.plot(times, values, **_line(index))
        bounds = [bound for bound in (lower, upper) if np.isfinite(bound)]
        low, high = np.min([*values, *bounds]), np.max([*values, *bounds])
        axis.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
        for bound, end in zip((lower, upper), axis.get_ylim()):
            if np.isfinite(bound):
                mark_bound(axis, bound, end - bound)
        axis.set_title(label, fontsize='medium', loc='left')
    _finish_time_axes(axes, times)
    return save(figure, path)


def plot_tool_path(path, points, goals=None, *, title='Tool path', times=None):
    """
    Draw the path of a point, flat where its height does not change, else in space.

    Parameters
    ----------
    path, title
        See `plot_errors`.
    points : ndarray (T, 3)
        [m]
    goals : ndarray (k, 3), optional
        [m]
    times : ndarray (T,), optional
        Of the points [s]; they colour the path. By default it is coloured by its progress.

    Returns
    -------
    pathlib.Path

    """
    points = np.asarray(points, dtype=float)
    goals = np.empty((0, 3)) if goals is None else np.atleast_2d(np.asarray(goals, dtype=float))
    goals = goals[np.isfinite(goals).all(axis=1)]
    everything = np.concatenate((points, goals))
    figure, axis, width = _scene(everything, title)
    progress = np.linspace(0.0, 100.0, len(points)) if times is None else np.asarray(times)
    shown = _thinned(len(points), 1500)
    points, progress = points[shown], progress[shown]
    if width == 3:
        axis.plot(points[:, 0], points[:, 1], axis.get_zlim()[0], color=SHADOW_COLOUR,
                  linewidth=2)
    lines = _coloured_path(axis, points[:, :width], progress)
    axis.plot(*_columns(points[:1, :width]), 'o', color='white', markeredgecolor=ARM_COLOUR,
              markersize=9, markeredgewidth=2, label='start', zorder=5)
    axis.plot(*_columns(points[-1:, :width]), 's', color=ARM_COLOUR, markersize=7, label='end',
              zorder=6)
    if len(goals):
        axis.plot(*_columns(goals[:, :width]), 'x', color=GOAL_COLOUR, markersize=10,
                  markeredgewidth=2.5, label='goal' if len(goals) == 1 else 'goals', zorder=7)
    bar = figure.colorbar(lines, ax=axis, shrink=0.7, pad=0.02 if width == 2 else 0.1)
    bar.set_label('time [s]' if times is not None else 'progress [%]')
    figure.legend(*axis.get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  frameon=False)
    return save(figure, path)


def animate_arm(path, robot, qs, times, frames=None, goals=None, fps=None, *, title=None,
                held=(), around=()):
    """
    Write an animation of the moving robot as a GIF of at most `MAX_FRAMES` pictures.

    Links are drawn as straight lines between their origins, and a base that moves by its outline.
    The view is from above where the robot moves in a horizontal plane, else in space, with its
    shadow on the ground.

    Parameters
    ----------
    path : str or pathlib.Path
        See `plot_errors`.
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
    fps : float, optional
        Pictures a second; such that the motion plays at its true speed by default, but in no
        more than ten seconds.
    title : str, optional
        The robot's name by default.
    held : sequence of (str, str), optional
        Pairs of frames that hold one thing, which is drawn as a line between them.
    around : sequence of ndarray (k, 3), optional
        Outlines of what stands around, in the root frame; see `tp_controller.demos.outlines` [m].

    Returns
    -------
    pathlib.Path

    """
    times, qs = np.asarray(times, dtype=float), np.asarray(qs, dtype=float)
    links, moving = links_of(robot)
    frames = [_tip(robot, links)] if frames is None else list(frames)
    segments, tools, joints = _positions(robot, qs, links, frames, moving)
    things, bases = _things(robot, qs, held), _bases(robot, qs)
    goals = np.full((len(times), 3), np.nan) if goals is None \
        else np.broadcast_to(np.asarray(goals, dtype=float), (len(times), 3))
    everything = np.concatenate([points.reshape(-1, 3) for points in (
        segments, tools, goals, bases, *around)])
    scene = _ArmScene(everything[np.isfinite(everything).all(axis=1)], tools,
                      title or robot.name, around, bool(held))
    # The samples nearest to moments equally spaced in time, which the samples need not be.
    moments = np.linspace(times[0], times[-1], min(len(times), MAX_FRAMES))
    shown = np.unique(np.searchsorted((times[1:] + times[:-1]) / 2.0, moments))
    duration = times[-1] - times[0]
    seconds = len(shown) / fps if fps else min(max(duration, 0.1), 10.0)
    speed = duration / seconds
    note = f'   ({speed:.1f} × real time)' if speed > 1.05 else ''
    pictures = [scene.picture(k, segments[k], joints[k], goals[k], f't = {times[k]:.1f} s{note}',
                              bases[k], things[k]) for k in shown]
    return _save_gif(path, pictures, 1000.0 * seconds / len(shown))


class _ArmScene:
    """Axes with everything that stays, and the lines that move, drawn over a kept background."""

    def __init__(self, everything, tools, title, around, holds):
        self._figure, self._axis, self._width = _scene(everything, title, size=(5.2, 5.4), dpi=88)
        self._tools = tools
        self._floor = None if self._width == 2 else self._axis.get_zlim()[0]
        blank = [[np.nan]] * self._width
        plot = self._axis.plot
        for index, line in enumerate(around):
            plot(*_columns(line[:, :self._width]), color=AROUND_COLOUR, linewidth=1.0,
                 label=None if index else 'obstacle')
        self._shadow = plot(*blank, color=SHADOW_COLOUR, linewidth=4, solid_capstyle='round')[0]
        paths = 'paths' if tools.shape[1] > 1 else 'tool path'
        self._paths = [plot(*blank, color=PATH_COLOUR, linewidth=1.2,
                            label=None if index else paths)[0]
                       for index in range(tools.shape[1])]
        self._base = plot(*blank, color=ARM_COLOUR, linewidth=1.0)[0]
        self._arm = plot(*blank, color=ARM_COLOUR, linewidth=4, solid_capstyle='round',
                         label='robot')[0]
        self._thing = plot(*blank, color=THING_COLOUR, linewidth=5, solid_capstyle='round',
                           label='thing' if holds else None)[0]
        self._joints = plot(*blank, 'o', color='white', markersize=6.5, markeredgewidth=2,
                            markeredgecolor=ARM_COLOUR, label='joints')[0]
        self._ends = plot(*blank, 'o', color=ARM_COLOUR, markersize=7)[0]
        self._goal = plot(*blank, 'x', color=GOAL_COLOUR, markersize=11, markeredgewidth=3,
                          label='goal')[0]
        self._clock = self._axis.text2D(0.02, 0.97, '', transform=self._axis.transAxes) \
            if self._width == 3 else self._axis.text(0.02, 0.96, '',
                                                     transform=self._axis.transAxes)
        self._figure.legend(*self._axis.get_legend_handles_labels(), loc='outside lower center',
                            ncols=5, columnspacing=1.2, frameon=False)
        self._moving = [self._shadow, *self._paths, self._base, self._arm, self._joints,
                        self._thing, self._ends, self._goal, self._clock]
        for artist in self._moving:
            artist.set_animated(True)
        self._figure.canvas.draw()
        self._background = self._figure.canvas.copy_from_bbox(self._figure.bbox)

    def picture(self, sample, segments, joints, goal, clock, base, thing):
        """
        Return the picture of one sample.

        The ends of the links are `segments` (k, 2, 3); `base` and `thing` (k, 3) are lines.
        """
        chain = joined_lines(segments)
        self._set(self._arm, chain)
        self._set(self._base, base)
        self._set(self._thing, thing)
        self._set(self._joints, joints)
        self._set(self._ends, self._tools[sample])
        if self._floor is not None:
            self._set(self._shadow, np.column_stack((
                chain[:, :2], np.where(np.isnan(chain[:, 0]), np.nan, self._floor))))
        for index, line in enumerate(self._paths):
            self._set(line, self._tools[:sample + 1, index])
        self._set(self._goal, goal[None])
        self._clock.set_text(clock)
        canvas = self._figure.canvas
        canvas.restore_region(self._background)
        for artist in self._moving:
            self._axis.draw_artist(artist)
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())

    def _set(self, line, points):
        """Give a line its points (k, 3)."""
        columns = _columns(points[:, :self._width])
        if self._width == 3:
            line.set_data_3d(*columns)
        else:
            line.set_data(*columns)


def links_of(robot):
    """Return (parent, child) of every joint of the description, and the children that move."""
    joints = ElementTree.fromstring(robot.urdf.encode()).findall('joint')
    links = [(joint.find('parent').get('link'), joint.find('child').get('link'))
             for joint in joints]
    driven = [child for joint, (_, child) in zip(joints, links)
              if joint.get('name') in robot.joint_names]
    return links, driven


def _tip(robot, links):
    """Return the frame at the end of the chain with the most joints."""
    parents = {child: parent for parent, child in links}

    def depth(frame):
        return 1 + depth(parents[frame]) if frame in parents else 0

    return max(robot.frame_names, key=depth)


def _positions(robot, qs, links, frames, joints):
    """
    Return where everything is [m].

    That is the ends of the links (T, k, 2, 3), without those of no length, and the origins of
    `frames` and `joints` (T, k, 3).
    """
    state = robot.state(qs[0])
    segments = np.empty((len(qs), len(links), 2, 3))
    tools, axes = (np.empty((len(qs), len(names), 3)) for names in (frames, joints))
    for sample, q in enumerate(qs):
        state.update(q)
        segments[sample] = [[state.position(parent), state.position(child)]
                            for parent, child in links]
        tools[sample] = [state.position(frame) for frame in frames]
        axes[sample] = [state.position(frame) for frame in joints]
    lengths = np.linalg.norm(segments[:, :, 1] - segments[:, :, 0], axis=2).max(axis=0)
    return segments[:, lengths > FLAT], tools, axes


def _things(robot, qs, held):
    """Return lines between the frames of pairs at each time (T, k, 3) [m]."""
    state, gap = robot.state(qs[0]), np.full(3, np.nan)
    lines = np.empty((len(qs), 3 * len(held), 3))
    for sample, q in enumerate(qs):
        state.update(q)
        lines[sample] = np.reshape([(state.position(one), state.position(other), gap)
                                    for one, other in held], (-1, 3))
    return lines


def _bases(robot, qs):
    """Return the outline of a base that moves at each time (T, k, 3) [m]; none of another."""
    if not robot.moves:
        return np.empty((len(qs), 0, 3))
    own, state = base_outline(robot), robot.state(qs[0])
    lines = np.empty((len(qs), *own.shape))
    for sample, q in enumerate(qs):
        state.update(q)
        T = state.pose(robot.base_frame)
        lines[sample] = own @ T[:3, :3].T + T[:3, 3]
    return lines


def _scene(points, title, size=(6.4, 6.0), dpi=DPI):
    """Return a figure, an axis with equal scales around points (k, 3), and its dimensions."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    flat = upper[2] - lower[2] < FLAT
    figure = Figure(figsize=size, dpi=dpi, layout='constrained')
    FigureCanvasAgg(figure)
    axis = figure.add_subplot() if flat else figure.add_subplot(projection='3d')
    axis.set_title(title)
    axis.set(xlabel='x [m]', ylabel='y [m]')
    longest = max((upper - lower).max(), FLAT)
    # In space a side is as long as is needed: what moves far would be tiny in a cube.
    sides = np.full(3, longest) if flat else np.maximum(upper - lower, LEAST_SIDE * longest)
    half, middle = 0.55 * sides, (lower + upper) / 2.0
    axis.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axis.set_ylim(middle[1] - half[1], middle[1] + half[1])
    if flat:
        axis.set_aspect('equal')
        tidy(axis)
        return figure, axis, 2
    axis.set_zlim(lower[2], lower[2] + 2.0 * half[2])
    axis.set_zlabel('z [m]')
    # A cube has the longest diagonal: what is flatter, or thinner, may be drawn larger.
    shape = half / half.max()
    axis.set_box_aspect(shape, zoom=ZOOM * (np.sqrt(3.0) / np.linalg.norm(shape)) ** ENLARGED)
    for each, side in zip((axis.xaxis, axis.yaxis, axis.zaxis), shape):
        each.set_major_locator(MaxNLocator(max(round(TICKS * side), 2)))
    axis.view_init(elev=22.0, azim=-55.0)
    return figure, axis, 3


def _coloured_path(axis, points, values):
    """Add a path (k, 2 or 3) whose colour follows values (k,), and return it."""
    pieces = np.stack((points[:-1], points[1:]), axis=1)
    if points.shape[1] == 2:
        collection = LineCollection(pieces, cmap='viridis', linewidth=2, capstyle='round')
    else:
        from mpl_toolkits.mplot3d.art3d import Line3DCollection
        collection = Line3DCollection(pieces, cmap='viridis', linewidth=2)
    collection.set_array(values[1:])
    axis.add_collection(collection)
    return collection


def _figure(title, rows, columns=1, height=4.0):
    """Return a figure and its axes, row by row, over one time axis."""
    figure = Figure(figsize=(8.2, height), dpi=DPI, layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    axes = list(figure.subplots(rows, columns, sharex=True, squeeze=False).ravel())
    for axis in axes:
        tidy(axis)
    return figure, axes


def tidy(axis):
    """Take away what distracts."""
    axis.grid(color='#E6E8EB', linewidth=0.8)
    axis.set_axisbelow(True)
    for side in ('top', 'right'):
        axis.spines[side].set_visible(False)


def _line(index):
    """Return colour and style of the line with a number."""
    return {'color': COLOURS[index % len(COLOURS)], 'linewidth': 1.8,
            'linestyle': STYLES[index // len(COLOURS) % len(STYLES)]}


def _legend(axis):
    """Put the legend beside the axis, where it covers nothing."""
    axis.legend(loc='upper left', bbox_to_anchor=(1.01, 1.02), frameon=False, borderaxespad=0.0)


def _mark_changes(axis, changes):
    """Mark the times at which a goal changed; the first mark explains them all."""
    for index, time in enumerate(changes):
        axis.axvline(time, color=FAINT, linewidth=1.0, linestyle=(0, (2, 2)), zorder=0,
                     label=None if index else 'new goal')


def _mark_limits(axis, limit):
    """Mark ±limit, and leave room above it."""
    for index, value in enumerate((limit, -limit)):
        axis.axhline(value, color=LIMIT_COLOUR, linewidth=1.2, linestyle='--', zorder=1,
                     label=None if index else 'limit')
    axis.set_ylim(-1.12 * limit, 1.12 * limit)


def _mark_range(axis, lower, upper):
    """Mark position limits, and shade what is beyond them."""
    span = upper - lower if np.isfinite(upper - lower) else 1.0
    for limit, outward in ((lower, -1.0), (upper, 1.0)):
        if np.isfinite(limit):
            mark_bound(axis, limit, outward * span,
                       label='limit' if outward > 0.0 or not np.isfinite(upper) else None)
            axis.set_ylim(**{'bottom' if outward < 0.0 else 'top': limit + outward * 0.1 * span})


def mark_bound(axis, bound, beyond, label=None):
    """Mark a value that is not to be crossed, and shade what is beyond it."""
    axis.axhline(bound, color=LIMIT_COLOUR, linewidth=1.2, linestyle='--', zorder=1, label=label)
    axis.axhspan(bound, bound + beyond, color=LIMIT_COLOUR, alpha=0.06, zorder=0, linewidth=0.0)


def _set_error_range(axis, curves, log):
    """Show zero on a linear axis; keep rounding errors from stretching a logarithmic one."""
    values = np.concatenate(curves)
    values = values[np.isfinite(values) & (values > 0.0)]
    top = values.max(initial=0.0)
    if log and top > 0.0:
        axis.set_yscale('log')
        axis.set_ylim(max(values.min(), 1e-7 * top) / 1.5, 1.5 * top)
    elif not log:
        # A little below zero, so that a curve on zero is seen.
        axis.set_ylim(-0.03 * (top or 1.0), 1.08 * (top or 1.0))


def _finish_time_axes(axes, times, columns=1):
    """Label the time axes, the lowest of each column."""
    for axis in axes:
        axis.set_xlim(times[0], times[-1] if times[-1] > times[0] else times[0] + 1.0)
    for axis in axes[-columns:]:
        axis.tick_params(labelbottom=True)
    axes[0].figure.supxlabel('time [s]', fontsize='medium')


def _thinned(count, most):
    """Return the indices of at most `most` samples, the first and the last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _columns(points):
    """Return the columns of an array, as the arguments of a plot."""
    return tuple(np.asarray(points).T)


def save(figure, path):
    """Write a figure and return its path."""
    path = _prepared(path)
    figure.savefig(path)
    return path


def _save_gif(path, pictures, milliseconds):
    """Write pictures as an animation that repeats, and return its path."""
    path = _prepared(path)
    # One palette for all: what does not change between two pictures then takes no space. The
    # last picture has every colour in it. What is almost white shall not tint the background,
    # and the colours that carry meaning shall not be mixed with others.
    # 64 colours in all need 6 bits.
    others = 64 - len(MEANINGFUL)
    palette = pictures[-1].quantize(others, dither=Image.Dither.NONE)
    colours = np.array(palette.getpalette()[:3 * others]).reshape(-1, 3)
    colours[colours.min(axis=1) > 245] = 255
    kept = [round(255.0 * part) for colour in MEANINGFUL for part in to_rgb(colour)]
    palette.putpalette(colours.ravel().tolist() + kept)
    first, *others = (picture.quantize(palette=palette, dither=Image.Dither.NONE)
                      for picture in pictures)
    first.save(path, save_all=True, append_images=others, loop=0,
               duration=max(round(milliseconds, -1), 20))
    return path


def _prepared(path):
    """Return a path whose folder exists."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path

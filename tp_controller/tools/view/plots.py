# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Running plots on the page: errors, joint velocities relative to their limits, manipulability."""

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.ros.client.status import TaskStatus
import viser

# Time span of a plot, and sampling period [s].
SECONDS, SAMPLE_SECONDS = 20.0, 0.1
CURVE_COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#000000',
                 '#7F3C8D', '#80BA5A')
LIMIT_COLOUR = '#B00020'
HEIGHT = 190
# Top, right, bottom and left: half of the uppermost label is above its line.
PADDING = 8, 24, 0, 0
# Errors are clamped to these bounds: a logarithmic scale (`distr` 3) has no zero.
LEAST_ERROR, MOST_ERROR = 1e-6, 1e9
# Largest number of labels of an axis.
MOST_LABELS = 6
# A plot in a tab that was just opened has no width until the browser draws the next frame; it
# would show its legend only.
HIDE_NARROW = '<style>.uplot:has(canvas[width="0"]) {visibility: hidden}</style>'
# The default of uPlot; viser makes the ticks as dark as the labels.
TICKS: viser.uplot.Axis_Ticks = {'stroke': '#00000012'}
EXPONENTS = str.maketrans('-0123456789', '⁻⁰¹²³⁴⁵⁶⁷⁸⁹')
# Entries of a Jacobian below this count as zero.
JACOBIAN_TOLERANCE = 1e-9
# Number of random configurations that find the rows of a Jacobian that are not zero.
JACOBIAN_SAMPLES = 5


class RunningPlot:
    """
    Plot of the last seconds.

    Parameters
    ----------
    gui : viser.GuiApi
        The plot is added to its current container.
    title : str
    scale : dict, optional
        Scale of the y axis, in the form of uPlot; logarithmic by default.
    limits : sequence of float
        Limits, drawn as lines.

    Attributes
    ----------
    names : tuple of str
        Names of the curves.

    """

    def __init__(self, gui: viser.GuiApi, title: str, scale: viser.uplot.Scale | None = None,
                 limits: Sequence[float] = ()) -> None:
        self._gui, self._title, self._scale, self._limits = gui, title, scale, limits
        self._plot: viser.GuiUplotHandle | None = None
        self.names: tuple[str, ...] = ()
        self._times: list[float] = []
        self._rows: list[list[float]] = []

    def add(self, now: float, values: Mapping[str, float]) -> None:
        """
        Add a sample if all its values are finite.

        Different names than before clear the plot.

        Parameters
        ----------
        now : float
            [s]
        values : dict
            {name of a curve: value}

        """
        if not np.isfinite(list(values.values())).all():
            return
        if values.keys() != set(self.names):
            self.names, self._times, self._rows = tuple(sorted(values)), [], []
        self._times.append(now)
        self._rows.append([values[name] for name in self.names])
        first = bisect_left(self._times, now - SECONDS)
        del self._times[:first], self._rows[:first]

    def show(self) -> None:
        """Show the samples."""
        if not self.names or not self._times:
            return
        data, series = self._data(), series_of(self.names, len(self._limits))
        if self._plot is None:
            self._plot = self._gui.add_uplot(data, series, title=self._title, height=HEIGHT,
                                             padding=PADDING, **self._axes())
        # Reuse the plot: a browser may still have updates of it.
        for name, value in {'series': series, **self._axes()}.items():
            if getattr(self._plot, name) != value:
                setattr(self._plot, name, value)
        self._plot.data = data

    def _axes(self) -> dict[str, Any]:
        """Return axes and scales, in the form of uPlot."""
        x: viser.uplot.Scale = {'time': False, 'range': (-SECONDS, 0.0)}
        if self._scale is not None:
            return {'scales': {'x': x, 'y': self._scale}}
        powers = powers_of_ten(self._rows)
        # The default labels are rounded to thousandths, and the grid has lines between powers.
        return {'scales': {'x': x, 'y': {'distr': 3, 'log': 10, 'range': (powers[0], powers[-1])}},
                'axes': ({'ticks': TICKS}, {'ticks': TICKS, 'splits': powers,
                                            'values': labels(powers)})}

    def _data(self) -> tuple[Array, ...]:
        """Return times relative to the last sample, and values (k,)."""
        times = np.array(self._times) - self._times[-1]
        return (times, *np.array(self._rows).T,
                *(np.full(len(times), limit) for limit in self._limits))


def series_of(names: Sequence[str], limits: int) -> tuple[viser.uplot.Series, ...]:
    """Return labels and styles of a plot over time: its curves, then a number of limits."""
    series: list[viser.uplot.Series] = [{'label': 's'}]
    series += [{'label': name, 'width': 1.5, 'stroke': CURVE_COLOURS[number % len(CURVE_COLOURS)]}
               for number, name in enumerate(names)]
    series += [{'label': 'limit', 'stroke': LIMIT_COLOUR, 'width': 1, 'dash': (6, 4)}] * limits
    return tuple(series)


@dataclass(frozen=True)
class Sample:
    """
    State of a controller from which the plots take their values.

    Attributes
    ----------
    rows : list of TaskStatus
        Tasks.
    robot : Robot
        Robot whose limits and Jacobian are used.
    state : RobotState
        State of the robot.
    velocity : ndarray (n,)
        Joint velocities; not a number if unknown [rad/s or m/s].
    frame : str
        Frame whose manipulability is shown.

    """

    rows: Sequence[TaskStatus]
    robot: Robot
    state: RobotState
    velocity: Array
    frame: str


class Plots:
    """
    Plots of the page.

    Parameters
    ----------
    gui : viser.GuiApi
    tab : viser.GuiTabHandle
        Tab of the plots.

    Attributes
    ----------
    errors, velocities, manipulability : RunningPlot

    """

    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle) -> None:
        self._gui, self._tab = gui, tab
        with tab:
            gui.add_html(HIDE_NARROW)
        self._curves: dict[RunningPlot, Callable[[Sample], dict[str, float]]] = {}
        self.errors = self._plot('error', error_curves)
        self.velocities = self._plot('velocity, % of limit', velocity_shares, {
            'auto': False, 'range': (-110.0, 110.0)}, (-100.0, 100.0))
        self.manipulability = self._plot('manipulability', self._manipulability, {'auto': True})
        self._due = -math.inf
        self._rows: tuple[str, list[int]] = ('', [])

    def add(self, now: float, sample: Sample) -> None:
        """Add a sample if it is due at a time [s], and show it."""
        if now < self._due:
            return
        self._due = now + SAMPLE_SECONDS
        for plot, curves in self._curves.items():
            plot.add(now, curves(sample))
            with self._tab:
                plot.show()

    def _plot(self, title: str, curves: Callable[[Sample], dict[str, float]],
              scale: viser.uplot.Scale | None = None,
              limits: Sequence[float] = ()) -> RunningPlot:
        """Return a `RunningPlot` of the curves that a function computes from each sample."""
        plot = RunningPlot(self._gui, title, scale, limits)
        self._curves[plot] = curves
        return plot

    def _manipulability(self, sample: Sample) -> dict[str, float]:
        """Return {frame: manipulability}."""
        if self._rows[0] != sample.frame:
            self._rows = sample.frame, moving_rows(sample.robot, sample.frame)
        return {sample.frame: manipulability(sample.state, sample.frame, self._rows[1])}


def error_curves(sample: Sample) -> dict[str, float]:
    """Return {task and unit: error}, clamped to positive values; not a number if unknown."""
    return {f'{row.name} [{unit}]': error if math.isnan(error)
            else min(max(error, LEAST_ERROR), MOST_ERROR)
            for row in sample.rows for unit, error in row.errors.items()}


def velocity_shares(sample: Sample) -> dict[str, float]:
    """Return {name: velocity} of limited velocities [% of the limit]; 0 if unknown."""
    robot, velocity = sample.robot, sample.velocity
    limited = np.isfinite(robot.velocity) & (robot.velocity > 0.0)
    shares = 100.0 * velocity[limited] / robot.velocity[limited]
    names = [name for name, given in zip(robot.velocity_names, limited) if given]
    return dict(zip(names, np.nan_to_num(shares).tolist()))


def powers_of_ten(values: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Return the powers of ten that enclose positive values."""
    lower = math.floor(math.log10(min(map(min, values))))
    upper = math.ceil(math.log10(max(map(max, values))))
    return tuple(10.0**each for each in range(lower, max(upper, lower + 1) + 1))


def labels(powers: Sequence[float]) -> tuple[str, ...]:
    """Return a label for each power of ten; with many powers some labels are empty."""
    step = math.ceil(len(powers) / MOST_LABELS)
    exponents = [round(math.log10(power)) for power in powers]
    return tuple('' if each % step else f'10{str(each).translate(EXPONENTS)}'
                 for each in exponents)


def moving_rows(robot: Robot, frame: str) -> list[int]:
    """Return the rows of the Jacobian of a frame that are not always zero."""
    random = np.random.default_rng(0)
    state = robot.state(robot.neutral())
    found = np.zeros(6)
    for _ in range(JACOBIAN_SAMPLES):
        state.update(robot.integrate(robot.neutral(), random.uniform(-1.0, 1.0, robot.n), 1.0))
        found = np.maximum(found, np.abs(state.jacobian(frame)).max(axis=1))
    return np.flatnonzero(found > JACOBIAN_TOLERANCE).tolist()


def manipulability(state: RobotState, frame: str, rows: Sequence[int]) -> float:
    """Return Yoshikawa's measure, the product of the singular values, of rows of a Jacobian."""
    return float(np.prod(np.linalg.svd(state.jacobian(frame)[list(rows)], compute_uv=False)))

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scene of a lesson: a question, the runs that answer it, their checks, plot and film."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
import math
from pathlib import Path
from textwrap import fill

import numpy as np
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.cycle_options import SolverFactory
from tp_controller.model.spatial import Array
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tools.demos.motion import Look, Motion
from tp_controller.tools.demos.outcome import films, Measurement, Outcome
from tp_controller.tools.demos.simulation import intervals, Run, simulate
from tp_controller.tools.plots.curves import BoundedCurves, plot_bounds

TEXT_WIDTH = 99


@dataclass(frozen=True)
class Failure:
    """Joint that stands still from a time [s] on; locked then, or commanded in vain."""

    joint: str
    time: float
    locked: bool


@dataclass(frozen=True, eq=False)
class Variant:
    """Stack, settings and solver of one run of a scene, and the joint that fails in it."""

    stack: str | Path
    settings: Settings = Settings()
    solver: SolverFactory = Settings.solver
    failure: Failure | None = None


@dataclass(frozen=True)
class Curve:
    """Quantity over time, with its unit, its function of a run (T,), and bounds."""

    unit: str
    values: Callable[[Run], Array]
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True)
class Check:
    """
    Reference of the largest value of a curve.

    Attributes
    ----------
    variant, curve : str
        Names in the scene.
    reference : float
        Largest value, within a share `tolerance`; without one an upper bound.
    since, until : float
        Times between which it counts [s].

    """

    variant: str
    curve: str
    reference: float
    tolerance: float = 0.0
    since: float = 0.0
    until: float = math.inf

    @property
    def window(self) -> str:
        """Return the times between which it counts, as text."""
        since = f' from {self.since:g} s' if self.since else ''
        return since + (f' to {self.until:g} s' if math.isfinite(self.until) else '')


@dataclass(frozen=True, eq=False)
class Scene:
    """
    Question of a lesson, with the runs that answer it.

    Attributes
    ----------
    title, question, answer : str
    robot : callable
        Returns the robot.
    start : ndarray (nq,)
        First configuration of every run [rad or m].
    duration : float
        [s]
    goals : callable
        Returns {task: goal} at a time [s].
    variants : {str: Variant}
        Runs; the first one is in the film.
    curves : {str: Curve}
        Quantities of the plot, from top to bottom.
    checks : tuple of Check
    moving : bool
        Goals move all the time: their velocity is fed forward.
    active : tuple of str
        Inequality tasks whose active bounds the plot shows, of the first variant.
    captions : tuple of (float, str)
        See `Motion`; the title by default.
    look : Look

    """

    title: str
    question: str
    answer: str
    robot: Callable[[], Robot]
    start: Array
    duration: float
    goals: Callable[[float], Mapping[str, Goal]]
    variants: Mapping[str, Variant]
    curves: Mapping[str, Curve]
    checks: tuple[Check, ...]
    moving: bool = False
    active: tuple[str, ...] = ()
    captions: tuple[tuple[float, str], ...] = ()
    look: Look = Look()

    def runs(self) -> dict[str, Run]:
        """Return the run of each variant."""
        return {name: self._run(variant) for name, variant in self.variants.items()}

    def motion(self, run: Run) -> Motion:
        """Return the motion of a run, with goals and captions."""
        return Motion(self.title, run.robot, run.times, run.q, run.stack, self.look,
                      list(self._goal_changes(run.times)), self.captions or ((0.0, self.title),))

    def _run(self, variant: Variant) -> Run:
        """Return the run of a variant."""
        robot, failure = self.robot(), variant.failure
        controller = Controller(robot, Stack.from_yaml(variant.stack, robot), variant.settings,
                                variant.solver)
        period = controller.settings.period

        def prepare(now: float) -> None:
            self._set_goals(controller, now)
            if failure and failure.locked and round((now - failure.time) / period) == 0:
                controller.lock([failure.joint], now)

        def carried_out(now: float, velocity: Array) -> Array:
            if failure is None or now < failure.time:
                return velocity
            return np.where(np.arange(robot.n) == robot.joint_index(failure.joint), 0.0, velocity)

        return simulate(controller, self.start, round(self.duration / period), prepare,
                        carried_out)

    def _set_goals(self, controller: Controller, now: float) -> None:
        """Set the goals at a time, with their velocity if they move."""
        period = controller.settings.period
        later = self.goals(now + period)
        for task, goal in self.goals(now).items():
            if self.moving:
                controller.set_goal(task, goal, now)
                controller.set_feed_forward(
                    task, (np.asarray(later[task]) - np.asarray(goal)) / period, now)
            elif not now or self.goals(now - period)[task] is not goal:
                controller.set_goal(task, goal, now)

    def _goal_changes(self, times: Array) -> Iterator[tuple[float, str, Goal]]:
        """Yield (time, task, goal) of every new goal."""
        last: Mapping[str, Goal] = {}
        for now in times.tolist():
            for task, goal in self.goals(now).items():
                if last.get(task) is not goal:
                    yield now, task, goal
            last = self.goals(now)


def play(name: str, scene: Scene, folder: str | Path) -> Outcome:
    """
    Run a scene and write its plot and film.

    Parameters
    ----------
    name : str
        Name of the files.
    scene : Scene
        One of `tp_controller.tools.demos.scenes.SCENES`.
    folder : str or pathlib.Path
        Folder of the files.

    Returns
    -------
    Outcome

    """
    runs = scene.runs()
    times = next(iter(runs.values())).times
    curves = {label: {variant: curve.values(run) for variant, run in runs.items()}
              for label, curve in scene.curves.items()}
    measurements = tuple(_measure(scene, check, times, curves) for check in scene.checks)
    paths = _figures(name, scene, Path(folder), runs, curves)
    lines = ('', *_table(scene, curves), *_active(scene, runs), '', *(
        fill(f'{head}: {text}', TEXT_WIDTH) for head, text in (
            ('Question', scene.question), ('Answer', scene.answer))), '')
    return Outcome(scene.title, measurements, lines, tuple(paths))


def _table(scene: Scene, curves: Mapping[str, Mapping[str, Array]]) -> Iterator[str]:
    """Yield a table of the largest and the last value of each curve."""
    yield ''.join((f'{"largest, at the end":<46}', *(f'{name:>22}' for name in scene.variants)))
    for label, curve in scene.curves.items():
        yield ''.join((f'{f"{label} [{curve.unit}]":<46}', *(
            f'{values.max():>12.3f}{values[-1]:>10.3f}' for values in curves[label].values())))


def _active(scene: Scene, runs: Mapping[str, Run]) -> Iterator[str]:
    """Yield the times at which bounds of the first variant are active."""
    run = next(iter(runs.values()))
    for task in scene.active:
        yield f'{task} active: ' + ', '.join(
            f'{run.times[first]:.2f} s to {run.times[last]:.2f} s'
            for first, last in intervals(run.active(task)))


def _measure(scene: Scene, check: Check, times: Array,
             curves: Mapping[str, Mapping[str, Array]]) -> Measurement:
    """Return the measurement of a check."""
    counts = (times >= check.since) & (times < check.until)
    return Measurement(
        f'{check.variant}: {check.curve}{check.window}', scene.curves[check.curve].unit,
        float(curves[check.curve][check.variant][counts].max()), check.reference,
        check.tolerance * check.reference, bound=not check.tolerance)


def _figures(name: str, scene: Scene, folder: Path, runs: Mapping[str, Run],
             curves: Mapping[str, Mapping[str, Array]]) -> Iterator[Path]:
    """Write the figures and yield their paths."""
    first = next(iter(runs.values()))
    # A single variant needs no legend.
    named = {variant: variant * (len(runs) > 1) for variant in runs}
    yield plot_bounds(
        folder / f'{name}.png', first.times,
        [BoundedCurves(f'{label} [{curve.unit}]',
                       {named[variant]: values for variant, values in curves[label].items()},
                       curve.lower, curve.upper) for label, curve in scene.curves.items()],
        title=scene.title, active={task: first.active(task) for task in scene.active})
    yield from films(folder / f'{name}.webp', scene.motion(first))

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

"""The check of a stack: samples, closed loops, and what follows from them."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields
from itertools import chain
import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.controller import Controller
from tp_controller.control.gains import decay_step
from tp_controller.control.settings import Settings
from tp_controller.errors import SettingsError, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.simulator import start_configuration
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Task
from tp_controller.tools.check.closed_loop import (
    AT_REST,
    closed_loop,
    Extremes,
    FAILED,
    REACHED,
    Run,
    TaskRun,
    TIME,
    Worst,
)
from tp_controller.tools.check.configuration_sample import Glimpse, glimpse
from tp_controller.tools.check.cycle_times import cycle_times
from tp_controller.tools.check.findings import (
    about_bounds,
    about_gains,
    about_goals,
    about_levels,
    about_limits,
    about_pairs,
    about_robot,
    about_singularities,
    about_time,
    NAMED,
)
from tp_controller.tools.check.results import (
    by_severity,
    CauseCount,
    CheckReport,
    Finding,
    LevelResult,
    PairResult,
    TaskResult,
    Timing,
    WorstResult,
    WRONG,
)
from tp_controller.tools.check.setup import Setup
from tp_controller.tools.check.spread import Spreader

VERSION = 1
SAMPLES, RUNS, SECONDS = 300, 20, 15.0
# Half of the goals are nearer than this, as a share of the way to any configuration.
NEAR = 0.5


class Advancing(Protocol):
    """What is told that a part of the work is done."""

    def advance(self) -> None:
        """Note it."""


class _Silent:
    """Shows nothing."""

    def advance(self) -> None:
        """Note that a part is done."""


# Opened with how many parts there are, and what is done.
Progress = Callable[[int, str], AbstractContextManager[Advancing]]


def _silent(total: int, what: str) -> AbstractContextManager[Advancing]:
    """Show no progress."""
    return nullcontext(_Silent())


def check(robot: Robot, stack: Stack, settings: Settings | None = None, *,
          period: float | None = None, samples: int = SAMPLES, runs: int = RUNS,
          seconds: float = SECONDS, seed: int = 0, jobs: int = 1, backend: str = 'loky',
          around: ArrayLike | None = None, progress: Progress = _silent) -> CheckReport:
    """
    Say what is wrong or doubtful with a stack, before a robot moves.

    At random configurations within the limits it looks at what the levels can do. Closed loops
    with a `KinematicSimulator` then go from random starts to random goals that can be reached:
    values of the tasks at another configuration. Both satisfy bounds and goals of the stack.

    The same seed gives the same report, whatever `jobs` and `backend`; only `timing`, and what is
    said of it, differs.

    Parameters
    ----------
    robot : Robot
        That is not moved.
    stack : Stack
        Its tasks are copied and stay as they are; goals that they have count as goals of the
        stack. No controller has used it.
    settings : Settings, optional
        Of the controller.
    period : float, optional
        Time between two cycles [s]; that of the settings, the longest one, by default.
    samples, runs : int
        How many configurations, and closed loops.
    seconds : float
        Longest time of a closed loop [s].
    seed : int
        Of the random configurations, from 0.
    jobs : int
        Processes; -1: as many as there are processors. More than one needs joblib, and a stack
        that was read from YAML.
    backend : str
        ``loky``: processes of this machine; ``dask``, ``ray``: a cluster.
    around : array_like (nq,), optional
        Configuration; a base that moves starts near where it is there. That of
        `start_configuration` by default.
    progress : callable, optional
        Called with a number of parts and a text for each section of the work; returns a context
        manager whose value has a method ``advance()``.

    Returns
    -------
    CheckReport

    Raises
    ------
    SettingsError
        An argument is out of range.
    StackError
        A controller has used the stack; see `Stack.copy`.
    RobotError
        `around` is no configuration.
    ModuleNotFoundError
        More than one job, and joblib or the backend is not installed.

    """
    settings = settings or Settings()
    setup = Setup(robot, stack, settings, _checked_period(period, settings), seconds,
                  robot.state(start_configuration(robot) if around is None else around).q)
    _check_counts(samples, runs, seconds, seed)
    seeds = np.random.SeedSequence(seed).spawn(3)
    faults = _refusals(setup)
    with Spreader(setup, jobs, backend) as spreader:
        with progress(samples, 'samples') as shown:
            glimpses = spreader.spread(glimpse, seeds[0].spawn(samples), shown.advance)
        found: list[Run] = []
        if not faults:
            with progress(runs, 'closed loops') as shown:
                found = spreader.spread(closed_loop, list(enumerate(seeds[1].spawn(runs))),
                                        shown.advance)
    timing = None
    if not faults and runs:
        try:
            timing = cycle_times(setup, seeds[2])
        except TpControllerError:
            # A task fails; the runs say so.
            pass
    return _report(setup, seed, glimpses, found, faults, timing)


def refused(messages: Iterable[tuple[str, str]], rate: float = 0.0, seed: int = 0,
            robot: str = '') -> CheckReport:
    """
    Return the report of a stack that is not even read.

    Parameters
    ----------
    messages : iterable of (str, str)
        Where the faults are, and what they are.
    rate, seed, robot
        Of the report.

    """
    findings = tuple(Finding(WRONG, 'fault', where, message, 'correct it: a controller refuses '
                             'it, too') for where, message in messages)
    return CheckReport(VERSION, robot, rate, seed, 0, 0, {}, findings, (), (), (), (), None)


def _checked_period(period: float | None, settings: Settings) -> float:
    """Return the time between two cycles [s], or raise `SettingsError`."""
    if period is None:
        return settings.period
    if not 0.0 < period <= settings.period * (1.0 + 1e-9):
        raise SettingsError([f'period must be positive, and at most that of the settings, '
                             f'{settings.period:g} s, not {period!r}'])
    return period


def _check_counts(samples: int, runs: int, seconds: float, seed: int) -> None:
    """Raise `SettingsError` where a number is out of its range."""
    faults = [f'{name} must be a whole number from {least} on, not {value!r}'
              for name, value, least in (('samples', samples, 1), ('runs', runs, 0),
                                         ('seed', seed, 0))
              if not isinstance(value, int) or value < least]
    if not 0.0 < seconds < math.inf:
        faults.append(f'seconds must be positive and finite, not {seconds!r}')
    if faults:
        raise SettingsError(faults)


def _refusals(setup: Setup) -> list[Finding]:
    """Return why a controller would refuse the settings with this stack."""
    try:
        Controller(setup.robot, setup.stack.copy(), setup.settings)
    except SettingsError as error:
        return [Finding(WRONG, 'fault', '', fault, 'correct it: a controller refuses it, too')
                for fault in error.faults]
    return []


def _report(setup: Setup, seed: int, glimpses: Sequence[Glimpse], runs: Sequence[Run],
            faults: Sequence[Finding], timing: Timing | None) -> CheckReport:
    """Return the report of what was found."""
    seen = [each for each in glimpses if not each.fault]
    levels, pairs = _levels(setup, seen), _pairs(seen)
    tasks = tuple(_task(setup, task, number, seen, runs)
                  for task, number in _numbered(setup.stack))
    worst = _worst(runs)
    numbers = {task.name: task.level for task in tasks}
    filling = seen[0].filling if seen else frozenset()
    findings = [*faults, *_failures(glimpses, runs), *chain(
        about_robot(setup), about_levels(levels, filling),
        about_pairs(pairs, numbers), about_gains(setup),
        about_singularities(setup, tasks), about_bounds(tasks, len(runs)),
        about_goals(tasks, filling, setup), about_limits(worst, setup),
        about_time(timing, setup) if timing else ())]
    ended = Counter(run.ended for run in runs)
    return CheckReport(
        VERSION, setup.robot.name, 1.0 / setup.period, seed, len(glimpses), len(runs),
        {how: ended[how] for how in (REACHED, AT_REST, TIME, FAILED)} if runs else {},
        by_severity(findings), levels, tasks, pairs, worst, timing)


def _numbered(stack: Stack) -> list[tuple[Task, int]]:
    """Return the tasks with the numbers of their levels, 0 where they are disabled."""
    active = [(task, number) for number, group in enumerate(stack.active, 1) for task in group]
    return [*active, *((task, 0) for task in stack.inactive)]


def _failures(glimpses: Sequence[Glimpse], runs: Sequence[Run]) -> list[Finding]:
    """Return which tasks failed, and why."""
    faults = [each.fault for each in glimpses] + [each.fault for each in runs]
    found = Counter(fault for fault in faults if fault)
    return [Finding(WRONG, 'failed', task, f'{count} times: {reason}', 'correct its code')
            for (task, reason), count in found.most_common(NAMED)]


def _levels(setup: Setup, glimpses: Sequence[Glimpse]) -> tuple[LevelResult, ...]:
    """Return what is left to each level with a demand."""
    found = []
    for number in glimpses[0].ranks if glimpses else ():
        left, alone = np.array([each.ranks[number] for each in glimpses]).T
        found.append(LevelResult(
            number, tuple(task.name for task in setup.stack.active[number - 1]),
            int(alone.max()), int(left.min()), float(np.median(left)), int(left.max()),
            float(np.mean(left == 0))))
    return tuple(found)


def _pairs(glimpses: Sequence[Glimpse]) -> tuple[PairResult, ...]:
    """Return how the directions of tasks lie to each other."""
    found = []
    for pair in glimpses[0].pairs if glimpses else ():
        angles, shared = zip(*(each.pairs[pair] for each in glimpses))
        found.append(PairResult(*pair, float(np.median(angles)),
                                float(np.mean(np.array(shared) > 0)), max(shared)))
    return tuple(found)


def _task(setup: Setup, task: Task, number: int, glimpses: Sequence[Glimpse],
          runs: Sequence[Run]) -> TaskResult:
    """Return what was found about a task."""
    name = task.name
    singular = smallest = outside = rows = active = active_in_loops = None
    if glimpses and name in glimpses[0].smallest:
        values = np.array([each.smallest[name] for each in glimpses])
        region = _region(setup, number)
        smallest = float(np.median(values))
        singular = None if region is None else float(np.mean(values < region))
    if glimpses and name in glimpses[0].bounds:
        outside, active, rows = np.mean(
            [each.bounds[name] for each in glimpses], axis=0).tolist()
        shares = [run.active[name] for run in runs if name in run.active]
        active_in_loops = float(np.mean(shares)) if shares else None
    done = [(run.tasks[name], run.far) for run in runs if name in run.tasks]
    possible = [(each, far) for each, far in done if each.possible]
    reached = [each for each, _ in possible if each.reached]
    near = [each for each, far in possible if far <= NEAR]
    seconds = [each.seconds for each in reached]
    return TaskResult(
        name, task.type_name, number, decay_step(task, task.gain, setup.period), singular,
        smallest, outside, rows, active, active_in_loops, len(possible), len(reached), len(near),
        sum(each.reached for each in near), float(np.median(seconds)) if seconds else None,
        max(seconds, default=None), _causes([each for each, _ in possible]))


def _region(setup: Setup, number: int) -> float | None:
    """Return the singular value below which a level is damped; None where all is."""
    above = any(not task.bounded for group in setup.stack.active[:number - 1] for task in group)
    damping = setup.settings.solver_options(setup.robot.n).damping
    damping = damping if above else damping.first
    return None if damping.everywhere else damping.singular_region


def _causes(runs: Sequence[TaskRun]) -> tuple[CauseCount, ...]:
    """Return what limited a task that did not reach its goal, the most frequent cause first."""
    counts = Counter(run.causes[0] if run.causes else ('', '') for run in runs
                     if not run.reached)
    return tuple(CauseCount(kind, name, count) for (kind, name), count in counts.most_common())


def _worst(runs: Sequence[Run]) -> tuple[WorstResult, ...]:
    """Return the worst of all runs."""
    if not runs:
        return ()
    found = []
    for kind in (each.name for each in fields(Extremes)):
        worst: Worst = max((getattr(run.extremes, kind) for run in runs),
                           key=lambda each: each.value)
        value = worst.value if math.isfinite(worst.value) else None
        found.append(WorstResult(kind, value, worst.name, worst.run))
    return tuple(found)

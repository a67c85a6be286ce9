# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Check of a stack by sampled configurations and closed loops."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from itertools import chain
import math
from multiprocessing import get_context
import os
import signal
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
from tp_controller.tools.check.chosen_joints import about_joints, about_row_weights
from tp_controller.tools.check.closed_loop import (
    AT_REST,
    closed_loop,
    FAILED,
    REACHED,
    Run,
    TaskRun,
    TIME_UP,
)
from tp_controller.tools.check.configuration_sample import (
    ConfigurationSample,
    sample_configuration,
)
from tp_controller.tools.check.contradictions import Contradiction, contradictions
from tp_controller.tools.check.cycle_times import cycle_times, expected_seconds
from tp_controller.tools.check.extremes import EXTREMES
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
    about_values,
    NAMES_PER_FINDING,
)
from tp_controller.tools.check.results import (
    by_severity,
    CauseCount,
    check_kinds,
    CheckReport,
    Finding,
    LevelResult,
    PairResult,
    TaskResult,
    Timing,
    WorstResult,
    WRONG,
)
from tp_controller.tools.check.setup import in_process, Plan, Result, Seed, Setup
from tp_controller.tools.check.unwatched import about_unwatched

REPORT_VERSION = 1
# Cosine of the angle between two directions from which they count as the same [1].
SAME_DIRECTION = 1.0 - 1e-6
# Defaults: number of samples and of closed loops, longest time of a closed loop [s].
SAMPLES, RUNS, RUN_SECONDS = 300, 20, 15.0
# Near goals: share of the distance from the start to a random configuration [1]; half of them are.
NEAR_SHARE = 0.5
# Number of parts of the work of one section, and seeds in the largest part: Ctrl-C waits for it.
PARTS, MOST_SEEDS = 64, 4


class ProgressSection(Protocol):
    """Progress display of one section of the work."""

    def advance(self) -> None:
        """Advance the display by one part."""


class _NoProgress:
    """Progress display without output."""

    def advance(self) -> None:
        """Do nothing."""


# Opened with the number of parts and the name of the section.
Progress = Callable[[int, str], AbstractContextManager[ProgressSection]]


def _no_progress(total: int, what: str) -> AbstractContextManager[ProgressSection]:
    """Return a context manager without progress display."""
    return nullcontext(_NoProgress())


class Workers(Protocol):
    """Map of work over seeds, whose results come in the order of the seeds."""

    def __call__(self, work: Callable[[Setup, Seed], Result], seeds: Sequence[Seed]
                 ) -> Iterable[Result]:
        """Return the result of work for each seed; the work is a function of a module."""


def check(robot: Robot, stack: Stack, settings: Settings | None = None, *,
          period: float | None = None, samples: int = SAMPLES, runs: int = RUNS,
          seconds: float = RUN_SECONDS, seed: int = 0, jobs: int = 1,
          executor: Executor | None = None, around: ArrayLike | None = None,
          progress: Progress = _no_progress,
          expecting: Callable[[float], None] | None = None) -> CheckReport:
    """
    Check a stack for faults and doubtful properties, before a robot moves.

    The capabilities of the levels are evaluated at random configurations within the limits.
    Closed loops with a `KinematicSimulator` then run from random starts to random reachable goals:
    the values of the tasks at another configuration. Both satisfy bounds and goals of the stack.

    The same seed gives the same report for any `jobs` and `executor`, except for `timing` and
    the findings about it.

    Parameters
    ----------
    robot : Robot
        Robot model; not modified.
    stack : Stack
        Stack that no controller has used. Its tasks are copied and not modified; goals that they
        have count as goals of the stack.
    settings : Settings, optional
        Settings of the controller.
    period : float, optional
        Time between two cycles [s]; that of the settings, the longest one, by default.
    samples, runs : int
        Number of configurations and of closed loops.
    seconds : float
        Longest time of a closed loop [s].
    seed : int
        Seed of the random configurations, from 0.
    jobs : int
        Number of processes; -1: one per processor. More than one requires a stack that was read
        from YAML, and a script that calls this under ``if __name__ == '__main__':``.
    executor : concurrent.futures.Executor, optional
        Executor of the work in place of `jobs`, such as that of a cluster.
    around : array_like (nq,), optional
        Configuration near which a moving base starts; that of `start_configuration` by default.
    progress : callable, optional
        Called with a number of parts and a text for each section of the work; returns a context
        manager whose value has a method ``advance()``.
    expecting : callable, optional
        Called before the work, with the time that it takes on this machine, to about a factor of
        two, if nothing else runs [s].

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
        `around` is not a valid configuration.
    concurrent.futures.BrokenExecutor
        A process ended while it worked.

    """
    settings = settings or Settings()
    # Goals of the closed loops are not those of people.
    settings = replace(settings, workspace=Settings().workspace, largest_jump=math.inf,
                       largest_turn=math.inf)
    setup = Setup(robot, stack, settings, _checked_period(period, settings), seconds,
                  robot.state(start_configuration(robot) if around is None else around).q)
    _check_counts(samples, runs, seconds, seed)
    check_kinds(kind for task in stack.tasks.values() for kind in task.accept)
    seeds = np.random.SeedSequence(seed).spawn(5)
    faults = _refusals(setup)
    if expecting and not faults:
        processes = jobs if jobs > 0 else os.cpu_count() or 1
        expecting(expected_seconds(setup, samples, runs) / processes)
    contradicting = [] if faults or not runs else contradictions(setup, seeds[3])
    if contradicting:
        # No configuration satisfies the stack: more tries would only take time.
        setup = replace(setup, tries=1)
    with _workers(setup, jobs, executor) as spread:
        with progress(samples, 'samples') as shown:
            configurations = list(_advancing(
                shown, spread(sample_configuration, seeds[0].spawn(samples))))
        found: list[Run] = []
        if not faults:
            with progress(runs, 'closed loops') as shown:
                found = list(_advancing(
                    shown, spread(closed_loop, list(enumerate(seeds[1].spawn(runs))))))
    timing = None
    if not faults and runs:
        try:
            timing = cycle_times(setup, seeds[2])
        except TpControllerError:
            # A task fails; the runs report it.
            pass
    return _report(setup, seed, configurations, found, faults, timing, contradicting,
                   [] if faults else list(about_unwatched(setup, seeds[4])))


@contextmanager
def _workers(setup: Setup, jobs: int, executor: Executor | None) -> Iterator[Workers]:
    """Open the workers: this process, new ones, or an executor."""
    if jobs == 0 or jobs < -1:
        raise SettingsError([f'jobs must be a number from 1 on, or -1 for all processors, '
                             f'not {jobs}'])
    if executor is None and jobs == 1:
        yield lambda work, seeds: map(partial(work, setup), seeds)
        return
    plan = Plan.of(setup)
    # Ctrl-C reaches all processes; this one lets the others finish their piece of work.
    with nullcontext(executor) if executor else ProcessPoolExecutor(
            jobs if jobs > 0 else os.cpu_count(), get_context('spawn'),
            signal.signal, (signal.SIGINT, signal.SIG_IGN)) as opened:
        yield lambda work, seeds: opened.map(
            partial(in_process, work, plan), seeds,
            chunksize=min(MOST_SEEDS, 1 + len(seeds) // PARTS))


def _advancing(shown: ProgressSection, results: Iterable[Result]) -> Iterator[Result]:
    """Yield results, and advance the display after each."""
    for result in results:
        shown.advance()
        yield result


def refused(messages: Iterable[tuple[str, str]], rate: float = 0.0, seed: int = 0,
            robot: str = '') -> CheckReport:
    """
    Return the report of a stack that could not be read.

    Parameters
    ----------
    messages : iterable of (str, str)
        Location and text of each fault.
    rate, seed, robot
        Fields of the report.

    """
    findings = tuple(Finding(WRONG, 'fault', where, message, 'correct it: a controller refuses '
                             'it, too') for where, message in messages)
    return CheckReport(REPORT_VERSION, robot, rate, seed, 0, 0, {}, findings, (), (), (), (), None)


def _checked_period(period: float | None, settings: Settings) -> float:
    """Return the validated time between two cycles [s], or raise `SettingsError`."""
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
    """Return a finding for each fault that a controller would refuse."""
    try:
        Controller(setup.robot, setup.stack.copy(), setup.settings)
    except SettingsError as error:
        return [Finding(WRONG, 'fault', '', fault, 'correct it: a controller refuses it, too')
                for fault in error.faults]
    return []


def _report(setup: Setup, seed: int, configurations: Sequence[ConfigurationSample],
            runs: Sequence[Run], faults: Sequence[Finding], timing: Timing | None,
            contradicting: Sequence[Contradiction], unwatched: Sequence[Finding]
            ) -> CheckReport:
    """Return the report of the results."""
    seen = [each for each in configurations if not each.fault]
    levels, pairs = _levels(setup, seen), _pairs(seen)
    tasks = tuple(_task(setup, task, number, seen, runs)
                  for task, number in _numbered(setup.stack))
    worst = _worst(runs)
    numbers = {task.name: task.level for task in tasks}
    filling = seen[0].filling if seen else frozenset()
    joints = list(about_joints(setup, seen, filling))
    findings = [*faults, *unwatched, *_failures(configurations, runs), *joints, *chain(
        about_robot(setup), about_values(setup), about_row_weights(setup),
        about_levels(setup, levels, filling), about_pairs(pairs, numbers), about_gains(setup),
        about_singularities(setup, tasks, {each.where for each in joints}),
        about_bounds(setup, tasks, len(runs), contradicting),
        about_goals(setup, tasks, len(runs), filling), about_limits(worst, setup),
        about_time(timing, setup) if timing else ())]
    ended = Counter(run.ended for run in runs)
    return CheckReport(
        REPORT_VERSION, setup.robot.name, 1.0 / setup.period, seed, len(configurations), len(runs),
        {how: ended[how] for how in (REACHED, AT_REST, TIME_UP, FAILED)} if runs else {},
        by_severity(findings), levels, tasks, pairs, worst, timing).accepting(
            tasks={task.name: task.accept for task in setup.stack.tasks.values()})


def _numbered(stack: Stack) -> list[tuple[Task, int]]:
    """Return the tasks with the numbers of their levels, 0 where they are disabled."""
    active = [(task, number) for number, group in enumerate(stack.active, 1) for task in group]
    return [*active, *((task, 0) for task in stack.inactive)]


def _failures(configurations: Sequence[ConfigurationSample], runs: Sequence[Run]) -> list[Finding]:
    """Return the findings about tasks that failed."""
    faults = [each.fault for each in configurations] + [each.fault for each in runs]
    found = Counter(fault for fault in faults if fault)
    return [Finding(WRONG, 'failed', task, f'{count} times: {reason}', 'correct its code')
            for (task, reason), count in found.most_common(NAMES_PER_FINDING)]


def _levels(setup: Setup, configurations: Sequence[ConfigurationSample]
            ) -> tuple[LevelResult, ...]:
    """Return the rank left to each level, over the samples in which it has one alone."""
    found = []
    for number in configurations[0].ranks if configurations else ():
        ranks = np.array([each.ranks[number] for each in configurations])
        acting = ranks[ranks[:, 1] > 0]
        # A level that the robot cannot move has no rank in any sample.
        left, alone, of_all = (acting if len(acting) else ranks).T
        found.append(LevelResult(
            number, tuple(task.name for task in setup.stack.active[number - 1]),
            int(alone.max()), int(left.min()), float(np.median(left)), int(left.max()),
            int(of_all.max()), float(np.mean(left == 0))))
    return tuple(found)


def _pairs(configurations: Sequence[ConfigurationSample]) -> tuple[PairResult, ...]:
    """Return the angles between pairs of tasks and the directions that they share."""
    found = []
    for pair in configurations[0].pairs if configurations else ():
        angles, shared = zip(*(each.pairs[pair] for each in configurations))
        found.append(PairResult(*pair, float(np.median(angles)),
                                float(np.mean(np.array(shared) > 0)), max(shared)))
    return tuple(found)


def _task(setup: Setup, task: Task, number: int, configurations: Sequence[ConfigurationSample],
          runs: Sequence[Run]) -> TaskResult:
    """Return the result of a task."""
    name = task.name
    fixed = False
    singular = smallest = outside = rows = active = within_reach = active_in_loops = None
    if configurations and name in configurations[0].smallest:
        values = np.array([each.smallest[name][0] for each in configurations])
        directions = np.array([each.smallest[name][1] for each in configurations])
        fixed = bool((np.abs(directions @ directions[0]) > SAME_DIRECTION).all())
        region = _region(setup, number)
        smallest = float(np.median(values))
        singular = None if region is None else float(np.mean(values < region))
    if configurations and name in configurations[0].bounds:
        outside, active, rows, within_reach = np.mean(
            [each.bounds[name] for each in configurations], axis=0).tolist()
        shares = [run.active[name] for run in runs if name in run.active]
        active_in_loops = float(np.mean(shares)) if shares else None
    done = [(run.tasks[name], run.far) for run in runs if name in run.tasks]
    possible = [(each, far) for each, far in done if each.possible]
    missed = [each for each, _ in possible or done if not each.reached]
    reached = [each for each, _ in possible if each.reached]
    near = [each for each, far in possible if far <= NEAR_SHARE]
    seconds = [each.seconds for each in reached]
    return TaskResult(
        name, task.type_name, number, decay_step(task, task.gain, setup.period), singular,
        fixed, smallest, outside, rows, active, within_reach, active_in_loops, len(possible),
        len(reached), len(near), sum(each.reached for each in near),
        float(np.median(seconds)) if seconds else None, max(seconds, default=None),
        _causes(missed), _hint(missed))


def _region(setup: Setup, number: int) -> float | None:
    """Return the singular value below which a level is damped; None if all directions are."""
    above = any(not task.bounded for group in setup.stack.active[:number - 1] for task in group)
    damping = setup.settings.solver(setup.robot.n).damping
    damping = damping if above else damping.first
    return None if damping.everywhere else damping.singular_region


def _causes(missed: Sequence[TaskRun]) -> tuple[CauseCount, ...]:
    """Return the counts of the largest causes in runs, the most frequent first."""
    return tuple(CauseCount(*cause, count)
                 for cause, count in Counter(run.cause for run in missed).most_common())


def _hint(missed: Sequence[TaskRun]) -> str:
    """Return the most frequent hint of runs; empty if there is none."""
    return next((hint for hint, _ in Counter(
        run.hint for run in missed if run.hint).most_common(1)), '')


def _worst(runs: Sequence[Run]) -> tuple[WorstResult, ...]:
    """Return the extremes over all runs."""
    if not runs:
        return ()
    found = []
    for kind in EXTREMES:
        worst = max((run.extremes[kind] for run in runs), key=lambda each: each.value)
        value = worst.value if math.isfinite(worst.value) else None
        found.append(WorstResult(kind, value, worst.name, worst.run))
    return tuple(found)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Closed loop without ROS, from a random start to random reachable goals."""

from collections import Counter
from dataclasses import dataclass, field, replace
from functools import partial
import math

import numpy as np
from tp_controller.control.controller import Command, Controller
from tp_controller.control.reasons import OUT_OF_REACH, phrase
from tp_controller.control.task_report import TaskReport
from tp_controller.errors import GoalError, in_words, TpControllerError
from tp_controller.model.simulator import KinematicSimulator
from tp_controller.model.spatial import Array
from tp_controller.tasks.stack import Stack
from tp_controller.tools.check.extremes import Extremes, Worst
from tp_controller.tools.check.results import COMBINED, STILL_MOVING, UNREACHABLE
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup
from tp_controller.tools.check.valid_configurations import goal_configuration, ValidConfigurations

# Interval between reports [s]: a report takes as long as the cycle itself.
REPORT_INTERVAL = 0.05
# Speed [rad/s or m/s] below which, for this time [s], a robot counts as at rest.
ROBOT_REST_SPEED, REST_SECONDS = 3e-4, 1.0
# Time for which all tasks have to be at their goals before a run ends [s].
REACHED_SECONDS = 0.2
# Outcomes of a run.
REACHED, AT_REST, TIME_UP, FAILED = 'reached', 'at rest', 'time is up', 'failed'


@dataclass(frozen=True)
class TaskRun:
    """
    Outcome of a task in a run.

    Attributes
    ----------
    possible : bool
        The task was at its goal, or within its bounds, at the configuration of the goals; always
        true for tasks whose goals come from this configuration.
    reached : bool
        The task was at its goal, or within its bounds, in the end.
    seconds : float
        Time from which on it stayed there; NaN if it did not [s].
    cause : tuple of str
        Kind, name and text of the largest cause that limited it in the end, as in `CauseCount`.
    hint : str
        Suggested change; empty if there is none.

    """

    possible: bool
    reached: bool
    seconds: float
    cause: tuple[str, str, str] = ('', '', '')
    hint: str = ''


@dataclass(frozen=True)
class Run:
    """
    Result of a closed loop.

    Attributes
    ----------
    ended : str
        ``reached``, ``at rest``, ``time is up`` or ``failed``.
    seconds : float
        Duration [s].
    cycles : int
        Number of cycles.
    far : float
        Distance of the goals as a share of that to a random configuration, in [0, 1].
    tasks : dict
        {task: TaskRun} of the enabled tasks.
    active : dict
        {inequality task: share of the time with active bounds}.
    extremes : dict
    fault : tuple of str
        Task and reason if a task failed; else empty.

    """

    ended: str
    seconds: float
    cycles: int
    far: float
    tasks: dict[str, TaskRun]
    active: dict[str, float]
    extremes: dict[str, Worst]
    fault: tuple[str, ...] = ()


@dataclass
class Loop:
    """
    Closed loop of a controller and a simulated robot.

    Attributes
    ----------
    since : dict
        {task: time since which it is at its goal [s]}.
    active : Counter
        Number of reports in which bounds were active.
    reads : int
        Number of reports read.
    extremes : Extremes or None
        Extremes of the commands, if recorded.

    """

    setup: Setup
    controller: Controller
    simulator: KinematicSimulator
    extremes: Extremes | None = None
    since: dict[str, float] = field(default_factory=dict)
    reports: tuple[TaskReport, ...] = ()
    active: Counter[str] = field(default_factory=Counter)
    reads: int = 0
    cycles: int = 0

    @classmethod
    def at(cls, setup: Setup, q: Array, stack: Stack) -> 'Loop':
        """Return a loop at a configuration."""
        return cls(setup, Controller(setup.robot, stack, setup.settings),
                   KinematicSimulator(setup.robot, q, timeout=max(0.1, 2.0 * setup.period)))

    @property
    def now(self) -> float:
        """Return the time [s]."""
        return self.cycles * self.setup.period

    def step(self) -> Command:
        """Run one cycle."""
        command = self.controller.update(self.simulator.q, self.now, elapsed=self.setup.period)
        if self.extremes is not None:
            self.extremes.add(self.simulator.q, command.velocity)
        self.follow(command)
        return command

    def follow(self, command: Command) -> None:
        """Move the robot with a command for one period."""
        self.simulator.command(command.velocity)
        self.simulator.step(self.setup.period)
        self.cycles += 1

    def run(self, seconds: float, tolerant: bool = True) -> str:
        """
        Run until all tasks stay satisfied, the robot is at rest, or the time is up.

        Parameters
        ----------
        seconds : float
            Longest time [s].
        tolerant : bool
            Whether errors within tolerances count as satisfied; else only rest ends the run.

        Returns
        -------
        str
            ``reached``, ``at rest`` or ``time is up``.

        """
        each = max(1, round(REPORT_INTERVAL / self.setup.period))
        until = self.now + seconds
        still = math.inf
        while self.now < until:
            command = self.step()
            if np.abs(command.velocity).max() > ROBOT_REST_SPEED:
                still = math.inf
            else:
                still = min(still, self.now)
            if self.cycles % each:
                continue
            self._read(command)
            if tolerant and all(since + REACHED_SECONDS <= self.now
                                for since in self.since.values()):
                return REACHED
            if still + REST_SECONDS <= self.now:
                return AT_REST
        self._read(command)
        return TIME_UP

    def _read(self, command: Command) -> None:
        """Record the tasks at their goals and the active bounds."""
        self.reports = tuple(task for task in command.report.tasks if task.level is not None)
        for task in self.reports:
            before = self.since.get(task.name, math.inf)
            self.since[task.name] = min(before, self.now) if task.reached else math.inf
        self.active.update(command.report.active_bounds)
        self.reads += 1


def closed_loop(setup: Setup, numbered: tuple[int, np.random.SeedSequence]) -> Run:
    """
    Run a closed loop and return its result.

    The loop starts at a random configuration, and its goals are the values of the tasks at another
    one; both satisfy bounds and goals of the stack, if that is possible.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    numbered : (int, numpy.random.SeedSequence)
        Number of the run, and seed of its configurations.

    Returns
    -------
    Run

    """
    number, seed = numbered
    random = np.random.default_rng(seed)
    try:
        valid = ValidConfigurations(setup)
        start, _ = valid.near(partial(random_configuration, setup.robot, random, setup.around))
        far = random.uniform()
        goals, possible = valid.near(partial(goal_configuration, setup, random, start, far))
        return _run(setup, number, start, goals, far, possible)
    except TpControllerError as error:
        fault = (getattr(error, 'task', ''), getattr(error, 'reason', in_words(error)))
        return Run(FAILED, 0.0, 0, 0.0, {}, {},
                   Extremes(setup.robot, setup.period, number).worst(), fault)


def _run(setup: Setup, number: int, start: Array, goals: Array, far: float,
         possible: dict[str, bool]) -> Run:
    """Return the result of a closed loop from a configuration to the goals of another one."""
    extremes = Extremes(setup.robot, setup.period, number)
    loop = start_loop(setup, start, goals, extremes)
    ended = loop.run(setup.seconds)
    tasks = {task.name: _task_run(task, loop.since[task.name], possible.get(task.name, True))
             for task in loop.reports}
    moving = {name for name, its in tasks.items() if its.cause[0] == STILL_MOVING}
    # What is blocked by a task that is still on its way might yet get to its goal.
    tasks = {name: replace(its, possible=False) if its.cause[:1] == ('task',)
             and its.cause[1] in moving else its for name, its in tasks.items()}
    active = {name: loop.active[name] / loop.reads
              for name, task in loop.controller.stack.tasks.items() if task.bounded}
    fault = next(iter(loop.controller.stack.faults.items()), ())
    return Run(ended, loop.now, loop.cycles, far, tasks, active, extremes.worst(), fault)


def start_loop(setup: Setup, start: Array, goals: Array, extremes: Extremes | None = None
               ) -> Loop:
    """
    Return a loop that starts at a configuration and has the goals of another one.

    Tasks with a goal of the stack keep it.
    """
    loop = Loop.at(setup, start, setup.stack.copy())
    loop.extremes = extremes
    # In the first cycle, the tasks take their present values as default goals, as in a node.
    loop.step()
    there = setup.stack.copy()
    there.start(setup.robot.state(goals))
    for name, task in there.tasks.items():
        if task.has_default_goal and name not in there.disabled:
            try:
                loop.controller.set_goal(name, task.goal, loop.now)
            except GoalError:
                # The task accepts no goal from outside, or not this one: it stays where it is.
                pass
    return loop


def _task_run(task: TaskReport, since: float, possible: bool) -> TaskRun:
    """Return the outcome of a task."""
    if task.reached:
        return TaskRun(True, True, since)
    return TaskRun(possible, False, math.nan, _cause(task), task.hint)


def _cause(task: TaskReport) -> tuple[str, str, str]:
    """Return `TaskRun.cause` of a task that is not at its goal."""
    text = task.main_cause
    if not text:
        return STILL_MOVING, '', 'still on its way'
    if text == OUT_OF_REACH:
        return UNREACHABLE, '', text
    for cause in task.causes:
        if phrase(cause.kind, cause.name) == text:
            return cause.kind, cause.name, text
    return COMBINED if len(task.phrases) > 1 else '', '', text

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

"""A closed loop without ROS, from a random start to random goals that can be reached."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
import math

import numpy as np
from tp_controller.control.controller import Command, Controller
from tp_controller.control.report import TaskReport
from tp_controller.errors import GoalError, in_words, TpControllerError
from tp_controller.model.simulator import KinematicSimulator
from tp_controller.model.spatial import Array
from tp_controller.tasks.stack import Stack
from tp_controller.tools.check.results import STILL_MOVING
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Configurations that are tried for a start, or for goals, until one satisfies the stack.
TRIES = 3
# How often reports are read [s]: they take as long as the cycle itself.
READ = 0.05
# A robot slower than this [rad/s or m/s] for so long [s] is at rest.
SLOW, REST = 3e-4, 1.0
# Longest time on the way from there to one that does [s].
SETTLE = 10.0
# For how long all tasks have to be at their goals until a run ends [s].
STAY = 0.2
# What a run ends by.
REACHED, AT_REST, TIME, FAILED = 'reached', 'at rest', 'time is up', 'failed'


@dataclass(frozen=True)
class Worst:
    """
    The largest of some numbers, and where it was.

    Attributes
    ----------
    value : float
    name : str
        The joint, or the velocity of the base; empty while there is none.
    run : int
        Number of the run, from 0.

    """

    value: float = -math.inf
    name: str = ''
    run: int = -1


@dataclass
class Extremes:
    """
    The worst that the commands of a run did.

    Attributes
    ----------
    velocity, acceleration : Worst
        As a share of the limit; acceleration over the time between two commands. −∞ without a
        limit.
    position : Worst
        How far a command would have led a joint past its limit, or farther, where it was outside
        already; negative: how far it stayed away [rad or m].
    jump : Worst
        Change of the command between two cycles, as a share of the velocity limit; without such
        a limit [rad/s or m/s].

    """

    velocity: Worst = Worst()
    position: Worst = Worst()
    acceleration: Worst = Worst()
    jump: Worst = Worst()


@dataclass(frozen=True)
class TaskRun:
    """
    What became of a task in a run.

    Attributes
    ----------
    possible : bool
        It was at its goal, or within its bounds, where the goals were taken from; of tasks whose
        goals were taken there always.
    reached : bool
        It was in the end.
    seconds : float
        From when on it stayed there; NaN where it did not [s].
    causes : tuple of (str, str)
        Kind and name of what limited it in the end; see `tp_controller.control.causes.Cause`.
    reason : str
        The same as a sentence.

    """

    possible: bool
    reached: bool
    seconds: float
    causes: tuple[tuple[str, str], ...] = ()
    reason: str = ''


@dataclass(frozen=True)
class Run:
    """
    A closed loop.

    Attributes
    ----------
    ended : str
        ``reached``, ``at rest``, ``time is up`` or ``failed``.
    seconds : float
        How long it was [s].
    cycles : int
        How many that is.
    far : float
        How much of the way from the start to any configuration the goals are, in [0, 1].
    tasks : dict
        {task: TaskRun} of those that are enabled.
    active : dict
        {inequality task: share of the time that its bounds were active}.
    extremes : Extremes
    fault : tuple of str
        Task and reason, where one failed; else empty.

    """

    ended: str
    seconds: float
    cycles: int
    far: float
    tasks: dict[str, TaskRun]
    active: dict[str, float]
    extremes: Extremes
    fault: tuple[str, ...] = ()


@dataclass
class Loop:
    """
    A controller and the simulated robot that follows it.

    Attributes
    ----------
    commanded : ndarray (n,)
        Velocities of the last cycle.
    since : dict
        {task: since when it is at its goal [s]}.
    active : Counter
        How often bounds were active.
    reads : int
        How often that was looked at.
    extremes : Extremes or None
        What is watched, if it is.

    """

    setup: Setup
    controller: Controller
    simulator: KinematicSimulator
    commanded: Array
    number: int = -1
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
                   KinematicSimulator(setup.robot, q, timeout=max(0.1, 2.0 * setup.period)),
                   np.zeros(setup.robot.n))

    @property
    def now(self) -> float:
        """Return the time [s]."""
        return self.cycles * self.setup.period

    def step(self) -> Command:
        """Run one cycle."""
        command = self.controller.update(self.simulator.q, self.now)
        if self.extremes is not None:
            watch(self.extremes, self.setup, self.simulator.q, command.velocity, self.commanded,
                  self.number)
        self.follow(command)
        return command

    def follow(self, command: Command) -> None:
        """Let the robot follow a command for one period."""
        self.commanded = command.velocity
        self.simulator.command(command.velocity)
        self.simulator.step(self.setup.period)
        self.cycles += 1

    def run(self, seconds: float, names: Collection[str] = (), tolerant: bool = True) -> str:
        """
        Run until some tasks have been satisfied for a while, or the robot is at rest.

        Parameters
        ----------
        seconds : float
            At most so long [s].
        names : collection of str
            Of the tasks; all, if it is empty.
        tolerant : bool
            Whether errors within tolerances count as satisfied; else only rest ends it.

        Returns
        -------
        str
            How it ended.

        """
        each = max(1, round(READ / self.setup.period))
        until = self.now + seconds
        still = math.inf
        while self.now < until:
            command = self.step()
            if np.abs(command.velocity).max() > SLOW:
                still = math.inf
            else:
                still = min(still, self.now)
            if self.cycles % each:
                continue
            self._read(command)
            if tolerant and all(since + STAY <= self.now
                                for name, since in self.since.items()
                                if not names or name in names):
                return REACHED
            if still + REST <= self.now:
                return AT_REST
        self._read(command)
        return TIME

    def _read(self, command: Command) -> None:
        """Note which tasks are at their goals."""
        self.reports = tuple(task for task in command.report.tasks if task.level is not None)
        for task in self.reports:
            before = self.since.get(task.name, math.inf)
            self.since[task.name] = min(before, self.now) if task.reached else math.inf
        self.active.update(command.report.active_bounds)
        self.reads += 1


def closed_loop(setup: Setup, numbered: tuple[int, np.random.SeedSequence]) -> Run:
    """
    Return what came of a closed loop.

    It starts at a random configuration, and its goals are the values of the tasks at another one;
    both satisfy bounds and goals of the stack, if that is possible.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    numbered : (int, numpy.random.SeedSequence)
        Number of the run, and what its configurations follow from.

    Returns
    -------
    Run

    """
    number, seed = numbered
    random = np.random.default_rng(seed)
    try:
        start, _ = _valid(setup, random, setup.around, 1.0)
        far = random.uniform()
        goals, possible = _valid(setup, random, start, far)
        return _run(setup, number, start, goals, far, possible)
    except TpControllerError as error:
        fault = (getattr(error, 'task', ''), getattr(error, 'reason', in_words(error)))
        return Run(FAILED, 0.0, 0, 0.0, {}, {}, Extremes(), fault)


def _valid(setup: Setup, random: np.random.Generator, around: Array,
           far: float) -> tuple[Array, dict[str, bool]]:
    """
    Return a configuration that tasks with bounds, or with a goal of the stack, allow.

    It is where the closed loop leads to from a random configuration, with the values of the other
    tasks there as default goals. Which of those tasks are satisfied comes with it.
    """
    found: list[tuple[Array, dict[str, bool]]] = []
    while not found or len(found) < TRIES and not all(found[-1][1].values()):
        stack = setup.stack.copy()
        given = [task for task in stack.active_tasks if task.bounded or task.goal is not None]
        loop = Loop.at(setup, random_configuration(setup.robot, random, around, far), stack)
        if given:
            # Goals of others fit to a goal of the stack only as well as that is reached.
            loop.run(min(SETTLE, setup.seconds), {task.name for task in given},
                     all(task.bounded for task in given))
        found.append((loop.simulator.q.copy(), {
            task.name: loop.since[task.name] < math.inf for task in given
            if task.name in loop.since}))
    return max(found, key=lambda each: _rank(setup, each[1]))


def _rank(setup: Setup, reached: dict[str, bool]) -> tuple[int, int]:
    """Return how good a configuration is: bounds before goals."""
    bounded = [ok for name, ok in reached.items() if setup.stack.tasks[name].bounded]
    return sum(bounded), sum(reached.values())


def _run(setup: Setup, number: int, start: Array, goals: Array, far: float,
         possible: dict[str, bool]) -> Run:
    """Return what came of the closed loop from a configuration to the goals of another one."""
    loop = start_loop(setup, start, goals)
    loop.number, loop.extremes = number, Extremes()
    ended = loop.run(setup.seconds)
    tasks = {task.name: _task_run(task, loop.since[task.name], possible.get(task.name, True))
             for task in loop.reports}
    active = {name: loop.active[name] / loop.reads
              for name, task in loop.controller.stack.tasks.items() if task.bounded}
    fault = next(iter(loop.controller.stack.faults.items()), ())
    return Run(ended, loop.now, loop.cycles, far, tasks, active, loop.extremes, fault)


def start_loop(setup: Setup, start: Array, goals: Array) -> Loop:
    """
    Return a loop on its way from a configuration to the goals of another one.

    Tasks with a goal of the stack keep it.
    """
    loop = Loop.at(setup, start, setup.stack.copy())
    # One cycle in which the tasks take what they have as default goals, as in a node.
    loop.step()
    there = setup.stack.copy()
    there.start(setup.robot.state(goals))
    for name, task in there.tasks.items():
        if task.has_default_goal and name not in there.disabled:
            try:
                loop.controller.set_goal(name, task.goal, loop.now)
            except GoalError:
                # It takes none from outside, or not this one: it stays where it is.
                pass
    return loop


def _task_run(task: TaskReport, since: float, possible: bool) -> TaskRun:
    """Return what became of a task."""
    if task.reached:
        return TaskRun(possible, True, since)
    causes = tuple((cause.kind, cause.name) for cause in task.causes)
    if not task.reason:
        causes = ((STILL_MOVING, ''),)
    return TaskRun(possible, False, math.nan, causes, task.reason)


def watch(extremes: Extremes, setup: Setup, q: Array, velocity: Array, previous: Array,
          number: int) -> None:
    """Note what a command does, the one before being `previous`."""
    robot, period = setup.robot, setup.period
    change = np.abs(velocity - previous)
    limit = np.where(np.isfinite(robot.velocity), robot.velocity, 1.0)
    here = robot.positions(q)
    moved = robot.positions(robot.integrate(q, velocity, period))
    # Who starts outside must not get farther out.
    allowed = np.maximum(np.maximum(robot.lower - here, here - robot.upper), 0.0)
    for name, values in (
            ('velocity', _share(np.abs(velocity), robot.velocity)),
            ('position', np.maximum(robot.lower - moved, moved - robot.upper) - allowed),
            ('acceleration', _share(change, robot.acceleration * period)),
            ('jump', _share(change, limit))):
        worst = int(np.argmax(values))
        if values[worst] > getattr(extremes, name).value:
            setattr(extremes, name, Worst(float(values[worst]), robot.velocity_names[worst],
                                          number))


def _share(values: Array, limits: Array) -> Array:
    """Return values as shares of their limits (n,); 0 of 0 is 0, −∞ where there is no limit."""
    shares = np.divide(values, limits, out=np.where(values > 0.0, np.inf, 0.0),
                       where=limits > 0.0)
    return np.where(np.isfinite(limits), shares, -np.inf)

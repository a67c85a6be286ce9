# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Roll-outs: the cycles of the next seconds on an ideal robot, as they are or with a change.

A single cycle cannot tell whether a task that is limited arrives by itself, nor whether a change
would help it later. Goals stay where they are, and changes act at once.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
import math
from typing import NamedTuple

from scipy.linalg.blas import dnrm2
from tp_controller.control.compiled_step import compiled_step
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.cycle_record import CycleRecord
from tp_controller.control.escape import STUCK_SECONDS
from tp_controller.control.measures import MeasuredCycle, Measures
from tp_controller.control.solved_cycle import Solved, SolvedCycle
from tp_controller.control.step import Commanded, CycleMemory, Problem, step
from tp_controller.control.transition import Transition
from tp_controller.control.trial_setup import Setup
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import is_foreign

# Time that is rolled out [s], and its largest number of cycles.
HORIZON, MOST_CYCLES = 10.0, 1000
# Time at rest after which a roll-out ends [s].
REST_SECONDS = 2.0 * STUCK_SECONDS
# The errors of the tasks are looked at again after this share of the time.
LOOK_SHARE = 0.08
# Speed below which the robot is at rest [rad/s or m/s].
LEAST_SPEED = 1e-4
# Longest time at which an error that still decreases is believed to vanish [s].
LONGEST_WAIT = 3.0 * HORIZON


class Course(NamedTuple):
    """
    Outcome of a roll-out.

    Attributes
    ----------
    arrivals : dict
        {task: time at which it arrives [s]}, for those that do; beyond the roll-out where the
        error still decreases at its end.
    q : ndarray (nq,)
        Last configuration [rad or m].
    seen : list of (float, dict)
        Times [s], and {task: error} then, in units of its tolerance.

    """

    arrivals: dict[str, float]
    q: Array
    seen: list[tuple[float, dict[str, float]]]

    @property
    def errors(self) -> dict[str, float]:
        """Return {task: error at the end}."""
        return self.seen[-1][1]

    def arrives(self, names: Iterable[str]) -> bool:
        """Return whether tasks arrive in the course of the roll-out."""
        return all(self.arrivals.get(name, math.inf) <= HORIZON for name in names)

    def time_to(self, name: str, share: float) -> float:
        """
        Return the time from which at most a share of the error is left [s]; else infinity.

        It has to stay so for the last fifth of the time.
        """
        most, found = share * self.seen[0][1][name], math.inf
        for time, errors in reversed(self.seen):
            if errors[name] > most:
                break
            found = time
        return found if found <= 0.8 * self.seen[-1][0] else math.inf

    def gains(self, name: str, other: 'Course', share: float) -> bool:
        """Return whether a task misses less than in another course, by a share, or is earlier."""
        time, usual = (each.arrivals.get(name, math.inf) for each in (self, other))
        if min(time, usual) <= HORIZON:
            return time <= (1.0 - share) * usual
        return self.errors.get(name, 0.0) <= (1.0 - share) * other.errors.get(name, 0.0)


class RollOuts:
    """
    Roll-outs from a cycle.

    Parameters
    ----------
    robot : Robot
    solved : SolvedCycle

    Attributes
    ----------
    setup : Setup
        Tasks and options of the cycle.

    """

    def __init__(self, robot: Robot, solved: SolvedCycle) -> None:
        self._solved, options = solved, solved.options
        self.setup = Setup(solved.tasks, options.settings, robot, options.velocity,
                           robot.integrate(solved.place.q, solved.velocity, options.period))

    @property
    def passive(self) -> Array | None:
        """Return the positions of the passive joints; see `Robot.state`."""
        return self._solved.place.passive

    @cached_property
    def unchanged(self) -> Course | None:
        """Return the course of the robot without a change; see `course`."""
        # A task of another package may take long, or not be made for a second thread.
        return None if any(map(is_foreign, self.setup.tasks.values())) \
            else self.course(self.setup)

    def course(self, setup: Setup) -> Course | None:
        """Return the course of the robot with another setup; None if a task or solver fails."""
        try:
            return self._course(setup)
        except Exception:
            # A cycle reports the faults of tasks; a hint is not worth one.
            return None

    def _course(self, setup: Setup) -> Course:
        """Return the course of the robot with another setup."""
        solved = self._solved
        run = _Run(setup, setup.period, solved)
        last: SolvedCycle | Commanded = Commanded(self._memory(setup, run.options))
        q, looks, time, still = setup.q, _Looks(), solved.options.period, 0.0
        most, now = min(HORIZON, MOST_CYCLES * run.period), solved.place.now
        while time < most and still < REST_SECONDS and not looks.reached:
            last = run.cycle(last, q, now + time)
            looks.look(last, time)
            still = still + run.period if dnrm2(last.velocity) < LEAST_SPEED else 0.0
            q = setup.robot.integrate(q, last.velocity, run.period)
            time += run.period
        return Course(looks.arrivals(still >= REST_SECONDS), q, looks.seen)

    def _memory(self, setup: Setup, options: CycleOptions) -> CycleMemory:
        """Return the memory of the cycle, for other levels and options, at rest elsewhere."""
        memory = self._solved.memory
        if setup.q is not self.setup.q:
            memory = CycleMemory.at_rest(options.n)
        return memory._replace(transition=Transition(), pending=()).fit(options).for_groups(
            self.setup.groups, setup.groups)


class _Looks:
    """Errors of the tasks in the course of a roll-out."""

    def __init__(self) -> None:
        self.reached = False
        self.seen: list[tuple[float, dict[str, float]]] = []
        self._since: dict[str, float] = {}

    def look(self, solved: SolvedCycle, time: float) -> None:
        """Note the errors in a cycle at a time [s], unless the last ones are recent."""
        if self.seen and time < (1.0 + LOOK_SHARE) * self.seen[-1][0]:
            return
        before, earlier = self.seen[-1] if self.seen else (time, {})
        measured = MeasuredCycle(solved).by_name()
        errors = {name: _size(each) for name, each in measured.items()}
        self._since = {name: self._since.get(name) or _time_of_arrival(
            before, earlier.get(name, 1.0), time, errors[name])
            for name, each in measured.items() if each.reached}
        self.seen.append((time, errors))
        self.reached = len(self._since) == len(measured)

    def arrivals(self, at_rest: bool) -> dict[str, float]:
        """Return {task: time at which it arrives [s]}; see `Course`."""
        found, (now, errors) = dict(self._since), self.seen[-1]
        before, earlier = next(seen for seen in self.seen if seen[0] >= 0.8 * now)
        late = [seen[1] for seen in self.seen if seen[0] >= 0.5 * now]
        for name, error in errors.items():
            time = _time_of_arrival(before, earlier[name], now, error)
            decays = all(one[name] > other[name] for one, other in pairwise(late))
            if name not in found and not at_rest and decays and time < LONGEST_WAIT:
                found[name] = time
        return found


def _time_of_arrival(before: float, earlier: float, now: float, error: float) -> float:
    """Return the time at which an error that decays between two times [s] is the tolerance."""
    if not 0.0 < error < earlier:
        return now
    return before + (now - before) * math.log(earlier) / math.log(earlier / error)


class _Run:
    """
    Cycles of a setup.

    Parameters
    ----------
    setup : Setup
    period : float
        [s]
    solved : SolvedCycle
        Cycle before them.

    Attributes
    ----------
    options : CycleOptions
    groups : tuple of tuple of Task
        Copies of the tasks.

    """

    def __init__(self, setup: Setup, period: float, solved: SolvedCycle) -> None:
        settings = replace(setup.settings, period=period, command_delay=0,
                           braking_gain=min(setup.settings.braking_gain, 1.0 / period))
        self.period, self._robot, self._place = period, setup.robot, solved.place
        self.options = CycleOptions(setup.robot, settings, setup.velocity,
                                    solved.options.make_solver)
        self.groups = tuple([tuple([_copy(task) for task in group]) for group in setup.groups])
        self._core = compiled_step(setup.robot, self.options, self.groups, self._place.spare)
        if self._core is not None:
            self._core.refresh()

    def cycle(self, last: SolvedCycle | Commanded, q: Array, now: float) -> SolvedCycle:
        """Return the next cycle."""
        return self._compiled(last, q, now) or self._reference(last, q, now)

    def _compiled(self, last: SolvedCycle | Commanded, q: Array, now: float
                  ) -> CycleRecord | None:
        """Return the next cycle; None if the core does not support it."""
        core, passive = self._core, self._place.passive
        memory = None if core is None else last.numbers if isinstance(last, CycleRecord) \
            else core.layout.pack(last.memory)
        if core is None or memory is None:
            return None
        needed = core.given or self._robot.moves or passive is not None
        state = self._state(q, last.velocity) if needed else None
        given = [task.evaluate(state, now) for task in core.given] if state else []
        return core.run(memory, q, now, self.period, state, passive, given)

    def _reference(self, last: SolvedCycle | Commanded, q: Array, now: float) -> Solved:
        """Return the next cycle, by `step`."""
        state = self._state(q, last.velocity)
        evaluations = [[task.evaluate(state, now) for task in group] for group in self.groups]
        problem = Problem(self.options, levels_of(evaluations), state.positions, now, self.period)
        return Solved.after(evaluations, *step(problem, last.memory),
                            self._place._replace(q=q, now=now), self.options)

    def _state(self, q: Array, velocity: Array) -> RobotState:
        """Return the state at a configuration, reached at a velocity (n,)."""
        state = self._place.spare
        state.update(q, self._place.passive)
        state.velocity, state.still = velocity, self.options.limits.zero
        return state


def _copy(task: Task) -> Task:
    """Return a copy of a task for cycles of its own; velocities without a goal never time out."""
    other = task.probe()
    other.led = False
    if not task.has_position:
        other.timeout = math.inf
    return other


def _size(measures: Measures) -> float:
    """Return the largest error, in units of its tolerance where it has some."""
    return max((value / (tolerance or 1.0) for value, _, tolerance in measures.errors),
               default=0.0)

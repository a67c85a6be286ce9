# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""One control cycle as a pure function: problem and memory in, outcome and new memory out."""

from collections.abc import Iterable
import math
from typing import NamedTuple

import numpy as np
from tp_controller.control.cycle import Cycle, Outcome, TRANSITION
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.cycle_time import CycleTime
from tp_controller.control.escape import Escape
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.standing_joints import without_joints
from tp_controller.control.transition import kept_above, Transition
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.solver.solution import Memory
from tp_controller.tasks.stack import Groups
from tp_controller.tasks.task import Task


class Snapshot(NamedTuple):
    """
    Demand of the tasks at the state of the last command.

    The demand of a changed stack at that state, not at the present one, isolates the effect of
    the change.

    Attributes
    ----------
    levels : list of Level
    positions : ndarray (n,)
        [rad or m]
    damping : tuple of float
        See `CycleMemory`.

    """

    levels: list[Level]
    positions: Array
    damping: Memory


class Problem(NamedTuple):
    """
    Input of one cycle.

    Attributes
    ----------
    options : CycleOptions
    levels : list of Level
        Levels of the stack, evaluated at the present state.
    positions : ndarray (n,)
        [rad or m]
    now : float
        Time of the clock of the caller [s].
    elapsed : float or None
        Time since the last command [s]; by default the advance of `now`.
    shared : int or None
        Number of upper levels that no change since the last cycle affects; None without a change.
    before : Snapshot or None
        The changed stack at the last command; None if the robot was at rest.

    """

    options: CycleOptions
    levels: list[Level]
    positions: Array
    now: float
    elapsed: float | None = None
    shared: int | None = None
    before: Snapshot | None = None


class CycleMemory(NamedTuple):
    """
    State that one cycle leaves to the next one; no array in it is changed.

    Attributes
    ----------
    velocity : ndarray (n,)
        Last command [rad/s or m/s]; zeros before the first one.
    acceleration : ndarray (n,)
        Its difference from the one before, per time [rad/s² or m/s²].
    before : float
        The time of that change, at most a period [s].
    pending : tuple of ndarray (n,)
        Commands that the positions do not reflect yet, the last one first [rad/s or m/s].
    commanded : float or None
        Time of the last command, on the clock of the caller [s]; None before the first one.
    time : CycleTime
    damping : tuple of float
        `Solution.memory` of the solver, one number for each level; where a limit follows what the
        tasks demand, of the solution without transient limits.
    transition : Transition
    escape : Escape
    demand : ndarray (n,) or None
        Velocities that the tasks demanded, where a limit follows these [rad/s or m/s].

    """

    velocity: Array
    acceleration: Array
    before: float
    pending: tuple[Array, ...]
    commanded: float | None
    time: CycleTime
    damping: Memory = ()
    transition: Transition = Transition()
    escape: Escape = Escape()
    demand: Array | None = None

    @classmethod
    def at_rest(cls, n: int) -> 'CycleMemory':
        """Return the memory of a robot with n joints at rest, before it fits any options."""
        return cls(np.zeros(n), np.zeros(n), math.inf, (), None, CycleTime(0.0, 0.0, 0.0))

    def fit(self, options: CycleOptions) -> 'CycleMemory':
        """Return the memory for cycles with other options."""
        rest = (np.zeros(options.n),) * options.delay
        return self._replace(pending=(self.pending + rest)[:options.delay],
                             time=self.time.expect(options.period))

    def for_groups(self, before: Groups | None, after: Groups) -> 'CycleMemory':
        """Return the memory for the levels of other tasks; `before` None: of the same tasks."""
        if before is None:
            return self
        remembered = dict(zip(map(_names, before), self.damping))
        return self._replace(
            damping=tuple([remembered.get(_names(group), 0.0) for group in after]))

    def after_command(self, velocity: Array, now: float, options: CycleOptions,
                      elapsed: float | None = None) -> 'CycleMemory':
        """
        Return the memory after a velocity (n,) that was commanded without tasks at `now`.

        The time since the last command is `elapsed`, by default the advance of `now`; a period if
        it is not more than zero [s]. A stop ends all accelerations.
        """
        if elapsed is None:
            elapsed = 0.0 if self.commanded is None else now - self.commanded
        h = min(elapsed, options.period) if elapsed > 0.0 else options.period
        acceleration = (velocity - self.velocity) / h if velocity.any() else np.zeros(options.n)
        return self._replace(velocity=velocity, acceleration=acceleration, before=h,
                             pending=(velocity, *self.pending)[:options.delay], commanded=now,
                             transition=Transition(), demand=None)

    def motion(self, positions: Array, elapsed: float, hold: float) -> JointMotion:
        """
        Return the motion of the joints, as their limits see it.

        Parameters
        ----------
        positions : ndarray (n,)
            [rad or m]
        elapsed : float
            Time since the last command [s].
        hold : float
            Longest time that a command is in force [s].

        """
        return JointMotion(positions, self.velocity, elapsed, self.pending, hold,
                           self.acceleration, self.before, demanded=self.demand)


class Commanded(NamedTuple):
    """Memory of a velocity that was commanded without tasks, in place of a `Solved` cycle."""

    memory: CycleMemory

    @property
    def velocity(self) -> Array:
        """Return the command (n,) [rad/s or m/s]."""
        return self.memory.velocity


def step(problem: Problem, memory: CycleMemory) -> tuple[Cycle, Outcome, CycleMemory]:
    """
    Compute one cycle.

    The function is pure: equal arguments give equal results, to the bit.

    Parameters
    ----------
    problem : Problem
        Levels and positions of this cycle.
    memory : CycleMemory
        Memory of the previous cycle.

    Returns
    -------
    cycle : Cycle
        Solved levels and bounds.
    outcome : Outcome
        Solution and commanded solution.
    memory : CycleMemory
        Memory for the next cycle.

    """
    options, levels, positions, now, elapsed, shared, before = problem
    last, *_, pending, commanded, time, damping, transition, escape, _ = memory
    if commanded is None:
        # From rest: the first command may change by what the joints can do in this time.
        elapsed = elapsed if elapsed is not None and 0.0 < elapsed < options.period \
            else options.period
    elif elapsed is None:
        elapsed = now - commanded
    elapsed, time = time.advance(elapsed, options.period)
    motion = memory.motion(positions, elapsed, time.longest_hold(options.period))
    cycle = Cycle.begin(levels, options.limits.at(motion, time.mean), options.solver, damping)
    outcome = None
    if shared is not None:
        escape = escape.reset()
    if commanded is not None and (shared is not None or transition.fades):
        transition, outcome = _blend(problem, memory, cycle, elapsed, time)
    if outcome is None:
        solution = cycle.solve()
        escape, leaving = escape.levels(solution, time.now, cycle.solve)
        outcome = Outcome(solution, solution) if leaving is None else Outcome(
            solution, cycle.towards(leaving).solve(leaving), 'leaving a singularity')
    command, h = outcome.commanded.velocity, min(elapsed, options.period)
    # Multipliers of a limit that follows the demand do not last.
    lasting = cycle.demand or outcome.solution
    return cycle, outcome, CycleMemory(
        command, (command - last) / h, h, (command, *pending)[:options.delay], now, time,
        lasting.memory, transition, escape, None if cycle.demand is None else lasting.velocity)


def _blend(problem: Problem, memory: CycleMemory, cycle: Cycle, elapsed: float, time: CycleTime
           ) -> tuple[Transition, Outcome | None]:
    """Return the transition of the next cycle, and the outcome that blends in changes or None."""
    options, shared, before = problem.options, problem.shared, problem.before
    transition = memory.transition.at(time.now)
    if shared is None and not transition.fades:
        return transition, None
    # The end of the transition; acceleration limits only determine how fast it is reached.
    aim = cycle.aim()
    if shared is not None:
        transition, changed = memory.transition, cycle
        if before is not None:
            motion = memory.motion(before.positions, elapsed, time.longest_hold(options.period))
            levels = [without_joints(level, cycle.standing) for level in before.levels]
            changed = cycle._replace(levels=levels, memory=before.damping,
                                     bounds=options.limits.at(motion, time.mean))
        began = time.now - min(elapsed, options.period)
        # Shared levels must not fade, even if their goals move on.
        velocity = changed.aim(kept_above(changed.levels, shared) + [
            Level.of_joints(memory.velocity - transition.offset(began, shared))]).velocity
        after = aim if changed is cycle else changed.aim()
        transition = transition.begin(velocity - after.velocity, began, options.blend, shared)
    blended = transition.levels(cycle.levels, aim.velocity, time.now)
    return transition, None if blended is None else Outcome(
        aim, cycle.towards(blended).solve(blended), TRANSITION)


def _names(group: Iterable[Task]) -> tuple[str, ...]:
    """Return the names of the tasks of a level."""
    return tuple([task.name for task in group])

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reports of tasks at a configuration where the robot stays."""

from collections.abc import Mapping
from copy import copy
from functools import cached_property
from itertools import count

import numpy as np
from tp_controller.control.causes import Cause, Causes, CURVED, DAMPING, TASK
from tp_controller.control.cycle_options import CycleOptions
from tp_controller.control.error_minimum import Place
from tp_controller.control.roll_out import RollOuts
from tp_controller.control.settings import Settings
from tp_controller.control.solved_cycle import Solved
from tp_controller.control.step import CycleMemory, Problem, step
from tp_controller.control.task_report import ReportedCycle, TaskReport
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.locked_robot import fixed
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.stack import levels_of, Stack
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import attempt

# Gain of the tasks [1/s]: so slow that only positions limit them.
SLOW_GAIN = 0.01
# Kinds of causes of slow motion.
DAMPINGS = (CURVED, DAMPING)
# In place of the velocity limits [rad/s or m/s].
NO_LIMIT = 1e6


class RestingCauses(Causes):
    """Causes in a cycle at a configuration that no task changes; `blocked`: by unmet tasks."""

    blocked: frozenset[Task] = frozenset()

    def is_limited(self, evaluation: Evaluation) -> bool:
        """Return whether something limits a task."""
        return evaluation.task in self.blocked or super().is_limited(evaluation)


class RestingCycle(ReportedCycle):
    """
    Cycle at a configuration that no task changes, as its tasks report it.

    A task above that cannot be met keeps others from motions that it does not notice at first: a
    stretched arm does not bend for them. The cycle is linear, and has no cause for that.
    """

    @cached_property
    def search(self) -> RestingCauses:
        """Return the search for causes that limit tasks."""
        solved = self._solved
        found = RestingCauses(self._robot, solved.evaluations, solved.cycle, solved.outcome,
                              solved.place, solved.options.locked)
        found.blocked = frozenset(
            each.task for index, each in enumerate(self.evaluations)
            if self._unmet_above(index) is not None and not found.is_limited(each))
        return found

    @cached_property
    def roll_outs(self) -> RollOuts:
        """Return the roll-outs from the cycle, of tasks with a usual gain."""
        found = super().roll_outs
        found.setup = found.setup._replace(groups=tuple([
            tuple([task.at_positions() for task in group]) for group in found.setup.groups]))
        return found

    def causes(self, index: int) -> tuple[Cause, ...]:
        """Return the causes that limit the task at an index, the largest share first."""
        above = self._unmet_above(index)
        if above is not None and self.evaluations[index].task in self.search.blocked:
            return Cause(TASK, above.name, 1.0),
        found = super().causes(index)
        # A robot at rest is damped by nothing but a singularity.
        return tuple([each for each in found if each.kind not in DAMPINGS]) or found

    def _unmet_above(self, index: int) -> Task | None:
        """Return the first task above an unmet one whose goal is not reached, either; or None."""
        if self.measures(index).reached:
            return None
        return next((self._tasks[other] for other in range(index)
                     if not self._tasks[other].bounded and not self.measures(other).reached), None)


def reports_at(robot: Robot, stack: Stack, goals: Mapping[str, Goal], q: Array, passive: Array
               ) -> tuple[TaskReport, ...]:
    """
    Return a `TaskReport` for every task: the first cycle from rest, as slow as can be.

    Parameters
    ----------
    robot : Robot
        Robot of the tasks.
    stack : Stack
        Tasks, which are not changed.
    goals : dict
        {task: goal}, of all tasks with a goal, in internal form.
    q, passive : ndarray (nq,), (p,)
        Configuration and passive positions [rad or m].

    """
    free, still = copy(robot), fixed(robot)
    free.velocity = np.full(robot.n, NO_LIMIT)
    free.acceleration = free.jerk = np.full(robot.n, np.inf)
    free.lower, free.upper = (np.where(still, end, limits) for end, limits in (
        (-np.inf, robot.lower), (np.inf, robot.upper)))
    options = CycleOptions(free, Settings(blend=0.0), np.where(still, 0.0, free.velocity))
    tasks = Stack([[attempt(task, at_rest, task, goals.get(task.name)) for task in group]
                   for group in stack.active])
    state = robot.state(q, passive)
    state.still = np.flatnonzero(still).tolist()
    evaluations = tasks.evaluate(state, 0.0)
    cycle = RestingCycle(free, Solved.after(evaluations, *step(
        Problem(options, levels_of(evaluations), state.positions, 0.0),
        CycleMemory.at_rest(robot.n).fit(options)),
        Place(q, passive, 0.0, robot.state(q, passive)), options))
    index = count()
    return tuple([TaskReport(task, level, '', cycle, next(index))
                  for level, group in enumerate(tasks.active, 1) for task in group])


def at_rest(task: Task, goal: Goal) -> Task:
    """Return a copy of a task with a goal, whose gain is `SLOW_GAIN`."""
    return task.with_goal(goal).at_positions(SLOW_GAIN)

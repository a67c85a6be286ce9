# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Stack in force: its tasks are started, evaluated, enabled and replaced."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
from tp_controller.control.changes import Changes
from tp_controller.control.lead import Lead
from tp_controller.errors import EvaluationError, GoalError, unknown
from tp_controller.model.state import RobotState
from tp_controller.references.reference import Reference
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.task_errors import accept


class ActiveStack:
    """
    Stack in force, with the changes since the last cycle.

    Parameters
    ----------
    stack : Stack
        First stack, used by nobody else.

    Attributes
    ----------
    stack : Stack
        Stack in force.
    changes : Changes
    started : bool
        Whether all tasks have a goal.
    switches_off : bool
        Whether tasks that fail are switched off; by default they raise.
    references : dict
        References that tasks follow, by task.

    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        # Owner mark of the stack in force; each stack gets a new one.
        self._owner = object()
        stack.check_owner(self._owner)
        self.changes = Changes()
        self.started = self.switches_off = False
        self._leads: dict[Task, Lead] = {}
        self.references: dict[Task, Reference] = {}
        # Time of the last cycle that followed them [s].
        self._followed = -math.inf

    def own(self) -> None:
        """Mark the tasks of the stack as used."""
        self.stack.set_owner(self._owner)

    def replace(self, stack: Stack) -> None:
        """Replace the stack; see `Controller.replace_stack`."""
        stack.check_owner(self._owner)
        before = self.stack.active
        self.end_leads()
        stack.inherit_goals(self.stack)
        self.references = {
            stack.tasks[task.name]: reference for task, reference in self.references.items()
            if _goes_on(task, stack.tasks.get(task.name))}
        self._owner = object()
        self.stack = stack
        self.own()
        self.started = False
        self.changes.announce_stack(before, stack.active)

    def restart(self) -> None:
        """Drop the default goals; the next start sets new ones."""
        changed = [any(task.has_default_goal for task in group) for group in self.stack.active]
        if any(changed):
            self.changes.announce(changed.index(True))
        self.started = False
        self.stack.reset()

    def forget_goals(self) -> None:
        """Drop all goals; the next start sets default goals."""
        self.changes.announce(0)
        self.started = False
        self.end_leads()
        self.end_references()
        self.stack.forget_goals()

    def task(self, name: str) -> Task:
        """Return a task by name."""
        if not isinstance(name, str) or name not in self.stack.tasks:
            raise GoalError(unknown('task', name, self.stack.tasks))
        return self.stack.tasks[name]

    def set_goal(self, task: Task, goal: Any, now: float, lead: Lead | None = None) -> None:
        """Set the goal of a task, parsed and in its reference frame, and what leads there."""
        self.changes.announce_goal(task, self.stack.active, now)
        self._end_reference(task)
        accept(task, task.set_goal, goal, now)
        self._end_lead(task)
        if lead is not None:
            self._leads[task], task.led = lead, True

    # Trajectories

    def reference(self, task: Task, now: float) -> Reference | None:
        """Return the reference that a task follows; None if it follows none, or it is over."""
        found = self.references.get(task)
        return None if found is None or found.is_over(now) else found

    def set_reference(self, task: Task, reference: Reference, now: float) -> None:
        """Let a task follow a reference, which goes on from where it is and moves."""
        if task not in self.references:
            accept(task, task.set_goal, reference.goal(now, 0.0)[0], now)
        if task in self._leads:
            self.changes.announce_goal(task, self.stack.active, now)
            self._end_lead(task)
        self.references[task] = reference

    def follow(self, now: float, period: float) -> None:
        """Set goals and feed-forward velocities of a cycle; `period` is the longest one [s]."""
        # The velocity of a cycle is the mean of those until the next: that in its middle.
        passed, self._followed = now - self._followed, now
        ahead = 0.5 * min(passed, period) if 0.0 < passed < math.inf else 0.0
        for task, reference in tuple(self.references.items()):
            goal, velocity = reference.goal(now, ahead)
            if reference.is_over(now):
                task.goal = goal
                self._end_reference(task)
            else:
                task.move_goal(goal, velocity, now)

    def progress(self, now: float) -> Mapping[str, float]:
        """Return {task: share of the time of its trajectory that has passed}."""
        return {task.name: reference.progress(now)
                for task, reference in self.references.items()}

    def end_references(self) -> None:
        """Let all tasks stay at the present values of their trajectories."""
        for task in tuple(self.references):
            self._end_reference(task)

    def _end_reference(self, task: Task) -> None:
        """Let a task stay at the present value of its trajectory."""
        if self.references.pop(task, None) is not None:
            task.forget_feed_forward()

    # Feed-forward velocities and enabling

    def set_feed_forward(self, task: Task, velocity: Any, now: float) -> None:
        """Set the feed-forward velocity of a task, parsed and in its reference frame."""
        self.changes.announce_goal(task, self.stack.active, now)
        accept(task, task.set_feed_forward, velocity, now)

    def enable(self, task: Task, enabled: bool) -> None:
        """Enable a task, which resets its default goal, or disable it."""
        if enabled == (task.name not in self.stack.disabled):
            return
        before = self.stack.active
        self._end_lead(task)
        self._end_reference(task)
        if enabled:
            accept(task, task.reset)
            self.started = False
        self.stack.enable(task.name, enabled)
        self.changes.announce_stack(before, self.stack.active)

    def start(self, state: RobotState) -> None:
        """Set the default goals of tasks without a goal to their present values, once."""
        while not self.started:
            try:
                self.stack.start(state)
                self.started = True
            except EvaluationError as error:
                self._switch_off(error)

    def evaluate(self, state: RobotState, now: float) -> list[list[Evaluation]]:
        """Return the evaluations of the tasks at a state, level by level."""
        while True:
            try:
                return [self._led(group, state) for group in self.stack.evaluate(state, now)]
            except EvaluationError as error:
                self._switch_off(error)

    def evaluate_some(self, tasks: Sequence[Task], state: RobotState, now: float
                      ) -> list[Evaluation] | None:
        """Return the evaluations of some tasks; None if one fails and is switched off."""
        try:
            return self._led(self.stack.evaluate_tasks(tasks, state, now), state)
        except EvaluationError as error:
            self._switch_off(error)
            return None

    def _led(self, evaluations: list[Evaluation], state: RobotState) -> list[Evaluation]:
        """Return evaluations, with the demands of leads in place of those of their tasks."""
        if not self._leads:
            return evaluations
        for task in [task for task, lead in self._leads.items() if lead.has_arrived(state)]:
            self._end_lead(task)
        return [self._leads[each.task].demand(each, state) if each.task in self._leads else each
                for each in evaluations]

    def end_leads(self) -> None:
        """Let all tasks go on straight to their goals."""
        for task in tuple(self._leads):
            self._end_lead(task)

    def _end_lead(self, task: Task) -> None:
        """Let a task go on straight to its goal."""
        if self._leads.pop(task, None) is not None:
            task.led = False

    def _switch_off(self, error: EvaluationError) -> None:
        """Switch off a task that fails, or raise."""
        if not self.switches_off:
            raise error
        before = self.stack.active
        if error.task in self.stack.tasks:
            self._end_reference(self.stack.tasks[error.task])
        self.stack.switch_off(error.task, error.reason)
        self.changes.announce_stack(before, self.stack.active)


def _goes_on(task: Task, other: Task | None) -> bool:
    """Return whether a task that replaces another one goes on with its trajectory."""
    return other is not None and other.goal is not None and type(other) is type(task) \
        and bool(accept(other, other.is_compatible, task)) \
        and np.array_equal(other.goal, task.goal)

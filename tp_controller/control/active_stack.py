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

"""Stack in force: its tasks are started, evaluated, enabled and replaced."""

from collections.abc import Sequence
from typing import Any

from tp_controller.control.changes import Changes
from tp_controller.control.lead import Lead
from tp_controller.errors import EvaluationError, GoalError, unknown
from tp_controller.model.state import RobotState
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

    """

    def __init__(self, stack: Stack) -> None:
        self.stack = stack
        # Owner mark of the stack in force; each stack gets a new one.
        self._owner = object()
        stack.check_owner(self._owner)
        self.changes = Changes()
        self.started = self.switches_off = False
        self._leads: dict[Task, Lead] = {}

    def own(self) -> None:
        """Mark the tasks of the stack as used."""
        self.stack.set_owner(self._owner)

    def replace(self, stack: Stack) -> None:
        """Replace the stack; see `Controller.replace_stack`."""
        stack.check_owner(self._owner)
        before = self.stack.active
        self._end_leads()
        stack.inherit_goals(self.stack)
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
        self._end_leads()
        self.stack.forget_goals()

    def task(self, name: str) -> Task:
        """Return a task by name."""
        if not isinstance(name, str) or name not in self.stack.tasks:
            raise GoalError(unknown('task', name, self.stack.tasks))
        return self.stack.tasks[name]

    def set_goal(self, task: Task, goal: Any, now: float, lead: Lead | None = None) -> None:
        """Set the goal of a task, parsed and in its reference frame, and what leads there."""
        self.changes.announce_goal(task, self.stack.active, now)
        accept(task, task.set_goal, goal, now)
        self._end_lead(task)
        if lead is not None:
            self._leads[task], task.led = lead, True

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

    def _end_leads(self) -> None:
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
        self.stack.switch_off(error.task, error.reason)
        self.changes.announce_stack(before, self.stack.active)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Hints of a status: computed once a second, and not for tasks without a reason."""

from types import SimpleNamespace

from tp_controller.ros.interface.recent_hints import HINT_SECONDS, RecentHints


class Task:
    """Report of a task that counts how often its hint is computed."""

    name, reason, computed = 'tool', 'blocked by elbow', 0

    @property
    def hint(self):
        """Return another hint each time."""
        self.computed += 1
        return f'wait {self.computed} s'


def test_hint_is_computed_once_a_second():
    clock, task = SimpleNamespace(now=5.0), Task()
    hints = RecentHints(lambda: clock.now)
    assert [hints.of(task), hints.of(task)] == ['wait 1 s', 'wait 1 s']
    clock.now += 0.99 * HINT_SECONDS
    assert hints.of(task) == 'wait 1 s'
    clock.now += 0.02 * HINT_SECONDS
    assert hints.of(task) == 'wait 2 s'


def test_task_without_a_reason_has_no_hint_and_costs_nothing():
    task = Task()
    hints = RecentHints(lambda: 0.0)
    hints.of(task)
    task.reason = ''
    assert hints.of(task) == '' and task.computed == 1


def test_hints_of_another_stack_are_dropped():
    task = Task()
    hints = RecentHints(lambda: 0.0)
    hints.of(task)
    hints.forget()
    assert hints.of(task) == 'wait 2 s'

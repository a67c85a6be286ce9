# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Steps of a demo over ROS 2: sending goals, printing progress, recording outcomes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
import math
from textwrap import shorten
import time
from typing import TYPE_CHECKING

import numpy as np
from tp_controller.control.reason_text import brief_reason
from tp_controller.ros.client.status import DONE, TaskStatus
from tp_controller.tools.demos.scenarios import Goal, goal_fields

if TYPE_CHECKING:  # Imported when a demo starts: nothing else here needs ROS.
    from tp_controller.ros.client.client import Client

# Timeout of a goal, in time for which the controller has computed commands [s], independent of the
# load of the machine.
GOAL_SECONDS = 20.0
# Timeout of a goal without new commands [s].
IDLE_SECONDS = 60.0
# Timeout of the response of the controller to a goal [s].
GOAL_ANSWER_SECONDS = 120.0
# Time for which a goal is observed after it is reached [s].
LINGER_SECONDS = 0.5
PROGRESS_SECONDS = 1.0
# Period of repeated velocities, which time out otherwise [s].
REPEAT_SECONDS = 0.1
# Polling period [s].
GOAL_POLL_SECONDS = 0.02
# Formats of errors in suitable units.
SHOWN = {'m': '{:8.2f} mm', 'rad': '{:6.2f}°', 'm/s': '{:8.2f} mm/s'}
FACTORS = {'m': 1e3, 'rad': np.degrees(1.0), 'm/s': 1e3}
# Longest reason of a pause [characters].
LONGEST_REASON = 48


@dataclass(frozen=True)
class TaskOutcome:
    """
    Outcome of one task under one goal.

    Attributes
    ----------
    goal : str
        Number and name of the goal; empty for a task that kept its own goal.
    task, error, status, reason : str
        Values of the status of the controller.
    say : str
        Number and name of the goal of this task; empty if it had none.

    """

    goal: str
    task: str
    error: str
    status: str
    say: str
    reason: str

    @property
    def asked(self) -> bool:
        """Return whether the goal was for this task."""
        return bool(self.say)

    @property
    def reached(self) -> bool:
        """Return whether the task is reached or satisfied."""
        return self.status in DONE

    @property
    def text(self) -> str:
        """Return a short text of the outcome."""
        if self.asked and not self.reached:
            return f'not reached: {brief_reason(self.reason) or "out of time"}'
        return self.status if self.reached else brief_reason(self.reason) or 'moving'

    def __str__(self) -> str:
        """Return the line of the table."""
        mark = '>' if self.asked else ' '
        return f'{self.goal:<42} {mark} {self.task:<8} {self.error:<24} {self.text}'


class Steps:
    """
    Execution of the steps of a demo.

    Parameters
    ----------
    client : Client
    check : callable
        Raises an error if a node has ended.
    computed : callable
        Returns the time for which the controller has computed commands [s].

    Attributes
    ----------
    pauses : int
        Number of temporary stops of the controller.

    """

    def __init__(self, client: 'Client', check: Callable[[], None],
                 computed: Callable[[], float]) -> None:
        self._client, self._check, self._computed = client, check, computed
        self._errors: dict[str, str] = {}
        self._paused = False
        self.pauses = 0

    def carry_out(self, step: Sequence[Goal], number: int) -> list[TaskOutcome]:
        """
        Send goals, print the progress, and return the outcome of every task.

        Parameters
        ----------
        step : sequence of dict
            Goals that are sent together.
        number : int
            Number of the step, for its lines.

        Raises
        ------
        TpControllerError
            A node has ended or does not respond.

        """
        titles = {goal['task']: f'{number} {goal["say"]}' for goal in step}
        self._errors.clear()
        for goal in step:
            self._client.send(goal['task'], wait=GOAL_ANSWER_SECONDS, **goal_fields(goal))
        seconds, began = max(goal.get('for', 0.0) for goal in step), time.monotonic()
        deadline = _Deadline(self._computed())
        show, repeat = _Ticker(PROGRESS_SECONDS), _Ticker(REPEAT_SECONDS, began)

        def turn() -> None:
            # Process all messages: dropped ones would be missing in the figures.
            self._client.spin(GOAL_POLL_SECONDS)
            self._client.catch_up()
            self._poll()
            if seconds and repeat.due():
                self._client.repeat()
            if show.due():
                self._show(titles, time.monotonic() - began)

        def ended() -> bool:
            return deadline.expired(self._computed()) or (
                time.monotonic() - began >= seconds and all(
                    self._client.task_status(task).status == 'reached' for task in titles))

        while not ended():
            turn()
        linger = time.monotonic() + LINGER_SECONDS
        while time.monotonic() < linger:
            turn()
        # A controller that stopped temporarily, as after late joint states, resumes by itself.
        while not ended():
            turn()
        return [self._outcome(title, task, titles.get(task, '')) for task, title in zip_longest(
            self._client.task_names(), titles.values(), fillvalue='')]

    def _poll(self) -> None:
        """Update the errors, which are unknown during a stop, and count pauses."""
        self._check()
        stopped = bool(self._client.stop_reason())
        self.pauses += stopped and not self._paused
        self._paused = stopped
        for task in self._client.task_names():
            errors = error_text(self._client.task_status(task))
            if errors:
                self._errors[task] = errors

    def _show(self, titles: Mapping[str, str], seconds: float) -> None:
        """Print the progress after a time [s], and the reason of a stop."""
        reason = self._client.stop_reason()
        pause = f'  paused: {shorten(reason, LONGEST_REASON, placeholder=" …")}' if reason else ''
        for task, title in titles.items():
            print(f'{title:<42}   {task:<8} {self._errors.get(task, ""):<24} '
                  f'{seconds:4.1f} s{pause}', flush=True)

    def _outcome(self, title: str, task: str, say: str) -> TaskOutcome:
        """Return the outcome of a task."""
        status = self._client.task_status(task)
        return TaskOutcome(title, task, self._errors.get(task, ''), status.status, say,
                           status.reason or self._client.stop_reason())


class _Ticker:
    """Clock that ticks at most once in a period [s]."""

    def __init__(self, period: float, last: float = -math.inf) -> None:
        self._period, self._last = period, last

    def due(self) -> bool:
        """Return whether it ticks."""
        now = time.monotonic()
        due = now - self._last > self._period
        if due:
            self._last = now
        return due


class _Deadline:
    """Timeout of a goal, in time for which commands were computed [s]."""

    def __init__(self, computed: float) -> None:
        self._until = computed + GOAL_SECONDS
        self._last, self._moved = computed, time.monotonic()

    def expired(self, computed: float) -> bool:
        """Return whether the goal has timed out."""
        now = time.monotonic()
        if computed > self._last:
            self._last, self._moved = computed, now
        return computed > self._until or now - self._moved > IDLE_SECONDS


def error_text(task: TaskStatus) -> str:
    """Return the errors of a task in suitable units; empty if they are unknown."""
    return ', '.join(SHOWN[unit].format(FACTORS[unit] * error)
                     for unit, error in task.errors.items()
                     if unit in SHOWN and math.isfinite(error))

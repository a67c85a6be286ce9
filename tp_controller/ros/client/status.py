# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Status of a controller, read from a received or recorded message; needs no ROS."""

from collections.abc import Mapping
from dataclasses import dataclass, field
import math

from tp_controller.ros import Message
from tp_controller.untrusted.texts import plain

STATUS_TYPE = 'diagnostic_msgs/msg/DiagnosticArray'
# Message of the head entry while the tasks are executed.
RUNNING = 'running'
# Statuses of a task whose goal is reached or whose bounds are satisfied, and while zeros are
# commanded.
DONE, STOPPED = ('reached', 'satisfied'), 'stopped'
# Level of a task outside the stack.
DISABLED = 'disabled'
# Desired speed of a task up to which it is at rest, in its own unit.
REST_SPEED = 1e-6
# Largest numbers of tasks, of values per entry, and of errors, tolerances and causes per task.
MOST_RECEIVED_TASKS, MOST_VALUES, MOST_TASK_ERRORS, MOST_TASK_CAUSES = 200, 64, 8, 64
# Longest name [characters].
LONGEST_KEY = 256
# Keys of the head entry that only controllers write.
OWN_KEYS = frozenset(('scale', 'limiting'))
CAUSE_SEPARATOR = '; '


@dataclass(frozen=True)
class TaskStatus:
    """
    Status of a task; all texts are printable.

    Attributes
    ----------
    name, kind, level : str
        Name and type of the task; level ``1``, ``2`` …, or ``disabled``.
    status : str
        ``reached``, ``moving``, ``limited`` …
    errors, tolerances : dict
        {unit: value}; NaN while it is unknown.
    wanted_speed, achieved_speed : float
        Norm of the demanded task velocity, and of its achieved part.
    reason, hint : str
        What limits the task, as a sentence, and a possible remedy.
    causes : tuple of str
        Causes that limit the task, the largest share first. Older recordings lack them: there the
        reason as a whole is the only cause.
    accepted, refused : int
        Number of accepted and refused goals.
    refusal : str
        Reason of the last refusal.
    goal_warning, gain_warning : str
        Probable mistake in the last accepted goal; whether the gain is too high.
    listeners : dict
        {topic: number of subscriptions} of the topics of goals.
    progress : float
        Share of the time of its trajectory that has passed; NaN without one.

    """

    name: str
    kind: str = ''
    level: str = ''
    status: str = ''
    errors: Mapping[str, float] = field(default_factory=dict)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    wanted_speed: float = math.nan
    achieved_speed: float = math.nan
    reason: str = ''
    hint: str = ''
    causes: tuple[str, ...] = ()
    accepted: int = 0
    refused: int = 0
    refusal: str = ''
    goal_warning: str = ''
    gain_warning: str = ''
    listeners: Mapping[str, int] = field(default_factory=dict)
    progress: float = math.nan

    @property
    def way(self) -> str:
        """Return the progress of the trajectory as text; empty without one."""
        return '' if math.isnan(self.progress) else f'{self.progress:.0%} of its trajectory'

    @property
    def enabled(self) -> bool:
        """Return whether the task is in the stack."""
        return self.level != DISABLED

    @property
    def share(self) -> float:
        """Return the achieved share of the desired speed; not a number at rest."""
        if not self.wanted_speed > REST_SPEED:
            return math.nan
        return min(max(self.achieved_speed / self.wanted_speed, 0.0), 1.0)

    @property
    def done(self) -> bool:
        """Return whether the goal is reached, or the bounds are satisfied."""
        return self.status in DONE

    @property
    def answers(self) -> tuple[int, int]:
        """Return the numbers of accepted and refused goals."""
        return self.accepted, self.refused

    @property
    def warnings(self) -> list[str]:
        """Return the warnings that the reason does not contain."""
        return [warning for warning in (self.goal_warning, self.gain_warning)
                if warning and warning not in self.reason]


@dataclass(frozen=True)
class ControllerStatus:
    """
    Status of a controller; all texts are printable.

    Attributes
    ----------
    name : str
        Name of the controller node, with its namespace.
    head : str
        ``running``, or the reason for zero commands.
    values : dict
        {key: value} of the controller as a whole.
    tasks : dict
        {name: TaskStatus}, by priority.

    """

    name: str
    head: str
    values: Mapping[str, str] = field(default_factory=dict)
    tasks: Mapping[str, TaskStatus] = field(default_factory=dict)

    @property
    def from_controller(self) -> bool:
        """Return whether a controller published it: other nodes use this message type, too."""
        return self.values.keys() >= OWN_KEYS

    @property
    def summary(self) -> str:
        """Return the head, and the joints that are locked."""
        locked = self.values.get('locked', '')
        return f'{self.head}, locked: {locked}' if locked else self.head

    @property
    def stop_reason(self) -> str:
        """Return the reason for zero commands; empty while the tasks are executed."""
        return '' if self.head == RUNNING else self.head


def received(message: Message) -> ControllerStatus:
    """
    Return the status in a message, with printable text, cut to the bounds of its size.

    Parameters
    ----------
    message : diagnostic_msgs.msg.DiagnosticArray
        Any message with its fields: recordings are decoded without ROS.

    """
    if not message.status:
        return ControllerStatus('', '')
    head, *others = message.status[:MOST_RECEIVED_TASKS + 1]
    tasks = {task.name: task for task in map(_task, others)}
    return ControllerStatus(plain(head.name, LONGEST_KEY), plain(head.message), _values(head),
                            tasks)


def _values(entry: Message) -> dict[str, str]:
    """Return {key: value} of an entry."""
    return {plain(value.key, LONGEST_KEY): plain(value.value)
            for value in entry.values[:MOST_VALUES]}


def _task(entry: Message) -> TaskStatus:
    """Return the status of a task from its entry."""
    values = _values(entry)

    def text(key: str) -> str:
        return values.get(key, '')

    reason = text('reason')
    causes = values['causes'].split(CAUSE_SEPARATOR) if 'causes' in values else [reason]
    return TaskStatus(
        plain(entry.name, LONGEST_KEY).partition(': ')[2], text('type'), text('level'),
        text('status'), _by_unit(values, 'error ['), _by_unit(values, 'tolerance ['),
        _number(text('wanted speed')), _number(text('achieved speed')), reason, text('hint'),
        tuple(filter(None, causes[:MOST_TASK_CAUSES])), _count(text('goals accepted')),
        _count(text('goals refused')), text('last refusal'), text('goal warning'),
        text('gain warning'),
        {key.removesuffix(' listeners'): _count(value) for key, value in values.items()
         if key.endswith(' listeners')}, _number(text('progress')))


def _by_unit(values: Mapping[str, str], start: str) -> dict[str, float]:
    """Return {unit: number} of the keys with a start and a unit in brackets."""
    found = [(key[len(start):-1], _number(value)) for key, value in values.items()
             if key.startswith(start)]
    return dict(found[:MOST_TASK_ERRORS])


def _number(text: str) -> float:
    """Return the number in a text; NaN if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _count(text: str) -> int:
    """Return the count in a text; 0 if it is not an integer."""
    try:
        return max(int(text), 0)
    except ValueError:
        return 0

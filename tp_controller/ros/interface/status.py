# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Conversion of the report of a cycle to messages."""

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from tp_controller.control.controller import Controller
from tp_controller.control.report import Report, stopped_reports
from tp_controller.control.task_report import TaskReport
from tp_controller.errors import GoalError
from tp_controller.ros.interface.task_topics import GoalRecord

LEVELS = {**dict.fromkeys(('reached', 'satisfied', 'moving', 'disabled'), DiagnosticStatus.OK),
          'limited': DiagnosticStatus.WARN, 'stopped': DiagnosticStatus.WARN,
          'failed': DiagnosticStatus.ERROR}


def diagnostics(stamp: Time, node_name: str, stop_reason: str, report: Report | None,
                controller: Controller | None, records: Mapping[str, GoalRecord],
                figures: Mapping[str, str], wait: Callable[[], None],
                hint_of: Callable[[TaskReport], str] = attrgetter('hint')) -> DiagnosticArray:
    """
    Return the status of the node and of every task, with the same keys at all times.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Time of the message.
    node_name : str
        Prefix of the name of each entry.
    stop_reason : str
        Reason for zero commands; empty while the tasks are executed.
    report : Report or None
        Report of the last cycle.
    controller : Controller or None
        Source of the tasks if there is no report on them.
    records : dict
        {task: GoalRecord}
    figures : dict
        {key: value} of the loop statistics.
    wait : callable
        Called between parts of the work, such as the causes that limit a task, and its text.
    hint_of : callable, optional
        Returns the hint of a task.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray

    """
    running = report is not None and not stop_reason
    locked = tuple(controller.locked) if controller else ()
    head = DiagnosticStatus(
        name=node_name, hardware_id=node_name,
        level=DiagnosticStatus.WARN if stop_reason or locked else DiagnosticStatus.OK,
        message=stop_reason or 'running',
        values=[_value('scale', f'{report.scale:.4f}' if report and running else 'nan'),
                _value('limiting', report.limiting if report and running else ''),
                _value('locked', ', '.join(locked)),
                *(_value(key, value) for key, value in figures.items())])
    array = DiagnosticArray(status=[head])
    array.header.stamp = stamp
    for task in task_reports(stop_reason, report, controller):
        if task.name in records:
            wait()
            status = _task_status(node_name, task, records[task.name], wait, hint_of)
            status.values.append(_value('gain warning', _gain_warning(controller, task.name)))
            array.status.append(status)
    return array


def task_reports(stop_reason: str, report: Report | None,
                 controller: Controller | None) -> Sequence[TaskReport]:
    """Return the reports of all tasks; see `diagnostics`."""
    if report is not None and not stop_reason:
        return report.tasks
    return stopped_reports(controller.stack) if controller else ()


def _gain_warning(controller: Controller | None, task: str) -> str:
    """Return the gain warning of a task, which may belong to an earlier stack."""
    try:
        return controller.gain_warning(task) if controller else ''
    except GoalError:
        return ''


def _goal_values(record: GoalRecord) -> list[KeyValue]:
    """Return the entries of a goal record."""
    return [_value('goals accepted', record.accepted), _value('goals refused', record.refused),
            _value('last refusal', record.refusal), _value('goal warning', record.warning),
            *(_value(f'{topic} listeners', count) for topic, count in record.listeners.items())]


def _task_status(node_name: str, task: TaskReport, record: GoalRecord,
                 wait: Callable[[], None], hint_of: Callable[[TaskReport], str]
                 ) -> DiagnosticStatus:
    """Return the status of one task."""
    # Computes the causes that limit the task.
    status = task.status
    wait()
    values = [_value('type', task.type_name), _value('level', task.level or 'disabled'),
              _value('status', status)]
    for error, unit, tolerance in task.errors:
        values.append(_value(f'error [{unit}]', f'{error:.6g}'))
        values.append(_value(f'tolerance [{unit}]', f'{tolerance:.6g}'))
    values.append(_value('wanted speed', f'{task.demanded_speed:.6g}'))
    values.append(_value('achieved speed', f'{task.achieved_speed:.6g}'))
    values.append(_value('progress', '' if task.progress is None else f'{task.progress:.4f}'))
    values.append(_value('reason', task.reason))
    values.append(_value('causes', '; '.join(task.phrases)))
    values.append(_value('hint', hint_of(task)))
    values.extend(_goal_values(record))
    message = status if not task.reason else f'{status}: {task.reason}'
    return DiagnosticStatus(name=f'{node_name}: {task.name}', hardware_id=node_name,
                            level=LEVELS[status], message=message, values=values)


def _value(key: str, value: object) -> KeyValue:
    """Return one entry of a diagnostic status."""
    return KeyValue(key=key, value=str(value))

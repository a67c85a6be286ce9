# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Report on a recording: one self-contained HTML page."""

import base64
from collections.abc import Iterable, Iterator, Sequence
from html import escape
import math
from pathlib import Path
import time

import numpy as np
from tp_controller.control.units import with_unit
from tp_controller.model.robot import Robot
from tp_controller.ros.client.status import DONE, STOPPED
from tp_controller.tools.files import new_file
from tp_controller.tools.html_page import Cell, page, Row, shown, table
from tp_controller.tools.recording.goals import Goal, outcome
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.pictures import command_topic
from tp_controller.tools.recording.robots import command_names
from tp_controller.tools.recording.task_history import TaskHistory
from tp_controller.untrusted.texts import plain

# Largest number of listed causes of a task.
MOST_LISTED_CAUSES = 3
# Longest cell of the summary, and longest parameter [characters].
LONGEST_CELL, LONGEST_VALUE = 200, 500


def summary(history: History) -> str:
    """Return a text summary of the task outcomes."""
    titles = ('task', 'level', 'status', 'last error', 'reached', 'limited by')
    tasks = [_task_row(task, all_errors=False) for task in history.tasks.values()]
    rows = [titles, *([plain(cell.text if isinstance(cell, Cell) else cell, LONGEST_CELL)
                       for cell in row] for row in tasks)]
    widths = [max(map(len, column)) for column in zip(*rows)]
    return '\n'.join('  '.join(f'{cell:<{width}}' for cell, width in zip(row, widths)).rstrip()
                     for row in rows)


def write_report(path: Path, history: History, robot: Robot | None,
                 plots: Iterable[tuple[str, Path]], *, title: str, remarks: Sequence[str],
                 replay: str) -> None:
    """
    Write the page.

    Parameters
    ----------
    path : pathlib.Path
        File to write.
    history : History
        History of the controller.
    robot : Robot or None
        Robot, for its limits.
    plots : iterable of (str, pathlib.Path)
        Title and file of each plot.
    title : str
        Title of the page.
    remarks : sequence of str
        Faults of the recording, and missing parts of the page.
    replay : str
        Complete HTML page that shows the motion; no replay if empty.

    """
    began = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(1e-9 * history.began))
    node = f'/{history.node}' if history.node else 'no controller'
    facts = f'{node} · {began} · {history.end:.1f} s · {history.counts.total()} messages'
    text = page(title, facts, _body(history, robot, plots, remarks, replay))
    with new_file(path) as file:
        file.write(text.encode())


def _body(history: History, robot: Robot | None, plots: Iterable[tuple[str, Path]],
          remarks: Sequence[str], replay: str) -> Iterator[str]:
    """Yield the parts of the page."""
    yield from (f'<p class="remarks">{shown(remark)}</p>' for remark in remarks)
    yield from table('Tasks', ('task', 'type', 'level', 'status', 'last error', 'largest',
                               'reached', 'limited by'),
                     [_task_row(task) for task in history.tasks.values()])
    if replay:
        # The sandbox denies scripts access to anything outside the replay.
        yield ('<h2>Replay</h2><iframe title="Replay" loading="lazy" sandbox="allow-scripts" '
               f'srcdoc="{escape(replay)}"></iframe>')
    yield from table('Goals', ('time', 'task', 'goal', 'frame', 'outcome'), _goal_rows(history),
                     history.goals.more)
    yield from table('Stops', ('time', 'duration', 'reason of zero commands'),
                     [(f'{stop.start:.1f} s', f'{stop.end - stop.start:.1f} s', stop.reason)
                      for stop in history.stops.stops], history.stops.more)
    for name, plot in plots:
        data = base64.b64encode(plot.read_bytes()).decode()
        yield (f'<h2>{shown(name)}</h2>'
               f'<img alt="{shown(name)}" src="data:image/png;base64,{data}">')
    yield from table('Joints', ('joint', 'positions', 'position limits', 'largest velocity',
                                'of its limit'), list(_joint_rows(history, robot)))
    yield '<h2>Recording</h2>'
    for name, rows in (('topics', history.counts), ('parameters', history.parameters)):
        if rows:
            yield f'<details><summary>{name}</summary>'
            yield from table('', (), [(key, plain(str(value), LONGEST_VALUE))
                                      for key, value in sorted(rows.items())])
            yield '</details>'


def _task_row(task: TaskHistory, all_errors: bool = True) -> Row:
    """Return the cells of a task."""
    done = task.status in DONE
    share = f'{100.0 * task.reached / task.known:.0f} % of {task.known:.1f} s' \
        if task.known else ''
    causes = ', '.join(
        f'{cause} ({task.causes[cause]:.1f} s)' for cause in sorted(
            task.causes, key=lambda cause: -task.causes[cause])[:MOST_LISTED_CAUSES])
    causes += ' …' if len(task.causes) > MOST_LISTED_CAUSES else ''
    last = ', '.join(_error(error, unit) for unit, (error, _) in task.errors.items())
    largest = ', '.join(_error(error, unit) for unit, error in task.largest.items())
    text = f'{task.status}, then {STOPPED}' if task.stopped and task.status != STOPPED \
        else task.status
    status = text if done else Cell(text)
    if not all_errors:
        return task.name, task.level, status, last, share, causes
    return task.name, task.kind, task.level, status, last, largest, share, causes


def _error(error: float, unit: str) -> str:
    """Return an error with its unit; a dash if it is unknown."""
    return '-' if math.isnan(error) else with_unit(f'{error:.4g}', unit)


def _goal_rows(history: History) -> list[Row]:
    """Return the cells of the goals."""
    following: dict[str, Goal] = {}
    rows: list[Row] = []
    for goal in reversed(history.goals.goals):
        became = outcome(goal, following.get(goal.task), history.end)
        if goal.accepted:
            # A refused goal replaces nothing.
            following[goal.task] = goal
        many = f' (the last of {goal.count}, until {goal.last:.1f} s)' if goal.count > 1 else ''
        rows.append((f'{goal.time:.1f} s', goal.task, goal.text + many, goal.frame,
                     became if math.isfinite(goal.reached) else Cell(became)))
    return rows[::-1]


def _joint_rows(history: History, robot: Robot | None) -> Iterator[Row]:
    """Yield the cells of the joints."""
    topic = command_topic(history)
    largest: dict[str, float] = {}
    if topic:
        _, values = history.commands[topic].rows()
        largest = dict(zip(command_names(history, robot, values.shape[1]),
                           np.abs(values).max(axis=0, initial=0.0).tolist()))
    limits = {} if robot is None else dict(zip(robot.velocity_names, zip(
        robot.velocity_units, robot.lower.tolist(), robot.upper.tolist(),
        robot.velocity.tolist())))
    ranges = history.motion.ranges
    for name in dict.fromkeys((*largest, *ranges)):
        unit, lower, upper, fastest = limits.get(name, ('', -math.inf, math.inf, math.inf))
        low, high = ranges.get(name, (math.nan, math.nan))
        speed = largest.get(name, math.nan)
        share = speed / fastest if fastest > 0.0 else math.nan
        beyond = low < lower or high > upper
        span = f'{low:.3f} … {high:.3f} {unit}' if math.isfinite(low) else ''
        yield (name, Cell(span) if beyond else span,
               f'{lower:.3f} … {upper:.3f}' if math.isfinite(upper - lower) else '',
               f'{speed:.3f}' + (f' {unit}/s' if unit else '') if math.isfinite(speed) else '',
               f'{100.0 * share:.0f} %' if math.isfinite(fastest) and math.isfinite(share)
               else '')

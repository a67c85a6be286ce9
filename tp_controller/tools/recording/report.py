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

"""Report on a recording: one self-contained HTML page."""

import base64
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import islice
import math
from pathlib import Path
import time
from typing import NamedTuple

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.tools.files import new_file
from tp_controller.tools.recording.goals import Goal, outcome
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.pictures import command_topic
from tp_controller.tools.recording.robots import command_names
from tp_controller.tools.recording.task_history import STOPPED, TaskHistory
from tp_controller.untrusted import plain

# Largest numbers of causes of a task and of rows of a table.
MOST_CAUSES, MOST_ROWS = 3, 1000
# Longest cell of the summary, and longest parameter [characters].
LONGEST_CELL, LONGEST_VALUE = 200, 500
STYLE = """\
:root { color-scheme: light dark; --line: #8884; --faint: #8882; --bad: #b00020; }
@media (prefers-color-scheme: dark) { :root { --bad: #ff7085; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem;
       padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p.facts { opacity: .75; margin-top: .3rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
div.wide { overflow-x: auto; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0;
         border-bottom: 1px solid var(--line); }
th { font-weight: 600; } td:first-child { white-space: nowrap; }
td.bad, p.bad { color: var(--bad); }
img { max-width: 100%; height: auto; background: white; border-radius: 6px; }
iframe { width: 100%; height: 32rem; border: 1px solid var(--line); border-radius: 6px; }
p.remarks { border-left: 4px solid var(--bad); background: var(--faint);
            padding: .6rem 1rem; }
pre { overflow-x: auto; } summary { cursor: pointer; }
"""


class Cell(NamedTuple):
    """Highlighted cell of a table, for a fault."""

    text: str


Row = Sequence[str | Cell]


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
    parts = [*_head(history, title, remarks),
             *_section('Tasks', ('task', 'type', 'level', 'status', 'last error',
                                 'largest', 'reached', 'limited by'),
                       [_task_row(task) for task in history.tasks.values()]),
             *_frame(replay),
             *_section('Goals', ('time', 'task', 'goal', 'frame', 'outcome'),
                       _goal_rows(history), history.goals.more),
             *_section('Stops', ('time', 'duration', 'reason of zero commands'),
                       [(f'{stop.start:.1f} s', f'{stop.end - stop.start:.1f} s',
                         stop.reason) for stop in history.stops.stops], history.stops.more)]
    for name, plot in plots:
        data = base64.b64encode(plot.read_bytes()).decode()
        parts += [f'<h2>{escape(name)}</h2>',
                  f'<img alt="{escape(name)}" src="data:image/png;base64,{data}">']
    parts += _section('Joints', ('joint', 'positions', 'position limits', 'largest velocity',
                                 'of its limit'), list(_joint_rows(history, robot)))
    parts += _details(history)
    page = ('<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width">'
            f'<title>{_shown(title)}</title><style>{STYLE}</style></head><body>\n'
            + '\n'.join(parts) + '\n</body></html>\n')
    with new_file(path) as file:
        file.write(page.encode())


def _head(history: History, title: str, remarks: Sequence[str]) -> Iterator[str]:
    """Yield the title, the facts and the remarks."""
    began = time.strftime('%Y-%m-%d %H:%M:%S', time.localtime(1e-9 * history.began))
    node = f'/{history.node}' if history.node else 'no controller'
    yield f'<h1>{_shown(title)}</h1>'
    yield (f'<p class="facts">{_shown(node)} · {began} · {history.end:.1f} s · '
           f'{history.counts.total()} messages</p>')
    for remark in remarks:
        yield f'<p class="remarks">{_shown(remark)}</p>'


def _frame(page: str) -> Iterator[str]:
    """Yield an embedded page, unless it is empty."""
    if page:
        yield '<h2>Replay</h2>'
        # The sandbox denies scripts access to anything outside the replay.
        yield ('<iframe title="Replay" loading="lazy" sandbox="allow-scripts" '
               f'srcdoc="{escape(page)}"></iframe>')


def _section(title: str, names: Sequence[str], rows: Sequence[Row],
             more: int = 0) -> Iterator[str]:
    """Yield a title and a table; nothing for an empty table."""
    if not rows:
        return
    yield f'<h2>{title}</h2><div class="wide"><table><tr>'
    yield ''.join(f'<th>{name}</th>' for name in names)
    for row in rows[:MOST_ROWS]:
        yield '</tr><tr>' + ''.join(
            f'<td class="bad">{_shown(cell.text)}</td>' if isinstance(cell, Cell)
            else f'<td>{_shown(cell)}</td>' for cell in row)
    yield '</tr></table></div>'
    more += len(rows[MOST_ROWS:])
    if more:
        yield f'<p>… and {more} more.</p>'


def _task_row(task: TaskHistory, all_errors: bool = True) -> Row:
    """Return the cells of a task."""
    done = task.status in ('reached', 'satisfied')
    share = f'{100.0 * task.reached / task.known:.0f} % of {task.known:.1f} s' \
        if task.known else ''
    causes = ', '.join(
        f'{cause} ({task.causes[cause]:.1f} s)' for cause in sorted(
            task.causes, key=lambda cause: -task.causes[cause])[:MOST_CAUSES])
    causes += ' …' if len(task.causes) > MOST_CAUSES else ''
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
    if math.isnan(error):
        return '-'
    return f'{error:.4g}' + ('' if unit == '1' else f' {unit}')


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


def _details(history: History) -> Iterator[str]:
    """Yield topics and parameters in collapsed sections."""
    yield '<h2>Recording</h2><details><summary>topics</summary>'
    yield from _table((topic, str(count)) for topic, count in sorted(history.counts.items()))
    yield '</details>'
    if history.parameters:
        yield '<details><summary>parameters</summary>'
        yield from _table((name, _brief(value)) for name, value in sorted(
            history.parameters.items()))
        yield '</details>'


def _table(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Yield a table of names and values."""
    yield '<div class="wide"><table>'
    for name, value in islice(rows, MOST_ROWS):
        yield f'<tr><td>{_shown(name)}</td><td>{_shown(value)}</td></tr>'
    yield '</table></div>'


def _shown(text: str) -> str:
    """Return a text as escaped HTML."""
    return escape(plain(text))


def _brief(value: object) -> str:
    """Return a value as text, truncated to `LONGEST_VALUE`."""
    return plain(str(value), LONGEST_VALUE, lines=True)

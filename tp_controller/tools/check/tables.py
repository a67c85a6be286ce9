# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Report of a check as text for a terminal."""

from collections.abc import Iterator, Sequence
import math
from textwrap import wrap

from tp_controller.model.limits import BASE_LIMIT_KEYS
from tp_controller.tools.check.results import (
    CheckReport,
    JUMP,
    POSITION,
    SEVERITIES,
    TaskResult,
    WorstResult,
)

TABLE_COLUMNS = 99
# Prefix of a suggested change.
ARROW = '→ '
# {kind of an extreme: title in a table, and format}
WORST = {**{key: (f'{key} / limit', '{:.1%}') for key in BASE_LIMIT_KEYS},
         POSITION: ('past a limit', '{:.2g}'), JUMP: ('jump / velocity limit', '{:.1%}')}
NO_VALUE = '–'
# Columns with names in them.
NAMES = ('task', 'tasks', 'what', 'joint')

# A title, its columns, its rows.
Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


def text_of(report: CheckReport) -> str:
    """Return a report as text: findings by severity, the worst first, then the tables."""
    lines = [headline(report), '']
    for severity in SEVERITIES:
        found = report.of(severity)
        if not found:
            continue
        lines.append(f'{severity}:')
        for finding in found:
            where = ' '.join(filter(None, (f'[{finding.kind}]', finding.where)))
            lines += wrap(f'{where}: {finding.message}', TABLE_COLUMNS, initial_indent='  - ',
                          subsequent_indent='    ')
            if finding.change:
                lines += wrap(ARROW + finding.change, TABLE_COLUMNS, initial_indent='    ',
                              subsequent_indent='      ')
        lines.append('')
    for title, columns, rows in tables(report):
        lines += [title, *_aligned(columns, rows), '']
    return '\n'.join(lines).rstrip()


def headline(report: CheckReport) -> str:
    """Return the headline of a report: counts of findings, samples and runs."""
    counts = ', '.join(f'{len(report.of(severity))} {severity}' for severity in SEVERITIES[:2])
    if not report.samples:
        return f'{counts}; nothing was tried, because it would be refused'
    ended = ', '.join(f'{how}: {count}' for how, count in report.ended.items() if count)
    return f'{report.robot}, {report.rate:g} Hz: {counts}; {report.samples} samples, ' \
           f'{report.runs} closed loops{f" ({ended})" if ended else ""}, seed {report.seed}'


def tables(report: CheckReport) -> Iterator[Table]:
    """Yield the tables of a report, as texts."""
    if report.levels:
        yield ('rank left by the levels above', (
            'level', 'tasks', 'rank', 'least', 'median', 'most', 'nothing left'), [
            (str(each.number), ', '.join(each.tasks), str(each.rank), str(each.least_left),
             f'{each.median_left:g}', str(each.most_left), f'{each.never:.0%}')
            for each in report.levels])
    if report.pairs:
        yield ('directions that tasks share', ('tasks', 'smallest angle', 'in samples', 'most'), [
            (f'{each.first}, {each.second}', f'{math.degrees(each.median_angle):.0f}°',
             f'{each.shared:.0%}', str(each.directions)) for each in report.pairs])
    bounded = [task for task in report.tasks if task.outside is not None]
    if bounded:
        yield ('inequality tasks', (
            'task', 'level', 'outside', 'active', 'active in loops', 'satisfied', 'possible'),
            list(map(_bounded_row, bounded)))
    others = [task for task in report.tasks if task.outside is None]
    if others:
        yield ('tasks', (
            'task', 'level', 'gain × period', 'singular', 'reached', 'near goals', 'possible',
            'median [s]', 'longest [s]'), list(map(_row, others)))
    if report.worst:
        yield ('extremes of the commands', ('what', 'value', 'joint', 'run'),
               list(map(_worst_row, report.worst)))


def _row(task: TaskResult) -> tuple[str, ...]:
    """Return the row of a task."""
    return (task.name, str(task.level or NO_VALUE), _shown(task.gain_period, '{:.3g}'),
            _shown(task.singular, '{:.0%}'), _share(task.reached, task.possible),
            _share(task.reached_near, task.possible_near), str(task.possible),
            _shown(task.median_seconds, '{:.1f}'), _shown(task.longest_seconds, '{:.1f}'))


def _bounded_row(task: TaskResult) -> tuple[str, ...]:
    """Return the row of an inequality task."""
    return (task.name, str(task.level or NO_VALUE), _shown(task.outside, '{:.0%}'),
            _shown(task.active, '{:.0%}'), _shown(task.active_in_loops, '{:.0%}'),
            _share(task.reached, task.possible), str(task.possible))


def _worst_row(worst: WorstResult) -> tuple[str, ...]:
    """Return the row of an extreme of the commands."""
    title, form = WORST[worst.kind]
    return (title, _shown(worst.value, form), worst.name or NO_VALUE,
            str(worst.run) if worst.run >= 0 else NO_VALUE)


def _shown(value: float | None, form: str) -> str:
    """Return a number as text."""
    return NO_VALUE if value is None else form.format(value)


def _share(part: int, whole: int) -> str:
    """Return a share as text."""
    return f'{part / whole:.0%}' if whole else NO_VALUE


def _aligned(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table."""
    widths = [max(map(len, column)) for column in zip(columns, *rows)]
    for row in (columns, *rows):
        yield '  ' + '  '.join(
            cell.ljust(width) if column in NAMES else cell.rjust(width)
            for column, cell, width in zip(columns, row, widths)).rstrip()

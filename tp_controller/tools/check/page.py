# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Report of a check as one self-contained HTML page."""

from collections.abc import Iterator

from tp_controller.tools.check.results import CheckReport, Finding, SEVERITIES
from tp_controller.tools.check.tables import headline, NAMES, tables
from tp_controller.tools.html_page import Cell, page, shown, table


def page_of(report: CheckReport) -> str:
    """Return a report as the text of an HTML file."""
    return page(f'tp_controller check: {report.robot or "refused"}', headline(report),
                _body(report))


def _body(report: CheckReport) -> Iterator[str]:
    """Yield the findings and the tables."""
    for severity in SEVERITIES:
        found = report.of(severity)
        if found:
            yield f'<h2>{severity.capitalize()}</h2><ul>'
            yield from map(_finding, found)
            yield '</ul>'
    for title, columns, rows in tables(report):
        yield from table(title[0].upper() + title[1:], list(map(_cell, columns, columns)),
                         [list(map(_cell, columns, row)) for row in rows])


def _finding(finding: Finding) -> str:
    """Return one finding as an item of a list."""
    where = f'<b>{shown(finding.where)}</b>' if finding.where else ''
    change = f'<br><span class="change">→ {shown(finding.change)}</span>' if finding.change else ''
    return f'<li class="{finding.severity}">[{finding.kind}] {where}: ' \
           f'{shown(finding.message)}{change}</li>'


def _cell(column: str, text: str) -> str | Cell:
    """Return a cell; a share has a bar behind it."""
    if column in NAMES:
        return text
    return Cell(text, 'number', min(float(text[:-1]), 100.0) if text.endswith('%') else None)

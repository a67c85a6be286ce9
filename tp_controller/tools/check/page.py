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

"""Report of a check as one self-contained HTML page."""

from collections.abc import Iterator
from html import escape

from tp_controller.tools.check.results import CheckReport, DOUBTFUL, Finding, SEVERITIES, WRONG
from tp_controller.tools.check.tables import headline, NAMES, Table, tables

TITLES = {WRONG: 'Wrong', DOUBTFUL: 'Doubtful'}
STYLE = """
:root { color-scheme: light dark; --line: #8884; --wrong: #c62828; --doubtful: #b26a00;
  --fine: #2e7d32; }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 68rem; margin: 2rem auto;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; }
h2 { font-size: 1.1rem; margin-top: 2rem; }
li { margin: .6rem 0; padding-left: .8rem; border-left: 4px solid var(--line); }
ul { list-style: none; padding: 0; }
.wrong { border-color: var(--wrong); } .doubtful { border-color: var(--doubtful); }
.fine { border-color: var(--fine); }
.change { opacity: .75; }
table { border-collapse: collapse; }
th, td { padding: .25rem .8rem; border-bottom: 1px solid var(--line); text-align: right; }
.name { text-align: left; }
.table { overflow-x: auto; }
.share { background: linear-gradient(90deg, #4488ff44 var(--part), transparent 0); }
"""


def page_of(report: CheckReport) -> str:
    """Return a report as the text of an HTML file."""
    title = f'tp_controller check: {report.robot or "refused"}'
    return '\n'.join((
        '<!DOCTYPE html>', '<html lang="en">', '<head>', '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">', f'<title>{escape(title)}</title>',
        f'<style>{STYLE}</style>', '</head>', '<body>', f'<h1>{escape(title)}</h1>',
        f'<p>{escape(headline(report))}</p>', *_body(report), '</body>', '</html>', ''))


def _body(report: CheckReport) -> Iterator[str]:
    """Yield the findings and the tables."""
    for severity in SEVERITIES:
        found = report.of(severity)
        if found:
            yield f'<h2>{TITLES.get(severity, "Fine")}</h2>'
            yield '<ul>'
            yield from map(_finding, found)
            yield '</ul>'
    for table in tables(report):
        yield from _table(table)


def _finding(finding: Finding) -> str:
    """Return one finding as an item of a list."""
    where = f'<b>{escape(finding.where)}</b>: ' if finding.where else ''
    change = f'<br><span class="change">→ {escape(finding.change)}</span>' if finding.change \
        else ''
    return f'<li class="{finding.severity}">{where}{escape(finding.message)}{change}</li>'


def _table(table: Table) -> Iterator[str]:
    """Yield a table."""
    title, columns, rows = table
    yield f'<h2>{escape(title[0].upper() + title[1:])}</h2>'
    yield '<div class="table"><table>'
    named = [' class="name"' if column in NAMES else '' for column in columns]
    yield '<tr>' + ''.join(f'<th{name}>{escape(column)}</th>'
                           for name, column in zip(named, columns)) + '</tr>'
    for row in rows:
        yield '<tr>' + ''.join(map(_cell, row, named)) + '</tr>'
    yield '</table></div>'


def _cell(text: str, name: str) -> str:
    """Return a cell; a share has a bar behind it."""
    if not text.endswith('%'):
        return f'<td{name}>{escape(text)}</td>'
    part = min(float(text[:-1]), 100.0)
    return f'<td class="share" style="--part: {part:g}%">{escape(text)}</td>'

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Self-contained HTML pages of text and tables."""

from collections.abc import Iterable, Iterator, Sequence
from html import escape
from string import Template
from typing import NamedTuple

from tp_controller.untrusted.texts import plain

# Largest number of rows of a table; more are counted.
MOST_ROWS = 1000
PAGE = Template("""\
<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>$title</title><style>
:root { color-scheme: light dark; --line: #8884; --faint: #8882; --bad: #b00020;
  --doubtful: #b26a00; --fine: #2e7d32; }
@media (prefers-color-scheme: dark) { :root { --bad: #ff7085; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem;
  padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
.facts, .change { opacity: .75; } .facts { margin-top: .3rem; }
ul { list-style: none; padding: 0; }
li { margin: .6rem 0; padding-left: .8rem; border-left: 4px solid var(--line); }
li.wrong { border-color: var(--bad); } li.doubtful { border-color: var(--doubtful); }
li.fine { border-color: var(--fine); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
div.wide { overflow-x: auto; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; } td:first-child { white-space: nowrap; }
th:first-child, td:first-child { padding-left: 0; }
.bad { color: var(--bad); } .number { text-align: right; }
td[style] { background: linear-gradient(90deg, #4488ff44 var(--share), transparent 0); }
img { max-width: 100%; height: auto; background: white; border-radius: 6px; }
iframe { width: 100%; height: 32rem; border: 1px solid var(--line); border-radius: 6px; }
.remarks { border-left: 4px solid var(--bad); background: var(--faint); padding: .6rem 1rem; }
pre { overflow-x: auto; } summary { cursor: pointer; }
</style></head><body>
<h1>$title</h1>
<p class="facts">$facts</p>
$body
</body></html>
""")


class Cell(NamedTuple):
    """
    Cell of a table with a class of the style.

    Attributes
    ----------
    text : str
    kind : str
        ``bad`` for a fault, or ``number``.
    share : float or None
        Length of the bar behind the text [%].

    """

    text: str
    kind: str = 'bad'
    share: float | None = None


Row = Sequence[str | Cell]


def page(title: str, facts: str, parts: Iterable[str]) -> str:
    """Return a page with a title, a line of facts and a body of HTML."""
    return PAGE.substitute(title=shown(title), facts=shown(facts), body='\n'.join(parts))


def table(title: str, names: Row, rows: Sequence[Row], more: int = 0) -> Iterator[str]:
    """Yield a table below its title, and the number of rows left out; nothing without rows."""
    if not rows:
        return
    if title:
        yield f'<h2>{shown(title)}</h2>'
    yield '<div class="wide"><table>'
    if names:
        yield _row('th', names)
    yield from (_row('td', row) for row in rows[:MOST_ROWS])
    yield '</table></div>'
    more += len(rows[MOST_ROWS:])
    if more:
        yield f'<p>… and {more} more.</p>'


def shown(text: str) -> str:
    """Return a text as escaped HTML."""
    return escape(plain(text))


def _row(tag: str, cells: Row) -> str:
    """Return a row of a table."""
    row = ''
    for cell in cells:
        text, kind, share = cell if isinstance(cell, Cell) else (cell, '', None)
        row += f'<{tag}' + (f' class="{kind}"' if kind else '') + (
            '' if share is None else f' style="--share: {share:g}%"') + f'>{shown(text)}</{tag}>'
    return f'<tr>{row}</tr>'

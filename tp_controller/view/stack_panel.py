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

"""The stack on the page: a row for each task, in order of priority, with what changes it."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
import math
import time
from typing import TypeVar

from tp_controller.view.rows import Row
import viser

# By status: of the dot before the name of a task.
COLOURS = {'reached': '#2e9e5b', 'satisfied': '#2e9e5b', 'moving': '#2f7fd1',
           'limited': '#e08a00', 'failed': '#c62828', 'stopped': '#8a8f98',
           'disabled': '#b8bec6'}
DONE = ('reached', 'satisfied')
UP, DOWN = '▲ up', '▼ down'
GAIN = 'gain'
# For how long what somebody has chosen is shown, whatever the status says [s].
PATIENCE = 1.0

Value = TypeVar('Value')
Gain = float | list[float]


class StackPanel:
    """
    The rows of the tasks.

    Parameters
    ----------
    gui : viser.GuiApi
    enable : callable
        Told the name of a task, and whether it is to be in the stack.
    move : callable
        Told the name of a task, and by how many places it is to move: -1 is up.
    set_gain : callable
        Told the name of a task, and its gain: one number, or a list with one for each row.

    Attributes
    ----------
    rows : dict
        {task: TaskRow}

    """

    def __init__(self, gui: viser.GuiApi, enable: Callable[[str, bool], None],
                 move: Callable[[str, int], None],
                 set_gain: Callable[[str, Gain], None]) -> None:
        self._gui, self._enable, self._move, self._set_gain = gui, enable, move, set_gain
        self._folder = gui.add_folder(None)
        self.rows: dict[str, TaskRow] = {}

    def show(self, rows: Sequence[Row], gains: Mapping[str, Gain]) -> None:
        """
        Show the tasks.

        Parameters
        ----------
        rows : list of Row
            By priority.
        gains : dict
            {task: gain} of those that have one.

        """
        names = [row.name for row in rows]
        for name in [name for name in self.rows if name not in names]:
            self.rows.pop(name).remove()
        for place, row in enumerate(rows):
            if row.name not in self.rows:
                self.rows[row.name] = TaskRow(self._gui, self._folder, row, self._enable,
                                              self._move, self._set_gain)
            self.rows[row.name].show(row, place, gains.get(row.name))


class TaskRow:
    """
    The row of a task.

    Attributes
    ----------
    folder : viser.GuiFolderHandle
        Its label begins with the place in the order.
    text : viser.GuiHtmlHandle
        Error, share achieved and cause.
    enabled : viser.GuiCheckboxHandle
    order : viser.GuiButtonGroupHandle
        Two buttons.
    gains : list of viser.GuiNumberHandle
        One, or one for each row of the task, as the gain has it.

    """

    def __init__(self, gui: viser.GuiApi, parent: viser.GuiFolderHandle, row: Row,
                 enable: Callable[[str, bool], None], move: Callable[[str, int], None],
                 set_gain: Callable[[str, Gain], None]) -> None:
        self._gui, self._name, self._set_gain = gui, row.name, set_gain
        self._chosen = {'enabled': -math.inf, 'gain': -math.inf}
        self._content = self._label = ''
        self._place = -1
        with parent:
            self.folder = gui.add_folder(row.name)
        with self.folder:
            self.text = gui.add_html('', order=0.0)
            self.enabled = gui.add_checkbox('enabled', row.enabled, order=2.0)
            self.order = gui.add_button_group('priority', (UP, DOWN), order=1.0)
        self._inputs: viser.GuiFolderHandle | None = None
        self._by_row = False
        self.gains: list[viser.GuiNumberHandle[float]] = []

        @self.enabled.on_update
        def _(event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
            if event.client_id is not None:
                self._chosen['enabled'] = time.monotonic()
                enable(self._name, event.target.value)

        @self.order.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            move(self._name, -1 if event.target.value == UP else 1)

    def show(self, row: Row, place: int, gain: Gain | None) -> None:
        """Show what is known of the task."""
        label = f'{place + 1} · {row.name}  ({row.kind})'
        if label != self._label:
            self._label = self.folder.label = label
        if place != self._place:
            self._place, self.folder.order = place, float(place)
        content = row_html(row)
        if content != self._content:
            self._content = self.text.content = content
        if self._settled('enabled') and self.enabled.value != row.enabled:
            assign(self.enabled, row.enabled)
        self._show_gain(gain)

    def remove(self) -> None:
        """Take the row away."""
        self.folder.remove()

    def _settled(self, what: str) -> bool:
        """Say whether nobody has chosen something a moment ago."""
        return time.monotonic() - self._chosen[what] > PATIENCE

    def _show_gain(self, gain: Gain | None) -> None:
        """Show a gain, with inputs for its numbers."""
        values = gain if isinstance(gain, list) else [] if gain is None else [gain]
        by_row = isinstance(gain, list)
        if len(values) != len(self.gains) or by_row != self._by_row:
            self._by_row = by_row
            self._build_gains(values)
        elif self._settled('gain'):
            for handle, value in zip(self.gains, values):
                if handle.value != value:
                    assign(handle, value)

    def _build_gains(self, values: Sequence[float]) -> None:
        """Have other inputs for the gain; those of rows are in a folder that is closed."""
        if self._inputs is not None:
            self._inputs.remove()
        with self.folder:
            self._inputs = self._gui.add_folder(GAIN if self._by_row else None, order=3.0,
                                                expand_by_default=False)
        with self._inputs:
            self.gains = [self._gui.add_number(
                f'row {number}' if self._by_row else GAIN, value, min=0.0, step=0.1, hint='1/s')
                for number, value in enumerate(values, 1)]
        for handle in self.gains:
            handle.on_update(self._on_gain)

    def _on_gain(self, event: viser.GuiEvent[viser.GuiNumberHandle[float]]) -> None:
        """Take a gain that somebody has chosen."""
        if event.client_id is not None:
            self._chosen['gain'] = time.monotonic()
            values = [float(handle.value) for handle in self.gains]
            self._set_gain(self._name, values if self._by_row else values[0])


def assign(handle: viser.GuiInputHandle[Value], value: Value) -> None:
    """Give an input another value."""
    # mypy sees no setter that does not stand right below its getter.
    handle.value = value  # type: ignore[misc]


def row_html(row: Row) -> str:
    """Return error, share achieved and cause of a task, with its status as a colour."""
    colour = COLOURS.get(row.status, '#8a8f98')
    lines = [f'<div style="display:flex;justify-content:space-between">'
             f'<span><span style="color:{colour}">●</span> {escape(row.status)}</span>'
             f'<b>{escape(row.error_text())}</b></div>']
    if not math.isnan(row.share) and row.status not in DONE:
        percent = round(100.0 * row.share)
        lines.append(
            '<div style="display:flex;align-items:center;gap:6px">'
            '<div style="flex:1;height:6px;border-radius:3px;background:#dfe3e8">'
            f'<div style="width:{percent}%;height:6px;border-radius:3px;background:{colour}">'
            f'</div></div><span style="width:3em;text-align:right">{percent} %</span></div>')
    lines += [f'<div style="color:#5b6470">{escape(text)}</div>'
              for text in (row.reason, row.hint) if text]
    if row.warning:
        lines.append(f'<div style="color:#e08a00">goal: {escape(row.warning)}</div>')
    if row.refusal:
        lines.append(f'<div style="color:#c62828">last refusal: {escape(row.refusal)}</div>')
    return (f'<div data-task="{escape(row.name)}" data-status="{escape(row.status)}" '
            f'style="padding:2px 12px 4px;font-size:0.85em;line-height:1.35">{"".join(lines)}'
            '</div>')

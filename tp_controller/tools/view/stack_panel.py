# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Stack on the page: a row for each task, in order of priority, with its controls."""

from collections.abc import Callable, Mapping, Sequence
from html import escape
import math
import time
from typing import TypeVar

from tp_controller.control.reason_text import causes_in
from tp_controller.ros.client.status import DONE, STOPPED, TaskStatus
from tp_controller.tools.view.status import error_text, FAINT
import viser

# Colour of the dot before the name of a task, by status.
STATUS_COLOURS = {'reached': '#2e9e5b', 'satisfied': '#2e9e5b', 'moving': '#2f7fd1',
                  'limited': '#e08a00', 'failed': '#c62828', STOPPED: FAINT,
                  'disabled': '#b8bec6'}
UP, DOWN = '▲ up', '▼ down'
GAIN = 'gain'
# Digits of a gain.
GAIN_DIGITS = 6
# Time for which user input takes precedence over the status [s].
INPUT_SECONDS = 1.0

Value = TypeVar('Value')
Gain = float | list[float]


class StackPanel:
    """
    Rows of the tasks.

    Parameters
    ----------
    gui : viser.GuiApi
    enable : callable
        Called with the name of a task, and whether to enable it.
    move : callable
        Called with the name of a task, and the number of places to move it: -1 is up.
    set_gain : callable
        Called with the name of a task, and its gain: one number, or a list with one per row.

    Attributes
    ----------
    rows : dict
        {task: TaskRow}; the rows of removed tasks are hidden and reused, since a slow browser
        may still have updates of them.

    """

    def __init__(self, gui: viser.GuiApi, enable: Callable[[str, bool], None],
                 move: Callable[[str, int], None],
                 set_gain: Callable[[str, Gain], None]) -> None:
        self._gui, self._enable, self._move, self._set_gain = gui, enable, move, set_gain
        self._folder = gui.add_folder(None)
        self.rows: dict[str, TaskRow] = {}
        self._unused: list[TaskRow] = []

    def show(self, rows: Sequence[TaskStatus], gains: Mapping[str, Gain],
             present: bool = True) -> None:
        """
        Show the tasks; while the robot is stopped, show their last state in grey.

        Parameters
        ----------
        rows : list of TaskStatus
            Rows by priority.
        gains : dict
            {task: gain} of the tasks with a gain.
        present : bool
            Whether the controller is present; if not, its last status is shown.

        """
        names = [row.name for row in rows]
        for name in [name for name in self.rows if name not in names]:
            self._unused.append(self.rows.pop(name))
        for place, row in enumerate(rows):
            if row.name not in self.rows:
                self.rows[row.name] = self._unused.pop() if self._unused else TaskRow(
                    self._gui, self._folder, self._enable, self._move, self._set_gain)
            self.rows[row.name].show(row, place, gains.get(row.name), present)
        for unused in self._unused:
            unused.folder.visible = False


class TaskRow:
    """
    Row of a task; it can be reused for another one.

    Attributes
    ----------
    folder : viser.GuiFolderHandle
        Folder whose label begins with the place in the order.
    text : viser.GuiHtmlHandle
        Error, achieved share and cause.
    enabled : viser.GuiCheckboxHandle
    order : viser.GuiButtonGroupHandle
        Two buttons.

    """

    def __init__(self, gui: viser.GuiApi, parent: viser.GuiFolderHandle,
                 enable: Callable[[str, bool], None], move: Callable[[str, int], None],
                 set_gain: Callable[[str, Gain], None]) -> None:
        self._name, self._set_gain = '', set_gain
        self._report: TaskStatus | None = None
        self._chosen = {'enabled': -math.inf, 'gain': -math.inf}
        with parent:
            self.folder = gui.add_folder('')
        with self.folder:
            self.text = gui.add_html('', order=0.0)
            self.enabled = gui.add_checkbox('enabled', True, order=2.0)
            self.order = gui.add_button_group('priority', (UP, DOWN), order=1.0)
        self._gain = GainInputs(gui, self.folder, None, self._on_gain)
        self._gain_by_row = GainInputs(gui, self.folder, GAIN, self._on_gain)

        @self.enabled.on_update
        def _(event: viser.GuiEvent[viser.GuiCheckboxHandle]) -> None:
            if event.client_id is not None:
                self._chosen['enabled'] = time.monotonic()
                enable(self._name, event.target.value)

        @self.order.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            move(self._name, -1 if event.target.value == UP else 1)

    @property
    def gains(self) -> 'list[viser.GuiNumberHandle[float]]':
        """Return the inputs of the gain: one, or one for each row of the task."""
        return self._gain.shown or self._gain_by_row.shown

    def show(self, row: TaskStatus, place: int, gain: Gain | None, present: bool = True) -> None:
        """Show the state of a task."""
        if row.name != self._name:
            self._name, self._report = row.name, None
            self._chosen = dict.fromkeys(self._chosen, -math.inf)
        self.folder.label = f'{place + 1} · {row.name}  ({row.kind})'
        self.folder.order = float(place)
        self.folder.visible = True
        if row.status != STOPPED:
            self._report = row
        stopped = row.status == STOPPED or not present
        self.text.content = row_html(self._report if stopped and self._report else row, stopped)
        if self._settled('enabled'):
            assign(self.enabled, row.enabled)
        if self._settled('gain'):
            self._gain_by_row.show(gain if isinstance(gain, list) else [])
            self._gain.show([gain] if isinstance(gain, float) else [])

    def _settled(self, what: str) -> bool:
        """Return whether the last user input is older than `INPUT_SECONDS`."""
        return time.monotonic() - self._chosen[what] > INPUT_SECONDS

    def _on_gain(self, event: viser.GuiEvent[viser.GuiNumberHandle[float]]) -> None:
        """Set a gain that a user has entered."""
        if event.client_id is not None:
            self._chosen['gain'] = time.monotonic()
            values = [float(handle.value) for handle in self.gains]
            self._set_gain(self._name, values if self._gain_by_row.shown else values[0])


class GainInputs:
    """
    Inputs of the numbers of a gain.

    Parameters
    ----------
    gui : viser.GuiApi
    parent : viser.GuiFolderHandle
    label : str or None
        Label of a closed folder of inputs by row; None: a single input without a folder.
    on_update : callable
        Called with the event of an input.

    Attributes
    ----------
    shown : list of viser.GuiNumberHandle

    """

    def __init__(self, gui: viser.GuiApi, parent: viser.GuiFolderHandle, label: str | None,
                 on_update: Callable[[viser.GuiEvent[viser.GuiNumberHandle[float]]], None]
                 ) -> None:
        self._gui, self._label, self._on_update = gui, label, on_update
        with parent:
            self._folder = gui.add_folder(label, order=3.0, expand_by_default=False,
                                          visible=False)
        self._all: list[viser.GuiNumberHandle[float]] = []
        self.shown: list[viser.GuiNumberHandle[float]] = []

    def show(self, values: Sequence[float]) -> None:
        """Show an input for each value."""
        with self._folder:
            while len(self._all) < len(values):
                self._all.append(self._new_input(len(self._all) + 1))
        for handle, value in zip(self._all, values):
            assign(handle, value)
        for number, handle in enumerate(self._all):
            handle.visible = number < len(values)
        self._folder.visible = bool(values)
        self.shown = self._all[:len(values)]

    def _new_input(self, number: int) -> 'viser.GuiNumberHandle[float]':
        """Return a new input."""
        handle = self._gui.add_number(f'row {number}' if self._label else GAIN, 0.0, min=0.0,
                                      step=0.1, hint='1/s')
        handle.precision = GAIN_DIGITS
        handle.on_update(self._on_update)
        return handle


def assign(handle: viser.GuiInputHandle[Value], value: Value) -> None:
    """Set the value of an input."""
    # mypy only recognizes a setter directly below its getter.
    handle.value = value  # type: ignore[misc]


def row_html(row: TaskStatus, stopped: bool = False) -> str:
    """Return the status, error, achieved share and cause of a task as HTML, grey while stopped."""
    colour = STATUS_COLOURS.get(row.status, FAINT)
    before = ' before' if stopped and row.status != STOPPED else ''
    lines = [f'<div style="display:flex;justify-content:space-between">'
             f'<span><span style="color:{colour}">●</span> {escape(row.status)}{before}</span>'
             f'<b>{escape(error_text(row))}</b></div>']
    if not math.isnan(row.share) and row.status not in DONE:
        percent = round(100.0 * row.share)
        lines.append(
            '<div style="display:flex;align-items:center;gap:6px">'
            '<div style="flex:1;height:6px;border-radius:3px;background:#dfe3e8">'
            f'<div style="width:{percent}%;height:6px;border-radius:3px;background:{colour}">'
            f'</div></div><span style="width:3em;text-align:right">{percent} %</span></div>')
    lines += [f'<div style="color:#5b6470">{escape(text)}</div>'
              for text in (row.way, *causes_in(row.reason), row.hint) if text]
    if row.warnings:
        warnings = escape('; '.join(row.warnings))
        lines.append(f'<div style="color:#e08a00">goal: {warnings}</div>')
    if row.refusal:
        lines.append(f'<div style="color:#c62828">last refusal: {escape(row.refusal)}</div>')
    status, faint = (STOPPED, 'opacity:0.55;filter:grayscale(1);') if stopped else (row.status, '')
    return (f'<div data-task="{escape(row.name)}" data-status="{escape(status)}" '
            f'style="{faint}padding:2px 12px 4px;font-size:0.85em;line-height:1.35">'
            f'{"".join(lines)}</div>')

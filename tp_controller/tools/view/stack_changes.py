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

"""Edits of the stack of a controller through its parameter."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tp_controller.errors import TpControllerError
from tp_controller.ros.parameters import TASKS
from tp_controller.tools.view.draggables import Numbers
from tp_controller.tools.view.link import Link, OnAnswer
from tp_controller.tools.view.stack_text import moved, numbers, stack_text, with_number


class StackChanges:
    """
    Editor of the text of a stack, one request at a time; goals, gains and tolerances stay.

    Edits during a pending request are combined, and only the last value of a key counts.

    Parameters
    ----------
    link : Link
    tell : callable
        Called with the success of a change and the reason of a failure.

    Attributes
    ----------
    numbers : dict
        {task: {key: number}}; empty if the text of the stack is not available.

    """

    def __init__(self, link: Link, tell: OnAnswer) -> None:
        self._link, self._tell = link, tell
        self._edits: dict[object, Callable[[str], str]] = {}
        self._busy = False
        self._read: object = None
        self.numbers: Numbers = {}

    def move(self, task: str, step: int) -> None:
        """Move the level of a task in the order: -1 is one up."""
        self._edits[object()] = partial(moved, task=task, step=step)

    def set_key(self, task: str, key: str, value: float) -> None:
        """Set the value of a key of a task."""
        self._edits[task, key] = partial(with_number, task=task, key=key, value=value)

    def update(self) -> None:
        """Send the pending edits, unless a request is pending."""
        if not self._edits or self._busy:
            return
        edits, self._edits = self._edits, {}
        try:
            before = text = self._text()
            for edit in edits.values():
                text = edit(text)
        except TpControllerError as error:
            self._tell(False, str(error))
            return
        if text != before:
            self._busy = True
            # A new stack resets the gains and tolerances to those in its text.
            given = {name: value for name, value in self._link.values.items()
                     if name.startswith(TASKS)}
            self._link.set_parameters({'stack': text}, partial(self._changed, given))

    def read(self) -> None:
        """Read the stack of the controller if its parameters were refreshed."""
        if self._link.values is self._read:
            return
        self._read = self._link.values
        try:
            self.numbers = numbers(self._text())
        except TpControllerError:
            self.numbers = {}

    def _text(self) -> str:
        """Return the text of the stack; raise `TpControllerError` if it is not available."""
        return stack_text(str(self._link.values.get('stack', '')))

    def _changed(self, given: dict[str, Any], worked: bool, reason: str) -> None:
        """Process the response, and restore the parameters of the tasks."""
        self._tell(worked, reason)
        if worked and given:
            self._link.set_parameters(given, self._restored)
        else:
            self._busy = False

    def _restored(self, worked: bool, reason: str) -> None:
        """Process the response of the restoration."""
        self._busy = False
        self._tell(worked, reason)

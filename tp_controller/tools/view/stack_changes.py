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

"""Changes that the page makes to the stack of a controller, through its parameter."""

from collections.abc import Callable
from functools import partial
from typing import Any

from tp_controller.errors import TpControllerError
from tp_controller.ros.parameters import TASKS
from tp_controller.tools.view.draggables import Numbers
from tp_controller.tools.view.link import Link, Told
from tp_controller.tools.view.stack_text import moved, numbers, stack_text, with_number


class StackChanges:
    """
    Changes the text of a stack, one request at a time; goals, gains and tolerances stay.

    What comes while the controller still reads a stack is put together, and of the numbers of a
    key only the last one counts.

    Parameters
    ----------
    link : Link
    tell : callable
        Told whether a change worked, and why not.

    Attributes
    ----------
    numbers : dict
        {task: {key: number}}; empty where the text of the stack is not at hand.

    """

    def __init__(self, link: Link, tell: Told) -> None:
        self._link, self._tell = link, tell
        self._edits: dict[object, Callable[[str], str]] = {}
        self._busy = False
        self._read: object = None
        self.numbers: Numbers = {}

    def move(self, task: str, step: int) -> None:
        """Give the level of a task another place in the order: -1 is one up."""
        self._edits[object()] = partial(moved, task=task, step=step)

    def set_key(self, task: str, key: str, value: float) -> None:
        """Give a key of a task another value."""
        self._edits[task, key] = partial(with_number, task=task, key=key, value=value)

    def update(self) -> None:
        """Have the controller change what is to be changed, unless it has not answered yet."""
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
            # A stack comes with the gains and tolerances that it was written with.
            given = {name: value for name, value in self._link.values.items()
                     if name.startswith(TASKS)}
            self._link.set_parameters({'stack': text}, partial(self._changed, given))

    def read(self) -> None:
        """Read the stack that the controller has, if its parameters came again."""
        if self._link.values is self._read:
            return
        self._read = self._link.values
        try:
            self.numbers = numbers(self._text())
        except TpControllerError:
            self.numbers = {}

    def _text(self) -> str:
        """Return the text of the stack; `TpControllerError` where it is not at hand."""
        return stack_text(str(self._link.values.get('stack', '')))

    def _changed(self, given: dict[str, Any], worked: bool, reason: str) -> None:
        """Take the answer, and set the parameters of the tasks again."""
        self._tell(worked, reason)
        if worked and given:
            self._link.set_parameters(given, self._restored)
        else:
            self._busy = False

    def _restored(self, worked: bool, reason: str) -> None:
        """Take the answer to that."""
        self._busy = False
        self._tell(worked, reason)

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

"""The base of all errors of the package, and what the solver raises; `tp_controller.errors`."""

import difflib
from typing import Iterable

# What messages show [characters].
LONGEST_MESSAGE, LONGEST_NAME = 10_000, 200


class TpControllerError(Exception):
    """Base of all errors raised by this package."""

    def __str__(self) -> str:
        """Return the message, cut where it quotes at length what was given."""
        text = super().__str__()
        return text if len(text) <= LONGEST_MESSAGE else f'{text[:LONGEST_MESSAGE]} …'


class SolverError(TpControllerError):
    """The levels, bounds or weights handed to the solver do not fit together."""


def unknown(what: str, name: object, valid: Iterable[str]) -> str:
    """Return a message that says what is unknown, what was meant perhaps, and what is valid."""
    valid = list(valid)
    return f'unknown {what} {suggestion(name, valid)}; valid: {", ".join(valid) or "none"}'


def suggestion(name: object, valid: Iterable[str]) -> str:
    """Return a name in quotes, with the valid name that was meant perhaps."""
    shown = repr(name)
    if len(shown) > LONGEST_NAME:
        # No name: to compare it with all valid ones would take seconds.
        return f'{shown[:LONGEST_NAME]} …'
    # What is there, and cannot be used all the same, is not what was meant instead.
    others = [each for each in valid if each != name]
    near = difflib.get_close_matches(str(name), others, n=1)
    return shown + (f' (did you mean {near[0]!r}?)' if near else '')

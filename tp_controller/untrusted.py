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
"""Untrusted texts and numbers: from messages, recordings and browsers."""

from collections.abc import Mapping
import math

# Longest text that is shown [characters].
LONGEST_TEXT = 2000
REPLACEMENT = '\ufffd'
ELLIPSIS = ' …'
# Beginning of the key of an error in a status: ``error [<unit>]``.
ERROR_KEY = 'error ['
# Largest number of errors of a task.
MOST_TASK_ERRORS = 8


def plain(text: str, longest: int = LONGEST_TEXT, *, lines: bool = False) -> str:
    """
    Return a text without control characters, for terminals, pages and plots.

    Control characters, direction overrides, invisible characters and halves of characters are
    replaced by U+FFFD, other spaces by a space.

    Parameters
    ----------
    text : str
        Any text.
    longest : int
        Longer texts are truncated [characters].
    lines : bool
        Whether line feeds are kept.

    """
    if len(text) > longest:
        text = text[:longest] + ELLIPSIS
    if text.isprintable():
        return text
    return ''.join(character if character.isprintable() or (lines and character == '\n')
                   else ' ' if character.isspace() and character not in CURSOR_SPACES
                   else REPLACEMENT for character in text)


# Spaces that move a cursor.
CURSOR_SPACES = '\n\r\v\f\x1c\x1d\x1e\x1f\x85\u2028\u2029'


def number(text: str) -> float:
    """Return the number in a text; NaN if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def count(text: str) -> int:
    """Return the count in a text; 0 if it is not an integer."""
    try:
        return max(int(text), 0)
    except ValueError:
        return 0


def errors_of(values: Mapping[str, str]) -> dict[str, float]:
    """Return {unit: error} of the status of a task, given as {key: value}."""
    errors = [(key[len(ERROR_KEY):-1], number(value)) for key, value in values.items()
              if key.startswith(ERROR_KEY)]
    return dict(errors[:MOST_TASK_ERRORS])

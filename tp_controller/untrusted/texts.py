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
"""Untrusted texts: from messages, recordings and browsers."""

# Longest text that is shown [characters].
LONGEST_TEXT = 2000
REPLACEMENT = '\ufffd'
ELLIPSIS = ' …'


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

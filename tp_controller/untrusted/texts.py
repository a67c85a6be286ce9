# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
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

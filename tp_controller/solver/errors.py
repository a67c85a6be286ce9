# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Base of all errors of the package, and the error of the solver; see `tp_controller.errors`."""

import difflib
from typing import Iterable

# Longest message, and longest name that a message quotes [characters].
LONGEST_ERROR_TEXT, LONGEST_QUOTE = 10_000, 200


class TpControllerError(Exception):
    """Base of all errors raised by this package."""

    def __str__(self) -> str:
        """Return the message, truncated if it quotes a long input."""
        text = super().__str__()
        return text if len(text) <= LONGEST_ERROR_TEXT else f'{text[:LONGEST_ERROR_TEXT]} …'


class SolverError(TpControllerError):
    """Invalid or inconsistent levels, bounds, weights or options of the solver."""


def unknown(what: str, name: object, valid: Iterable[str]) -> str:
    """Return a message with the unknown name, a similar valid name, and all valid names."""
    valid = list(valid)
    return f'unknown {what} {suggestion(name, valid)}; valid: {", ".join(valid) or "none"}'


def suggestion(name: object, valid: Iterable[str]) -> str:
    """Return a name in quotes, with a similar valid name if there is one."""
    shown = repr(name)
    if len(shown) > LONGEST_QUOTE:
        # Too long for a name: the comparison with all valid names would take seconds.
        return f'{shown[:LONGEST_QUOTE]} …'
    # Do not suggest the name itself: it can be valid, yet not usable here.
    others = [each for each in valid if each != name]
    near = difflib.get_close_matches(str(name), others, n=1)
    return shown + (f' (did you mean {near[0]!r}?)' if near else '')

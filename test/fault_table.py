# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Declarations of faults and their outcomes: asserted by the tests, printed in docs/safety.md.

Where a test is about several faults, the declarations are the very values that it asserts.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

AT_ONCE, RAMPED, NOTHING = 'zeros at once', 'a ramped stop', 'nothing is published'
BRAKING = 'braking, then the last positions'
BY_ITSELF, START = 'by itself', '`~/start`'


@dataclass(frozen=True)
class Outcome:
    """
    What comes of a fault, with default parameters.

    Attributes
    ----------
    fault : str
        What goes wrong.
    result : str
        What velocities are commanded then.
    ends : str
        What ends it.
    told : str
        Part of the reason in the status.
    within : float
        Time in which it is noticed [s]; infinite where that depends on other nodes.
    positions : str
        What positions are commanded then, if not `BRAKING` in place of zeros at once, and the
        last positions after a ramped stop.

    """

    fault: str
    result: str
    ends: str
    told: str
    within: float
    positions: str = ''

    @property
    def commanded(self) -> str:
        """Return the cell of the table with both."""
        return '; '.join(filter(None, (
            self.result, self.positions and f'with positions: {self.positions}')))


# By area of docs/safety.md, with the tests.
TABLE: dict[str, list[tuple[Outcome, str]]] = {}


def outcomes(area: str, declared: Iterable[Outcome]) -> Callable[[Callable], Callable]:
    """Declare the outcomes that a test asserts."""
    declared = list(declared)

    def note(test: Callable) -> Callable:
        TABLE.setdefault(area, []).extend((each, test.__name__) for each in declared)
        return test

    return note


def fault_text(text: str) -> Callable[[Callable], Callable]:
    """Describe a function that causes a fault, as in a row of the table."""
    def note(function: Callable) -> Callable:
        function.text = text
        return function

    return note

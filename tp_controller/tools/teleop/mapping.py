# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Mapping of the axes and buttons of a device to a twist."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import re
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]
# Components of a twist, linear then angular.
DIRECTIONS = ('x', 'y', 'z', 'rx', 'ry', 'rz')
TERM = re.compile(r'\s*([+-]?)\s*(axis|button)\s+(\d{1,3})\s*')
# Value from which an input that is a switch counts as pressed.
PRESSED = 0.5


class Term(NamedTuple):
    """Signed axis or button of a device, by its number from 0."""

    sign: float
    kind: str
    number: int


class Source:
    """
    Signed sum of axes and buttons of a device.

    Parameters
    ----------
    text : str
        Such as ``axis 1``, ``-axis 0`` or ``button 14 - button 13``; empty for none.

    Raises
    ------
    ValueError
        It is not such a sum.

    """

    def __init__(self, text: str) -> None:
        self._terms = [Term(sign, found[2], int(found[3])) for sign, found in signed_terms(
            text, TERM, 'such as axis 1, -axis 0 or button 14 - button 13')]

    def __bool__(self) -> bool:
        """Return whether there is an axis or a button."""
        return bool(self._terms)

    def value(self, axes: Sequence[float], buttons: Sequence[int]) -> float:
        """Return the sum; an axis or button that the device lacks counts as 0."""
        values = {'axis': axes, 'button': buttons}
        return sum(term.sign * values[term.kind][term.number] for term in self._terms
                   if term.number < len(values[term.kind]))

    def pressed(self, axes: Sequence[float], buttons: Sequence[int]) -> bool:
        """Return whether the sum, as a switch, is pressed."""
        return self.value(axes, buttons) > PRESSED

    def missing(self, axes: Sequence[float]) -> str:
        """Return the name of an axis that the device lacks; empty if there is none."""
        return next((f'axis {term.number}' for term in self._terms
                     if term.kind == 'axis' and term.number >= len(axes)), '')


def signed_terms(text: str, term: re.Pattern[str], wanted: str
                 ) -> Iterator[tuple[float, re.Match[str]]]:
    """Yield (sign, match) of each term of a sum, or raise `ValueError` that tells what it is."""
    end = 0
    while end < len(text.rstrip()):
        found = term.match(text, end)
        if found is None or (end and not found[1]):
            raise ValueError(f'{text!r} is not a sum {wanted}')
        yield -1.0 if found[1] == '-' else 1.0, found
        end = found.end()


@dataclass(frozen=True)
class Scaling:
    """
    Scaling of deflections to a twist.

    Attributes
    ----------
    linear, angular : float
        Speed at full deflection [m/s, rad/s].
    deadband : float
        Deflection up to which an axis counts as at rest; motion begins from zero there.

    """

    linear: float
    angular: float
    deadband: float

    def twist(self, deflection: ArrayLike) -> Array:
        """
        Return the velocities (6,) of deflections, linear then angular [m/s, rad/s].

        Parameters
        ----------
        deflection : array_like (6,)
            From -1 to 1 along and about x, y and z; larger values count as these.

        """
        value = np.asarray(deflection, float)
        # The remaining range is stretched to 0 … 1, so that nothing jumps at the deadband.
        size = np.clip((np.abs(value) - self.deadband) / (1.0 - self.deadband), 0.0, 1.0)
        return np.sign(value) * size * np.repeat((self.linear, self.angular), 3)

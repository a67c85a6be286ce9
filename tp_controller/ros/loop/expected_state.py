# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The next joint state of a publisher, as it is expected: most messages need no other check.

The core has a twin of the class, which takes a fiftieth of the time.
"""

from collections.abc import Sequence
import struct
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.joint_state_cdr import BEGIN, HEADER, LITTLE_ENDIAN, STAMP
from tp_controller.solver.compiled import core

DOUBLE = struct.Struct('<d')


class Expectation(Protocol):
    """Reader of messages that are as expected."""

    def read(self, raw: bytes, received: float, offset: float, limit: float,
             newest: float) -> float | None:
        """
        Store the positions of a message that is as expected, and return its stamp.

        Parameters
        ----------
        raw : bytes
            The message.
        received : float
            Time of receipt on the clock of the robot [s].
        offset, limit, newest : float
            See `StampAge` [s].

        Returns
        -------
        float or None
            [s]; None for any other message, of which nothing is stored.

        """


class ExpectedState:
    """
    Message like the one before: the same names, and motion that is possible at any interval.

    Parameters
    ----------
    raw : bytes
        The message before, which was valid.
    mask : bytes
        `JointStateReader.mask` of it.
    source, rows : sequence of int (k,)
        Indices of the joints in a message, and in the buffer.
    reference, passable : sequence of float (k,)
        Earlier positions, and largest distance from these and from the last ones [rad or m].
    positions : ndarray (m,)
        Positions of the buffer; those of the last message among them [rad or m].

    """

    def __init__(self, raw: bytes, mask: bytes, source: Sequence[int], rows: Sequence[int],
                 reference: Sequence[float], passable: Sequence[float],
                 positions: Array) -> None:
        self._size, self._begin = len(raw), BEGIN + len(mask)
        self._mask = int.from_bytes(mask, 'little')
        self._names = self._names_of(raw)
        self._offsets = [self._begin + DOUBLE.size * index for index in source]
        self._rows: NDArray[np.intp] = np.array(rows, dtype=np.intp)
        self._reference, self._passable, self._positions = reference, passable, positions

    def read(self, raw: bytes, received: float, offset: float, limit: float,
             newest: float) -> float | None:
        """Store the positions of a message, and return its stamp; see `Expectation`."""
        if len(raw) != self._size or not raw.startswith(LITTLE_ENDIAN) \
                or self._names_of(raw) != self._names:
            return None
        seconds, nanoseconds = STAMP.unpack_from(raw, HEADER)
        stamp: float = seconds + 1e-9 * nanoseconds
        # The age of the message, and whether a newer one has arrived.
        if stamp != 0.0 and not (abs(received - stamp - offset) <= limit and stamp >= newest):
            return None
        found = [DOUBLE.unpack_from(raw, offset)[0] for offset in self._offsets]
        for position, last, reference, most in zip(
                found, self._positions[self._rows].tolist(), self._reference, self._passable):
            if not (abs(position - last) <= most and abs(position - reference) <= most):
                return None
        self._positions[self._rows] = found
        return stamp

    def _names_of(self, raw: bytes) -> int:
        """Return the bits of a message that count before its positions."""
        return int.from_bytes(raw[BEGIN:self._begin], 'little') & self._mask


def expected_state(raw: bytes, mask: bytes, source: Sequence[int], rows: Sequence[int],
                   reference: Sequence[float], passable: Sequence[float],
                   positions: Array) -> Expectation:
    """Return an `ExpectedState`, or its twin where there is a core."""
    make = ExpectedState if core is None else core.ExpectedState
    found: Expectation = make(raw, mask, source, rows, reference, passable, positions)
    return found

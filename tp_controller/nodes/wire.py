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

"""
Joint states as they are on the wire.

Making Python objects of a joint state takes 40 µs where that happens once a millisecond, a tenth
of the cycle. Its names hardly ever change, and its positions lie there as doubles.
"""

from collections.abc import Sequence
import struct
from typing import NamedTuple

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

# Common Data Representation (OMG, DDS-XTypes 7.4.1), little-endian, as every ROS 2 middleware on
# such a machine uses it: a header of four bytes, then the fields, each aligned to its size.
LITTLE_ENDIAN = b'\x00\x01'
HEADER = 4
STAMP = struct.Struct('<iI')
COUNT = struct.Struct('<I')
# Where the frame and the names begin: up to the positions all messages of a publisher are equal.
BEGIN = HEADER + STAMP.size
# How many such beginnings are remembered. A publisher may have some: what is between the fields
# may be anything that was in its memory.
MOST_KNOWN = 100


class Form(NamedTuple):
    """What the beginning of a message says: the names, and where the positions are."""

    names: tuple[str, ...]
    positions: struct.Struct
    offset: int


class JointStateReader:
    """Reads serialized joint states; how the last publishers begin is remembered."""

    def __init__(self) -> None:
        self._forms: dict[bytes, Form] = {}
        # Where the positions of a message begin, mostly at the same byte in all.
        self._ends: list[int] = []

    def read(self, raw: bytes) -> tuple[Sequence[str], Sequence[float], float]:
        """
        Return what is in a serialized joint state.

        Parameters
        ----------
        raw : bytes
            The message.

        Returns
        -------
        names : sequence of str
        positions : sequence of float
            [rad or m]
        stamp : float
            [s]

        """
        for end in self._ends:
            form = self._forms.get(raw[BEGIN:end])
            if form is not None and raw.startswith(LITTLE_ENDIAN):
                seconds, nanoseconds = STAMP.unpack_from(raw, HEADER)
                return (form.names, form.positions.unpack_from(raw, form.offset),
                        seconds + 1e-9 * nanoseconds)
        message = deserialize_message(raw, JointState)
        self._remember(raw, message)
        stamp = message.header.stamp
        return tuple(message.name), message.position, stamp.sec + 1e-9 * stamp.nanosec

    def _remember(self, raw: bytes, message: JointState) -> None:
        """Remember how a message begins, if its positions are where they should be."""
        end = BEGIN
        for text in (message.header.frame_id, None, *message.name):
            end += -end % COUNT.size + COUNT.size
            end += len(text.encode()) + 1 if text is not None else 0
        end += -end % COUNT.size + COUNT.size
        count = len(message.position)
        form = Form(tuple(message.name), struct.Struct(f'<{count}d'),
                    end + (-(end - HEADER) % 8 if count else 0))
        if raw.startswith(LITTLE_ENDIAN) and len(raw) >= form.offset + form.positions.size \
                and COUNT.unpack_from(raw, end - COUNT.size) == (count,) \
                and np.array_equal(form.positions.unpack_from(raw, form.offset),
                                   message.position, equal_nan=True):
            # Names that change all the time must not fill the memory.
            if len(self._forms) >= MOST_KNOWN:
                self._forms.clear()
                self._ends.clear()
            self._forms[raw[BEGIN:end]] = form
            if end not in self._ends:
                self._ends.append(end)

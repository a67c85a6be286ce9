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

"""Joint positions, merged by name from any number of publishers."""

from collections.abc import Sequence
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array
from tp_controller.tasks.keys import LARGEST

Rows = NDArray[np.intp]


class JointStateBuffer:
    """
    The latest position of every joint, and when it was received.

    Names are sorted out once per publisher; other joints are ignored.

    Parameters
    ----------
    driven, passive : sequence of str
        Names of the joints.
    passive_start : sequence of float
        Where the passive joints are before their first message [rad or m].

    Attributes
    ----------
    q : ndarray (n,)
        Positions of the driven joints, NaN before the first [rad or m].
    passive : ndarray (p,)
        Positions of the passive joints, `passive_start` before the first [rad or m].

    """

    def __init__(self, driven: Sequence[str], passive: Sequence[str],
                 passive_start: Sequence[float] | Array) -> None:
        self._names = (*driven, *passive)
        self._rows = {name: row for row, name in enumerate(self._names)}
        self._n = len(driven)
        self._positions = np.array([math.nan] * len(driven) + list(passive_start), dtype=float)
        self._received = np.full(len(self._names), -math.inf)
        self.q = self._positions[:self._n]
        self.passive = self._positions[self._n:]
        self._fresh = np.zeros(self._n, dtype=bool)
        self._plans: dict[tuple[str, ...], tuple[Rows, Rows, Rows]] = {}

    def put(self, names: Sequence[str], positions: Sequence[float], now: float) -> str:
        """
        Take a message.

        Parameters
        ----------
        names : sequence of str
            Joints, in any order; others may be among them.
        positions : sequence of float
            [rad or m]
        now : float
            Time of receipt [s].

        Returns
        -------
        str
            What is wrong with the message, which is ignored then; else empty.

        """
        names = tuple(names)
        if len(positions) != len(names):
            return f'{len(names)} joints with {len(positions)} positions'
        plan = self._plans.get(names)
        if plan is None:
            plan = self._plan(names)
        source, rows, driven = plan
        values = np.asarray(positions, dtype=float)[source]
        bad = [self._names[row] for row, value in zip(rows, values.tolist())
               if not abs(value) <= LARGEST]
        if bad:
            return f'position not finite, or beyond {LARGEST:g}: {", ".join(bad)}'
        self._positions[rows] = values
        self._received[rows] = now
        self._fresh[driven] = True
        return ''

    def missing(self, now: float, timeout: float) -> list[str]:
        """Return the driven joints that nothing was heard of for `timeout` seconds."""
        age = now - self._received[:self._n]
        if not self._n or age.max() <= timeout:
            return []
        return [self._names[row] for row in np.flatnonzero(age > timeout)]

    def unheard(self) -> list[str]:
        """Return the passive joints that nothing was ever heard of."""
        return [name for name, received in zip(self._names[self._n:], self._received[self._n:])
                if received == -math.inf]

    def take_complete(self) -> bool:
        """Return True once after every driven joint got a new position."""
        if not self._fresh.all():
            return False
        self._fresh[:] = False
        return True

    def _plan(self, names: tuple[str, ...]) -> tuple[Rows, Rows, Rows]:
        """Return where in a message the joints are, and where they go."""
        found = [(index, self._rows[name]) for index, name in enumerate(names)
                 if name in self._rows]
        source = np.array([index for index, _ in found], dtype=np.intp)
        rows = np.array([row for _, row in found], dtype=np.intp)
        # A publisher that changes its names all the time must not fill the memory.
        if len(self._plans) >= 100:
            self._plans.clear()
        self._plans[names] = source, rows, rows[rows < self._n]
        return self._plans[names]

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
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.state_checks import (
    Contradicting,
    Dropped,
    History,
    motion,
    StampAge,
)
from tp_controller.tasks.keys import MAX_NUMBER

Rows = NDArray[np.intp]
# Longer pauses count as this [s]: a joint may be anywhere then.
LONG = 1e6


@dataclass(frozen=True, eq=False)
class Plan:
    """
    What is the same in every message of a publisher.

    Attributes
    ----------
    source, rows : ndarray of int, or slice
        Where in a message the joints are, and where they go.
    driven, of_driven : ndarray of int, or slice
        Where those go that are driven, and which of `source` they are.
    passable : list of float
        How far each of `source` may move between two messages, however soon one comes after the
        other, at most 1: whatever moves farther is looked at closely.
    whole : bool
        It is about all driven joints.
    twice : str
        Joints that are named twice.
    age : StampAge
        How old its messages are.

    """

    source: Rows | slice
    rows: Rows | slice
    driven: Rows | slice
    of_driven: Rows | slice
    passable: list[float]
    whole: bool
    twice: str
    age: StampAge


@dataclass(eq=False)
class Heard:
    """
    When positions of the same message were heard.

    Attributes
    ----------
    received : float
        On the clock of timeouts [s].
    measured : float
        On the clock of the robot [s].
    true : float
        When they were true, on the clock of timeouts, as far as stamps tell [s].

    """

    received: float = -math.inf
    measured: float = -math.inf
    true: float = -math.inf


class JointStateBuffer(Contradicting):
    """
    The latest position of every joint, and when it was received.

    Names are sorted out once per publisher; other joints are ignored.

    Parameters
    ----------
    driven, passive : sequence of str
        Names of the joints.
    passive_start : sequence of float
        Where the passive joints are before their first message [rad or m].
    speeds : ndarray (n,), optional
        Velocity limits of the driven joints [rad/s or m/s]; a joint that moves faster contradicts
        itself. Infinite where there is none.
    endless : ndarray (n,) of bool, optional
        Which of them turn without end, so that whole turns are no motion.
    late : float
        By how much messages may be late [s]. Older ones, by their stamps, are ignored.
    tolerance : float
        What a position may be off [rad or m].

    Attributes
    ----------
    q : ndarray (n,)
        Positions of the driven joints, NaN before the first [rad or m].
    passive : ndarray (p,)
        Positions of the passive joints, `passive_start` before the first [rad or m].
    delay : float
        Age of the last message by its stamp, even if it was ignored [s].
    dropped : Dropped
        Messages that were ignored.

    """

    def __init__(self, driven: Sequence[str], passive: Sequence[str],
                 passive_start: Sequence[float] | Array, speeds: Array | None = None,
                 endless: NDArray[np.bool_] | None = None, late: float = math.inf,
                 tolerance: float = 0.0) -> None:
        super().__init__()
        self._names = (*driven, *passive)
        self._rows = {name: row for row, name in enumerate(self._names)}
        self._n = len(driven)
        self._numbers = np.arange(len(self._names))
        self._positions = np.array([math.nan] * len(driven) + list(passive_start), dtype=float)
        # Of each joint.
        self._heard = [Heard()] * len(self._names)
        self.q = self._positions[:self._n]
        self.passive = self._positions[self._n:]
        # When the oldest positions had been received that were taken last.
        self._taken = -math.inf
        # When the last message came if it was about all driven joints, and of when that is true.
        self._whole = self._surely = -math.inf
        self._plans: dict[tuple[str, ...], Plan] = {}
        self._speeds = np.full(self._n, math.inf) if speeds is None else speeds
        self._endless = np.zeros(self._n, dtype=bool) if endless is None else endless
        self._turns = bool(self._endless.any())
        self._late, self._tolerance = late, tolerance
        # Time that a position may be late by, and after which it is compared again.
        self._slack = min(late, 1.0)
        self._history = History(self._slack)
        self.delay = 0.0
        self.dropped = Dropped()
        self._clock = -math.inf
        # Who spoke last, when, where in its messages the joints are, and their positions then.
        self._speaker: Plan | None = None
        self._spoken = Heard()
        self._window = slice(0)
        self._last: Sequence[float] = ()
        self._reference: Sequence[float] = ()

    def discard(self) -> None:
        """Take what was heard of driven joints for too old; where they are next is no jump."""
        self._heard[:self._n] = [Heard()] * self._n
        self._whole = self._surely = -math.inf
        self._speaker = None
        self._history.clear()

    def put(self, names: Sequence[str], positions: Sequence[float] | Array, now: float,
            stamp: float = 0.0, received: float | None = None) -> str:
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
        stamp : float
            Of the message [s]; 0: none.
        received : float, optional
            Time of receipt on the clock that stamps are of, where that is another one [s].

        Returns
        -------
        str
            What is wrong with the message, which is ignored then; else empty.

        """
        fault = self._take(tuple(names), positions, now, stamp,
                           now if received is None else received)
        self.dropped.note(fault, now)
        return fault

    def _take(self, names: tuple[str, ...], positions: Sequence[float] | Array, now: float,
              stamp: float, clock: float) -> str:
        """Take a message; see `put`."""
        if len(positions) != len(names):
            return f'{len(names)} joints with {len(positions)} positions'
        plan = self._plans.get(names)
        if plan is None:
            plan = self._plan(names)
        if plan.twice:
            return f'{plan.twice} is named twice'
        if clock < self._clock:
            # It was set back, as that of a simulation.
            for heard in self._heard:
                heard.measured = -math.inf
            self._history.clear()
            plan = self._plan(names)
        self._clock = clock
        # A clock that has not begun says nothing about stamps.
        fault = plan.age.fault(stamp, clock) if clock > 0.0 else ''
        self.delay = plan.age.delay
        return fault or self._take_positions(plan, positions, now, clock)

    def _take_positions(self, plan: Plan, positions: Sequence[float] | Array, now: float,
                        clock: float) -> str:
        """Take the positions of a message; return what is wrong with them, or nothing."""
        if self._is_usual(plan, positions, clock):
            if not plan.age.overtaken:
                self._last = tuple(positions[self._window])
                self._positions[plan.rows] = self._last
                self._note(plan, self._spoken, now, clock)
            return ''
        values = np.asarray(positions, dtype=float)[plan.source]
        known = np.abs(values) <= MAX_NUMBER
        if not known[plan.of_driven].all():
            bad = ', '.join(self._names[row] for row in self._numbers[plan.rows][~known])
            return f'position not finite, or beyond {MAX_NUMBER:g}: {bad}'
        self._check_motion(plan, values, now, clock)
        if plan.age.overtaken:
            return ''
        # Some drivers know no position of joints that are not theirs to drive.
        rows, heard = self._numbers[plan.rows][known], Heard()
        self._positions[rows] = values[known]
        # Complete before others see it: they may ask what is missing at any time.
        self._note(plan, heard, now, clock)
        for row in rows.tolist():
            self._heard[row] = heard
        if self._history.is_due(clock):
            self._history.replace(self.q, self._measured(), clock)
        self._speaker = None
        if isinstance(plan.source, slice) and known.all():
            self._speaker, self._spoken = plan, heard
            self._window, self._last = plan.source, values.tolist()
            self._reference = self._references(plan)
        return ''

    def _is_usual(self, plan: Plan, positions: Sequence[float] | Array, clock: float) -> bool:
        """Return whether the last publisher goes on, and no joint has moved far since."""
        if plan is not self._speaker or self._history.is_due(clock):
            return False
        for position, last, reference, most in zip(positions[self._window], self._last,
                                                   self._reference, plan.passable):
            if not (-most <= position - last <= most
                    and -most <= position - reference <= most):
                return False
        return True

    def _references(self, plan: Plan) -> Sequence[float]:
        """Return the reference positions of the joints of a message."""
        positions = self._positions.copy()
        positions[:self._n] = self._history.positions
        references: list[float] = positions[plan.rows].tolist()
        return references

    def _note(self, plan: Plan, heard: Heard, now: float, clock: float) -> None:
        """Note when positions were heard."""
        heard.received, heard.measured, heard.true = now, clock, now - plan.age.age
        self._whole, self._surely = (now, heard.true) if plan.whole else (-math.inf, -math.inf)

    def missing(self, now: float, timeout: float) -> list[str]:
        """Return the driven joints whose positions are older than `timeout` seconds."""
        oldest = now - timeout
        if self._surely >= oldest:
            return []
        return [name for name, heard in zip(self._names, self._heard[:self._n])
                if heard.true < oldest]

    def unheard(self) -> list[str]:
        """Return the passive joints that nothing was ever heard of."""
        return [name for name, heard in zip(self._names[self._n:], self._heard[self._n:])
                if heard.received == -math.inf]

    def take_complete(self) -> bool:
        """Return True once after every driven joint got a new position."""
        if self._whole > self._taken:
            self._taken = self._whole
            return True
        received = [heard.received for heard in self._heard[:self._n]]
        if min(received, default=math.inf) <= self._taken:
            return False
        self._taken = max(received, default=-math.inf)
        return True

    def _check_motion(self, plan: Plan, values: Array, now: float, clock: float) -> None:
        """Notice joints that are farther away than they can have moved since they were heard."""
        rows = plan.driven
        measured = self._measured()
        self._compare(plan, values[plan.of_driven] - self._positions[rows], clock - measured[rows],
                      now)
        if self._history.positions is not None:
            since = np.asarray(self._history.measured)[rows]
            self._compare(plan, values[plan.of_driven] - self._history.positions[rows],
                          clock - since, now)

    def _compare(self, plan: Plan, moved: Array, passed: Array, now: float) -> None:
        """Notice joints that moved farther in a time than their velocity limits allow."""
        rows = plan.driven
        moved = np.abs(motion(moved, self._endless[rows]) if self._turns else moved)
        passed = np.minimum(passed, LONG)
        jumped = moved > self._speeds[rows] * (passed + self._slack) + self._tolerance
        if jumped.any():
            which = int(np.argmax(jumped))
            name = self._names[self._numbers[rows][which]]
            self._contradict(f'{name} jumped by {moved[which]:.2g} '
                             f'in {passed[which]:.2g} s', now)

    def _measured(self) -> Array:
        """Return when the positions of the driven joints were measured (n,) [s]."""
        return np.array([heard.measured for heard in self._heard[:self._n]])

    def _plan(self, names: tuple[str, ...]) -> Plan:
        """Return what is sorted out once for a publisher."""
        found = [(index, self._rows[name]) for index, name in enumerate(names)
                 if name in self._rows]
        rows = np.array([row for _, row in found], dtype=np.intp)
        driven = rows[rows < self._n]
        speeds = [*self._speeds.tolist(), *[math.inf] * len(self.passive)]
        twice = [name for name in self._rows if names.count(name) > 1]
        # A publisher that changes its names all the time must not fill the memory.
        if len(self._plans) >= 100:
            self._plans.clear()
        self._plans[names] = Plan(
            _sliced(np.array([index for index, _ in found], dtype=np.intp)), _sliced(rows),
            _sliced(driven), _sliced(np.flatnonzero(rows < self._n)),
            [min(speeds[row] * self._slack + self._tolerance, 1.0) for row in rows],
            len(driven) == self._n, ', '.join(twice), StampAge(self._late))
        return self._plans[names]


def _sliced(rows: Rows) -> Rows | slice:
    """Return rows as a slice where they follow each other, which is quicker."""
    if len(rows) and (np.diff(rows) == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint positions, merged by name from any number of publishers."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.expected_state import Expectation, expected_state
from tp_controller.ros.loop.stamp_age import StampAge
from tp_controller.ros.loop.state_checks import Contradicting, Dropped, History, motion
from tp_controller.tasks.keys import MAX_NUMBER

Rows = NDArray[np.intp]
# Upper bound of the time between two positions [s]: after it a joint may be anywhere.
LONGEST_PAUSE = 1e6


@dataclass(frozen=True, eq=False)
class MessageLayout:
    """
    Constant properties of the messages of a publisher.

    Attributes
    ----------
    source, rows : ndarray of int, or slice
        Indices of the joints in a message, and in the buffer.
    driven, of_driven : ndarray of int, or slice
        Indices of the driven joints in the buffer, and among `source`.
    indices : list of int
        `source` as a list.
    passable : list of float
        Motion of each of `source` that is possible between two messages at any interval, at
        most 1; larger motion is checked in full.
    whole : bool
        The message contains all driven joints.
    twice : str
        Joints that are named twice.
    age : StampAge
        Age of the messages.

    """

    source: Rows | slice
    rows: Rows | slice
    driven: Rows | slice
    of_driven: Rows | slice
    indices: list[int]
    passable: list[float]
    whole: bool
    twice: str
    age: StampAge


@dataclass(eq=False)
class Receipt:
    """
    Times of the positions of one message.

    Attributes
    ----------
    received : float
        Time of receipt on the clock of timeouts [s].
    measured : float
        Time of receipt on the clock of the robot [s].
    valid_at : float
        Time of the measurement on the clock of timeouts, according to the stamp [s].

    """

    received: float = -math.inf
    measured: float = -math.inf
    valid_at: float = -math.inf


class JointStateBuffer(Contradicting):
    """
    Joint-state buffer: latest position of every joint and its time of receipt.

    Names are resolved once per publisher; other joints are ignored.

    Parameters
    ----------
    driven, passive : sequence of str
        Names of the joints.
    passive_start : sequence of float
        Positions of the passive joints before their first message [rad or m].
    speeds : ndarray (n,), optional
        Velocity limits of the driven joints [rad/s or m/s], infinite without a limit; faster
        motion is a contradiction.
    endless : ndarray (n,) of bool, optional
        Marks joints that turn without end, so that whole turns are no motion.
    late : float
        Largest delay of messages [s]. Older ones, by their stamps, are ignored.
    tolerance : float
        Tolerated error of a position [rad or m].

    Attributes
    ----------
    q : ndarray (n,)
        Positions of the driven joints, NaN before the first [rad or m].
    passive : ndarray (p,)
        Positions of the passive joints, `passive_start` before the first [rad or m].
    whole_valid : float
        Time of the last positions if one message had those of all driven joints [s].
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
        # Times of the position of each joint.
        self._receipts = [Receipt()] * len(self._names)
        self.q = self._positions[:self._n]
        self.passive = self._positions[self._n:]
        # Time of the last positions that `take_complete` has reported.
        self._taken = -math.inf
        # Time of receipt of the last message if it contains all driven joints.
        self._whole = self.whole_valid = -math.inf
        self._layouts: dict[tuple[str, ...], MessageLayout] = {}
        self._speeds = np.full(self._n, math.inf) if speeds is None else speeds
        self._endless = np.zeros(self._n, dtype=bool) if endless is None else endless
        self._turns = bool(self._endless.any())
        self._late, self._tolerance = late, tolerance
        # Tolerated delay of a position, and age at which the reference is replaced.
        self._slack = min(late, 1.0)
        self._history = History(self._slack)
        self.delay = 0.0
        self.dropped = Dropped()
        self._clock = -math.inf
        # Layout and receipt of the last message if it was complete, and whether the one before had
        # the same layout; and what is expected of the next one.
        self._latest: MessageLayout | None = None
        self._latest_receipt, self._repeated = Receipt(), False
        self._expected: Expectation | None = None

    def discard(self) -> None:
        """Mark the positions of driven joints as outdated; the next ones are no jump."""
        self._receipts[:self._n] = [Receipt()] * self._n
        self._whole = self.whole_valid = -math.inf
        self._latest = None
        self._history.clear()

    def put_expected(self, raw: bytes, now: float, clock: float) -> bool:
        """
        Store the positions of a message if it is as expected; else it is one for `put`.

        Parameters
        ----------
        raw : bytes
            Serialized message.
        now, clock : float
            Time of receipt, and the same on the clock of the stamps [s].

        Returns
        -------
        bool
            Whether they are stored.

        """
        layout, expected = self._latest, self._expected
        # The clock was set back, or the reference is too old.
        if expected is None or layout is None or clock < self._clock \
                or clock >= self._history.due:
            return False
        age = layout.age
        stamp = expected.read(raw, clock, age.offset, age.limit, age.newest)
        if stamp is None:
            return False
        age.accept(stamp, clock)
        self._clock, self.delay = clock, age.delay
        self._note(layout, self._latest_receipt, now, clock)
        return True

    def expect(self, raw: bytes, mask: bytes) -> None:
        """
        Expect messages like the one that was put, from a publisher that alone sends them.

        Parameters
        ----------
        raw : bytes
            That message.
        mask : bytes
            `JointStateReader.mask` of it.

        """
        layout = self._latest
        if mask and layout is not None and self._repeated:
            references = self._positions.copy()
            references[:self._n] = self._history.positions
            rows = self._numbers[layout.rows]
            self._expected = expected_state(
                raw, mask, layout.indices, rows.tolist(), references[rows].tolist(),
                layout.passable, self._positions)

    def put(self, names: Sequence[str], positions: Sequence[float] | Array, now: float,
            stamp: float = 0.0, received: float | None = None) -> str:
        """
        Store the positions of a message.

        Parameters
        ----------
        names : sequence of str
            Joints, in any order; others may be among them.
        positions : sequence of float
            [rad or m]
        now : float
            Time of receipt [s].
        stamp : float
            Stamp of the message [s]; 0: none.
        received : float, optional
            Time of receipt on the clock of the stamps, by default `now` [s].

        Returns
        -------
        str
            Fault for which the message is ignored, or empty.

        """
        fault = self._put(tuple(names), positions, now, stamp,
                          now if received is None else received)
        self.dropped.note(fault, now)
        return fault

    def _put(self, names: tuple[str, ...], positions: Sequence[float] | Array, now: float,
             stamp: float, clock: float) -> str:
        """Store the positions of a message; see `put`."""
        self._repeated, self._expected = False, None
        if len(positions) != len(names):
            return f'{len(names)} joints with {len(positions)} positions'
        layout = self._layouts.get(names)
        if layout is None:
            layout = self._make_layout(names)
        if layout.twice:
            return f'{layout.twice} is named twice'
        if clock < self._clock:
            # The clock was set back, as that of a simulation.
            for receipt in self._receipts:
                receipt.measured = -math.inf
            self._history.clear()
            layout = self._make_layout(names)
        self._clock = clock
        # Stamps cannot be checked with a clock that has not started.
        fault = layout.age.fault(stamp, clock) if clock > 0.0 else ''
        self.delay = layout.age.delay
        return fault or self._put_positions(layout, positions, now, clock)

    def _put_positions(self, layout: MessageLayout, positions: Sequence[float] | Array, now: float,
                       clock: float) -> str:
        """Store valid positions of a message; return their fault, or an empty string."""
        values = np.asarray(positions, dtype=float)[layout.source]
        known = np.abs(values) <= MAX_NUMBER
        if not known[layout.of_driven].all():
            bad = ', '.join(self._names[row] for row in self._numbers[layout.rows][~known])
            return f'position not finite, or beyond {MAX_NUMBER:g}: {bad}'
        self._check_motion(layout, values, now, clock)
        if layout.age.overtaken:
            return ''
        # Some drivers send NaN for joints that they do not drive.
        rows, receipt = self._numbers[layout.rows][known], Receipt()
        self._positions[rows] = values[known]
        # Complete before other threads see it: they may call `missing` at any time.
        self._note(layout, receipt, now, clock)
        for row in rows.tolist():
            self._receipts[row] = receipt
        if self._history.is_due(clock):
            self._history.replace(self.q, self._measured(), clock)
        self._repeated = layout is self._latest
        self._latest, self._latest_receipt = layout if known.all() else None, receipt
        return ''

    def _note(self, layout: MessageLayout, receipt: Receipt, now: float, clock: float) -> None:
        """Record the times of the positions of a message."""
        receipt.received, receipt.measured, receipt.valid_at = now, clock, now - layout.age.age
        self._whole, self.whole_valid = (now, receipt.valid_at) if layout.whole \
            else (-math.inf, -math.inf)

    def missing(self, now: float, timeout: float) -> list[str]:
        """Return the driven joints whose positions are older than `timeout` seconds."""
        oldest = now - timeout
        if self.whole_valid >= oldest:
            return []
        return [name for name, receipt in zip(self._names, self._receipts[:self._n])
                if receipt.valid_at < oldest]

    def unheard(self) -> list[str]:
        """Return the passive joints without a received position."""
        return [name for name, receipt in zip(self._names[self._n:], self._receipts[self._n:])
                if receipt.received == -math.inf]

    def take_complete(self) -> bool:
        """Return True once after each set of new positions of all driven joints."""
        if self._whole > self._taken:
            self._taken = self._whole
            return True
        received = [receipt.received for receipt in self._receipts[:self._n]]
        if min(received, default=math.inf) <= self._taken:
            return False
        self._taken = max(received, default=-math.inf)
        return True

    def _check_motion(self, layout: MessageLayout, values: Array, now: float,
                      clock: float) -> None:
        """Detect joints that moved farther than possible since their last positions."""
        rows = layout.driven
        measured = self._measured()
        self._compare(layout, values[layout.of_driven] - self._positions[rows],
                      clock - measured[rows], now)
        if self._history.positions is not None:
            since = np.asarray(self._history.measured)[rows]
            self._compare(layout, values[layout.of_driven] - self._history.positions[rows],
                          clock - since, now)

    def _compare(self, layout: MessageLayout, moved: Array, passed: Array, now: float) -> None:
        """Detect joints that moved farther in a time than their velocity limits allow."""
        rows = layout.driven
        moved = np.abs(motion(moved, self._endless[rows]) if self._turns else moved)
        passed = np.minimum(passed, LONGEST_PAUSE)
        jumped = moved > self._speeds[rows] * (passed + self._slack) + self._tolerance
        if jumped.any():
            which = int(np.argmax(jumped))
            name = self._names[self._numbers[rows][which]]
            self._contradict(f'{name} jumped by {moved[which]:.2g} '
                             f'in {passed[which]:.2g} s', now)

    def _measured(self) -> Array:
        """Return the measurement times of the positions of the driven joints (n,) [s]."""
        return np.array([receipt.measured for receipt in self._receipts[:self._n]])

    def _make_layout(self, names: tuple[str, ...]) -> MessageLayout:
        """Return the layout of the messages of a new publisher."""
        found = [(index, self._rows[name]) for index, name in enumerate(names)
                 if name in self._rows]
        rows = np.array([row for _, row in found], dtype=np.intp)
        driven = rows[rows < self._n]
        speeds = [*self._speeds.tolist(), *[math.inf] * len(self.passive)]
        twice = [name for name in self._rows if names.count(name) > 1]
        # Bounds the memory if a publisher changes its names all the time.
        if len(self._layouts) >= 100:
            self._layouts.clear()
        self._layouts[names] = MessageLayout(
            _sliced(np.array([index for index, _ in found], dtype=np.intp)), _sliced(rows),
            _sliced(driven), _sliced(np.flatnonzero(rows < self._n)),
            [index for index, _ in found],
            [min(speeds[row] * self._slack + self._tolerance, 1.0) for row in rows],
            len(driven) == self._n, ', '.join(twice), StampAge(self._late))
        return self._layouts[names]


def _sliced(rows: Rows) -> Rows | slice:
    """Return consecutive rows as a slice, which is faster."""
    if len(rows) and (np.diff(rows) == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows

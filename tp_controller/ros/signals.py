# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Signal handling: shutdown between two messages, even if other threads hang."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
import os
import select
import signal
import sys
import threading
import time
from typing import Any

END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Time in which a repeated signal is ignored [s]: a launch repeats Ctrl-C at once.
SIGNAL_REPEAT_SECONDS = 1.0
# Value written to the pipe by `close`; no signal has this number.
CLOSED = 0


class SignalWatch:
    """
    Signal reader on a thread of its own, independent of threads that hang.

    The signals need handlers in Python, which run on the main thread, if at all. A further signal
    ends the process at once, but not sooner than `SIGNAL_REPEAT_SECONDS` after the first one. C
    code that owns the interpreter lock delays this thread, too.

    Parameters
    ----------
    numbers : collection of int
        Signals that end the process.
    status : int
        Exit status where the process is ended by force.
    act : callable, optional
        Called with the number of the first signal.
    limit : float, optional
        Time from the first signal to the forced end of the process [s]; by default only a further
        signal ends it.

    """

    def __init__(self, numbers: Collection[int], status: int,
                 act: Callable[[int], None] | None = None, limit: float | None = None) -> None:
        self._numbers, self._status = frozenset(numbers), status
        self._act, self._limit = act, limit
        self._reader, self._writer = os.pipe()
        self._arrived = select.poll()
        self._arrived.register(self._reader, select.POLLIN)
        self._thread = threading.Thread(target=self._watch, name='signals', daemon=True)

    def start(self) -> None:
        """Start watching; only the main thread may call this."""
        os.set_blocking(self._writer, False)
        # A handler in Python would run only once the main thread returns from C++.
        self._before = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._thread.start()

    def close(self) -> None:
        """Stop watching."""
        signal.set_wakeup_fd(self._before)
        os.write(self._writer, bytes([CLOSED]))
        self._thread.join()
        os.close(self._reader)
        os.close(self._writer)

    def _watch(self) -> None:
        """Act on the first signal, and end the process by force when due."""
        first = self._read(None)
        if first == CLOSED:
            return
        began = time.monotonic()
        if self._act is not None:
            # On a thread of its own, since it may hang, too.
            threading.Thread(target=self._act, args=(first,), daemon=True).start()
        end = None if self._limit is None else began + self._limit
        if self._read(end) != CLOSED and not self._closes(began + SIGNAL_REPEAT_SECONDS):
            os._exit(self._status)

    def _closes(self, end: float) -> bool:
        """Return whether `close` is called before a time [s]."""
        while (number := self._read(end)) is not None:
            if number == CLOSED:
                return True
        return False

    def _read(self, end: float | None) -> int | None:
        """Return the next signal or `CLOSED`, or None if none arrives before a time [s]."""
        while True:
            left = None if end is None else 1e3 * max(end - time.monotonic(), 0.0)
            if not self._arrived.poll(left):
                return None
            number, = os.read(self._reader, 1)
            if number == CLOSED or number in self._numbers:
                return number


@contextmanager
def uninterrupted() -> Iterator[None]:
    """
    Defer the signals that end a command until the block has ended.

    Their handlers raise an exception at any point of the program. Within an executor, a message
    that was taken would stay unhandled, and a coroutine unawaited. Only the main thread has
    handlers; in other threads this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    before: dict[int, Any] = {
        number: signal.signal(number, lambda each, _: arrived.append(each))
        for number in END_SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for got in arrived:
            _handle(got, before[got])


def _handle(number: int, handler: Any) -> None:
    """Call the handler of a signal; sent again, `SignalWatch` would count it twice."""
    if callable(handler):
        handler(number, sys._getframe())
    else:
        signal.raise_signal(number)

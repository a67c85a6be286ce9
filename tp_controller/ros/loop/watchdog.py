# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Watchdog of the control loop, on a thread of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread


class Watchdog:
    """
    Watchdog that calls `on_timeout` repeatedly while the loop makes no progress.

    Parameters
    ----------
    timeout : float
        [s]
    silence : callable
        Returns the time since the last progress [s].
    on_timeout : callable
        Called without arguments.

    """

    def __init__(self, timeout: float, silence: Callable[[], float],
                 on_timeout: Callable[[], None]) -> None:
        self._timeout, self._silence, self._on_timeout = timeout, silence, on_timeout

    def check(self) -> None:
        """Check the loop once."""
        if self._silence() > self._timeout:
            self._on_timeout()

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Check the loop four times in each timeout, until the block ends."""
        ended = Event()

        def watch() -> None:
            while not ended.wait(self._timeout / 4.0):
                self.check()

        thread = Thread(target=watch, name='watchdog', daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

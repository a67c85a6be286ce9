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

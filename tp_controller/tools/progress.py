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

"""A bar that shows how far long work is."""

from collections.abc import Iterator
from contextlib import contextmanager
import shutil
import sys
from time import monotonic
from typing import TextIO

# Between two drawings [s]: more often costs time and shows nothing more.
PERIOD = 0.1
# From which time on the time left is told [s]: before it nobody can know.
TELLING = 1.0
# Columns of the bar.
WIDTH = 24
# To the start of the line, and clear it.
CLEAR = '\r\x1b[K'


class Progress:
    """
    How far work is.

    Parameters
    ----------
    total : float
        When the work is done, in any unit; 0 for work that is done already.
    what : str
        What is done, for the line.
    stream : TextIO, optional
        Where the bar is drawn; nowhere by default.

    """

    def __init__(self, total: float, what: str, stream: TextIO | None = None) -> None:
        self._total = total
        self._what = what
        self._stream = stream
        self._done = 0.0
        self._start = self._drawn = monotonic()

    def advance(self, amount: float = 1.0) -> None:
        """
        Note that a further part is done.

        Parameters
        ----------
        amount : float
            In the unit of the total.

        """
        self._done += amount
        if self._stream is not None and (now := monotonic()) - self._drawn >= PERIOD:
            self._drawn = now
            # A longer line would go on in the next, which is never cleared.
            columns = shutil.get_terminal_size().columns - 1
            self._stream.write(CLEAR + self._line(now - self._start)[:columns])
            self._stream.flush()

    def clear(self) -> None:
        """Remove the bar."""
        if self._stream is not None:
            self._stream.write(CLEAR)
            self._stream.flush()

    def _line(self, elapsed: float) -> str:
        """Return what the line says after a time [s]."""
        part = min(1.0, self._done / self._total) if self._total > 0.0 else 1.0
        full = round(WIDTH * part)
        line = f'{self._what} [{"#" * full}{"." * (WIDTH - full)}] {part:4.0%}'
        if elapsed < TELLING or part == 0.0:
            return line
        left = round(elapsed * (1.0 / part - 1.0))
        return f'{line}, {left // 60}:{left % 60:02} left'


@contextmanager
def progress(total: float, what: str) -> Iterator[Progress]:
    """
    Show how far work is while it is done: on a terminal, and on the error stream.

    Parameters
    ----------
    total : float
        When the work is done, in any unit.
    what : str
        What is done, such as ``'reading run.mcap'``.

    Yields
    ------
    Progress
        To be told of each part that is done.

    """
    shown = Progress(total, what, sys.stderr if sys.stderr.isatty() else None)
    try:
        yield shown
    finally:
        shown.clear()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Progress bar of long work."""

from collections.abc import Iterator
from contextlib import contextmanager
import shutil
import sys
from time import monotonic
from typing import TextIO

# Period of drawing [s].
DRAW_SECONDS = 0.1
# Elapsed time from which the remaining time is estimated [s].
ESTIMATE_SECONDS = 1.0
# Columns of the bar.
BAR_COLUMNS = 24
# Carriage return, and erase to the end of the line.
CLEAR_LINE = '\r\x1b[K'


class Progress:
    """
    Progress of work, drawn as a bar.

    Parameters
    ----------
    total : float
        Amount of work, in any unit; 0 for finished work.
    what : str
        Description of the work.
    stream : TextIO, optional
        Stream of the bar; none by default.

    """

    def __init__(self, total: float, what: str, stream: TextIO | None = None) -> None:
        self._total = total
        self._what = what
        self._stream = stream
        self._done = 0.0
        self._start = self._drawn = monotonic()

    def advance(self, amount: float = 1.0) -> None:
        """
        Add a finished part.

        Parameters
        ----------
        amount : float
            Size of the part, in the unit of the total.

        """
        self._done += amount
        if self._stream is not None and (now := monotonic()) - self._drawn >= DRAW_SECONDS:
            self._drawn = now
            # A longer line would wrap, and its rest would not be cleared.
            columns = shutil.get_terminal_size().columns - 1
            self._stream.write(CLEAR_LINE + self._line(now - self._start)[:columns])
            self._stream.flush()

    def clear(self) -> None:
        """Remove the bar."""
        if self._stream is not None:
            self._stream.write(CLEAR_LINE)
            self._stream.flush()

    def _line(self, elapsed: float) -> str:
        """Return the line after a time [s]."""
        part = min(1.0, self._done / self._total) if self._total > 0.0 else 1.0
        full = round(BAR_COLUMNS * part)
        line = f'{self._what} [{"#" * full}{"." * (BAR_COLUMNS - full)}] {part:4.0%}'
        if elapsed < ESTIMATE_SECONDS or part == 0.0:
            return line
        left = round(elapsed * (1.0 / part - 1.0))
        return f'{line}, {left // 60}:{left % 60:02} left'


@contextmanager
def progress(total: float, what: str) -> Iterator[Progress]:
    """
    Show the progress of work on the error stream, if that is a terminal.

    Parameters
    ----------
    total : float
        Amount of work, in any unit.
    what : str
        Description of the work, such as ``'reading run.mcap'``.

    Yields
    ------
    Progress
        Bar to advance for each finished part.

    """
    shown = Progress(total, what, sys.stderr if sys.stderr.isatty() else None)
    try:
        yield shown
    finally:
        shown.clear()

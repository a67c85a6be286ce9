# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Log whose callers never wait for the output."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
import time

from rclpy.impl.rcutils_logger import RcutilsLogger
from tp_controller.untrusted.texts import plain

# Shortest time between two messages of one cause [s].
MESSAGE_REPEAT_SECONDS = 1.0
# Largest number of queued messages, and of causes that are distinguished.
LARGEST_QUEUE, MOST_LOG_CAUSES = 200, 100
# Longest text of a message [characters].
LONGEST_ENTRY = 20_000
# rclpy needs a call site of its own for each severity.
WRITERS: dict[str, Callable[[RcutilsLogger, str], object]] = {
    'info': lambda logger, text: logger.info(text),
    'warning': lambda logger, text: logger.warning(text),
    'error': lambda logger, text: logger.error(text),
}


@dataclass
class CauseRecord:
    """State of one cause: time of the last output, and messages since then."""

    at: float = -math.inf
    pending: int = 0
    severity: str = ''
    text: str = ''


class Log:
    """
    Log that accepts messages from any thread without waiting, and writes them in `flush`.

    Repeated messages of one cause are written once in `MESSAGE_REPEAT_SECONDS`, and counted.

    Parameters
    ----------
    logger : rclpy.impl.rcutils_logger.RcutilsLogger
        Logger of the node.

    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._queue: deque[tuple[str, str, str]] = deque(maxlen=LARGEST_QUEUE)
        self._written: dict[str, CauseRecord] = {}

    def info(self, text: str, cause: str = '') -> None:
        """Log information; `cause` is the text by default."""
        self._queue.append(('info', text, cause or text))

    def warning(self, text: str, cause: str = '') -> None:
        """Log a warning."""
        self._queue.append(('warning', text, cause or text))

    def error(self, text: str, cause: str = '') -> None:
        """Log an error."""
        self._queue.append(('error', text, cause or text))

    def flush(self) -> None:
        """Write the messages that are due."""
        now = time.monotonic()
        while self._queue:
            severity, text, cause = self._queue.popleft()
            written = self._written.setdefault(cause, CauseRecord())
            written.pending, written.severity, written.text = written.pending + 1, severity, text
            self._write(written, now)
        for written in self._written.values():
            self._write(written, now)
        if len(self._written) > MOST_LOG_CAUSES:
            self._written.clear()

    def _write(self, written: CauseRecord, now: float) -> None:
        """Write the last message of a cause, if it is due."""
        if written.pending and now - written.at >= MESSAGE_REPEAT_SECONDS:
            more = f' ({written.pending} times)' if written.pending > 1 else ''
            # It may contain text from other nodes.
            WRITERS[written.severity](self._logger, plain(written.text, LONGEST_ENTRY) + more)
            written.at, written.pending = now, 0

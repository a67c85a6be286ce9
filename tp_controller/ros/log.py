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

"""A log that nobody waits for."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
import time

from rclpy.impl.rcutils_logger import RcutilsLogger
from tp_controller.untrusted import plain

# What repeats is written once in this time [s].
REPEAT_SECONDS = 1.0
# How much can wait to be written, and how many causes are told apart.
LARGEST_QUEUE, MOST_CAUSES = 200, 100
# Longest text that is written [characters].
LONGEST = 20_000
# In rclpy each severity needs a line of its own.
WRITERS: dict[str, Callable[[RcutilsLogger, str], object]] = {
    'info': lambda logger, text: logger.info(text),
    'warning': lambda logger, text: logger.warning(text),
    'error': lambda logger, text: logger.error(text),
}


@dataclass
class Written:
    """When something was written, and what came since, how often."""

    at: float = -math.inf
    more: int = 0
    severity: str = ''
    text: str = ''


class Log:
    """
    Takes sentences from any thread at once, and writes them when `flush` is called.

    What comes again and again, by its cause, is written once a second and counted.

    Parameters
    ----------
    logger : rclpy.impl.rcutils_logger.RcutilsLogger
        Where it goes.

    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._queue: deque[tuple[str, str, str]] = deque(maxlen=LARGEST_QUEUE)
        self._written: dict[str, Written] = {}

    def info(self, text: str, cause: str = '') -> None:
        """Say what is as it should be; `cause` is the text by default."""
        self._queue.append(('info', text, cause or text))

    def warning(self, text: str, cause: str = '') -> None:
        """Say what may be wrong."""
        self._queue.append(('warning', text, cause or text))

    def error(self, text: str, cause: str = '') -> None:
        """Say what is wrong."""
        self._queue.append(('error', text, cause or text))

    def flush(self) -> None:
        """Write what is due."""
        now = time.monotonic()
        while self._queue:
            severity, text, cause = self._queue.popleft()
            written = self._written.setdefault(cause, Written())
            written.more, written.severity, written.text = written.more + 1, severity, text
            self._write(written, now)
        for written in self._written.values():
            self._write(written, now)
        if len(self._written) > MOST_CAUSES:
            self._written.clear()

    def _write(self, written: Written, now: float) -> None:
        """Write what came last from one cause, unless that is not due."""
        if written.more and now - written.at >= REPEAT_SECONDS:
            more = f' ({written.more} times)' if written.more > 1 else ''
            # Texts of others may be in it.
            WRITERS[written.severity](self._logger, plain(written.text, LONGEST) + more)
            written.at, written.more = now, 0

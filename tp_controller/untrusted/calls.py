# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Context for calls of foreign code, such as task types: its exceptions end no program."""

import signal
import threading
from traceback import walk_tb
from types import CodeType, TracebackType
from typing import Any


class Leaving(Exception):
    """Exception of foreign code that would end the program; its cause is the original one."""


class Foreign:
    """
    Context in which foreign code is called.

    ``SystemExit``, ``KeyboardInterrupt``, ``GeneratorExit`` and all other exceptions that are no
    `Exception` are replaced by `Leaving`, an ordinary fault. Only exceptions that the handler of a
    signal raises there pass unchanged.
    """

    def __enter__(self) -> None:
        """Enter without overhead: the context may be used in every cycle."""

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Exit, and replace an exception that is no `Exception` by `Leaving`."""
        if error is not None and not isinstance(error, Exception) and not _is_of_signal(error):
            raise Leaving from error


foreign = Foreign()


def _is_of_signal(error: BaseException) -> bool:
    """Return whether the handler of a signal raised an exception."""
    if threading.current_thread() is not threading.main_thread():
        # Handlers run in the main thread only.
        return False
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    if isinstance(error, KeyboardInterrupt) and signal.default_int_handler in handlers:
        return True
    codes = {_code(handler) for handler in handlers} - {None}
    return any(frame.f_code in codes for frame, _ in walk_tb(error.__traceback__))


def _code(handler: Any) -> CodeType | None:
    """Return the code of a handler in Python; None for others."""
    handler = getattr(handler, 'func', handler)
    return getattr(handler, '__code__', None) or getattr(
        getattr(type(handler), '__call__', None), '__code__', None)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""Guard between browsers and viser: access control, message checks, and a rate-limited log."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
import logging
import time
from typing import Any

from tp_controller.errors import in_words
from tp_controller.tools.view.gate import Gate, MOST_CLIENTS
from tp_controller.tools.view.incoming import (
    CheckedConnection,
    LONGEST_MESSAGE,
    LONGEST_PICTURE,
    MESSAGES,
    PICTURES,
)
from tp_controller.untrusted.texts import plain
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

# Minimum time between two lines of the log [s].
LOG_SECONDS = 10.0
# WebSocket subprotocol of the page of this version of viser.
SUBPROTOCOL = f'viser-v{viser.__version__}'


class Guard:
    """
    Filter between browsers and viser, which accepts every connection and message.

    Parameters
    ----------
    gate : Gate
    pictures : bool
        Accept only pictures of the scene.

    Attributes
    ----------
    refused : int
        Number of refused messages.
    ready : bool
        Whether viser opened its server through this guard.

    """

    def __init__(self, gate: Gate, pictures: bool) -> None:
        self._gate = gate
        self._clients = 0
        self._gui: viser.GuiApi | None = None
        self._answer: Any = None
        self._handle: Any = None
        self._log = quiet_log()
        self._decoder, self._longest = (PICTURES, LONGEST_PICTURE) if pictures \
            else (MESSAGES, LONGEST_MESSAGE)
        self.refused = 0
        self.ready = False

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Guard the servers that viser opens in the context; viser has no parameter for it."""
        serve = websockets.asyncio.server.serve
        websockets.asyncio.server.serve = partial(  # type: ignore[misc, assignment]
            self._serve, serve)
        try:
            yield
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]

    def attach(self, gui: viser.GuiApi) -> None:
        """Set the widgets that messages are checked against; until then input is refused."""
        self._gui = gui

    def _serve(self, serve: Any, handle: Any, *arguments: Any, **options: Any) -> Any:
        """Return the server of viser with checks."""
        self._handle, self._answer = handle, options['process_request']
        # This runs in the loop of the server.
        asyncio.get_running_loop().set_exception_handler(
            lambda _, context: self._log.error(context['message'],
                                               exc_info=context.get('exception')))
        self.ready = True
        return serve(self._handle_client, *arguments, **{
            **options, 'process_request': self._process, 'max_size': self._longest,
            'logger': self._log, 'create_connection': partial(
                CheckedConnection, decoder=self._decoder, find=self._find,
                refused=self._count_refusal)})

    def _process(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the response to a request; None to open a connection."""
        reason = self._gate.refusal(request)
        if reason:
            return self._gate.refuse(connection, reason)
        response: Response | None = self._answer(connection, request)
        return response and self._gate.protected(response, request.headers['Host'])

    async def _handle_client(self, connection: ServerConnection) -> None:
        """Serve a browser; refuse excess browsers and pages of another version."""
        if connection.subprotocol != SUBPROTOCOL:
            # viser would print a message each time.
            await connection.close(CloseCode.PROTOCOL_ERROR, 'Version mismatch: reload the page')
            return
        if self._clients >= MOST_CLIENTS:
            await connection.close(CloseCode.TRY_AGAIN_LATER, 'too many browsers')
            return
        self._clients += 1
        try:
            await self._handle(connection)
        finally:
            self._clients -= 1

    def _find(self, identifier: str) -> Any:
        """Return the widget of an identifier; None if there is none."""
        # viser has no public lookup of widgets by identifier.
        return self._gui and self._gui._gui_input_handle_from_uuid.get(identifier)

    def _count_refusal(self) -> None:
        """Count a refused message."""
        self.refused += 1
        if self._gui is not None:
            self._log.warning('messages of a browser were refused')


def quiet_log() -> logging.Logger:
    """Return a logger that writes at most one line per `LOG_SECONDS`, without tracebacks."""
    log = logging.Logger(__name__)
    log.propagate = False
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter('tp_controller: page: %(message)s'))
    log.addHandler(handler)
    due = -LOG_SECONDS
    dropped = 0

    def brief(record: logging.LogRecord) -> bool:
        nonlocal due, dropped
        # Browsers open connections in advance, and close them unused.
        if record.levelno < logging.WARNING or record.msg == 'opening handshake failed':
            return False
        if time.monotonic() < due:
            dropped += 1
            return False
        due = time.monotonic() + LOG_SECONDS
        error = record.exc_info[1] if record.exc_info else None
        more = f' (and {dropped} more)' if dropped else ''
        record.msg = plain(record.getMessage() + (f': {in_words(error)}' if error else '') + more)
        record.args, record.exc_info, dropped = (), None, 0
        return True

    log.addFilter(brief)
    return log

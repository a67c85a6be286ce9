# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Server of the page: address, port, message buffers, and a test of its protection."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
import io
import socket
import time
from typing import Any

from tp_controller.errors import TpControllerError
from tp_controller.tools.view.gate import Gate, HEADERS, is_local, LOCAL
from tp_controller.tools.view.guard import Guard, SUBPROTOCOL
import viser
import viser.infra._infra as infra
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

# Ports that are tried if none is given.
PORTS = range(8080, 8180)
TITLE = 'tp_controller'
# Width of the panel beside the scene [pixels].
PANEL_WIDTH = 384
FOREIGN = 'http://other.example'
# Message of a browser that sets a property of a widget other than its value.
FORGED = (b'\x83\xa4type\xb0GuiUpdateMessage\xa4uuid\xa1x\xa7updates\x81\xa8disabled\xc3')
# Timeouts of a response and of the check of a message on a busy machine [s].
SERVER_ANSWER_SECONDS = CHECK_SECONDS = 30.0
REFUSAL_POLL_SECONDS = 0.01
UPGRADE = ('\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
           'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==')


class PageServer(viser.ViserServer):
    """Server that cannot be shared through the internet."""

    def stop(self) -> None:
        """Stop the server, without the message of viser."""
        with _quiet():
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Do nothing: viser would make the page reachable from the internet."""
        return None


def open_server(host: str = LOCAL, port: int = 0, *, pictures: bool = False) -> PageServer:
    """
    Return a server of an empty page that has refused the requests of pages of other sites.

    Parameters
    ----------
    host : str
        Address to listen on; by default that of this machine, which others cannot reach.
    port : int
        Port; 0 selects the first free one from 8080 on.
    pictures : bool
        Accept only pictures of the scene from browsers.

    Raises
    ------
    TpControllerError
        The port is taken, the address is not one of this machine, or the server accepts requests
        that it must refuse, as with an unsupported version of viser.

    """
    port = port or free_port(host)
    check_port(host, port)
    use_loop_buffers()
    guard = Guard(Gate(host), pictures)
    with _quiet(), guard.watching():
        server = PageServer(host, port, label=TITLE, verbose=False)
    try:
        try_from_outside(host, port, guard)
        guard.attach(server.gui)
    except TpControllerError:
        server.stop()
        raise
    server.gui.configure_theme(show_logo=False, show_share_button=False,
                               brand_color=(52, 74, 99))
    # In pixels: browsers apply a width of the theme only if they receive it before docking.
    server.gui.main_panel.set_width(PANEL_WIDTH)
    server.gui.main_panel.dock_right()
    return server


def address(server: viser.ViserServer) -> str:
    """Return the URL of the page of a server."""
    return url(server.get_host(), server.get_port())


def url(host: str, port: int) -> str:
    """Return the URL of a page; localhost if the server listens on all addresses."""
    shown = 'localhost' if host in ('0.0.0.0', '::', '') else host
    return f'http://{f"[{shown}]" if ":" in shown else shown}:{port}'


def exposure(host: str) -> str:
    """Return a warning if others can reach an address; else an empty string."""
    if is_local(host):
        return ''
    return (f'whoever can reach {host} can move the robot with this page: there is no password '
            'and no encryption')


def free_port(host: str) -> int:
    """Return the first free port; raise `TpControllerError` if there is none."""
    for port in PORTS:
        if _fault(host, port) is None:
            return port
    raise TpControllerError(f'no free port from {PORTS[0]} to {PORTS[-1]} on {host}: '
                            f'{_fault(host, PORTS[0])}')


def unused_port() -> int:
    """
    Return a free port outside `PORTS`.

    A browser with an old page reconnects to any new server at the address of that page.
    """
    with socket.socket() as tried:
        tried.bind((LOCAL, 0))
        port: int = tried.getsockname()[1]
    return port if port not in PORTS else unused_port()


def check_port(host: str, port: int) -> None:
    """Raise `TpControllerError` if a port is not available."""
    fault = _fault(host, port)
    if fault is not None:
        raise TpControllerError(f'the page cannot be shown at {url(host, port)}: {fault}')


def _fault(host: str, port: int) -> OSError | OverflowError | None:
    """Return the error of listening on a port; None if it is available."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            # As the server does: a port closed a moment ago is free.
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except (OSError, OverflowError) as error:
        return error
    return None


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the address that viser prints on the terminal."""
    with redirect_stdout(io.StringIO()):
        yield


class LoopEvent(asyncio.Event):
    """
    Event that is set only on the thread of a loop.

    viser wakes the senders of a message buffer from any thread that writes to it, but asyncio
    events may be set only on the thread of their loop: occasionally a write raised
    ``RuntimeError: deque mutated during iteration``. viser also wakes the senders on the loop,
    which suffices.
    """

    def set(self) -> None:  # noqa: A003
        """Wake the waiting tasks on the loop; viser repeats the call there for other threads."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class LoopBuffer(infra.AsyncMessageBuffer):
    """Buffer whose event other threads do not set."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.message_event = LoopEvent()


def use_loop_buffers() -> None:
    """Make new servers use these buffers; viser has no option for it."""
    infra.AsyncMessageBuffer = LoopBuffer  # type: ignore[misc]


def try_from_outside(host: str, port: int, guard: Guard) -> None:
    """
    Raise `TpControllerError` unless a server refuses the requests of pages of other sites.

    Parameters
    ----------
    host, port
        Address of the server.
    guard : Guard
        Guard that counts refused messages.

    """
    try:
        faults = list(_faults(host, port, guard)) if guard.ready else ['it is not guarded']
    except (OSError, WebSocketException) as error:
        faults = [f'it cannot be tried: {error}']
    if faults:
        raise TpControllerError(
            f'the page is not shown: with viser {viser.__version__} pages of other sites could '
            f'move the robot: {"; ".join(faults)}')


def _faults(host: str, port: int, guard: Guard) -> Iterator[str]:
    """Yield the faults of a server."""
    near = _near(host)
    own = f'{f"[{near}]" if ":" in near else near}:{port}'
    if _head(near, port, own, '/')[0] != 200:
        yield 'its page cannot be fetched'
    for origin, lines, target in (
            ('another site', f'{own}\r\nOrigin: {FOREIGN}', '/'),
            ('another port of this machine', f'{own}\r\nOrigin: http://localhost:1', '/'),
            ('another name of this machine', f'other.example:{port}', '/'),
            ('an address that names another server', own, '/?websocket=ws://other.example')):
        for upgrade in ('', UPGRADE):
            if _head(near, port, lines + upgrade, target)[0] != 403:
                yield f'{origin} is allowed'
    _, headers = _head(near, port, own, '/')
    for name in HEADERS:
        if name.lower() not in headers:
            yield f'{name} is not sent'
    before = guard.refused
    with connect(f'ws://{own}', subprotocols=[Subprotocol(SUBPROTOCOL)],
                 open_timeout=SERVER_ANSWER_SECONDS) as browser:
        browser.send(FORGED)
        end = time.monotonic() + CHECK_SECONDS
        while guard.refused == before and time.monotonic() < end:
            time.sleep(REFUSAL_POLL_SECONDS)
    if guard.refused == before:
        yield 'messages are not checked'


def _near(host: str) -> str:
    """Return an address at which this machine reaches a server."""
    if is_local(host):
        return host
    return {'0.0.0.0': '127.0.0.1', '': '127.0.0.1', '::': '::1'}.get(host, host)


def _head(host: str, port: int, lines: str, target: str) -> tuple[int, dict[str, str]]:
    """Return status and headers (names in lower case) of the response to a request."""
    with socket.create_connection((host, port), SERVER_ANSWER_SECONDS) as found:
        found.sendall(f'GET {target} HTTP/1.1\r\nHost: {lines}\r\n\r\n'.encode())
        received = b''
        while b'\r\n\r\n' not in received:
            piece = found.recv(1 << 16)
            if not piece:
                raise OSError('no answer')
            received += piece
    status, *rest = received.partition(b'\r\n\r\n')[0].decode('latin-1').split('\r\n')
    return int(status.split()[1]), {
        name.strip().lower(): value.strip()
        for name, _, value in (line.partition(':') for line in rest)}

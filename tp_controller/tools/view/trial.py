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
"""Test of a server at its start: requests of other sites that it must refuse."""

from collections.abc import Iterator
import socket
import time

from tp_controller.errors import TpControllerError
from tp_controller.tools.view.gate import HEADERS, is_local
from tp_controller.tools.view.guard import Guard, SUBPROTOCOL
import viser
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

FOREIGN = 'http://other.example'
# Message of a browser that sets a property of a widget other than its value.
FORGED = (b'\x83\xa4type\xb0GuiUpdateMessage\xa4uuid\xa1x\xa7updates\x81\xa8disabled\xc3')
# Timeouts of a response and of the check of a message on a busy machine [s].
ANSWER_SECONDS = CHECK_SECONDS = 30.0
POLL_SECONDS = 0.01


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
                 open_timeout=ANSWER_SECONDS) as browser:
        browser.send(FORGED)
        end = time.monotonic() + CHECK_SECONDS
        while guard.refused == before and time.monotonic() < end:
            time.sleep(POLL_SECONDS)
    if guard.refused == before:
        yield 'messages are not checked'


UPGRADE = ('\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
           'Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==')


def _near(host: str) -> str:
    """Return an address at which this machine reaches a server."""
    if is_local(host):
        return host
    return {'0.0.0.0': '127.0.0.1', '': '127.0.0.1', '::': '::1'}.get(host, host)


def _head(host: str, port: int, lines: str, target: str) -> tuple[int, dict[str, str]]:
    """Return status and headers (names in lower case) of the response to a request."""
    with socket.create_connection((host, port), ANSWER_SECONDS) as found:
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

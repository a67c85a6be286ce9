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

"""Server of the page: address, port and protection."""

from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
import io
import socket

from tp_controller.errors import TpControllerError
from tp_controller.tools.view.buffers import use_loop_buffers
from tp_controller.tools.view.gate import Gate, is_local, LOCAL
from tp_controller.tools.view.guard import Guard
from tp_controller.tools.view.trial import try_from_outside
import viser

# Ports that are tried if none is given.
PORTS = range(8080, 8180)
TITLE = 'tp_controller'
# Width of the panel beside the scene [pixels].
PANEL_WIDTH = 384


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

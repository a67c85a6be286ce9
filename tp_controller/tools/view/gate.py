# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""Access control of the page: accepted requests of browsers and programs, and the responses."""

from http import HTTPStatus
import ipaddress
import re
import socket
from urllib.parse import parse_qsl, urlsplit

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

LOCAL = '127.0.0.1'
# Largest number of browsers at a time.
MOST_CLIENTS = 32
SCHEMES = ('http://', 'https://')
# Query parameters that the page accepts. Others name servers and recordings elsewhere,
# which could run scripts in the page.
QUERIES = re.compile('fixedDpr|darkMode|showStats|logCamera|initialCamera[A-Z][A-Za-z]*')
HOST = re.compile(r'(?P<name>\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z_.-]+)(:[0-9]{1,5})?')
# Headers of every response; {host} is the host of the request. The page itself consists of
# ``data:`` URLs.
HEADERS = {
    'X-Frame-Options': 'DENY',
    'Content-Security-Policy':
        "frame-ancestors 'none'; connect-src 'self' ws://{host} wss://{host} data: blob:; "
        "object-src 'none'; base-uri 'none'; form-action 'none'",
    'Cross-Origin-Opener-Policy': 'same-origin',
    'Cross-Origin-Resource-Policy': 'same-origin',
    'X-Content-Type-Options': 'nosniff',
    'Referrer-Policy': 'no-referrer'}


def is_local(host: str) -> bool:
    """Return whether only this machine can reach an address."""
    if host == 'localhost':
        return True
    address = _ip(host)
    return address is not None and address.is_loopback


class Gate:
    """
    Access rule, the same for every address that a server listens on.

    ``Host`` must be a name of this machine, and connections must come from its page: ``Origin``
    equals ``Host``. Programs other than browsers send no ``Origin``.

    Parameters
    ----------
    host : str
        Address that the server listens on.

    """

    def __init__(self, host: str) -> None:
        self._exposed = not is_local(host)
        name = socket.gethostname().lower()
        self._names = {host.lower(), *((name, f'{name}.local') if self._exposed else ())}

    def refusal(self, request: Request) -> str:
        """Return the reason for refusing a request; empty if it is allowed."""
        hosts, origins = (request.headers.get_all(name) for name in ('Host', 'Origin'))
        if len(hosts) != 1 or not self._is_known(hosts[0]):
            return f'no name of this machine: {", ".join(hosts) or "no Host"}'
        if origins and (len(origins) > 1 or origins[0].lower() not in [
                f'{scheme}{hosts[0].lower()}' for scheme in SCHEMES]):
            return f'a page of another site: {", ".join(origins)}'
        try:
            queries = parse_qsl(urlsplit(request.path).query, keep_blank_values=True)
        except ValueError:
            return 'not an address of the page'
        unknown = [name for name, _ in queries if not QUERIES.fullmatch(name)]
        return f'not an address of the page: {", ".join(unknown)}' if unknown else ''

    def refuse(self, connection: ServerConnection, reason: str) -> Response:
        """Return the response to a refused request."""
        return self.protected(connection.respond(HTTPStatus.FORBIDDEN, f'Refused: {reason}\n'), '')

    def protected(self, response: Response, host: str) -> Response:
        """Return a response with the headers that keep other sites from using the page."""
        for name, value in HEADERS.items():
            response.headers[name] = value.replace(' ws://{host} wss://{host}', '') if not host \
                else value.replace('{host}', host)
        return response

    def _is_known(self, host: str) -> bool:
        """Return whether a host (and port) is a name of this machine."""
        match = HOST.fullmatch(host)
        if match is None:
            return False
        name = match['name'].strip('[]').lower()
        # A numeric address cannot be redirected by another site.
        return is_local(name) or name in self._names or (self._exposed and _ip(name) is not None)


def _ip(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return the numeric address in a name; None if it is not one."""
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Optional browser page of a running demo."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.error import URLError
from urllib.request import urlopen

from tp_controller.errors import TpControllerError
from tp_controller.tools.demos.processes import NodeProcess
from tp_controller.tools.demos.startup import Startup
from tp_controller.tools.extras import install_command

if TYPE_CHECKING:  # Imported when a demo starts: nothing else here needs ROS.
    from tp_controller.ros.client.client import Client

NODE = 'tp_viewer'
# Timeout of a response of the page [s].
VIEWER_ANSWER_SECONDS = 30.0
WITHOUT_PAGE = 'no page in the browser, the demo continues without it: '


class LivePage:
    """Page of a demo, in its own process, with its address."""

    def __init__(self, process: NodeProcess, address: str) -> None:
        self._process, self._address = process, address

    def wait(self, turn: Callable[[float], None], report: Callable[[str], None]) -> str:
        """Wait until the page answers (`Startup`); return its address, or the fault, as text."""
        try:
            Startup([self._process], report).wait(
                lambda: '' if _answers(self._address) else 'the page in the browser', turn)
        except TpControllerError as error:
            return f'{WITHOUT_PAGE}{error}'
        return f'page: {self._address}'

    def conclude(self, client: 'Client', text: str) -> bool:
        """Show the results of the demo on the page; return the success."""
        from tp_controller.ros.client.remote_parameters import set_parameter
        return self._process.running() and set_parameter(
            client, NODE, 'conclusion', text, VIEWER_ANSWER_SECONDS)


def start_page(stack: ExitStack, environment: Mapping[str, str], folder: Path) -> LivePage:
    """
    Start the page of a demo, with its log in a folder, until a stack ends.

    Raises
    ------
    TpControllerError
        The page is impossible; the reason begins with `WITHOUT_PAGE`.

    """
    if find_spec('viser') is None:
        raise TpControllerError(f'{WITHOUT_PAGE}viser is missing; {install_command("view")}')
    # Imported only if installed: it is an extra.
    from tp_controller.tools.view.server import free_port, LOCAL, url
    try:
        port = free_port(LOCAL)
    except TpControllerError as error:
        raise TpControllerError(f'{WITHOUT_PAGE}{error}') from error
    process = NodeProcess('viewer_node', ['-p', f'port:={port}'], environment,
                          folder / 'viewer_node.log')
    return LivePage(stack.enter_context(process), url(LOCAL, port))


def _answers(address: str) -> bool:
    """Return whether an address responds."""
    try:
        with urlopen(address, timeout=1.0):
            return True
    except (URLError, OSError):
        return False

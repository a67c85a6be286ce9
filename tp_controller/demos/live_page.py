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

"""The page in the browser beside a demo: it shows what happens, and the demo does without it."""

from collections.abc import Mapping
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
import time
from urllib.error import URLError
from urllib.request import urlopen

from tp_controller.demos.processes import NodeProcess
from tp_controller.errors import TpControllerError
from tp_controller.extras import install_command

# For how long the page is waited for, and how often it is looked for [s].
START_SECONDS, LOOK_SECONDS = 15.0, 0.05
WITHOUT = 'no page in the browser, the demo goes on without it: '


def start_page(stack: ExitStack, environment: Mapping[str, str], folder: Path) -> str:
    """
    Start the page of a demo, until a stack ends.

    Parameters
    ----------
    stack : contextlib.ExitStack
        Ends the page.
    environment : dict
        Of the nodes of the demo.
    folder : pathlib.Path
        Where its log goes.

    Returns
    -------
    str
        Where the page is, or why there is none.

    """
    if find_spec('viser') is None:
        return f'{WITHOUT}viser is missing; {install_command("view")}'
    # Imported where it is there: it is an extra.
    from tp_controller.view.server import free_port, LOCAL, url
    try:
        port = free_port(LOCAL)
    except TpControllerError as error:
        return f'{WITHOUT}{error}'
    page = stack.enter_context(NodeProcess('viewer_node', ['-p', f'port:={port}'], environment,
                                           folder / 'viewer_node.log'))
    until = time.monotonic() + START_SECONDS
    while page.running() and time.monotonic() < until:
        if _answers(url(LOCAL, port)):
            return f'page: {url(LOCAL, port)}'
        time.sleep(LOOK_SECONDS)
    said = page.output().strip().splitlines()
    return f'{WITHOUT}{said[-1] if said else "it did not start"}'


def _answers(address: str) -> bool:
    """Return whether there is a page at an address."""
    try:
        with urlopen(address, timeout=1.0):
            return True
    except (URLError, OSError):
        return False

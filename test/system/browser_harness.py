# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A page that the process of the test serves, and the browser that opens it."""

from importlib.util import find_spec

import pytest
from tp_controller.tools.demos.chromium import chromium_flags, find_chromium

# Without a graphics card, on a machine with much to do, the page takes most of a minute to open.
SECONDS = 120.0
NEEDS = {'rclpy': 'ROS 2', 'viser': 'viser', 'playwright': 'playwright'}
NEEDS_BROWSER = [
    *(pytest.mark.skipif(find_spec(module) is None, reason=f'needs {what}')
      for module, what in NEEDS.items()),
    pytest.mark.skipif(find_chromium() is None, reason='needs a Chromium on the PATH')]


@pytest.fixture(scope='module')
def server():
    """Return the server of an empty page."""
    from tp_controller.tools.view.server import LOCAL, open_server, unused_port
    found = open_server(LOCAL, unused_port())
    yield found
    found.stop()


@pytest.fixture(scope='module')
def chromium():
    """Return a browser."""
    from playwright.sync_api import sync_playwright
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_chromium(), args=chromium_flags())
        yield browser
        browser.close()

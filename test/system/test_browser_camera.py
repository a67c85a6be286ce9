# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Where browsers look from: at the robot first, wherever it is, and then as somebody chooses."""

import time
from types import SimpleNamespace

from browser_harness import NEEDS_BROWSER, SECONDS
import numpy as np
import pytest
from robots import panda, planar

pytestmark = NEEDS_BROWSER

SIZE = {'width': 800, 'height': 500}


class FakeLink(SimpleNamespace):
    """What a page hears of a controller with a robot, of which it is not known yet where it is."""

    def __init__(self, robot):
        super().__init__(
            client=SimpleNamespace(publish=None, tasks=dict, controller='tp_controller'),
            robot=robot, q=None, passive=np.empty(0), velocity=np.zeros(robot.n), markers=[],
            rows=[], values={}, head='running', fault='', present=True, running=True)

    def update(self):
        """Hear nothing new."""

    def watch(self, wanted):
        """Listen to nothing else."""

    def gains(self):
        """Return no gains."""
        return {}


class Window:
    """
    A browser's window with the page of a controller.

    Attributes
    ----------
    link : FakeLink
    page : tp_controller.tools.view.page.Page
    tab : playwright.sync_api.Page

    """

    def __init__(self, server, chromium):
        from tp_controller.tools.view.page import Page
        from tp_controller.tools.view.server import address
        server.scene.reset()
        server.gui.reset()
        self.link = FakeLink(panda())
        self._server, self.page = server, Page(server, self.link)
        self.page.update()
        self.tab = chromium.new_page(viewport=SIZE)
        self.tab.set_default_timeout(1e3 * SECONDS)
        self.tab.goto(f'{address(server)}/?fixedDpr=0.5')
        self.wait(self.cameras, 'the browser')

    def cameras(self):
        """Return the cameras of all browsers."""
        return [client.camera for client in self._server.get_clients().values()]

    def wait(self, condition, what):
        """Keep the page up to date until a condition holds."""
        for _ in range(int(SECONDS / 0.02)):
            self.page.update()
            if condition():
                return
            time.sleep(0.02)
        pytest.fail(f'{what} did not come about within {SECONDS:g} s')

    def looks_from(self, position, target):
        """Return whether the browser looks from a point at another (3,) [m]."""
        camera, = self.cameras()
        return np.allclose([camera.position, camera.look_at], [position, target], atol=1e-3)

    def hear(self):
        """Wait until the browser has done what it was told up to now."""
        said = self._server.gui.add_html('<p data-heard="yes">heard</p>')
        self.wait(self.tab.locator('[data-heard]').count, 'the last message')
        said.remove()
        self.wait(lambda: not self.tab.locator('[data-heard]').count(), 'the end of it')

    def close(self):
        """Close it."""
        self.tab.close()
        self.wait(lambda: not self.cameras(), 'the end')


@pytest.fixture
def window(server, chromium):
    """Return a window that is open before it is known where the robot is."""
    found = Window(server, chromium)
    yield found
    found.close()


def first_view(window):
    """Return from where the robot is seen well where it is now."""
    from tp_controller.tools.view import camera
    return camera.first_view(window.page._robot.outer_points())


def test_a_browser_that_is_open_already_goes_once_to_where_the_robot_is_seen(window):
    window.link.q = np.array([2.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0])
    window.wait(lambda: window.looks_from(*first_view(window)), 'the first view')
    first = first_view(window)
    # What moves then, or even comes in place of it, does not move the camera.
    window.link.q = window.link.robot.neutral()
    window.hear()
    window.link.robot = planar()
    window.link.q, window.link.velocity = np.zeros(3), np.zeros(3)
    window.hear()
    assert not np.allclose(first_view(window), first, atol=0.1)
    assert window.looks_from(*first)

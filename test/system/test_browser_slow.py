# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A browser that draws seldom takes everything that happened meanwhile at once, without errors."""

from browser_harness import NEEDS_BROWSER, SECONDS
import pytest
from robots import panda, planar

# Nothing is drawn while `busy` is true: what arrives waits until then. `said` is the last text
# of the server that has arrived, drawn or not.
BUSY = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = (callback) => {
    const drawUnlessBusy = (time) =>
        window.busy ? setTimeout(() => draw(drawUnlessBusy), 10) : callback(time);
    return draw(drawUnlessBusy);
};
window.Worker = class extends window.Worker {
    constructor(...options) {
        super(...options);
        this.addEventListener('message', (event) => {
            for (const message of event.data.messages ?? [])
                window.said = message.updates?.content ?? window.said;
        });
    }
};
"""

pytestmark = NEEDS_BROWSER


class SlowTab:
    """
    A page that draws when it is told to.

    Attributes
    ----------
    faults : list of str
        Errors on its console.

    """

    def __init__(self, server, browser):
        from tp_controller.tools.view.server import address
        server.scene.reset()
        server.gui.reset()
        self.faults, self._text = [], server.gui.add_html('')
        self._frame = server.scene.add_frame('/frame')
        self._page = browser.new_page(viewport={'width': 400, 'height': 300})
        self._page.set_default_timeout(1e3 * SECONDS)
        self._page.add_init_script(BUSY)
        self._page.on('console', lambda message: self.faults.append(message.text)
                      if message.type == 'error' else None)
        self._page.goto(address(server))
        self._count = 0
        self._wait_until_shown()

    def _say(self):
        """Say something that was not said before, and return it."""
        self._count += 1
        text = f'<p data-said="{self._count}">{self._count}</p>'
        self._text.content = text
        return text

    def _wait_until_shown(self):
        """Wait until the page shows everything that was sent."""
        self._say()
        self._page.locator(f'[data-said="{self._count}"]').wait_for()

    def wait_until_heard(self):
        """Wait until everything that was sent has arrived, whether it is drawn or not."""
        self._page.wait_for_function('text => window.said === text', arg=self._say(), polling=20)

    def be_busy(self):
        """Draw nothing for now."""
        self._page.evaluate('window.busy = true')
        # Only what is in the scene waits to be drawn, and what comes after it.
        self._frame.position = (1.0, 0.0, 0.0)
        self.wait_until_heard()

    def take(self):
        """Draw everything that has come meanwhile."""
        self._page.evaluate('window.busy = false')
        self._wait_until_shown()

    def shows(self, text):
        """Return whether a text is on the page."""
        return self._page.get_by_text(text).count() > 0

    def close(self):
        """Close the page."""
        self._page.close()


@pytest.fixture
def tab(server, chromium):
    """Return a page that shows all there is."""
    found = SlowTab(server, chromium)
    yield found
    found.close()


# `heard` waits until a browser has what was shown before.


def row(name):
    """Return what is shown of a task."""
    from tp_controller.ros.client.status import TaskStatus
    return TaskStatus(name, 'position', '1', 'moving', {'m': 0.1}, {}, 2.0, 1.0)


def change_robots(gui, heard):
    """Show sliders of one robot, and then of another with fewer joints."""
    from tp_controller.tools.view.joint_sliders import JointSliders
    joints = JointSliders(gui, None)
    for robot in (panda(), planar()):
        joints.build(robot)
        joints.show(robot, robot.neutral(), ['posture'])
        heard()


def change_tasks(gui, heard):
    """Show tasks, and then others."""
    from tp_controller.tools.view.stack_panel import StackPanel
    stack = StackPanel(gui, None, None, None)
    for names in (['tool', 'elbow', 'rest'], ['hand', 'rest']):
        stack.show([row(name) for name in names], dict.fromkeys(names, 1.0))
        heard()


def change_gains(gui, heard):
    """Show a gain for each row of a task, and then one for all."""
    from tp_controller.tools.view.stack_panel import StackPanel
    stack = StackPanel(gui, None, None, None)
    for gain in ([1.0, 2.0], [3.0, 4.0], 1.0, 2.0):
        stack.show([row('tool')], {'tool': gain})
        heard()


@pytest.mark.parametrize('change, shown, gone', [
    (change_robots, ['joint1', 'joint3'], ['panda_joint1', 'panda_joint7']),
    (change_tasks, ['1 · hand', '2 · rest'], ['· tool', '· elbow']),
    (change_gains, ['gain'], ['row 1', 'row 2'])])
def test_tab_that_could_not_draw_takes_all_changes_at_once_without_errors(
        server, tab, change, shown, gone):
    tab.be_busy()
    change(server.gui, tab.wait_until_heard)
    tab.take()
    assert tab.faults == []
    assert all(map(tab.shows, shown)) and not any(map(tab.shows, gone))

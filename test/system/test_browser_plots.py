# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The plots of the page while a browser is slow to draw them."""

from browser_harness import NEEDS_BROWSER, SECONDS
import pytest

# Pictures are not drawn while it is set.
PAUSE = """
    const draw = window.requestAnimationFrame.bind(window), waiting = [];
    window.paused = false;
    window.requestAnimationFrame = callback => window.paused ? waiting.push(callback) && 0
                                                           : draw(callback);
    window.resume = () => {
        window.paused = false;
        waiting.splice(0).forEach(each => draw(each));
    };
"""
SEEN = """() => [...document.querySelectorAll('.uplot')].map(plot => [
    plot.querySelector('canvas').width, getComputedStyle(plot).visibility])"""

pytestmark = NEEDS_BROWSER


@pytest.fixture
def page(server, chromium):
    """Return a page with a tab of plots, which is not open yet."""
    from tp_controller.tools.view.plots import Plots
    from tp_controller.tools.view.server import address
    server.scene.reset()
    server.gui.reset()
    tabs = server.gui.add_tab_group()
    stack, tab = tabs.add_tab('Stack'), tabs.add_tab('Plots')
    plots = Plots(server.gui, tab)
    for time in range(3):
        plots.errors.add(float(time), {'tool [m]': 0.1})
    with tab:
        plots.errors.show()
    # The page handles messages in order, and none while pictures are paused: this is the last one.
    with stack:
        server.gui.add_html('a stack')
    page = chromium.new_page(viewport={'width': 800, 'height': 600})
    page.set_default_timeout(1e3 * SECONDS)
    page.add_init_script(PAUSE)
    page.goto(address(server))
    page.get_by_text('a stack').wait_for()
    yield page
    page.close()


def test_a_plot_is_hidden_until_it_has_a_width(page):
    page.get_by_role('tab', name='Plots').focus()
    page.evaluate('window.paused = true')
    # A click waits for two pictures, which do not come, and misses a tab that moves.
    page.keyboard.press('Enter')
    page.wait_for_function('document.querySelector(".uplot canvas")', polling=100)
    assert page.evaluate(SEEN) == [[0, 'hidden']]
    page.evaluate('window.resume()')
    page.wait_for_function('document.querySelector(".uplot canvas").width > 100', polling=100)
    assert [visibility for _, visibility in page.evaluate(SEEN)] == ['visible']

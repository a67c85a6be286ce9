# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What is written in the panel of the page can be read there."""

from browser_harness import NEEDS_BROWSER, SECONDS
import numpy as np
import pytest
from tp_controller.model.robot import Robot

pytestmark = NEEDS_BROWSER

# {joint: (its type, lower and upper limit, where it is)} [rad or m]
JOINTS = {'turn': ('revolute', -np.pi, np.pi, -2.356194),
          'wind': ('revolute', -31.4, 31.4, -28.2743),
          'rail': ('prismatic', -12.3456, 14.0, -9.87654),
          'finger': ('prismatic', 0.0, 0.04, 0.0123),
          'far': ('prismatic', -1000.0, -100.55, -103.456)}
GAINS = {'one': 1234.56789, 'rows': [0.012345, 123456.7, 1e-5]}
# Of each input that is seen: what is in it, and whether there is more than there is place for.
READ = """inputs => inputs.filter(input => input.offsetParent && input.type === 'text')
          .map(input => [input.value, input.scrollWidth > input.clientWidth])"""


def robot():
    """Return a robot with one joint after the other."""
    names = list(JOINTS)
    return Robot.from_urdf('<robot name="chain"><link name="base"/>' + ''.join(
        f'<link name="{name}_link"/><joint name="{name}" type="{kind}">'
        f'<parent link="{f"{names[number - 1]}_link" if number else "base"}"/>'
        f'<child link="{name}_link"/><axis xyz="0 0 1"/>'
        f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
        for number, (name, (kind, lower, upper, _)) in enumerate(JOINTS.items())) + '</robot>')


@pytest.fixture
def inputs(server, chromium):
    """Return what is in the inputs of a panel with sliders and gains: (text, is it cut off)."""
    from tp_controller.ros.client.status import TaskStatus
    from tp_controller.tools.view.joint_sliders import JointSliders
    from tp_controller.tools.view.server import address
    from tp_controller.tools.view.stack_panel import StackPanel
    server.scene.reset()
    server.gui.reset()
    joints, stack = JointSliders(server.gui, None), StackPanel(server.gui, None, None, None)
    joints.build(robot())
    joints.show(robot(), np.array([joint[-1] for joint in JOINTS.values()]), ['posture'])
    stack.show([TaskStatus(name, 'position', '1', 'moving', {'m': 0.1}, {}, 2.0, 1.0)
                for name in GAINS], GAINS)
    page = chromium.new_page(viewport={'width': 1280, 'height': 1000})
    page.set_default_timeout(1e3 * SECONDS)
    page.goto(address(server))
    page.get_by_text('far', exact=True).wait_for()
    # Gains of rows are in a folder, which is closed.
    page.get_by_text('gain', exact=True).last.click()
    page.get_by_text('row 3', exact=True).wait_for()
    yield page.locator('input').evaluate_all(READ)
    page.close()


def test_numbers_of_sliders_and_gains_fit_in_their_boxes(inputs):
    wanted = [joint[-1] for joint in JOINTS.values()] + [GAINS['one'], *GAINS['rows']]
    shown = [(float(text), cut) for text, cut in inputs if text[-1:].isdigit()]
    assert not any(cut for _, cut in shown), shown
    np.testing.assert_allclose([number for number, _ in shown], wanted, rtol=0.03)

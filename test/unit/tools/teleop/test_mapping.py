# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Axes and buttons become a twist as the texts of a device say."""

import numpy as np
import pytest
from tp_controller.tools.teleop.mapping import Scaling, Source

AXES, BUTTONS = (0.5, -0.25, 1.0), (0, 1, 1)


@pytest.mark.parametrize(('text', 'value'), [
    ('', 0.0), ('axis 0', 0.5), ('-axis 1', 0.25), ('axis 2 - axis 0', 0.5),
    ('button 0 - button 1', -1.0), ('- axis 0 + button 2', 0.5), (' +axis 1 ', -0.25),
    ('axis 3', 0.0), ('button 3 + axis 0', 0.5)])
def test_a_sum_of_axes_and_buttons_is_read(text, value):
    assert Source(text).value(AXES, BUTTONS) == value
    assert bool(Source(text)) == bool(text)


@pytest.mark.parametrize('text', ['axis', 'axis -1', 'axis 1 axis 2', '1', 'knob 1', 'axis 1 -',
                                  'axis 1.5', 'axis 1 * 2'])
def test_what_is_not_a_sum_is_refused(text):
    with pytest.raises(ValueError, match='is not a sum such as axis 1'):
        Source(text)


@pytest.mark.parametrize(('text', 'pressed'), [
    ('button 1', True), ('button 0', False), ('axis 2', True), ('axis 0', False),
    ('-axis 0', False), ('', False)])
def test_a_switch_is_pressed_beyond_half_of_its_way(text, pressed):
    assert Source(text).pressed(AXES, BUTTONS) is pressed


def test_an_axis_that_the_device_lacks_is_named():
    assert Source('axis 0 - axis 4').missing(AXES) == 'axis 4'
    # Buttons of some devices are there from their first press on.
    assert Source('axis 2 + button 9').missing(AXES) == ''


def test_full_deflection_is_the_scale_and_more_is_no_more():
    twist = Scaling(0.2, 0.6, 0.1).twist([1.0, -1.0, 3.0, 1.0, -1.5, 0.0])
    np.testing.assert_allclose(twist, [0.2, -0.2, 0.2, 0.6, -0.6, 0.0])


def test_motion_begins_from_zero_at_the_deadband():
    scaling = Scaling(1.0, 1.0, 0.2)
    np.testing.assert_allclose(scaling.twist([0.2, -0.2, 0.6, -0.6, 0.2 + 1e-9, 0.1]),
                               [0.0, 0.0, 0.5, -0.5, 1.25e-9, 0.0], rtol=1e-6)

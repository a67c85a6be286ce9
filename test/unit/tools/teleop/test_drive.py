# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A device commands a twist while its switch is pressed, and zeros once it is not."""

import math

import numpy as np
import pytest
from tp_controller.tools.teleop.drive import Drive, FINAL_ZEROS
from tp_controller.tools.teleop.mapping import Scaling, Source

STICK = {'x': Source('axis 0'), 'rz': Source('-axis 1')}
SCALING = Scaling(0.2, 1.0, 0.0)


def drive(sources=STICK, dead_man='button 0', ramp=0.0, **options):
    """Return a drive with a timeout of 0.2 s."""
    return Drive(sources, Source(dead_man), SCALING, 0.2, ramp, **options)


def twists(each, now):
    """Return the twists of cycles at one time, until there is none."""
    found = []
    while len(found) < 10 and (twist := each.command(now)) is not None:
        found.append(twist.tolist())
    return found


def test_the_deflection_is_commanded_while_the_switch_is_pressed():
    each = drive()
    each.take_joy((1.0, 0.5), (0,), 0.0)
    assert each.command(0.0) is None
    each.take_joy((1.0, 0.5), (1,), 0.0)
    np.testing.assert_allclose(each.command(0.0), [0.2, 0, 0, 0, 0, -0.5])
    each.take_joy((0.5, 0.0), (1,), 0.1)
    np.testing.assert_allclose(each.command(0.1), [0.1, 0, 0, 0, 0, 0])
    each.take_joy((0.5, 0.0), (0,), 0.1)
    assert twists(each, 0.1) == [[0.0] * 6] * FINAL_ZEROS


def test_a_lost_stream_ends_in_zeros():
    each = drive()
    each.take_joy((1.0, 0.5), (0,), 0.0)
    each.take_joy((1.0, 0.5), (1,), 0.0)
    assert each.command(0.2).any()
    assert twists(each, 0.25) == [[0.0] * 6] * FINAL_ZEROS
    assert each.reason(0.25) == 'timeout: no input on joy for 0.2 s'


def test_speed_rises_from_zero():
    each = drive(ramp=0.1)
    each.take_joy((1.0, 0.0), (0,), 0.0)
    each.take_joy((1.0, 0.0), (1,), 0.0)
    assert [each.command(now)[0] for now in (0.0, 0.05, 0.1)] == pytest.approx([0.0, 0.1, 0.2])


def test_without_a_switch_a_deflection_counts_as_pressed():
    each = drive(dead_man='')
    each.take_joy((1.0, 0.0), (), 0.0)
    assert each.command(0.0) is None
    assert each.reason(0.0) == 'timeout: bring the device to rest once'
    each.take_joy((0.0, 0.0), (), 0.0)
    assert each.reason(0.0) == 'at rest'
    each.take_joy((1.0, 0.0), (), 0.1)
    assert each.command(0.1)[0] == 0.2
    each.take_joy((0.0, 0.0), (), 0.1)
    assert twists(each, 0.1) == [[0.0] * 6] * FINAL_ZEROS


@pytest.mark.parametrize(('unitless', 'expected'), [
    (True, [0.2, -0.1, 0, 0, 0, 1]), (False, [2, -0.5, 0, 0, 0, 1])])
def test_twists_are_deflections_or_velocities(unitless, expected):
    each = drive({}, '', unitless=unitless)
    each.take_twist([0.0] * 6, 0.0)
    each.take_twist([2, -0.5, 0, 0, 0, 1], 0.0)
    np.testing.assert_allclose(each.command(0.0), expected)


def test_a_switch_for_twists_comes_from_the_buttons():
    each = drive({})
    each.take_twist([1, 0, 0, 0, 0, 0], 0.0)
    assert each.reason(0.0) == 'timeout: no input on joy'
    each = drive({})
    each.take_joy((), (0,), 0.0)
    each.take_twist([1, 0, 0, 0, 0, 0], 0.0)
    # The switch has to be open once while both are there.
    each.take_joy((), (1,), 0.05)
    assert each.command(0.05) is None
    each.take_joy((), (0,), 0.1)
    each.take_joy((), (1,), 0.1)
    assert each.command(0.1)[0] == 0.2
    # Twists alone do not stand in for the buttons, nor buttons for twists.
    each.take_twist([1, 0, 0, 0, 0, 0], 0.25)
    assert each.command(0.31).any() == 0
    assert each.reason(0.31) == 'timeout: no input on joy for 0.2 s'


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_input_that_is_not_finite_is_no_input(value):
    each = drive()
    each.take_joy((0.0, 0.0), (0,), 0.0)
    each.take_joy((1.0, 0.0), (1,), 0.0)
    assert each.take_joy((value, 0.0), (1,), 0.15) == 'axes that are not finite'
    assert each.command(0.15)[0] == 0.2
    assert not each.command(0.21).any()
    streamed = drive({}, '')
    assert streamed.take_twist([0, 0, value, 0, 0, 0], 0.0) == 'a twist that is not finite'
    assert streamed.reason(0.0) == 'timeout: no input on twist'


def test_a_missing_axis_is_told_and_the_others_count():
    each = drive()
    assert each.take_joy((0.0,), (0,), 0.0) == 'axis 1 is missing: the device has 1 axes'
    each.take_joy((1.0,), (1,), 0.0)
    assert each.command(0.0).tolist() == [0.2, 0, 0, 0, 0, 0]


def test_another_scaling_acts_in_the_next_cycle():
    each = drive()
    each.take_joy((0.0, 0.0), (0,), 0.0)
    each.take_joy((1.0, 0.0), (1,), 0.0)
    each.scaling = Scaling(0.05, 1.0, 0.0)
    assert each.command(0.0)[0] == 0.05

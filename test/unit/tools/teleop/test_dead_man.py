# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Nothing moves but while the switch is pressed and the streams are alive."""

import math

import pytest
from tp_controller.tools.teleop.dead_man import DeadManSwitch, SWITCH

OPEN, AGAIN = SWITCH


def switch(ramp=0.0, streams=('joy',)):
    """Return a switch that was open at 0 s."""
    made = DeadManSwitch(dict.fromkeys(streams, 0.2), ramp)
    for stream in streams:
        made.receive(stream, 0.0)
    made.press(False, 0.0)
    return made


def test_a_press_moves_and_opening_stops():
    each = switch()
    assert (each.share(0.1), each.reason(0.1)) == (0.0, OPEN)
    each.press(True, 0.1)
    assert (each.share(0.1), each.reason(0.1)) == (1.0, '')
    each.press(False, 0.15)
    assert (each.share(0.15), each.reason(0.15)) == (0.0, OPEN)


def test_a_switch_that_is_pressed_at_the_start_has_to_be_opened():
    each = DeadManSwitch({'joy': 0.2})
    assert each.reason(0.0) == 'timeout: no input on joy'
    for pressed, share, reason in ((True, 0.0, AGAIN), (False, 0.0, OPEN), (True, 1.0, '')):
        each.receive('joy', 0.1)
        each.press(pressed, 0.1)
        assert (each.share(0.1), each.reason(0.1)) == (share, reason)


def test_a_lost_stream_stops_and_does_not_go_on_by_itself():
    each = switch()
    each.press(True, 0.0)
    assert each.share(0.2) == 1.0
    assert not each.closed(0.2001) and each.share(0.2001) == 0.0
    assert each.reason(0.3) == 'timeout: no input on joy for 0.2 s'
    each.receive('joy', 0.4)
    each.press(True, 0.4)
    assert (each.share(0.4), each.reason(0.4)) == (0.0, AGAIN)
    each.press(False, 0.4)
    each.press(True, 0.45)
    assert each.share(0.45) == 1.0


def test_a_loss_that_nobody_looked_at_counts():
    each = switch()
    each.press(True, 0.0)
    each.receive('joy', 1.0)
    each.press(True, 1.0)
    assert each.share(1.0) == 0.0


def test_a_switch_that_need_not_be_open_first_counts_from_its_first_message():
    each = DeadManSwitch({'joy': 0.2}, open_first=False)
    for now in (0.0, 1.0):
        each.receive('joy', now)
        each.press(True, now)
        assert each.share(now) == 1.0
        assert each.share(now + 0.3) == 0.0


def test_every_stream_has_to_be_alive():
    each = switch(streams=('joy', 'pose'))
    each.press(True, 0.1)
    each.receive('joy', 0.2)
    assert each.share(0.2) == 1.0
    assert each.share(0.21) == 0.0
    assert each.reason(0.21) == 'timeout: no input on pose for 0.2 s'


def test_speed_rises_from_zero_after_every_press():
    each = switch(ramp=0.1)
    for press in (0.05, 0.15):
        each.press(True, press)
        each.receive('joy', press)
        assert [each.share(press + time) for time in (0.0, 0.025, 0.05, 0.1, 0.15)] \
            == pytest.approx([0.0, 0.25, 0.5, 1.0, 1.0])
        each.press(False, press + 0.05)


def test_further_messages_of_a_pressed_switch_do_not_begin_anew():
    each = switch(ramp=0.1)
    each.press(True, 0.0)
    each.press(True, 0.05)
    assert each.share(0.1) == pytest.approx(1.0)


def test_a_clock_that_was_set_back_loses_the_stream():
    each = switch()
    each.press(True, 0.0)
    assert each.share(-0.3) == 0.0
    assert math.isclose(each.share(0.0), 0.0)

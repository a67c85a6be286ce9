# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A tool follows a device while the clutch is pressed, and stays where it is once it is not."""

import math

import numpy as np
import pytest
from tp_controller.tools.teleop.clutch import Clutch, FINAL_GOALS, Largest, TOOL_SECONDS
from tp_controller.tools.teleop.mapping import Source
from tp_controller.tools.teleop.motion import Following

TIMEOUT = 0.2
LEVEL = (0.0, 0.0, 0.0, 1.0)
OPEN = 'timeout: dead-man switch not pressed'
AGAIN = 'open the dead-man switch once, then press it'


class Rig:
    """A clutch, its device and its tool, at times that the test gives."""

    def __init__(self, switch='', largest=Largest(), **following):
        self.clutch = Clutch(Source(switch), Following(**following), largest, TIMEOUT)
        self.tool, self.device = [0.5, 0.0, 0.4], [1.0, 2.0, 3.0]
        self.pressed, self.now = False, 0.0

    def send(self, now=None, stamp=0.0):
        """Send the pose of the device and its switch; return the fault."""
        self.now = self.now if now is None else now
        fault = self.clutch.take_pose((*self.device, *LEVEL), stamp, self.now)
        self.clutch.take_switch(self.pressed, self.now)
        return fault

    def see(self, frame='hand', reference='base'):
        """Send the pose of the tool."""
        return self.clutch.take_tool(reference, frame, (*self.tool, *LEVEL), self.now)

    def press(self):
        """Open the switch, then press it, where device and tool are."""
        # All streams have to be alive before the switch counts as open.
        for self.pressed in (False, False, True):
            self.send()
            self.see()

    def goal(self):
        """Return frame and place of the goal of a cycle."""
        found = self.clutch.command(self.now)
        return None if found is None else (found.frame, found.T[:3, 3].round(9).tolist())

    def goals(self):
        """Return the goals of cycles at one time, until there is none."""
        found = []
        while len(found) < 3 * FINAL_GOALS and (goal := self.goal()) is not None:
            found.append(goal)
        return found

    @property
    def reason(self):
        """Return the reason for which nothing moves."""
        return self.clutch.reason(self.now)


REST = ('hand', [0.0, 0.0, 0.0])


def test_the_tool_follows_from_where_it_was_at_the_press():
    rig = Rig()
    rig.press()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])
    rig.device[0] += 0.1
    rig.send(0.1)
    assert rig.goal() == ('base', [0.6, 0.0, 0.4])
    assert rig.clutch.closed(0.1) and not rig.reason


def test_opening_leaves_the_tool_where_it_is():
    rig = Rig()
    rig.press()
    assert rig.goal()[0] == 'base'
    rig.pressed = False
    rig.send(0.05)
    assert not rig.clutch.closed(0.05) and rig.reason == OPEN
    assert rig.goals() == [REST] * FINAL_GOALS


def test_a_press_anew_begins_from_where_both_are_then():
    rig = Rig()
    rig.press()
    rig.device[0] += 0.1
    rig.send()
    assert rig.goal() == ('base', [0.6, 0.0, 0.4])
    rig.pressed = False
    rig.send()
    assert rig.goals()[-1] == REST
    rig.device, rig.tool = [9.0, 9.0, 9.0], [0.58, 0.0, 0.4]
    rig.press()
    assert rig.goal() == ('base', [0.58, 0.0, 0.4])
    rig.device[2] -= 0.2
    rig.send()
    assert rig.goal() == ('base', [0.58, 0.0, 0.2])


def test_a_press_holds_the_tool_until_its_pose_is_known():
    rig = Rig()
    rig.send()
    rig.see()
    for rig.pressed in (False, True):
        rig.send()
    assert rig.goals() == [REST] * FINAL_GOALS
    assert rig.reason == 'timeout: waiting for the pose of the tool'
    assert not rig.clutch.closed(0.0)
    # What the device moved meanwhile does not count.
    rig.device[0] += 0.3
    rig.send()
    rig.see()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])
    rig.pressed = False
    rig.send()
    assert rig.goals() == [REST] * FINAL_GOALS


def test_a_press_anew_counts_even_between_two_cycles():
    rig = Rig()
    rig.press()
    for rig.pressed in (False, True):
        rig.send()
    rig.device[0] += 0.3
    rig.send()
    assert rig.goal() == REST
    rig.see()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])


@pytest.mark.parametrize('lost', ['pose', 'dead_man_topic', 'transform'])
def test_a_lost_stream_leaves_the_tool_where_it_is_until_the_switch_was_open(lost):
    rig = Rig()
    rig.press()
    assert rig.goal()[0] == 'base'
    timeout = TOOL_SECONDS if lost == 'transform' else TIMEOUT
    sent = {'pose': lambda now: rig.clutch.take_pose((*rig.device, *LEVEL), 0.0, now),
            'dead_man_topic': lambda now: rig.clutch.take_switch(True, now),
            'transform': lambda now: rig.see()}
    for now in np.arange(0.0, timeout + 0.001, 0.05):
        rig.now = now
        for stream, send in sent.items():
            if stream != lost:
                send(now)
    assert rig.goal()[0] == 'base'
    rig.now = timeout + 0.01
    assert rig.goals() == [REST] * FINAL_GOALS
    assert rig.reason == f'timeout: no input on {lost} for {timeout:g} s'
    for send in sent.values():
        send(rig.now)
    assert rig.goals() == [] and rig.reason == f'timeout: {AGAIN}'
    rig.press()
    assert rig.goal()[0] == 'base'


def test_a_switch_that_is_pressed_at_the_start_moves_nothing():
    rig = Rig()
    rig.pressed = True
    rig.send()
    rig.see()
    assert rig.goals() == [] and rig.reason == f'timeout: {AGAIN}'


def test_a_button_is_a_switch_too():
    rig = Rig('button 1')
    for pressed in (0, 0, 1):
        rig.clutch.take_joy((), (0, pressed), 0.0)
        rig.clutch.take_pose((*rig.device, *LEVEL), 0.0, 0.0)
        rig.see()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])
    rig.clutch.take_joy((), (1, 0), 0.0)
    assert rig.goal() == REST


def test_axes_that_are_not_finite_count_as_lost():
    rig = Rig('-axis 0')
    assert rig.clutch.take_joy((math.nan,), (), 0.0) == 'axes that are not finite'
    assert rig.reason == 'timeout: no input on joy'
    assert rig.clutch.take_joy((), (), 0.0) == 'axis 0 is missing: the device has 0 axes'


# What cannot be believed -----------------------------------------------------------------------


@pytest.mark.parametrize('values', [
    (math.nan, 0, 0, 0, 0, 0, 1), (0, math.inf, 0, 0, 0, 0, 1), (0, 0, 0, 0, 0, 0, 0)])
def test_a_pose_that_is_none_is_ignored(values):
    rig = Rig()
    rig.press()
    assert rig.clutch.take_pose(values, 0.0, 0.1)
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])
    rig.clutch.take_switch(True, 0.2)
    rig.now = 0.3
    assert rig.reason == 'timeout: no input on pose for 0.2 s'


def test_a_pose_of_the_tool_that_is_none_is_ignored():
    rig = Rig()
    rig.press()
    assert rig.clutch.take_tool('base', 'hand', (0, 0, 0, 0, 0, 0, 0), 0.0)
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])


def test_poses_that_are_overtaken_or_repeated_are_ignored():
    rig = Rig()
    rig.send(stamp=50.0)
    rig.press()
    for stamp, follows in ((50.1, True), (50.05, False), (50.1, False), (50.2, True)):
        rig.device[0] += 0.01
        before = rig.goal()
        assert bool(rig.send(stamp=stamp)) is not follows
        assert (rig.goal() != before) is follows


def test_a_repeated_pose_does_not_keep_the_stream_alive():
    rig = Rig()
    rig.press()
    for now in np.arange(0.0, 0.31, 0.05):
        rig.send(now, stamp=7.0)
    assert rig.goals()[-1] == REST
    assert rig.reason == 'timeout: no input on pose for 0.2 s'


def test_a_clock_of_the_device_that_is_set_back_counts_once_the_stream_was_lost():
    rig = Rig()
    rig.send(0.0, stamp=50.0)
    assert rig.send(0.1, stamp=1.0)
    assert not rig.send(0.3, stamp=1.2)


@pytest.mark.parametrize(('largest', 'reason'), [
    (Largest(step=0.1), 'the device jumped by 0.12 m'),
    (Largest(lag=0.1), 'the tool is behind by 0.12 m')])
def test_a_device_that_jumps_or_a_tool_that_does_not_follow_opens_the_clutch(largest, reason):
    rig = Rig(largest=largest)
    rig.press()
    rig.device[1] += 0.12
    rig.send()
    rig.see()
    assert rig.goals()[-1] == REST
    assert rig.reason == f'timeout: {reason}; {AGAIN}'
    # The switch is still pressed.
    rig.send()
    rig.see()
    assert rig.goals() == []
    rig.pressed = False
    rig.send()
    assert rig.reason == OPEN
    rig.press()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])


def test_turns_count_as_jumps_and_lags_too():
    half = (0.0, 0.0, math.sin(0.25), math.cos(0.25))
    for largest, reason in ((Largest(turn=0.4), 'the device jumped by 0.50 rad'),
                            (Largest(turn_lag=0.4), 'the tool is behind by 0.50 rad')):
        rig = Rig(largest=largest)
        rig.press()
        rig.clutch.take_pose((*rig.device, *half), 0.0, 0.0)
        rig.see()
        assert rig.reason == f'timeout: {reason}; {AGAIN}'


def test_steps_that_add_up_are_no_jump():
    rig = Rig(largest=Largest(step=0.1))
    rig.press()
    for _ in range(5):
        rig.device[0] += 0.09
        rig.send()
    assert rig.goal() == ('base', [0.95, 0.0, 0.4])


def test_jumps_while_the_clutch_is_open_do_not_matter():
    rig = Rig(largest=Largest(step=0.1))
    rig.press()
    rig.pressed = False
    rig.send()
    rig.device[0], rig.pressed = 5.0, True
    rig.send()
    rig.see()
    assert rig.goal() == ('base', [0.5, 0.0, 0.4])


def test_a_task_that_moves_another_frame_opens_the_clutch():
    rig = Rig()
    rig.press()
    rig.see(frame='elbow')
    assert rig.reason == f'timeout: the task moves another frame; {AGAIN}'


def test_a_frame_that_is_not_of_the_task_keeps_the_clutch_open():
    rig = Rig(frame='arm')
    rig.press()
    assert rig.reason.startswith("timeout: frame 'arm' is neither 'hand'")


def test_another_scale_while_driving_does_not_move_the_tool():
    rig = Rig()
    rig.press()
    rig.device[0] += 0.1
    rig.send()
    rig.clutch.following = Following(linear=3.0)
    assert rig.goal() == ('base', [0.6, 0.0, 0.4])
    rig.device[0] += 0.1
    rig.send()
    assert rig.goal() == ('base', [0.9, 0.0, 0.4])

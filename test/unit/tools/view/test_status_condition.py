# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the page says of a controller that runs, pauses, stops or is gone."""

import pytest
from tp_controller.tools.view.status import (
    BAD,
    ConditionReader,
    FAINT,
    GONE,
    GOOD,
    MANY_PAUSES,
    PAUSE_SECONDS,
    WITHIN_SECONDS,
)

LATE = 'joint states are late'


class Reader(ConditionReader):
    """A reader with a clock that only the test moves."""

    def __init__(self):
        self.now = 100.0
        super().__init__(lambda: self.now)

    def see(self, head, seconds=0.0, present=True):
        """Return what is said after a time [s]."""
        self.now += seconds
        return tuple(self.read(head, present))[:2]


@pytest.fixture
def reader():
    """Return a reader."""
    return Reader()


def pause(reader, count, head=LATE):
    """Let a controller pause several times."""
    for _ in range(count):
        reader.see(head)
        reader.see('running', 0.3)


def test_a_controller_that_was_never_heard_is_waited_for(reader):
    text, colour = reader.see(None, present=False)
    assert 'waiting' in text and colour == FAINT


def test_a_short_stop_is_a_pause_in_grey_and_a_long_one_a_fault(reader):
    assert reader.see('running') == ('running', GOOD)
    assert reader.see(LATE) == (f'paused: {LATE}', FAINT)
    assert reader.see(LATE, 0.9 * PAUSE_SECONDS)[1] == FAINT
    assert reader.see(LATE, 0.2 * PAUSE_SECONDS) == (LATE, BAD)
    assert reader.see('running') == ('running', GOOD)


def test_a_stop_by_hand_is_no_pause(reader):
    assert reader.see('stopped; call ~/start to go on') == (
        'stopped; call ~/start to go on', BAD)
    pause(reader, 2 * MANY_PAUSES, 'stopped; call ~/start to go on')
    assert reader.remark() == ''


def test_a_controller_that_is_gone_is_said_to_be_gone(reader):
    reader.see('running')
    assert reader.see('running', present=False) == (GONE, BAD)


def test_a_machine_that_is_too_slow_is_said_to_be_once(reader):
    pause(reader, MANY_PAUSES - 1)
    assert reader.remark() == ''
    pause(reader, 1)
    assert f'{MANY_PAUSES} times' in reader.remark()
    pause(reader, 5)
    assert reader.remark() == ''
    reader.see('running', 2.0 * WITHIN_SECONDS)
    assert reader.remark() == ''
    pause(reader, MANY_PAUSES)
    assert 'too slow' in reader.remark()


def test_pauses_that_are_rare_are_no_remark(reader):
    for _ in range(3 * MANY_PAUSES):
        pause(reader, 1)
        reader.see('running', WITHIN_SECONDS)
        assert reader.remark() == ''


def test_start_is_offered_where_the_controller_does_not_go_on_by_itself(reader):
    assert not reader.read('running', True).waits
    assert not reader.read(LATE, True).waits
    reader.now += 2.0 * PAUSE_SECONDS
    assert reader.read(LATE, True).waits
    assert reader.read('stopped; call ~/start to go on', True).waits
    assert not reader.read('stopped; call ~/start to go on', False).waits


def test_a_pause_is_told_in_one_line(reader):
    names = ', '.join(f'joint{number}' for number in range(20))
    text, _ = reader.see(f'no joint states of {names}')
    assert text.startswith('paused: no joint states') and len(text) < 50

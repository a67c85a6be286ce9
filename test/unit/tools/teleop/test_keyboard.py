# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys move while they are repeated, and a terminal is left as it was."""

import os
import signal
import termios

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.check.parameter_file import node_parameters
from tp_controller.tools.teleop.drive import FINAL_ZEROS
from tp_controller.tools.teleop.key_map import key_map, KEYBOARD
from tp_controller.tools.teleop.keyboard import Keyboard, keys_of, MOST_SPEED, read_keys
from tp_controller.tools.teleop.mapping import DIRECTIONS

KEY_MAP = key_map(node_parameters(KEYBOARD, 'tp_teleop'))
KEYS = KEY_MAP.keys


def hold(keyboard, key, until=1.0):
    """Repeat a key as terminals do, from 0 s on; return the last twist."""
    for step in range(round(until / 0.04) + 1):
        assert keyboard.press(key, 0.04 * step)
    return keyboard.drive.command(until)


@pytest.mark.parametrize('key', KEYS)
def test_a_key_moves_in_its_direction(key):
    direction, sign = KEYS[key]
    expected = [0.0] * 6
    expected[DIRECTIONS.index(direction)] = sign * (0.5 if direction[0] == 'r' else 0.1)
    assert hold(Keyboard(KEY_MAP), key).tolist() == expected


def test_each_direction_has_two_keys():
    assert sorted(KEYS.values()) == sorted((name, sign) for name in DIRECTIONS
                                           for sign in (-1.0, 1.0))


def test_a_key_that_is_not_repeated_ends_in_zeros():
    keyboard = Keyboard(KEY_MAP)
    hold(keyboard, 'w')
    assert keyboard.drive.command(1.14)[0] > 0.0
    assert [keyboard.drive.command(1.16).any() for _ in range(FINAL_ZEROS)] == [False] * 3
    assert keyboard.drive.command(1.16) is None
    # The next press begins from zero.
    keyboard.press('w', 2.0)
    assert 0.0 < keyboard.drive.command(2.03)[0] < 0.011


def test_the_space_bar_stops_at_once():
    keyboard = Keyboard(KEY_MAP)
    hold(keyboard, 'w')
    assert keyboard.press(' ', 1.0)
    assert not keyboard.drive.command(1.0).any()


def test_speed_changes_within_bounds():
    keyboard = Keyboard(KEY_MAP)
    keyboard.press('+', 0.0)
    assert hold(keyboard, 's')[0] == pytest.approx(-0.125)
    for _ in range(50):
        keyboard.press('+', 0.0)
    assert keyboard.drive.scaling.linear == pytest.approx(0.1 * MOST_SPEED)
    keyboard.press('-', 0.0)
    assert keyboard.drive.scaling.angular == pytest.approx(0.5 * MOST_SPEED / 1.25)


def test_q_ends_and_other_keys_do_nothing():
    keyboard = Keyboard(KEY_MAP)
    # An arrow key is several characters.
    assert all(keyboard.press(key, 0.0) for key in '\x1b[A1W')
    assert keyboard.drive.command(0.0) is None
    assert not keyboard.press('q', 0.0)


@pytest.fixture
def terminal():
    """Return both ends of a terminal: that of the keyboard, and that of the program."""
    ends = os.openpty()
    yield ends
    for end in ends:
        os.close(end)


@pytest.mark.parametrize('error', [KeyboardInterrupt, ValueError])
def test_a_terminal_is_restored_whatever_happens(terminal, error):
    outer, inner = terminal
    before, handler = termios.tcgetattr(inner), signal.getsignal(signal.SIGTERM)
    with pytest.raises(error), keys_of(inner):
        assert not termios.tcgetattr(inner)[3] & (termios.ICANON | termios.ECHO)
        os.write(outer, b'wa')
        assert read_keys(inner, 10.0) == 'wa'
        assert read_keys(inner, 0.0) == ''
        raise error
    assert termios.tcgetattr(inner) == before
    assert signal.getsignal(signal.SIGTERM) is handler


def test_a_signal_that_ends_the_process_restores_the_terminal_first(terminal):
    _, inner = terminal
    before = termios.tcgetattr(inner)
    with pytest.raises(KeyboardInterrupt), keys_of(inner):
        os.kill(os.getpid(), signal.SIGTERM)
        read_keys(inner, 10.0)
    assert termios.tcgetattr(inner) == before


def test_what_is_not_a_terminal_is_refused():
    reader, writer = os.pipe()
    with pytest.raises(TpControllerError, match='keys of a terminal'), keys_of(reader):
        pass
    os.close(writer)
    assert read_keys(reader, 1.0) is None
    os.close(reader)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys are read from a parameter file, and faults in it are named."""

import pytest
from tp_controller.errors import SettingsError
from tp_controller.tools.check.parameter_file import node_parameters
from tp_controller.tools.teleop.key_map import key_map, KEYBOARD
from tp_controller.tools.teleop.keyboard import Keyboard

HELP = """move   w/s x   a/d y   r/f z      turn   u/o about x   i/k about y   j/l about z
space stop     +/- faster, slower     q or Ctrl-C end     hold a key to go on moving"""


def test_the_file_of_this_package_has_keys_for_every_direction():
    assert key_map(node_parameters(KEYBOARD, 'tp_teleop')).text == HELP


def test_another_layout_moves_with_its_own_keys_speeds_and_times():
    found = key_map({'x': 'key z - key s + key Z', 'rz': '- key é', 'linear_scale': 1,
                     'timeout': 0.6, 'ramp': 0.0, 'frame': 'hand'})
    assert found.keys == {'z': ('x', 1.0), 's': ('x', -1.0), 'Z': ('x', 1.0), 'é': ('rz', -1.0)}
    assert (found.seconds, found.frame, found.angular) == (0.6, 'hand', 0.5)
    assert found.text.startswith('move   z/Z/s x      turn   é about z\n')
    keyboard = Keyboard(found)
    keyboard.press('z', 0.0)
    assert keyboard.drive.command(0.59).tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert not keyboard.drive.command(0.61).any()
    assert not keyboard.press('q', 1.0)


def test_the_key_that_ends_the_command_may_move_instead():
    found = key_map({'y': 'key q - key d'})
    assert found.text.startswith('move   q/d y\nspace stop') and ' Ctrl-C end' in found.text
    keyboard = Keyboard(found)
    assert 'q or Ctrl-C' not in found.text and keyboard.press('q', 0.0)
    assert keyboard.drive.command(0.1)[1] > 0.0


@pytest.mark.parametrize('parameters, message', [
    ({'x': 'axis 1'}, "parameter x: 'axis 1' is not a sum of keys such as key w - key s"),
    ({'x': 'key w key s'}, 'is not a sum of keys'), ({'x': 'key up'}, 'is not a sum of keys'),
    ({'x': 'key w', 'y': 'key w'}, 'parameter y: key w has another meaning, too'),
    ({'x': '- key -'}, 'parameter x: key - has another meaning'), ({'x': 1}, 'must be a string'),
    ({'frame': 'hand'}, 'no keys: one of the parameters x, y'),
    ({'timeout': 0.0}, 'timeout must be from 0.01 to 10'), ({'w': 'x'}, "keyboard 'w'; valid: x")])
def test_a_fault_of_the_file_is_named(parameters, message):
    with pytest.raises(SettingsError, match=message):
        key_map(parameters)

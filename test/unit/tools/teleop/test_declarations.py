# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The files of devices set parameters that exist, and each direction moves."""

import pytest
from robots import CONFIG
from tp_controller.tools.teleop.declarations import PARAMETERS
from tp_controller.tools.teleop.mapping import DIRECTIONS, Source
import yaml

FILES = sorted((CONFIG / 'teleop').glob('*.yaml'))
SPECS = {spec.name: spec for spec in PARAMETERS}


def parameters(path):
    """Return the parameters of a file."""
    return yaml.safe_load(path.read_text())['/**']['ros__parameters']


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_a_device_sets_parameters_that_exist(path):
    for name, value in parameters(path).items():
        assert not SPECS[name].fault(value), name


@pytest.mark.parametrize('device', ['gamepad', 'spacemouse'])
def test_a_device_has_its_own_axes_for_every_direction(device):
    values = parameters(CONFIG / 'teleop' / f'{device}.yaml')
    sources = {name: Source(values[name]) for name in DIRECTIONS}
    moved = {}
    for index in range(6):
        axes = [float(index == each) for each in range(6)]
        moved.update({name: axes for name in DIRECTIONS if sources[name].value(axes, ())})
    buttons = {name for name in DIRECTIONS
               if any(sources[name].value((), [0] * each + [1]) for each in range(21))}
    assert moved.keys() | buttons == set(DIRECTIONS)
    # The switches move nothing.
    used = [(term.kind, term.number) for name in (*DIRECTIONS, 'dead_man', 'gripper')
            for term in Source(values[name])._terms]
    assert len(used) == len(set(used))


def test_a_gamepad_drives_as_its_sticks_point():
    values = parameters(CONFIG / 'teleop' / 'gamepad.yaml')
    sources = {name: Source(values[name]) for name in DIRECTIONS}
    # Left and forward are positive in the messages of game_controller_node, pressed triggers -1.
    axes, buttons = [0.1, 0.2, 0.3, 0.4, -0.5, -0.75], [0] * 21
    buttons[14] = 1
    assert [sources[name].value(axes, buttons) for name in DIRECTIONS] \
        == pytest.approx([0.2, 0.1, 0.25, 1.0, 0.4, 0.3])

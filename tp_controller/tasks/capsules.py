# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Capsules that replace the collision shapes of links: the key `capsules`."""

from typing import Any

from tp_controller.errors import GoalError
from tp_controller.model.robot import Robot
from tp_controller.model.solids import capsule, Solid
from tp_controller.resources import load_yaml, read_source
from tp_controller.tasks.keys import check_mapping, finite_vector, named_positive

CAPSULE_KEYS = ('from', 'to', 'radius')
CAPSULE_FORM = '{from: [x, y, z], to: [x, y, z], radius: …} [m]'


def parse_capsules(robot: Robot, capsules: Any) -> dict[str, list[Solid]]:
    """Return {link: list of Solid}; raise if invalid; `capsules` may name a file."""
    if isinstance(capsules, str):
        capsules = _load(capsules)
    if not isinstance(capsules, dict):
        raise ValueError(f'needs a mapping {{link: {CAPSULE_FORM}}}, got {capsules!r}')
    solids = {}
    for link, several in capsules.items():
        robot.check_frame(link)
        several = several if isinstance(several, list) else [several]
        if not several:
            raise ValueError(f'{link} needs {CAPSULE_FORM}, got []')
        solids[link] = [
            _capsule(link + (f'[{index}]' if len(several) > 1 else ''), link, each)
            for index, each in enumerate(several, 1)]
    return solids


def _load(source: str) -> Any:
    """Return the value of a YAML text or file, or raise ValueError."""
    try:
        text = read_source(source, lambda text: '{' in text)
    except OSError as error:
        raise ValueError(str(error)) from error
    try:
        return load_yaml(text)
    except ValueError as error:
        raise ValueError(str(error) if text is source else f'{source}: {error}') from error


def _capsule(name: str, link: str, keys: Any) -> Solid:
    """Return the solid of one capsule, or raise ValueError."""
    check_mapping(name, keys, CAPSULE_KEYS, {'from', 'radius'}, CAPSULE_FORM)
    try:
        start = finite_vector(keys['from'], 3, 'from')
        end = finite_vector(keys.get('to', start), 3, 'to')
        return capsule(name, link, start, end, named_positive('radius', keys['radius']))
    except (GoalError, ValueError) as error:
        raise ValueError(f'{name}: {error}') from error

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Properties of a robot that task types need."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.urdf_solids import has_solids


class Need(NamedTuple):
    """
    Property that a task type may declare in `needs`.

    Attributes
    ----------
    what : str
        Noun phrase for messages.
    met : callable
        Function of a robot that returns whether it has the property.
    lack : callable
        Function of a robot without the property that returns a sentence about it.
    instead : str
        Key that takes the place of the property; empty for none.

    """

    what: str
    met: Callable[[Robot], bool]
    lack: Callable[[Robot], str]
    instead: str = ''


NEEDS = {
    'driven_joints': Need(
        'a robot with driven joints', lambda robot: bool(robot.joint_names),
        lambda robot: f'{robot.name} has no driven joints'),
    'masses': Need(
        'a robot with masses', lambda robot: robot.mass > 0.0,
        lambda robot: f'the description of {robot.name} gives no link a mass'),
    'moving_base': Need(
        'a robot whose base moves', lambda robot: robot.moves,
        lambda robot: f'the base of this one is {robot.base}'),
    'position_limits': Need(
        'a robot with position limits',
        lambda robot: bool(np.isfinite(robot.upper - robot.lower).any()),
        lambda robot: 'no joint of the robot has position limits'),
    'shapes': Need(
        'shapes of links', lambda robot: has_solids(robot.urdf),
        lambda robot: f'the description of {robot.name} has no collision shapes: give capsules',
        'capsules'),
}


def lacks(type_name: str, needs: Sequence[str], robot: Robot,
          given: Mapping[str, Any]) -> list[tuple[str, str]]:
    """
    Return the needs of a task type that a robot does not meet.

    Parameters
    ----------
    type_name : str
        Name of the type.
    needs : sequence of str
        Names in `NEEDS`.
    robot : Robot
        Robot of the task.
    given : mapping
        Values of the keys of the task.

    Returns
    -------
    list of (str, str)
        Key at fault, ``type``, and message.

    """
    return [('type', f'{type_name} needs {need.what}; {need.lack(robot)}')
            for need in map(NEEDS.__getitem__, needs)
            if not need.met(robot) and given.get(need.instead) is None]

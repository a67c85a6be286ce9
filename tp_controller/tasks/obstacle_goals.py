# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Obstacles as values: their form in keys and goals."""

from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from tp_controller.errors import GoalError, RobotError
from tp_controller.model.shapes import HalfSpace, parse_shape, Shape
from tp_controller.model.spatial import Array
from tp_controller.tasks.keys import check_mapping, named_positive
from tp_controller.tasks.region import parse_place

# Name that stands for all present obstacles in an update.
ALL_OBSTACLES = '*'
OBSTACLE_KEYS = ('shape', 'at', 'lifetime')
OBSTACLE_FORM = '{shape: {box: [x, y, z]}, at: [x, y, z]} [m]'


@dataclass(frozen=True, eq=False)
class Obstacle:
    """
    Obstacle of the task `obstacles`.

    Attributes
    ----------
    shape : object
        One of `tp_controller.model.shapes`.
    pose : ndarray (4, 4)
        T_reference_obstacle.
    lifetime : float
        Time after which it is removed [s].
    since : float
        Time of its last update [s].

    """

    shape: Shape
    pose: Array
    lifetime: float = math.inf
    since: float = -math.inf

    def gone(self, now: float) -> bool:
        """Return whether its lifetime has expired."""
        return now - self.since > self.lifetime < math.inf


def parse_obstacles(given: Any, removals: bool = False) -> dict[str, Obstacle | None]:
    """Return {name: Obstacle}, None for an obstacle to remove; raise if invalid."""
    if not isinstance(given, dict):
        raise ValueError(f'needs a mapping {{name: {OBSTACLE_FORM}}}, got {given!r}')
    return {_name(name, keys, removals): _obstacle(name, keys, removals)
            for name, keys in given.items()}


def _name(name: object, keys: object, removals: bool) -> str:
    """Return the name of an obstacle, or raise ValueError."""
    if not isinstance(name, str) or not name \
            or (name == ALL_OBSTACLES and not (removals and keys is None)):
        raise ValueError(f'an obstacle needs a name, got {name!r}')
    return name


def _obstacle(name: str, keys: Any, removals: bool) -> Obstacle | None:
    """Return one obstacle, None to remove it, or raise ValueError."""
    if removals and keys is None:
        return None
    check_mapping(name, keys, OBSTACLE_KEYS if removals else OBSTACLE_KEYS[:2], {'shape'},
                  OBSTACLE_FORM)
    try:
        shape, lifetime = parse_shape(keys['shape']), math.inf
        if 'lifetime' in keys:
            lifetime = named_positive('lifetime', keys['lifetime'])
        if keys.get('at') is not None:
            return Obstacle(shape, parse_place(keys['at']), lifetime)
        # Only a half-space, such as the floor, has a default place.
        if not isinstance(shape, HalfSpace):
            raise ValueError(f'needs a place, {OBSTACLE_FORM}')
        return Obstacle(shape, np.eye(4), lifetime)
    except (GoalError, ValueError, RobotError) as error:
        raise ValueError(f'{name}: {error}') from error

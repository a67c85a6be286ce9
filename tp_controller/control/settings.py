# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the controller; the defaults are safe for a real arm."""

from collections.abc import Iterator
from dataclasses import dataclass, Field, field, fields
import math
from typing import Any

import numpy as np
from tp_controller.errors import SettingsError, unknown
from tp_controller.model.robot import Robot
from tp_controller.resources import is_number
from tp_controller.solver.damping import Damping
from tp_controller.solver.level import Array, WEIGHT_RATIO
from tp_controller.solver.solve import PrioritySolver, SCALINGS

# Reactions to a task that fails.
STOP, SWITCH_OFF = 'stop', 'switch off'
# An unbounded workspace.
ANYWHERE = (-math.inf, math.inf) * 3


def _is_box(value: object) -> bool:
    """Return whether a value is a box: a lower and an upper bound for each of x, y and z."""
    return isinstance(value, (list, tuple)) and len(value) == 6 and all(map(is_number, value)) \
        and all(lower <= upper for lower, upper in zip(value[::2], value[1::2]))


def _number(default: float, lower: float, upper: float, unit: str, description: str) -> float:
    """Return a field with its range and description."""
    found: float = field(default=default, metadata={
        'lower': lower, 'upper': upper, 'unit': unit, 'description': description})
    return found


def _count(default: int, lower: int, upper: int, unit: str, description: str) -> int:
    """Return a field for whole numbers with its range and description."""
    found: int = field(default=default, metadata={
        'lower': lower, 'upper': upper, 'unit': unit, 'description': description})
    return found


def _choice(default: str, valid: tuple[str, ...], description: str) -> str:
    """Return a field with its valid values and description."""
    found: str = field(default=default, metadata={
        'valid': valid, 'unit': '', 'description': description})
    return found


@dataclass(frozen=True)
class Settings:
    """
    Settings of a `Controller`; each field carries its unit, range and description.

    Raises
    ------
    SettingsError
        All that are out of range.

    """

    period: float = _number(
        0.01, 1e-5, 1.0, 's', 'longest time between two commands; braking ahead of position '
        'limits relies on it')
    damping: float = _number(
        0.1, 0.0, 10.0, '',
        'damping λ of directions that hardly move a task, in the units of the Jacobian; of the '
        'first level a fifth of it (0: undamped)')
    singular_region: float = _number(
        0.1, 0.0, math.inf, '', 'singular value of the Jacobian below which a direction is '
        'damped; of the first level a fifth of it (inf: damped least squares, lecture 2.2)')
    braking_gain: float = _number(
        10.0, 1e-3, 1e4, '1/s', 'allowed speed towards a position limit per distance to it, at '
        'most 1/period; with d = command_delay at most dᵈ/(d + 1)ᵈ⁺¹/period takes effect')
    command_delay: int = _count(
        2, 0, 100, 'cycles', 'most commands under way when positions are measured; joints '
        'brake from where these lead, or position limits would be crossed')
    release_region: float = _number(
        0.02, 0.0, 10.0, '', 'singular value of the Jacobian below which a direction is '
        'relaxed: left to the lower tasks, smoothly (0: never)')
    scaling: str = _choice(
        'redistribute', SCALINGS, 'reaction to a velocity beyond a limit: other joints move '
        'instead, at the cost of the lowest tasks first; or all joints are slowed alike')
    regularisation: float = _number(
        0.02, 0.0, 10.0, '', 'with redistribute: singular value of the Jacobian below which a '
        'direction stays near the velocity cut off at the limits, against jumps of the command; '
        'of the first level a fifth of it (0: exact)')
    reserve: float = _number(
        0.4, 0.0, 1.0, '', 'with redistribute: share of the speed limit of each joint with an '
        'acceleration limit that lower tasks leave to the first level')
    blend: float = _number(
        0.4, 0.0, 60.0, 's', 'duration of the transition after a change of stack, goal or setting '
        '(0: at once)')
    task_faults: str = _choice(
        'stop', (STOP, SWITCH_OFF), 'reaction to a task that raises an exception, returns an '
        'invalid result or exceeds its time budget: the robot stops; or the task is switched off '
        'until it is enabled again')
    task_budget: float = _number(
        0.5, 1e-3, math.inf, '', 'share of the period that the evaluation of a task of another '
        'package may take; it fails after three longer ones in a row (inf: any time)')
    weights: tuple[float, ...] | None = field(default=None, metadata={
        'unit': '', 'description': 'positive cost of each velocity, those of a moving base '
        'first: the higher, the less it is used in the null space of all tasks (empty: all '
        'equal)'})

    workspace: tuple[float, ...] = field(default=ANYWHERE, metadata={
        'count': 6, 'unit': 'm', 'description': 'box for the goals of frames, in the root frame: '
        'x from, to, y from, to, z from, to (infinite: no limit)'})
    largest_jump: float = _number(
        math.inf, 0.0, math.inf, 'm', 'largest distance of a new goal from where its task is '
        '(inf: any)')
    largest_turn: float = _number(
        math.inf, 0.0, math.inf, 'rad', 'largest angle between a new goal and where its task is, '
        'also of joints (inf: any)')

    def __new__(cls, *values: object, **named: object) -> 'Settings':
        """Refuse unknown settings."""
        names = [item.name for item in fields(cls)]
        faults = [unknown('setting', name, names) for name in named if name not in names]
        if faults:
            raise SettingsError(faults)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        """Validate all fields; raise one error with all faults."""
        faults = [fault for item in fields(self) for fault in self._faults(item)]
        if not faults and self.braking_gain * self.period > 1.0 + 1e-12:
            faults.append(f'braking_gain {self.braking_gain:g} must be at most 1/period = '
                          f'{1.0 / self.period:g}, or position limits would be crossed')
        if faults:
            raise SettingsError(faults)

    @property
    def limits_goals(self) -> bool:
        """Return whether any limit of goals is set."""
        return (self.workspace, self.largest_jump, self.largest_turn) != (
            ANYWHERE, math.inf, math.inf)

    def solver(self, n: int) -> PrioritySolver:
        """Return the solver of this package for a robot with n joints."""
        return PrioritySolver(
            n, Damping(self.damping, self.singular_region, self.release_region,
                       self.regularisation), self.weights or None, self.scaling)

    def speed_cap(self, robot: Robot, velocity: Array | None = None) -> Array | None:
        """
        Return the largest speeds (n,) of levels below the first; None if there is no such cap.

        Only joints with an acceleration limit need a reserve, and none where all are scaled. The
        velocity limits (n,) are those of the robot by default.
        """
        slow = np.isfinite(robot.acceleration)
        if not slow.any() or self.scaling == 'uniform':
            return None
        velocity = robot.velocity if velocity is None else velocity
        return np.where(slow, (1.0 - self.reserve) * velocity, velocity)

    def _faults(self, item: Field[Any]) -> Iterator[str]:
        """Yield the faults of one field."""
        value = getattr(self, item.name)
        if 'valid' in item.metadata:
            if value not in item.metadata['valid']:
                yield (f'{item.name} must be one of {", ".join(item.metadata["valid"])}, '
                       f'not {value!r}')
        elif 'lower' in item.metadata:
            lower, upper = item.metadata['lower'], item.metadata['upper']
            whole = isinstance(item.default, int)
            if not is_number(value) or not lower <= value <= upper \
                    or whole and not isinstance(value, int):
                yield (f'{item.name} must be a {"whole " if whole else ""}number '
                       f'from {lower:g} to {upper:g}, not {value!r}')
        elif 'count' in item.metadata:
            if not _is_box(value):
                yield (f'{item.name} must be six numbers, from and to for each of x, y and z, '
                       f'not {value!r}')
        elif value is not None:
            yield from _faults_of_weights(item.name, value)


def _faults_of_weights(name: str, value: object) -> Iterator[str]:
    """Yield the faults of weights."""
    if not isinstance(value, (list, tuple)) or not all(
            is_number(weight) and 0.0 < weight < math.inf for weight in value):
        yield f'{name} must be positive numbers, one for each joint, not {value!r}'
    elif value and float(max(value)) / float(min(value)) > WEIGHT_RATIO:
        yield f'{name} must be within a factor of {WEIGHT_RATIO:g} of each other, not {value!r}'

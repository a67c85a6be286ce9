# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Extremes of the commands of a closed loop, as shares of the limits of the robot."""

from dataclasses import dataclass
import math

import numpy as np
from tp_controller.model.limits import BASE_LIMIT_KEYS
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tools.check.results import JUMP, POSITION

# Extremes of the commands: shares of the limits of absolute values, with changes over the time
# between two commands, −∞ without a limit; the distance by which a command would have moved a
# joint past its position limit, or farther outside if it was already, negative where it is kept
# from the limit [rad or m]; and the change between two cycles, as a share of the velocity limit,
# without such a limit [rad/s or m/s].
EXTREMES = (BASE_LIMIT_KEYS[0], POSITION, *BASE_LIMIT_KEYS[1:], JUMP)
# Number of cycles that are evaluated together.
CYCLES_TOGETHER = 1000


@dataclass(frozen=True)
class Worst:
    """
    Largest of some values, with its location.

    Attributes
    ----------
    value : float
    name : str
        Joint or velocity of the base; empty without a value.
    run : int
        Number of the run, from 0.

    """

    value: float = -math.inf
    name: str = ''
    run: int = -1


class Extremes:
    """
    Extremes of the commands of one run, from rest.

    Parameters
    ----------
    robot : Robot
    period : float
        [s]
    run : int
        Number of the run, from 0.

    """

    def __init__(self, robot: Robot, period: float, run: int) -> None:
        self._robot, self._period, self._run = robot, period, run
        self._worst = {kind: Worst() for kind in EXTREMES}
        # The commands before, as many as changes of the highest order need, and those to evaluate.
        self._commands = [np.zeros(robot.n)] * (len(BASE_LIMIT_KEYS) - 1)
        self._configurations: list[Array] = []

    def add(self, q: Array, velocity: Array) -> None:
        """Add a command (n,) at a configuration q (nq,); both arrays are kept."""
        self._configurations.append(q)
        self._commands.append(velocity)
        if len(self._configurations) == CYCLES_TOGETHER:
            self._evaluate()

    def worst(self) -> dict[str, Worst]:
        """Return {one of `EXTREMES`: the worst of its values, the first of equal ones}."""
        if self._configurations:
            self._evaluate()
        return dict(self._worst)

    def _evaluate(self) -> None:
        """Evaluate the commands since the last evaluation."""
        robot, period = self._robot, self._period
        before = len(BASE_LIMIT_KEYS) - 1
        commands, configurations = np.array(self._commands), np.array(self._configurations)
        self._commands, self._configurations = self._commands[-before:], []
        changes = [np.abs(np.diff(commands[before - order:], order, axis=0))
                   for order in range(len(BASE_LIMIT_KEYS))]
        limit = np.where(np.isfinite(robot.velocity), robot.velocity, 1.0)
        here = np.zeros((len(configurations), robot.n))
        here[:, robot.joint_columns] = configurations[:, robot.joint_rows]
        moved = here + period * commands[before:]
        # A joint that starts outside must not move farther out.
        allowed = np.maximum(np.maximum(robot.lower - here, here - robot.upper), 0.0)
        self._note(POSITION, np.maximum(robot.lower - moved, moved - robot.upper) - allowed)
        self._note(JUMP, _share(changes[1], limit))
        for order, (kind, change) in enumerate(zip(BASE_LIMIT_KEYS, changes)):
            self._note(kind, _share(change, robot.limits[kind] * period ** order))

    def _note(self, kind: str, values: Array) -> None:
        """Note the largest of values (k, n)."""
        cycle, column = divmod(int(values.argmax()), values.shape[1])
        if values[cycle, column] > self._worst[kind].value:
            self._worst[kind] = Worst(float(values[cycle, column]),
                                      self._robot.velocity_names[column], self._run)


def _share(values: Array, limits: Array) -> Array:
    """Return values (k, n) as shares of their limits (n,); 0 for 0 of 0, −∞ without a limit."""
    shares = np.divide(values, limits, out=np.where(values > 0.0, np.inf, 0.0),
                       where=limits > 0.0)
    return np.where(np.isfinite(limits), shares, -np.inf)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Speed limit of a frame (slides (1), (3))."""

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import (
    frame_and_reference,
    frame_key,
    reference_key,
    RelativeTask,
)
from tp_controller.tasks.keys import Keys, optional, positive, UnitRows
from tp_controller.tasks.task import Evaluation
from tp_controller.tasks.twin import make_twin, SPEED_LIMIT, Twin
from tp_controller.tasks.yaml_keys import tolerance_key, yaml_key

GOLDEN = (1.0 + 5.0 ** 0.5) / 2.0
# Unit vectors to the corners of an icosahedron and of its dual dodecahedron, one of each opposite
# pair: sixteen evenly distributed directions (16, 3).
DIRECTIONS = np.array([
    (0, 1, GOLDEN), (0, 1, -GOLDEN), (1, GOLDEN, 0), (1, -GOLDEN, 0), (GOLDEN, 0, 1),
    (-GOLDEN, 0, 1),
    (1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1), (0, GOLDEN, 1 / GOLDEN),
    (0, GOLDEN, -1 / GOLDEN), (1 / GOLDEN, 0, GOLDEN), (-1 / GOLDEN, 0, GOLDEN),
    (GOLDEN, 1 / GOLDEN, 0), (GOLDEN, -1 / GOLDEN, 0)])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, np.newaxis]
# Largest component along each direction that bounds the norm of a vector to 1: the radius of the
# largest sphere within the hull of both solids.
INSCRIBED_RADIUS = 0.9226


class SpeedLimit(RelativeTask, BoundedTask):
    """
    Keep the speed of a frame below a limit, linear, angular or both.

    The norm of a velocity is not linear, so the velocity is bounded along sixteen directions. The
    speed never exceeds the limit. It can reach all of it along a direction, and 92 % in between.
    """

    type_name = 'speed_limit'
    has_position = False
    without = ('gain', 'return_speed')
    example = {'frame': 'panda_hand_tcp', 'linear': 0.25}
    sketch_parts = {'frame': True}

    frame: str = frame_key('frame of the robot that is limited')
    linear: float | None = yaml_key(
        'largest speed of its origin (at least one of linear and angular)', optional(positive),
        None, unit='m/s')
    angular: float | None = yaml_key('largest angular speed', optional(positive), None,
                                     unit='rad/s')
    reference: str = reference_key(
        'frame that the speed is relative to; it may move with the joints (default: the root)')
    groups: tuple[UnitRows, ...] = tolerance_key(
        'excess that still counts as satisfied: a number, or one for each unit as '
        '{m: …, rad: …}', 'm/s, rad/s')

    def check_keys(self, keys: Keys) -> None:
        """Set bounds and units."""
        super().check_keys(keys)
        limits = {unit: limit for unit, limit in (('m', self.linear), ('rad', self.angular))
                  if limit is not None}
        if not limits and not {'linear', 'angular'} & {key for key, _ in keys.faults}:
            keys.faults.append(('linear', 'needs a speed: give linear, angular or both'))
        self.units = tuple(unit for unit in limits for _ in DIRECTIONS)
        self.upper = self._most = INSCRIBED_RADIUS * np.array([
            limits[unit] for unit in self.units])
        self.lower = -self._most
        along = {'m': np.pad(DIRECTIONS, ((0, 0), (0, 3))),
                 'rad': np.pad(DIRECTIONS, ((0, 0), (3, 0)))}
        self._along = np.concatenate([np.empty((0, 6)), *(along[unit] for unit in limits)])

    def set_up(self) -> None:
        """Set a gain of zero: the bounds are on the speed itself, there is no distance to one."""
        super().set_up()
        self.gain = np.zeros(())

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return zeros (rows,), since there is no value to control, and J (rows, n)."""
        return np.zeros(self.rows), self._along.dot(self._motion.jacobian(state))

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        return make_twin(SPEED_LIMIT, self._law(), (
            *frame_and_reference(self.robot, self.frame, self.reference), self._along,
            self._most), self.mode)

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        error, J = self.observe(state)
        return Evaluation(self, Level(J, lower=-self._most, upper=self._most), error)

    def reported_errors(self, error: Array, residual: Array) -> tuple[tuple[float, str, float],
                                                                      ...]:
        """Return the excess speed of each unit; see `Task`."""
        # Excess over the limit itself; the bounds are a share below it.
        allowed = (1.0 / INSCRIBED_RADIUS - 1.0) * self._most
        residual = np.maximum(np.abs(residual) - allowed, 0.0)
        return tuple((value, f'{unit}/s', tolerance)
                     for value, unit, tolerance in super().reported_errors(residual, residual))

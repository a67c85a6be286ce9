# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Margin to the joint position limits, as a task of the stack."""

from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.joint import JointTask
from tp_controller.tasks.keys import Keys, positive
from tp_controller.tasks.task import Task
from tp_controller.tasks.twin import JOINT_LIMITS, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

# Default of the key `margin` [rad or m].
DEFAULT_MARGIN = 0.05


class JointLimits(JointTask, BoundedTask):
    """
    Keep joints a margin away from their position limits (lecture 3.1).

    The position limits themselves are enforced with every stack. This task adds a margin,
    which the tasks above it may violate.
    """

    type_name = 'joint_limits'
    feed_forward_type = None
    # An inequality task accepts no joint velocities as feed-forward.
    parse_feed_forward = Task.parse_feed_forward

    margin: float = yaml_key('least distance to the limits', positive, DEFAULT_MARGIN,
                             unit='rad or m')

    def check_keys(self, keys: Keys) -> None:
        """Set the bounds, or record a fault if the margin leaves a joint no range."""
        super().check_keys(keys)
        self.row_names = self.joints
        lower, upper = self.robot.lower[self._indices], self.robot.upper[self._indices]
        if self.margin is not None:
            keys.check('margin', self._check_margin, upper - lower)
            self.lower, self.upper = lower + self.margin, upper - self.margin

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the positions of the joints (rows,) [rad or m] and their rows (rows, n)."""
        return self.positions(state), self.jacobian(state)

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        return make_twin(JOINT_LIMITS, self._law(), (
            self._indices.astype(float), self.lower, self.upper, self.return_speed), self.mode)

    def _check_margin(self, ranges: Array) -> None:
        """Raise ValueError if the margin leaves a joint no range."""
        margin, narrow = self.margin, int(ranges.argmin())
        if not 2.0 * margin < ranges[narrow]:
            raise ValueError(f'must be less than half the range of {self.joints[narrow]}, '
                             f'{0.5 * ranges[narrow]:g}, got {margin:g}')

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Distance from the joint limits, maximized in the null space of the tasks above."""

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.twin import JOINT_LIMIT_DISTANCE, make_twin, Twin

# Largest |x| of the formula of h. Beyond it h continues linearly; otherwise the gradient would be
# unbounded, and the joint would oscillate about its optimum.
MAX_CURVED = 0.8
# Largest rate at which a joint approaches the middle of its range [1/s]. The curvature of h grows
# as the inverse square of the range: a gripper finger with a range of 2 cm has 20,000/m², and
# would overshoot in every cycle at 100 Hz and gain 0.01.
MAX_RATE = 10.0


class JointLimitDistance(GradientTask):
    """
    Maximize the distance of the joints from their limits.

    It is h = −Σ 1 / (1 − x²), x = −1 … 1 from limit to limit: the sum of
    (upper − lower)² / (4 (upper − q) (q − lower)) of the weighted gradient projection method
    (wiki, Joint Limit Avoidance), with the sign reversed. Joints without limits do not contribute.
    The demand K ∂h/∂q of a joint at the distance d from the middle is reduced smoothly to at most
    ``MAX_RATE`` d.
    """

    type_name = 'joint_limit_distance'

    needs = ('position_limits',)

    def set_up(self) -> None:
        """Find the joints with limits, and the middle of their ranges."""
        super().set_up()
        lower, upper = self.robot.lower, self.robot.upper
        limited = self._limited = np.isfinite(upper - lower)
        # In an infinite range h has no slope.
        self._half = np.where(limited, 0.5 * (upper - lower), np.inf)
        self._middle = np.zeros(self.robot.n)
        self._middle[limited] = 0.5 * (upper[limited] + lower[limited])

    def measure(self, state: RobotState) -> tuple[float, Array]:
        """Return h and its gradient (n,) [1/rad or 1/m]."""
        x, curved, gap = self._normalized_positions(state)
        slope = -2.0 * curved / (gap * gap)
        h = slope * (x - curved) - 1.0 / gap
        return float(np.sum(h[self._limited])), slope / self._half

    def slowdown(self, state: RobotState) -> Array:
        """Return the factor ≥ 1 (n,) that limits the rate of approach of every joint."""
        gap = self._normalized_positions(state)[2]
        return 1.0 + 2.0 * self.gain / (MAX_RATE * (gap * self._half) ** 2)

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        return make_twin(JOINT_LIMIT_DISTANCE, self._law(), (
            self._middle, self._half, self.max_speed), self.mode)

    def _normalized_positions(self, state: RobotState) -> tuple[Array, Array, Array]:
        """Return x and x clipped to ± MAX_CURVED, with its 1 − x²; x = 0 without limits."""
        x = (state.positions - self._middle) / self._half
        curved = np.clip(x, -MAX_CURVED, MAX_CURVED)
        return x, curved, 1.0 - curved * curved

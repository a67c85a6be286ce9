# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Ramped stop: velocities that decrease to zero."""

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.shared_controller import SharedController

# Longest duration of a ramped stop [s].
LONGEST_RAMP = 2.0


class RampedStop:
    """
    Velocities of a stop with a deceleration.

    Parameters
    ----------
    controller : SharedController
    deceleration : float
        Smallest deceleration of the stop [rad/s² or m/s²]; 0: zeros at once.

    Attributes
    ----------
    deceleration : float
        See above; it may be changed at any time.

    """

    def __init__(self, controller: SharedController, deceleration: float) -> None:
        self._controller, self.deceleration = controller, deceleration
        self.reset()

    def reset(self) -> None:
        """End the ramp: the next stop begins another one."""
        self._current = 0.0

    def velocity(self, q: Array, now: float, elapsed: float) -> Array:
        """
        Return the next velocity of the stop (n,).

        Parameters
        ----------
        q : ndarray (nq,)
            Configuration.
        now, elapsed : float
            Time, and time since the last velocity [s].

        """
        # No ramp lasts longer than LONGEST_RAMP, at any deceleration.
        fastest = float(np.abs(self._controller.velocity).max(initial=0.0))
        self._current = max(self._current, self.deceleration, fastest / LONGEST_RAMP)
        return self._controller.slow_down(q, now, self._current, elapsed)

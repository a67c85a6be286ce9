# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints that a task may move, from the keys that choose or exclude some."""

from collections.abc import Sequence

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.solver.level import Mask


def joint_mask(robot: Robot, chosen: Sequence[str] | None, excluded: Sequence[str] | None
               ) -> Mask | None:
    """
    Return the mask (n,) of the velocities that a task may move; None for all.

    Parameters
    ----------
    robot : Robot
        Robot whose velocities they are.
    chosen, excluded : sequence of str or None
        Names of velocities; None for all, and for none.

    Raises
    ------
    ValueError
        No velocity is left.

    """
    left = set(robot.velocity_names if chosen is None else chosen) - set(excluded or ())
    if not left:
        raise ValueError('leaves the task no joint to move')
    mask = np.array([name in left for name in robot.velocity_names])
    mask.setflags(write=False)
    return None if mask.all() else mask

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Uniform velocity scaling: one factor for all joints (lecture 4; lab exercise 2 [9])."""

import numpy as np
from tp_controller.solver.level import Array, NEGLIGIBLE


def scale_uniformly(velocity: Array, lower: Array,
                    upper: Array) -> tuple[Array, float, int | None]:
    """
    Scale all joints by the same factor until each is within its bounds (lecture 4).

    In lecture 4 the bounds are symmetric, s = max |ζ_i| / ζ_i,max. Here each velocity is compared
    with the bound on its own side. If the bounds of a joint exclude zero, as while it brakes, the
    slowest velocity within them replaces zero, and zero replaces this bound: what is slower cannot
    be had at once, so the others slow down only for a joint that has to turn back, by its share
    beyond zero.

    Return the velocity (n,), exactly within the bounds, 1/s in [0, 1], and the index of the
    limiting joint.
    """
    slowest = _slowest(lower, upper)
    change = velocity - slowest
    allowed = np.where(change > 0.0, np.maximum(upper, 0.0), np.minimum(lower, 0.0)) - slowest
    size = np.abs(change)
    too_fast = size - np.abs(allowed) > NEGLIGIBLE * size.max(initial=0.0)
    if not too_fast.any():
        return np.clip(velocity, lower, upper), 1.0, None
    ratios = np.ones(len(velocity))
    np.divide(allowed, change, out=ratios, where=too_fast)
    limiting = int(ratios.argmin())
    scale = float(ratios[limiting])
    scaled = np.clip(slowest + scale * change, lower, upper)
    # To the last digit.
    scaled[limiting] = (upper if change[limiting] > 0.0 else lower)[limiting]
    return scaled, scale, limiting


def enlarged(share: float, lower: Array, upper: Array) -> tuple[Array, Array]:
    """
    Return bounds that scaling by a share reduces to `lower` and `upper`.

    Within them no bounds of levels make a joint so fast that all joints are scaled further.
    """
    slowest = _slowest(lower, upper)
    return (slowest + (np.minimum(lower, 0.0) - slowest) / share,
            slowest + (np.maximum(upper, 0.0) - slowest) / share)


def _slowest(lower: Array, upper: Array) -> Array:
    """Return the slowest velocity (n,) within bounds."""
    return np.minimum(np.maximum(lower, 0.0), upper)

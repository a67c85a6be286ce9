# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Roll, pitch and yaw as a quaternion, without libraries that are slow to import."""

import math


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> list[float]:
    """Return the quaternion ``xyzw`` of turns about fixed x, then y, then z [rad]."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(0.5 * angle), math.cos(0.5 * angle))
                                    for angle in (roll, pitch, yaw))
    return [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]

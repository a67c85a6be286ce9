# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Rotations, compared with SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tp_controller.model.spatial import (
    check_rotation,
    quaternion_from_rotation,
    rotation_from_vector,
)


@pytest.mark.parametrize('turn', [0.0, 1e-9, 1.0, 2.5, np.pi - 1e-9, np.pi, 3.5, 6.0])
def test_quaternion_of_a_rotation_has_no_negative_scalar_part(turn):
    rng = np.random.default_rng(round(1e3 * turn))
    for axis in rng.standard_normal((50, 3)):
        rotation = Rotation.from_rotvec(turn * axis / np.linalg.norm(axis))
        quat_xyzw = quaternion_from_rotation(rotation.as_matrix())
        assert quat_xyzw[3] >= 0.0
        np.testing.assert_allclose(Rotation.from_quat(quat_xyzw).as_matrix(),
                                   rotation.as_matrix(), atol=1e-12)


@pytest.mark.parametrize('R', [np.eye(3), rotation_from_vector(np.array([0.3, -2.0, 1.1]))])
def test_rotation_matrix_is_accepted_and_others_are_refused(R):
    assert check_rotation(R) is R
    mirrored = R * [1.0, 1.0, -1.0]
    for wrong in (mirrored, mirrored[:, [1, 0, 2]] * [1.0, 1.0, -1.0], 1.01 * R, R + 0.01,
                  np.zeros((3, 3))):
        with pytest.raises(ValueError, match='not a rotation matrix'):
            check_rotation(wrong)

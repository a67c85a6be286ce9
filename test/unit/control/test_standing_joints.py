# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Levels of a robot whose joints stand still."""

import numpy as np
from tp_controller.control.standing_joints import without_joints
from tp_controller.solver.level import Level

J = np.array([[0.6, 0.8, 0.0], [0.3, 0.0, 0.4], [0.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
LEFT = np.array([[0.6, 0.0, 0.0], [0.3, 0.0, 0.4], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def test_columns_are_zero_and_only_rows_without_any_other_demand_nothing():
    v = np.array([1.0, 2.0, 3.0, 4.0])
    found = without_joints(Level(J, v, 'scale'), [1])
    assert found.J.tolist() == LEFT.tolist()
    # The last row was out of reach before.
    assert found.v.tolist() == [1.0, 2.0, 0.0, 4.0]
    assert found.mode == 'scale'
    assert without_joints(found, [1]).v.tolist() == found.v.tolist()


def test_demand_of_all_joints_stays_one():
    found = without_joints(Level.of_joints(np.array([1.0, 2.0, 3.0])), [0, 2])
    assert found.is_identity and found.v.tolist() == [0.0, 2.0, 0.0]


def test_bounds_demand_a_return_at_the_joint_speed_of_before_and_bound_as_before():
    lower = np.array([0.5, -np.inf, 1.0, 0.1])
    upper = np.array([np.inf, -0.2, 1.0, 0.3])
    found = without_joints(Level(J, lower=lower, upper=upper), [1])
    # The norm of the first row is 0.6 in place of 1, that of the third one 0.
    np.testing.assert_allclose(found.lower, [0.3, -np.inf, 0.0, 0.1])
    np.testing.assert_allclose(found.upper, [np.inf, -0.2, 1.0, 0.3])
    mirrored = without_joints(Level(J, lower=-upper, upper=-lower), [1])
    np.testing.assert_allclose(mirrored.lower, -found.upper)
    np.testing.assert_allclose(mirrored.upper, -found.lower)

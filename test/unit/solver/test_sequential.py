# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The sequential form, *slides* (50) and (51), and how it differs from the recursion."""

import math

import numpy as np
from problems import EXACT
import pytest
from reference import random_levels
from tp_controller import Level, solve
from tp_controller.solver.sequential import sequential


def successive(levels, n):
    """Return the velocities of the sequential form."""
    return sequential([Level(np.asarray(J), np.asarray(v)) for J, v in levels], n)


def test_sequential_form_is_the_formula_of_the_slides():
    rng = np.random.default_rng(4)
    for rows in ([2], [2, 2], [1, 2, 1], [2, 1, 1, 3]):
        levels = random_levels(rng, 7, rows)
        velocity, P = np.zeros(7), np.eye(7)
        for J, v in levels:
            velocity = velocity + P @ np.linalg.pinv(J) @ v
            P = P @ (np.eye(7) - np.linalg.pinv(J) @ J)
        np.testing.assert_allclose(successive(levels, 7), velocity, **EXACT)


def test_sequential_form_keeps_the_first_priority():
    for seed in range(20):
        levels = random_levels(np.random.default_rng(seed), 7, [2, 2, 2])
        np.testing.assert_allclose(levels[0][0] @ successive(levels, 7), levels[0][1], **EXACT)


def test_sequential_form_fails_a_second_level_that_the_recursion_meets():
    levels = [([[1.0, 0.0]], [0.0]), ([[1.0, 1.0]], [1.0])]
    assert solve(levels).velocity == pytest.approx([0.0, 1.0])
    assert successive(levels, 2) == pytest.approx([0.0, 0.5])


@pytest.mark.parametrize('degrees, share', [(60, 0.75), (30, 0.25), (10, 0.030)])
def test_sequential_form_carries_out_the_squared_sine_of_the_angle_between_tasks(degrees, share):
    angle = math.radians(degrees)
    J1, J2 = np.array([[1.0, 0.0]]), np.array([[math.cos(angle), math.sin(angle)]])
    levels = [(J1, [0.0]), (J2, [1.0])]
    assert J2 @ successive(levels, 2) == pytest.approx(share, abs=5e-4)
    assert J2 @ solve(levels).velocity == pytest.approx(1.0)


def test_both_forms_agree_where_the_tasks_are_orthogonal():
    rng = np.random.default_rng(9)
    Q = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    levels = [(Q[:2], rng.standard_normal(2)), (Q[2:4], rng.standard_normal(2)),
              (Q[4:5], rng.standard_normal(1))]
    np.testing.assert_allclose(successive(levels, 6), solve(levels).velocity, **EXACT)


@pytest.mark.parametrize('J2, change', [([0.0, 1.0, 0.0], 0.0), ([1.0, 1.0, 0.0], 0.5)])
def test_third_task_disturbs_the_second_unless_the_projectors_commute(J2, change):
    # Worked out by hand: for the second J2, P2 = P1 (I − J2⁺ J2) has the rows 0, [−0.5 0.5 0], z.
    levels = [([[1.0, 0.0, 0.0]], [0.0]), ([J2], [0.0]), ([[0.0, 1.0, 1.0]], [2.0])]
    assert J2 @ successive(levels, 3) == pytest.approx(change)

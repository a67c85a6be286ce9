# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Which levels the solver accepts, and what it says about others."""

import math

import numpy as np
import pytest
from tp_controller import Level, solve, SolverError


def test_level_may_hold_lists():
    assert solve([Level([[1.0, 1.0]], [1.0])]).velocity == pytest.approx([0.5, 0.5])


def test_level_of_all_joints_is_recognised_whoever_made_it():
    levels = [Level.of_joints(np.ones(3)), (np.eye(3), np.ones(3)), (2.0 * np.eye(3), np.ones(3)),
              (np.eye(3)[[1, 0, 2]], np.ones(3)), (np.eye(3)[:2], np.ones(2)),
              Level(np.eye(3), upper=np.ones(3)), Level(np.ones((1, 3)), np.ones(1),
                                                        is_identity=True)]
    checked = solve(levels).hierarchy
    assert [level.is_identity for level in checked] == [True, True] + [False] * 5
    assert Level.of_joints(np.array([0.3, 0.1]), 'scale').mode == 'scale'


@pytest.mark.parametrize('levels, message', [
    ([(np.eye(2), np.ones(3))], 'level 1: J must be'),
    ([(np.ones(2), np.ones(2))], 'level 1: J must be'),
    ([(np.eye(2), np.ones((2, 1)))], 'level 1: J must be'),
    ([(np.eye(2), np.ones(2)), (np.eye(3), np.ones(3))], r'number of joints: \[2, 3\]'),
    ([(np.eye(2), np.ones(2)), 5], 'level 2: needs J'),
    ([([[1.0, 2.0], [3.0]], [1.0, 2.0])], 'level 1: J must be'),
    ([(np.eye(2), ['a', 'b'])], 'level 1: J must be'),
    ([Level(np.eye(2))], 'level 1: needs v, or a bound'),
    ([Level(np.eye(2), np.ones(2)), Level(np.eye(2), np.ones(2), lower=np.zeros(2))],
     'level 2: has both a velocity v and bounds'),
    ([Level(np.eye(2), lower=np.zeros(3))], 'level 1: bounds must be 2 numbers'),
    ([Level(np.eye(2), lower=np.zeros((2, 1)))], 'level 1: the lower bound'),
    ([Level(np.eye(2), upper=['a', 'b'])], 'level 1: the upper bound'),
    ([Level(np.eye(2), lower=[0.0, 1.0], upper=[0.0, 0.5])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), lower=[0.0, math.nan])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), lower=[0.0, math.inf])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), upper=[0.0, -math.inf])], 'level 1: bounds need lower ≤ upper'),
    ([Level(np.eye(2), np.ones(2), mode='scaled')], "level 1: unknown mode.*mean 'scale'"),
    ([Level(np.eye(2), lower=np.zeros(2), mode='scale')], 'level 1: bounds have no direction'),
    ([Level(np.eye(2), lower=np.zeros(2)), (np.eye(2), np.ones(2)),
      Level(np.eye(2), np.ones(2), 'scale')], 'level 3: mode scale .* bounds of level 1 above'),
])
def test_levels_that_do_not_fit_together_are_refused(levels, message):
    with pytest.raises(SolverError, match=message):
        solve(levels)


@pytest.mark.parametrize('levels, message', [
    (5, 'levels must be a sequence of Level or .J, v., not 5'),
    (None, 'levels must be a sequence'),
    ([(1j * np.eye(2), np.ones(2))], 'level 1: J must be .m, n.: complex'),
    ([(1e160 * np.eye(2), np.ones(2))], 'level 1: .* beyond 1e.100'),
    ([(np.eye(2), 1e160 * np.ones(2))], 'level 1: .* beyond 1e.100'),
])
def test_what_are_no_levels_is_named(levels, message):
    with pytest.raises(SolverError, match=message):
        solve(levels)

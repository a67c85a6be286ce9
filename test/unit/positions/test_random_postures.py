# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Random postures: within limits, and near the start where a base moves."""

import numpy as np
import pytest
import robots
from tp_controller.positions.random_postures import BASE_RANGE, FREE_RANGE, random_postures


@pytest.mark.parametrize('name', ['Panda', 'DH arm', 'planar', 'differential', 'underwater',
                                  'floating'])
def test_joints_are_within_limits_and_bases_near_the_start(name):
    robot = robots.named(name)
    start = robots.anywhere(robot, np.random.default_rng(1))[0]
    found = random_postures(robot, start, np.random.default_rng(0), 200)
    assert found.shape == (200, robot.nq)
    joints, columns = found[:, robot.joint_rows], robot.joint_columns
    lower, upper = robot.lower[columns], robot.upper[columns]
    lower = np.where(np.isfinite(lower), lower, -FREE_RANGE)
    upper = np.where(np.isfinite(upper), upper, FREE_RANGE)
    assert (joints >= lower).all()
    assert (joints <= upper).all()
    # They fill the ranges.
    assert (np.ptp(joints, axis=0) > 0.9 * (upper - lower)).all()
    if robot.moves:
        places = np.array([robot.base_placement(q)[:3] for q in found])
        away = np.abs(places - robot.base_placement(start)[:3])
        assert away.max() <= np.sqrt(3.0) * BASE_RANGE + 1e-9
        assert away.max() > 0.5 * BASE_RANGE
        for q in found:
            robot.state(q)
    again = random_postures(robot, start, np.random.default_rng(0), 200)
    np.testing.assert_array_equal(found, again)

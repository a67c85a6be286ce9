# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The demonstration with a joint that fails: the tool arrives with the others."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tp_controller.tools.demos import failed_joint as demo

THIRD = 2


@pytest.fixture(scope='module')
def motions():
    """Return the recorded runs."""
    return {case: demo.record(case) for case in (demo.WORKING, demo.ONE_LOCKED, demo.UNTOLD)}


@pytest.mark.slow
def test_tool_arrives_at_each_goal_without_the_joint(motions):
    motion = motions[demo.ONE_LOCKED]
    last, count = demo.last_errors(motion), round(demo.TIME_OF_A_GOAL / demo.PERIOD)
    for number, goal in enumerate(demo.goals_of(motion.robot), 1):
        pose = motion.robot.state(motion.q[number * count - 1]).pose(demo.TOOL)
        away = 1e3 * np.linalg.norm(pose[:3, 3] - goal[:3, 3])
        turn = np.degrees(Rotation.from_matrix(pose[:3, :3].T @ goal[:3, :3]).magnitude())
        assert away < 0.05 and turn < 0.01
        np.testing.assert_allclose(last[number - 1], [away, turn], atol=1e-5)
    # As soon as with all joints.
    np.testing.assert_allclose(last, demo.last_errors(motions[demo.WORKING]), atol=0.01)


def test_joint_fails_in_motion_and_stands_from_then_on(motions):
    for case in (demo.ONE_LOCKED, demo.UNTOLD):
        motion, fails = motions[case], round(demo.FAILS / demo.PERIOD)
        assert motion.velocities[fails - 1, THIRD] > 0.1
        assert np.ptp(motion.q[fails:, THIRD]) < 1e-12
    assert not motions[demo.ONE_LOCKED].velocities[fails:, THIRD].any()
    assert np.abs(motions[demo.UNTOLD].velocities[fails:, THIRD]).min() > 0.0
    # It would have gone on.
    assert np.ptp(motions[demo.WORKING].q[fails:, THIRD]) > 0.2


def test_controller_that_does_not_know_misses_all_goals(motions):
    assert demo.last_errors(motions[demo.UNTOLD])[:, 0].min() > 5.0


@pytest.mark.slow
def test_outcome_is_told_with_figures(tmp_path, motions, monkeypatch):
    films = []
    monkeypatch.setattr(demo, 'record', motions.__getitem__)
    monkeypatch.setattr(demo, 'films', lambda path, motion: films.append(motion) or ())
    outcome = demo.failed_joint(tmp_path)
    assert outcome.passed
    assert 'joint 3 commanded in vain: the tool misses the goals by 9.3 mm, 77.2 mm, 26.8 mm' in \
        str(outcome)
    assert all(path.stat().st_size > 10_000 for path in outcome.paths)
    film, = films
    assert film.caption(10) == 'all joints work' and 'joint 3 has failed' in film.caption(100)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The pictures of docs/tuning.md are shown, can be drawn anew, and what they show is true."""

import importlib.util
from pathlib import Path
import re

import numpy as np
from PIL import Image
import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PICTURE = re.compile(r'^!\[[^\]]+\]\(images/tuning/(\w+)\.png\)$', re.MULTILINE)


def load_tuning():
    """Return docs/tuning.py as a module."""
    spec = importlib.util.spec_from_file_location('tuning', DOCS / 'tuning.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


tuning = load_tuning()


def curves(name):
    """Return for each curve of a case its values before and after, (2, cycles) each."""
    case = tuning.CASES[name]
    runs = [tuning.Run(setup, case.tool) for setup in (case.before, case.after)]
    return [np.array([plot.curve(run) for run in runs]) for plot in case.plots]


def seconds_until(error, limit):
    """Return when errors (cycles,) are within a limit for good [s]."""
    return tuning.PERIOD * (1 + np.flatnonzero(error > limit).max())


def test_every_case_has_a_picture_and_is_shown():
    shown = PICTURE.findall((DOCS / 'tuning.md').read_text(encoding='utf-8'))
    assert len(shown) == len(set(shown)) and set(shown) == set(tuning.CASES)
    assert {path.stem for path in tuning.FOLDER.iterdir()} == set(tuning.CASES)


def test_pictures_have_one_size_and_are_small():
    for path in tuning.FOLDER.iterdir():
        with Image.open(path) as picture:
            assert picture.size == (902, 352), path
        assert path.stat().st_size < 100_000, path


@pytest.mark.slow
def test_a_picture_drawn_again_is_the_same(tmp_path):
    paths = [tuning.draw('delay', tmp_path / folder)[0] for folder in ('first', 'second')]
    assert paths[0].name == 'delay.png'
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_higher_gain_is_faster():
    error, fastest = curves('slow')
    before, after = (seconds_until(each, 20.0) for each in error)
    assert before == pytest.approx(3.0 * after, rel=0.1)
    assert fastest[1].max() > 2.0 * fastest[0].max()


def test_delay_and_a_high_gain_make_it_overshoot():
    height, _ = curves('delay')
    assert height[0].min() < -20.0 and height[1].min() > -0.5


def test_feed_forward_takes_the_lag_away():
    error, _ = curves('lag')
    assert error[0, 300:].min() > 60.0 and error[1, 300:].max() < 1.0


def test_damping_slows_joints_near_a_singularity_at_little_cost():
    fastest, error = curves('singular')
    # Velocity limits of the Panda.
    assert fastest[0].max() == pytest.approx(2.61) and fastest[1].max() < 1.8
    assert error[1, -1] < error[0, -1] + 1.0


@pytest.mark.slow
def test_too_much_damping_makes_it_creep():
    error, _ = curves('creeping')
    assert error[0, 300:].max() > 15.0 and error[1, 300:].max() < 1.0
    assert error[0, -1] > 100.0 * error[1, -1]


def test_acceleration_limits_keep_commands_from_jumping():
    change, _ = curves('jumps')
    most = max(limit['acceleration'] for limit in tuning.ACCELERATIONS.values())
    assert change[0].max() > 1.0 and change[1].max() <= tuning.PERIOD * most + 1e-9


def test_redistribution_goes_on_where_uniform_scaling_stops():
    error, position = curves('stops')
    assert error[0, -1] > 700.0 and error[1, -1] < 1.0
    assert position[0, -1] == pytest.approx(-1.7628, abs=1e-3) and position[1, -1] > -1.5


def test_a_delay_that_is_set_keeps_a_late_robot_within_its_limit():
    beyond, _ = curves('overshoot')
    assert beyond[0].max() > 10.0 and beyond[1].max() <= 0.0


def test_less_demand_reaches_the_point():
    error, tilt = curves('demand')
    assert error[0, -1] > 70.0 and error[1, -1] < 0.1
    assert tilt[0, -1] < 1.1 and 15.0 < tilt[1, -1] < 25.0


@pytest.mark.slow
def test_a_posture_ends_the_drift():
    for joint in curves('drift'):
        turn = round(3.0 / tuning.PERIOD)
        drift = np.abs(joint[:, -1] - joint[:, 3 * turn - 1])
        assert drift[0] > 0.1 > 0.02 > drift[1]


@pytest.mark.slow
def test_a_reserve_keeps_the_first_task_on_its_path():
    error, tilt = curves('reserve')
    assert error[0, 150:].max() > 100.0 and error[1, 150:].max() < 10.0
    assert tilt[1].max() < tilt[0].max()


def test_a_short_blending_starts_sooner():
    error, _ = curves('blend')
    before, after = (seconds_until(each, 20.0) - 2.0 for each in error)
    assert before > 1.5 and after < 0.9


def test_weights_make_the_arm_do_more_of_the_work():
    driven, error = curves('weights')
    assert driven[1, -1] < 0.7 * driven[0, -1]
    assert error[:, -1].max() < 0.1

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joints that stay away from their commanded positions: at rest, in motion, as far as allowed."""

from types import SimpleNamespace

import numpy as np
import pytest
from tp_controller.ros.loop.motion_checks import LeadCheck
from tp_controller.ros.loop.state_checks import Following


def told(ahead, speed=0.0, largest=1.0, tolerance=0.1, window=1.0, seconds=3.0):
    """Return what is told of the second joint, and when [s], if it stays at a distance."""
    check = LeadCheck(('joint1', 'joint2'), Following(window, excess=tolerance))
    output = SimpleNamespace(ahead=None if ahead is None else np.array([0.0, ahead]),
                             velocity=np.array([0.0, speed]), largest_lead=np.full(2, largest))
    for step in range(round(100.0 * seconds)):
        fault = check.check(output, 5.0 + 0.01 * step)
        if fault:
            return fault, 0.01 * step
    return '', None


@pytest.mark.parametrize('ahead, speed, largest, tolerance', [
    # Beyond the tolerance; as far as allowed, which is less; in motion beyond 0.3 s of it.
    (0.11, 0.0, 1.0, 0.1), (-0.11, 0.0, 1.0, 0.1), (0.048, 0.0, 0.05, 0.1),
    (0.048, 0.0, 0.05, np.inf), (0.41, 1.0, 1.0, 0.1), (0.96, 3.0, 1.0, 0.1)])
def test_a_joint_that_stays_away_is_named_after_the_window(ahead, speed, largest, tolerance):
    fault, passed = told(ahead, speed, largest, tolerance)
    assert fault.startswith('joint2 does not follow: 0.') and passed == pytest.approx(1.01)


@pytest.mark.parametrize('given', [
    {'ahead': 0.09}, {'ahead': 0.39, 'speed': 1.0}, {'ahead': 0.047, 'largest': 0.05},
    {'ahead': 0.5, 'window': 0.0}, {'ahead': None}, {'ahead': 0.9, 'tolerance': np.inf},
    {'ahead': 0.5, 'seconds': 0.99}])
def test_a_joint_that_follows_or_has_time_to_is_not_named(given):
    assert told(**given) == ('', None)

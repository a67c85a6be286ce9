# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Configurations at which bounds and goals of a stack are satisfied, near those that are drawn."""

from types import SimpleNamespace

import numpy as np
import pytest
from robots import planar
from tp_controller import Settings, Stack
from tp_controller.tools.check import valid_configurations
from tp_controller.tools.check.setup import Setup
from tp_controller.tools.check.valid_configurations import ValidConfigurations

TIP = '- tip: {type: position, frame: link3, axes: xy}'
NEAR = '- near: {type: keep_in, frame: link3, shape: {sphere: 1.5}}'
NOWHERE = '- nowhere: {type: keep_in, frame: link3, shape: {sphere: 0.5}, at: [9, 0, 0]}'
POSTURE = '- posture: {type: posture, target: {joint1: 0.0, joint2: 0.5, joint3: 0.5}}'
TARGET = [0.0, 0.5, 0.5]
STRETCHED, FOLDED = np.array([0.2, 0.01, 0.01]), np.array([0.2, 2.0, 0.5])


def setup_of(*lines, tries=3):
    """Return the setup of a stack of the planar arm."""
    robot = planar()
    return Setup(robot, Stack.from_yaml('\n'.join(lines), robot), Settings(), 0.01, 10.0,
                 robot.neutral(), tries)


def tip(setup, q):
    """Return where the tip is (2,) [m]."""
    return setup.robot.state(q).position('link3')[:2]


def test_a_configuration_outside_bounds_moves_inside():
    setup = setup_of(NEAR, TIP)
    assert np.linalg.norm(tip(setup, STRETCHED)) > 1.6
    q, satisfied = ValidConfigurations(setup).near(lambda: STRETCHED)
    assert satisfied == {'near': True}
    assert 1.4 < np.linalg.norm(tip(setup, q)) < 1.5 + 1e-6


@pytest.mark.parametrize('lines', [[NEAR, TIP], [TIP], ['- turn: {type: twist, frame: link3}']])
def test_a_configuration_that_satisfies_all_stays(lines):
    drawn = FOLDED.copy()
    q, satisfied = ValidConfigurations(setup_of(*lines)).near(lambda: drawn)
    assert q == pytest.approx(FOLDED, abs=1e-9)
    assert satisfied == ({'near': True} if NEAR in lines else {})


def test_goals_of_the_stack_are_reached():
    q, satisfied = ValidConfigurations(setup_of(POSTURE, TIP)).near(lambda: FOLDED)
    assert q == pytest.approx(TARGET, abs=1e-6)
    assert satisfied == {'posture': True}


def test_a_task_above_keeps_its_value():
    setup = setup_of(TIP, POSTURE)
    q, satisfied = ValidConfigurations(setup).near(lambda: FOLDED)
    assert tip(setup, q) == pytest.approx(tip(setup, FOLDED), abs=1e-6)
    assert satisfied == {'posture': False}
    assert np.linalg.norm(q - TARGET) < np.linalg.norm(FOLDED - TARGET) - 0.1


def test_disabled_tasks_and_limits_of_speeds_are_left_out():
    setup = setup_of(NEAR, '- slow: {type: speed_limit, frame: link3, linear: 0.1}', TIP)
    setup.stack.enable('near', False)
    q, satisfied = ValidConfigurations(setup).near(lambda: STRETCHED)
    assert q == pytest.approx(STRETCHED)
    assert satisfied == {}


def test_the_best_of_several_is_taken_where_none_satisfies_all():
    drawn = iter([STRETCHED, FOLDED, STRETCHED, FOLDED])
    _, satisfied = ValidConfigurations(setup_of(NOWHERE, NEAR)).near(lambda: next(drawn))
    assert len(list(drawn)) == 1
    assert not satisfied['nowhere']


def test_bounds_count_before_goals(monkeypatch):
    class Solver:
        """Satisfies one task after the other."""

        def __init__(self, robot, stack):
            self.names = iter(stack.tasks)

        def solve(self, start, **options):
            """Return a solution with the next task satisfied."""
            name = next(self.names)
            return SimpleNamespace(q=start, tasks=[
                SimpleNamespace(name=each, reached=each == name) for each in ('posture', 'near')])

    monkeypatch.setattr(valid_configurations, 'PositionSolver', Solver)
    for lines, drawn in (([POSTURE, NEAR], [STRETCHED, FOLDED]),
                         ([NEAR, POSTURE], [FOLDED, STRETCHED])):
        each = iter(drawn)
        q, satisfied = ValidConfigurations(setup_of(*lines, tries=2)).near(lambda: next(each))
        assert satisfied == {'posture': False, 'near': True}
        assert np.array_equal(q, FOLDED)

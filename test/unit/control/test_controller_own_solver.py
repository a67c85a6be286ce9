# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A controller with a solver of the user's own: what it gets, and what a report makes of it."""

from dataclasses import replace

import numpy as np
import pytest
import robots
from tp_controller import (
    Bounds,
    Controller,
    Level,
    LevelStep,
    Settings,
    Solution,
    Stack,
)
from tp_controller.solver.solve import PrioritySolver

START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TEXT = ('- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
        '- posture: {type: posture, gain: 0.5}\n')


class PlainRecursion:
    """The recursion as one writes it first, clipped; reports velocities and multipliers only."""

    def __init__(self, settings, n):
        self.settings, self.n, self.undamped, self.given = settings, n, self, []

    def solve(self, levels, bounds, memory=()):
        self.given.append((levels, bounds, memory))
        x, P, steps = np.zeros(self.n), np.eye(self.n), []
        for level in levels:
            pseudoinverse = np.linalg.pinv(level.J @ P, rcond=1e-6)
            x = x + pseudoinverse @ (level.v - level.J @ x)
            P = P - pseudoinverse @ level.J @ P
            steps.append(LevelStep(x))
        clipped = np.clip(x, bounds.lower, bounds.upper)
        if (x != clipped).any():
            steps = [step._replace(multipliers=x - clipped) for step in steps]
        return Solution(clipped, levels, steps=steps)


def controller_of(made, text=TEXT, **settings):
    """Return a controller whose solvers are noted in `made`."""
    def make(*given):
        made.append(PlainRecursion(*given))
        return made[-1]

    robot = robots.panda()
    return Controller(robot, Stack.from_yaml(text, robot), Settings(blend=0.0, **settings), make)


def test_commands_are_those_of_the_solver_that_was_given():
    made = []
    controller = controller_of(made)
    controller.update(START, 0.0)
    controller.set_goal('tool', [0.4, 0.2, 0.5], 0.0)
    q = START
    for cycle in range(1, 500):
        command = controller.update(q, 0.01 * cycle)
        q = controller.robot.integrate(q, command.velocity, 0.01)
    solver, = made
    levels, bounds, _ = solver.given[-1]
    assert np.array_equal(command.velocity, solver.solve(levels, bounds).velocity)
    assert [level.J.shape for level in levels] == [(3, 7), (7, 7)]
    assert bounds.hold == pytest.approx(0.01) and (bounds.lower < bounds.upper).all()
    assert command.report.tasks[0].reached


def test_settings_make_another_solver():
    made = []
    controller = controller_of(made)
    controller.update(START, 0.0)
    controller.settings = replace(controller.settings, damping=0.3)
    controller.update(START, 0.01)
    assert [solver.settings.damping for solver in made] == [0.1, 0.3]
    assert [solver.n for solver in made] == [7, 7] and made[1].given


def test_report_names_causes_with_a_solver_that_knows_of_none():
    controller = controller_of([])
    controller.update(START, 0.0)
    controller.set_goal('tool', [0.7, 0.3, 0.6], 0.0)
    controller.set_velocity_limits({'panda_joint1': 0.05})
    report = controller.update(START, 0.01).report
    assert ('velocity limit', 'panda_joint1') in {
        (cause.kind, cause.name) for cause in report.tasks[0].causes}
    assert 'panda_joint1 at its velocity limit' in report.tasks[0].reason
    assert report.limiting.endswith('at its velocity limit')


def test_what_a_solver_leaves_out_is_computed_from_the_levels():
    rng = np.random.default_rng(3)
    levels = [Level(rng.normal(size=(m, 7)), rng.normal(size=m)) for m in (2, 3, 4)]
    levels[1].J[2] = levels[0].J[0] + levels[1].J[0]
    bounds = Bounds(np.full(7, -1e6), np.full(7, 1e6))
    expected = PrioritySolver(7).solve(levels, bounds)
    found = PlainRecursion(None, 7).solve(levels, bounds)
    assert found.velocity == pytest.approx(expected.velocity)
    for one, other in zip(found.levels, expected.levels):
        assert one.rank == other.rank and one.rank_alone == np.linalg.matrix_rank(one._level.J)
        assert one.unreachable == pytest.approx(other.unreachable, abs=1e-9)
        assert one.residual == pytest.approx(other.residual, abs=1e-9)
        assert one.smallest_singular_value == pytest.approx(other.smallest_singular_value)
        assert not one.is_damped and one.disturbance_bound == 0.0
    # Without any steps as well.
    bare = Solution(expected.velocity, levels)
    assert [level.rank for level in bare.levels] == [level.rank for level in expected.levels]
    assert not bare.bounded and bare.scale == 1.0 and bare.bends == [0.0, 0.0, 0.0]

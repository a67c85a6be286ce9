# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Problems as hard as one can make them: an answer, within the bounds, and no level disturbed.

`benchmarks/robustness.py` counts the same in 8,000 of them.
"""

from audit import audit
import numpy as np
from problems import features_of, hard_cycle, redistribute, SETTINGS
import pytest
from tp_controller import Level, solve
from tp_controller.solver import compiled
from tp_controller.solver.bounded_hierarchy import BoundedHierarchy
from tp_controller.solver.damping import Damping
from tp_controller.solver.polytope import Polytope
from tp_controller.solver.solve import solve_by_reference, solve_cycle

PROBLEMS = 300


def solve_whole(cycle):
    """Return the solution of a cycle, as `solve` does."""
    return solve_cycle(*cycle)


@pytest.mark.parametrize('setting', SETTINGS)
@pytest.mark.slow
def test_hard_problem_has_an_answer_within_its_bounds_that_keeps_priorities(setting):
    for seed in range(PROBLEMS):
        found = audit(hard_cycle(seed, setting), solve_whole)
        assert found.velocity is not None and not found.error, (seed, found)
        assert not found.not_finite and not found.beyond, (seed, found)
        # Within bounds of 1e-6 of a unit, tolerances of 1e-11 are larger than rounding.
        most = 1e-6 if 'joint units' in features_of(seed) else 1e-9
        assert found.disturbed <= most, (seed, found)


@pytest.mark.solvers('compiled')
@pytest.mark.parametrize('setting', SETTINGS)
@pytest.mark.slow
def test_core_and_solver_in_python_agree_on_hard_problems(setting):
    before, far_off = compiled.left_to_the_reference(), []
    for seed in range(PROBLEMS):
        cycle = hard_cycle(seed, setting)
        one, other = solve_whole(cycle).velocity, solve_by_reference(*cycle).velocity
        if np.abs(one - other).max() > 1e-6 * max(1.0, np.abs(other).max()):
            far_off.append(seed)
    # What a direction of 1e-9 of its level, or units of 1e6, cost in digits.
    assert len(far_off) <= PROBLEMS // 100, far_off
    assert compiled.left_to_the_reference() <= before + 1


# No direction left

@pytest.mark.parametrize('seed, setting', [
    (1189, 'exact'), (4197, 'exact'), (664, 'defaults'), (4886, 'defaults'), (4886, 'speed cap'),
    (3264, 'memory'), (3409, 'memory')])
def test_level_below_a_program_of_a_loose_tolerance_has_an_answer(seed, setting):
    # Rows that nearly repeat each other contradict each other, and then no direction is left.
    before = compiled.left_to_the_reference()
    found = audit(hard_cycle(seed, setting), solve_whole)
    assert found.velocity is not None and not found.error, found
    assert not found.beyond and found.disturbed < 1e-9, found
    assert compiled.left_to_the_reference() == before


@pytest.mark.solvers('python')
@pytest.mark.parametrize('mode', ['least_squares', 'scale'])
def test_level_without_a_direction_left_stays_where_a_tolerance_has_put_it(mode):
    allowed = Polytope(-np.ones(2), np.ones(2))
    hierarchy = BoundedHierarchy(allowed, Damping())
    hierarchy.carry_out(Level(np.eye(2), np.array([0.5, 0.25]), is_identity=True), 0.0)
    allowed.add(np.eye(2)[:1], np.array([-1.0]), np.array([0.5 - 1e-7]), np.ones(1))
    step = hierarchy.carry_out(Level(np.array([[1.0, 1.0]]), np.ones(1), mode), 0.0)
    assert hierarchy.x.tolist() == step.velocity.tolist() == [0.5, 0.25]
    assert step.multipliers is None or not step.multipliers.any()


@pytest.mark.solvers('python')
def test_whatever_a_program_was_solved_to_is_allowed_from_then_on(monkeypatch):
    move, moved = BoundedHierarchy._move, []

    def check(hierarchy, *given):
        multipliers = move(hierarchy, *given)
        allowed, x = hierarchy.allowed, hierarchy.x
        values = allowed.rows @ x
        assert (allowed.row_lower <= values).all() and (values <= allowed.row_upper).all()
        assert allowed.fitting(x).tolist() == x.tolist()
        moved.append(len(values))
        return multipliers
    monkeypatch.setattr(BoundedHierarchy, '_move', check)
    for seed in range(200):
        if 'inequalities' in features_of(seed):
            solve_whole(hard_cycle(seed, 'exact'))
    assert np.count_nonzero(moved) > 50


@pytest.mark.parametrize('n', [0, 1])
def test_level_with_bounds_that_nothing_can_move_is_as_far_off_as_before(n):
    fixed = {'lower': [0.5], 'upper': [0.5]} if n else {}
    J = np.full((1, n), 2.0)
    solution = redistribute([Level(J, lower=[3.0]), (J, [1.0]), Level(J, upper=[-1.0])], **fixed)
    assert solution.velocity.tolist() == [0.5] * n
    assert [level.residual.tolist() for level in solution.levels] == \
        [[3.0 - n], [1.0 - n], [-1.0 - n]]


# Units

@pytest.mark.parametrize('unit', [1.0, 1e3, 1e6, 1e9, 1e12, 1e14])
@pytest.mark.parametrize('regularisation', [0.0, 0.02])
def test_unit_of_a_level_does_not_disturb_those_above_within_bounds(unit, regularisation):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        J, below = rng.standard_normal((2, 6)), unit * rng.standard_normal((3, 6))
        levels = [(J, 3.0 * rng.standard_normal(2)), (below, 3.0 * unit * rng.standard_normal(3)),
                  Level(rng.standard_normal((2, 6)), lower=rng.standard_normal(2))]
        upper = rng.uniform(0.1, 1.0, 6)
        solution = solve(levels, -upper, upper, scaling='redistribute',
                         regularisation=regularisation)
        assert solution.levels[0].disturbance == pytest.approx(np.zeros(2), abs=1e-10)
        assert solution.levels[1].disturbance / unit == pytest.approx(np.zeros(3), abs=1e-10)

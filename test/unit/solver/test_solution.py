# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the solution says about each level, most of it worked out by hand."""

from hypothesis import assume, given
from hypothesis import strategies as st
import numpy as np
from problems import EXACT, near, redistribute, stacks, well_conditioned
import pytest
from reference import projector, random_levels
from tp_controller import Level, solve


@pytest.mark.slow
@given(stacks(max_joints=9, max_levels=4), st.sampled_from([0.0, 0.2]), st.booleans())
def test_solution_tells_rank_and_smallest_singular_value_of_each_level(stack, damping, scaled):
    n, levels = stack
    assume(levels and well_conditioned(n, levels, 1e-3))
    bounds = (np.full(n, -0.2), np.full(n, 0.2)) if scaled else (None, None)
    solution = solve(levels, *bounds, damping=damping)
    assert len(solution.levels) == len(levels)
    for index, ((J, v), level) in enumerate(zip(levels, solution.levels)):
        s = np.linalg.svd(J @ projector(levels[:index], n), compute_uv=False)
        assert level.rank == (s > 1e-9 * np.linalg.norm(J)).sum()
        smallest = s[-1] if 0 < len(v) <= n else 0.0
        assert level.smallest_singular_value == pytest.approx(smallest, abs=1e-9)
        np.testing.assert_allclose(level.demand, v)
        np.testing.assert_allclose(level.achieved, J @ solution.velocity, **EXACT)
        np.testing.assert_allclose(level.residual, v - J @ solution.velocity, **EXACT)
        assert level.scale == solution.scale


def test_former_name_of_the_demand_warns():
    level, = solve([([[1.0, 0.5]], [0.3])]).levels
    with pytest.warns(DeprecationWarning, match='demand'):
        assert level.wanted == near([0.3])


def test_multipliers_and_limited_by_are_those_of_the_bounds_in_the_way():
    level = redistribute([([[1.0, 2.0]], [5.0])], -np.ones(2), np.ones(2)).levels[0]
    # Both at 1, 2 is missing: widening by ε helps by 2 ε and 4 ε.
    assert level.multipliers == near([2.0, 4.0])
    assert level.limited_by == [1, 0]
    assert level.scale == near(0.6)
    assert level.velocity.tolist() == level.limited_velocity.tolist() == [1.0, 1.0]
    level = redistribute([([[1.0, 2.0]], [-5.0])], -np.ones(2), np.ones(2)).levels[0]
    assert level.multipliers == near([-2.0, -4.0])


def test_second_level_is_limited_where_the_first_is_not():
    levels = [([[1.0, 1.0, 0.0]], [0.0]), ([[1.0, 0.0, 0.0]], [3.0])]
    solution = redistribute(levels, -np.ones(3), np.ones(3))
    assert solution.velocity == near([1.0, -1.0, 0.0])
    assert solution.levels[0].limited_by == []
    assert solution.levels[0].scale == 1.0
    assert set(solution.levels[1].limited_by) <= {0, 1}
    assert solution.levels[1].scale == near(1.0 / 3.0)
    # Along (1, −1, 0) the residual is 2, because of either bound or of both.
    multipliers = solution.levels[1].multipliers
    assert multipliers[0] - multipliers[1] == near(2.0)
    assert solution.scale == near(1.0 / 3.0)
    assert solution.limiting in {0, 1}


def test_joint_that_cannot_move_is_named_where_it_would_help():
    solution = redistribute([([[1.0, 0.0]], [2.0]), ([[0.0, 1.0]], [0.5])], [0.0, -1.0],
                            [0.0, 1.0])
    assert solution.velocity == near([0.0, 0.5])
    assert solution.levels[0].multipliers == near([2.0, 0.0])
    assert solution.levels[0].limited_by == [0]
    assert solution.levels[1].limited_by == []


def test_unreachable_part_of_the_first_demand_does_not_depend_on_bounds_above_it():
    # s = 0.01 is damped to s / ε² = 25, ε = 0.02 of the first level; the row has moved joint 1.
    options = {'damping': 0.1, 'singular_region': 0.1}
    row = Level(np.array([[1.0, 0.0]]), lower=np.array([0.2]))
    demand = ([[0.01, 0.0]], [0.01])
    for levels in ([demand], [row, demand]):
        level = redistribute(levels, **options).levels[-1]
        assert level.achieved == near([0.0025])
        assert level.unreachable == near([0.0075])


def test_unreachable_is_what_is_missing_without_bounds_too():
    J = np.array([[1.0, 0.0], [0.0, 0.0]])
    for bound, scale in ((9.0, 1.0), (0.5, 0.5)):
        level = redistribute([(J, [1.0, 2.0])], np.full(2, -bound), np.full(2, bound)).levels[0]
        assert level.unreachable == near([0.0, 2.0])
        assert level.scale == near(scale)
    level = redistribute([([[1.0, 0.0]], [0.3]), (np.eye(2), [1.0, 0.2])]).levels[1]
    assert level.unreachable == near([0.7, 0.0])


@pytest.mark.slow
def test_widening_a_bound_helps_as_much_as_its_multiplier_says():
    rng = np.random.default_rng(21)
    for _ in range(20):
        levels = random_levels(rng, 5, [2, 2])
        upper = np.full(5, 0.1)
        before = redistribute(levels, -upper, upper)
        for joint, multiplier in enumerate(before.levels[0].multipliers):
            wider = upper.copy()
            wider[joint] += 1e-6
            after = redistribute(levels, -upper if multiplier > 0.0 else -wider,
                                 wider if multiplier > 0.0 else upper)
            J, v = levels[0]
            gain = 0.5 * (np.sum((v - J @ before.velocity) ** 2)
                          - np.sum((v - J @ after.velocity) ** 2)) / 1e-6
            assert gain == pytest.approx(abs(multiplier), abs=1e-4)


def test_widening_a_bound_helps_a_scaled_level_as_much_as_its_multiplier_says():
    level = Level(np.eye(2), np.array([2.0, 1.0]), 'scale')
    upper = np.array([0.5, 5.0])
    before, after = (redistribute([level], -upper, upper + [wider, 0.0]) for wider in (0.0, 1e-6))
    gain = 0.5 * (np.sum(before.levels[0].residual ** 2)
                  - np.sum(after.levels[0].residual ** 2)) / 1e-6
    assert before.levels[0].multipliers == near([gain, 0.0], rel=1e-4)


def test_a_row_that_is_pushed_by_rounding_alone_is_not_in_the_way():
    # The second level begins at the bound of the first, and is met all the same.
    levels = [Level(np.array([[1.0, 0.0]]), lower=np.array([0.1])),
              (np.array([[-2.9, 0.1]]), np.array([-0.1])), (np.array([[-1.2, 0.0]]), [-0.3])]
    solution = redistribute(levels, -5.0 * np.ones(2), 5.0 * np.ones(2))
    assert solution.levels[1].residual == near([0.0])
    assert not any(level.row_multipliers for level in solution.levels)

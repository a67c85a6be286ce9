# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygons in the compiled core are those of the reference, in cycles and searches."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.control.cycle_record import CycleRecord
from tp_controller.control.step import Commanded
from tp_controller.positions.compiled import Searches
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures
from tp_controller.solver.compiled import core
from tp_controller.tasks import ComPolygon, Task
from tp_controller.tasks.needs import lacks

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
SEEDS = st.integers(0, 2 ** 32 - 1)
NAMES = [name for name in sorted(robots.EVERY) if not lacks(
    'com_polygon', ComPolygon.needs, robots.named(name), {})]


def pair(robot, entries):
    """Return two controllers of a stack: with tasks in the core, and all in Python."""
    found = [Controller(robot, Stack(entries, robot), Settings(period=0.01, blend=0.0))
             for _ in range(2)]
    found[1]._core.solve = lambda *given: None
    for task in found[1].stack.tasks.values():
        task.make_twin = lambda: None
    return found


def assert_same(one, other):
    """Assert that two cycles have the same evaluations."""
    for found, expected in zip(sum(one.evaluations, []), sum(other.evaluations, []), strict=True):
        assert list(found.row_names) == list(expected.row_names)
        for this, that in ((found.error, expected.error), (found.level.J, expected.level.J),
                           (found.level.lower, expected.level.lower),
                           (found.level.upper, expected.level.upper)):
            np.testing.assert_allclose(this, that, rtol=0.0, atol=1e-12)
    for found, expected in zip(one.cycle.levels, other.cycle.levels, strict=True):
        np.testing.assert_array_equal(found.weights, expected.weights)
    assert [each.tolist() for each in one.errors] == [
        each.error.tolist() for each in sum(one.evaluations, [])]


@pytest.mark.slow
@given(seed=SEEDS, name=st.sampled_from(NAMES), count=st.integers(1, 3), shared=st.booleans())
def test_rows_are_those_of_the_reference_whichever_way_evaluated_the_cycle_before(
        seed, name, count, shared):
    rng, robot = np.random.default_rng(seed), robots.named(name)
    frames = rng.choice(robot.frame_names, count, replace=False)
    balance = {'balance': {
        'type': 'com_polygon', 'up': rng.normal(size=3).tolist(), 'margin': 0.1,
        'contacts': {str(frame): rng.normal(size=(4, 3)).tolist() for frame in frames},
        **({'weights': 3.0} if shared else {})}}
    slow = {'slow': {'type': 'speed_limit', 'frame': str(robot.frame_names[-1]), 'linear': 0.5}}
    one, other = pair(robot, [[slow, balance] if shared else balance])
    q, names = robots.anywhere(robot, rng)[0], set()
    for cycle in range(12):
        now = 0.01 * cycle
        other._last = Commanded(one._memory)
        if rng.random() < 0.3:
            solve, one._core.solve = one._core.solve, lambda *given: None
            one.update(q, now)
            one._core.solve = solve
        else:
            one.update(q, now)
            assert isinstance(one._last, CycleRecord)
        other.update(q, now)
        assert_same(one._last, other._last)
        names.update(one._last.evaluations[0][-1].row_names)
        # The robot rests, moves on and jumps.
        q = robot.integrate(q, rng.choice([0.0, 0.01, 1.0]) * rng.normal(size=robot.n), 1.0)
    assert len(names) >= 3


@pytest.mark.parametrize('points, rows', [
    ({'panda_link0': [[0.0, 0.0, 0.1], [0.0, 0.1, 0.2], [0.0, -0.1, 0.1]]},
     ['contacts on one line']),
    ({'panda_link0': [[0.2, 0.1, 0.0]], 'panda_link1': [[0.2, 0.1, -0.333], [0.2, 0.1, 0.3]]},
     ['contacts on one line']),
    # The second point is outside of the edge, but by a rounding error only.
    ({'panda_link0': [[0.1, -0.1, 0.0], [0.1 + 1e-9, 0.0, 0.0], [0.1, 0.1, 0.0],
                      [-0.1, 0.0, 0.0]]},
     ['panda_link0 1 – panda_link0 3', 'panda_link0 3 – panda_link0 4',
      'panda_link0 4 – panda_link0 1'])])
def test_points_that_are_no_corners_have_no_rows(points, rows):
    robot = robots.robot_for(ComPolygon)
    one, other = pair(robot, [{'balance': {'type': 'com_polygon', 'contacts': points}}])
    q = np.array(robots.PANDA_READY)
    # At the zero of joint 1 its frame is parallel to that of the stand.
    q[0] = 0.0
    for cycle in range(5):
        other._last = Commanded(one._memory)
        q = q + 0.01 * one.update(q, 0.01 * cycle).velocity
        other.update(one._last.place.q, 0.01 * cycle)
        assert isinstance(one._last, CycleRecord)
        assert_same(one._last, other._last)
        assert one._last.evaluations[0][0].row_names == rows


def test_numbers_of_single_rows_are_those_of_all_edges():
    robot = robots.robot_for(ComPolygon)
    one, other = pair(robot, [{'balance': {'type': 'com_polygon', **ComPolygon.example,
                                           'gain': [3.0], 'weights': {'m': 2.0}}}])
    for controller in (one, other):
        controller.update(np.array(robots.PANDA_READY), 0.0)
    assert isinstance(one._last, CycleRecord)
    assert_same(one._last, other._last)
    assert one._last.cycle.levels[0].weights.tolist() == [2.0] * 4


def test_type_that_sees_other_rows_has_no_twin():
    class Narrow(ComPolygon):
        type_name = ''

        def observe_rows(self, state):
            return super().observe_rows(state)

    robot = robots.robot_for(ComPolygon)
    assert Narrow(robot, 'task', **ComPolygon.example).twin is None
    assert Task.types['com_polygon'] is ComPolygon


def test_searches_keep_the_balance_as_those_of_the_reference():
    robot, generator = robots.robot_for(ComPolygon), np.random.default_rng(0)
    corners = [[0.12, 0.3, 0.0], [-0.3, 0.3, 0.0], [-0.3, -0.3, 0.0], [0.12, -0.3, 0.0]]
    stack = Stack([{'balance': {'type': 'com_polygon', 'contacts': {'panda_link0': corners}}},
                   {'tool': {'type': 'position', 'frame': robots.PANDA_TOOL}}], robot)
    both = [PositionStack(robot, stack) for _ in range(2)]
    one, other = (Searches(robot, tasks) for tasks in both)
    other._compiled = None
    for start in random_postures(robot, robot.neutral(), generator, 10):
        # A goal nearby: few steps, which rounding does not turn elsewhere.
        near = start + generator.uniform(-0.1, 0.1, robot.n)
        for tasks in both:
            tasks.stack.tasks['tool'].goal = robot.state(near).position(robots.PANDA_TOOL).copy()
        one.begin(robot.passive_neutral)
        assert one._compiled.fit
        found, expected = (each.find(start[np.newaxis], 2, 1, np.inf)[0] for each in (one, other))
        assert found.descents == expected.descents
        np.testing.assert_allclose(found.q, expected.q, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(found.costs, expected.costs, rtol=1e-6, atol=1e-12)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The compiled bounds of inequality tasks are those of the reference."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.solver.compiled import core
from tp_controller.tasks import bounded
from tp_controller.tasks.bounded import bounds_of

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')

N = 4
seeds = st.integers(0, 2 ** 32 - 1)


def filled(arguments):
    """Return what the compiled function fills in; None where it leaves that to the reference."""
    found = [np.full(len(arguments[0]), 7.0) for _ in range(3)]
    return found if core.bound(*arguments, *found) else None


@settings(max_examples=500)
@given(seed=seeds, m=st.integers(0, 5), each=st.booleans(), short=st.booleans(),
       jumps=st.booleans(), turned=st.booleans(), ends=st.sampled_from(['both', 'lower', 'upper']))
@pytest.mark.slow
def test_bounds_are_those_of_the_reference(seed, m, each, short, jumps, turned, ends):
    rng = np.random.default_rng(seed)
    # Nearly out of reach are bounds that are a few times as far away as their rows are long.
    J = rng.normal(size=(m, N)) * (rng.choice([0.0, 1e-6, 3e-3, 6e-3], (m, 1)) if short else 1.0)
    before = rng.normal(size=(m, N)) if jumps else J * rng.uniform(0.6, 1.4, (m, 1))
    value = rng.normal(size=m) * 10.0 ** rng.uniform(-2.0, 0.0)
    lower = rng.normal(size=m) - 1.0 if each else -0.01
    upper = lower + rng.uniform(0.0, 2.0, m) if each else 0.01
    arguments = (
        value, np.asfortranarray(J) if turned else J, before,
        rng.normal(size=N) * 10.0 ** rng.uniform(-1.0, 2.0),
        -np.inf if ends == 'upper' else lower, np.inf if ends == 'lower' else upper,
        rng.uniform(1.0, 20.0, m) if each else np.array(5.0), rng.uniform(0.1, 1.0),
        rng.normal(size=m) if each else 0.0, rng.uniform(0.1, 0.9))
    for found, expected in zip(filled(arguments), bounds_of(*arguments)):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def test_numbers_that_are_none_stay_so():
    J = np.array([[1.0, 0.0], [np.nan, 0.0]])
    arguments = (np.array([np.nan, 0.0]), J, J, np.zeros(2), -1.0, 1.0, np.array(2.0), 0.5, 0.0,
                 0.5)
    for found, expected in zip(filled(arguments), bounds_of(*arguments)):
        assert np.isnan(found[0]) == np.isnan(expected[0])
    assert np.isnan(filled(arguments)[1]).any()


def test_what_does_not_fit_is_left_to_the_reference():
    J, two = np.ones((2, N)), np.ones(2)
    fits = [two, J, J, np.zeros(N), -two, 2.0, np.array(5.0), 0.2, 0.0, 0.5, two, two, two]
    fits[10:] = np.empty(2), np.empty(2), np.empty(2)
    assert core.bound(*fits) is True
    for place, wrong in ((0, np.ones(3)), (0, [1.0, 1.0]), (1, J[:, 1:]), (1, J.astype(np.single)),
                         (2, J[:1]), (2, None), (3, np.zeros(N + 1)), (4, np.ones(3)), (4, -1),
                         (5, None), (6, np.ones((2, 1))), (8, np.ones(1)), (10, np.empty(3)),
                         (11, np.empty(4)[::2]), (12, None), (12, np.empty((2, 1)))):
        given_ = [*fits]
        given_[place] = wrong
        assert core.bound(*given_) is False, (place, wrong)
    with pytest.raises(TypeError, match='bound'):
        core.bound(*fits[1:])


@pytest.mark.parametrize('guard', [
    'joint_limits, joints: panda_joint1, margin: 2.5',
    'keep_out, frame: panda_hand_tcp, shape: {sphere: 0.2}, at: [0.5, 0.2, 0.5]',
    f'obstacles, capsules: {robots.CONFIG / "panda_capsules.yaml"}, '
    'obstacles: {box: {shape: {box: [0.2, 0.2, 0.2]}, at: [0.5, 0.3, 0.5]}}'])
def test_a_robot_keeps_its_distance_as_with_the_reference(guard, monkeypatch):
    its, ends = robots.panda(), []
    text = f'- guard: {{type: {guard}}}\n- tool: {{type: position, frame: panda_hand_tcp}}\n'
    for rows in (core, None):
        monkeypatch.setattr(bounded, 'core', rows)
        controller = Controller(its, Stack.from_yaml(text, its), Settings(period=0.01))
        # Python observes, as for types without a twin.
        controller.stack.tasks['guard'].make_twin = lambda: None
        q = np.array(robots.PANDA_READY)
        controller.update(q, 0.0)
        controller.set_goal('tool', [0.5, 0.3, 0.5], 0.0)
        for cycle in range(1, 200):
            q = q + 0.01 * controller.update(q, 0.01 * cycle).velocity
        ends.append(q)
    assert np.abs(ends[0] - ends[1]).max() < 1e-9
    assert np.abs(ends[0] - robots.PANDA_READY).max() > 0.1

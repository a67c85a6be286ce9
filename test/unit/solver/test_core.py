# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The compiled core gives the answers of the solver in Python, and says so when it cannot."""

from collections import Counter
import math
import shutil
import sys

import numpy as np
from problems import random_box, random_rows
import pytest
from tp_controller import Level, solve, SolverError
from tp_controller.solver import bounded_hierarchy, compiled, damping, level, min_norm, qp
from tp_controller.solver.damping import Damping
from tp_controller.solver.level import check_levels
from tp_controller.solver.solve import Options, solve_by_reference, solve_cycle

SETTINGS = {
    'default': [Damping(0.1, 0.1, 0.02, 0.02)],
    'exact': [Damping()],
    'others': [Damping(0.1, math.inf, 0.0, 0.02), Damping(0.3, 0.3, 0.1, 0.0),
               Damping(0.0, math.inf, 0.1, 0.1)]}
# benchmarks/core.py has as many as one likes.
PROBLEMS = 500
pytestmark = pytest.mark.solvers('compiled')


def structured_level(rng, n, above):
    """Return a level of one of many kinds, which conflicts with those above or repeats them."""
    m = int(rng.integers(0, max(1, n // 2) + 1))
    J = rng.standard_normal((m, n))
    kind = rng.choice(['full', 'full', 'full', 'rank deficient', 'duplicate', 'mixture',
                       'selection', 'tall', 'posture', 'weak', 'zero'])
    if kind == 'rank deficient' and m > 1:
        J = rng.standard_normal((m, m // 2)) @ rng.standard_normal((m // 2, n))
    elif kind == 'duplicate' and above:
        J = above[rng.integers(len(above))].J.copy()
    elif kind == 'mixture' and above:
        rows = np.concatenate([each.J for each in above])
        J = rng.standard_normal((m, len(rows))) @ rows / math.sqrt(max(1, len(rows)))
    elif kind == 'selection':
        J = np.eye(n)[rng.permutation(n)[:m]]
    elif kind == 'tall':
        J = rng.standard_normal((n + 1, n))
    elif kind == 'posture':
        J = np.eye(n)
    elif kind == 'weak' and m:
        U, s, V_T = np.linalg.svd(J, full_matrices=False)
        s[-1] = 10.0 ** rng.uniform(-4.0, -0.5)
        J = U * s @ V_T
    elif kind == 'zero':
        J = np.zeros((m, n))
    if len(J) and rng.random() < 0.25:
        lower, upper = random_rows(rng, len(J))
        return Level(J, lower=lower, upper=upper)
    mode = 'scale' if rng.random() < 0.2 and not any(each.v is None for each in above) \
        else 'least_squares'
    return Level(J, rng.standard_normal(len(J)) * 10.0 ** rng.uniform(-1.5, 0.5), mode)


def problem(seed, settings):
    """Return what `solve_cycle` takes, of random shapes, bounds and options."""
    rng = np.random.default_rng(seed)
    n, levels = int(rng.integers(1, 13)), []
    for _ in range(int(rng.integers(0, 6))):
        levels.append(structured_level(rng, n, levels))
    lower, upper = random_box(rng, n, str(rng.choice(['symmetric', 'mixed'])))
    if rng.random() < 0.15:
        lower = upper = None
    weights = 10.0 ** rng.uniform(-1.0, 1.0, n) if rng.random() < 0.3 else None
    scaling = 'uniform' if rng.random() < 0.25 else 'redistribute'
    options = Options(n, settings[rng.integers(len(settings))], weights, scaling)
    cap = rng.uniform(0.05, 0.5, n) if scaling == 'redistribute' and rng.random() < 0.3 else None
    remembered = rng.uniform(0.0, 3.0, len(levels)) * (rng.random(len(levels)) < 0.5)
    return (check_levels(levels), lower, upper, options, 0.01 if rng.random() < 0.7 else 0.0, cap,
            tuple(remembered.tolist()) if rng.random() < 0.6 else ())


def by_core(levels, lower, upper, options, period=0.0, cap=None, memory=()):
    """Return what the compiled core makes of a cycle; None where it leaves it to the other."""
    return compiled.solve_by_core(options.core, options.n, levels, lower, upper, period, cap,
                                  memory)


@pytest.mark.parametrize('settings', SETTINGS)
def test_core_gives_the_velocities_of_the_solver_in_python(settings):
    counted = Counter()
    for seed in range(PROBLEMS):
        given = problem(seed, SETTINGS[settings])
        expected, found = solve_by_reference(*given), by_core(*given)
        counted['left'] += found is None
        if found is not None:
            off = np.abs(found.velocity - expected.velocity).max(initial=0.0)
            counted['off'] += off > 1e-9
            counted['far off'] += off > 1e-6
            compare_steps(given, expected, found, counted)
    # A polytope that is all but a point is as large as rounding says.
    assert counted['off'] <= PROBLEMS // 100 and not counted['far off'], counted
    assert counted['left'] <= PROBLEMS // 100, counted
    # Where more bounds meet than are needed, any of them may have the multipliers.
    assert counted['other multipliers'] <= PROBLEMS // 20, counted


def compare_steps(given, expected, found, counted):
    """Compare what is unique in how the levels were carried out."""
    n = given[3].n
    assert len(expected.steps) == len(found.steps) == len(found.memory) == len(given[0])
    for one, other in zip(expected.steps, found.steps):
        assert (one.directions is None) == (other.directions is None)
        assert len(one.followed) == len(other.followed)
        if one.directions is not None:
            assert one.directions.rank == other.directions.rank
            assert one.directions.U.shape == other.directions.U.shape
            assert one.directions.Q.shape == other.directions.Q.shape
            assert other.directions.size == pytest.approx(one.directions.size)
            np.testing.assert_allclose(other.directions.s, one.directions.s, rtol=1e-7,
                                       atol=1e-9 * one.directions.size)
        assert (one.relaxed is None) == (other.relaxed is None)
        assert other.velocity.shape == (n,)
        for mine, yours in ((one.multipliers, other.multipliers),
                            (one.row_multipliers, other.row_multipliers)):
            none = mine is None or yours is None
            counted['other multipliers'] += none and mine is not yours
            if not none:
                assert mine.shape == yours.shape
                size = np.abs(mine).max(initial=1.0)
                counted['other multipliers'] += not np.allclose(mine, yours, atol=1e-6 * size)


def test_core_has_the_constants_of_the_solver_in_python():
    places = {'NEGLIGIBLE': level, 'ROUNDING': level, 'FEASIBLE': level, 'CURVATURE': damping,
              'TURNING': damping, 'ROW_TURNING': damping, 'FIRST': damping, 'MEMORY': damping,
              'WELL_CONDITIONED': min_norm, 'ROW_DAMPING': bounded_hierarchy, 'TOLERANCES': qp,
              'EXACT': qp}
    assert set(compiled.core.CONSTANTS) == set(places)
    for name, value in compiled.core.CONSTANTS.items():
        assert np.array_equal(getattr(places[name], name), value), name


def raw(core, levels, lower=None, upper=None, memory=(), n=None):
    """Return what the core itself answers."""
    n = levels[0].J.shape[1] if n is None else n
    return core.solve(levels, lower, upper, 0.01, None, memory, np.empty(n))


@pytest.mark.parametrize('excess', [0.9, 1.1])
def test_core_takes_the_fast_path_where_no_bound_is_in_the_way(excess):
    levels = check_levels([(np.eye(3)[:1], [excess])])
    bounds = -np.ones(3), np.ones(3)
    memory, steps, slowed = raw(compiled.core_for(3, Damping(), None, 'redistribute'), levels,
                                *bounds)
    assert (steps is None) == (excess < 1.0)
    assert (memory[0] == 0.0) == (excess < 1.0) and slowed == 1.0
    slowly = compiled.core_for(3, Damping(), None, 'redistribute', fast=False)
    assert raw(slowly, levels, *bounds)[1] is not None


def test_core_remembers_nothing_but_what_it_is_given():
    # Its memory is used again, by stacks of all sizes.
    for seed in range(40):
        levels, lower, upper, options, period, cap, memory = problem(seed, SETTINGS['default'])
        given = levels, lower, upper, options, period, cap, memory
        first = by_core(*given)
        for other in (levels[:1], [*levels, *levels], []):
            by_core(other, lower, upper, options, period, cap)
        again = by_core(*given)
        assert (first is None) == (again is None)
        if first is not None:
            assert first.velocity.tolist() == again.velocity.tolist()
            assert first.memory == again.memory


BAD = math.nan
UNUSABLE = [
    ([Level(np.array([[1.0, BAD]]), np.ones(1))], None, None),
    ([Level(np.array([[1.0, math.inf]]), np.ones(1))], None, None),
    ([Level(np.eye(2), np.array([1.0, BAD]))], None, None),
    ([Level(np.eye(2), np.ones(3))], None, None),
    ([Level(np.eye(3), np.ones(3))], None, None),
    ([Level(np.ones(2), np.ones(1))], None, None),
    ([Level(np.eye(2), np.ones((2, 1)))], None, None),
    ([Level(np.eye(2, dtype=int), np.ones(2))], None, None),
    ([Level(np.eye(2, dtype='>f8'), np.ones(2))], None, None),
    ([Level(np.eye(2, dtype=np.float32), np.ones(2))], None, None),
    ([Level([[1.0, 0.0]], [1.0])], None, None),
    ([Level(None, None)], None, None),
    ([Level(np.eye(2), np.ones(2), mode=None)], None, None),
    ([Level(np.eye(2), lower=np.ones(2))], None, None),
    ([Level(np.eye(2), lower=np.ones(2), upper=np.zeros(2))], None, None),
    ([Level(np.eye(2), lower=np.full(2, BAD), upper=np.zeros(2))], None, None),
    ([Level(np.eye(3)[:2], np.ones(2), is_identity=True)], None, None),
    ([Level(np.eye(2), np.ones(2), is_identity=np.ones(2))], None, None),
    ([Level(np.eye(2), np.ones(2))], np.ones(2), -np.ones(2)),
    ([Level(np.eye(2), np.ones(2))], np.full(2, BAD), np.ones(2)),
    ([Level(np.eye(2), np.ones(2))], np.ones(3), np.ones(3)),
    ([Level(np.eye(2), np.ones(2))], [-1.0, -1.0], [1.0, 1.0]),
    ([object()], None, None),
    ((), None, None),
    (None, None, None)]


@pytest.mark.parametrize('levels, lower, upper', UNUSABLE)
def test_core_leaves_what_it_cannot_use_to_the_solver_in_python(levels, lower, upper):
    core = compiled.core_for(2, Damping(), None, 'redistribute')
    assert raw(core, levels, lower, upper, n=2) is None
    # It is none the worse for it.
    assert raw(core, [Level(np.eye(2), np.ones(2))]) is not None


@pytest.mark.parametrize('memory', [None, (BAD,), ('1',), [0.0]])
def test_core_leaves_a_memory_that_is_none_to_the_solver_in_python(memory):
    core = compiled.core_for(2, Damping(), None, 'uniform')
    assert raw(core, [Level(np.eye(2), np.ones(2))], memory=memory) is None


def test_core_reads_arrays_however_they_lie_in_memory():
    rng = np.random.default_rng(3)
    J, v = rng.standard_normal((3, 7)), rng.standard_normal(3)
    expected = solve([(J, v)]).velocity
    wide, doubled = np.zeros((6, 14)), np.zeros(6)
    wide[::2, ::2], doubled[::2] = J, v
    backwards = J[::-1, ::-1].copy()[::-1, ::-1], v[::-1].copy()[::-1]
    for given in ((np.asfortranarray(J), v), (wide[::2, ::2], doubled[::2]), backwards):
        assert solve([given]).velocity.tolist() == expected.tolist()


def test_what_the_core_cannot_solve_is_solved_all_the_same_and_counted():
    before = compiled.left_to_the_reference()
    with pytest.raises(SolverError, match='not finite'):
        solve_cycle([Level(np.array([[BAD, 1.0]]), np.ones(1))], None, None, Options(2), 0.0)
    # The solver in Python takes whole numbers.
    found = solve_cycle([Level(np.eye(2, dtype=int), np.ones(2))], None, None, Options(2), 0.0)
    assert found.velocity.tolist() == [1.0, 1.0]
    assert compiled.left_to_the_reference() == before + 2


class Nested:
    """A level whose demand is computed with the very core that reads it."""

    J, mode, is_identity = np.eye(2), 'least_squares', False

    def __init__(self, core):
        self.core, self.answer = core, 'none yet'

    @property
    def v(self):
        self.answer = raw(self.core, [Level(np.eye(2), np.zeros(2))])
        return np.ones(2)


def test_core_is_not_confused_by_a_level_that_uses_it():
    core = compiled.core_for(2, Damping(), None, 'redistribute')
    nested = Nested(core)
    x = np.empty(2)
    assert core.solve([nested], None, None, 0.0, None, (), x) is not None
    assert nested.answer is None and x.tolist() == [1.0, 1.0]


@pytest.mark.parametrize('given', [
    (0, 0.0, 0.0, 0.0, 0.0, None, True, True), (2, 0.0, 0.0, 0.0, 0.0, np.ones(3), True, True),
    (2, 0.0, 0.0, 0.0, 0.0, 'ab', True, True)])
def test_core_refuses_options_that_do_not_fit(given):
    with pytest.raises(ValueError, match='needs joints'):
        compiled.core.Solver(*given)


def test_core_needs_all_its_arguments():
    with pytest.raises(TypeError, match='levels, lower'):
        compiled.core_for(2, Damping(), None, 'uniform').solve([])
    with pytest.raises(TypeError):
        compiled.core.Solver(2)


# Which solver runs

@pytest.mark.solvers('python')
def test_solver_is_chosen_by_name(monkeypatch):
    assert compiled.load('python') is None
    assert compiled.running() == 'python'
    with pytest.raises(SolverError, match="unknown solver 'compield'.*mean 'compiled'"):
        compiled.load('compield')
    # As if it had not been built.
    monkeypatch.setitem(sys.modules, 'tp_controller.solver.core', None)
    assert compiled.load('') is None
    with pytest.raises(SolverError, match='TP_CONTROLLER_SOLVER is compiled, but'):
        compiled.load('compiled')


def test_core_runs_where_it_was_built():
    assert compiled.load('') is compiled.load('compiled') is compiled.core
    assert compiled.running() == 'compiled'


@pytest.mark.solvers('python')
@pytest.mark.skipif(not any(map(shutil.which, ('c++', 'g++', 'clang++'))), reason='no compiler')
def test_core_was_built_where_there_is_a_compiler():
    assert compiled.load('compiled').Solver

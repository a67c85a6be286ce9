# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The compiled core gives the answers of the solver in Python, and says so when it cannot."""

from collections import Counter
import copy
import ctypes
import math
import os
import pickle
import shutil
import subprocess
import sys
import tracemalloc
from types import SimpleNamespace

import numpy as np
from problems import masked_cycle, OPTIONS, random_cycle, redistribute
import pytest
from reference import random_levels
from tp_controller import Level, solve, SolverError
from tp_controller.core.sources import digest
from tp_controller.solver import (
    compiled,
)
from tp_controller.solver.damping import Damping
from tp_controller.solver.level import check_levels
from tp_controller.solver.solve import PrioritySolver, solve_by_reference, solve_cycle

# A long run: TP_CONTROLLER_PROBLEMS=10000 make test PYTEST_FLAGS="test/unit/solver -k compiled"
PROBLEMS = int(os.environ.get('TP_CONTROLLER_PROBLEMS', '1500'))
pytestmark = pytest.mark.solvers('compiled')


def by_core(levels, lower, upper, options, period=0.0, cap=None, memory=()):
    """Return what the compiled core makes of a cycle; None where it leaves it to the other."""
    return compiled.solve_by_core(options.core, options.n, levels, lower, upper, period, cap,
                                  memory)


@pytest.mark.parametrize('settings', OPTIONS)
@pytest.mark.parametrize('cycle', [random_cycle, masked_cycle])
@pytest.mark.slow
def test_core_gives_the_velocities_of_the_solver_in_python(cycle, settings):
    counted = Counter()
    for seed in range(PROBLEMS):
        given = cycle(seed, OPTIONS[settings])
        expected, found = solve_by_reference(*given), by_core(*given)
        counted['left'] += found is None
        if found is not None:
            off = np.abs(found.velocity - expected.velocity).max(initial=0.0)
            counted['off'] += off > 1e-9
            counted['far off'] += off > 1e-6
            compare_steps(given, expected, found, counted)
            check_bounds_are_met_exactly(given, found)
    # A polytope that is all but a point is as large as rounding says.
    assert counted['off'] <= PROBLEMS // 100, counted
    assert counted['far off'] <= PROBLEMS // 5000, counted
    assert counted['left'] <= PROBLEMS // 100, counted
    # Where more bounds meet than are needed, any of them may have the multipliers.
    assert counted['other multipliers'] <= PROBLEMS // 20, counted


def compare_steps(given, expected, found, counted):
    """Compare what is unique in how the levels were carried out."""
    n, same = given[3].n, True
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
        assert (one.origin is None) == (other.origin is None)
        if one.origin is not None:
            np.testing.assert_allclose(other.origin, one.origin, rtol=0, atol=1e-6)
        assert other.velocity.shape == (n,)
        for mine, yours in ((one.multipliers, other.multipliers),
                            (one.row_multipliers, other.row_multipliers)):
            same = same and agree(mine, yours)
        # What follows from multipliers is the same where they are.
        if same:
            assert other.bend == pytest.approx(one.bend, rel=1e-5, abs=1e-5)
            assert np.allclose(other.followed, one.followed, atol=1e-6)
    counted['other multipliers'] += not same
    if same:
        assert found.memory == pytest.approx(expected.memory, rel=1e-5, abs=1e-5)


def check_bounds_are_met_exactly(given, found):
    """Check that joints that push against their bounds are at them, to the last digit."""
    _, lower, upper, options, _, cap, _ = given
    if lower is None or cap is not None or options.scaling == 'uniform':
        return
    for step in found.steps:
        if step.multipliers is not None:
            assert (step.velocity == upper)[step.multipliers > 1e-6].all()
            assert (step.velocity == lower)[step.multipliers < -1e-6].all()


def agree(one, other):
    """Say whether multipliers are the same, but for digits of the largest."""
    if one is None or other is None:
        return one is other
    assert one.shape == other.shape
    return np.allclose(one, other, atol=1e-6 * np.abs(one).max(initial=1.0))


@pytest.mark.parametrize('seed', [2, 694, 1439])
def test_core_keeps_priorities_where_a_demand_is_far_beyond_the_bounds(seed):
    rng = np.random.default_rng(seed)
    (J, v), _ = random_levels(rng, 6, [2, 2])
    # What the first level leaves of the second has singular values of 1e-7.
    near = J + 1e-7 * rng.standard_normal(J.shape), v + rng.standard_normal(2)
    upper = rng.uniform(0.05, 1.0, 6)
    before = compiled.left_to_the_reference()
    alone, both = (redistribute(levels, -upper, upper).steps[-1].velocity
                   for levels in ([(J, v)], [(J, v), near]))
    assert compiled.left_to_the_reference() == before
    np.testing.assert_allclose(J @ both, J @ alone, rtol=0, atol=1e-10)


@pytest.mark.parametrize('share', [1e-8, 1e-9])
def test_core_does_not_overlook_the_bound_of_a_joint_that_hardly_moves(share):
    # Joint 2 has to move with joint 1, by that share, and ends at 1e-4.
    levels = [(np.array([[share, 1.0]]), [0.0]), (np.eye(2)[:1], [1e6])]
    velocity = redistribute(levels, [-1e7, -1e-4], [1e7, 1e-4]).velocity
    np.testing.assert_allclose(velocity, [1e-4 / share, -1e-4], rtol=1e-6)


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
        levels, lower, upper, options, period, cap, memory = random_cycle(seed, OPTIONS['default'])
        given = levels, lower, upper, options, period, cap, memory
        first = by_core(*given)
        for other in (levels[:1], [*levels, *levels], []):
            by_core(other, lower, upper, options, period, cap)
        again = by_core(*given)
        assert (first is None) == (again is None)
        if first is not None:
            assert first.velocity.tolist() == again.velocity.tolist()
            assert first.memory == again.memory


of_linux = pytest.mark.skipif(not os.path.exists('/proc/self/statm'),
                              reason='the size of a process is read there')
# Where the core is compiled with the address sanitizer.
sanitizer = getattr(ctypes.CDLL(None), '__sanitizer_get_current_allocated_bytes', None)


def allocated():
    """Return how much memory is in use [kB]."""
    if sanitizer is None:
        with open('/proc/self/statm') as file:
            return int(file.read().split()[1]) * os.sysconf('SC_PAGESIZE') // 1024
    # It keeps what was freed, to notice who still reads that: the process does not shrink.
    sanitizer.restype = ctypes.c_size_t
    return sanitizer() // 1024


@pytest.mark.slow
@of_linux
def test_core_takes_no_more_memory_from_cycle_to_cycle():
    rng = np.random.default_rng(1)
    levels = check_levels([(rng.standard_normal((6, 20)), 9.0 * np.ones(6)),
                           (np.eye(20), np.ones(20))])
    core, bounds = compiled.core_for(20, Damping(), None, 'redistribute'), np.full(20, 0.1)
    for _ in range(10):
        raw(core, levels, -bounds, bounds)
    before = allocated()
    for _ in range(2000):
        assert raw(core, levels, -bounds, bounds)[1] is not None
    # A cycle takes 60.
    assert allocated() - before < 20_000
    # So does a solver, with its memory.
    for _ in range(2000):
        raw(compiled.core_for(20, Damping(), None, 'redistribute'), levels, -bounds, bounds)
    assert allocated() - before < 20_000


def test_core_gives_back_all_objects_that_it_is_given_or_makes():
    J, v, weights = np.ones((1, 2)), np.ones(1), np.ones(2)
    lower, upper, cap, x = np.zeros(2), np.full(2, 0.1), np.full(2, 0.2), np.empty(2)
    usable = [Level(J, v), Level(J, lower=-v, upper=v)]
    strange = Level(J, np.ones(3)), Level(J.astype(int), v), Level(J, v, mode=None), object()
    memory, period = (math.pi, math.e), math.tau
    objects = (J, v, weights, lower, upper, cap, x, memory, period, usable, *usable, *strange,
               *memory, compiled.core.Solver)

    def use():
        core = compiled.core_for(2, Damping(0.1, 0.1), weights, 'redistribute')
        for levels, fitting in ((usable, x), *(([each], x) for each in strange), (usable, v),
                                (usable, lower[::-1]), (usable, None)):
            core.solve(levels, lower, upper, period, cap, memory, fitting)
            core.solve(levels, upper, lower, period, v, memory, fitting)
            core.solve(levels, None, None, 'now', None, None, fitting)
        with pytest.raises(ValueError, match='needs joints'):
            compiled.core.Solver(3, 0.0, 0.0, 0.0, 0.0, weights, True, True)
        return core.solve(usable, lower, upper, period, cap, memory, x)
    assert use()[1] is not None
    before = [sys.getrefcount(each) for each in objects]
    for _ in range(3):
        use()
    assert [sys.getrefcount(each) for each in objects] == before
    # What it makes: memory, and the record of the steps.
    core = compiled.core_for(2, Damping(0.1, 0.1), weights, 'redistribute')
    tracemalloc.start()
    try:
        for cycle in range(600):
            if cycle == 100:
                before = tracemalloc.get_traced_memory()[0]
            assert core.solve(usable, lower, upper, period, cap, memory, x)[1] is not None
            compiled.core_for(2, Damping(0.1, 0.1), weights, 'redistribute')
        # [B]; each number of a memory has 24.
        assert tracemalloc.get_traced_memory()[0] - before < 2000
    finally:
        tracemalloc.stop()


SHORT_OF_MEMORY = """
import resource
import numpy as np
from tp_controller import Level
from tp_controller.solver import compiled
from tp_controller.solver.damping import Damping

n, rng = 300, np.random.default_rng(0)
levels = [Level(rng.standard_normal((50, n)), np.ones(50)) for _ in range(4)]


def velocity(core):
    found = np.empty(n)
    return None if core.solve(levels, None, None, 0.0, None, (), found) is None else found


def make():
    return compiled.core_for(n, Damping(), None, 'redistribute', fast=False)


core, failed = make(), 0
with open('/proc/self/statm') as file:
    size = int(file.read().split()[0]) * resource.getpagesize()
for more in range(30):
    resource.setrlimit(resource.RLIMIT_AS, (size + more * 2 ** 17, -1))
    failed += velocity(core) is None
resource.setrlimit(resource.RLIMIT_AS, (-1, -1))
assert failed > 0
for _ in range(3):
    assert np.array_equal(velocity(core), velocity(make()))
"""


@pytest.mark.slow
@of_linux
@pytest.mark.skipif(sanitizer is not None, reason='reserves more than any limit would allow')
def test_core_that_was_short_of_memory_is_none_the_worse_for_it():
    found = subprocess.run([sys.executable, '-c', SHORT_OF_MEMORY], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr


def test_more_joints_or_rows_than_the_core_takes_are_left_to_the_solver_in_python():
    J = np.eye(compiled.MOST + 1)
    assert compiled.core_for(len(J), Damping(), None, 'redistribute') is None
    assert solve([(J[:1], [1.0])]).velocity.tolist() == J[0].tolist()
    # One row, again and again.
    before = compiled.left_to_the_reference()
    assert solve([(J[:, :1], J[0] * 0.0)]).velocity.tolist() == [0.0]
    assert compiled.left_to_the_reference() == before + 1


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


def garbage(rng, *shape):
    """Return an array of numbers of all sizes, and of what is none."""
    numbers = rng.standard_normal(shape)
    strange = rng.choice([0.0, 1e-308, 1e-160, 1e-12, 1e8, 1e100, 1e160, 1e308, BAD, math.inf,
                          -math.inf, -1e100], shape)
    array = np.where(rng.random(shape) < rng.choice([0.0, 0.02, 0.3]), strange, numbers)
    return array[::-1] if rng.random() < 0.1 else array


def strange_cycle(seed):
    """Return the number of joints and levels, bounds and more, of shapes that may not fit."""
    rng = np.random.default_rng(seed)
    n, levels = int(rng.choice([1, 2, 3, 7, 20])), []

    def size(usual):
        return int(rng.integers(0, 5)) if rng.random() < 0.02 else usual
    for _ in range(rng.integers(0, 5)):
        m = int(rng.integers(0, n + 3))
        J = garbage(rng, size(m), size(n))
        if rng.random() < 0.3:
            edges = np.sort([garbage(rng, m), garbage(rng, m)], axis=0)
            levels.append(Level(J, lower=edges[0], upper=edges[1]))
        elif rng.random() < 0.2:
            levels.append(Level.of_joints(garbage(rng, n)))
        else:
            levels.append(Level(J, garbage(rng, size(m)), str(rng.choice(['scale', '']))))
    lower, upper = -np.abs(garbage(rng, size(n))), np.abs(garbage(rng, size(n)))
    cap = np.abs(garbage(rng, n)) if rng.random() < 0.3 else None
    return n, levels, lower, upper, float(np.abs(garbage(rng, 1))[0]), cap, tuple(
        np.abs(garbage(rng, int(rng.integers(0, 7)))).tolist())


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.slow
def test_core_survives_all_shapes_and_numbers(scaling):
    cores, answered = {}, 0
    for seed in range(4 * PROBLEMS):
        n, levels, lower, upper, period, cap, memory = strange_cycle(seed)
        options = (Damping(0.1, 0.1, 0.02, 0.02), Damping())[seed % 2]
        core = cores.setdefault((n, seed % 2), compiled.core_for(n, options, None, scaling))
        x = np.empty(n)
        found = core.solve(levels, lower, upper, period, cap, memory, x)
        if found is not None:
            answered += 1
            assert np.isfinite(x).all() and (lower <= x).all() and (x <= upper).all()
            if found[1] is not None:
                record = compiled.Record(found[1], n, len(levels))
                found = [record.step(index).bend for index in range(len(levels))]
                assert np.array_equal(found, record.bends(), equal_nan=True)
    assert answered > PROBLEMS


@pytest.mark.parametrize('velocity', [np.empty(1), np.empty(3), np.empty(2, dtype=int),
                                      np.empty((2, 1)), [0.0, 0.0], b'ab', None])
def test_core_writes_to_nothing_but_an_array_of_the_right_size(velocity):
    core = compiled.core_for(2, Damping(), None, 'uniform')
    level = Level(np.eye(2), np.ones(2))
    assert core.solve([level], None, None, 0.0, None, (), velocity) is None
    locked = np.empty(2)
    locked.setflags(write=False)
    assert core.solve([level], None, None, 0.0, None, (), locked) is None


@pytest.mark.parametrize('memory', [None, (BAD,), ('1',), [0.0]])
def test_core_leaves_a_memory_that_is_none_to_the_solver_in_python(memory):
    core = compiled.core_for(2, Damping(), None, 'uniform')
    assert raw(core, [Level(np.eye(2), np.ones(2))], memory=memory) is None


def test_core_reads_and_writes_arrays_however_they_lie_in_memory():
    rng = np.random.default_rng(3)
    J, v = rng.standard_normal((3, 7)), rng.standard_normal(3)
    expected = solve([(J, v)]).velocity
    wide, doubled = np.zeros((6, 14)), np.zeros(6)
    wide[::2, ::2], doubled[::2] = J, v
    backwards = J[::-1, ::-1].copy()[::-1, ::-1], v[::-1].copy()[::-1]
    for given in ((np.asfortranarray(J), v), (wide[::2, ::2], doubled[::2]), backwards):
        assert solve([given]).velocity.tolist() == expected.tolist()
    # So it writes.
    x = np.zeros(14)
    core = compiled.core_for(7, Damping(), None, 'uniform')
    assert core.solve([Level(J, v)], None, None, 0.0, None, (), x[::2]) is not None
    assert x[::2].tolist() == expected.tolist() and not x[1::2].any()


def test_what_the_core_cannot_solve_is_solved_all_the_same_and_counted():
    before = compiled.left_to_the_reference()
    with pytest.raises(SolverError, match='not finite'):
        solve_cycle([Level(np.array([[BAD, 1.0]]), np.ones(1))], None, None, PrioritySolver(2),
                    0.0)
    # The solver in Python takes whole numbers.
    found = solve_cycle([Level(np.eye(2, dtype=int), np.ones(2))], None, None, PrioritySolver(2),
                        0.0)
    assert found.velocity.tolist() == [1.0, 1.0]
    assert compiled.left_to_the_reference() == before + 2


def test_options_can_be_copied_and_stored_whatever_they_have_solved():
    options = PrioritySolver(2, Damping(0.1, 0.1), np.array([1.0, 2.0]), 'redistribute')
    levels = check_levels([([[1.0, 1.0]], [1.0])])
    expected = solve_cycle(levels, None, None, options, 0.0).velocity.tolist()
    for other in (copy.copy(options), copy.deepcopy(options), pickle.loads(pickle.dumps(options))):
        assert other.core is not options.core
        assert solve_cycle(levels, None, None, other, 0.0).velocity.tolist() == expected


class Nested:
    """A level whose demand is computed with the very core that reads it."""

    J, mode, is_identity = np.eye(2), 'least_squares', False
    joints = weights = None

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


class Last:
    """A level that nobody holds any more while it is read."""

    def __init__(self, levels):
        self.v, self.mode, self.is_identity = np.ones(2), 'least_squares', False
        self.joints = self.weights = None
        self._levels = levels
        levels.append(self)

    @property
    def J(self):
        self._levels.clear()
        return np.eye(2)


def test_core_holds_the_level_that_it_reads():
    core, levels, x = compiled.core_for(2, Damping(), None, 'redistribute'), [], np.empty(2)
    Last(levels)
    assert core.solve(levels, None, None, 0.0, None, (), x) is not None
    assert levels == [] and x.tolist() == [1.0, 1.0]


@pytest.mark.parametrize('cap', [-np.ones(2), np.full(2, BAD), np.ones(3), [1.0, 1.0]])
def test_core_leaves_a_cap_that_is_none_to_the_solver_in_python(cap):
    core = compiled.core_for(2, Damping(), None, 'redistribute')
    level, x = Level(np.eye(2), np.ones(2)), np.empty(2)
    assert core.solve([level], None, None, 0.0, np.ones(2), (), x) is not None
    assert core.solve([level], None, None, 0.0, cap, (), x) is None


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
    monkeypatch.setitem(sys.modules, 'tp_controller.core.extension', None)
    assert compiled.load('') is None
    with pytest.raises(SolverError, match='TP_CONTROLLER_SOLVER is compiled, but'):
        compiled.load('compiled')


@pytest.mark.solvers('python')
@pytest.mark.parametrize(('chosen', 'told'), [('', True), ('python', False)])
def test_a_missing_core_is_reported_unless_the_reference_was_chosen(monkeypatch, chosen, told):
    monkeypatch.setenv(compiled.VARIABLE, chosen)
    assert ('install a C++ compiler' in compiled.fallback_reason()) is told


@pytest.mark.solvers('python')
@pytest.mark.parametrize('older', [SimpleNamespace(SOURCES=1), SimpleNamespace()])
def test_an_outdated_core_is_not_loaded(monkeypatch, older):
    monkeypatch.delenv(compiled.VARIABLE, raising=False)
    monkeypatch.setitem(sys.modules, 'tp_controller.core.extension', older)
    assert compiled.load('') is None
    assert 'built from other sources' in compiled.fallback_reason()
    with pytest.raises(SolverError, match='built from other sources.*install the package again'):
        compiled.load('compiled')


def test_every_file_counts_in_the_digest_of_the_sources(tmp_path):
    assert digest(tmp_path) == 0
    found = set()
    for name, text in (('a.h', 'x'), ('b.cpp', 'y'), ('b.cpp', 'z'), ('c.h', '')):
        (tmp_path / name).write_text(text)
        found.add(digest(tmp_path))
    (tmp_path / 'c.h').rename(tmp_path / 'd.h')
    assert len(found | {digest(tmp_path)}) == 5


def test_a_core_that_runs_is_not_reported_as_missing(monkeypatch):
    monkeypatch.delenv(compiled.VARIABLE, raising=False)
    assert bool(compiled.fallback_reason()) is (compiled.running() == 'python')


def test_core_runs_where_it_was_built():
    assert compiled.load('') is compiled.load('compiled') is compiled.core
    assert compiled.running() == 'compiled'


@pytest.mark.solvers('python')
@pytest.mark.skipif(not any(map(shutil.which, ('c++', 'g++', 'clang++'))), reason='no compiler')
def test_core_was_built_where_there_is_a_compiler():
    assert compiled.load('compiled').Solver

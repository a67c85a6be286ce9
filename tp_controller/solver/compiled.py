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

"""
Choice of the solver: the compiled core where it was built, else the reference in Python.

The core does what `tp_controller.solver.solve.solve_cycle` does, in one call. What it cannot solve
it leaves to the reference, which is counted. The environment variable ``TP_CONTROLLER_SOLVER``
chooses: ``python``, or ``compiled``, which fails where there is no core.
"""

from functools import cached_property
from importlib import import_module
import os
from struct import Struct
from types import ModuleType
from typing import Protocol

import numpy as np
from tp_controller.solver.bounded_hierarchy import LevelStep
from tp_controller.solver.damping import Damping, Memory
from tp_controller.solver.errors import SolverError, unknown
from tp_controller.solver.level import Array, Level
from tp_controller.solver.null_space import Directions
from tp_controller.solver.solution import Solution

VARIABLE = 'TP_CONTROLLER_SOLVER'
SOLVERS = ('compiled', 'python')
# More joints, or rows of a level, are left to the reference; as in python_buffers.h.
MOST = 1000
# Numbers before the arrays of a step.
HEAD = Struct('8d')


class Core(Protocol):
    """What a solver of the compiled core does; it keeps its memory from cycle to cycle."""

    def solve(self, levels: list[Level], lower: Array | None, upper: Array | None, period: float,
              speed_cap: Array | None, memory: Memory,
              velocity: Array) -> tuple[Memory, bytes | None, float] | None:
        """Fill in velocities (n,); return what `solve` makes of it, None for the reference."""


def load(wanted: str) -> ModuleType | None:
    """
    Return the compiled core; None for the reference.

    Parameters
    ----------
    wanted : str
        One of `SOLVERS`; empty: the core where it was built.

    Raises
    ------
    SolverError
        There is no such solver, or the core is wanted and was not built.

    """
    if wanted and wanted not in SOLVERS:
        raise SolverError(f'{VARIABLE}: {unknown("solver", wanted, SOLVERS)}')
    if wanted == 'python':
        return None
    try:
        return import_module('tp_controller.core.extension')
    except ImportError as error:
        if wanted:
            raise SolverError(f'{VARIABLE} is {wanted}, but the core was not built: install the '
                              f'package again where there is a C++ compiler ({error})') from error
        return None


core = load(os.environ.get(VARIABLE, ''))
_left = 0


def running() -> str:
    """Return which solver runs, one of `SOLVERS`."""
    return 'python' if core is None else 'compiled'


def fallback_reason() -> str:
    """Return why the reference runs although nobody chose it; empty if it does not."""
    if core is not None or os.environ.get(VARIABLE):
        return ''
    return ('the compiled core is missing, so the solver in Python runs, 3 to 9 times as slow; '
            f'install a C++ compiler, then this package again ({VARIABLE}=python accepts it)')


def left_to_the_reference() -> int:
    """Return how many cycles the compiled core could not solve, since the package was loaded."""
    return _left


def core_for(n: int, damping: Damping, weights: Array | None, scaling: str,
             fast: bool = True) -> Core | None:
    """
    Return a solver of the core for options that were checked; None where it has none for them.

    With the fast path (`tp_controller.solver.min_norm`), or without.
    """
    if core is None or not 0 < n <= MOST:
        return None
    found: Core = core.Solver(n, damping.damping, damping.singular_region,
                              damping.release_region, damping.regularisation, weights,
                              scaling == 'uniform', fast)
    return found


def solve_by_core(solver: Core, n: int, levels: list[Level], lower: Array | None,
                  upper: Array | None, period: float, speed_cap: Array | None,
                  memory: Memory) -> Solution | None:
    """Return the `Solution` of one cycle; None where the reference has to solve it."""
    global _left
    x = np.empty(n)
    found = solver.solve(levels, lower, upper, period, speed_cap, memory, x)
    if found is None:
        _left += 1
        return None
    memory, record, slowed = found
    if record is None:
        return Solution(x, levels, memory)
    whole = np.frombuffer(record, count=n) if slowed < 1.0 else None
    return Solution(x, levels, memory, Record(record, n, len(levels)), whole, slowed)


class Record:
    """
    How each level was carried out, as solver_object.h wrote it down; see `Record` there.

    Parameters
    ----------
    record : bytes
        Doubles: the velocities before uniform scaling, h of each level, where the step of each
        level begins, then the steps.
    n, count : int
        Number of joints, and of levels.

    """

    def __init__(self, record: bytes, n: int, count: int) -> None:
        self._record, self._n, self._count = record, n, count
        self._found: dict[int, LevelStep] = {}

    @cached_property
    def _numbers(self) -> Array:
        """Return the doubles."""
        return np.frombuffer(self._record)

    def bends(self) -> list[float]:
        """Return `LevelStep.bend` of each level."""
        found: list[float] = self._numbers[self._n:self._n + self._count].tolist()
        return found

    def step(self, index: int) -> LevelStep:
        """Return the step of a level."""
        if index not in self._found:
            self._found[index] = self._read(int(self._numbers[self._n + self._count + index]))
        return self._found[index]

    def _read(self, begin: int) -> LevelStep:
        """Return the step that begins at a number."""
        *counts, size, bend = HEAD.unpack_from(self._record, 8 * begin)
        m, rank, k, left, has_multipliers, rows = map(int, counts)
        self._at = begin + len(counts) + 2
        n, take = self._n, self._take
        velocity, directions = take(n), None
        if m >= 0:
            directions = Directions(self._columns(m, rank), take(rank), self._columns(n, k), size)
        return LevelStep(velocity, directions, take(rank),
                         self._columns(n, left) if left >= 0 else None,
                         take(n) if has_multipliers else None,
                         take(rows) if rows >= 0 else None, bend)

    def _take(self, size: int) -> Array:
        """Return the numbers (size,) that are next."""
        begin = self._at
        self._at = begin + size
        return self._numbers[begin:self._at]

    def _columns(self, rows: int, columns: int) -> Array:
        """Return the matrix that is next, column by column."""
        return self._take(rows * columns).reshape(columns, rows).T

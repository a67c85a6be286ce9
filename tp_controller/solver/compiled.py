# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Choice of the solver: the compiled core if it was built, else the reference in Python.

The core computes `tp_controller.solver.solve.solve_cycle` in one call. Cycles that it cannot solve
fall back to the reference and are counted. The environment variable ``TP_CONTROLLER_SOLVER``
selects the solver: ``python``, or ``compiled``, which fails if there is no core.
"""

from functools import cached_property
from importlib import import_module
import os
from pathlib import Path
from struct import Struct
from types import ModuleType
from typing import Protocol

import numpy as np
from tp_controller.core.sources import digest
from tp_controller.solver.damping import Damping
from tp_controller.solver.errors import SolverError, unknown
from tp_controller.solver.level import Array, Level
from tp_controller.solver.null_space import Directions
from tp_controller.solver.solution import LevelStep, Memory, Solution

VARIABLE = 'TP_CONTROLLER_SOLVER'
SOLVERS = ('compiled', 'python')
# Largest number of joints, and of rows of a level, that the core solves (python_buffers.h).
MOST = 1000
# Numbers that precede the arrays of a step.
HEAD = Struct('9d')


class Core(Protocol):
    """Interface of a solver of the compiled core, whose buffers are reused in every cycle."""

    def solve(self, levels: list[Level], lower: Array | None, upper: Array | None, period: float,
              speed_cap: Array | None, memory: Memory,
              velocity: Array) -> tuple[Memory, bytes | None, float] | None:
        """Fill in velocities (n,); return memory, record and scale, None for the reference."""


def load(wanted: str) -> ModuleType | None:
    """
    Return the compiled core; None for the reference.

    Parameters
    ----------
    wanted : str
        One of `SOLVERS`; empty: the core if it was built.

    Raises
    ------
    SolverError
        The solver is unknown, or the core is requested and is missing or outdated.

    """
    if wanted and wanted not in SOLVERS:
        raise SolverError(f'{VARIABLE}: {unknown("solver", wanted, SOLVERS)}')
    if wanted == 'python':
        return None
    found, reason = _find()
    if wanted and reason:
        raise SolverError(f'{VARIABLE} is {wanted}, but {reason}: install the package again where '
                          'there is a C++ compiler')
    return found


def _find() -> tuple[ModuleType | None, str]:
    """Return the core, or None and why it cannot run."""
    try:
        found = import_module('tp_controller.core.extension')
    except ImportError as error:
        return None, f'the compiled core is missing ({error})'
    # An installed package has no sources.
    if digest(Path(__file__).parents[1] / 'core') not in (0, getattr(found, 'SOURCES', None)):
        return None, 'the compiled core was built from other sources than those beside it'
    return found, ''


core = load(os.environ.get(VARIABLE, ''))
_fallbacks = 0


def running() -> str:
    """Return the name of the running solver, one of `SOLVERS`."""
    return 'python' if core is None else 'compiled'


def fallback_reason() -> str:
    """Return the reason for running the reference without being selected; empty if none."""
    if core is not None or os.environ.get(VARIABLE):
        return ''
    return (f'{_find()[1]}, so the solver in Python runs, 3 to 9 times as slow; install a C++ '
            f'compiler, then this package again ({VARIABLE}=python accepts it)')


def left_to_the_reference() -> int:
    """Return the number of cycles that the core could not solve since the package was loaded."""
    return _fallbacks


def core_for(n: int, damping: Damping, weights: Array | None, scaling: str,
             fast: bool = True) -> Core | None:
    """
    Return a solver of the core for validated options; None if the core does not support them.

    `fast` enables the fast path (`tp_controller.solver.min_norm`).
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
    """Return the `Solution` of one cycle; None if the reference has to solve it."""
    global _fallbacks
    x = np.empty(n)
    found = solver.solve(levels, lower, upper, period, speed_cap, memory, x)
    if found is None:
        _fallbacks += 1
        return None
    memory, record, slowed = found
    if record is None:
        return Solution(x, levels, memory)
    whole = np.frombuffer(record, count=n)
    return Solution(x, levels, memory, Record(record, n, len(levels)), whole, slowed)


class Record:
    """
    Steps of the levels, read from the record that solver_object.h writes; see `Record` there.

    Parameters
    ----------
    record : bytes or memoryview
        Doubles: the velocities before uniform scaling, h of each level, the index at which the
        step of each level begins, then the steps.
    n, count : int
        Number of joints, and of levels.

    """

    def __init__(self, record: bytes | memoryview, n: int, count: int) -> None:
        self._record, self._n, self._count = record, n, count
        self._found: dict[int, LevelStep] = {}

    @cached_property
    def _numbers(self) -> Array:
        """Return the record as an array of doubles."""
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
        """Return the step that begins at an index of the doubles."""
        *counts, size, bend = HEAD.unpack_from(self._record, 8 * begin)
        m, rank, k, left, has_multipliers, rows, has_origin = map(int, counts)
        self._at = begin + len(counts) + 2
        n, take = self._n, self._take
        velocity, directions = take(n), None
        if m >= 0:
            directions = Directions(self._columns(m, rank), take(rank), self._columns(n, k), size)
        return LevelStep(velocity, directions, take(rank),
                         self._columns(n, left) if left >= 0 else None,
                         take(n) if has_multipliers else None,
                         take(rows) if rows >= 0 else None, bend,
                         take(n) if has_origin else None)

    def _take(self, size: int) -> Array:
        """Return the next numbers (size,)."""
        begin = self._at
        self._at = begin + size
        return self._numbers[begin:self._at]

    def _columns(self, rows: int, columns: int) -> Array:
        """Return the next matrix (rows, columns), stored column by column."""
        return self._take(rows * columns).reshape(columns, rows).T

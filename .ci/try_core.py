# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Load what is compiled, and solve one small problem with it and nothing but the standard library.

Run as ``python .ci/try_core.py FOLDER tp_controller/core/extension``, with what is compiled in an
unpacked wheel. The problem has three joints, the first of two levels at the limit of a
joint. Another joint has to do what that one cannot.
"""

from array import array
from importlib.util import module_from_spec, spec_from_file_location
import math
import platform
import sys
from types import SimpleNamespace


def doubles(*numbers):
    """Return numbers as the core reads them."""
    return memoryview(array('d', numbers))


def level(rows, v):
    """Return a level that demands v of J."""
    flat = doubles(*(number for row in rows for number in row))
    J = flat.cast('B').cast('d', (len(rows), len(rows[0])))
    return SimpleNamespace(J=J, v=doubles(*v), mode='least_squares', lower=None, upper=None,
                           joints=None, weights=None, is_identity=False)


def load(folder, name):
    """Return a compiled module."""
    spec = spec_from_file_location(name.replace('/', '.'), f'{folder}/{name}.abi3.so')
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(folder, *names):
    """Load all, and solve it."""
    modules = {name: load(folder, name) for name in names}
    core = modules['tp_controller/core/extension']
    solver = core.Solver(3, 0.0, math.inf, 0.0, 0.0, None, False, True)
    velocity = doubles(0.0, 0.0, 0.0)
    found = solver.solve(
        [level([[1.0, 1.0, 0.0]], [3.0]), level([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [0.0, 0.5])],
        doubles(-5.0, -2.0, -5.0), doubles(5.0, 2.0, 5.0), 0.0, None, (), velocity)
    assert found is not None and len(found[0]) == 2
    assert all(math.isclose(*pair, abs_tol=1e-12) for pair in zip(velocity, (1.0, 2.0, 0.5))), \
        list(velocity)
    print(f'{", ".join(modules)}: run on Python {sys.version.split()[0]}, {platform.machine()}')


if __name__ == '__main__':
    main(*sys.argv[1:])

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Runs the tests of this folder with the solver in Python and with the compiled core.

The marker `solvers` names the solvers that a test is for, where that is not both.
"""

import pytest
from tp_controller.solver import compiled


def pytest_generate_tests(metafunc):
    """Give every test the solvers that it is for."""
    marker = metafunc.definition.get_closest_marker('solvers')
    metafunc.parametrize('solver', marker.args if marker else compiled.SOLVERS, indirect=True)


@pytest.fixture(autouse=True)
def solver(request, monkeypatch):
    """Let one of the solvers run."""
    if request.param == 'python':
        monkeypatch.setattr(compiled, 'core', None)
    elif compiled.core is None:
        pytest.skip('the compiled core was not built')

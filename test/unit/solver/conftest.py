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

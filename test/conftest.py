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

"""Rules of all tests; puts this folder on the path, so that all can import `robots`."""

import os

from optional import pytest_pycollect_makemodule, pytest_runtest_call, pytest_runtest_setup

__all__ = ['pytest_pycollect_makemodule', 'pytest_runtest_call', 'pytest_runtest_setup']

# A film takes most of a minute; tests of one set this aside.
os.environ.setdefault('TP_CONTROLLER_FILM', 'none')

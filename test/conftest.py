# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Rules of all tests; puts this folder on the path, so that all can import `robots`."""

import os

from optional import pytest_pycollect_makemodule, pytest_runtest_call, pytest_runtest_setup

__all__ = ['pytest_pycollect_makemodule', 'pytest_runtest_call', 'pytest_runtest_setup']

# A film takes most of a minute; tests of one set this aside.
os.environ.setdefault('TP_CONTROLLER_FILM', 'none')

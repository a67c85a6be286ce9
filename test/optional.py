# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Optional packages: tests that need one that is not installed are skipped.

Some are on PyPI only, so a ROS machine lacks them.
"""

import pytest

# {module, or distribution: how to get it}
OPTIONAL = {
    **dict.fromkeys(['PIL', 'matplotlib'], "pip install '.[plots]'"),
    **dict.fromkeys(['msgspec', 'trimesh', 'viser', 'websockets', 'zstandard'],
                    "pip install '.[view]'"),
    'rosbags': "pip install '.[record]'",
    'example-robot-data': 'pip install example-robot-data'}


def skip_without(error):
    """Skip the test if an error is that an optional package is not installed."""
    name = error.name.partition('.')[0] if isinstance(error, ModuleNotFoundError) else None
    if name in OPTIONAL:
        pytest.skip(f'needs {name}: {OPTIONAL[name]}', allow_module_level=True)


class Module(pytest.Module):
    """Test module that is skipped if it imports an optional package that is not installed."""

    def collect(self):
        """Return the tests of the module."""
        try:
            return super().collect()
        except self.CollectError as error:
            skip_without(error.__cause__)
            raise


def pytest_pycollect_makemodule(module_path, parent):
    """Return the collector of a test module."""
    return Module.from_parent(parent, path=module_path)


def _skipping(item):
    """Run a phase of a test; skip the test if it lacks an optional package."""
    outcome = yield
    if outcome.excinfo:
        try:
            skip_without(outcome.excinfo[1])
        except pytest.skip.Exception as skipped:
            outcome.force_exception(skipped)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_setup(item):
    """Run the fixtures of a test."""
    yield from _skipping(item)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item):
    """Run a test."""
    yield from _skipping(item)

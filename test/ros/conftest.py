# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of the node tests; without ROS no test of this folder is collected."""

from importlib.util import find_spec
import warnings

import pytest

if find_spec('rclpy') is None:
    collect_ignore_glob = ['*test_*.py']
else:
    with warnings.catch_warnings():
        # The generator of the messages' Python code, loaded with the first of them, has a
        # dependency that uses a deprecated module of the standard library.
        warnings.filterwarnings('ignore', "module 'sre_", DeprecationWarning)
        import rosidl_generator_py  # noqa: F401
    from harness import Harness
    from rclpy.executors import SingleThreadedExecutor
    from tp_controller.ros import controller_node
    from tp_controller.ros.log import Log
    from tp_controller.ros.runner import make_executor


@pytest.fixture(autouse=True)
def alone(monkeypatch, tmp_path):
    """Keep the nodes of a test from being heard by any other process."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))


@pytest.fixture
def harness(alone):
    """Return the harness, with the executor that the nodes use."""
    harness = Harness(make_executor)
    yield harness
    harness.close()


@pytest.fixture(params=['events', 'standard'])
def any_harness(alone, request):
    """Return a harness, once with each executor."""
    harness = Harness(make_executor if request.param == 'events' else standard_executor)
    yield harness
    harness.close()


def standard_executor(context):
    """Return the executor that every rclpy has."""
    return SingleThreadedExecutor(context=context)


@pytest.fixture
def log(capfd, monkeypatch):
    """Return a function that returns all that was logged since the last time, and is due."""
    logs = []

    class Kept(Log):

        def __init__(self, logger):
            super().__init__(logger)
            logs.append(self)

    def read():
        for each in logs:
            each.flush()
        return capfd.readouterr().err

    monkeypatch.setattr(controller_node, 'Log', Kept)
    return read

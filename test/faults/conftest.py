# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Fixtures of the tests with faults; without ROS none of this folder is collected."""

from importlib.util import find_spec
from pathlib import Path
import sys
import warnings

# The harnesses of nodes and processes are shared with their tests.
sys.path[:0] = [str(Path(__file__).resolve().parents[1] / folder) for folder in ('ros', 'system')]

if find_spec('rclpy') is None:
    collect_ignore_glob = ['test_*.py']
else:
    with warnings.catch_warnings():
        # The generator of the messages' Python code, loaded with the first of them, has a
        # dependency that uses a deprecated module of the standard library.
        warnings.filterwarnings('ignore', "module 'sre_", DeprecationWarning)
        import rosidl_generator_py  # noqa: F401
    from processes_harness import domain, environment, listener, start
    __all__ = ['domain', 'environment', 'listener', 'start']

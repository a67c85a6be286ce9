# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The tests are collected and run where a package that is on PyPI only is not installed."""

import os
import subprocess
import sys

import pytest
from robots import REPOSITORY

# Python imports a module of this name when it starts: this one hides a package, and its metadata.
HIDING = """
from importlib.machinery import PathFinder
import sys


class Hiding(PathFinder):

    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition('.')[0] == {module!r}:
            return None
        return super().find_spec(name, path, target)

    @classmethod
    def find_distributions(cls, *context):
        for found in super().find_distributions(*context):
            if found.metadata['Name'].replace('-', '_') != {module!r}:
                yield found


sys.meta_path[:] = [Hiding if each is PathFinder else each for each in sys.meta_path]
"""
# A few quick modules, some of which need one of the packages.
QUICK = 'test_series or test_history or test_plots.py or test_center_of_mass'


@pytest.mark.parametrize(('module', 'skipped'), [
    ('rosbags', 'needs rosbags'), ('viser', 'needs viser'), ('playwright', ''),
    ('example_robot_data', 'needs example-robot-data')])
def test_all_tests_are_collected_and_some_are_run_without_a_package(tmp_path, module, skipped):
    (tmp_path / 'sitecustomize.py').write_text(HIDING.format(module=module), encoding='utf-8')
    path = os.pathsep.join([str(tmp_path), str(REPOSITORY), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-rs', '-k', QUICK, 'test'],
        cwd=REPOSITORY, env={**os.environ, 'PYTHONPATH': path.rstrip(os.pathsep)},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600)
    assert done.returncode == 0, done.stdout
    assert ' passed' in done.stdout and skipped in done.stdout

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Commands that install optional packages are exact."""

from importlib import metadata
import shlex
import sys

from tp_controller.tools import extras


def test_command_names_this_python_and_the_packages_of_the_extra(monkeypatch):
    monkeypatch.setattr(extras, 'requires', lambda name: [
        'numpy', 'rosbags<0.12,>=0.11; extra == "record"', 'viser<2,>=1; extra == "view"',
        "embodik; python_version < '3.13' and extra == 'peers'"])
    assert shlex.split(extras.install_command('record')) == [
        sys.executable, '-m', 'pip', 'install', 'rosbags<0.12,>=0.11']
    assert extras.install_command('peers').endswith(' install embodik')


def test_command_is_for_the_folder_of_the_sources_where_nothing_is_installed(monkeypatch):
    def absent(name):
        raise metadata.PackageNotFoundError(name)
    monkeypatch.setattr(extras, 'requires', absent)
    assert shlex.split(extras.install_command('view'))[2:] == ['pip', 'install', '.[view]']

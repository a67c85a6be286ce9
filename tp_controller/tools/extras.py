# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Installation commands of the extras."""

from importlib.metadata import PackageNotFoundError, requires
import shlex
import sys


def install_command(extra: str) -> str:
    """
    Return the shell command that installs the packages of an extra.

    It contains this Python and the packages, so it works in every folder and environment.

    Parameters
    ----------
    extra : str
        Extra of setup.py.

    Returns
    -------
    str
        The command; one for the source folder if this package is not installed.

    """
    try:
        entries = [entry.partition(';') for entry in requires('tp_controller') or ()]
    except PackageNotFoundError:
        entries = []
    packages = [package.strip() for package, _, marker in entries
                if f'extra == "{extra}"' in marker.replace("'", '"')]
    return shlex.join([sys.executable, '-m', 'pip', 'install', *(packages or [f'.[{extra}]'])])

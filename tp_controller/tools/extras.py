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

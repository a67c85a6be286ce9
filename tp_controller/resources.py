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

"""Files by name: paths, ``package://`` names, and text given in place of a file."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import Any

from tp_controller.solver.errors import suggestion
import yaml

PACKAGE = 'tp_controller'
SCHEME = 'package://'


def package_share(package: str = PACKAGE) -> Path:
    """
    Return the share directory of a ROS package.

    The ament index is asked first; this package's own files are also found in a source tree and
    after a plain ``pip install``, below whatever prefix it went to.

    Parameters
    ----------
    package : str
        Its name.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    FileNotFoundError
        The package is not installed.

    """
    try:
        from ament_index_python.packages import get_package_share_directory
        return Path(get_package_share_directory(package))
    except (ImportError, LookupError, OSError):
        pass  # no ROS; not in the index (a KeyError); AMENT_PREFIX_PATH is not set
    if package == PACKAGE:
        for folder in Path(__file__).resolve().parents[1:]:
            for share in (folder, folder / 'share' / PACKAGE):
                if (share / 'package.xml').is_file() and (share / 'config').is_dir():
                    return share
    raise FileNotFoundError(f'package {suggestion(package, [PACKAGE])} is not found: it is not '
                            'installed, or its workspace is not sourced')


class YamlLoader(yaml.SafeLoader):
    """Safe YAML that reads 1e-3 as a number, as YAML 1.2 does, and not as text."""


YamlLoader.add_implicit_resolver('tag:yaml.org,2002:float',
                                 re.compile(r'[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$'),
                                 list('-+0123456789'))


def load_yaml(text: str) -> Any:
    """
    Return what a YAML text says.

    Parameters
    ----------
    text : str
        One document.

    Returns
    -------
    object

    Raises
    ------
    ValueError
        The text is no YAML, or a value in it cannot be read.

    """
    try:
        return yaml.load(text, YamlLoader)
    except RecursionError as error:
        raise ValueError('not valid YAML: nested too deeply') from error
    except (yaml.YAMLError, LookupError, AttributeError, TypeError) as error:
        raise ValueError(f'not valid YAML: {error}') from error


def find_file(name: str | Path) -> Path:
    """
    Return the path of a file.

    Parameters
    ----------
    name : str or pathlib.Path
        A path, or ``package://<package>/<path in its share directory>``.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    FileNotFoundError
        There is no such file, or ``~user`` names nobody.

    """
    if not str(name):
        raise FileNotFoundError('no file: its name is empty')
    if str(name).startswith(SCHEME):
        package, _, rest = str(name)[len(SCHEME):].partition('/')
        path = package_share(package) / rest
    else:
        try:
            path = Path(name).expanduser()
        except RuntimeError as error:
            raise FileNotFoundError(f'no file {name}: {error}') from error
    if not path.is_file():
        raise FileNotFoundError(f'no file {path}')
    return path


def read_source(source: str | Path, is_text: Callable[[str], bool]) -> str:
    """
    Return the text of `source`, which is a file's name or the text itself.

    Parameters
    ----------
    source : str or pathlib.Path
        Text or name.
    is_text : callable
        Says of a string whether it is the text itself.

    Returns
    -------
    str

    Raises
    ------
    FileNotFoundError
        `source` is no text and there is no such file.
    ValueError
        The file is none of text in UTF-8.

    """
    if isinstance(source, str) and is_text(source):
        return source
    path = find_file(source)
    try:
        return path.read_text(encoding='utf-8')
    except UnicodeDecodeError as error:
        raise ValueError(f'{path} is not text in UTF-8') from error

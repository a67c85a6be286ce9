# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Reader of YAML and XML, from a file or from text given in place of a file.

The input may come from anywhere. Limits of its size, depth and number of values ensure that any
input is read or refused within about a second.
"""

from collections.abc import Callable, Iterator
import math
import os
from pathlib import Path
import re
import stat
import time
from typing import Any, TypeGuard
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from tp_controller.solver.errors import suggestion
import yaml

PACKAGE = 'tp_controller'
SCHEME = 'package://'
PACKAGE_NAME = re.compile(r'[A-Za-z0-9][\w.-]*')
# The largest of 100 descriptions in example-robot-data, TIAGo with two arms, has 210,777
# characters, 3,851 elements and 7 levels; stacks have about 1,000 characters.
MOST_YAML_CHARACTERS = 250_000
MOST_YAML_VALUES = 10_000
MOST_YAML_LEVELS = 32
# Longest plain scalar: a number, name or other value without quotes [characters].
LONGEST_PLAIN_SCALAR = 1000
MOST_XML_CHARACTERS = 2_000_000
MOST_XML_ELEMENTS = 20_000
MOST_XML_LEVELS = 64
# XML is parsed in chunks of this size, between which other threads can run [characters].
XML_CHUNK = 16_384
# A file that changed less than this ago may still be written [s]. Among files written in lines, 10
# to 90 ms apart, 30 of 30 were read too early with 0.02 s, and none with 0.2 s.
SETTLING_TIME = 0.2
# Longest wait for a file to settle [s].
SETTLING_TIMEOUT = 1.0
# Longest name of a file, and longest part of a longer one in a message [characters].
LONGEST_PATH, LONGEST_QUOTED_PATH = 1000, 100
SURROGATE = re.compile('[\ud800-\udfff]')


def package_share(package: str = PACKAGE, near: Path | None = None) -> Path:
    """
    Return the share directory of a ROS package, or its folder in a source tree.

    The ament index is searched first; this package's own files are also found in a source tree
    and after a plain ``pip install``, below any prefix. Without ROS, or for packages that are not
    built, the folders of `AMENT_PREFIX_PATH` and `ROS_PACKAGE_PATH` are searched, and those above
    a file.

    Parameters
    ----------
    package : str
        Name of the package.
    near : pathlib.Path, optional
        File that names the package, such as a robot description.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    FileNotFoundError
        The package is not found.

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
    elif PACKAGE_NAME.fullmatch(package):
        for folder in _package_folders(near):
            if _is_package(folder, package):
                return folder
            if (folder / package).is_dir():
                return folder / package
    raise FileNotFoundError(f'package {suggestion(package, [PACKAGE])} is not found: it is not '
                            'installed, its workspace is not sourced, and it is in no folder of '
                            'ROS_PACKAGE_PATH')


def _package_folders(near: Path | None) -> Iterator[Path]:
    """Yield folders that may be a package, or have it in them; the nearest to a file first."""
    if near is not None:
        # Not the root: /etc is no package.
        yield from list(near.resolve().parents)[:-1]
    for variable, share in (('AMENT_PREFIX_PATH', 'share'), ('ROS_PACKAGE_PATH', '')):
        for entry in filter(None, os.environ.get(variable, '').split(os.pathsep)):
            yield Path(entry) / share


def _is_package(folder: Path, package: str) -> bool:
    """Return whether a folder has the name of a package, or the manifest of it."""
    if folder.name == package:
        return True
    try:
        manifest = (folder / 'package.xml').read_text('utf-8', 'replace')[:MOST_YAML_CHARACTERS]
    except OSError:
        return False
    return re.search(rf'<name>\s*{re.escape(package)}\s*</name>', manifest) is not None


class YamlLoader(yaml.SafeLoader):
    """
    Safe YAML loader with limits.

    It reads 1e-3 as a number, as YAML 1.2 does, and not as text. The node of an alias counts once
    per use.
    """

    def __init__(self, text: str) -> None:
        check_length(text, MOST_YAML_CHARACTERS)
        super().__init__(text)
        self._values = self._levels = 0
        # Number of values in each complete node.
        self._sizes: dict[yaml.Node | None, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Return the next node; refuse one that exceeds a limit."""
        before = self._values
        event = self.peek_event()
        self._levels += 1
        if self._levels > MOST_YAML_LEVELS:
            raise _refusal(f'nested too deeply, in more than {MOST_YAML_LEVELS} levels', event)
        node = super().compose_node(parent, index)
        self._levels -= 1
        if isinstance(event, yaml.AliasEvent):
            if node not in self._sizes:
                raise _refusal(f'the alias *{event.anchor} is part of what it stands for', event)
            self._values += self._sizes[node]
        else:
            self._values += 1
            self._sizes[node] = self._values - before
        if self._values > MOST_YAML_VALUES:
            raise _refusal(f'more than {MOST_YAML_VALUES} values, counting what aliases stand for',
                           event)
        return node

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        """Return the next scalar; refuse one that is too long or no valid text."""
        event = self.peek_event()
        if event.style is None and len(event.value) > LONGEST_PLAIN_SCALAR:
            raise _refusal(f'a number or word of more than {LONGEST_PLAIN_SCALAR} characters',
                           event)
        if SURROGATE.search(event.value):
            raise _refusal('half of a character (a lone surrogate)', event)
        return super().compose_scalar_node(anchor)


def _refusal(problem: str, event: Any) -> yaml.YAMLError:
    """Return the error for valid YAML that exceeds a limit."""
    return yaml.composer.ComposerError(None, None, problem, event.start_mark)


YamlLoader.add_implicit_resolver('tag:yaml.org,2002:float',
                                 re.compile(r'[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$'),
                                 list('-+0123456789'))


def check_length(text: str, most: int) -> None:
    """Raise ValueError if a text has more than `most` characters."""
    if len(text) > most:
        raise ValueError(f'a text of {len(text)} characters; at most {most} are read')


def load_yaml(text: str) -> Any:
    """
    Return the value of a YAML text.

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
        The text is not valid YAML, a value in it cannot be read, or it exceeds a limit.

    """
    try:
        return yaml.load(text, YamlLoader)
    except (yaml.YAMLError, LookupError, AttributeError, TypeError, ArithmeticError) as error:
        raise ValueError(f'not valid YAML: {error}') from error


class _Builder(ElementTree.TreeBuilder):
    """Builder of the tree of an XML text, with limits."""

    def __init__(self) -> None:
        super().__init__()
        self._elements = self._levels = 0

    def start(self, tag: str, attributes: dict[str, str]) -> Element:
        """Begin an element."""
        self._elements += 1
        self._levels += 1
        if self._elements > MOST_XML_ELEMENTS:
            raise ValueError(f'more than {MOST_XML_ELEMENTS} elements')
        if self._levels > MOST_XML_LEVELS:
            raise ValueError(f'nested too deeply, in more than {MOST_XML_LEVELS} levels')
        return super().start(tag, attributes)

    def end(self, tag: str) -> Element:
        """End an element."""
        self._levels -= 1
        return super().end(tag)

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Refuse a document type: its entities could expand a short text without limit."""
        raise ValueError('a document type (<!DOCTYPE …>) is not read')


def load_xml(text: str) -> Element:
    """
    Return the outermost element of an XML text.

    The text is in Unicode already; an encoding that it declares is ignored.

    Parameters
    ----------
    text : str
        One document.

    Returns
    -------
    xml.etree.ElementTree.Element

    Raises
    ------
    ValueError
        The text is not valid XML, or exceeds a limit.

    """
    check_length(text, MOST_XML_CHARACTERS)
    parser = ElementTree.XMLParser(target=_Builder())
    try:
        for start in range(0, len(text), XML_CHUNK):
            parser.feed(text[start:start + XML_CHUNK])
        return parser.close()
    except (ElementTree.ParseError, UnicodeEncodeError) as error:
        raise ValueError(f'not valid XML: {error}') from error


def is_number(value: object) -> TypeGuard[int | float]:
    """Return whether a value is a number in the range of floats, and not NaN."""
    try:
        return isinstance(value, (int, float)) and not isinstance(value, bool) \
            and not math.isnan(float(value))
    except OverflowError:
        # YAML has integers of any size.
        return False


def find_file(name: str | Path, near: Path | None = None) -> Path:
    """
    Return the path of a file.

    Parameters
    ----------
    name : str or pathlib.Path
        A path, or ``package://<package>/<path in its share directory>``.
    near : pathlib.Path, optional
        File that names it: packages are searched in the folders above, too.

    Returns
    -------
    pathlib.Path

    Raises
    ------
    FileNotFoundError
        The file does not exist, ``~user`` is unknown, or the path leads out of its package.

    """
    if not str(name):
        raise FileNotFoundError('no file: its name is empty')
    if len(str(name)) > LONGEST_PATH:
        # Probably a text given in place of a name.
        raise FileNotFoundError(f'no file {str(name)[:LONGEST_QUOTED_PATH]} …')
    if str(name).startswith(SCHEME):
        return _package_file(str(name), near)
    try:
        path = Path(name).expanduser()
    except RuntimeError as error:
        raise FileNotFoundError(f'no file {name}: {error}') from error
    return _regular(path)


def _package_file(name: str, near: Path | None) -> Path:
    """Return the path of a file of a package."""
    package, _, rest = name[len(SCHEME):].partition('/')
    share = package_share(package, near)
    # An absolute rest replaces the share directory.
    path = _regular(share / rest)
    if not any(path.resolve().is_relative_to(folder) for folder in _folders(package, share)):
        raise FileNotFoundError(f'no file {name}: the path leads out of its package')
    return path


def _folders(package: str, share: Path) -> list[Path]:
    """
    Return the folders of a package's files.

    After ``colcon build --symlink-install`` its share directory has links to its source, such as
    package.xml, and to its build directory.
    """
    source = (share / 'package.xml').resolve().parent
    builds = [folder / 'build' / package for folder in share.resolve().parents[2:4]]
    return [share.resolve(), source, *builds]


def _regular(path: Path) -> Path:
    """Return a path; raise OSError if it is missing, a directory, a device or the like."""
    if not path.is_file():
        raise FileNotFoundError(
            f'no file {path}' + (': it is no regular file' if path.exists() else ''))
    return path


def read_source(source: str | Path, is_text: Callable[[str], bool],
                most: int = MOST_YAML_CHARACTERS) -> str:
    """
    Return the text of `source`, which is a file's name or the text itself.

    Parameters
    ----------
    source : str or pathlib.Path
        Text or name.
    is_text : callable
        Predicate: whether a string is the text itself.
    most : int
        Largest number of characters.

    Returns
    -------
    str

    Raises
    ------
    FileNotFoundError
        `source` is the name of a file that does not exist.
    ValueError
        The text is too long, or the file is not text in UTF-8 or still being written.

    """
    if not isinstance(source, (str, Path)):
        raise ValueError(f'needs text or the name of a file, got {source!r}')
    if isinstance(source, str) and is_text(source):
        check_length(source, most)
        return source
    path = find_file(source)
    content = _settled_content(path, most)
    try:
        return content.decode('utf-8')
    except UnicodeDecodeError as error:
        raise ValueError(f'{path} is not text in UTF-8') from error


def _settled_content(path: Path, most: int) -> bytes:
    """
    Return the content of a file as soon as it is completely written.

    The first lines of a stack are a stack, too: reading while they are written would return the
    upper tasks only.
    """
    until = time.monotonic() + SETTLING_TIMEOUT
    while True:
        content, changed = _content(path, most)
        if not 0.0 <= time.time() - changed < SETTLING_TIME:
            return content
        if time.monotonic() > until:
            raise ValueError(f'{path} has been changing for {SETTLING_TIMEOUT:g} s: read it when '
                             'it is complete')
        time.sleep(SETTLING_TIME)


def _content(path: Path, most: int) -> tuple[bytes, float]:
    """Return the content of a file, and the time of its last change."""
    # A fifo that replaced the file meanwhile must not block.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(descriptor, 'rb') as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise FileNotFoundError(f'no file {path}: it is no regular file')
        # A file without content yet, as some below /proc, returns None.
        content = file.read(most + 1) or b''
        if len(content) > most:
            raise ValueError(f'{path} is longer than {most} bytes, more than are read')
        return content, os.fstat(descriptor).st_mtime

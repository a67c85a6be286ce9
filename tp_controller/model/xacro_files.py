# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Expansion of xacro files by the `xacro` package, with or without ROS.

A xacro is a program: expand those only that you would run. Packages are found where
``package://`` finds them, also in the folders above a file. Files and output are limited as other
descriptions are.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
import re
from threading import Lock
from types import ModuleType
from typing import Any, TypeAlias
from xml.dom import expatbuilder, minidom
from xml.parsers.expat import ExpatError

from tp_controller.errors import LONGEST_FAULT, RobotError, suggestion, unknown
from tp_controller.resources import (
    check_length,
    MOST_XML_CHARACTERS,
    package_share,
    read_source,
)

# {name: value}, or a list of ``name:=value``, as the command xacro takes them.
XacroArguments: TypeAlias = Mapping[str, object] | Sequence[str]
INSTALL_XACRO = 'install it by "pip install xacro", or "sudo apt install ros-jazzy-xacro" with ROS'
ARGUMENT_FORM = 'a xacro argument is name:=value, such as ur_type:=ur5e'
# Arguments that a file declares or uses.
DECLARED = re.compile(r'<xacro:arg\s[^>]*?\bname\s*=\s*["\']([^"\']+)["\']'
                      r'|\$\(arg\s+([^)\s]+)\s*\)|xacro\.arg\(\s*["\']([^"\']+)["\']')
# Largest number of files that one xacro may include, and of includes inside each other.
MOST_INCLUDED_FILES, MOST_INCLUDE_LEVELS = 1000, 50
# Key of the place of an element.
PLACE_KEY = 'place'
# The package keeps its state in globals.
_LOCK = Lock()


def xacro_values(arguments: XacroArguments | None) -> dict[str, str]:
    """
    Return {name: value} of xacro arguments.

    Truth values become ``true`` and ``false``. Empty entries of a list are ignored.

    Raises
    ------
    RobotError
        An entry of a list is not ``name:=value``.

    """
    if arguments is None:
        return {}
    if isinstance(arguments, Mapping):
        pairs = [(name, value) for name, value in arguments.items()]
    elif isinstance(arguments, Sequence) and not isinstance(arguments, (str, bytes)):
        pairs = [_pair(entry) for entry in arguments if entry != '']
    else:
        raise RobotError(f'xacro arguments must be a list or mapping, not {arguments!r}; '
                         f'{ARGUMENT_FORM}')
    for name, value in pairs:
        if not isinstance(name, str) or not isinstance(value, (str, bool, int, float)):
            raise RobotError(f'xacro argument {name!r}: needs a text or number, not {value!r}')
    return {name: str(value).lower() if isinstance(value, bool) else str(value)
            for name, value in pairs}


def expand_xacro(path: Path, arguments: Mapping[str, str],
                 packages: Mapping[str, Path] | None = None) -> str:
    """
    Return the XML text of a xacro file.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    arguments : mapping
        ``{name: value}``.
    packages : mapping, optional
        ``{package: folder}`` for ``$(find package)``, before those that are searched.

    Raises
    ------
    RobotError
        `xacro` is not installed, an argument is unknown or missing, a file or package is not
        found, or the text is not valid; the message names the file, and the line if it is known.

    """
    try:
        import xacro
        from xacro import substitution_args
    except ImportError as error:
        raise RobotError(f'{path} is a xacro, and the package xacro is missing: {INSTALL_XACRO}'
                         ) from error
    reader = _Reader(path, packages or {})
    with _LOCK, reader.hooks(xacro, substitution_args):
        try:
            document = xacro.process_file(str(path), mappings=dict(arguments), verbosity=0)
            text: str = document.toxml()
        except Exception as error:
            # Expressions of the file may raise anything.
            raise RobotError(f'xacro {reader.place(error)}: {_message(error)}'
                             + reader.hint(arguments)) from error
    for name in arguments:
        if name not in reader.declared:
            raise RobotError(f'xacro {path}: {unknown("argument", name, reader.declared)}')
    try:
        check_length(text, MOST_XML_CHARACTERS)
    except ValueError as error:
        raise RobotError(f'xacro {path}: it expands to {error}') from error
    return text


class _Reader:
    """
    Reader of the files of one xacro.

    Attributes
    ----------
    declared : dict
        Names of the arguments that the files declare or use.

    """

    def __init__(self, path: Path, packages: Mapping[str, Path]) -> None:
        self._packages = packages
        self.declared: dict[str, None] = {}
        self._files = [path]

    @contextmanager
    def hooks(self, xacro: ModuleType, substitution: ModuleType) -> Iterator[None]:
        """Let the package read files, and find packages, by this reader."""
        self._xacro = xacro
        changes = ((xacro, 'parse', self.parse), (substitution, '_eval_find', self.find),
                   (substitution, '_eval_dict', {**substitution._eval_dict, 'find': self.find}))
        before = [(module, name, getattr(module, name)) for module, name, _ in changes]
        try:
            for module, name, value in changes:
                setattr(module, name, value)
            yield
        finally:
            for module, name, value in before:
                setattr(module, name, value)

    def find(self, package: str) -> str:
        """Return the folder of a package; FileNotFoundError if there is none."""
        if package in self._packages:
            return str(self._packages[package])
        return str(package_share(package, self._files[0]))

    def parse(self, _: object, filename: str) -> minidom.Document:
        """Return the tree of a file, the elements of which know their lines."""
        stack = self._xacro.filestack
        if len(stack) > MOST_INCLUDE_LEVELS or len(self._files) > MOST_INCLUDED_FILES:
            raise RecursionError
        path = Path(filename)
        try:
            text = read_source(path, lambda text: False, MOST_XML_CHARACTERS)
        except OSError as error:
            # An optional include is skipped; the package expects this exception.
            stack.pop()
            raise self._xacro.XacroException(str(error), exc=error) from error
        self._files.append(path)
        self.declared.update((name, None) for names in DECLARED.findall(text)
                             for name in names if name)
        return _Builder(filename).parseString(text.encode())

    def hint(self, arguments: Iterable[str]) -> str:
        """Return the end of a message: the first argument that no file has, so far."""
        strange = [name for name in arguments if name not in self.declared]
        return f'; unknown argument {suggestion(strange[0], self.declared)}' if strange else ''

    def place(self, error: BaseException) -> str:
        """Return the file, and the line if it is known, that an exception is about."""
        stack = [str(file) for file in self._xacro.filestack or ()] or [str(self._files[0])]
        if isinstance(error, ExpatError):
            return f'{stack[-1]}, line {error.lineno}'
        found, frame = '', error.__traceback__
        while frame is not None:
            # The innermost element that the package was busy with.
            node = frame.tb_frame.f_locals.get('node')
            if isinstance(node, minidom.Element):
                found = node.getUserData(PLACE_KEY) or found
            frame = frame.tb_next
        return found or stack[-1]


class _Builder(expatbuilder.ExpatBuilderNS):
    """Builder of a tree with the place of each element, which its copies in macros keep."""

    def __init__(self, filename: str) -> None:
        super().__init__()
        self._filename = filename

    def start_element_handler(self, name: str, attributes: Any) -> None:
        """Begin an element."""
        super().start_element_handler(name, attributes)
        line = self.getParser().CurrentLineNumber
        self.curNode.setUserData(PLACE_KEY, f'{self._filename}, line {line}', self)

    def handle(self, operation: int, key: str, data: str, source: Any, copy: Any) -> None:
        """Give the copy of an element its place."""
        if copy is not None:
            copy.setUserData(key, data, self)

    def start_doctype_decl_handler(self, *_: object) -> None:
        """Refuse a document type: its entities could expand a short text without limit."""
        raise ValueError('a document type (<!DOCTYPE …>) is not read')


def _pair(entry: object) -> tuple[str, str]:
    """Return the name and value of an argument ``name:=value``."""
    name, separator, value = entry.partition(':=') if isinstance(entry, str) else ('', '', '')
    if not separator or not name.strip():
        raise RobotError(f'{ARGUMENT_FORM}, not {entry!r}')
    return name.strip(), value


def _message(error: Exception) -> str:
    """Return the message of an exception of the package or an expression, in one line."""
    cause: Any = error
    while getattr(cause, 'exc', None) is not None:
        cause = cause.exc
    if isinstance(cause, RecursionError):
        return 'files include each other, or macros call each other, without end'
    if type(cause).__name__ == 'ArgException':
        return f'argument {str(cause)!r} has no value; give it one, as {cause}:=value'
    text = str(error)
    if isinstance(cause, OSError):
        text = f'{cause.strerror}: {cause.filename}' if cause.filename else str(cause)
    return ' '.join(text.split())[:LONGEST_FAULT] or type(error).__name__

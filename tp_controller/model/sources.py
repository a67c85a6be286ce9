# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Robot descriptions in the forms that people have them, as URDF text.

A URDF, a xacro, an MJCF, a name of the package `robot_descriptions`, or a model of Pinocchio. DH
tables are read by `tp_controller.model.dh`.
"""

from collections.abc import Mapping
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias
from xml.parsers import expat

import pinocchio
from tp_controller.errors import LONGEST_FAULT, RobotError, suggestion
from tp_controller.model.mjcf import MJCF_ROOT, urdf_from_mjcf
from tp_controller.model.model_urdf import Description, urdf_from_model
from tp_controller.model.standalone import with_located_meshes, with_simple_joints
from tp_controller.model.xacro_files import expand_xacro, xacro_values, XacroArguments
from tp_controller.resources import (
    check_length,
    find_file,
    MOST_XML_CHARACTERS,
    read_source,
    XML_CHUNK,
)

Source: TypeAlias = str | Path | pinocchio.Model
# Prefix of a name of the package robot_descriptions.
DESCRIPTION_PREFIX = 'robot_descriptions:'
XACRO_SUFFIX = '.xacro'
MACRO = 'xacro:'
INSTALL_DESCRIPTIONS = 'install it by "pip install robot_descriptions"'


class _Elements(NamedTuple):
    """Outermost element of a text, empty if it is not XML, and whether there are macros."""

    root: str
    macros: bool


def describe(source: Source, xacro_arguments: XacroArguments | None = None) -> Description:
    """
    Return the URDF of a robot.

    Parameters
    ----------
    source : str, pathlib.Path or pinocchio.Model
        Text in URDF or MJCF; a file of one of these or a xacro, by its path or as
        ``package://<package>/<path>``; ``robot_descriptions:<name>``; or a model.
    xacro_arguments : dict or list, optional
        ``{name: value}`` or ``['name:=value', …]``.

    Returns
    -------
    Description

    Raises
    ------
    RobotError
        The description cannot be read; the message says what is valid.

    """
    arguments = xacro_values(xacro_arguments)
    if isinstance(source, pinocchio.Model):
        _refuse(arguments, 'a model of Pinocchio')
        return urdf_from_model(source)
    if isinstance(source, str) and source.startswith(DESCRIPTION_PREFIX):
        return _from_package(source.removeprefix(DESCRIPTION_PREFIX), arguments)
    try:
        if isinstance(source, str) and '<' in source:
            check_length(source, MOST_XML_CHARACTERS)
            _refuse(arguments, 'a text')
            return _from_text(source)
        if not isinstance(source, (str, Path)):
            raise ValueError('needs text, the name of a file or a pinocchio.Model, got '
                             f'{source!r}')
        path = find_file(source)
    except (OSError, ValueError) as error:
        raise RobotError(f'robot description: {error}') from error
    return _from_file(path, arguments, {})


def _from_file(path: Path, arguments: Mapping[str, str],
               packages: Mapping[str, Path]) -> Description:
    """Return the URDF of a file in URDF, xacro or MJCF."""
    try:
        text = read_source(path, lambda text: False, MOST_XML_CHARACTERS)
    except (OSError, ValueError) as error:
        raise RobotError(f'robot description: {error}') from error
    elements = _elements(text)
    if path.suffix == XACRO_SUFFIX or elements.macros:
        text = expand_xacro(path, arguments, packages)
    else:
        _refuse(arguments, str(path))
    if elements.root == MJCF_ROOT:
        return urdf_from_mjcf(text, path)
    return with_simple_joints(with_located_meshes(text, path, packages))


def _from_text(text: str) -> Description:
    """Return the URDF of a text in URDF or MJCF."""
    elements = _elements(text)
    if elements.root == MJCF_ROOT:
        return urdf_from_mjcf(text)
    if elements.macros:
        # A xacro is a program, and a text may come from a topic.
        raise RobotError('robot description: the text is a xacro: give the name of its file, or '
                         'expand it first (xacro robot.urdf.xacro > robot.urdf)')
    return with_simple_joints(text)


def _from_package(name: str, arguments: Mapping[str, str]) -> Description:
    """Return the URDF of a robot of the package robot_descriptions, which downloads it."""
    module = _description_module(name)
    packages = {package: Path(folder) for package, folder in
                getattr(module, 'XACRO_PACKAGE_PATHS', {}).items()}
    for kind in ('URDF_PATH', 'XACRO_PATH', 'MJCF_PATH'):
        if hasattr(module, kind):
            given = {**getattr(module, 'XACRO_ARGS', {}), **arguments} \
                if kind == 'XACRO_PATH' else arguments
            return _from_file(Path(getattr(module, kind)), given, packages)
    raise RobotError(f'{DESCRIPTION_PREFIX}{name} has neither URDF, xacro nor MJCF')


def _description_module(name: str) -> ModuleType:
    """Return a module of the package robot_descriptions, which downloads what it describes."""
    try:
        known: Mapping[str, Any] = importlib.import_module(
            'robot_descriptions._descriptions').DESCRIPTIONS
    except ImportError as error:
        raise RobotError(f'{DESCRIPTION_PREFIX}{name}: the package robot_descriptions is missing: '
                         f'{INSTALL_DESCRIPTIONS}') from error
    if name not in known:
        raise RobotError(f'unknown robot description {suggestion(name, known)}; all names: '
                         'python -m robot_descriptions list')
    try:
        return importlib.import_module(f'robot_descriptions.{name}')
    except Exception as error:
        # Git, and the network that it needs, raise anything.
        text = ' '.join(str(error).split())[:LONGEST_FAULT] or type(error).__name__
        raise RobotError(f'{DESCRIPTION_PREFIX}{name} cannot be downloaded: {text}') from error


def _refuse(arguments: Mapping[str, str], what: str) -> None:
    """Raise `RobotError` for arguments of what is no xacro."""
    if arguments:
        raise RobotError(f'xacro arguments ({", ".join(arguments)}) are for the file of a xacro, '
                         f'not for {what}')


def _elements(text: str) -> _Elements:
    """Return the elements of a text that tell its format; comments do not count."""
    names: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, _: names.append(name)
    try:
        for start in range(0, len(text), XML_CHUNK):
            parser.Parse(text[start:start + XML_CHUNK])
            if names and MACRO not in text:
                break
    except (expat.ExpatError, UnicodeEncodeError):
        # The reader of the whole text has the message.
        pass
    return _Elements(names[0] if names else '', any(name.startswith(MACRO) for name in names))

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Stacks given as lists and mappings of Python, which become YAML with one entry a line."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from tp_controller.errors import Fault, StackError
from tp_controller.model.robot import Robot
from tp_controller.resources import (
    check_length,
    MOST_YAML_CHARACTERS,
    MOST_YAML_LEVELS,
    YamlLoader,
)
from tp_controller.tasks.stack_reader import StackReader
from tp_controller.tasks.task import Task
import yaml

# Largest number of characters shown of a value that is not valid.
MOST_VALUE_CHARACTERS = 100
FORM = ("a list such as [{'tool': {'type': 'pose', 'frame': 'tcp'}}], the highest priority first, "
        'an inner list for tasks that share a level')


class _Dumper(yaml.SafeDumper):
    """Dumper of YAML that `YamlLoader` reads as the same values."""


# Text that only this loader takes for a number gets quotes.
_Dumper.yaml_implicit_resolvers = YamlLoader.yaml_implicit_resolvers


def read_entries(entries: object, robot: Robot) -> tuple[list[list[Task]], str]:
    """
    Return the tasks of a list, and the YAML that has the same meaning.

    Parameters
    ----------
    entries : list
        Mappings ``{name: {key: value}}``, or lists of them that share a level. Values may be
        arrays and numbers of numpy, tuples and paths.
    robot : Robot
        Robot with the joints and frames that the tasks name.

    Raises
    ------
    StackError
        All faults, each with its task, or with the number of its entry.

    """
    if not isinstance(robot, Robot):
        raise StackError([Fault(0, '', f'needs a Robot, got {_shown(robot)}')])
    text = yaml_of(entries)
    try:
        return StackReader(robot, 'entry').read(text), text
    except StackError as error:
        # A line is an entry.
        raise StackError([Fault(0, fault.where or f'entry {fault.line}', fault.message)
                          for fault in error.faults]) from error


def yaml_of(entries: object) -> str:
    """
    Return the YAML of a list, one line for each entry.

    Raises
    ------
    StackError
        YAML lacks a value, or the text is too long.

    """
    if not isinstance(entries, (list, tuple)):
        raise StackError([Fault(0, '', f'a stack must be {FORM}; got {_shown(entries)}')])
    lines, faults = [], []
    for number, entry in enumerate(entries, 1):
        try:
            lines.append('- ' + yaml.dump(_plain(entry), Dumper=_Dumper, sort_keys=False,
                                          default_flow_style=True, allow_unicode=True,
                                          width=MOST_YAML_CHARACTERS).strip() + '\n')
        except (ValueError, yaml.YAMLError) as error:
            faults.append(Fault(0, f'entry {number}', str(error)))
    if faults:
        raise StackError(faults)
    text = ''.join(lines) or '[]\n'
    try:
        check_length(text, MOST_YAML_CHARACTERS)
    except ValueError as error:
        raise StackError([Fault(0, '', str(error))]) from error
    return text


def _plain(value: object, levels: int = 0) -> object:
    """Return a value as YAML has it; ValueError for one that it has not."""
    if levels > MOST_YAML_LEVELS:
        raise ValueError(f'nested too deeply, in more than {MOST_YAML_LEVELS} levels')
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {_key(key): _plain(each, levels + 1) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each, levels + 1) for each in value]
    if value is None or type(value) in (bool, int, float, str):
        return value
    raise ValueError(f'needs numbers, texts, lists and mappings, not {_shown(value)}')


def _key(key: object) -> object:
    """Return a key of a mapping; ValueError for one that YAML has not."""
    plain = _plain(key)
    if isinstance(plain, (list, dict)):
        raise ValueError(f'a key must be a text, not {_shown(key)}')
    return plain


def _shown(value: object) -> str:
    """Return the beginning of a value, and its type."""
    return f'{repr(value)[:MOST_VALUE_CHARACTERS]} ({type(value).__name__})'

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of bags, folders or files of ROS 2, complete or truncated, without ROS."""

from collections.abc import Callable, Iterator
from pathlib import Path
import re
from typing import Any

from rosbags.typesys import get_typestore, Stores
from tp_controller.errors import TpControllerError
from tp_controller.tools.recording.mcap import Damaged, mcap_messages, Raw
from tp_controller.tools.recording.sqlite import sqlite_messages

# Name of the description in the folder of a bag.
DESCRIPTION = 'metadata.yaml'
SUFFIXES = ('.mcap', '.db3')
COMPRESSED = ('.zstd', '.zst', '.lz4')
# Line of the description that marks separately compressed messages in an SQLite file.
BY_MESSAGE = re.compile(r'^[^\S\n]*compression_mode:[^\S\n]*["\']?message\b',
                        re.IGNORECASE | re.MULTILINE)
# Longest description that is read [characters].
LONGEST_DESCRIPTION = 1 << 24
# Longest message that is decoded [bytes]; decoding may take thirty times as much memory.
MESSAGE_BYTES = 1 << 22


class Unreadable(Exception):
    """A message does not match its type."""


class Bag:
    """
    Recording of ROS 2.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag, or one file of it.

    Attributes
    ----------
    path : pathlib.Path
    size : int
        Size of its files [bytes].
    remarks : list of str
        Faults found while reading.

    Raises
    ------
    TpControllerError
        The path contains no recording.

    """

    def __init__(self, path: Path) -> None:
        self.path = path.parent if path.name == DESCRIPTION else path
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self.remarks: list[str] = []
        self._files = _files(self.path)
        self.size = sum(file.stat().st_size for file in self._files)
        if self.path.is_dir() and not (self.path / DESCRIPTION).is_file():
            self.remarks.append(f'{self.path} has no {DESCRIPTION}: the recording was not ended')

    def messages(self, advance: Callable[[float], object]) -> Iterator[Raw]:
        """
        Yield all messages, in the order of the files, as far as they can be read.

        Parameters
        ----------
        advance : callable
            Called with the number of bytes read since the last call.

        """
        for path in self._files:
            try:
                yield from mcap_messages(path, advance) if path.suffix == '.mcap' \
                    else sqlite_messages(path, self._is_compressed, advance)
            except Damaged as fault:
                self.remarks.append(str(fault))

    def decode(self, raw: Raw) -> Any:
        """
        Return a message with the fields of its type; sequences of numbers are arrays.

        Raises
        ------
        Unreadable
            The message is damaged or too long, or its type is unknown.

        """
        if len(raw.data) > MESSAGE_BYTES:
            raise Unreadable(f'{raw.topic} ({raw.kind}), too long')
        try:
            return self._types.deserialize_cdr(raw.data, raw.kind)
        except Exception as error:
            # Decoding untrusted bytes can raise any exception.
            raise Unreadable(f'{raw.topic} ({raw.kind})') from error

    @property
    def _is_compressed(self) -> bool:
        """Return whether each message of SQLite files is compressed."""
        description = self.path / DESCRIPTION
        if not description.is_file():
            return False
        try:
            with description.open(encoding='utf-8', errors='replace') as file:
                return BY_MESSAGE.search(file.read(LONGEST_DESCRIPTION)) is not None
        except OSError:
            return False


def _files(path: Path) -> list[Path]:
    """Return the files of a bag, in their order."""
    if not path.exists():
        raise TpControllerError(f'there is no {path}')
    if not path.is_dir():
        if not path.is_file():
            raise TpControllerError(f'{path} is not a recording: not a regular file')
        if path.suffix not in SUFFIXES:
            raise TpControllerError(f'{path} is not a recording: neither a folder nor a file '
                                    f'{" or ".join(SUFFIXES)}')
        return [path]
    # Opening a named pipe would block.
    found = [file for file in path.iterdir() if file.suffix in SUFFIXES and file.is_file()]
    if found:
        return sorted(found, key=_number)
    if any(file.suffix in COMPRESSED for file in path.iterdir()):
        raise TpControllerError(f'the files in {path} are compressed as a whole: decompress them '
                                'first, as with zstd -d')
    raise TpControllerError(f'there is no recording in {path}: no file {" or ".join(SUFFIXES)}')


def _number(path: Path) -> list[int | str]:
    """Return a sort key that puts run_2 before run_10: alternating texts and numbers."""
    return [int(part) if place % 2 else part
            for place, part in enumerate(re.split(r'(\d+)', path.name))]

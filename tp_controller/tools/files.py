# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Files in folders that other users can write to, opened without following links."""

from collections.abc import Iterator
from contextlib import contextmanager
import errno
import os
from pathlib import Path
import stat
import tempfile
from typing import BinaryIO

from tp_controller.errors import TpControllerError

PRIVATE = 0o700


@contextmanager
def private_folder(name: str) -> Iterator[int]:
    """
    Open or create a private folder of this user in the temporary directory.

    Parameters
    ----------
    name : str
        Name of the folder, the same for every process of the user.

    Yields
    ------
    int
        Descriptor to open files in the folder (``dir_fd``), even if its path changes.

    Raises
    ------
    TpControllerError
        Another user owns it, or it is a link or a file.

    """
    path = Path(tempfile.gettempdir()) / name
    try:
        path.mkdir(PRIVATE, exist_ok=True)
        folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError as error:
        raise TpControllerError(f'{path} must be a folder of your own: {error.strerror}; remove '
                                'it, or set TMPDIR') from error
    try:
        status = os.fstat(folder)
        if status.st_uid != os.getuid():
            raise TpControllerError(f'{path} must be a folder of your own: it belongs to user '
                                    f'{status.st_uid}; set TMPDIR')
        if stat.S_IMODE(status.st_mode) != PRIVATE:
            os.fchmod(folder, PRIVATE)
        yield folder
    finally:
        os.close(folder)


def open_lock(name: str, folder: int) -> BinaryIO:
    """Open or create a lock file in a folder (descriptor)."""
    try:
        number = os.open(name, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600, dir_fd=folder)
    except OSError as error:
        raise TpControllerError(f'no lock {name}: {error.strerror}') from error
    return os.fdopen(number, 'r+b')


def new_file(path: str | Path) -> BinaryIO:
    """
    Open a file for writing from its start, and create its folder.

    Raises
    ------
    TpControllerError
        The file is a link, whose creator would choose the file to be written.

    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise TpControllerError(f'{path} is a link, and is not written; remove it') from error
        raise
    return os.fdopen(number, 'wb')

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Files in folders that other users can write to, opened without following links."""

import errno
import os
from pathlib import Path
from typing import BinaryIO

from tp_controller.errors import TpControllerError


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

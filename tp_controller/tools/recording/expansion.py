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

"""Decompression into a bounded memory, whatever compressed data claim."""

from pathlib import Path
import sys
from typing import Any

# Largest piece of a recording, compressed or not [bytes].
LONGEST = 1 << 26
# Largest logarithm of the memory that Zstandard looks back into.
WINDOW = 26
# How much a file may become: so many times its size, and a constant [bytes].
MOST_TIMES, FREE = 200, 1 << 28
# Unit of the blocks of a file [bytes].
BLOCK = 512


class TooMuch(Exception):
    """Data are longer than they say, or than is read."""


class Budget:
    """
    How much may come out of a file, for what it takes on the disk: holes count nothing.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    """

    def __init__(self, path: Path) -> None:
        status = path.stat()
        self._left = FREE + MOST_TIMES * min(status.st_size, BLOCK * status.st_blocks)

    def take(self, size: int) -> None:
        """Take so much of it [bytes]; `TooMuch` if there is no more."""
        self._left -= size
        if self._left < 0:
            raise TooMuch


def expanded(name: str, data: bytes | memoryview, size: int) -> bytes | memoryview:
    """
    Return decompressed data; as much as there is where they are cut off.

    Parameters
    ----------
    name : str
        Of the compression, ``'zstd'``, ``'lz4'`` or empty.
    data : bytes
        Compressed.
    size : int
        What they become, as the recording says [bytes].

    Raises
    ------
    TooMuch
        They become more, or there are more than `LONGEST`.
    ValueError
        They are damaged, or the compression is not known.
    ImportError
        A library is missing.

    """
    if max(size, len(data)) > LONGEST:
        raise TooMuch
    if not name:
        return data
    if name not in DECOMPRESSORS:
        raise ValueError(f'unknown compression {name!r}')
    decompressor = DECOMPRESSORS[name]()
    try:
        found = bytes(decompressor.decompress(data, max_length=size + 1))
    except MemoryError:
        raise
    except Exception as error:
        # Each library has errors of its own for data that are damaged.
        raise ValueError('damaged') from error
    if len(found) > size:
        raise TooMuch
    return found


def _zstd() -> Any:
    """Return a decompressor of Zstandard."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd.ZstdDecompressor(options={zstd.DecompressionParameter.window_log_max: WINDOW})


def _lz4() -> Any:
    """Return a decompressor of LZ4."""
    from lz4.frame import LZ4FrameDecompressor
    return LZ4FrameDecompressor()


DECOMPRESSORS = {'zstd': _zstd, 'lz4': _lz4}

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Decompression with bounded memory, for untrusted data."""

from pathlib import Path
import sys
from typing import Any

# Largest chunk of a recording, compressed or not [bytes].
CHUNK_BYTES = 1 << 26
# Largest logarithm of the window size of Zstandard.
ZSTD_WINDOW = 26
# Limit of the decompressed size of a file: factor on its size on the disk, and constant [bytes].
MOST_RATIO, EXTRA_BYTES = 200, 1 << 28
# Unit of `st_blocks` [bytes].
BLOCK_BYTES = 512


class TooMuch(Exception):
    """Data exceed their declared size or the limit."""


class Budget:
    """
    Limit of the decompressed size of a file, by its size on the disk without holes.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    """

    def __init__(self, path: Path) -> None:
        status = path.stat()
        self._left = EXTRA_BYTES + MOST_RATIO * min(
            status.st_size, BLOCK_BYTES * status.st_blocks)

    def take(self, size: int) -> None:
        """Subtract a size [bytes]; raise `TooMuch` if the limit is exceeded."""
        self._left -= size
        if self._left < 0:
            raise TooMuch


def expanded(name: str, data: bytes | memoryview, size: int) -> bytes | memoryview:
    """
    Return decompressed data; truncated data are decompressed as far as possible.

    Parameters
    ----------
    name : str
        Name of the compression, ``'zstd'``, ``'lz4'`` or empty.
    data : bytes
        Compressed data.
    size : int
        Decompressed size according to the recording [bytes].

    Raises
    ------
    TooMuch
        The result exceeds `size`, or the data exceed `CHUNK_BYTES`.
    ValueError
        The data are damaged, or the compression is unknown.
    ImportError
        The library of the compression is missing.

    """
    if max(size, len(data)) > CHUNK_BYTES:
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
        # Each library raises its own exceptions for damaged data.
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
    return zstd.ZstdDecompressor(options={zstd.DecompressionParameter.window_log_max: ZSTD_WINDOW})


def _lz4() -> Any:
    """Return a decompressor of LZ4."""
    from lz4.frame import LZ4FrameDecompressor
    return LZ4FrameDecompressor()


DECOMPRESSORS = {'zstd': _zstd, 'lz4': _lz4}

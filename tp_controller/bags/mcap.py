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

"""Reads MCAP files from their start, one message after the other, as far as they go."""

from collections.abc import Callable, Iterator
import io
from pathlib import Path
import struct
import sys
from typing import BinaryIO, NamedTuple

from tp_controller.errors import TpControllerError

MAGIC = b'\x89MCAP0\r\n'
# Opcodes of records (mcap.dev/spec).
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15
HEAD = struct.Struct('<BQ')
# Of a message: channel, number, times of receipt and of publishing [ns].
MESSAGE_HEAD = struct.Struct('<HIQQ')
# Of a chunk: times, size and checksum of what is in it.
CHUNK_HEAD = struct.Struct('<QQQI')
# A longer record is none: the file is damaged [bytes].
LONGEST = 1 << 28


class Raw(NamedTuple):
    """
    One message of a bag, not decoded.

    Attributes
    ----------
    topic, kind : str
        Names of the topic and of its type.
    stamp : int
        When it was received [ns].
    data : bytes
        CDR.

    """

    topic: str
    kind: str
    stamp: int
    data: bytes


class CutOff(Exception):
    """The file ends, or makes no sense any more, where something else has to be."""


class McapFile:
    """
    An MCAP file.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Attributes
    ----------
    fault : str
        Where the file was cut off, once its messages were read; empty if it is complete.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.fault = ''
        self._schemas: dict[int, str] = {}
        # Of each channel the topic and its type; None where it is not in CDR.
        self._channels: dict[int, tuple[str, str] | None] = {}

    def messages(self, advance: Callable[[float], object]) -> Iterator[Raw]:
        """
        Yield all messages in the order of the file.

        Parameters
        ----------
        advance : callable
            Called with the number of bytes that were read since the last call.

        Raises
        ------
        TpControllerError
            It is no MCAP file.

        """
        with self.path.open('rb') as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise TpControllerError(f'{self.path} is no MCAP file')
            place = file.tell()
            try:
                for kind, record in _records(file):
                    if kind in (DATA_END, FOOTER):
                        # What is left is an index.
                        advance(self.path.stat().st_size - place)
                        return
                    yield from self._take(kind, record)
                    advance(file.tell() - place)
                    place = file.tell()
            except (CutOff, struct.error, ValueError):
                # What came before was told.
                pass
            self.fault = f'{self.path.name} is cut off, or damaged, after {place} bytes'

    def _take(self, kind: int, record: bytes) -> Iterator[Raw]:
        """Take one record, and yield the messages in it."""
        if kind == MESSAGE:
            channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(record)
            known = self._channels.get(channel)
            if known is not None:
                yield Raw(*known, stamp, record[MESSAGE_HEAD.size:])
        elif kind == CHUNK:
            yield from self._take_chunk(record)
        elif kind == SCHEMA:
            number, = struct.unpack_from('<H', record)
            self._schemas[number], _ = _text(record, 2)
        elif kind == CHANNEL:
            number, schema = struct.unpack_from('<HH', record)
            topic, end = _text(record, 4)
            encoding, _ = _text(record, end)
            self._channels[number] = (topic, self._schemas.get(schema, '')) \
                if encoding == 'cdr' else None

    def _take_chunk(self, record: bytes) -> Iterator[Raw]:
        """Yield the messages in a chunk, as far as it goes."""
        compression, end = _text(record, CHUNK_HEAD.size)
        packed, = struct.unpack_from('<Q', record, end)
        start = end + 8
        inner = _decompressed(compression, record[start:start + packed])
        for kind, content in _records(io.BytesIO(inner)):
            yield from self._take(kind, content)
        if len(record) < start + packed:
            raise CutOff


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """
    Yield the kind and the content of each record to the end.

    Of a chunk that is cut off what there is comes last. Raises `CutOff` after what is complete.
    """
    while head := file.read(HEAD.size):
        if len(head) < HEAD.size:
            raise CutOff
        kind, length = HEAD.unpack(head)
        if length > LONGEST:
            raise CutOff
        content = file.read(length)
        if len(content) == length or kind == CHUNK:
            yield kind, content
        if len(content) < length:
            raise CutOff


def _text(record: bytes, start: int) -> tuple[str, int]:
    """Return a text in a record, and where it ends."""
    length, = struct.unpack_from('<I', record, start)
    end = start + 4 + length
    if end > len(record):
        raise CutOff
    return record[start + 4:end].decode(), end


def _decompressed(name: str, data: bytes) -> bytes:
    """Return what a chunk has in it; of one that is cut off, as much as can be known."""
    if not name:
        return data
    if name not in DECOMPRESSORS:
        raise CutOff
    try:
        return DECOMPRESSORS[name](data)
    except (ImportError, MemoryError):
        raise
    except Exception as error:
        # Each library has errors of its own for data that are damaged.
        raise CutOff from error


def _from_zstd(data: bytes) -> bytes:
    """Decompress what Zstandard compressed."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd.ZstdDecompressor().decompress(data)


def _from_lz4(data: bytes) -> bytes:
    """Decompress what LZ4 compressed."""
    from lz4.frame import LZ4FrameDecompressor
    return bytes(LZ4FrameDecompressor().decompress(data))


DECOMPRESSORS = {'zstd': _from_zstd, 'lz4': _from_lz4}

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Sequential reader of MCAP files, as far as they are intact."""

from collections.abc import Callable, Iterator
import io
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple

from tp_controller.errors import TpControllerError
from tp_controller.tools.recording.expansion import Budget, CHUNK_BYTES, expanded, TooMuch

MAGIC = b'\x89MCAP0\r\n'
# Opcodes of records (mcap.dev/spec).
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 2, 3, 4, 5, 6, 15
HEAD = struct.Struct('<BQ')
# Header of a message: channel, number, times of receipt and of publication [ns].
MESSAGE_HEAD = struct.Struct('<HIQQ')
# Header of a chunk: times, size and checksum of its content.
CHUNK_HEAD = struct.Struct('<QQQI')
# Longest record of each kind that is read [bytes]; other kinds are skipped.
READ = {FOOTER: CHUNK_BYTES, SCHEMA: 1 << 20, CHANNEL: 1 << 20, MESSAGE: CHUNK_BYTES,
        CHUNK: CHUNK_BYTES, DATA_END: CHUNK_BYTES}
# Longest name of a topic or type [bytes].
LONGEST_NAME = 1000


class Raw(NamedTuple):
    """
    Message of a bag, not decoded.

    Attributes
    ----------
    topic, kind : str
        Names of the topic and of its type.
    stamp : int
        Time of receipt [ns].
    data : bytes
        Content in CDR.

    """

    topic: str
    kind: str
    stamp: int
    data: bytes


class Damaged(Exception):
    """The file ends or is damaged here, after the messages that were yielded."""


# Of each channel: topic and type; None for channels not in CDR.
Channels = dict[int, tuple[str, str] | None]


def mcap_messages(path: Path, advance: Callable[[float], object]) -> Iterator[Raw]:
    """
    Yield all messages in the order of a file.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    advance : callable
        Called with the number of bytes read since the last call.

    Raises
    ------
    TpControllerError
        The file is not an MCAP file.
    Damaged
        It is truncated or damaged.

    """
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise TpControllerError(f'{path} is not an MCAP file')
        position, budget = file.tell(), Budget(path)
        schemas: dict[int, str] = {}
        channels: Channels = {}
        try:
            for kind, record in _records(file, position):
                if kind in (DATA_END, FOOTER):
                    # The rest is an index.
                    advance(path.stat().st_size - position)
                    return
                if kind == CHUNK:
                    yield from _chunk(record, schemas, channels, budget)
                else:
                    yield from _message(kind, record, schemas, channels)
                advance(file.tell() - position)
                position = file.tell()
        except (Damaged, TooMuch, struct.error, ValueError):
            # The complete records before were yielded.
            pass
        raise Damaged(f'{path.name} is cut off, or damaged, after {position} bytes')


def _message(kind: int, record: bytes, schemas: dict[int, str],
             channels: Channels) -> Iterator[Raw]:
    """Yield a message, or store a schema or channel."""
    if kind == MESSAGE:
        channel, _, stamp, _ = MESSAGE_HEAD.unpack_from(record)
        known = channels.get(channel)
        if known is not None:
            yield Raw(*known, stamp, record[MESSAGE_HEAD.size:])
    elif kind == SCHEMA:
        number, = struct.unpack_from('<H', record)
        schemas[number] = _text(record, 2)[0][:LONGEST_NAME + 1]
    elif kind == CHANNEL:
        number, schema = struct.unpack_from('<HH', record)
        topic, end = _text(record, 4)
        encoding, _ = _text(record, end)
        name = schemas.get(schema, '')
        channels[number] = (topic, name) \
            if encoding == 'cdr' and max(len(topic), len(name)) <= LONGEST_NAME else None
    elif kind == CHUNK:
        # Chunks within chunks are not allowed.
        raise Damaged


def _chunk(record: bytes, schemas: dict[int, str], channels: Channels,
           budget: Budget) -> Iterator[Raw]:
    """Yield the messages in a chunk, as far as it can be read."""
    _, _, size, _ = CHUNK_HEAD.unpack_from(record)
    compression, end = _text(record, CHUNK_HEAD.size)
    packed, = struct.unpack_from('<Q', record, end)
    start = end + 8
    inner = expanded(compression, memoryview(record)[start:start + packed], size)
    budget.take(len(inner))
    for kind, content in _records(io.BytesIO(inner)):
        yield from _message(kind, content, schemas, channels)
    if len(record) < start + packed:
        raise Damaged


def _records(file: BinaryIO, position: int = 0) -> Iterator[tuple[int, bytes]]:
    """
    Yield the kind and the content of each relevant record.

    A truncated chunk is yielded last, as far as it can be read. `Damaged` is raised after the last
    complete record.
    """
    end = file.seek(0, io.SEEK_END)
    file.seek(position)
    while head := file.read(HEAD.size):
        if len(head) < HEAD.size:
            raise Damaged
        kind, length = HEAD.unpack(head)
        if kind not in READ:
            # Kind 0 does not exist: it marks a hole in the file.
            if not kind or length > end - file.tell():
                raise Damaged
            file.seek(length, io.SEEK_CUR)
            continue
        if length > READ[kind]:
            raise Damaged
        content = file.read(length)
        if len(content) == length or kind == CHUNK:
            yield kind, content
        if len(content) < length:
            raise Damaged


def _text(record: bytes, start: int) -> tuple[str, int]:
    """Return a text in a record, and the position of its end."""
    length, = struct.unpack_from('<I', record, start)
    end = start + 4 + length
    if end > len(record):
        raise Damaged
    return record[start + 4:end].decode(), end

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of the SQLite files of bags, for untrusted data."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
import sqlite3

from tp_controller.tools.recording.expansion import Budget, CHUNK_BYTES, expanded, TooMuch
from tp_controller.tools.recording.mcap import Damaged, LONGEST_NAME, Raw

# Smallest size of a message in a file [bytes].
MESSAGE_OVERHEAD = 8
# Largest number of topics.
MOST_TOPICS = 65_536
TABLES = ('topics', 'messages')
TOPICS = 'SELECT id, name, type, serialization_format FROM topics LIMIT ?'
# In the order of writing: sorting would take as much memory as the messages.
MESSAGES = 'SELECT topic_id, timestamp, data FROM messages WHERE length(data) <= ? ORDER BY rowid'


def sqlite_messages(path: Path, compressed: bool,
                    advance: Callable[[float], object]) -> Iterator[Raw]:
    """
    Yield all messages in the order of a file.

    Parameters
    ----------
    path : pathlib.Path
        The file.
    compressed : bool
        Whether each message is compressed by Zstandard.
    advance : callable
        Called with the number of bytes read since the last call.

    Raises
    ------
    Damaged
        The file is truncated or damaged.

    """
    try:
        with closing(_opened(path)) as database:
            yield from _rows(path, database, compressed, advance)
    except (sqlite3.Error, TooMuch, ValueError, OverflowError) as error:
        raise Damaged(f'{path.name} is cut off or damaged' + (f': {error}' if str(error) else '')
                      ) from error


def _rows(path: Path, database: sqlite3.Connection, compressed: bool,
          advance: Callable[[float], object]) -> Iterator[Raw]:
    """Yield the messages of a database."""
    size = path.stat().st_size
    _check_tables(database)
    topics = {number: (str(topic), str(kind))
              for number, topic, kind, form in database.execute(TOPICS, (MOST_TOPICS,))
              if form == 'cdr' and max(len(str(topic)), len(str(kind))) <= LONGEST_NAME}
    budget, left, read = Budget(path), size // MESSAGE_OVERHEAD, 0
    for number, stamp, data in database.execute(MESSAGES, (CHUNK_BYTES,)):
        left -= 1
        if left < 0:
            # Pages of a damaged file may form a cycle.
            raise TooMuch
        if number not in topics or not isinstance(stamp, int) or not isinstance(data, bytes):
            continue
        step = min(len(data) + MESSAGE_OVERHEAD, size - read)
        read += step
        if compressed:
            data = bytes(expanded('zstd', data, CHUNK_BYTES))
        budget.take(len(data) + MESSAGE_OVERHEAD)
        yield Raw(*topics[number], stamp, data)
        advance(step)
    advance(size - read)


def _opened(path: Path) -> sqlite3.Connection:
    """Return a database that is read-only and executes nothing in the file."""
    database = sqlite3.connect(f'{path.resolve().as_uri()}?immutable=1', uri=True)
    database.text_factory = lambda data: data.decode(errors='replace')
    database.execute('PRAGMA trusted_schema = OFF')
    if hasattr(database, 'setlimit'):
        # Available from Python 3.11 on.
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, CHUNK_BYTES)
    return database


def _check_tables(database: sqlite3.Connection) -> None:
    """Raise ValueError unless the messages are in plain tables."""
    for table in TABLES:
        found = database.execute('SELECT type, sql FROM sqlite_master WHERE name = ?',
                                 (table,)).fetchone()
        if found is None or found[0] != 'table' or 'virtual' in str(found[1]).lower():
            raise ValueError(f'no table {table}')
        if any(hidden for *_, hidden in database.execute(f'PRAGMA table_xinfo({table})')):
            raise ValueError(f'table {table} is computed')

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings of anybody are read in bounded memory and time, whatever they claim."""

import os
import sqlite3
import struct
import sys
import time
import tracemalloc

import numpy as np
import pytest
import recordings
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from tp_controller.errors import TpControllerError
from tp_controller.tools.recording import (
    expansion,
    history,
    mcap,
    motion,
    reader,
    sqlite,
    task_history,
)
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.reader import Bag, Unreadable

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

lz4 = pytest.importorskip('lz4.frame')

MAGIC = mcap.MAGIC
# What reading may take, of the processor alone [s], and beside what is read [bytes].
SOON, LITTLE = 10.0, 100_000_000
HUGE = 1 << 27
STATUS = '/tp_controller/status'


def record(kind, content, length=None):
    """Return a record, which may claim another length."""
    return struct.pack('<BQ', kind, len(content) if length is None else length) + content


def text(content):
    """Return a text of a record."""
    return struct.pack('<I', len(content)) + content.encode()


def chunk(compression, packed, size):
    """Return a chunk that claims to have a size."""
    return record(mcap.CHUNK, struct.pack('<QQQI', 0, 0, size, 0) + text(compression)
                  + struct.pack('<Q', len(packed)) + packed)


def packed(compression, data):
    """Return compressed data."""
    return {'zstd': zstd.compress, 'lz4': lz4.compress, '': bytes}[compression](data)


END = record(mcap.DATA_END, b'')


def channel(topic='/text', kind='std_msgs/msg/String'):
    """Return the records that come before messages."""
    return (record(mcap.SCHEMA, struct.pack('<H', 1) + text(kind) + text('ros2msg') + text(''))
            + record(mcap.CHANNEL, struct.pack('<HH', 1, 1) + text(topic) + text('cdr')
                     + struct.pack('<I', 0)))


def message(data=b'', stamp=5):
    """Return the record of a message."""
    return record(mcap.MESSAGE, struct.pack('<HIQQ', 1, 0, stamp, stamp) + data)


def read(path):
    """Read a recording within bounds; return how many messages it has, and remarks."""
    tracemalloc.start()
    began = time.thread_time()
    try:
        bag = Bag(path)
        count = sum(1 for _ in bag.messages(lambda size: None))
        assert tracemalloc.get_traced_memory()[1] < 3 * expansion.CHUNK_BYTES + LITTLE
    finally:
        tracemalloc.stop()
    assert time.thread_time() - began < SOON
    return count, bag.remarks


@pytest.fixture
def write(tmp_path):
    """Return a function that writes an MCAP file."""
    def write(*parts):
        path = tmp_path / 'run.mcap'
        path.write_bytes(b''.join((MAGIC, *parts)))
        return path

    return write


@pytest.mark.parametrize('compression', ['', 'zstd', 'lz4'])
def test_a_chunk_is_read_as_it_says(write, compression):
    inner = message(bytes(1000)) * 3
    path = write(channel(), chunk(compression, packed(compression, inner), len(inner)),
                 END)
    assert read(path) == (3, [])


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
@pytest.mark.parametrize('claimed', [0, 1000, HUGE, 1 << 63])
@pytest.mark.slow
def test_a_chunk_that_becomes_more_than_is_read_is_refused(write, compression, claimed):
    data = message(bytes(HUGE))
    path = write(channel(), message(), chunk(compression, packed(compression, data), claimed))
    assert path.stat().st_size < 2_000_000
    count, remarks = read(path)
    assert count == 1 and 'is cut off, or damaged' in remarks[0]


def test_many_chunks_become_no_more_than_a_multiple_of_the_file(write, monkeypatch):
    monkeypatch.setattr(expansion, 'EXTRA_BYTES', 10_000_000)
    data = message(bytes(4_000_000))
    one = chunk('zstd', packed('zstd', data), len(data))
    count, remarks = read(write(channel(), one * 100))
    assert 0 < count < 10 and remarks


def test_holes_do_not_add_to_what_chunks_may_become(write, monkeypatch):
    monkeypatch.setattr(expansion, 'EXTRA_BYTES', 10_000_000)
    data = message(bytes(4_000_000))
    path = write(channel(), chunk('zstd', packed('zstd', data), len(data)) * 100)
    os.truncate(path, 60 << 30)
    count, remarks = read(path)
    assert 0 < count < 10 and remarks


def test_a_small_file_becomes_no_more_than_is_decoded_within_a_minute(write):
    data = message(bytes(4_000_000))
    path = write(channel(), chunk('zstd', packed('zstd', data), len(data)) * 400)
    count, remarks = read(path)
    assert 0 < count * len(data) < 300_000_000 + 200 * path.stat().st_size and remarks


def test_chunks_within_chunks_are_refused(write):
    nested = message()
    for _ in range(3000):
        nested = chunk('', nested, len(nested))
    count, remarks = read(write(channel(), message(), nested))
    assert count == 1 and remarks


@pytest.mark.parametrize('kind', [0, 1, 9, mcap.MESSAGE, mcap.CHUNK, mcap.SCHEMA, 200])
@pytest.mark.parametrize('length', [0, 1 << 30, 60 << 30, 1 << 63])
def test_a_file_with_holes_is_read_soon(write, kind, length):
    path = write(channel(), message(), record(kind, b'', length))
    os.truncate(path, 60 << 30)
    count, remarks = read(path)
    assert count == 1 and remarks


def test_records_of_no_use_are_passed_over(write):
    other = record(200, bytes(1000))
    assert read(write(channel(), message(), other, message(), other, END)) == (2, [])
    count, remarks = read(write(channel(), message(), other, message(), other[:-1]))
    assert count == 2 and remarks


def test_names_are_bounded(write):
    count, remarks = read(write(channel('/' + 'x' * 5000), message(), channel('/b'), message(),
                                END))
    assert count == 1 and not remarks


@pytest.fixture
def database(tmp_path):
    """Return a function that writes an SQLite file from statements."""
    def database(*statements):
        path = tmp_path / 'run.db3'
        with sqlite3.connect(path) as connection:
            for statement in (
                    'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
                    'serialization_format TEXT)',
                    "INSERT INTO topics VALUES(1, '/text', 'std_msgs/msg/String', 'cdr')",
                    *statements):
                connection.execute(statement)
        connection.close()
        return path

    return database


TABLE = 'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data)'
ROW = "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 5, x'00')"


@pytest.mark.parametrize(('statements', 'found', 'fault'), [
    ([TABLE, ROW], 1, ''),
    # Rows that are computed, without end or huge.
    (['CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) '
      "SELECT i AS rowid, 1 AS topic_id, 5 AS timestamp, x'00' AS data FROM n"], 0, 'no table'),
    (['CREATE TABLE messages(topic_id, timestamp, data GENERATED ALWAYS AS '
      '(zeroblob(1000000000)))', 'INSERT INTO messages(topic_id, timestamp) VALUES(1, 5)'],
     0, 'computed'),
    ([TABLE, 'INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 5, zeroblob(100000000))',
      ROW], 1, None),
    # Of other types than they should be.
    ([TABLE, "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 'x', x'00')",
      "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 5, 'text')",
      'INSERT INTO messages(topic_id, timestamp, data) VALUES(1, NULL, NULL)',
      "INSERT INTO messages(topic_id, timestamp, data) VALUES(9, 5, x'00')", ROW], 1, ''),
    ([], 0, 'no table')])
def test_an_sqlite_file_is_read_within_bounds(database, statements, found, fault):
    count, remarks = read(database(*statements))
    assert (count == found or fault is None) and bool(remarks) == bool(fault or fault is None
                                                                       and remarks)
    assert not fault or fault in remarks[0]


def test_an_sqlite_file_with_more_rows_than_fit_into_it_is_left(database, monkeypatch):
    monkeypatch.setattr(sqlite, 'MESSAGE_OVERHEAD', 1000)
    count, remarks = read(database(TABLE, *[ROW] * 100))
    assert 0 < count < 100 and remarks


def test_an_sqlite_file_whose_messages_become_too_much_is_refused(tmp_path):
    with_bomb = tmp_path / 'run'
    writer = Writer(with_bomb, version=9, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection('/text', 'std_msgs/msg/String',
                                           typestore=recordings.STORE)
        writer.write(connection, 1, bytes(100))
        writer.write(connection, 2, bytes(HUGE))
    count, remarks = read(with_bomb)
    assert count == 1 and remarks


def test_a_description_of_blank_lines_is_read_soon(database):
    path = database(TABLE, ROW).parent
    (path / 'metadata.yaml').write_text('\n' * 300_000 + '  compression_mode: none')
    assert read(path) == (1, [])


def test_files_are_sorted_by_their_numbers_whatever_else_is_in_their_names(tmp_path):
    names = ['²1.mcap', '²³.mcap', '٣.mcap', 'run_10.mcap', 'run_2.mcap', '1.mcap']
    for name in names:
        (tmp_path / name).write_bytes(MAGIC + END)
    found = [file.name for file in reader._files(tmp_path)]
    assert sorted(found) == sorted(names)
    assert found.index('run_2.mcap') < found.index('run_10.mcap')


def test_what_is_no_regular_file_is_not_waited_for(write):
    path = write(channel(), message(), END)
    os.mkfifo(path.with_name('run_1.mcap'))
    assert read(path.parent)[0] == 1
    os.mkfifo(path.with_name('metadata.yaml'))
    assert not Bag(path.parent)._is_compressed
    with pytest.raises(TpControllerError, match='not a regular file'):
        Bag(path.with_name('run_1.mcap'))


def test_a_message_that_is_too_long_is_not_decoded(write):
    bag = Bag(write(channel(), message(bytes(reader.MESSAGE_BYTES + 1))))
    raw, = bag.messages(lambda size: None)
    with pytest.raises(Unreadable, match='too long'):
        bag.decode(raw)


def histories(tmp_path, rows):
    """Return the history of a recording, and how much memory it takes [bytes]."""
    path = recordings.write(tmp_path / 'run', rows)
    tracemalloc.start()
    try:
        found = History(Bag(path), '', lambda size: None)
        return found, tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_what_is_kept_of_a_recording_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(history, 'MOST_TOPICS_OF_A_KIND', 5)
    monkeypatch.setattr(motion, 'MOST_NAME_LISTS', 5)
    node = 'tp_controller'

    def rows():
        yield 0.0, STATUS, recordings.status(node)
        for number in range(12):
            now = 0.05 * number
            yield now, STATUS, recordings.status(node, **{
                f'task{number}_{each}': {f'error [{unit}]': 1.0 for unit in range(20)}
                | {'reason': f'{number} {each} ' + 'x' * 5000} for each in range(20)})
            names = [f'joint{number}_{each}' for each in range(200)]
            yield now, '/joint_states', recordings.joint_state(np.zeros(200), names)
            yield now, f'/commands{number}', recordings.numbers(np.zeros(400))
            yield now, f'/{number}/robot_description', recordings.text('x' * 10_000)
            yield now, '/parameter_events', recordings.parameters(
                node, **{f'value{number}': 'y' * 1_000_000})
            yield now, f'/{node}/task/goal', recordings.joint_state(np.zeros(1000), [
                'z' * 100] * 1000)

    found, memory = histories(tmp_path, rows())
    assert len(found.tasks) == history.MOST_TASKS
    assert all(len(task.errors) <= task_history.MOST_ERRORS for task in found.tasks.values())
    assert len(found.curves.columns) <= history.MOST_TASKS * task_history.MOST_ERRORS
    assert all(len(moment.joints) <= motion.MOST_JOINTS for moment in found.motion.moments)
    assert sum(map(len, found.commands.values())) <= history.MOST_COMMANDS
    assert len(found.descriptions) <= history.MOST_TOPICS_OF_A_KIND
    assert sum(map(len, found.parameters.values())) <= history.LONGEST_PARAMETERS
    assert all(len(goal.text) < 2100 for goal in found.goals.goals)
    assert all(len('; '.join(causes)) < 2100 for causes in found.curves.sets)
    assert memory < LITTLE


def test_the_markers_of_the_moments_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(motion, 'MOST_MARKER_BYTES', 100_000)
    kind = recordings.STORE.types['visualization_msgs/msg/MarkerArray']

    def rows():
        yield 0.0, STATUS, recordings.status('tp_controller')
        for number in range(200):
            marker = recordings.make(
                'visualization_msgs/msg/Marker', recordings.header(), 'x' * 10_000, 0, 0, 0,
                POSE, SCALE, COLOUR, recordings.make('builtin_interfaces/msg/Duration', 0, 0),
                False, [], [], '', recordings.make(
                    'sensor_msgs/msg/CompressedImage', recordings.header(), '',
                    np.empty(0, np.uint8)), [], '', '', recordings.make(
                        'visualization_msgs/msg/MeshFile', '', np.empty(0, np.uint8)), False)
            yield 0.1 * number, '/tp_controller/markers', kind([marker])
            yield 0.1 * number, '/joint_states', recordings.joint_state([0.0, 0.0, 0.0])

    found, _ = histories(tmp_path, rows())
    kept = {id(moment.markers): len(moment.markers.data) for moment in found.motion.moments}
    assert len(found.motion.moments) > 2 and sum(kept.values()) <= 100_000


POSE = recordings.make('geometry_msgs/msg/Pose',
                       recordings.make('geometry_msgs/msg/Point', 0.0, 0.0, 0.0),
                       recordings.make('geometry_msgs/msg/Quaternion', 0.0, 0.0, 0.0, 1.0))
SCALE = recordings.make('geometry_msgs/msg/Vector3', 1.0, 1.0, 1.0)
COLOUR = recordings.make('std_msgs/msg/ColorRGBA', 1.0, 1.0, 1.0, 1.0)

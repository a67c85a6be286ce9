# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings are read as far as they go, whoever wrote them, and wherever they were cut off."""

import shutil

import pytest
import recordings
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from tp_controller import TpControllerError
from tp_controller.tools.recording.reader import Bag, Unreadable
from tp_controller.tools.recording.writer import BagWriter


def messages(path):
    """Return all messages, and what is wrong with the recording."""
    bag = Bag(path)
    return list(bag.messages(lambda size: None)), bag.remarks


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return a recording."""
    return recordings.write(tmp_path_factory.mktemp('bags') / 'run', recordings.run())


def rewritten(run, path, storage=StoragePlugin.MCAP, mode=CompressionMode.NONE):
    """Write the messages of a recording again, in another form; return its folder."""
    with Reader(run) as reader:
        writer = Writer(path, version=9, storage_plugin=storage)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connections = {old.topic: writer.add_connection(
                old.topic, old.msgtype, typestore=recordings.STORE)
                for old in reader.connections}
            for connection, stamp, data in reader.messages():
                writer.write(connections[connection.topic], stamp, data)
    return path


def test_what_is_written_is_what_another_library_reads(run):
    ours, remarks = messages(run)
    with Reader(run) as reader:
        theirs = [(connection.topic, connection.msgtype, stamp, bytes(data))
                  for connection, stamp, data in reader.messages()]
    # The other one sorts by time, too.
    assert not remarks and sorted(ours) == sorted(theirs) and len(ours) > 400


@pytest.mark.parametrize(('storage', 'mode'), [
    (StoragePlugin.MCAP, CompressionMode.NONE), (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE)])
def test_recordings_in_other_forms_are_read(run, tmp_path, storage, mode):
    found, remarks = messages(rewritten(run, tmp_path / 'again', storage, mode))
    assert not remarks and sorted(found) == sorted(messages(run)[0])


@pytest.mark.slow
@pytest.mark.parametrize('mode', [CompressionMode.NONE, CompressionMode.STORAGE])
def test_a_file_that_is_cut_off_anywhere_is_read_as_far_as_it_goes(run, tmp_path, mode):
    file = next(rewritten(run, tmp_path / 'again', mode=mode).glob('*.mcap'))
    whole, _ = messages(file)
    content, counts = file.read_bytes(), []
    for end in range(8, len(content), max(len(content) // 150, 1)):
        file.write_bytes(content[:end])
        found, remarks = messages(file)
        counts.append(len(found))
        assert found == whole[:len(found)]
        assert remarks or len(found) == len(whole), end
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == len(whole)
    # What is in a chunk that is cut off counts, too; what is compressed needs blocks of it.
    assert mode is not CompressionMode.NONE or len(set(counts)) > 100


def test_a_file_that_is_damaged_in_the_middle_is_read_up_to_there(run, tmp_path):
    file = next(rewritten(run, tmp_path / 'again').glob('*.mcap'))
    whole, _ = messages(file)
    content = file.read_bytes()
    for place in range(100, len(content), len(content) // 40):
        file.write_bytes(content[:place] + bytes(40) + content[place + 40:])
        found, _ = messages(file)
        assert len(found) <= len(whole)


def test_a_recorder_that_is_killed_loses_what_came_since_the_last_flush_only(tmp_path):
    bag = BagWriter(tmp_path / 'run')
    kind = 'std_msgs/msg/String'
    data = bytes(recordings.STORE.serialize_cdr(recordings.text('a'), kind))
    for number in range(10):
        bag.write('/text', kind, number, data)
        if number == 6:
            bag.flush()
    shutil.copytree(bag.path, tmp_path / 'killed')
    bag.close()
    found, remarks = messages(tmp_path / 'killed')
    assert [raw.stamp for raw in found] == list(range(7))
    assert any('was not ended' in remark for remark in remarks)
    assert len(messages(tmp_path / 'run')[0]) == 10


def test_what_is_not_encoded_as_ros_messages_are_is_left_out(tmp_path):
    with Writer(tmp_path / 'run', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, encoding in (('/json', 'json'), ('/text', 'cdr')):
            connection = writer.add_connection(topic, 'std_msgs/msg/String', serialization_format=(
                encoding), typestore=recordings.STORE)
            writer.write(connection, 5, b'{}')
    assert [raw.topic for raw in messages(tmp_path / 'run')[0]] == ['/text']


def test_files_of_a_split_recording_are_read_in_their_order(run, tmp_path):
    for number in (0, 1, 2, 10):
        shutil.copy(run / 'run.mcap', tmp_path / f'run_{number}.mcap')
    assert [path.name for path in Bag(tmp_path)._files] == [
        'run_0.mcap', 'run_1.mcap', 'run_2.mcap', 'run_10.mcap']


def test_progress_adds_up_to_the_size_of_the_files(run):
    bag, read = Bag(run), []
    for _ in bag.messages(read.append):
        pass
    assert sum(read) == pytest.approx(bag.size, abs=20)


def test_a_message_that_is_damaged_is_named(run):
    bag = Bag(run)
    raw = next(raw for raw in bag.messages(lambda size: None) if 'joint' in raw.topic)
    for damaged in (raw._replace(data=raw.data[:-5]), raw._replace(kind='some_msgs/msg/Text')):
        with pytest.raises(Unreadable, match='/joint_states'):
            bag.decode(damaged)


@pytest.mark.parametrize(('name', 'content', 'fault'), [
    ('missing', None, 'there is no '),
    ('text.txt', b'text', 'is not a recording'),
    ('folder/notes.txt', b'text', 'no recording in'),
    ('folder/run.db3.zstd', b'', 'compressed as a whole')])
def test_what_is_no_recording_is_refused(tmp_path, name, content, fault):
    path = tmp_path / name
    if content is not None:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    path = path.parent if path.parent != tmp_path else path
    with pytest.raises(TpControllerError, match=fault):
        Bag(path)


def test_a_file_of_another_format_is_refused(tmp_path):
    path = tmp_path / 'run.mcap'
    path.write_bytes(b'0123456789')
    with pytest.raises(TpControllerError, match='is not an MCAP file'):
        messages(path)
    path = path.rename(tmp_path / 'run.db3')
    assert 'cut off or damaged' in messages(path)[1][0]


def test_an_existing_folder_is_not_written(tmp_path):
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'notes').write_text('mine')
    with pytest.raises(TpControllerError, match='exists already'):
        BagWriter(tmp_path / 'run')
    assert [path.name for path in (tmp_path / 'run').iterdir()] == ['notes']
    (tmp_path / 'file').write_text('mine')
    with pytest.raises(TpControllerError, match='cannot be written'):
        BagWriter(tmp_path / 'file' / 'run')


def test_quality_of_service_is_told(tmp_path):
    bag = BagWriter(tmp_path / 'run')
    never = QosTime(9223372036, 854775807)
    offered = Qos(QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
                  never, never, QosLiveliness.AUTOMATIC, never, False)
    kind = 'std_msgs/msg/String'
    bag.write('/text', kind, 5, bytes(recordings.STORE.serialize_cdr(recordings.text('a'), kind)),
              [offered])
    bag.close()
    with Reader(tmp_path / 'run') as reader:
        assert reader.connections[0].ext.offered_qos_profiles == [offered]

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller record`` as a process: how it ends, and what is there then."""

import signal
import subprocess
import sys
import time
from types import SimpleNamespace

from processes_harness import command_line, DEADLINE
import pytest
from rosbags.rosbag2 import Reader
from tp_controller.tools.cli.record import _write
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.reader import Bag


@pytest.fixture
def record(domain, tmp_path):
    """Return what starts a recorder in a folder of its own; all are killed at last."""
    started = []

    def record(*arguments):
        process = subprocess.Popen(
            [sys.executable, '-m', 'tp_controller', 'record', *arguments], cwd=tmp_path,
            env=domain, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield record
    for process in started:
        process.kill()
        process.communicate()


def wait_for_file(path, size):
    """Wait until a file is so large."""
    end = time.monotonic() + DEADLINE
    while not path.is_file() or path.stat().st_size < size:
        assert time.monotonic() < end, f'{path} did not grow'
        time.sleep(0.02)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_recording_with_a_whole_file(cell, record, tmp_path, number):
    process = record('run')
    wait_for_file(tmp_path / 'run' / 'run.mcap', 20_000)
    process.send_signal(number)
    # An impatient user.
    process.send_signal(number)
    out, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 0 and not err
    started, told = out.splitlines()
    assert started == 'recording /tp_controller to run; Ctrl-C ends it'
    with Reader(tmp_path / 'run') as reader:
        count = reader.message_count
        for connection in reader.connections:
            assert f'{connection.topic} {connection.msgcount}' in told
    assert told.startswith('run: ') and f' {count} messages, ' in told and ' 0 lost: ' in told
    bag = Bag(tmp_path / 'run')
    assert list(History(bag, '', lambda size: None).tasks) == ['swing'] and not bag.remarks


def test_it_says_that_it_records_once_it_does(capsys, tmp_path):
    said = []
    recorder = SimpleNamespace(controllers=['arm'],
                               record=lambda bag: said.append(capsys.readouterr().out))
    bag = SimpleNamespace(path=tmp_path, counts={}, close=list)
    _write(recorder, bag, 0.0, [])
    assert said == ['', f'recording /arm to {tmp_path}; Ctrl-C ends it\n']


def test_what_a_killed_recorder_has_written_is_plotted(cell, domain, record, tmp_path,
                                                       monkeypatch):
    process = record('run')
    wait_for_file(tmp_path / 'run' / 'run.mcap', 60_000)
    process.kill()
    process.communicate(timeout=DEADLINE)
    monkeypatch.chdir(tmp_path)
    code, out, err = command_line(domain, 'plot', 'run')
    assert code == 0 and 'the recording was not ended' in err and 'cut off' in err
    assert 'swing' in out and 'errors.png' in out


def test_a_recording_ends_after_its_time(cell, record, tmp_path):
    process = record('--for', '0.5', 'run.mcap')
    out, _ = process.communicate(timeout=2.0 * DEADLINE)
    assert process.returncode == 0 and 'run: ' in out
    assert sorted(path.name for path in (tmp_path / 'run').iterdir()) == [
        'metadata.yaml', 'run.mcap']


def test_an_existing_folder_is_left_alone(domain, tmp_path, monkeypatch):
    (tmp_path / 'run').mkdir()
    monkeypatch.chdir(tmp_path)
    code, _, err = command_line(domain, 'record', 'run')
    assert code == 1 and 'run exists already, and stays as it is' in err
    assert list((tmp_path / 'run').iterdir()) == []


def test_without_a_controller_nothing_is_written(domain, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = command_line(domain, 'record', 'run', '--wait', '0.5')
    assert code == 1 and 'no node with tasks is running' in err
    code, _, err = command_line(domain, 'record', '--node', '/left/arm', '--wait', '0.5')
    assert code == 1 and 'no node /left/arm with tasks is running' in err
    assert list(tmp_path.iterdir()) == []

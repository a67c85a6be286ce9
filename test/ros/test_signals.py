# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Signals wait for the message that is being handled, and end what hangs."""

import importlib
import os
import signal
import subprocess
import sys
import threading
import time

from harness import DEADLINE
import pytest
from std_msgs.msg import String
from tp_controller.ros import signals as interruption
from tp_controller.ros.client.client import Client
from tp_controller.ros.signals import SignalWatch, uninterrupted


@pytest.fixture(autouse=True)
def handlers():
    """Let both signals raise, as in a command, and put back what was there."""
    before = {number: signal.signal(number, handler) for number, handler in
              ((signal.SIGINT, signal.default_int_handler),
               (signal.SIGTERM, lambda number, _: sys.exit(128 + number)))}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize('number, raised', [(signal.SIGINT, KeyboardInterrupt),
                                            (signal.SIGTERM, SystemExit)])
def test_a_signal_waits_for_the_end(number, raised):
    done = []
    with pytest.raises(raised):
        with uninterrupted():
            signal.raise_signal(number)
            done.append(True)
    assert done
    # Afterwards it raises at once again.
    with pytest.raises(raised):
        signal.raise_signal(number)


def test_a_signal_during_an_import_that_takes_it_for_an_error_is_not_lost(monkeypatch, tmp_path):
    (tmp_path / 'trimesh.py').write_text(
        'import signal\ntry:\n    signal.raise_signal(signal.SIGINT)\n'
        'except BaseException:\n    pass\n')
    monkeypatch.syspath_prepend(tmp_path)
    for name in ('trimesh', 'tp_controller.tools.view.meshes'):
        # Set first, so that what is imported here is forgotten where nothing was there before.
        monkeypatch.setitem(sys.modules, name, None)
        del sys.modules[name]
    with pytest.raises(KeyboardInterrupt):
        importlib.import_module('tp_controller.tools.view.meshes')


def test_a_signal_while_a_mesh_is_loaded_is_not_lost(monkeypatch, tmp_path):
    meshes = pytest.importorskip('tp_controller.tools.view.meshes')

    def load_scene(path):
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            pass
        raise OSError('not read')

    monkeypatch.setattr(meshes.trimesh, 'load_scene', load_scene)
    path = tmp_path / 'cube.stl'
    path.touch()
    with pytest.raises(KeyboardInterrupt):
        meshes.load_mesh(path)


def test_a_signal_after_an_error_is_not_lost():
    with pytest.raises(KeyboardInterrupt) as caught:
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            raise ValueError('a message that cannot be read')
    assert isinstance(caught.value.__context__, ValueError)


def test_another_thread_has_no_handlers_to_hold_back():
    entered = []

    def enter():
        with uninterrupted():
            entered.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert entered == [signal.default_int_handler]


def take_again_and_again(client):
    end = time.monotonic() + DEADLINE
    while time.monotonic() < end:
        client.catch_up()


@pytest.mark.parametrize('take', [lambda client: client.wait(lambda: False, DEADLINE),
                                  take_again_and_again])
def test_a_client_handles_the_message_that_it_took(harness, take):
    heard = []
    with Client(context=harness.context) as client:

        def on_message(message):
            signal.raise_signal(signal.SIGINT)
            heard.append(message.data)

        client.node.create_subscription(String, '/news', on_message, 10)
        publisher = harness.node.create_publisher(String, '/news', 10)
        assert client.wait(lambda: publisher.get_subscription_count() > 0, DEADLINE)
        publisher.publish(String(data='first'))
        with pytest.raises(KeyboardInterrupt):
            take(client)
        assert heard == ['first']


# Watched by a thread ------------------------------------------------------------------------

STATUS = 7
# Deadlocks in C code that no signal interrupts.
HANGING_COMMAND = """
import ctypes, sys
from tp_controller.tools.cli import main
from tp_controller.tools.cli import status
def hang(options):
    print('hangs', flush=True)
    lock, library = ctypes.create_string_buffer(64), ctypes.CDLL(None)
    library.pthread_mutex_lock(lock), library.pthread_mutex_lock(lock)
main.COMMANDS['status'] = status.COMMAND._replace(run=hang)
sys.exit(main.main(['status']))
"""


@pytest.fixture
def forced(monkeypatch):
    """Let both signals do nothing; return the exit statuses that end the process by force."""
    statuses = []
    monkeypatch.setattr(os, '_exit', statuses.append)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    return statuses


def wait_for(statuses):
    """Wait until the process would have ended by force."""
    end = time.monotonic() + DEADLINE
    while not statuses:
        assert time.monotonic() < end
        time.sleep(0.001)


def started(**options):
    """Return a watch that has been started."""
    watch = SignalWatch((signal.SIGINT, signal.SIGTERM), STATUS, **options)
    watch.start()
    return watch


def test_the_first_signal_acts_on_another_thread_and_forces_nothing(forced):
    acts, acted = [], threading.Event()

    def act(number):
        acts.append((number, threading.current_thread() is threading.main_thread()))
        acted.set()

    watch = started(act=act)
    signal.raise_signal(signal.SIGTERM)
    assert acted.wait(DEADLINE)
    watch.close()
    assert acts == [(signal.SIGTERM, False)] and not forced


@pytest.mark.parametrize('act', [None, lambda number: threading.Event().wait()],
                         ids=['nothing', 'hangs'])
def test_a_further_signal_ends_the_process(forced, monkeypatch, act):
    monkeypatch.setattr(interruption, 'SIGNAL_REPEAT_SECONDS', 0.0)
    watch = started(act=act)
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGINT)
    wait_for(forced)
    watch.close()
    assert forced == [STATUS]


def test_a_signal_that_a_launch_repeats_at_once_leaves_time_to_end(forced, monkeypatch):
    monkeypatch.setattr(interruption, 'SIGNAL_REPEAT_SECONDS', 60.0)
    watch = started(limit=60.0)
    for _ in range(3):
        signal.raise_signal(signal.SIGINT)
    watch.close()
    assert not forced


def test_a_process_that_does_not_end_in_time_is_ended(forced, monkeypatch):
    monkeypatch.setattr(interruption, 'SIGNAL_REPEAT_SECONDS', 0.0)
    watch = started(limit=0.01)
    signal.raise_signal(signal.SIGINT)
    wait_for(forced)
    watch.close()
    assert forced == [STATUS]


def test_a_signal_that_waited_for_a_message_counts_once(forced, monkeypatch):
    monkeypatch.setattr(interruption, 'SIGNAL_REPEAT_SECONDS', 0.0)
    watch = started()
    with uninterrupted():
        signal.raise_signal(signal.SIGINT)
    watch.close()
    assert not forced


def test_other_signals_end_nothing(forced, monkeypatch):
    monkeypatch.setattr(interruption, 'SIGNAL_REPEAT_SECONDS', 0.0)
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    watch = started(limit=0.0)
    signal.raise_signal(signal.SIGUSR1)
    watch.close()
    signal.signal(signal.SIGUSR1, before)
    assert not forced


def test_a_second_ctrl_c_ends_a_command_that_hangs_in_c_code():
    command = subprocess.Popen([sys.executable, '-c', HANGING_COMMAND], stdout=subprocess.PIPE,
                               text=True)
    with command:
        assert command.stdout.readline() == 'hangs\n'
        end = time.monotonic() + DEADLINE
        while command.poll() is None and time.monotonic() < end:
            command.send_signal(signal.SIGINT)
            time.sleep(0.05)
        command.kill()
    # The first where a signal arrives after Python has given its own handler back.
    assert command.returncode in (-signal.SIGINT, 128 + signal.SIGINT)

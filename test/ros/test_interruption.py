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

"""Signals that end a command wait for the message that is being handled."""

import importlib
import signal
import sys
import threading
import time

from harness import DEADLINE
import pytest
from std_msgs.msg import String
from tp_controller.nodes.client import Client
from tp_controller.nodes.interruption import uninterrupted


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
    for name in ('trimesh', 'tp_controller.view.meshes'):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(KeyboardInterrupt):
        importlib.import_module('tp_controller.view.meshes')


def test_a_signal_while_a_mesh_is_loaded_is_not_lost(monkeypatch, tmp_path):
    meshes = pytest.importorskip('tp_controller.view.meshes')

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

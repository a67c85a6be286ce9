# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The runner, which spins a node until it ends."""

import os
import signal
import threading

from harness import DEADLINE
import pytest
from rclpy.exceptions import InvalidHandle
from tp_controller.ros import runner
from tp_controller.ros.middleware import VARIABLES
from tp_controller.ros.runner import _spin, ClosableNode, Ending, make_executor


class Spun(ClosableNode):
    """A node that has nothing to say."""

    def close(self, reason):
        """Say nothing."""


def node_with_a_timer(harness, callback):
    """Return a node that calls `callback` again and again."""
    node = Spun('spun', context=harness.context)
    node.create_timer(0.001, callback)
    return node


def test_a_signal_ends_the_spinning(harness):
    calls, ending = [], Ending('node')

    def tick():
        calls.append(1)
        if len(calls) == 10:
            ending.begin(signal.SIGINT)

    node = node_with_a_timer(harness, tick)
    _spin(node, ending)
    assert len(calls) >= 10
    node.destroy_node()


@pytest.mark.parametrize('hangs', [True, False])
def test_a_signal_that_waits_for_a_callback_is_logged(log, hangs):
    ending = Ending('node')
    if not hangs:
        ending.note_return()
    ending.begin(signal.SIGTERM)
    assert ('ended by SIGTERM: waiting for a callback' in log()) == hangs


def test_a_node_that_ends_at_once_waits_for_no_callback(harness, log):
    ending = Ending('node')
    signals = threading.Thread(target=ending.begin, args=(signal.SIGINT,))
    node = node_with_a_timer(harness, lambda: signals.ident or signals.start())
    _spin(node, ending)
    assert ending._returned.is_set()
    signals.join()
    node.destroy_node()


def test_a_call_to_a_service_that_is_gone_does_not_end_the_node(harness):
    calls, ending = [], Ending('node')

    def tick():
        calls.append(1)
        if len(calls) == 3:
            raise InvalidHandle('the service is gone')
        if len(calls) == 6:
            ending.begin(signal.SIGINT)

    node = node_with_a_timer(harness, tick)
    _spin(node, ending)
    assert len(calls) >= 6
    node.destroy_node()


def test_a_fault_of_our_own_is_not_hidden(harness):
    def tick():
        raise ZeroDivisionError

    node = node_with_a_timer(harness, tick)
    with pytest.raises(ZeroDivisionError):
        _spin(node, Ending('node'))
    node.destroy_node()


def test_the_end_of_the_context_ends_the_spinning(harness):
    node = node_with_a_timer(harness, lambda: None)
    spinning = threading.Thread(target=_spin, args=(node, Ending('node')))
    spinning.start()
    harness.executor.spin_once(timeout_sec=0.05)
    harness.context.try_shutdown()
    spinning.join(DEADLINE)
    assert not spinning.is_alive()


def test_the_executor_is_the_one_of_its_context(harness):
    executor = make_executor(harness.context)
    assert executor.context is harness.context
    executor.shutdown()


def test_a_node_announces_itself_often_from_the_start(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    found = []

    def start(**_):
        found.extend(os.environ[name] for name in VARIABLES if name in os.environ)
        raise RuntimeError('enough')

    monkeypatch.setattr(runner, 'init', start)
    monkeypatch.setattr(runner, '_catch_signals', lambda ending: None)
    monkeypatch.setattr(runner.sys, 'setswitchinterval', lambda seconds: None)
    monkeypatch.setattr(os, 'environ', dict(os.environ))
    assert runner.run(Spun, 'node', []) == 1
    path, = found
    assert os.path.basename(path) == 'fastdds.xml'

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the operating system: they act, or it is said that they do not."""

import gc
import os
from threading import Thread

import pytest
from tp_controller.ros.loop import realtime
from tp_controller.ros.loop.realtime import prepare

NOTHING = {'priority': 0, 'processor': -1, 'lock_memory': False, 'freeze': False}


def on_a_thread(**settings):
    """Return what `prepare` says on a thread of its own, and on which processors that runs."""
    told = []

    def run():
        told.append((prepare(**{**NOTHING, **settings}), os.sched_getaffinity(0),
                     os.sched_getscheduler(0)))

    thread = Thread(target=run)
    thread.start()
    thread.join()
    return told[0]


def test_nothing_is_set_unless_somebody_asks():
    before = gc.get_freeze_count()
    assert on_a_thread() == ([], os.sched_getaffinity(0), os.SCHED_OTHER)
    assert gc.get_freeze_count() == before


def test_a_thread_can_be_pinned_and_others_are_not():
    all_of_them = os.sched_getaffinity(0)
    one = max(all_of_them)
    assert on_a_thread(processor=one)[:2] == ([], {one})
    assert os.sched_getaffinity(0) == all_of_them


def test_a_processor_that_is_not_there_is_named():
    fault, = on_a_thread(processor=1000)[0]
    assert fault.startswith('parameter processor has no effect: ')


def test_what_is_not_permitted_is_said_with_what_it_takes(monkeypatch):
    def refuse(*_):
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    monkeypatch.setattr(realtime, '_lock_memory', refuse)
    priority, memory = on_a_thread(priority=50, lock_memory=True)[0]
    assert 'realtime_priority has no effect: [Errno 1]' in priority and 'rtprio' in priority
    assert 'lock_memory has no effect: [Errno 1]' in memory and 'memlock' in memory


def test_the_priority_acts_where_it_is_permitted():
    faults, _, policy = on_a_thread(priority=1)
    if faults:
        pytest.skip(faults[0])
    assert policy == os.SCHED_FIFO


def test_the_garbage_collector_can_be_frozen():
    try:
        assert on_a_thread(freeze=True)[0] == []
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()

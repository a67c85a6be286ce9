# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""The log that nobody waits for: what repeats is written once a second, with how often."""

import threading
import time
from types import SimpleNamespace

from harness import DEADLINE
import pytest
from tp_controller.ros import log as log_module
from tp_controller.ros.log import LARGEST_QUEUE, Log, MOST_LOG_CAUSES


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that the test sets."""
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(log_module.time, 'monotonic', lambda: clock.now)
    return clock


@pytest.fixture
def written():
    """Return a log, and what it has written as (severity, text)."""
    lines = []
    writers = {name: lambda text, name=name: lines.append((name, text))
               for name in ('info', 'warning', 'error')}
    return Log(SimpleNamespace(**writers)), lines


def test_nothing_is_written_before_it_is_flushed(written, clock):
    log, lines = written
    log.info('a')
    log.warning('b')
    log.error('c')
    assert lines == []
    log.flush()
    assert lines == [('info', 'a'), ('warning', 'b'), ('error', 'c')]


def test_what_repeats_is_written_once_a_second_with_how_often(written, clock):
    log, lines = written
    for _ in range(3000):
        log.warning('late')
        log.flush()
        clock.now += 0.001
    assert lines == [('warning', 'late'), ('warning', 'late (1000 times)'),
                     ('warning', 'late (1000 times)')]
    clock.now += 1.0
    log.flush()
    assert lines[3:] == [('warning', 'late (999 times)')]
    clock.now += 10.0
    log.flush()
    assert len(lines) == 4


def test_sentences_of_one_cause_count_together_and_the_last_is_written(written, clock):
    log, lines = written
    for count in range(10):
        log.warning(f'{count} old', 'old')
    log.flush()
    assert lines[:1] == [('warning', '0 old')]
    clock.now += 1.0
    log.flush()
    assert lines[1:] == [('warning', '9 old (9 times)')]


def test_a_flood_without_flushes_keeps_what_came_last(written, clock):
    log, lines = written
    for count in range(10 * LARGEST_QUEUE):
        log.error(f'fault {count}')
    log.flush()
    assert len(lines) == LARGEST_QUEUE
    assert lines[-1] == ('error', f'fault {10 * LARGEST_QUEUE - 1}')


def test_causes_that_never_repeat_do_not_fill_the_memory(written, clock):
    log, _ = written
    for count in range(20 * MOST_LOG_CAUSES):
        log.error(f'fault {count}')
        log.flush()
    assert len(log._written) <= MOST_LOG_CAUSES


def test_nobody_waits_for_a_writer_that_does_not_return():
    stuck, go_on = threading.Event(), threading.Event()

    def write(text):
        stuck.set()
        go_on.wait(DEADLINE)

    log = Log(SimpleNamespace(warning=write))
    log.warning('first')
    flushing = threading.Thread(target=log.flush)
    flushing.start()
    assert stuck.wait(DEADLINE)
    begin = time.monotonic()
    for count in range(1000):
        log.warning(f'{count} more', 'more')
    assert time.monotonic() - begin < 1.0
    go_on.set()
    flushing.join(DEADLINE)
    assert not flushing.is_alive()

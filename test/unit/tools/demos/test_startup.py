# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The start of a demo: processes are waited for as long as they make progress."""

import threading
from types import SimpleNamespace

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.demos import startup as module
from tp_controller.tools.demos.startup import missing, report_if_slow, Startup


class Played:
    """A process that takes processor time at a pace, and ends at a time [s]."""

    def __init__(self, clock, pace=1.0, ends=1e9, name='controller_node'):
        self.name, self.log = name, f'/logs/{name}.log'
        self.process = SimpleNamespace(returncode=3)
        self._clock, self.pace, self._ends = clock, pace, ends

    def running(self):
        return self._clock.now < self._ends

    def processor_seconds(self):
        return self.pace * self._clock.now

    def output(self):
        return 'a line\nthe last line\n'


class Clock:
    """A clock that turns with every turn of a wait."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now

    def turn(self, seconds):
        self.now += seconds


@pytest.fixture
def clock():
    """Return a clock."""
    return Clock()


def start(clock, nodes, until, missing='the status of the controller', said=None):
    """Wait until a time [s]."""
    said = [] if said is None else said
    Startup(nodes, said.append, clock).wait(
        lambda: missing if clock.now < until else '', clock.turn)
    return said


def test_nothing_is_said_of_a_start_that_is_quick(clock):
    assert start(clock, [Played(clock)], 4.9) == []


def test_an_import_that_takes_long_is_reported_while_it_does():
    reported = threading.Event()
    lines = []

    def report(line):
        lines.append(line)
        reported.set()

    with report_if_slow('importing the page', report, 0.01):
        assert reported.wait(60.0)
    assert lines[0].startswith('still starting (load ')
    assert lines[0].endswith(': importing the page')


def test_an_import_that_is_quick_is_not_reported():
    lines = []
    with report_if_slow('importing the page', lines.append, 60.0):
        pass
    assert not lines
    assert not any(isinstance(thread, threading.Timer) and not thread.finished.is_set()
                   for thread in threading.enumerate())


def test_what_is_waited_for_is_said_with_the_load_of_the_machine(clock, monkeypatch):
    monkeypatch.setattr(module.os, 'getloadavg', lambda: (16.7, 3.0, 1.0))
    monkeypatch.setattr(module.os, 'cpu_count', lambda: 2)
    assert start(clock, [Played(clock)], 6.0) == [
        'still starting (load 17 on 2 processors): waiting for the status of the controller']


def test_a_process_that_gets_little_of_the_processors_is_waited_for(clock):
    # Both need ten minutes for what they do in 27 s otherwise.
    start(clock, [Played(clock, pace=0.025), Played(clock, pace=0.02)], 600.0)
    assert clock.now >= 600.0


def test_a_new_step_has_the_whole_time_again(clock):
    node = Played(clock, pace=0.5)
    steps = [f'step {number}' for number in range(5)]
    Startup([node], lambda line: None, clock).wait(
        lambda: steps[int(clock.now // 50.0)] if clock.now < 250.0 else '', clock.turn)
    assert clock.now >= 250.0


@pytest.mark.parametrize('pace', [0.0, 2.0])
def test_what_makes_no_progress_is_abandoned(clock, pace):
    with pytest.raises(TpControllerError, match='waited for the status') as error:
        start(clock, [Played(clock, pace)], 1000.0)
    assert clock.now < 100.0
    assert '/logs/controller_node.log' in str(error.value) and 'the last line' in str(error.value)


def test_a_reason_that_changes_is_no_progress(clock):
    with pytest.raises(TpControllerError, match='to run: late by'):
        Startup([Played(clock, 0.0)], lambda line: None, clock).wait(
            lambda: f'the controller to run: late by {clock.now:.2f} s', clock.turn)


def test_a_process_that_ends_is_said_at_once_with_its_log(clock):
    nodes = [Played(clock, name='simulator_node'), Played(clock, ends=2.0)]
    with pytest.raises(TpControllerError) as error:
        start(clock, nodes, 1000.0)
    assert clock.now < 2.2
    assert str(error.value).startswith('controller_node has ended (exit status 3)')
    assert '/logs/controller_node.log' in str(error.value) and 'the last line' in str(error.value)


@pytest.mark.parametrize('status, reason, tasks, expected', [
    (None, '', {}, 'the status of the controller'),
    (1, 'no joint states', {}, 'the controller to run: no joint states'),
    (1, '', {}, 'the topics of the goals'), (1, '', {'tool': {}}, '')])
def test_the_step_that_is_missing_has_a_name(status, reason, tasks, expected):
    assert missing(SimpleNamespace(status=status, stop_reason=lambda: reason,
                                   tasks=lambda: tasks)) == expected

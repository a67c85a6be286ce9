# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

import io

import pytest
import tp_controller.tools.progress as module
from tp_controller.tools.progress import Progress, progress


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """Return a clock that only the test moves: [now]."""
    now = [100.0]
    monkeypatch.setattr(module, 'monotonic', lambda: now[0])
    return now


def last_line(stream):
    """Return what stands on the line of a terminal in the end."""
    return stream.getvalue().rpartition(module.CLEAR_LINE)[2]


def test_bar_shows_the_part_that_is_done_and_the_time_left(clock):
    stream = io.StringIO()
    bar = Progress(200, 'reading run.mcap', stream)
    clock[0] += 30.0
    bar.advance(50)
    assert last_line(stream) == 'reading run.mcap [######..................]  25%, 1:30 left'


def test_time_left_is_not_told_before_it_can_be_known(clock):
    stream = io.StringIO()
    bar = Progress(200, 'reading', stream)
    clock[0] += 0.5
    bar.advance(50)
    assert last_line(stream).endswith('25%')


def test_bar_is_drawn_now_and_then_only(clock):
    stream = io.StringIO()
    bar = Progress(1000, 'reading', stream)
    for _ in range(1000):
        clock[0] += module.DRAW_SECONDS / 10.0
        bar.advance()
    assert 90 <= stream.getvalue().count('%') <= 101


@pytest.mark.parametrize(('total', 'done'), [(0, 0), (0, 5), (10, 20)])
def test_more_than_all_is_shown_as_all(clock, total, done):
    stream = io.StringIO()
    bar = Progress(total, 'reading', stream)
    clock[0] += 0.5
    bar.advance(done)
    assert '100%' in last_line(stream)


def test_bar_fits_into_the_terminal(clock, monkeypatch):
    monkeypatch.setenv('COLUMNS', '20')
    stream = io.StringIO()
    bar = Progress(10, 'reading a file with a long name', stream)
    clock[0] += 5.0
    bar.advance(1)
    assert len(last_line(stream)) == 19


def test_bar_goes_to_the_error_stream_of_a_terminal_and_away_in_the_end(clock, monkeypatch):
    stream = Terminal()
    monkeypatch.setattr('sys.stderr', stream)
    with pytest.raises(KeyboardInterrupt), progress(10, 'reading') as bar:
        clock[0] += 5.0
        bar.advance(1)
        assert '10%' in last_line(stream)
        raise KeyboardInterrupt
    assert last_line(stream) == ''


def test_nothing_is_drawn_elsewhere(clock, monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr('sys.stderr', stream)
    with progress(10, 'reading') as bar:
        clock[0] += 5.0
        bar.advance(1)
    assert stream.getvalue() == ''

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller record``: all topics of running controllers, to a file."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import sys
import time
from typing import TYPE_CHECKING

from tp_controller.errors import TpControllerError
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.tools.cli.command import Command
from tp_controller.tools.cli.values import positive_number
from tp_controller.tools.progress import CLEAR_LINE
from tp_controller.untrusted.texts import plain

if TYPE_CHECKING:  # Imported when a recording starts: the help needs no ROS.
    from tp_controller.tools.recording.bag_recorder import BagRecorder
    from tp_controller.tools.recording.writer import BagWriter

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Periods of polling the messages, of writing to the disk, and of the status line [s].
RECEIVE_SECONDS, WRITE_SECONDS, STATUS_SECONDS = 0.005, 1.0, 0.2
SIZE_UNITS = ((1e9, 'GB'), (1e6, 'MB'), (1e3, 'kB'))
EXAMPLES = """\
examples:
  tp_controller record                       until Ctrl-C, to a folder named after the time
  tp_controller record run1 --for 30
  tp_controller record run2 --node left/tp_controller
  tp_controller plot run1                    plots and a report of it
  ros2 bag info run1                         Foxglove and PlotJuggler read run1/run1.mcap
"""


def add_record_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command to its parser."""
    parser.add_argument('out', nargs='?', type=Path, metavar='OUT',
                        help='folder of the recording, which must not exist '
                        '(default: ./tp_<date>_<time>)')
    parser.add_argument('--node', action='append', default=[],
                        help='name of a controller node, with its namespace; once for each '
                        '(default: all that are found)')
    parser.add_argument('--for', dest='seconds', type=positive_number, metavar='SECONDS',
                        help='end after so long (default: at Ctrl-C)')
    parser.add_argument('--wait', type=positive_number, default=10.0, metavar='SECONDS',
                        help='how long to look for the controllers (default: 10)')


def record(options: argparse.Namespace) -> int:
    """
    Record until Ctrl-C, or for a given time.

    Parameters
    ----------
    options : argparse.Namespace
        Options of the arguments that `add_record_arguments` adds.

    Returns
    -------
    int
        0.

    Raises
    ------
    TpControllerError
        No controller, or not every named one, was found, or the recording cannot be written.

    """
    path = options.out or Path(time.strftime('tp_%Y-%m-%d_%H-%M-%S'))
    if path.suffix == '.mcap':
        # The file in the folder has this name.
        path = path.with_suffix('')
    set_up_fast_dds()
    from tp_controller.ros.client.graph import absence
    from tp_controller.ros.runner import TRANSPORTS
    from tp_controller.tools.recording.bag_recorder import BagRecorder
    from tp_controller.tools.recording.writer import BagWriter
    os.environ.setdefault(*TRANSPORTS)
    if path.exists():
        raise TpControllerError(f'{path} exists already, and stays as it is: name another, or '
                                'move it away')
    with _signals() as arrived, BagRecorder(options.node) as recorder:
        end = time.monotonic() + options.wait
        while not recorder.find() and not arrived:
            if time.monotonic() > end:
                raise TpControllerError(
                    absence(', '.join(f'/{name}' for name in recorder.missing())))
            time.sleep(RECEIVE_SECONDS)
        if arrived:
            raise KeyboardInterrupt
        bag = BagWriter(path)
        seconds = _write(recorder, bag, options.seconds, arrived)
        print(_summary(bag, recorder, seconds))
        for topic, reason in recorder.skipped.items():
            print(f'tp_controller: {plain(topic)} is not recorded: {plain(reason)}',
                  file=sys.stderr)
    return 0


@contextmanager
def _signals() -> Iterator[list[int]]:
    """Collect the signals that end the command, so that no write is interrupted."""
    arrived: list[int] = []
    before = {number: signal.signal(number, lambda got, _: arrived.append(got))
              for number in SIGNALS}
    try:
        yield arrived
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _write(recorder: 'BagRecorder', bag: 'BagWriter', seconds: float | None,
           arrived: list[int]) -> float:
    """Write messages until a signal, or for a time; return the duration [s]."""
    start = flushed = shown = time.monotonic()
    try:
        # The first call subscribes: messages sent after the following line are recorded.
        recorder.record(bag)
        print(f'recording {", ".join(f"/{name}" for name in recorder.controllers)} to {bag.path}; '
              'Ctrl-C ends it', flush=True)
        while not arrived and (seconds is None or time.monotonic() - start < seconds):
            recorder.record(bag)
            now = time.monotonic()
            if now - flushed >= WRITE_SECONDS:
                flushed = now
                bag.flush()
            if now - shown >= STATUS_SECONDS:
                shown = now
                _show(f'{_amount(bag, now - start)}, {len(bag.counts)} topics')
            time.sleep(RECEIVE_SECONDS)
        recorder.record(bag)
        bag.close()
    except OSError as error:
        bag.abandon()
        raise TpControllerError(
            f'{bag.path}: {error.strerror}; earlier messages can be plotted') from error
    except BaseException:
        bag.abandon()
        raise
    finally:
        _show('')
    return time.monotonic() - start


def _show(line: str) -> None:
    """Replace the status line on a terminal."""
    if sys.stderr.isatty():
        print(CLEAR_LINE + line, end='', file=sys.stderr, flush=True)


def _amount(bag: 'BagWriter', seconds: float) -> str:
    """Return duration, number of messages and size of the recording."""
    return (f'{seconds:.1f} s, {sum(bag.counts.values())} messages, '
            f'{_size(bag.size())}')


def _size(size: float) -> str:
    """Return a size [bytes] as text in a suitable unit."""
    return next((f'{size / unit:.1f} {name}' for unit, name in SIZE_UNITS if size >= unit),
                f'{size:.0f} bytes')


def _summary(bag: 'BagWriter', recorder: 'BagRecorder', seconds: float) -> str:
    """Return a summary of the recording in one line."""
    return (f'{bag.path}: {_amount(bag, seconds)}, {recorder.lost()} lost: '
            f'{_listed(bag.counts)}')


def _listed(counts: Mapping[str, int]) -> str:
    """Return the number of messages of each topic."""
    return ', '.join(f'{plain(topic)} {counts[topic]}' for topic in sorted(counts))


COMMAND = Command(
    'record the topics of running controllers',
    'Record all topics of running controllers, until Ctrl-C, to a folder that ros2 bag, '
    'PlotJuggler, Foxglove and tp_controller plot read.',
    EXAMPLES, add_record_arguments, record)

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

"""Waiting for processes that start: as long as they make progress, however slow the machine is."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import os
from threading import Timer
import time
from typing import TYPE_CHECKING

from tp_controller.errors import TpControllerError
from tp_controller.tools.demos.processes import NodeProcess

if TYPE_CHECKING:  # Imported when a demo starts: nothing else here needs ROS.
    from tp_controller.ros.client.client import Client

# Processor time that one step may take, of all processes together, and for how long none of them
# may take any [s]. A step takes 2 to 6 s of a processor.
STEP_SECONDS, IDLE_SECONDS = 30.0, 60.0
# From when on the wait is reported, and the time between two reports [s].
PATIENT_SECONDS, REPORT_SECONDS = 5.0, 15.0
# Between two looks at what has come [s].
LOOK_SECONDS = 0.05
# Of a log, that are shown.
LINES = 12


class Startup:
    """
    Watches processes that start, and reports what is waited for.

    Time does not count, progress does: a process that takes processor time on a machine with
    much to do is on its way.

    Parameters
    ----------
    nodes : sequence of NodeProcess
        All of which are needed.
    report : callable
        Takes a line for the user.
    clock : callable
        Returns a time [s].

    """

    def __init__(self, nodes: Sequence[NodeProcess], report: Callable[[str], None],
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._nodes, self._report, self._clock = nodes, report, clock
        now = clock()
        self._due = now + PATIENT_SECONDS
        self._steps: set[str] = set()
        self._moved, self._used, self._used_before = now, 0.0, 0.0

    def check(self, missing: str) -> None:
        """
        Take note of what is missing now.

        Parameters
        ----------
        missing : str
            Such as ``the controller to run: no joint states``; what follows a colon may change
            without progress.

        Raises
        ------
        TpControllerError
            A process has ended, or none has made progress for too long.

        """
        check_alive(self._nodes)
        now, used = self._clock(), sum(node.processor_seconds() for node in self._nodes)
        step = missing.partition(':')[0]
        if step not in self._steps:
            self._steps.add(step)
            self._used_before, self._moved = used, now
        if used > self._used:
            self._used, self._moved = used, now
        if now - self._moved > IDLE_SECONDS or used - self._used_before > STEP_SECONDS:
            logs = '\n'.join(map(said_last, self._nodes))
            raise TpControllerError(f'the demo did not start, it waited for {missing}\n{logs}')
        if now >= self._due:
            self._due = now + REPORT_SECONDS
            self._report(f'still starting ({load()}): waiting for {missing}')

    def wait(self, missing: Callable[[], str], turn: Callable[[float], None]) -> None:
        """
        Wait until nothing is missing.

        Parameters
        ----------
        missing : callable
            Returns what is missing; empty once all has come.
        turn : callable
            Takes what arrives, for at most a time [s].

        Raises
        ------
        TpControllerError
            See `check`.

        """
        while text := missing():
            self.check(text)
            turn(LOOK_SECONDS)


@contextmanager
def report_if_slow(step: str, report: Callable[[str], None],
                   seconds: float = PATIENT_SECONDS) -> Iterator[None]:
    """
    Report a step that is still not done after a time, while it blocks this thread.

    Parameters
    ----------
    step : str
        Such as ``importing the page``.
    report : callable
        Takes a line for the user; called from another thread.
    seconds : float
        The time [s].

    """
    timer = Timer(seconds, lambda: report(f'still starting ({load()}): {step}'))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def missing(client: 'Client') -> str:
    """Return what has not come yet of a controller that is to run; empty once all has."""
    if client.status is None:
        return 'the status of the controller'
    if client.stop_reason():
        return f'the controller to run: {client.stop_reason()}'
    return '' if client.tasks() else 'the topics of the goals'


def check_alive(nodes: Sequence[NodeProcess]) -> None:
    """Raise `TpControllerError`, with the end of its log, where a node has ended."""
    for node in nodes:
        if not node.running():
            raise TpControllerError(end_of(node))


def end_of(node: NodeProcess) -> str:
    """Return how a node has ended, and its last words."""
    return f'{node.name} has ended (exit status {node.process.returncode})\n{said_last(node)}'


def said_last(node: NodeProcess) -> str:
    """Return where the log of a node is, and its last lines."""
    lines = node.output().strip().splitlines()[-LINES:]
    return '\n  '.join((f'log of {node.name}: {node.log}', *(lines or ['(empty)'])))


def load() -> str:
    """Return how much the machine has to do."""
    return f'load {os.getloadavg()[0]:.0f} on {os.cpu_count()} processors'

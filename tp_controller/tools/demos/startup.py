# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Startup of processes, with timeouts in processor time for slow machines."""

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

# Limits of the processor time of one step, over all processes, and of the time without progress
# [s]. A step takes 2 to 6 s of a processor.
STEP_SECONDS, IDLE_SECONDS = 30.0, 60.0
# Time until the first report of a wait, and between two reports [s].
FIRST_REPORT_SECONDS, REPORT_SECONDS = 5.0, 15.0
# Polling period [s].
STARTUP_POLL_SECONDS = 0.05
# Number of displayed lines of a log.
LOG_LINES = 12


class Startup:
    """
    Supervisor of starting processes, which reports the step in progress.

    The timeouts count progress, not time: a process on a busy machine that uses processor time is
    still starting.

    Parameters
    ----------
    nodes : sequence of NodeProcess
        Processes that must all run.
    report : callable
        Called with a line for the user.
    clock : callable
        Returns a time [s].

    """

    def __init__(self, nodes: Sequence[NodeProcess], report: Callable[[str], None],
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._nodes, self._report, self._clock = nodes, report, clock
        now = clock()
        self._due = now + FIRST_REPORT_SECONDS
        self._steps: set[str] = set()
        self._moved, self._used, self._used_before = now, 0.0, 0.0

    def check(self, missing: str) -> None:
        """
        Check the progress, given the missing part.

        Parameters
        ----------
        missing : str
            Missing part, such as ``the controller to run: no joint states``; a change of the text
            after the colon is not progress.

        Raises
        ------
        TpControllerError
            A process has ended, or there was no progress for too long.

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
            logs = '\n'.join(map(log_tail, self._nodes))
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
            Returns the missing part; empty when startup is complete.
        turn : callable
            Processes messages, for at most a time [s].

        Raises
        ------
        TpControllerError
            See `check`.

        """
        while text := missing():
            self.check(text)
            turn(STARTUP_POLL_SECONDS)


@contextmanager
def report_if_slow(step: str, report: Callable[[str], None],
                   seconds: float = FIRST_REPORT_SECONDS) -> Iterator[None]:
    """Report a step that still blocks this thread after a time [s], from another thread."""
    timer = Timer(seconds, lambda: report(f'still starting ({load()}): {step}'))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def missing(client: 'Client') -> str:
    """Return the missing part of a controller that must run; empty if it runs."""
    if client.status is None:
        return 'the status of the controller'
    if client.stop_reason():
        return f'the controller to run: {client.stop_reason()}'
    return '' if client.tasks() else 'the topics of the goals'


def check_alive(nodes: Sequence[NodeProcess]) -> None:
    """Raise `TpControllerError` with the end of the log if a node has ended."""
    for node in nodes:
        if not node.running():
            raise TpControllerError(end_of(node))


def end_of(node: NodeProcess) -> str:
    """Return the exit status of a node and the end of its log."""
    return f'{node.name} has ended (exit status {node.process.returncode})\n{log_tail(node)}'


def log_tail(node: NodeProcess) -> str:
    """Return the path of the log of a node, and its last lines."""
    lines = node.output().strip().splitlines()[-LOG_LINES:]
    return '\n  '.join((f'log of {node.name}: {node.log}', *(lines or ['(empty)'])))


def load() -> str:
    """Return the load of the machine as text."""
    return f'load {os.getloadavg()[0]:.0f} on {os.cpu_count()} processors'

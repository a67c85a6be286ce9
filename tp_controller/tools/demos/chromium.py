# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Headless Chromium that shows one page, if one is installed."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import subprocess
from tempfile import TemporaryDirectory

from tp_controller.errors import TpControllerError

PROGRAMS = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
# WebGL on the processor: the pictures do not depend on the graphics card.
RENDERING = ('--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist')
# Prevents the throttling of a page in the background.
AWAKE = ('--disable-background-timer-throttling', '--disable-renderer-backgrounding',
         '--disable-backgrounding-occluded-windows')
# Removes the limit of one frame per second for hidden pages: a picture takes 0.4 s instead of
# 3 s. Without the limit the page uses all processors that it gets.
NO_FRAME_LIMIT = '--disable-frame-rate-limit'
QUIET = ('--no-first-run', '--no-default-browser-check', '--disable-extensions',
         '--disable-background-networking', '--disable-component-update', '--disable-sync',
         '--hide-scrollbars', '--mute-audio')
END_SECONDS = 5.0  # for a process to end after each signal


def find_chromium() -> str | None:
    """Return the path of a Chromium (or Chrome) on the PATH; None if there is none."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


def chromium_flags() -> list[str]:
    """Return the flags that render a page with WebGL on any machine."""
    # Chromium refuses to run as root in its sandbox.
    root = ['--no-sandbox'] if os.geteuid() == 0 else []
    return [*RENDERING, *AWAKE, *QUIET, *root]


class HeadlessPage:
    """
    Process that renders a page off screen.

    Parameters
    ----------
    process : subprocess.Popen
    log : pathlib.Path
        File of its output.

    """

    def __init__(self, process: 'subprocess.Popen[bytes]', log: Path) -> None:
        self._process = process
        self._log = log

    def check(self) -> None:
        """
        Check that the process still runs.

        Raises
        ------
        TpControllerError
            The process ended; the error contains the last line of its output.

        """
        status = self._process.poll()
        if status is not None:
            said = self._log.read_text(errors='replace').strip().splitlines()
            raise TpControllerError(f'Chromium ended (exit code {status})'
                                    + (f': {said[-1]}' if said else ''))


@contextmanager
def open_page(program: str, address: str, width: int, height: int) -> Iterator[HeadlessPage]:
    """
    Show a page in a headless Chromium until the context ends.

    Parameters
    ----------
    program : str
        See `find_chromium`.
    address : str
        URL of the page.
    width, height : int
        Size of the window [pixels].

    Yields
    ------
    HeadlessPage

    """
    with TemporaryDirectory(prefix='tp_controller_', ignore_cleanup_errors=True) as folder:
        log = Path(folder) / 'log'
        with log.open('wb') as output:
            process = subprocess.Popen(
                [program, '--headless=new', *chromium_flags(), NO_FRAME_LIMIT,
                 f'--window-size={width},{height}',
                 f'--user-data-dir={folder}/profile', address],
                # A process group: Chromium consists of several processes.
                stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True)
        try:
            yield HeadlessPage(process, log)
        finally:
            _end(process)


def _end(process: 'subprocess.Popen[bytes]') -> None:
    """End a process and its children."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(END_SECONDS)
        except ProcessLookupError:
            break
        except subprocess.TimeoutExpired:
            continue

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Node processes in their own ROS domain."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
import errno
import os
from pathlib import Path
import shutil
import signal
import socket
import subprocess
import sys

from tp_controller.errors import TpControllerError
from tp_controller.tools.files import new_file

# Ids that are safe on every platform (ROS 2 documentation, "The ROS_DOMAIN_ID"), in descending
# order: users number their robots from 0 up.
DOMAINS = range(101, 49, -1)
# {name of an executable: its subpackage}
NODES = {'controller_node': 'ros', 'simulator_node': 'ros', 'watchdog_node': 'ros',
         'viewer_node': 'tools.view', 'teleop_node': 'tools.teleop'}
# Descriptor of the socket that reserves each domain of this process, by id.
_MARKS: dict[str, int] = {}


@contextmanager
def own_domain() -> Iterator[dict[str, str]]:
    """
    Reserve a ROS domain, exclusive among all who call this function on the same network stack.

    Yields
    ------
    dict
        Environment of nodes that communicate only with each other.

    Raises
    ------
    TpControllerError
        All domains are reserved.

    """
    domain, mark = _free_domain()
    with mark:
        _MARKS[domain] = mark.fileno()
        try:
            yield {**os.environ, 'ROS_DOMAIN_ID': domain,
                   'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        finally:
            del _MARKS[domain]


def _free_domain() -> tuple[str, socket.socket]:
    """
    Return the id of a domain that nobody has reserved, and the socket that reserves it.

    Names of abstract sockets (unix(7)) are unique in a network namespace, as domains are, for all
    users, and end with the last process that holds the socket.
    """
    for domain in map(str, DOMAINS):
        mark = socket.socket(socket.AF_UNIX)
        try:
            mark.bind(f'\0tp_controller/domain_{domain}')
        except OSError as error:
            mark.close()
            if error.errno != errno.EADDRINUSE:
                raise TpControllerError(f'no ROS domain can be reserved: {error.strerror}') \
                    from error
        else:
            return domain, mark
    raise TpControllerError('no free ROS domain: other demos or tests use all of '
                            f'{DOMAINS[0]} to {DOMAINS[-1]}')


@contextmanager
def ended_by_sigterm() -> Iterator[Callable[[], None]]:
    """
    Convert SIGTERM to an exception, so that processes started here are ended, too.

    Yields
    ------
    callable
        Call it after the start of all processes: signals are deferred until then, as a process
        that is being started is not yet known.

    """
    arrived = started = False

    def leave_if_due() -> None:
        if arrived and started:
            sys.exit(128 + signal.SIGTERM)

    def on_signal(*_: object) -> None:
        nonlocal arrived
        arrived = True
        leave_if_due()

    def all_started() -> None:
        nonlocal started
        started = True
        leave_if_due()

    before = signal.signal(signal.SIGTERM, on_signal)
    try:
        yield all_started
    finally:
        signal.signal(signal.SIGTERM, before)


class NodeProcess:
    """
    Node in its own process, with its output in a file.

    Parameters
    ----------
    executable : str
        Name in `NODES`.
    arguments : list of str
        ROS arguments, after ``--ros-args``.
    environment : dict
        Environment of the process.
    log : str or pathlib.Path
        File of its output.

    Attributes
    ----------
    name : str
        Name of the executable.

    """

    def __init__(self, executable: str, arguments: Sequence[str],
                 environment: Mapping[str, str], log: str | Path) -> None:
        if executable not in NODES:
            raise ValueError(f'{executable!r} is not one of {", ".join(sorted(NODES))}')
        self.name, self.log = executable, Path(log)
        # A node that outlives this process keeps its domain reserved.
        mark = _MARKS.get(environment.get('ROS_DOMAIN_ID', ''))
        with new_file(self.log) as output:
            self.process = subprocess.Popen(
                [*_end_with_this_process(), sys.executable, '-m',
                 f'tp_controller.{NODES[executable]}.{executable}',
                 '--ros-args',
                 *arguments], env=environment, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, pass_fds=() if mark is None else (mark,))

    def __enter__(self) -> 'NodeProcess':
        """Return the running process."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the process."""
        self.stop()

    def running(self) -> bool:
        """Return whether the process is alive."""
        return self.process.poll() is None

    def output(self) -> str:
        """Return the output of the process so far."""
        return self.log.read_text()

    def processor_seconds(self) -> float:
        """Return the processor time of the process [s]; 0 if it is not available."""
        try:
            fields = Path(f'/proc/{self.process.pid}/stat').read_text().rpartition(')')[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def stop(self, seconds: float = 10.0) -> int:
        """Terminate the process, by force after a timeout [s]; return its exit status."""
        if self.running():
            self.process.terminate()
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def _end_with_this_process() -> list[str]:
    """Return a prefix of a command that is sent SIGTERM when this process ends in any way."""
    program = shutil.which('setpriv')
    return [program, '--pdeathsig', 'TERM', '--'] if program else []


def start_nodes(stack: ExitStack, parameters: Path, environment: Mapping[str, str],
                folder: Path, output: str = 'velocity') -> list[NodeProcess]:
    """Start a simulator and a controller until a stack ends, with logs in a folder."""
    file = ['--params-file', str(parameters)]
    return [stack.enter_context(NodeProcess(name, arguments, environment, folder / f'{name}.log'))
            for name, arguments in (('simulator_node', file), (
                'controller_node', [*file, '-p', f'output:={output}']))]

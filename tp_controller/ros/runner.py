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

"""Running a node: one loop, clean ends, plain words instead of tracebacks."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from enum import Enum
import os
from pathlib import Path
import signal
import sys
from textwrap import wrap
import threading
from types import ModuleType
from typing import cast

from rclpy import init, try_shutdown
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from tp_controller.errors import in_words, TpControllerError
from tp_controller.ros.middleware import set_up_fast_dds
from tp_controller.ros.signals import SignalWatch

HELP_WIDTH = 95
# A terminal that is closed and Ctrl-\\ end a node as Ctrl-C does.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
NAMES = {number.value: number.name for number in SIGNALS}
# EventsExecutor.spin() waits with a deadline that overflows and burns a core; a long finite one
# does not [s].
LONG = 1e8
# How long a thread is waited for, and the name of those that are [s].
PATIENCE_SECONDS, BESIDE = 1.0, 'beside'
# How long a node takes at most to end after a signal, and its exit status if it does not [s].
ENDING_SECONDS, STUCK = 5.0, 1
# After how long it is logged that a callback has not returned since a signal [s].
HANGING_SECONDS = 0.1
# How long a thread that is busy in Python may hold up the others [s]; Python's own is 5 ms.
SWITCH_SECONDS = 1e-4
# What Fast DDS sends over, unless the environment says so already. Through shared memory, its
# default, a process that hears the robot and is suspended (Ctrl-Z, a debugger) may hold a lock
# that every sender waits for: in 2 of 40 pauses of a simulator the controller stood still as long
# as it did, over UDP in none. UDP takes 2 to 3 % more of a processor at 1 kHz.
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4'


class ClosableNode(Node, ABC):
    """A node that `run` can run."""

    @abstractmethod
    def close(self, reason: str) -> None:
        """Act for the last time, while publishing still works, and say why the node ends."""

    def halt(self, reason: str) -> None:
        """
        Stop what moves, and say why, before `close` or in its place.

        Called from any thread, whatever hangs on the others: it may wait for nothing, and call no
        code of a task. Nothing may move afterwards.
        """

    def beside(self, failed: Callable[[BaseException], None]) -> AbstractContextManager[None]:
        """Return what runs on other threads meanwhile; it calls `failed` if that ends."""
        return nullcontext()


def make_executor(context: Context | None = None) -> Executor:
    """Return the executor with the least overhead that this rclpy has."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def run(make_node: Callable[[], ClosableNode], name: str,
        args: list[str] | None = None) -> int:
    """
    Run a node until a signal ends it, or say how it is started.

    Parameters
    ----------
    make_node : callable
        Returns the node; it has a method `close`, called while publishing still works.
    name : str
        Name for messages before the node exists.
    args : list of str, optional
        Command line.

    Returns
    -------
    int
        Exit status: 0, or 1 if the node could not start.

    """
    if {'-h', '--help'} & set(sys.argv[1:] if args is None else args):
        print(_help(sys.modules[make_node.__module__]))
        return 0
    ending = Ending(name)
    _catch_signals(ending)
    sys.setswitchinterval(SWITCH_SECONDS)
    os.environ.setdefault(*TRANSPORTS)
    set_up_fast_dds()
    try:
        init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError) as error:
        # Bad ROS arguments, which have several types of errors.
        get_logger(name).fatal(str(error).splitlines()[0])
        return 1
    node, reason = None, 'ended'
    try:
        node = make_node()
        reason = _spin(node, ending)
    except (TpControllerError, ParameterException) as error:
        get_logger(name).fatal(str(error))
        reason = f'ended: {error}'
        return 1
    except Exception as error:
        reason = f'ended: {in_words(error)}'
        raise
    finally:
        if node is not None:
            node.close(reason)
            if _is_stuck():
                # It would be waited for in vain, and with it everything that it uses.
                os._exit(STUCK)
            node.destroy_node()
        try_shutdown()
    return 0


def _help(module: ModuleType) -> str:
    """Return how the node of a module is started, and its parameters."""
    name = Path(module.__file__ or '').stem
    lines = [f'usage: {name} [--ros-args -p NAME:=VALUE --params-file FILE -r FROM:=TO ...]', '',
             *wrap((module.__doc__ or '').strip(), HELP_WIDTH), '', 'parameters:']
    for spec in module.PARAMETERS:
        default = '' if isinstance(spec.default, Enum) or spec.default == '' \
            else f' (default: {spec.default})'
        unit = f' [{spec.unit}]' if spec.unit else ''
        indent = ' ' * 6
        lines += [f'  {spec.name}', *wrap(spec.description + unit + default, HELP_WIDTH,
                                          initial_indent=indent, subsequent_indent=indent)]
    return '\n'.join(lines)


class Ending:
    """
    Ends a node from any thread.

    Parameters
    ----------
    name : str
        Name for messages.

    Attributes
    ----------
    reason : str
        Why the node has to end; empty while it goes on.

    """

    def __init__(self, name: str) -> None:
        self._name, self.reason = name, ''
        self._node: ClosableNode | None = None
        self._spun: Future | None = None
        self._returned = threading.Event()

    def follow(self, node: ClosableNode, spun: Future) -> None:
        """End a node from now on, which spins until a future is done."""
        self._node, self._spun = node, spun
        if self.reason:
            self._act()

    def begin(self, number: int) -> None:
        """End the node because of a signal."""
        self.reason = f'ended by {NAMES[number]}'
        self._act()
        if not self._returned.wait(HANGING_SECONDS):
            get_logger(self._name).warning(
                f'{self.reason}: waiting for a callback, or the start, to return, until the '
                f'process is ended by force after {ENDING_SECONDS:g} s')

    def note_return(self) -> None:
        """Note that the main thread hangs in no callback: it ends the node now."""
        self._returned.set()

    def _act(self) -> None:
        """Stop what moves, and then let the main thread end the node, if it can."""
        node, spun = self._node, self._spun
        if node is not None and spun is not None:
            try:
                node.halt(self.reason)
            finally:
                spun.set_result(self.reason)


def _catch_signals(ending: Ending) -> None:
    """
    Let signals end the node, until the end of the process.

    rclpy's own handlers shut the context down at once, when no zero can be published any more.
    """
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)
    SignalWatch(SIGNALS, STUCK, ending.begin, ENDING_SECONDS).start()


@contextmanager
def spinning(node: Node, failed: Callable[[BaseException], None],
             first: Callable[[], None]) -> Iterator[None]:
    """
    Spin a node on a thread of its own.

    Parameters
    ----------
    node : rclpy.node.Node
        The node.
    failed : callable
        Called with what ends it.
    first : callable
        Called on that thread before anything else.

    """
    executor = make_executor(node.context)
    executor.add_node(node)
    ended = Future(executor=executor)

    def spin() -> None:
        try:
            first()
            _spin_until(ended, executor)
        except ExternalShutdownException:
            pass
        except BaseException as error:
            failed(error)

    thread = threading.Thread(target=spin, name=BESIDE, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set_result(None)
        thread.join(PATIENCE_SECONDS)
        if not thread.is_alive():
            executor.shutdown()


def _spin(node: ClosableNode, ending: Ending) -> str:
    """Spin until a signal arrives or somebody shuts the context down; return which."""
    executor = make_executor(node.context)
    executor.add_node(node)
    ended = Future(executor=executor)
    ending.follow(node, ended)
    try:
        with node.beside(ended.set_exception):
            _spin_until(ended, executor)
    except ExternalShutdownException:
        pass
    finally:
        ending.note_return()
        executor.shutdown()
    return cast(str, ended.result()) if ended.done() else 'ended: ROS was shut down'


def _spin_until(ended: Future, executor: Executor) -> None:
    """Spin until a future is done."""
    while not ended.done():
        try:
            executor.spin_until_future_complete(ended, LONG)
        except InvalidHandle:
            # A call that was sent before a new stack closed its service cannot be answered
            # any more, and is no reason to end.
            continue


def _is_stuck() -> bool:
    """Return whether a thread that was to end still runs, as in a task that never returns."""
    return any(thread.name == BESIDE for thread in threading.enumerate())

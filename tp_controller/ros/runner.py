# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Running of a node: executor, signals, and error messages instead of tracebacks."""

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
# Closing the terminal and Ctrl-\\ end a node as Ctrl-C does.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
NAMES = {number.value: number.name for number in SIGNALS}
# Timeout of the executor [s]: the infinite one of EventsExecutor.spin() overflows and burns a
# core.
SPIN_SECONDS = 1e8
# Timeout for joining a thread of `spinning` [s], and the name of these threads.
JOIN_SECONDS, THREAD_NAME = 1.0, 'beside'
# Time from a signal to the forced end of the process [s], and its exit status then.
ENDING_SECONDS, FORCED_STATUS = 5.0, 1
# Time from a signal after which a callback that has not returned is logged [s].
HANGING_SECONDS = 0.1
# Longest time that one busy Python thread delays the others [s]; Python's default is 5 ms.
SWITCH_SECONDS = 1e-4
# Transport of Fast DDS, unless the environment sets it. With shared memory, the default, a
# suspended subscriber (Ctrl-Z, a debugger) may own a lock that every sender waits for: in 2 of 40
# pauses of a simulator the controller stood still for as long, over UDP in none. UDP takes 2 to
# 3 % more of a processor at 1 kHz.
TRANSPORTS = 'FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4'


class ClosableNode(Node, ABC):
    """Base class of nodes that `run` runs."""

    @abstractmethod
    def close(self, reason: str) -> None:
        """Act for the last time, while publishing still works, and report why the node ends."""

    def halt(self, reason: str) -> None:
        """
        Stop all motion and report the reason, before `close` or in its place.

        Called from any thread, even if others hang: it must neither wait nor call code of a task.
        Nothing may move afterwards.
        """

    def beside(self, failed: Callable[[BaseException], None]) -> AbstractContextManager[None]:
        """Return the context that runs other threads; it calls `failed` if one of them fails."""
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
    Run a node until a signal ends it, or print its help.

    Parameters
    ----------
    make_node : callable
        Returns the node; its method `close` is called while publishing still works.
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
        # Invalid ROS arguments raise several types of errors.
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
                # Joining the thread, and destroying the objects that it uses, would block.
                os._exit(FORCED_STATUS)
            node.destroy_node()
        try_shutdown()
    return 0


def _help(module: ModuleType) -> str:
    """Return the help of a node module: usage and parameters."""
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
    Shutdown of a node, requested from any thread.

    Parameters
    ----------
    name : str
        Name for messages.

    Attributes
    ----------
    reason : str
        Reason of the shutdown; empty while the node runs.

    """

    def __init__(self, name: str) -> None:
        self._name, self.reason = name, ''
        self._node: ClosableNode | None = None
        self._spun: Future | None = None
        self._returned = threading.Event()

    def follow(self, node: ClosableNode, spun: Future) -> None:
        """Set the node to end, and the future that ends its spinning."""
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
        """Record that the main thread hangs in no callback: it ends the node now."""
        self._returned.set()

    def _act(self) -> None:
        """Stop all motion, and then request the main thread to end the node."""
        node, spun = self._node, self._spun
        if node is not None and spun is not None:
            try:
                node.halt(self.reason)
            finally:
                spun.set_result(self.reason)


def _catch_signals(ending: Ending) -> None:
    """
    Install the signal handling that ends the node, until the end of the process.

    rclpy's own handlers shut the context down at once, before zeros can be published.
    """
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)
    SignalWatch(SIGNALS, FORCED_STATUS, ending.begin, ENDING_SECONDS).start()


@contextmanager
def spinning(node: Node, failed: Callable[[BaseException], None],
             first: Callable[[], None]) -> Iterator[None]:
    """
    Spin a node on a thread of its own.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to spin.
    failed : callable
        Called with the exception that ends it.
    first : callable
        Called on that thread before spinning.

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

    thread = threading.Thread(target=spin, name=THREAD_NAME, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set_result(None)
        thread.join(JOIN_SECONDS)
        if not thread.is_alive():
            executor.shutdown()


def _spin(node: ClosableNode, ending: Ending) -> str:
    """Spin until a signal or a shutdown of the context; return the reason."""
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
            executor.spin_until_future_complete(ended, SPIN_SECONDS)
        except InvalidHandle:
            # A call that was sent before a new stack closed its service cannot be answered.
            # The node goes on.
            continue


def _is_stuck() -> bool:
    """Return whether a thread still runs after its timeout, as in a task that never returns."""
    return any(thread.name == THREAD_NAME for thread in threading.enumerate())

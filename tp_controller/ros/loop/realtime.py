# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the operating system for the thread of the loop."""

from collections.abc import Callable
import ctypes
import gc
import os

# <sys/mman.h>: all pages that are, and will be, mapped.
MCL_CURRENT, MCL_FUTURE = 1, 2


def prepare(priority: int, processor: int, lock_memory: bool, freeze: bool) -> list[str]:
    """
    Prepare this thread, and its process, for regular cycles.

    Parameters
    ----------
    priority : int
        Priority of the scheduling policy FIFO, from 1; 0 leaves the policy unchanged.
    processor : int
        The only processor that the thread runs on; -1: any.
    lock_memory : bool
        Prevent swapping of the memory of the process.
    freeze : bool
        Exclude the existing objects from Python's garbage collection.

    Returns
    -------
    list of str
        Settings that the operating system refuses, with the permission that each needs.

    """
    faults = []
    if priority:
        faults.append(_apply(
            'realtime_priority', 'a limit for rtprio in /etc/security/limits.conf or CAP_SYS_NICE',
            lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))))
    if processor >= 0:
        faults.append(_apply('processor', 'a processor of this machine, allowed for the process',
                             lambda: os.sched_setaffinity(0, {processor})))
    if lock_memory:
        faults.append(_apply(
            'lock_memory', 'a limit for memlock in /etc/security/limits.conf or CAP_IPC_LOCK',
            _lock_memory))
    if freeze:
        gc.collect()
        gc.freeze()
    return [fault for fault in faults if fault]


def _lock_memory() -> None:
    """Lock the memory of the process."""
    if ctypes.CDLL(None, use_errno=True).mlockall(MCL_CURRENT | MCL_FUTURE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _apply(parameter: str, needed: str, setting: Callable[[], object]) -> str:
    """Apply a setting; return the fault if it is refused, or an empty string."""
    try:
        setting()
    except (OSError, ValueError) as error:
        return f'parameter {parameter} has no effect: {error}; it takes {needed}'
    return ''

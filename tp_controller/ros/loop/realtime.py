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

"""Settings of the operating system for the thread of the loop."""

from collections.abc import Callable
import ctypes
import gc
import os

# <sys/mman.h>: everything that is and will be in memory.
MCL_CURRENT, MCL_FUTURE = 1, 2


def prepare(priority: int, processor: int, lock_memory: bool, freeze: bool) -> list[str]:
    """
    Prepare this thread, and what it shares with others, for regular cycles.

    Parameters
    ----------
    priority : int
        Of the scheduling policy FIFO, from 1; 0 leaves the policy as it is.
    processor : int
        The only one that the thread runs on; -1: any.
    lock_memory : bool
        Nothing of the process is written to disk while other processes need memory.
    freeze : bool
        Python's garbage collector leaves alone what is there now.

    Returns
    -------
    list of str
        What the operating system does not permit, and what it takes.

    """
    faults = []
    if priority:
        faults.append(_refused(
            'realtime_priority', 'a limit for rtprio in /etc/security/limits.conf or CAP_SYS_NICE',
            lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))))
    if processor >= 0:
        faults.append(_refused('processor', 'a processor of this machine, allowed for the process',
                               lambda: os.sched_setaffinity(0, {processor})))
    if lock_memory:
        faults.append(_refused(
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


def _refused(parameter: str, needed: str, setting: Callable[[], object]) -> str:
    """Return why something cannot be set; empty where it was."""
    try:
        setting()
    except (OSError, ValueError) as error:
        return f'parameter {parameter} has no effect: {error}; it takes {needed}'
    return ''

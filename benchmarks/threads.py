# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Count control cycles per second of one controller, and of two in threads of one process.

Run as ``python benchmarks/threads.py`` on a machine with two idle cores. The compiled core works
without the lock of the interpreter; what is left in Python takes turns. One and two threads
alternate, so that a machine whose speed drifts affects both alike. Figures are medians over the
rounds, with the smallest and the largest.
"""

import argparse
from threading import Barrier, Thread
import time

import numpy as np
from solver import CASES, load_case, PERIOD, STATES

SECONDS = 0.5
THREADS = 2


def count(case, barrier, until, found):
    """Append the number of cycles until a time that the first of all threads sets."""
    if barrier.wait() == 0:
        until.append(time.perf_counter() + SECONDS)
    barrier.wait()
    end, cycles, update = until[0], 0, case.controller.update
    while time.perf_counter() < end:
        update(case.states[cycles % STATES], 0.0, elapsed=PERIOD)
        cycles += 1
    found.append(cycles)


def rate(cases):
    """Return the cycles per second of controllers in a thread each."""
    barrier, until, found = Barrier(len(cases)), [], []
    threads = [Thread(target=count, args=(case, barrier, until, found)) for case in cases]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(found) / SECONDS


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=9)
    rounds = parser.parse_args().rounds
    print('| stack | one thread, cycles/s | two threads, times as many |')
    print('| --- | --- | --- |')
    for name, given in CASES.items():
        kinds = [load_case(*given) for _ in range(THREADS)]
        for limits in ('free', 'limited'):
            cases = [each[limits] for each in kinds]
            pairs = [(rate(cases[:1]), rate(cases)) for _ in range(rounds)]
            one = [pair[0] for pair in pairs]
            ratio = [pair[1] / pair[0] for pair in pairs]
            shown = f'{name}, limits active' if limits == 'limited' else name
            print(f'| {shown} | {np.median(one):.0f} | {np.median(ratio):.2f} '
                  f'({min(ratio):.2f}–{max(ratio):.2f}) |')


if __name__ == '__main__':
    main()

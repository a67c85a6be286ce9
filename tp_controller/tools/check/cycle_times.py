# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Processor time of a cycle, and of a whole check, on this machine."""

from time import perf_counter, thread_time

import numpy as np
from tp_controller.errors import TpControllerError
from tp_controller.tools.check.closed_loop import start_loop
from tp_controller.tools.check.configuration_sample import sample_configuration
from tp_controller.tools.check.results import Timing
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Cycles until the caches are warm, and measured cycles.
WARM_UP_CYCLES = 50
MEASURED_CYCLES = 500
# Samples and time [s] from which the time of a check is estimated, and share of the longest time
# that a run mostly takes [1].
TRIED_SAMPLES, TRIED_SECONDS, USUAL_SHARE = 3, 1.0, 0.6


def cycle_times(setup: Setup, seed: np.random.SeedSequence) -> Timing:
    """
    Measure the processor time of `Controller.update` between two configurations.

    Processor time excludes other programs.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    seed : numpy.random.SeedSequence
        Seed of the two configurations.

    Returns
    -------
    Timing

    """
    random = np.random.default_rng(seed)
    start, goals = (random_configuration(setup.robot, random, setup.around) for _ in range(2))
    loop = start_loop(setup, start, goals)
    took = []
    for _ in range(WARM_UP_CYCLES + MEASURED_CYCLES):
        began = thread_time()
        command = loop.controller.update(loop.simulator.q, loop.now)
        took.append(thread_time() - began)
        loop.follow(command)
    median, most = np.quantile(took[WARM_UP_CYCLES:], (0.5, 0.99)).tolist()
    return Timing(MEASURED_CYCLES, median, most, max(took[WARM_UP_CYCLES:]))


def expected_seconds(setup: Setup, samples: int, runs: int) -> float:
    """
    Return the time that samples and closed loops take in one process, to about a factor of two.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    samples, runs : int
        Number of configurations and of closed loops.

    Returns
    -------
    float
        [s]

    """
    seeds = np.random.SeedSequence(0).spawn(TRIED_SAMPLES + 1)
    random = np.random.default_rng(seeds.pop())
    start, goals = (random_configuration(setup.robot, random, setup.around) for _ in range(2))
    took = []
    for seed in seeds:
        began = perf_counter()
        sample_configuration(setup, seed)
        took.append(perf_counter() - began)
    try:
        began = perf_counter()
        loop = start_loop(setup, start, goals)
        loop.run(min(TRIED_SECONDS, setup.seconds), tolerant=False)
        per_second = (perf_counter() - began) / loop.now
    except TpControllerError:
        # A task fails; the runs report it.
        per_second = 0.0
    return samples * min(took) + runs * USUAL_SHARE * setup.seconds * per_second

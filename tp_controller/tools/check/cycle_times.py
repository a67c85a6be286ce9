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

"""Processor time of a cycle on this machine."""

from time import thread_time

import numpy as np
from tp_controller.tools.check.closed_loop import start_loop
from tp_controller.tools.check.results import Timing
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Cycles until the caches are warm, and measured cycles.
WARM_UP_CYCLES = 50
MEASURED_CYCLES = 500


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

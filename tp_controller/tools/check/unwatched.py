# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Links that overlap in samples, but that a task of the type `self_collision` leaves out."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
from tp_controller.errors import TaskError
from tp_controller.tasks.self_collision import SelfCollision
from tp_controller.tools.check.results import DOUBTFUL, Finding
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Largest number of configurations, and share of them from which an overlap counts [1].
CONFIGURATIONS, OFTEN = 60, 0.05


def about_unwatched(setup: Setup, seed: np.random.SeedSequence) -> Iterator[Finding]:
    """Yield a finding for each task whose key `links` leaves out links that overlap."""
    for task in setup.stack.active_tasks:
        if not isinstance(task, SelfCollision) or not task.links:
            continue
        try:
            every = task.with_all_links()
        except TaskError:
            # The description lacks shapes, or there are too many pairs.
            continue
        overlaps = _overlaps(setup, task, every, seed)
        often = [pair for pair, count in overlaps.most_common() if count >= OFTEN * CONFIGURATIONS]
        if often:
            share = overlaps[often[0]] / CONFIGURATIONS
            more = f', as {len(often) - 1} more pairs' if len(often) > 1 else ''
            yield Finding(DOUBTFUL, 'unwatched', task.name,
                          f'{often[0]} overlap in {share:.0%} of the samples, and its links leave '
                          f'them out{more}', 'add them to links, or leave out the key links')


def _overlaps(setup: Setup, task: SelfCollision, every: SelfCollision,
              seed: np.random.SeedSequence) -> Counter[str]:
    """Return in how many configurations each pair overlaps that a task does not check."""
    random, found = np.random.default_rng(seed), Counter[str]()
    for _ in range(CONFIGURATIONS):
        state = setup.robot.state(random_configuration(setup.robot, random, setup.around))
        seen = every.observe_rows(state)
        found.update({name for name, distance in zip(seen.names or (), seen.value)
                      if distance < 0.0 and name not in task.pairs})
    return found

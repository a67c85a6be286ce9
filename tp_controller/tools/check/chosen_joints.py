# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings about the joints that tasks may move, and about the weights of their rows."""

from collections.abc import Iterator, Sequence

import numpy as np
from tp_controller.solver.level import Mask
from tp_controller.tasks.task import Task
from tp_controller.tools.check.configuration_sample import ChosenJoints, ConfigurationSample
from tp_controller.tools.check.results import DOUBTFUL, Finding, WRONG
from tp_controller.tools.check.setup import Setup

# Ratio of two weights of a level from which the lighter row hardly counts [1].
IMPLAUSIBLE_RATIO = 1e6
# Largest number of joints that a sentence lists.
JOINTS_PER_FINDING = 8


def about_joints(setup: Setup, configurations: Sequence[ConfigurationSample],
                 filling: frozenset[str]) -> Iterator[Finding]:
    """Yield the findings about the joints that tasks may move; see `about_levels`."""
    for task in setup.stack.active_tasks:
        found = [each.chosen[task.name] for each in configurations if task.name in each.chosen]
        mask = task.joint_mask
        if found and mask is not None:
            yield from _about_joints_of(task, mask, found, task.name in filling)


def _about_joints_of(task: Task, mask: Mask, found: Sequence[ChosenJoints], fills: bool
                     ) -> Iterator[Finding]:
    """Yield the findings about the joints of a task; `fills`: it demands every joint."""
    robot = task.robot
    rows, frame = (np.any([getattr(each, what) for each in found], axis=0)
                   for what in ('rows', 'frame'))
    if not (mask & rows).any():
        if rows.any():
            yield Finding(WRONG, 'joints', task.name,
                          f'none of its joints moves it: {_joints(task, mask)}',
                          f'let it move one or more of {_joints(task, rows)}')
        return
    in_groups = {name for names in robot.groups.values() for name in names
                 if mask[np.isin(robot.velocity_names, names)].all()}
    idle = np.isin(robot.velocity_names, list(set(task.used_joints or ()) - in_groups)) & ~frame
    if idle.any():
        yield Finding(DOUBTFUL, 'joints', task.name,
                      f'its joints have no effect on it: {_joints(task, idle)}',
                      f'leave them out; it moves with {_joints(task, rows)}')
    left, every = np.median([(each.rank, each.rank_of_all) for each in found], axis=0)
    if left < every and not fills and not task.bounded:
        count = int((mask & rows).sum())
        yield Finding(DOUBTFUL, 'joints', task.name,
                      f'it uses {count} {"joint" if count == 1 else "joints"} only and demands '
                      f'{task.rows} rows: {left:g} of the {every:g} directions that all joints '
                      'give are left, in the median',
                      f'let it use more joints, such as {_joints(task, rows & ~mask)}, or leave '
                      'out axes')


def _joints(task: Task, mask: Mask) -> str:
    """Return the names of the velocities of a mask (n,)."""
    names = [name for name, its in zip(task.robot.velocity_names, mask) if its]
    return ', '.join(names[:JOINTS_PER_FINDING]) + ', …' * (len(names) > JOINTS_PER_FINDING)


def about_row_weights(setup: Setup) -> Iterator[Finding]:
    """Yield the findings about weights of rows that are far apart, or have no effect."""
    for number, group in enumerate(setup.stack.active, 1):
        weights = [np.ones(1) if task.row_weights is None else task.row_weights.ravel()
                   for task in group]
        weighted = ', '.join(task.name for task in group if task.row_weights is not None)
        every = np.concatenate(weights)
        if not weighted:
            continue
        ratio = float(every.max() / every.min())
        if ratio == 1.0:
            yield Finding(DOUBTFUL, 'weights', weighted,
                          f'its weights have no effect: all rows of level {number} weigh the '
                          'same', 'weigh rows against each other; to put a task before others, '
                          'move it up in the stack')
        elif ratio >= IMPLAUSIBLE_RATIO:
            yield Finding(DOUBTFUL, 'weights', weighted,
                          f'weights of level {number} differ by a factor of {ratio:.0e}: the '
                          'lighter rows hardly count', 'weights of 0.01 to 100 are enough; what '
                          'matters more in any case belongs on a level above')

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

"""Gains and tolerances of tasks: which ones a task can have, and which gains are doubtful."""

from collections.abc import Iterator
from contextlib import contextmanager
import math
from typing import NamedTuple

import numpy as np
from tp_controller.errors import SettingsError
from tp_controller.foreign import foreign
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.keys import Gain, MAX_NUMBER, parse_gain, Tolerance
from tp_controller.tasks.task import Task

ROUNDING = 1e-12
# Gain times period; docs/method.md, time steps and gains. Of inequality tasks and of others the
# largest one: beyond it bounds are crossed, and errors grow.
BOUNDED, STABLE = 1.0, 2.0
# From these on a step overshoots the goal, and the steps of a robot that obeys a cycle late do by
# more than half.
OVERSHOOTS, DOUBTFUL = 1.0, 0.5
# Up to this one they do not overshoot.
LATE = 0.25


class GainRemark(NamedTuple):
    """
    What is doubtful about a gain.

    Attributes
    ----------
    step : float
        Gain times period.
    message, change : str
        What is the case, and what can be changed.

    """

    step: float
    message: str
    change: str


def decay_step(task: Task, gain: Gain, period: float) -> float | None:
    """Return gain times period of a task whose gain says how fast an error decays, else None."""
    if task.bounded or isinstance(task, GradientTask) or 'gain' not in task.accepted_keys():
        return None
    return float(np.max(gain)) * period if np.size(gain) else math.nan


def gain_limit(task: Task, period: float) -> tuple[float, str]:
    """Return the largest gain of a task in cycles of a period [s], and why as text."""
    if task.bounded:
        return BOUNDED / period, '1/period, or its bounds would be crossed'
    if decay_step(task, 0.0, period) is not None:
        return STABLE / period, '2/period, or its error would grow from cycle to cycle; ' \
                                f'{LATE:g}/period does not overshoot, a cycle late either'
    return MAX_NUMBER, ''


def gain_faults(task: Task, gain: Gain, period: float) -> list[str]:
    """Return what is wrong with a gain of a task in cycles of a period [s]."""
    largest, why = gain_limit(task, period)
    if not why or np.max(gain, initial=0.0) <= largest * (1.0 + ROUNDING):
        return []
    rule, _, reason = why.partition(', ')
    return [f'gain {np.max(gain):g} of task {task.name} must be at most {rule} = {largest:g}, '
            f'{reason}']


def gain_remark(task: Task, gain: Gain, period: float) -> GainRemark | None:
    """Return what is doubtful about a gain of a task in cycles of a period [s]; mostly None."""
    step = decay_step(task, gain, period)
    if step is None or not step >= DOUBTFUL:
        return None
    if step > OVERSHOOTS:
        effect = 'every cycle overshoots the goal'
    elif step == OVERSHOOTS:
        effect = 'any delay makes it overshoot'
    else:
        effect = 'a robot that obeys a cycle late overshoots'
    rate = 1.0 / period
    return GainRemark(
        step, f'gain {step * rate:g}/s at {rate:g} Hz: after one cycle {1.0 - step:.2g} of the '
        f'error is left; {effect}',
        f'a gain of at most {LATE * rate:.3g}/s does not overshoot, a cycle late either '
        '(docs/method.md, time steps and gains); or raise the rate')


def check_gain(task: Task, gain: Gain, period: float) -> None:
    """Raise `SettingsError` if a task cannot have a gain in cycles of a period [s]."""
    with _as_setting(task, 'gain'):
        parsed = parse_gain(gain, task.rows)
    faults = gain_faults(task, parsed, period)
    if faults:
        raise SettingsError(faults)


def set_gain(task: Task, gain: Gain, period: float) -> None:
    """Give a task another gain, or raise `SettingsError` as `check_gain` does."""
    check_gain(task, gain, period)
    with foreign:
        task.set_gain(gain)


def check_tolerance(task: Task, tolerance: Tolerance) -> None:
    """Raise `SettingsError` if a task cannot have such tolerances."""
    with _as_setting(task, 'tolerance'):
        with foreign:
            task.parse_tolerance(tolerance)


def set_tolerance(task: Task, tolerance: Tolerance) -> None:
    """Give a task other tolerances, or raise `SettingsError` as `check_tolerance` does."""
    check_tolerance(task, tolerance)
    with foreign:
        task.set_tolerance(tolerance)


@contextmanager
def _as_setting(task: Task, key: str) -> Iterator[None]:
    """Raise a `SettingsError` for a value that a key of a task cannot have."""
    if key not in task.accepted_keys():
        raise SettingsError([f'task {task.name} of the type {task.type_name} has no {key}'])
    try:
        yield
    except ValueError as error:
        raise SettingsError([f'{key} of task {task.name} {error}']) from error

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Gains and tolerances of tasks: valid values, and remarks about doubtful gains."""

from collections.abc import Iterator
from contextlib import contextmanager
import math
from typing import NamedTuple

import numpy as np
from tp_controller.errors import SettingsError
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.keys import Gain, MAX_NUMBER, parse_gain, Tolerance
from tp_controller.tasks.task import Task
from tp_controller.untrusted.calls import foreign

# Relative rounding error of a gain at its limit [1].
RELATIVE_ROUNDING = 1e-12
# Largest gain times period [1] of inequality tasks and of other tasks (docs/method.md, time steps
# and gains). Above it bounds are crossed, and errors grow.
BOUNDED_STEP, STABLE_STEP = 1.0, 2.0
# Gain times period [1] from which a step overshoots the goal, and from which the steps of a robot
# with one cycle of delay overshoot by more than half.
OVERSHOOT_STEP, DOUBTFUL_STEP = 1.0, 0.5
# Largest gain times period [1] without overshoot at one cycle of delay.
DELAY_SAFE_STEP = 0.25


class GainRemark(NamedTuple):
    """
    Remark about a doubtful gain.

    Attributes
    ----------
    step : float
        Gain times period.
    message, change : str
        Observation, and suggested change.

    """

    step: float
    message: str
    change: str


def decay_step(task: Task, gain: Gain, period: float) -> float | None:
    """Return gain times period; None for a task whose gain is not the decay rate of an error."""
    if task.bounded or isinstance(task, GradientTask) or 'gain' not in task.accepted_keys():
        return None
    return float(np.max(gain)) * period if np.size(gain) else math.nan


def gain_limit(task: Task, period: float) -> tuple[float, str]:
    """Return the largest gain of a task for a control period [s], and the reason as text."""
    if task.bounded:
        return BOUNDED_STEP / period, '1/period, or its bounds would be crossed'
    if decay_step(task, 0.0, period) is not None:
        return (STABLE_STEP / period,
                '2/period, or its error would grow from cycle to cycle; '
                f'{DELAY_SAFE_STEP:g}/period does not overshoot, even a cycle late')
    return MAX_NUMBER, ''


def gain_faults(task: Task, gain: Gain, period: float) -> list[str]:
    """Return the faults of a gain of a task for a control period [s]."""
    largest, why = gain_limit(task, period)
    if not why or np.max(gain, initial=0.0) <= largest * (1.0 + RELATIVE_ROUNDING):
        return []
    rule, _, reason = why.partition(', ')
    return [f'gain {np.max(gain):g} of task {task.name} must be at most {rule} = {largest:g}, '
            f'{reason}']


def gain_remark(task: Task, gain: Gain, period: float) -> GainRemark | None:
    """Return the remark about a gain of a task for a control period [s]; mostly None."""
    step = decay_step(task, gain, period)
    if step is None or not step >= DOUBTFUL_STEP:
        return None
    if step > OVERSHOOT_STEP:
        effect = 'every cycle overshoots the goal'
    elif step == OVERSHOOT_STEP:
        effect = 'any delay makes it overshoot'
    else:
        effect = 'a robot that obeys a cycle late overshoots'
    rate = 1.0 / period
    return GainRemark(
        step, f'gain {step * rate:g}/s at {rate:g} Hz: after one cycle {1.0 - step:.2g} of the '
        f'error is left; {effect}',
        f'a gain of at most {DELAY_SAFE_STEP * rate:.3g}/s does not overshoot, even a cycle '
        'late (docs/method.md, time steps and gains); or raise the rate')


def check_gain(task: Task, gain: Gain, period: float) -> None:
    """Raise `SettingsError` if a gain of a task is not valid for a control period [s]."""
    with _as_setting(task, 'gain'):
        parsed = parse_gain(gain, task.rows)
    faults = gain_faults(task, parsed, period)
    if faults:
        raise SettingsError(faults)


def set_gain(task: Task, gain: Gain, period: float) -> None:
    """Set the gain of a task, or raise `SettingsError` as `check_gain` does."""
    check_gain(task, gain, period)
    with foreign:
        task.set_gain(gain)


def check_tolerance(task: Task, tolerance: Tolerance) -> None:
    """Raise `SettingsError` if a tolerance of a task is not valid."""
    with _as_setting(task, 'tolerance'):
        with foreign:
            task.parse_tolerance(tolerance)


def set_tolerance(task: Task, tolerance: Tolerance) -> None:
    """Set the tolerance of a task, or raise `SettingsError` as `check_tolerance` does."""
    check_tolerance(task, tolerance)
    with foreign:
        task.set_tolerance(tolerance)


@contextmanager
def _as_setting(task: Task, key: str) -> Iterator[None]:
    """Raise a `SettingsError` if a value of a key of a task is not valid."""
    if key not in task.accepted_keys():
        raise SettingsError([f'task {task.name} of the type {task.type_name} has no {key}'])
    try:
        yield
    except ValueError as error:
        raise SettingsError([f'{key} of task {task.name} {error}']) from error

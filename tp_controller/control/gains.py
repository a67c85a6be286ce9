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

"""Gains and tolerances that change while a task is carried out: which ones a task can have."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from tp_controller.errors import SettingsError
from tp_controller.foreign import foreign
from tp_controller.tasks.keys import Gain, parse_gain, Tolerance
from tp_controller.tasks.task import Task

ROUNDING = 1e-12


def gain_faults(task: Task, gain: Gain, period: float) -> list[str]:
    """Return what is wrong with a gain of a task in cycles of a period [s]."""
    if task.bounded and np.max(gain) * period > 1.0 + ROUNDING:
        return [f'gain {np.max(gain):g} of task {task.name} must be at most 1/period = '
                f'{1.0 / period:g}, or its bounds would be crossed']
    return []


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

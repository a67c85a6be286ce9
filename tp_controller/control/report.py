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

"""The report of a cycle: for every task how far it is, and what holds it back."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from tp_controller.control.velocity_limits import VelocityBounds
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.level import NEGLIGIBLE
from tp_controller.solver.solution import LevelSolution, Solution
from tp_controller.tasks.bounded import out_of_reach, STILL
from tp_controller.tasks.task import Evaluation, norm, Task

# A part of the wanted velocity below this is rounding, not something that was held back.
UNNOTICED = 1e-6
# A task is called slowed or held back when it misses more than this share of what it wants.
NOTABLE = 0.01
NEAR_SINGULAR = 0.1
# How many joints are named that stand in the way of one task.
NAMED = 3


@dataclass(frozen=True)
class TaskReport:
    """
    One task in one cycle.

    Attributes
    ----------
    name, type_name : str
    level : int or None
        From 1, the highest priority; None while the task is disabled.
    errors : tuple of (float, str, float)
        Norm of the error, its unit and the tolerance, for each unit.
    reached : bool
        Every error is within its tolerance.
    wanted_speed, achieved_speed : float
        Norm of the wanted task velocity, and of its part that is carried out (over all rows;
        m/s and rad/s are added up as they are).
    reason : str
        What holds the task back; empty where nothing does.
    bounded : bool
        The task keeps bounds instead of wanting a velocity.

    """

    name: str
    type_name: str
    level: int | None
    errors: tuple[tuple[float, str, float], ...]
    reached: bool
    wanted_speed: float
    achieved_speed: float
    reason: str
    bounded: bool = False

    @property
    def status(self) -> str:
        """Return ``disabled``, ``reached``, ``kept`` (bounds), ``moving`` or ``held back``."""
        if self.level is None:
            return 'disabled'
        if self.reached:
            return 'kept' if self.bounded else 'reached'
        return 'held back' if self.reason else 'moving'


class Report:
    """
    What the solver made of the stack in one cycle; worked out when it is asked for.

    Attributes
    ----------
    scale : float
        Factor by which the limits slowed the command.
    tasks : tuple of TaskReport
        In order of priority, the disabled ones last.

    """

    def __init__(self, robot: Robot, evaluations: Sequence[Sequence[Evaluation]],
                 disabled: Sequence[Task], bounds: VelocityBounds, solution: Solution,
                 eased: str) -> None:
        self._robot, self._bounds, self._solution = robot, bounds, solution
        self._evaluations, self._disabled = evaluations, disabled
        self._eased = eased

    @cached_property
    def tasks(self) -> tuple[TaskReport, ...]:
        """Return a `TaskReport` for every task."""
        reports = [self._task(number, evaluation, rows, level)
                   for number, level in enumerate(self._solution.levels, 1)
                   for evaluation, rows in self._members(number - 1)]
        reports.extend(TaskReport(task.name, task.type_name, None, (), False, 0.0, 0.0,
                                  'disabled') for task in self._disabled)
        return tuple(reports)

    def _members(self, index: int) -> Iterator[tuple[Evaluation, slice]]:
        """Yield (evaluation, its rows) of a level, from 0."""
        first = 0
        for evaluation in self._evaluations[index]:
            rows = len(evaluation.level.J)
            yield evaluation, slice(first, first + rows)
            first += rows

    @property
    def scale(self) -> float:
        """Return the smallest factor that the limits put on a level."""
        return self._solution.scale

    @property
    def reached(self) -> bool:
        """Return whether every enabled task is at its goal."""
        return all(task.reached for task in self.tasks if task.level is not None)

    @property
    def limiting(self) -> str:
        """Return what slows the command, as text; empty where nothing does."""
        index = self._solution.limiting
        if index is None:
            return ''
        level = next(level for level in self._solution.levels if level.limited_by)
        return self._limit(index, level)

    def _limit(self, joint: int, level: LevelSolution) -> str:
        """Return which limit of a joint stands in the way of a level, as text."""
        up = level.multipliers[joint] > 0.0
        name = self._bounds.name(joint, level.limited_velocity[joint], up)
        return f'{self._robot.velocity_names[joint]} at its {name}'

    def _task(self, number: int, evaluation: Evaluation, rows: slice,
              level: LevelSolution) -> TaskReport:
        """Return the report of a task that is rows `rows` of a level."""
        task = evaluation.task
        wanted = level.wanted[rows] / task.row_scale
        achieved = level.achieved[rows] / task.row_scale
        errors = task.reported_errors(evaluation.error, wanted - achieved)
        stuck = self._stuck(evaluation) if task.bounded else ''
        return TaskReport(
            task.name, task.type_name, number, errors,
            all(value <= tolerance for value, _, tolerance in errors), norm(wanted),
            norm(achieved), self._reason(number, task, level, wanted, achieved, stuck),
            task.bounded)

    def _stuck(self, evaluation: Evaluation) -> str:
        """Return what no joint can bring back to within its bounds, as text; mostly nothing."""
        error, J, names = evaluation.error, evaluation.level.J, evaluation.row_names
        if not error.any():
            return ''
        moved = np.sqrt((J * J).sum(axis=1))
        still = np.flatnonzero((moved < STILL) & (out_of_reach(error, moved) > 0.0)).tolist()
        if not still:
            return ''
        which = list(dict.fromkeys(names[row] for row in still))[:NAMED] if names else ['it']
        return f'no joint brings {", ".join(which)} back'

    def _reason(self, number: int, task: Task, level: LevelSolution, wanted: Array,
                achieved: Array, stuck: str) -> str:
        """Return what holds a task back."""
        speed = norm(wanted)
        enough = max(UNNOTICED, NOTABLE * speed)
        if norm(wanted - achieved) <= enough:
            return stuck
        reasons = [stuck] if stuck else []
        in_the_way = [*(self._limit(joint, level) for joint in level.limited_by[:NAMED]),
                      *self._bounds_of_tasks(task, level)[:NAMED]]
        if in_the_way:
            share = (f'slowed to {100.0 * level.scale:.0f} %' if level.scale < 1.0 - NOTABLE
                     else 'turned aside')
            reasons.append(f'{share} by {", ".join(in_the_way)}')
        if norm(level.unreachable) > enough:
            reasons.append(self._missing_directions(number, level))
        if task.bounded and not reasons:
            reasons.append('its bounds contradict each other' if number == 1
                           else 'in conflict with higher levels')
        if self._eased:
            reasons.append(self._eased)
        return ', '.join(reasons)

    def _bounds_of_tasks(self, task: Task, level: LevelSolution) -> list[str]:
        """Return the other tasks whose bounds stand in the way of one, as text."""
        found = []
        for index, multipliers in level.row_multipliers.items():
            for evaluation, rows in self._members(index):
                other, names = evaluation.task, evaluation.row_names
                pushing = np.flatnonzero(multipliers[rows]).tolist()
                if other is not task and pushing:
                    which = dict.fromkeys(names[row] for row in pushing) if names else {}
                    found.append(f'{other.name} ({", ".join(list(which)[:NAMED])})' if which
                                 else other.name)
        return found

    def _missing_directions(self, number: int, level: LevelSolution) -> str:
        """Return why a level cannot move the way it wants, apart from the limits."""
        rows, smallest = len(level.wanted), level.smallest_singular_value
        alone = self._solution.singular_values_alone(number - 1)
        possible = int(np.count_nonzero(alone > NEGLIGIBLE * norm(alone)))
        if possible < rows:
            return f'{possible} of {rows} directions possible for the robot here'
        if level.rank < rows:
            return f'{level.rank} of {rows} directions left by higher levels'
        if smallest >= NEAR_SINGULAR:
            return 'damped'
        if alone[-1] >= NEAR_SINGULAR:
            return 'in conflict with higher levels'
        return f'near a singularity (smallest singular value {smallest:.2g})'

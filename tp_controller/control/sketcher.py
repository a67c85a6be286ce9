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

"""Pictures of the tasks of a controller, made beside its cycles."""

from collections import Counter
from collections.abc import Callable, Mapping
from itertools import islice
import time
from typing import TypeAlias

from numpy.typing import ArrayLike
from tp_controller.control.controller import Controller
from tp_controller.foreign import foreign
from tp_controller.model.robot import Robot
from tp_controller.tasks.sketch import Sketch
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import MAX_SLOW_CYCLES, raised

Place: TypeAlias = tuple[ArrayLike, ArrayLike | None]
# How many parts of a task are drawn.
MOST_PARTS = 200
# A task that takes longer than this, `MAX_SLOW_CYCLES` times in a row, is not drawn any more [s]:
# what else is told about the controller would be late. Those of this package take milliseconds.
SOON = 0.2


class Sketcher:
    """
    Sketches what a controller does, while it goes on.

    It has a state of its own, and sketches copies of the tasks: no cycle can notice.

    Parameters
    ----------
    robot : Robot
        Of the controllers.
    refused : callable
        Told the name of a task that cannot be drawn, and why.

    """

    def __init__(self, robot: Robot, refused: Callable[[str, str], object]) -> None:
        self._state, self._refused = robot.state(robot.neutral()), refused
        # How many times in a row each task has taken too long.
        self._late: Counter[Task] = Counter()

    def sketch(self, controller: Controller, place: Place | None = None
               ) -> Mapping[str, list[Sketch]]:
        """
        Return what can be drawn of the enabled tasks.

        Parameters
        ----------
        controller : Controller
            Another thread may use it meanwhile if it is a `SharedController`.
        place : tuple, optional
            Where the robot is, as `Controller.configuration` returns it; by default where it was
            in the last cycle.

        Returns
        -------
        dict
            {task: list of Sketch}, in order of priority; empty where nobody knows where the robot
            is.

        Raises
        ------
        RobotError
            `place` cannot be one.

        """
        place = place or controller.configuration()
        if place is None:
            return {}
        self._state.update(*place)
        # Tasks of another stack get a chance of their own.
        for task in self._late.keys() - set(controller.stack.tasks.values()):
            del self._late[task]
        return {task.name: self._parts(task) for task in controller.stack.active_tasks}

    def _parts(self, task: Task) -> list[Sketch]:
        """Return what can be drawn of a task; nothing where it fails or takes too long."""
        if self._late[task] >= MAX_SLOW_CYCLES:
            return []
        began = time.monotonic()
        try:
            with foreign:
                parts = list(islice(task.probe().sketch(self._state), MOST_PARTS))
        except Exception as error:
            # Of a type of another package; it is carried out all the same.
            self._refused(task.name, raised(Task.sketch, error))
            return []
        self._check_time(task, time.monotonic() - began)
        return parts

    def _check_time(self, task: Task, took: float) -> None:
        """Count how often a task takes too long."""
        self._late[task] = self._late[task] + 1 if took > SOON else 0
        if self._late[task] == MAX_SLOW_CYCLES:
            self._refused(task.name, f'sketch took more than {SOON:g} s, {MAX_SLOW_CYCLES} times '
                                     'in a row')

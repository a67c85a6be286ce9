# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Sketches and poses of the tasks of a controller, made outside of its cycles."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import islice
import time
from typing import NamedTuple, TypeAlias

from numpy.typing import ArrayLike
from tp_controller.control.controller import Controller
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, pose
from tp_controller.tasks.frame import FrameTask, RelativeFrame
from tp_controller.tasks.sketch import Sketch
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import MAX_SLOW_CYCLES, raised
from tp_controller.untrusted.calls import foreign

# Configuration and positions of the passive joints.
Configuration: TypeAlias = tuple[ArrayLike, ArrayLike | None]
# Largest number of drawn parts of a task.
MOST_PARTS = 200
# Time limit of a sketch [s]. A task that exceeds it `MAX_SLOW_CYCLES` times in a row is no longer
# drawn: it would delay the other reports. The tasks of this package take milliseconds.
SKETCH_SECONDS = 0.2


class FramePose(NamedTuple):
    """Pose of the frame of a task: T_reference_frame (4, 4), and both names."""

    reference: str
    frame: str
    T: Array


class Sketcher:
    """
    Sketcher of the tasks of a controller that keeps running.

    It has a state of its own and sketches copies of the tasks, so it does not affect the cycles.

    Parameters
    ----------
    robot : Robot
        Robot of the controllers.
    refused : callable
        Called with the name of a task that cannot be drawn, and the reason.

    """

    def __init__(self, robot: Robot, refused: Callable[[str, str], object]) -> None:
        self._robot, self._refused = robot, refused
        self._state = robot.state(robot.neutral())
        # Number of times in a row that each task exceeded the time limit.
        self._late: Counter[Task] = Counter()

    def sketch(self, controller: Controller, place: Configuration | None = None
               ) -> Mapping[str, list[Sketch]]:
        """
        Return the sketches of the enabled tasks.

        Parameters
        ----------
        controller : Controller
            Another thread may use it meanwhile if it is a `SharedController`.
        place : tuple, optional
            Configuration of the robot as returned by `Controller.configuration`; by default that
            of the last cycle.

        Returns
        -------
        dict
            {task: list of Sketch}, in order of priority; empty while the configuration is unknown.

        Raises
        ------
        RobotError
            `place` is not a valid configuration.

        """
        if not self._move(controller, place):
            return {}
        # Tasks of another stack start with a count of zero.
        for task in self._late.keys() - set(controller.stack.tasks.values()):
            del self._late[task]
        return {task.name: self._parts(task) for task in controller.stack.active_tasks}

    def poses(self, controller: Controller, names: Iterable[str],
              place: Configuration | None = None) -> Mapping[str, FramePose]:
        """Return {task: FramePose} of some tasks about a frame; the rest as in `sketch`."""
        if not self._move(controller, place):
            return {}
        tasks = controller.stack.tasks
        return {name: self._pose_of(task) for name in names
                if isinstance(task := tasks.get(name), FrameTask)}

    def _pose_of(self, task: FrameTask) -> FramePose:
        """Return the pose of the frame of a task."""
        motion = RelativeFrame(self._robot, task.frame, task.reference)
        return FramePose(task.reference, task.frame,
                         pose(motion.rotation(self._state), motion.position(self._state)))

    def _move(self, controller: Controller, place: Configuration | None) -> bool:
        """Move the state to a configuration; return False while it is unknown."""
        place = place or controller.configuration()
        if place is not None:
            self._state.update(*place)
        return place is not None

    def _parts(self, task: Task) -> list[Sketch]:
        """Return the sketch of a task; [] if it fails or exceeds the time limit."""
        if self._late[task] >= MAX_SLOW_CYCLES:
            return []
        began = time.monotonic()
        try:
            with foreign:
                parts = list(islice(task.probe().sketch(self._state), MOST_PARTS))
        except Exception as error:
            # A task type of another package failed to draw; the task still runs.
            self._refused(task.name, raised(Task.sketch, error))
            return []
        self._check_time(task, time.monotonic() - began)
        return parts

    def _check_time(self, task: Task, took: float) -> None:
        """Count the violations of the time limit by a task."""
        self._late[task] = self._late[task] + 1 if took > SKETCH_SECONDS else 0
        if self._late[task] == MAX_SLOW_CYCLES:
            self._refused(task.name, f'sketch took more than {SKETCH_SECONDS:g} s, '
                                     f'{MAX_SLOW_CYCLES} times in a row')

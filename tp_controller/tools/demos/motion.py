# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Motion of a film: a recorded motion of a robot, with goals, captions and objects."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.shapes import Shape
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.sketch import Arrow, Body, Cone, Dot, Sketch, Triad
from tp_controller.tasks.stack import Stack


@dataclass(frozen=True, eq=False)
class FixedObject:
    """
    Solid fixed to a frame of the robot.

    Attributes
    ----------
    frame : str
    shape : object
        One of `tp_controller.model.shapes`.
    at : tuple of float
        Centre in the frame, whose axes it shares [m].

    """

    frame: str
    shape: Shape
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Look:
    """
    Appearance of a film.

    Attributes
    ----------
    frames : tuple of str
        Frames with a drawn path.
    objects : tuple of FixedObject
    carried : tuple of (str, str)
        Pairs of frames that carry one bar.
    view : tuple of float
        Azimuth and elevation of the viewer [deg].
    ground : float or None
        Height of the ground [m]; None: below the robot at the start.
    enlarged : float
        Size factor of the goals.

    """

    frames: tuple[str, ...] = ()
    objects: tuple[FixedObject, ...] = ()
    carried: tuple[tuple[str, str], ...] = ()
    view: tuple[float, float] = (-45.0, 25.0)
    ground: float | None = None
    enlarged: float = 1.0


@dataclass(frozen=True, eq=False)
class Motion:
    """
    Recorded motion with the content of its film.

    Attributes
    ----------
    title : str
    robot : Robot
    times : ndarray (T,)
        [s]
    q : ndarray (T, nq)
        Configurations [rad or m].
    stack : Stack
        Tasks with goals, regions and obstacles to show.
    look : Look
    goals : sequence of (float, str, object)
        Start time of a goal [s], task and goal, in order of time.
    captions : sequence of (float, str)
        Start time of a caption [s], and its text, in order of time.

    """

    title: str
    robot: Robot
    times: Array
    q: Array
    stack: Stack
    look: Look
    goals: Sequence[tuple[float, str, Goal]] = ()
    captions: Sequence[tuple[float, str]] = ()

    def caption(self, sample: int) -> str:
        """Return the caption at a sample."""
        number = bisect_right([time for time, _ in self.captions], self.times[sample])
        return self.captions[number - 1][1] if number else ''


class Playback:
    """
    Sequential playback of a motion.

    Parameters
    ----------
    motion : Motion

    Attributes
    ----------
    state : RobotState
        State of the robot at the sample.

    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self.state: RobotState = motion.robot.state(motion.q[0])
        self._tasks = {name: task.probe() for name, task in motion.stack.tasks.items()}
        for task in self._tasks.values():
            task.reset()
            task.start(self.state)
        self._left = list(motion.goals)
        self._with_goal: set[str] = set()

    def seek(self, sample: int) -> None:
        """Advance to a sample."""
        motion = self._motion
        self.state.update(motion.q[sample])
        while self._left and self._left[0][0] <= motion.times[sample]:
            _, name, goal = self._left.pop(0)
            self._tasks[name] = self._tasks[name].with_goal(self._tasks[name].parse_goal(goal))
            self._with_goal.add(name)

    def sketches(self) -> Mapping[str, list[Sketch]]:
        """Return {task: sketches to show}: given goals, lines to them, regions, and views."""
        return {name: [_without_axes(sketch) if task.goal_type == 'point' else sketch
                       for sketch in task.sketch(self.state) if self._is_shown(name, sketch)]
                for name, task in self._tasks.items()}

    def bars(self) -> list[Array]:
        """Return the ends (2, 3) of the carried bars [m]."""
        return [np.stack((self.state.position(one), self.state.position(other)))
                for one, other in self._motion.look.carried]

    def _is_shown(self, name: str, sketch: Sketch) -> bool:
        """Return whether a film shows a sketch."""
        if isinstance(sketch, Triad | Dot):
            return sketch.part == 'goal' and name in self._with_goal
        if isinstance(sketch, Arrow):
            return sketch.part == 'error' and name in self._with_goal
        if isinstance(sketch, Body):
            return sketch.part != 'sphere'
        return isinstance(sketch, Cone) and self._tasks[name].bounded


def _without_axes(sketch: Sketch) -> Sketch:
    """Return a point in place of axes: a point goal has no orientation."""
    return Dot(sketch.part, sketch.T[:3, 3]) if isinstance(sketch, Triad) else sketch

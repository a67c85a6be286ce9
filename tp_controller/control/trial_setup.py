# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Setup of a roll-out: tasks, settings, robot and start, and changes of them."""

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from tp_controller.control.gains import BOUNDED_STEP, decay_step, DOUBTFUL_STEP
from tp_controller.control.joint_limits import LARGEST_DISTANCE
from tp_controller.control.settings import Settings
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.stack import Groups
from tp_controller.tasks.task import Evaluation, Task

# Factor of velocity limits that are raised.
RAISED = 3.0
# Shortest period of a roll-out [s]: the joints move a few times as far as in a usual cycle.
COARSE_PERIOD = 0.01


class Setup(NamedTuple):
    """
    All that a roll-out may change.

    Attributes
    ----------
    groups : tuple of tuple of Task
        Enabled tasks of each level.
    settings : Settings
    robot : Robot
        Robot with its limits of positions and accelerations.
    velocity : ndarray (n,)
        Velocity limits [rad/s or m/s].
    q : ndarray (nq,)
        First configuration [rad or m].

    """

    groups: Groups
    settings: Settings
    robot: Robot
    velocity: Array
    q: Array

    @property
    def tasks(self) -> dict[str, Task]:
        """Return {name: task}, the highest priority first."""
        return {task.name: task for group in self.groups for task in group}

    @property
    def period(self) -> float:
        """Return the period of a roll-out [s]: a coarse one, unless tasks would overshoot."""
        steps = [float(np.max(task.gain, initial=0.0)) / (
            BOUNDED_STEP if task.bounded else DOUBTFUL_STEP) for task in self.tasks.values()
            if task.bounded or decay_step(task, task.gain, 1.0) is not None]
        return max(self.settings.period, 1.0 / max(steps + [1.0 / COARSE_PERIOD]))

    def with_settings(self, **changes: Any) -> 'Setup':
        """Return the setup with other settings."""
        return self._replace(settings=replace(self.settings, **changes))

    def exchanged(self, one: str, other: str) -> 'Setup':
        """Return the setup with two tasks exchanged."""
        tasks = self.tasks
        return self._with({one: tasks[other], other: tasks[one]})

    def above(self, own: str, names: Iterable[str]) -> 'Setup':
        """Return the setup with a task on a level of its own above others."""
        first = min(index for index, group in enumerate(self.groups)
                    if any(task.name in names for task in group))
        left = self.without(own).groups
        return self._replace(groups=(*left[:first], (self.tasks[own],), *left[first:]))

    def without(self, name: str) -> 'Setup':
        """Return the setup without a task."""
        groups = [tuple([task for task in group if task.name != name]) for group in self.groups]
        return self._replace(groups=tuple(filter(None, groups)))

    def with_goals_at(self, q: Array, passive: Array | None, names: Sequence[str]) -> 'Setup':
        """Return the setup with the goals of some tasks where they are at a configuration."""
        state, tasks = self.robot.state(q, passive), self.tasks
        return self._with({name: tasks[name].with_goal(tasks[name].value(state))
                           for name in names})

    def with_gain(self, name: str, gain: float) -> 'Setup':
        """Return the setup with another gain of a task [1/s]."""
        task = self.tasks[name].probe()
        task.set_gain(gain)
        return self._with({name: task})

    def with_all_joints(self, name: str) -> 'Setup':
        """Return the setup with a task, and those on its level, that may move all joints."""
        group = next(group for group in self.groups if any(task.name == name for task in group))
        free = {task.name: task.probe() for task in group}
        for task in free.values():
            task.joint_mask = None
        return self._with(free)

    def with_part(self, name: str, U: Array) -> 'Setup':
        """Return the setup with a task that demands nothing but the directions U (m, k)."""
        task = self.tasks[name].probe()
        part, evaluate = task.probe(), task.evaluate

        def evaluate_part(state: RobotState, now: float) -> Evaluation:
            """Return the evaluation of the task in these directions."""
            whole, P = evaluate(state, now), U.dot(U.T)
            level = replace(whole.level, J=P.dot(whole.level.J), v=P.dot(whole.level.v))
            return replace(whole, level=level, error=P.dot(whole.error))

        part.evaluate = evaluate_part  # type: ignore[method-assign]
        return self._with({name: part})

    def without_limits(self, key: str, names: Sequence[str]) -> 'Setup':
        """Return the setup with higher velocity limits of joints, or without position limits."""
        joints = [self.robot.velocity_names.index(name) for name in names]
        if key == 'velocity':
            velocity = self.velocity.copy()
            velocity[joints] *= RAISED
            return self._replace(velocity=velocity)
        robot = copy(self.robot)
        limits = getattr(robot, key).copy()
        limits[joints] = LARGEST_DISTANCE if key == 'upper' else -LARGEST_DISTANCE
        setattr(robot, key, limits)
        return self._replace(robot=robot)

    def unlocked(self, names: Sequence[str]) -> 'Setup':
        """Return the setup with the velocity limits that locked joints had."""
        joints = [self.robot.velocity_names.index(name) for name in names]
        velocity = self.velocity.copy()
        velocity[joints] = self.robot.velocity[joints]
        return self._replace(velocity=velocity)

    def in_middle(self, names: Sequence[str]) -> 'Setup':
        """Return the setup that begins at rest with joints in the middle of their ranges."""
        robot, q = self.robot, self.q.copy()
        for name in names:
            if name in robot.joint_names:
                joint = robot.velocity_names.index(name)
                ends = robot.lower[joint], robot.upper[joint]
                if np.isfinite(ends).all() and self.velocity[joint] > 0.0:
                    q[robot.joint_rows.start + robot.joint_names.index(name)] = np.mean(ends)
        return self._replace(q=q)

    def _with(self, tasks: Mapping[str, Task]) -> 'Setup':
        """Return the setup with tasks in place of others, by the names of these."""
        return self._replace(groups=tuple([tuple([tasks.get(task.name, task) for task in group])
                                           for group in self.groups]))

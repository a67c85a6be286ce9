# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Twins of tasks: their inputs, as the compiled core evaluates them.

A task has a twin until one of its attributes is set; the next evaluation makes a new one. A goal
that moves with a velocity is set in place, as a new twin takes as long as some cycles. Arrays
among the inputs become read-only: no twin would notice a change in place. Types that override a
method of the evaluation have no twin.
"""

from typing import Any, NamedTuple, Protocol, TypeAlias

from tp_controller.model.compiled import Motion
from tp_controller.model.spatial import Array
from tp_controller.solver.compiled import core
from tp_controller.solver.level import Mask

# Kinds of twins, in the order of the readers in task_object.h.
(FRAME, JOINTS, JOINT_LIMITS, AXIS, CENTER_OF_MASS, SPEED_LIMIT, REGION, JOINT_LIMIT_DISTANCE,
 CONE, ORIENTATION_RANGE, COM_POLYGON) = range(11)
# rows, whether the mode is ``scale``, gain, feed-forward velocity (or the twist of the
# goal), its time of arrival, timeout, mask of the joints, weights of the rows
Law: TypeAlias = tuple[int, bool, Array, Array | None, float, float, Mask | None, Array | None]


class CompiledTask(Protocol):
    """A task in the compiled core; only a goal that moves changes it."""

    def evaluate(self, motion: Motion, positions: Array, velocity: Array, now: float,
                 error: Array, J: Array, v: Array, upper: Array | None) -> bool:
        """
        Fill in error (m,), J (m, n) and demand v (m,), or lower and upper bounds (m,).

        Return False if arguments do not fit, the feed-forward velocity has timed out, or the
        number of rows changes from cycle to cycle: the reference then evaluates the task.
        """

    def move_goal(self, goal: Array, velocity: Array, now: float) -> bool:
        """
        Set a goal and a feed-forward velocity from a time on, both of the form that they have.

        Return False, and change nothing, if arguments do not fit.
        """


class Watch:
    """
    Watcher of tasks.

    Attributes
    ----------
    changed : bool
        Whether an input of a task has changed since this was last reset.

    """

    def __init__(self) -> None:
        self.changed = True


class Twin(NamedTuple):
    """
    Inputs of a task in the compiled core.

    Attributes
    ----------
    task : CompiledTask
    mode : str
        Mode of its level.

    """

    task: CompiledTask
    mode: str


def make_twin(kind: int, law: Law, inputs: tuple[Any, ...], mode: str) -> Twin | None:
    """Return the twin of a task; None if there is no core, or it does not support the inputs."""
    if core is None:
        return None
    try:
        return Twin(core.Task(kind, law, inputs), mode)
    except ValueError:
        return None

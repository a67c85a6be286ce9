# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Configurations that satisfy the bounds of a stack and reach the goals that it has."""

from collections.abc import Callable
import math

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.positions.solve_position import PositionSolver
from tp_controller.tasks.stack import Stack
from tp_controller.tasks.task import Task
from tp_controller.tools.check.sampling import moved_from, random_configuration
from tp_controller.tools.check.setup import Setup


class ValidConfigurations:
    """
    Search for configurations that satisfy a stack, as far as that is possible.

    Tasks above, without a goal of the stack, keep their values at the configurations drawn: a
    posture below a tool is where the tool allows it.

    Parameters
    ----------
    setup : Setup
        Robot and stack.

    """

    def __init__(self, setup: Setup) -> None:
        levels = setup.stack.active
        last = max((number for number, group in enumerate(levels, 1)
                    if any(map(_is_given, group))), default=0)
        self._stack = Stack(levels[:last])
        self._solver = PositionSolver(setup.robot, self._stack)
        self._tries = setup.tries

    def near(self, draw: Callable[[], Array]) -> tuple[Array, dict[str, bool]]:
        """
        Return the best configuration near some that are drawn, and {task: satisfied}.

        It satisfies bounds, or reaches goals of the stack; bounds count before goals.

        Parameters
        ----------
        draw : callable
            Returns a configuration (nq,) [rad or m].

        """
        if not self._stack.tasks:
            return draw(), {}
        found: list[tuple[Array, dict[str, bool]]] = []
        while not found or len(found) < self._tries and not all(found[-1][1].values()):
            solution = self._solver.solve(start=draw(), attempts=1, timeout=math.inf)
            found.append((np.array(solution.q),
                          {task.name: task.reached for task in solution.tasks
                           if _is_given(self._stack.tasks[task.name])}))
        return max(found, key=lambda each: self._score(each[1]))

    def _score(self, reached: dict[str, bool]) -> tuple[int, int]:
        """Return the score of a configuration."""
        bounded = [ok for name, ok in reached.items() if self._stack.tasks[name].bounded]
        return sum(bounded), sum(reached.values())


def _is_given(task: Task) -> bool:
    """Return whether a task has bounds, or a goal of the stack."""
    return task.has_position and (task.bounded or task.goal is not None)


def goal_configuration(setup: Setup, random: np.random.Generator, start: Array,
                       far: float) -> Array:
    """
    Return a random configuration (nq,) with joints that no task may move as at the start.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    random : numpy.random.Generator
        What is drawn from.
    start : ndarray (nq,)
        Configuration [rad or m].
    far : float
        Distance from there, as a share of that to a random configuration, in [0, 1].

    """
    q = random_configuration(setup.robot, random, start, far)
    masks = [task.joint_mask for task in setup.stack.active_tasks if not task.bounded]
    chosen = [mask for mask in masks if mask is not None]
    if not chosen or len(chosen) < len(masks):
        return q
    return moved_from(setup.robot, start, q, np.any(chosen, axis=0))

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals that a controller reaches by a posture, where the straight way is blocked."""

from collections.abc import Collection

import numpy as np
from tp_controller.control.controller import Controller
from tp_controller.control.lead import ARRIVED
from tp_controller.errors import GoalError
from tp_controller.model.spatial import Array
from tp_controller.positions.solution import PositionSolution
from tp_controller.positions.solve_position import PositionSolver
from tp_controller.tasks.goal_holder import Goal

# Longest time of a search [s].
LONGEST_SEARCH = 0.1


def set_goal_by_posture(controller: Controller, name: str, goal: Goal,
                        now: float | None = None, frame: str | Array | None = None
                        ) -> tuple[str, ...]:
    """
    Set the goal of a task, to be reached by a posture; see `Controller.set_goal`.

    A task that moves straight to its goal stops where a joint is at its limit, or the arm would
    have to fold the other way round. Here the joints move, along a straight line, to the posture
    that `PositionSolver` finds with the goals in force. This keeps all limits, and the tasks above
    undisturbed; but it avoids nothing: what is in the way of the whole arm needs a planner.

    Returns
    -------
    tuple of str
        Remarks about the goal. If no posture reaches it, this is one of them, and the task moves
        straight towards it.

    A disabled task gets its goal as by `Controller.set_goal`.

    Raises
    ------
    GoalError
        As `Controller.set_goal`; or no joint positions have arrived yet.

    """
    if name in controller.stack.disabled:
        return controller.set_goal(name, goal, now, frame)
    place = controller.configuration()
    if place is None:
        raise GoalError('a goal that is reached by a posture needs joint positions, and none have '
                        'arrived yet')
    parsed = controller.parsed_goal(name, goal, frame)
    q, standing = place[0], _standing(controller, name)
    found = _search(controller, name, parsed, place, standing)
    reason = _missing(found, name)
    if standing and reason:
        # Is it these joints that are missing?
        found = _search(controller, name, parsed, place, ())
        reason = _missing(found, name) or _unable(controller, name, np.abs(found.q - q))
    remarks = controller.set_goal(name, goal, now, frame, posture=None if reason else found.q)
    return (*remarks, f'no posture reaches it: {reason}') if reason else remarks


def _search(controller: Controller, name: str, goal: Goal, place: tuple[Array, Array | None],
            standing: Collection[str]) -> PositionSolution:
    """Return the nearest posture to a goal with the goals in force, without some joints."""
    q, passive = place
    solver = PositionSolver(controller.robot, controller.stack, {*controller.locked, *standing}, q)
    return solver.solve({name: goal}, q, passive=passive, timeout=LONGEST_SEARCH)


def _missing(found: PositionSolution, name: str) -> str:
    """Return the reason why a search has not reached the goal of a task; empty if it has."""
    return '' if found.reached else next(
        task.reason for task in found.tasks if task.name == name) or 'a task above is in the way'


def _standing(controller: Controller, task: str) -> list[str]:
    """Return the joints that do not move on the way to a posture for a task."""
    robot, mask = controller.robot, controller.stack.tasks[task].joint_mask
    if robot.moves:
        return []
    moving = robot.velocity > 0.0 if mask is None else mask & (robot.velocity > 0.0)
    return [name for name, able in zip(robot.joint_names, moving) if not able]


def _unable(controller: Controller, task: str, way: Array) -> str:
    """Return the reason why a task cannot move joints so far (n,); empty if it can."""
    robot, mask = controller.robot, controller.stack.tasks[task].joint_mask
    if robot.moves:
        return ''
    names, far = np.array(robot.joint_names), way > ARRIVED
    still = names[far & (robot.velocity == 0.0)]
    if len(still):
        return f'{", ".join(still)} cannot move, with a velocity limit of zero'
    others = names[:0] if mask is None else names[far & ~mask]
    return f'{task} must not move {", ".join(others)}' if len(others) else ''

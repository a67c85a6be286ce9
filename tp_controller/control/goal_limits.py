# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Limits of goals and trajectories: a workspace box, and largest distances."""

from collections.abc import Sequence
import math

import numpy as np
from tp_controller.control.settings import Settings
from tp_controller.control.units import with_unit
from tp_controller.errors import GoalError
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.references.curve import Curve
from tp_controller.references.forms import Form, NONE
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.task import norm, Task

# Goal types with a target value; others are velocities and obstacles.
TARGETS = {'point', 'direction', 'quaternion', 'pose', 'joints'}


def check_goal(task: Task, goal: Goal, state: RobotState | None, settings: Settings) -> None:
    """
    Refuse a goal beyond the limits of `Settings`.

    Parameters
    ----------
    task : Task
        Task that receives the goal; inequality tasks have no limits of goals.
    goal : object
        Goal as parsed by the task, in its reference frame.
    state : RobotState or None
        State of the robot.
    settings : Settings
        `workspace`, `largest_jump` and `largest_turn` apply.

    Raises
    ------
    GoalError
        The goal is beyond one of them, or there is no state yet to check it with.

    """
    if task.bounded or task.goal_type not in TARGETS or not settings.limits_goals:
        return
    if state is None:
        raise GoalError('the limits of goals need joint positions, and none have arrived yet')
    if task.reference is not None:
        _check_position(task, task.goal_place(goal, state), state, settings.workspace)
    error = task.with_goal(goal).error(state)
    for rows, unit, _ in task.groups:
        name, largest = _largest(settings, unit)
        # A joint without a goal has no distance to it (NaN).
        distance = norm(np.nan_to_num(error[rows]))
        if distance > largest:
            raise GoalError(f'the goal is {distance:.3g} {unit} away, more than {name} '
                            f'({with_unit(f"{largest:g}", unit)}) allows')


def check_motion(task: Task, form: Form, curve: Curve, state: RobotState | None,
                 settings: Settings) -> None:
    """
    Refuse a trajectory beyond the limits of `Settings`.

    Its curve has to lie in the workspace, also between its values, and no value may be farther
    from the one before than a goal from its task; `check_goal` checks the first value.

    Parameters
    ----------
    task, state, settings
        See `check_goal`.
    form : Form
        Form of the goals of the task.
    curve : Curve
        Curve through the values.

    Raises
    ------
    GoalError
        It is beyond one of them.

    """
    if not settings.limits_goals or state is None:
        return
    # As of goals: other points than those of frames may be anywhere.
    if form.place is not NONE and task.reference is not None \
            and task.goal_place(task.goal, state) is not None:
        places, _ = curve.samples()
        T = state.pose(task.reference)
        in_root = places[:, form.place].dot(T[:3, :3].T) + T[:3, 3]
        lower, upper = settings.workspace[::2], settings.workspace[1::2]
        outside = np.flatnonzero(((in_root < lower) | (in_root > upper)).any(axis=1))
        if len(outside):
            _check_place(task, in_root[outside[0]], settings.workspace)
    values = curve.coefficients[:, 0]
    for unit, found in form.distances(values).items():
        name, largest = _largest(settings, unit)
        if len(found) and found.max() > largest:
            raise GoalError(f'value {int(found.argmax()) + 2} is {found.max():.3g} {unit} from '
                            f'the one before, more than {name} '
                            f'({with_unit(f"{largest:g}", unit)}) allows')


def _check_position(task: Task, place: Array | None, state: RobotState,
                    workspace: Sequence[float]) -> None:
    """Refuse a position, in the reference of a task, outside of the workspace."""
    if place is None or task.reference is None:
        return
    T = state.pose(task.reference)
    _check_place(task, T[:3, :3].dot(place) + T[:3, 3], workspace)


def _check_place(task: Task, in_root: Array, workspace: Sequence[float]) -> None:
    """Refuse a position (3,) in the root outside of the workspace."""
    for axis, value, lower, upper in zip('xyz', in_root, workspace[::2], workspace[1::2]):
        if not lower <= value <= upper:
            raise GoalError(f'the goal is outside the workspace: {axis} = {value:.3g} m is not '
                            f'from {_bound(lower)} to {_bound(upper)}, in the frame '
                            f'{task.robot.root}')


def _largest(settings: Settings, unit: str) -> tuple[str, float]:
    """Return name and value of the largest distance in a unit."""
    return {'m': ('largest_jump', settings.largest_jump),
            'rad': ('largest_turn', settings.largest_turn)}.get(unit, ('', math.inf))


def _bound(value: float) -> str:
    """Return a bound of the workspace as text."""
    return f'{value:g} m' if math.isfinite(value) else 'anywhere'

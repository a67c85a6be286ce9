# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Joints that stand, and stay: those with a velocity limit of zero, such as locked ones.

Their columns in all levels are zero. Each level is that of a robot without these joints: other
joints move instead, and damping and singular values are those of the others.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from tp_controller.control.error_minimum import Place
from tp_controller.model.spatial import Array
from tp_controller.solver.level import Level
from tp_controller.tasks.task import Evaluation
from tp_controller.untrusted.calls import foreign

Groups: TypeAlias = Sequence[Sequence[Evaluation]]


def without_joints(level: Level, joints: Sequence[int]) -> Level:
    """
    Return a level of a robot whose joints with these indices stand still.

    A row that no other joint moves demands nothing. A row with bounds that demand a return demands
    it at the joint speed of before, however short the row is now.
    """
    if not joints:
        return level
    columns = list(joints)
    if level.is_identity:
        v = level.v.copy()
        v[columns] = 0.0
        return replace(level, v=v)
    J = level.J.copy()
    J[:, columns] = 0.0
    before, left = (np.sqrt((rows * rows).sum(axis=1)) for rows in (level.J, J))
    share = np.divide(left, before, out=np.ones(len(J)), where=before > 0.0)
    if level.v is not None:
        return replace(level, J=J, v=np.where(share > 0.0, level.v, 0.0))
    return replace(
        level, J=J,
        lower=np.minimum(level.lower, 0.0) + share * np.maximum(level.lower, 0.0),
        upper=np.maximum(level.upper, 0.0) + share * np.minimum(level.upper, 0.0))


def evaluations_without(evaluations: Groups, joints: Sequence[int]) -> Groups:
    """Return evaluations whose levels are those of `without_joints`."""
    if not joints:
        return evaluations
    return [[replace(each, level=without_joints(each.level, joints)) for each in group]
            for group in evaluations]


def whole_levels(evaluations: Groups, place: Place, velocity: Array, joints: Sequence[int]
                 ) -> dict[int, Level]:
    """
    Return {id of the evaluation: level} with the columns of all joints.

    A task that fails, or whose rows are others now, keeps its level.

    Parameters
    ----------
    evaluations : sequence of sequence of Evaluation
        Evaluations without joints that stand.
    place : Place
        Configuration of their cycle.
    velocity : ndarray (n,)
        Last command before the cycle [rad/s or m/s].
    joints : sequence of int
        Joints that stand.

    """
    state = place.spare
    state.update(place.q, place.passive)
    state.velocity, state.still = velocity, joints
    found = {}
    for each in (each for group in evaluations for each in group):
        found[id(each)] = each.level
        # A task type of another package may raise any exception.
        with suppress(Exception), foreign:
            level = each.task.probe().evaluate(state, place.now).level
            if level.J.shape == each.level.J.shape:
                found[id(each)] = level
    return found

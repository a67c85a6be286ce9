# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Capabilities of the levels of a stack at a random configuration, without motion."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
import math

import numpy as np
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.report import active_bounds
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.errors import EvaluationError
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.level import Level, Mask, NEGLIGIBLE
from tp_controller.solver.solution import Solution
from tp_controller.tasks.keys import MAX_NUMBER
from tp_controller.tasks.stack import levels_of
from tp_controller.tasks.task import Evaluation
from tp_controller.tools.check.sampling import random_configuration
from tp_controller.tools.check.setup import Setup

# Angle between the rows of two tasks below which they share a direction [rad].
SHARED_ANGLE = math.radians(5.0)
# Share of the largest entry, or of the norm, of a Jacobian below which a column, or a singular
# value, counts as zero: descriptions round angles.
NEXT_TO_ZERO = 1e-4


@dataclass(frozen=True, eq=False)
class ChosenJoints:
    """
    Joints of a task that may move some joints only, at one configuration.

    Attributes
    ----------
    rank, rank_of_all : int
        Rank of the task with the joints that it may move, and with all.
    rows, frame : ndarray (n,) of bool
        Joints that move its rows; that move these or its frame.

    """

    rank: int
    rank_of_all: int
    rows: Mask
    frame: Mask


@dataclass(frozen=True)
class ConfigurationSample:
    """
    Stack at one configuration; each mapping has the tasks or levels that it applies to.

    Attributes
    ----------
    fault : tuple of str
        Task and reason if a task fails; the other fields are then empty.
    ranks : dict
        {level: (rank left by the levels above, rank alone, rank that would be left if it could
        move all joints)}, levels from 1.
    smallest : dict
        {task: smallest singular value of its rows for the joints that it may move, and the
        direction of the task (m,) that belongs to it}.
    pairs : dict
        {(task, task): (smallest angle between their rows [rad], directions that they share)}.
    bounds : dict
        {inequality task: (value outside its bounds, bounds active, share of rows outside, joints
        at their velocity limits could bring it to its bounds)}.
    filling : frozenset of str
        Tasks that demand a velocity of every joint.
    chosen : dict
        {task that may move some joints only: ChosenJoints}.

    """

    fault: tuple[str, ...]
    ranks: dict[int, tuple[int, int, int]]
    smallest: dict[str, tuple[float, Array]]
    pairs: dict[tuple[str, str], tuple[float, int]]
    bounds: dict[str, tuple[bool, bool, float, bool]]
    filling: frozenset[str] = frozenset()
    chosen: dict[str, ChosenJoints] = field(default_factory=dict)


def sample_configuration(setup: Setup, seed: np.random.SeedSequence) -> ConfigurationSample:
    """
    Evaluate a stack at a random configuration, with goals from another one.

    Parameters
    ----------
    setup : Setup
        Robot and stack.
    seed : numpy.random.SeedSequence
        Seed of the two configurations.

    Returns
    -------
    ConfigurationSample

    """
    random = np.random.default_rng(seed)
    here, there = (setup.robot.state(random_configuration(setup.robot, random, setup.around))
                   for _ in range(2))
    stack = setup.stack.copy()
    try:
        stack.start(there)
        evaluations = stack.evaluate(here, 0.0)
        stack.check(evaluations, setup.robot.n)
    except EvaluationError as error:
        return ConfigurationSample((error.task, error.reason), {}, {}, {}, {})
    levels = levels_of(evaluations)
    # A task that demands a velocity of every joint, such as a posture, shares directions with all.
    demanding = [evaluation for group in evaluations for evaluation in group
                 if not evaluation.task.bounded]
    filling = [each for each in demanding if _fills(each.level, setup.robot.joint_columns)]
    demanding = [each for each in demanding if each not in filling]
    return ConfigurationSample(
        (), _ranks(levels, setup.robot.n),
        {each.task.name: smallest_singular_value(_movable(each.level)) for each in demanding},
        _pairs(demanding), _bounds(setup, here, evaluations, levels),
        frozenset(each.task.name for each in filling),
        {each.task.name: _chosen(each, here) for group in evaluations for each in group
         if each.level.joints is not None})


def smallest_singular_value(J: Array) -> tuple[float, Array]:
    """Return the m-th singular value of J (m, n), 0 if it has fewer, and its direction (m,)."""
    U, s, _ = np.linalg.svd(J)
    return float(s[-1]) if 0 < len(s) == len(J) else 0.0, U[:, -1]


def angles_between(J: Array, other: Array) -> Array:
    """Return the principal angles between the row spaces of two matrices, ascending [rad]."""
    cosines = np.linalg.svd(_row_basis(J) @ _row_basis(other).T, compute_uv=False)
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def _row_basis(J: Array) -> Array:
    """Return orthonormal rows (k, n) that span those of J."""
    _, s, V = np.linalg.svd(J, full_matrices=False)
    return V[s > NEGLIGIBLE * max(float(np.linalg.norm(J)), NEGLIGIBLE)]


def _fills(level: Level, joints: slice) -> bool:
    """Return whether a level demands a velocity of every joint, in their order."""
    rows = level.J[:, joints]
    return level.is_identity or (rows.shape[0] == rows.shape[1]
                                 and np.array_equal(rows, np.eye(len(rows))))


def _ranks(levels: list[Level], n: int) -> dict[int, tuple[int, int, int]]:
    """Return `ConfigurationSample.ranks`."""
    solution, above, found = Solution(np.zeros(n), levels), np.zeros((0, n)), {}
    for number, (level, its) in enumerate(zip(levels, solution.levels), 1):
        both = _row_basis(np.concatenate([above, level.J]))
        of_all = len(both) - len(above)
        found[number] = (of_all if level.v is None else its.rank,
                         its.rank_alone if level.joints is None else _ranks_of(level)[0],
                         of_all)
        if level.v is not None:
            above = both
    return found


def _movable(level: Level) -> Array:
    """Return the columns of the joints that a level may move (m, k)."""
    return level.J if level.joints is None else level.J[:, level.joints]


def _chosen(evaluation: Evaluation, state: RobotState) -> ChosenJoints:
    """Return the effect of the joints that a task may move."""
    level, frame = evaluation.level, evaluation.task.frame
    rows = _moving(level.J)
    return ChosenJoints(*_ranks_of(level), rows,
                        rows if frame is None else rows | _moving(state.jacobian(frame)))


def _moving(J: Array) -> Mask:
    """Return a mask (n,) of the columns of J (m, n) that are not next to zero."""
    size = np.abs(J).max(axis=0, initial=0.0)
    return size > NEXT_TO_ZERO * max(float(size.max()), NEGLIGIBLE)


def _ranks_of(level: Level) -> tuple[int, int]:
    """Return the rank of a level for the joints that it may move, and for all."""
    least = NEXT_TO_ZERO * max(float(np.linalg.norm(level.J)), NEGLIGIBLE)
    own, every = (int((np.linalg.svd(J, compute_uv=False) > least).sum())
                  for J in (_movable(level), level.J))
    return own, every


def _pairs(evaluations: Sequence[Evaluation]) -> dict[tuple[str, str], tuple[float, int]]:
    """Return the smallest angle and the number of shared directions of each pair of tasks."""
    found = {}
    for one, other in combinations(evaluations, 2):
        angles = angles_between(one.level.J, other.level.J)
        smallest = float(angles[0]) if len(angles) else 0.5 * math.pi
        found[one.task.name, other.task.name] = smallest, int((angles < SHARED_ANGLE).sum())
    return found


def _bounds(setup: Setup, state: RobotState, evaluations: Sequence[Sequence[Evaluation]],
            levels: list[Level]) -> dict[str, tuple[bool, bool, float, bool]]:
    """Return `ConfigurationSample.bounds`."""
    if not any(level.v is None for level in levels):
        return {}
    robot, settings = setup.robot, setup.settings
    limits = VelocityLimits(robot, settings.period, settings.braking_gain)
    motion = JointMotion(robot.positions(state.q), np.zeros(robot.n), settings.period)
    solution = settings.solver(robot.n).solve(levels, limits.at(motion, setup.period).settled)
    active = active_bounds(evaluations, solution)
    fastest = np.minimum(robot.velocity, MAX_NUMBER)
    return {evaluation.task.name: (_is_outside(evaluation),
                                   evaluation.task.name in active,
                                   float(np.mean(evaluation.error != 0.0))
                                   if len(evaluation.error) else 0.0,
                                   _may_act(evaluation.level, fastest))
            for group in evaluations for evaluation in group if evaluation.task.bounded}


def _may_act(level: Level, fastest: Array) -> bool:
    """Return whether velocities of at most `fastest` (n,) could bring a row to its bounds."""
    speed = np.abs(level.J).dot(fastest)
    return bool(((speed >= level.upper) | (-speed <= level.lower)).any())


def _is_outside(evaluation: Evaluation) -> bool:
    """Return whether the error of an inequality task exceeds its tolerance."""
    error = evaluation.error
    return any(value > tolerance for value, _, tolerance in
               evaluation.task.reported_errors(error, np.zeros_like(error)))

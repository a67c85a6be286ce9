# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Descent from a configuration to one nearby at which the errors of a stack are least.

A step is the solution of the hierarchy of all levels for the change x of the positions, within a
trust region: J x brings each error to zero as far as the levels above allow, |x_j| ≤ Δ, and the
position limits hold. It is accepted if the cost falls by a sufficient share of what the constant J
predicts; otherwise Δ shrinks (Nocedal and Wright, Numerical Optimization, 4.1). The region is what
keeps steps near singularities short: with damped ones no goal more is reached, of 8,000.

Levels that can be met together are reduced together. After that each level is reduced in turn,
on the configurations that leave those above it as they are: these curve, so steps of the levels
above alone lead back to them (a second-order correction, ibid. 18.3).
"""

from collections.abc import Callable
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.positions.position_stack import linear_cost, Point, PositionStack
from tp_controller.solver.solve import PrioritySolver, solve_cycle

# Cost up to which a level is met: an error of 3e-7 m or rad.
MET = 1e-13
# Error by which levels above a reduced one may grow [m or rad].
KEPT = 5e-7
# Trust region Δ: first, largest, and where a descent ends [rad or m].
FIRST_RADIUS, LARGEST_RADIUS, LEAST_RADIUS = 0.6, 1.5, 1e-5
# Share of the predicted reduction from which a step is accepted, and from which Δ grows.
LEAST_GAIN, WELL_PREDICTED = 0.05, 0.7
SHRINK, GROW = 0.35, 2.0
# Share of the cost below which the reduction of a step ends a descent, at first and at the end.
LEAST_REDUCTION, LAST_REDUCTION = 1e-4, 1e-8
# Cosine between a step and the slope of an objective below which it is at its maximum.
LEAST_SLOPE = 1e-4
# Number of steps in a row, each leaving more than this share of the cost, that make a dead end.
STALLED, STALLED_STEPS = 0.7, 7
# Most steps back to the levels above.
CORRECTIONS = 4
# Most steps of a descent, and most rounds over its levels.
MOST_STEPS, ROUNDS = 200, 3


def kept_cost(cost: float) -> float:
    """Return the most that a level may cost while others are reduced."""
    return (math.sqrt(cost) + KEPT) ** 2


class Judged(NamedTuple):
    """Levels whose cost a step has to reduce, `first` to `last` − 1; those above are kept."""

    first: int
    last: int

    def cost(self, costs: list[float]) -> float:
        """Return the cost of these levels."""
        return sum(costs[self.first:self.last])


class Descent:
    """
    Descent of a stack at positions.

    Parameters
    ----------
    tasks : PositionStack
    robot : Robot
    out_of_time : callable () -> bool

    """

    def __init__(self, tasks: PositionStack, robot: Robot,
                 out_of_time: Callable[[], bool]) -> None:
        self._tasks, self.out_of_time = tasks, out_of_time
        self._lower, self._upper = robot.lower, robot.upper
        self._solver = PrioritySolver(robot.n, scaling='redistribute')
        self._steps = 0

    def begin(self) -> None:
        """Begin a descent, with all its steps left."""
        self._steps = 0

    def approach(self, point: Point, needed: int) -> Point:
        """Reduce the first `needed` levels together; in turn if they cannot be met together."""
        whole = Judged(0, needed)
        point = self._reduce(point, whole, False)
        if needed > 1 and whole.cost(point.costs) > MET:
            for level in range(needed):
                point = self._reduce(point, Judged(level, level + 1), False)
        return point

    def finish(self, point: Point) -> Point:
        """Reduce all levels in turn."""
        for _ in range(ROUNDS):
            before = point
            for level, objective in enumerate(self._tasks.objectives):
                point = self._maximize(point, level) if objective else \
                    self._reduce(point, Judged(level, level + 1), True)
            if point is before:
                break
        return point

    def _reduce(self, point: Point, judged: Judged, patient: bool) -> Point:
        """Reduce the cost of some levels; a patient descent goes on as long as it falls."""
        radius, slow = FIRST_RADIUS, 0
        least = LAST_REDUCTION if patient else LEAST_REDUCTION
        kept = [kept_cost(cost) for cost in point.costs[:judged.first]]
        cost = judged.cost(point.costs)
        while cost > MET and self._steps < MOST_STEPS and not self.out_of_time():
            self._steps += 1
            step = self._step(point, judged.last, radius)
            reduction = cost - sum(
                linear_cost(level, error, step) for level, error in zip(
                    point.levels[judged.first:judged.last],
                    point.errors[judged.first:judged.last]))
            if reduction <= least * cost:
                break
            trial = self._correct(self._tasks.moved(point, step), point, judged.first)
            after = judged.cost(trial.costs)
            gain = (cost - after) / reduction if _holds(trial, kept) else -1.0
            if gain <= LEAST_GAIN:
                radius = SHRINK * float(np.abs(step).max())
                if radius < LEAST_RADIUS:
                    break
                continue
            if gain > WELL_PREDICTED:
                radius = min(GROW * radius, LARGEST_RADIUS)
            slow = slow + 1 if after > STALLED * cost else 0
            point, cost = trial, after
            if slow == STALLED_STEPS and not patient:
                break
        return point

    def _maximize(self, point: Point, level: int) -> Point:
        """Follow the slope of an objective, without a change of the levels above it."""
        radius = FIRST_RADIUS
        kept = [kept_cost(cost) for cost in point.costs[:level]]
        while self._steps < MOST_STEPS and not self.out_of_time():
            self._steps += 1
            slope = point.errors[level]
            largest = float(np.abs(slope).max())
            if largest == 0.0:
                break
            # The slope tells the direction, the region the length.
            point.levels[level] = replace(point.levels[level], v=slope * (radius / largest))
            step = self._step(point, level + 1, radius)
            rise, length = float(slope.dot(step)), float(np.abs(step).max())
            if length < LEAST_RADIUS or rise <= LEAST_SLOPE * largest * length:
                break
            trial = self._correct(self._tasks.moved(point, step), point, level)
            # The mean of the slopes at both ends, along the step.
            gain = 0.5 + 0.5 * float(trial.errors[level].dot(step)) / rise \
                if _holds(trial, kept) else -1.0
            if gain <= LEAST_GAIN:
                radius = SHRINK * length
                continue
            if gain > WELL_PREDICTED:
                radius = min(GROW * radius, LARGEST_RADIUS)
            point = trial
        return point

    def _step(self, point: Point, count: int, radius: float) -> Array:
        """Return the change (n,) of the positions for the first `count` levels."""
        lower = np.minimum(np.maximum(self._lower - point.positions, -radius), 0.0)
        upper = np.maximum(np.minimum(self._upper - point.positions, radius), 0.0)
        return solve_cycle(point.levels[:count], lower, upper, self._solver, 0.0).velocity

    def _correct(self, trial: Point, before: Point, count: int) -> Point:
        """Return a point nearby at which the first `count` levels cost what they did before."""
        allowed = [max(cost, MET) for cost in before.costs[:count]]
        for _ in range(CORRECTIONS):
            if _holds(trial, allowed):
                break
            trial = self._tasks.moved(trial, self._step(trial, count, LARGEST_RADIUS))
        return trial


def _holds(point: Point, most: list[float]) -> bool:
    """Return whether the first levels cost at most so much."""
    return all(cost <= limit for cost, limit in zip(point.costs, most))

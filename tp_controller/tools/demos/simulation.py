# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recorded runs of a controller with the kinematic simulator, in simulated time without ROS."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from tp_controller import Controller, KinematicSimulator, Robot, RobotState, Stack
from tp_controller.control.report import Report
from tp_controller.model.spatial import Array


@dataclass(frozen=True, eq=False)
class Run:
    """
    Recorded run, one sample for each cycle.

    Attributes
    ----------
    robot : Robot
    stack : Stack
        Tasks with their last goals.
    times : ndarray (T,)
        [s]
    q : ndarray (T, nq)
        Configurations at these times [rad or m].
    velocities : ndarray (T, n)
        Commands at these times [rad/s or m/s].
    reports : tuple of Report (T,)

    """

    robot: Robot
    stack: Stack
    times: Array
    q: Array
    velocities: Array
    reports: tuple[Report, ...]

    @cached_property
    def errors(self) -> Mapping[str, Array]:
        """Return {task: norms of its error in its first unit (T,)}."""
        return {task.name: np.array([report.tasks[index].errors[0][0] for report in self.reports])
                for index, task in enumerate(self.reports[0].tasks)}

    @property
    def top_speed(self) -> float:
        """Return the largest absolute velocity [rad/s or m/s]."""
        return float(np.abs(self.velocities).max())

    def values(self, function: Callable[[RobotState], ArrayLike]) -> Array:
        """Return a function of the state at each sample (T, …)."""
        state = self.robot.state(self.q[0])
        found = []
        for q in self.q:
            state.update(q)
            found.append(np.array(function(state), dtype=float))
        return np.array(found)

    @cached_property
    def clearance(self) -> Array:
        """Return the distance of the nearest joint from its position limits (T,) [rad or m]."""
        positions = np.array([self.robot.positions(q) for q in self.q])
        return np.minimum(positions - self.robot.lower, self.robot.upper - positions).min(axis=1)

    def active(self, task: str) -> list[bool]:
        """Return whether bounds of an inequality task have multipliers, for each sample."""
        return [task in report.active_bounds for report in self.reports]


def simulate(controller: Controller, start: ArrayLike, samples: int,
             set_goals: Callable[[float], None],
             carried_out: Callable[[float, Array], Array] = lambda now, velocity: velocity) -> Run:
    """
    Return the run of a controller from a configuration.

    Parameters
    ----------
    controller : Controller
        Controller that has not run yet.
    start : array_like (nq,)
        First configuration [rad or m].
    samples : int
        Number of cycles.
    set_goals : callable
        Called with the time [s] before each cycle.
    carried_out : callable
        Returns the velocities (n,) that the robot carries out at a time [s], of those commanded.

    Returns
    -------
    Run

    """
    period = controller.settings.period
    simulator = KinematicSimulator(controller.robot, start)
    rows = []
    for step in range(samples):
        now = step * period
        set_goals(now)
        velocity, report = controller.update(simulator.q, now)
        rows.append((now, simulator.q, velocity, report))
        simulator.command(carried_out(now, velocity))
        simulator.step(period)
    times, q, velocities, reports = zip(*rows)
    return Run(controller.robot, controller.stack, np.array(times), np.array(q),
               np.array(velocities), reports)


def intervals(mask: ArrayLike) -> list[tuple[int, int]]:
    """Return (first, last) of every run of true values of a mask (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(first, last - 1) for first, last in zip(edges[::2], edges[1::2])]

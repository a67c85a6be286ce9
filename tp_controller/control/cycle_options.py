# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Options of the control cycle, constant until a setting or a velocity limit changes."""

from collections.abc import Callable
from typing import TypeAlias

from tp_controller.control.gains import gain_faults
from tp_controller.control.settings import Settings
from tp_controller.control.velocity_limits import VelocityLimits
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.solver.solution import Solver
from tp_controller.tasks.stack import Stack

# Makes the solver for settings and a number of joints.
SolverFactory: TypeAlias = Callable[[Settings, int], Solver]


class CycleOptions:
    """
    Options of the control cycle that follow from the robot, the settings and its velocity limits.

    Parameters
    ----------
    robot : Robot
    settings : Settings
        Settings that fit the robot.
    velocity : ndarray (n,)
        Velocity limits in force [rad/s or m/s].
    make_solver : callable (Settings, int) -> Solver
        Solver for the settings and n joints.

    Attributes
    ----------
    settings, velocity, make_solver
        As given.
    n : int
        Number of joints.
    period, blend : float
        Settings [s].
    delay : int
        Number of pending commands.
    solver : Solver
    limits : VelocityLimits
    locked : tuple of str
        Joints that have lost their velocity limit of the robot, which is zero now.

    """

    def __init__(self, robot: Robot, settings: Settings, velocity: Array,
                 make_solver: SolverFactory = Settings.solver) -> None:
        self.n = robot.n
        self.settings, self.velocity, self.make_solver = settings, velocity, make_solver
        self.period, self.blend = settings.period, settings.blend
        self.delay = settings.command_delay
        self.solver = make_solver(settings, robot.n)
        self.locked = tuple([name for name, limit, own in zip(
            robot.velocity_names, velocity, robot.velocity) if limit == 0.0 < own])
        self.limits = VelocityLimits(robot, settings.period, settings.braking_gain, velocity,
                                     settings.speed_cap(robot, velocity))


def setting_faults(settings: Settings, robot: Robot, stack: Stack) -> list[str]:
    """Return the faults of settings for a robot and a stack."""
    if not isinstance(settings, Settings):
        return [f'settings must be made by Settings(…), got {settings!r}']
    weights = settings.weights or ()
    faults = [] if len(weights) in (0, robot.n) else [
        f'weights needs {robot.n} numbers, one for each of {", ".join(robot.velocity_names)}, '
        f'got {len(weights)}']
    return faults + [fault for task in stack.tasks.values()
                     for fault in gain_faults(task, task.gain, settings.period)]

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Prioritized velocity control of redundant robots.

::

    robot = Robot.from_urdf('panda.urdf')
    controller = Controller(robot, Stack.from_yaml('stack.yaml', robot))
    controller.set_goal('tool', pose, now)
    command = controller.update(q, now)
    found = solve_position(robot, stack, {'tool': pose}, start=q)
"""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from tp_controller.control.controller import Command, Controller
    from tp_controller.control.settings import Settings
    from tp_controller.errors import (
        EvaluationError,
        GoalError,
        RobotError,
        SettingsError,
        SolverError,
        StackError,
        TaskError,
        TimeError,
        TpControllerError,
    )
    from tp_controller.model.robot import Robot, RobotState
    from tp_controller.model.simulator import KinematicSimulator, SimulatorNoise
    from tp_controller.positions.approach import set_goal_by_posture
    from tp_controller.positions.solution import PositionSolution
    from tp_controller.positions.solve_position import PositionSolver, solve_position
    from tp_controller.positions.solve_positions import solve_positions
    from tp_controller.solver.level import Level
    from tp_controller.solver.solution import Bounds, LevelSolution, LevelStep, Solution, Solver
    from tp_controller.solver.solve import solve
    from tp_controller.tasks.stack import Stack

__all__ = [
    'Bounds', 'Command', 'Controller', 'EvaluationError', 'GoalError', 'KinematicSimulator',
    'Level', 'LevelSolution', 'LevelStep', 'PositionSolution', 'PositionSolver', 'Robot',
    'RobotError', 'RobotState', 'Settings', 'SettingsError', 'SimulatorNoise', 'Solution',
    'Solver', 'SolverError', 'Stack', 'StackError', 'TaskError', 'TimeError',
    'TpControllerError', 'set_goal_by_posture', 'solve', 'solve_position', 'solve_positions']

# Module of each public name, imported on first use: the command line needs few of them.
_ORIGINS = {
    'control.controller': ('Command', 'Controller'),
    'control.settings': ('Settings',),
    'errors': ('EvaluationError', 'GoalError', 'RobotError', 'SettingsError', 'SolverError',
               'StackError', 'TaskError', 'TimeError', 'TpControllerError'),
    'model.robot': ('Robot', 'RobotState'),
    'model.simulator': ('KinematicSimulator', 'SimulatorNoise'),
    'positions.approach': ('set_goal_by_posture',),
    'positions.solution': ('PositionSolution',),
    'positions.solve_position': ('PositionSolver', 'solve_position'),
    'positions.solve_positions': ('solve_positions',),
    'solver.level': ('Level',),
    'solver.solution': ('Bounds', 'LevelSolution', 'LevelStep', 'Solution', 'Solver'),
    'solver.solve': ('solve',),
    'tasks.stack': ('Stack',),
}
_MODULES = {name: module for module, names in _ORIGINS.items() for name in names}
_SUBPACKAGES = ('control', 'errors', 'model', 'positions', 'resources', 'solver', 'tasks')


def __getattr__(name: str) -> Any:
    """Import and return a public name, or a subpackage."""
    if name in _MODULES:
        found = getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
        globals()[name] = found
        return found
    if name in _SUBPACKAGES:
        return import_module(f'{__name__}.{name}')
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    """Return all names of the package, imported or not."""
    return sorted({*globals(), *__all__, *_SUBPACKAGES})

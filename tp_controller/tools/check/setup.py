# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Setup of a check, as objects of this process and as a plan for other processes."""

from collections.abc import Callable
from dataclasses import dataclass
import hashlib
import pickle
from typing import Any, TypeVar

import numpy as np
from tp_controller.control.settings import Settings
from tp_controller.errors import SettingsError
from tp_controller.model.joint_groups import BASE
from tp_controller.model.limits import BASE_LIMIT_KEYS, LIMIT_KEYS
from tp_controller.model.mobile_base import DEFAULT_WORLD
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tasks.stack import Stack

Seed = TypeVar('Seed')
Result = TypeVar('Result')


@dataclass(frozen=True, eq=False)
class Setup:
    """
    Robot, stack, and parameters of the closed loops.

    Attributes
    ----------
    robot : Robot
    stack : Stack
        Not evaluated itself: every run uses a copy.
    settings : Settings
    period : float
        Time between two cycles [s].
    seconds : float
        Longest time of a closed loop [s].
    around : ndarray (nq,)
        Configuration near which a moving base starts.
    tries : int
        Largest number of configurations tried until one, as a start or for goals, satisfies the
        stack.

    """

    robot: Robot
    stack: Stack
    settings: Settings
    period: float
    seconds: float
    around: Array
    tries: int = 3


@dataclass(frozen=True)
class Plan:
    """
    Serializable plan from which a process builds a `Setup` once.

    Attributes
    ----------
    key : str
        Hash of the plan.
    robot, task_keys, rest : dict
        Arguments of the robot; gains and tolerances that were set since the tasks were read; other
        fields of a `Setup`.
    stack : str
        Stack as YAML.
    disabled : tuple of str
        Names of the disabled tasks.

    """

    key: str
    robot: dict[str, Any]
    stack: str
    disabled: tuple[str, ...]
    task_keys: dict[str, tuple[Any, dict[str, float]]]
    rest: dict[str, Any]

    @classmethod
    def of(cls, setup: Setup) -> 'Plan':
        """
        Return the plan of a setup.

        Raises
        ------
        SettingsError
            The stack was not read from YAML.

        """
        stack = setup.stack
        if not stack.text:
            raise SettingsError(['a stack that was not read from YAML cannot be sent to other '
                                 'processes: check it with one job'])
        parts = (_robot_arguments(setup.robot), stack.text, tuple(sorted(stack.disabled)),
                 {name: (task.gain, {unit: value for _, unit, value in task.groups})
                  for name, task in stack.tasks.items()},
                 {'settings': setup.settings, 'period': setup.period, 'seconds': setup.seconds,
                  'around': setup.around, 'tries': setup.tries})
        return cls(hashlib.sha256(pickle.dumps(parts)).hexdigest(), *parts)

    def build(self) -> Setup:
        """Return the setup of this plan."""
        robot = Robot.from_urdf(**self.robot)
        stack = Stack.from_yaml(self.stack, robot)
        for name, (gain, tolerance) in self.task_keys.items():
            task = stack.tasks[name]
            accepted = task.accepted_keys()
            if 'gain' in accepted and not np.array_equal(task.gain, gain):
                task.set_gain(gain)
            if 'tolerance' in accepted:
                task.set_tolerance(tolerance)
        for name in self.disabled:
            stack.enable(name, False)
        return Setup(robot, stack, **self.rest)


# Last setup that this process has built, by the key of its plan.
_BUILT: dict[str, Setup] = {}


def built(plan: Plan) -> Setup:
    """Return the setup of a plan; reuse the last one that this process has built."""
    if plan.key not in _BUILT:
        _BUILT.clear()
        _BUILT[plan.key] = plan.build()
    return _BUILT[plan.key]


def in_process(work: Callable[[Setup, Seed], Result], plan: Plan, seed: Seed) -> Result:
    """Return the result of work for a seed, in a process that may have to build the setup."""
    return work(built(plan), seed)


def _robot_arguments(robot: Robot) -> dict[str, Any]:
    """Return the arguments of `Robot.from_urdf` that rebuild a robot."""
    limits = {name: {key: float(robot.limits[key][row])
                     for key in (LIMIT_KEYS if name in robot.joint_names else BASE_LIMIT_KEYS)}
              for row, name in enumerate(robot.velocity_names)}
    return {'source': robot.urdf, 'base': robot.base, 'joints': list(robot.joint_names),
            'limits': limits, 'world_frame': robot.root if robot.moves else DEFAULT_WORLD,
            'groups': {name: list(names) for name, names in robot.groups.items() if name != BASE}}

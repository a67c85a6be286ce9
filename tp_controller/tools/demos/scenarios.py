# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenarios of the demos over ROS 2: robots, stacks and goals, from files in config/."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from tp_controller.control.settings import Settings
from tp_controller.model.robot import Robot
from tp_controller.model.rpy import quaternion_from_rpy
from tp_controller.model.shapes import Box, Cylinder
from tp_controller.model.simulator import initial_positions
from tp_controller.model.spatial import Array
from tp_controller.resources import load_yaml, package_share
from tp_controller.tasks.stack import Stack
from tp_controller.tools.check.parameter_file import node_parameters, NodeSetup, read
from tp_controller.tools.demos.motion import FixedObject, Look

# A goal of a file: task, name, and the fields of its message.
Goal = Mapping[str, Any]


@dataclass(frozen=True)
class Demo:
    """
    Robot that executes a stack of tasks, with the content of its film.

    Attributes
    ----------
    files : str
        Prefix of the names in config/: ``<files>.yaml`` contains the parameters of both nodes,
        ``<files>_stack.yaml`` the tasks and ``<files>_goals.yaml`` their goals.
    title : str
        Title of the film.
    leader : str
        Task with the drawn goals.
    look : Look
        Appearance of the film, in which the frame of the leader has a path, too.

    """

    files: str
    title: str
    leader: str
    look: Look = Look()

    def file(self, ending: str) -> Path:
        """Return the path of the file whose name has an ending."""
        return package_share() / 'config' / f'{self.files}{ending}.yaml'

    @cached_property
    def setup(self) -> NodeSetup:
        """Return robot, stack and settings of the nodes."""
        return read([self.file('')], '', '', '', None)

    @property
    def robot(self) -> Robot:
        """Return the robot of the nodes, with limits."""
        return self.setup.robot

    @property
    def rate(self) -> float:
        """Return the rate of joint states of the simulator, each followed by a command [Hz]."""
        rate: float = node_parameters(self.file(''), 'tp_simulator')['rate']
        return rate

    @cached_property
    def start(self) -> Array:
        """Return the initial configuration of the simulator (nq,) [rad or m]."""
        return initial_positions(
            node_parameters(self.file(''), 'tp_simulator')['initial_positions'], self.robot)

    @property
    def settings(self) -> Settings:
        """Return the settings of the controller, with the default period."""
        return replace(self.setup.settings, period=Settings().period)

    @property
    def stack(self) -> Stack:
        """Return the stack of tasks."""
        return self.setup.stack

    @cached_property
    def steps(self) -> list[tuple[Goal, ...]]:
        """Return the goals of each step, which are sent together."""
        return [tuple(step) if isinstance(step, list) else (step,)
                for step in load_yaml(self.file('_goals').read_text())]


DEMOS = {
    'panda': Demo('demo', 'Panda: tool, elbow, posture', 'tool'),
    # A tray with a glass on it.
    'mobile': Demo('mobile', 'A tray, level, past obstacles', 'tray', Look(
        ('base_link',), (FixedObject('tool', Box(0.28, 0.36, 0.02)),
                         FixedObject('tool', Cylinder(0.03, 0.12), (0.0, 0.08, 0.07))),
        view=(-70.0, 28.0))),
    'underwater': Demo('underwater', 'Underwater: tool, view, vehicle', 'tool', Look(
        ('vehicle',), view=(-50.0, 30.0), ground=-4.2)),
    'two_arms': Demo('two_arms', 'Two hands carry one object', 'carry', Look(
        ('right_hand',), carried=(('left_hand', 'right_hand'),), view=(-30.0, 20.0))),
}


def goal_fields(goal: Goal) -> dict[str, Any]:
    """
    Return the message fields of a goal in a file.

    Parameters
    ----------
    goal : dict
        Goal with ``xyz`` [m], ``rpy`` [rad], ``linear`` [m/s] or ``angular`` [rad/s].

    Returns
    -------
    dict
        Arguments of `tp_controller.ros.client.client.Client.send`.

    """
    fields = {key: goal[key] for key in ('xyz', 'linear', 'angular') if key in goal}
    if 'rpy' in goal:
        fields['quat_xyzw'] = quaternion_from_rpy(*goal['rpy'])
    return fields

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robots that the tests share: the files of this repository and of example-robot-data."""

from functools import lru_cache
from importlib.metadata import files
from pathlib import Path

import numpy as np
from tp_controller import Robot
from tp_controller.model.spatial import pose, rotation_from_vector
from tp_controller.tasks.needs import lacks

REPOSITORY = Path(__file__).resolve().parents[1]
CONFIG = REPOSITORY / 'config'
PANDA_DH = CONFIG / 'robots' / 'panda.yaml'
PLANAR_DH = CONFIG / 'robots' / 'planar_3r.yaml'

# Paths below robots/ of example-robot-data.
URDFS = {
    'panda': 'panda_description/urdf/panda.urdf',
    'ur5': 'ur_description/urdf/ur5_robot.urdf',
    'xarm7': 'xarm_description/urdf/xarm7.urdf',
    'baxter': 'baxter_description/urdf/baxter.urdf',
    'talos': 'talos_data/robots/talos_reduced.urdf',
    'talos_arm': 'talos_data/robots/talos_left_arm.urdf',
    'tiago': 'tiago_description/robots/tiago.urdf',
}
# Those of them with joints that have no range.
STILL = {
    'pr2': 'pr2_description/urdf/pr2.urdf',
    'centauro': 'centauro_description/urdf/centauro.urdf',
    'quadruped': 'quadruped_description/urdf/quadruped.urdf',
}
TOOLS = {
    'panda': 'panda_hand_tcp', 'ur5': 'tool0', 'xarm7': 'link7', 'baxter': 'left_gripper',
    'talos': 'gripper_left_base_link', 'talos_arm': 'gripper_left_base_link',
    'tiago': 'arm_tool_link'}

# A posture of the Panda with its tool straight down, far from every limit.
PANDA_READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
PANDA_TOOL = 'panda_hand_tcp'
PLANAR_START = (0.0, 0.6, 0.3)

# Joints of all kinds: turning and sliding, about axes that are none of the frame, and mimics; some
# links have masses.
CHAIN = """
<robot name="chain">
<link name="l0"><inertial><origin xyz="0.1 0.2 -0.3"/><mass value="3"/></inertial></link>
<link name="l1"/><link name="l3"/>
<link name="l2"><inertial><origin xyz="0.3 0 0.1"/><mass value="0.5"/></inertial></link>
<link name="l4"><inertial><origin xyz="0 0.4 0.2"/><mass value="2"/></inertial></link>
<link name="l5"><inertial><origin xyz="0.5 0.4 0"/><mass value="1"/></inertial></link>
<joint name="a" type="continuous"><parent link="l0"/><child link="l1"/>
  <origin xyz="1 0 0.5" rpy="0.3 -0.2 1"/><axis xyz="1 2 -0.5"/></joint>
<joint name="b" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="1 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="9" effort="0"/>
  <mimic joint="a" multiplier="-2" offset="0.1"/></joint>
<joint name="c" type="prismatic"><parent link="l2"/><child link="l3"/>
  <origin xyz="1 0 0" rpy="1 0.5 0"/><axis xyz="0.5 -1 0.25"/>
  <limit lower="0.2" upper="1" velocity="1" effort="0"/></joint>
<joint name="d" type="fixed"><parent link="l1"/><child link="l4"/>
  <origin xyz="0.2 -0.3 0" rpy="0 2 0"/></joint>
<joint name="e" type="prismatic"><parent link="l3"/><child link="l5"/>
  <origin xyz="0 0.3 0" rpy="0 -1 0.4"/><axis xyz="0 2 1"/>
  <limit lower="-1" upper="1" velocity="1" effort="0"/>
  <mimic joint="c" multiplier="-0.5" offset="0.2"/></joint></robot>""".replace(
    '<mass', '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/><mass')


@lru_cache(maxsize=None)
def urdf_path(name):
    """Return the path of a robot's URDF in example-robot-data."""
    wanted = f'robots/{(URDFS | STILL)[name]}'
    for file in files('example-robot-data'):
        if str(file).endswith(wanted):
            return Path(file.locate()).resolve()
    raise FileNotFoundError(f'example-robot-data has no {wanted}')


@lru_cache(maxsize=None)
def urdf_robot(name, joints=None):
    """Return a robot of example-robot-data; `joints` is a tuple or None."""
    return Robot.from_urdf(urdf_path(name), joints=joints)


@lru_cache(maxsize=None)
def panda():
    """Return the Panda of this repository: seven joints, with limits."""
    return Robot.from_file(PANDA_DH)


@lru_cache(maxsize=None)
def moving_panda(base='planar'):
    """Return the Panda of this repository on a base that moves."""
    return Robot.from_file(PANDA_DH, base=base)


def robot_for(*kinds):
    """Return a Panda that has what classes of tasks need."""
    arm = tuple(f'panda_joint{number}' for number in range(1, 8))
    for found in (panda, moving_panda, lambda: urdf_robot('panda', arm)):
        if not any(lacks(kind.type_name, kind.needs, found(), kind.example) for kind in kinds):
            return found()
    raise LookupError(f'no test robot has what {", ".join(map(str, kinds))} need')


@lru_cache(maxsize=None)
def planar():
    """Return the planar arm with three joints of *lab* (docs/sources.md)."""
    return Robot.from_file(PLANAR_DH)


def cartesian(limits=None):
    """Return a robot whose three joints slide along x, y and z."""
    axes = {'x': '1 0 0', 'y': '0 1 0', 'z': '0 0 1'}
    links = ''.join(f'<link name="{name}"/>' for name in ('base', *axes))
    joints = ''.join(
        f'<joint name="slide_{name}" type="prismatic"><parent link="{parent}"/>'
        f'<child link="{name}"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for parent, (name, axis) in zip(('base', 'x', 'y'), axes.items()))
    return Robot.from_urdf(f'<robot name="r">{links}{joints}</robot>', limits=limits)


@lru_cache(maxsize=None)
def mixed():
    """Return an arm with a revolute, a prismatic and two continuous joints, with limits."""
    return Robot.from_dh([
        {'name': 'turn', 'a': 0.3, 'alpha': 0.7, 'd': 0.2, 'lower': -2.0, 'upper': 2.5,
         'velocity': 1.5},
        {'name': 'slide', 'a': 0.1, 'alpha': -1.1, 'theta': 0.4, 'type': 'prismatic',
         'lower': -0.2, 'upper': 0.6, 'velocity': 0.4},
        {'name': 'spin', 'a': 0.25, 'alpha': 1.3, 'd': -0.1, 'type': 'continuous',
         'velocity': 2.0},
        {'name': 'roll', 'a': 0.2, 'alpha': 0.2, 'd': 0.15, 'theta': -0.5, 'type': 'continuous',
         'velocity': 3.0},
    ])


# {name: function that returns a robot} of all that the core supports.
EVERY = {
    **{name: lambda name=name: urdf_robot(name) for name in URDFS},
    'Panda': panda,
    'DH arm': mixed,
    'chain': lambda: Robot.from_urdf(CHAIN),
    'a passive joint': lambda: Robot.from_urdf(CHAIN, joints=['c']),
    **{base: lambda base=base: moving_panda(base)
       for base in ('planar', 'differential', 'underwater', 'floating')},
    'walker': lambda: Robot.from_urdf(urdf_path('talos'), base='floating'),
    'rover': lambda: Robot.from_urdf(urdf_path('tiago'), base='planar'),
}


@lru_cache(maxsize=None)
def named(name):
    """Return one of `EVERY`."""
    return EVERY[name]()


def anywhere(robot, rng):
    """Return q and the passive positions of a robot at random."""
    rows = robot.joint_columns
    joints = rng.uniform(np.maximum(robot.lower[rows], -3.0), np.minimum(robot.upper[rows], 3.0))
    T = pose(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    return (robot.configuration(joints, T) if robot.moves else joints,
            rng.uniform(-1.0, 1.0, len(robot.passive_names)))

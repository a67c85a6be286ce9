# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Robots that the tests share: the files of this repository and of example-robot-data."""

from functools import lru_cache
from importlib.metadata import files
from pathlib import Path

from tp_controller import Robot
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

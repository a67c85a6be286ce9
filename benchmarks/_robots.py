# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robots that the benchmarks share: those of this repository and of example-robot-data."""

from importlib.metadata import distribution
from pathlib import Path

from tp_controller import Robot

CONFIG = Path(__file__).resolve().parent.parent / 'config'
PANDA_READY = (0.3, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8)
PANDA_JOINTS = [f'panda_joint{number}' for number in range(1, 8)]
BAXTER_JOINTS = [f'{side}_{joint}' for side in ('left', 'right')
                 for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')]
TALOS_JOINTS = [f'torso_{number}_joint' for number in (1, 2)] + \
    [f'head_{number}_joint' for number in (1, 2)] + \
    [f'arm_{side}_{number}_joint' for side in ('left', 'right') for number in range(1, 8)]
LEG_JOINTS = [f'leg_{side}_{number}_joint' for side in ('left', 'right')
              for number in range(1, 7)]
TIAGO_JOINTS = ['torso_lift_joint', *(f'arm_{number}_joint' for number in range(1, 8))]
ARM_READY = (0.3, 0.5, -0.4, -1.4, 0.2, 0.1, 0.1)
TALOS_READY = (0.1, 0.2, 0.05, 0.1, *ARM_READY, *(-value for value in ARM_READY[:3]),
               *ARM_READY[3:])
# Arms of equal links in a plane, such as ``planar 10R``: their length [m].
PLANAR_LENGTH = 2.0
# {name: (file name in example-robot-data, joints)}
URDFS = {'Panda, URDF': ('panda.urdf', PANDA_JOINTS),
         'UR5': ('ur5_robot.urdf', None), 'HyQ': ('hyq_no_sensors.urdf', None),
         'xArm 7': ('xarm7.urdf', None), 'SO-101': ('so101.urdf', None),
         'Baxter': ('baxter.urdf', BAXTER_JOINTS),
         'Talos': ('talos_reduced.urdf', TALOS_JOINTS),
         'Talos, 30 joints': ('talos_reduced.urdf', LEG_JOINTS + TALOS_JOINTS),
         'Talos arm': ('talos_left_arm.urdf', None), 'TIAGo': ('tiago.urdf', TIAGO_JOINTS),
         'TIAGo on wheels': ('tiago.urdf', TIAGO_JOINTS)}
# {name: file in config/robots}
FILES = {'Panda': 'panda.yaml', 'FR3': 'fr3.yaml', 'planar 3R': 'planar_3r.yaml',
         'mobile arm': 'mobile_arm.urdf'}
# {name: kind of base}; the others do not move.
BASES = {'TIAGo on wheels': 'planar', 'mobile arm': 'planar'}


def load_robot(name, acceleration=None, limits=None, jerk=None):
    """
    Return a robot.

    Parameters
    ----------
    name : str
        One of `FILES` or `URDFS`, or an arm with any number of joints, such as ``planar 10R``.
    acceleration : float, optional
        Limit of every joint, and of a base that moves [rad/s² or m/s²]; none by default.
    limits : dict, optional
        Single limits, {joint: {limit: value}}; instead of `acceleration`.
    jerk : float, optional
        The same beside `acceleration` [rad/s³ or m/s³]; none by default.

    Returns
    -------
    Robot

    """
    if acceleration is None:
        return _load(name, limits)
    names = _load(name, None).velocity_names
    given = {'acceleration': acceleration} | ({} if jerk is None else {'jerk': jerk})
    return _load(name, dict.fromkeys(names, given))


def _load(name, limits):
    """Return a robot with some limits replaced."""
    base = BASES.get(name, 'fixed')
    if name in FILES:
        return Robot.from_file(CONFIG / 'robots' / FILES[name], limits=limits, base=base)
    if name.startswith('planar '):
        return Robot.from_dh(_planar(int(name[7:-1]), limits or {}))
    file_name, joints = URDFS[name]
    return Robot.from_urdf(example_urdf(file_name), joints=joints, limits=limits, base=base)


def example_urdf(name):
    """Return the URDF of a file of example-robot-data, by the end of its path."""
    installed = distribution('example-robot-data')
    path = next(installed.locate_file(file) for file in installed.files
                if str(file).endswith(f'/{name}'))
    # Their meshes are beside them, not in a ROS workspace.
    share = next(folder for folder in Path(path).parents if folder.name == 'example-robot-data')
    return Path(path).read_text(encoding='utf-8').replace('package://example-robot-data',
                                                          str(share))


def _planar(joints, limits):
    """Return the table of an arm in a plane."""
    return [{'name': f'joint{number}', 'a': PLANAR_LENGTH / joints, 'lower': -2.0, 'upper': 2.0,
             'velocity': 2.0, **limits.get(f'joint{number}', {})}
            for number in range(1, joints + 1)]

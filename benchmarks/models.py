# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Robots that can be read, of example-robot-data and of what is here of robot_descriptions.

Descriptions are taken from the cache of robot_descriptions (`ROBOT_DESCRIPTIONS_CACHE`), whatever
their commit; nothing is downloaded. Forward kinematics are compared with those of Pinocchio's own
reader at random positions, and of an MJCF with those of MuJoCo where that is installed.
"""

import argparse
from collections import Counter
import importlib
from importlib.metadata import files
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio
from tp_controller import Robot, RobotError
from tp_controller.model.sources import DESCRIPTION_PREFIX
from tp_controller.model.urdf import mimic_rules, moving_joints, parse, resolve_mimic
from tp_controller.model.xacro_files import expand_xacro

POSITIONS = 3
LONGEST_MESSAGE = 110


def example_robots():
    """Yield (name, format, source) of the robots of example-robot-data."""
    for file in files('example-robot-data') or ():
        if file.suffix == '.urdf' and 'robots' in file.parts:
            yield file.stem, 'URDF', Path(file.locate()).resolve()


def cached_descriptions():
    """Yield (name, format, source) of the descriptions in the cache of robot_descriptions."""
    cache = importlib.import_module('robot_descriptions._cache')

    def present(_, folder, commit=None):
        if not os.path.isdir(folder):
            raise FileNotFoundError(folder)
        return SimpleNamespace(working_dir=folder)

    cache.clone_to_directory = present
    names = importlib.import_module('robot_descriptions._descriptions').DESCRIPTIONS
    for name in names:
        try:
            module = importlib.import_module(f'robot_descriptions.{name}')
        except FileNotFoundError:
            continue
        path, kind = next((Path(getattr(module, attribute)), kind) for attribute, kind in (
            ('URDF_PATH', 'URDF'), ('XACRO_PATH', 'xacro'), ('MJCF_PATH', 'MJCF'))
            if hasattr(module, attribute))
        if path.is_file():
            yield name, kind, f'{DESCRIPTION_PREFIX}{name}'


def configuration(robot, rng):
    """Return random positions of the driven joints, and {joint: position} of all joints."""
    rows = robot.joint_columns
    q = rng.uniform(np.maximum(robot.lower[rows], -1.0), np.maximum(
        np.minimum(robot.upper[rows], 1.0), np.maximum(robot.lower[rows], -1.0)))
    values = dict(zip(robot.joint_names, q)) | dict(zip(robot.passive_names,
                                                        robot.passive_neutral))
    rules = mimic_rules(moving_joints(parse(robot.urdf)))
    for name in rules:
        leader, multiplier, offset = resolve_mimic(name, rules)
        values[name] = multiplier * values[leader] + offset
    return q, values


def pinocchio_poses(model, values):
    """Return {link: pose} of a model of Pinocchio."""
    q, data = pinocchio.neutral(model), model.createData()
    for joint, name in zip(model.joints[1:], model.names[1:]):
        if name in values and joint.nq <= 2:
            angle = values[name]
            q[joint.idx_q:joint.idx_q + joint.nq] = \
                angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
        elif f'{name}_yaw' in values:
            x, y, yaw = (values[f'{name}_{axis}'] for axis in ('x', 'y', 'yaw'))
            q[joint.idx_q:joint.idx_q + 4] = x, y, np.cos(yaw), np.sin(yaw)
    pinocchio.framesForwardKinematics(model, data, q)
    return {frame.name: placement.homogeneous
            for frame, placement in zip(model.frames, data.oMf)
            if frame.type == pinocchio.FrameType.BODY}


def mujoco_poses(mujoco, path, values):
    """Return {body: pose} of MuJoCo."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for row in range(model.njnt):
        joint = model.joint(row)
        if joint.name in values and joint.qposadr.size == 1 and joint.type[0] >= 2:
            data.qpos[joint.qposadr[0]] = values[joint.name]
    mujoco.mj_kinematics(model, data)
    poses = {}
    for row in range(model.nbody):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = data.xmat[row].reshape(3, 3), data.xpos[row]
        poses[model.body(row).name] = T
    return poses


def reference(kind, source):
    """Return a function from {joint: position} to {link: pose}, and the name of its library."""
    if isinstance(source, Path):
        path = source
    else:
        module = importlib.import_module(f'robot_descriptions.{source.partition(":")[2]}')
        path = Path(next(getattr(module, name) for name in (
            'URDF_PATH', 'XACRO_PATH', 'MJCF_PATH') if hasattr(module, name)))
    if kind == 'xacro':
        packages = {name: Path(folder) for name, folder in
                    getattr(module, 'XACRO_PACKAGE_PATHS', {}).items()}
        model = pinocchio.buildModelFromXML(
            expand_xacro(path, getattr(module, 'XACRO_ARGS', {}), packages))
    elif kind == 'MJCF':
        try:
            mujoco = importlib.import_module('mujoco')
            mujoco.MjModel.from_xml_path(str(path))
            return lambda values: mujoco_poses(mujoco, path, values), 'MuJoCo'
        except (ImportError, ValueError):
            # Not installed, or without the meshes, which Pinocchio does not need.
            model = pinocchio.buildModelFromMJCF(str(path))
    else:
        model = pinocchio.buildModelFromUrdf(str(path))
    return lambda values: pinocchio_poses(model, values), 'Pinocchio'


def difference(robot, poses_of):
    """Return the largest difference of poses relative to the root [m or 1]."""
    rng, largest = np.random.default_rng(0), 0.0
    for _ in range(POSITIONS):
        q, values = configuration(robot, rng)
        state, poses = robot.state(robot.configuration(q)), poses_of(values)
        inverse = np.linalg.inv(poses.get(robot.root, np.eye(4)))
        for name, T in poses.items():
            if name in robot.frame_names:
                largest = max(largest, np.abs(inverse.dot(T) - state.pose(name)).max())
    return largest


def row_of(kind, source):
    """Return (joints, difference, library, message) of a robot."""
    try:
        robot = Robot.from_file(source)
    except RobotError as error:
        if not str(error).endswith('set base'):
            return '', '', '', str(error)
        # Without joints, such as a drone.
        robot = Robot.from_file(source, base='floating')
        return robot.n, '', '', 'with base: floating'
    try:
        poses_of, library = reference(kind, source)
        return robot.n, f'{difference(robot, poses_of):.0e}', library, ''
    except (ValueError, RuntimeError, IndexError) as error:
        return robot.n, '', '', f'no reference: {" ".join(str(error).split())}'


def main():
    """Print one line for each robot, and how many of each format load."""
    argparse.ArgumentParser(description=__doc__.splitlines()[1]).parse_args()
    counts = Counter()
    print(f'{"robot":40} {"format":6} {"n":>4} {"difference":>10} library')
    for package, robots in (('example-robot-data', example_robots()),
                            ('robot_descriptions', cached_descriptions())):
        for name, kind, source in robots:
            n, error, library, message = row_of(kind, source)
            print(f'{name:40} {kind:6} {n:4} {error:>10} {library} {message[:LONGEST_MESSAGE]}',
                  flush=True)
            counts[package, kind, 'loads' if n != '' else 'does not load'] += 1
    for (package, kind, state), count in sorted(counts.items()):
        print(f'{package}: {count} {kind} {state}')


if __name__ == '__main__':
    main()

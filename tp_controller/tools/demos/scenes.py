# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes of a lesson on task priorities, in simulated time without ROS."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
import math
from typing import cast, TypeVar

import numpy as np
from tp_controller import Robot, Settings
from tp_controller.model.shapes import Cylinder, Sphere
from tp_controller.model.simulator import initial_positions
from tp_controller.model.spatial import Array, rotation_from_rpy
from tp_controller.resources import package_share
from tp_controller.solver.sequential import SequentialSolver
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.joint_limits import JointLimits
from tp_controller.tasks.obstacles import Obstacles
from tp_controller.tools.demos.motion import FixedObject, Look
from tp_controller.tools.demos.scenarios import Demo
from tp_controller.tools.demos.scene import Check, Curve, Failure, Scene, Variant
from tp_controller.tools.demos.simulation import Run

Step = TypeVar('Step')

ROBOTS = package_share() / 'config' / 'robots'
SECONDS_PER_GOAL = 4.0
# The camera, its line of sight, and the object.
CAMERA_OBJECTS = (FixedObject('camera', Cylinder(0.014, 0.03)),
                  FixedObject('camera', Cylinder(0.002, 0.2), (0.0, 0.0, 0.1)),
                  FixedObject('base_link', Sphere(0.02), (0.27, 0.0, 0.0)))
# Scenes that a page shows, too: {name: robot, stack and goals of its files}.
DEMOS = {name: Demo(name, title, leader) for name, title, leader in (
    ('camera', 'A camera on an arm with five joints', 'place'),
    ('bounds', 'Bounds that switch on and off', 'tool'))}
# Time at which a joint fails, and time for each pose of the tool [s].
FAILS, SECONDS_PER_POSE = 0.8, 5.0
FAILED_JOINT, FAILED_TOOL = 'panda_joint3', 'panda_hand_tcp'
FAILED_START = (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785)
# Shift [m] and turn (roll, pitch, yaw) [rad] of each pose of the tool from the first one.
FAILED_GOALS = (
    ((0.05, 0.35, 0.0), (0.2, 0.0, 0.4)), ((0.1, -0.1, -0.15), (0.0, -0.3, 0.0)),
    ((-0.05, 0.2, 0.1), (0.3, 0.2, 0.0)))
# Postures and tasks of the scenes that have no files.
MOBILE_START = '{torso_lift: 0.15, arm_1: 0.3, arm_2: 0.5, arm_4: 1.2, arm_6: -0.6}'
MOBILE_STACK = """
- [tool: {type: position, frame: tool, gain: 1.0}, level: {type: orientation, frame: tool}]
"""
# Ahead, aside and down from the start [m].
MOBILE_STEP = (0.4, 0.1, -0.1)
PLANAR_START = (0.1, 0.808, 1.195)
PLANAR_STACK = """
- end_effector: {type: position, frame: link3, axes: xy, gain: 5.0}
- joint1: {type: joint, joints: joint1, gain: 5.0}
"""
PLANAR_SPEED = 20.0
UNDAMPED = Settings(damping=0.0, release_region=0.0, regularisation=0.0, scaling='uniform',
                    blend=0.0)
DAMPED = Settings(scaling='uniform', blend=0.0)


def camera() -> Scene:
    """Return the scene of a camera on an arm with five joints."""
    demo = DEMOS['camera']
    stack = demo.file('_stack').read_text(encoding='utf-8')
    upright = stack.replace('gain: 3.0', 'gain: 3.0, up: y')
    return Scene(
        demo.title,
        'Five joints cannot bring a camera to any pose. Can it go to a place and look at an '
        'object?',
        'Yes: 3 rows for the place and 2 for the direction are 5 rows for 5 joints; the turn '
        'about the line of sight follows. A demand for an upright picture, a sixth row above the '
        'place, takes 10 cm of the place, except where the picture is upright anyway.',
        lambda: demo.robot, demo.start, SECONDS_PER_GOAL * len(demo.steps), _steps(demo),
        {'direction': Variant(stack, demo.settings),
         'upright': Variant(upright, demo.settings)},
        {'camera off its place': Curve('mm', lambda run: 1e3 * run.errors['place']),
         'object off the line of sight': Curve('°', sight)},
        (Check('direction', 'camera off its place', 1.0, since=3.5, until=4.0),
         Check('upright', 'camera off its place', 100.0, 0.05, since=3.5, until=4.0),
         Check('upright', 'camera off its place', 1.0, since=7.5, until=8.0),
         Check('direction', 'object off the line of sight', 0.2, since=3.0),
         Check('upright', 'object off the line of sight', 0.2, since=3.0)),
        captions=_captions(demo),
        look=Look(('camera',), CAMERA_OBJECTS, view=(-60.0, 30.0), ground=0.0))


def bounds() -> Scene:
    """Return the scene of inequality tasks that switch on and off."""
    demo = DEMOS['bounds']
    tasks = demo.stack.tasks
    clear, joints = cast(Obstacles, tasks['clear']), cast(JointLimits, tasks['joints'])
    return Scene(
        demo.title,
        'When do an obstacle and the margin of a joint limit have an effect?',
        'While their multipliers are not zero, and no longer: the plot of the demo has a band at '
        'these times. Beside the ball the tool is led around it; near the base joint 4 stops at '
        'its margin, and the other joints bring the tool to its goal. A goal in the ball keeps '
        'the bound active: the tool stops in front of it.',
        lambda: demo.robot, demo.start, SECONDS_PER_GOAL * len(demo.steps), _steps(demo),
        {'bounds': Variant(demo.file('_stack'), demo.settings)},
        {'distance from the ball': Curve('m', lambda run: run.values(
            lambda state: min([*clear.value(state), clear.within])), lower=clear.distance),
         'joint nearest to its limit': Curve('rad', lambda run: run.clearance,
                                             lower=joints.margin),
         'tool off its goal': Curve('mm', lambda run: 1e3 * run.errors['tool'])},
        (Check('bounds', 'tool off its goal', 1.0, since=3.5, until=4.0),
         Check('bounds', 'tool off its goal', 1.0, since=7.5, until=8.0),
         Check('bounds', 'tool off its goal', 1.0, since=11.5, until=12.0),
         Check('bounds', 'tool off its goal', 86.5, 0.02, since=15.5)),
        active=('clear', 'joints'), captions=_captions(demo),
        look=Look(('panda_hand_tcp',), view=(-50.0, 25.0)))


def weights() -> Scene:
    """Return the scene of a vehicle and an arm that share the motion by weights."""
    robot = _mobile_robot()
    start = initial_positions(MOBILE_START, robot)
    goal = robot.state(start).position('tool') + MOBILE_STEP
    joints = robot.n - 2
    return Scene(
        'Vehicle and arm share the motion by weights',
        'A vehicle with an arm has many ways to bring its tool 0.4 m ahead. Who moves?',
        'The one that costs less: among the velocities that move the tool as demanded, the one '
        'with the least sum of w q̇² is taken. The motion of the tool is the same with all '
        'weights.',
        _mobile_robot, start, 8.0, lambda now: {'tool': goal},
        {f'{base:g} : {each:g}': Variant(MOBILE_STACK, Settings(
            weights=(base,) * 2 + (each,) * joints))
         for base, each in ((1.0, 1.0), (1.0, 10.0), (100.0, 1.0))},
        {'path of the vehicle': Curve('m', lambda run: travel(run, slice(1))),
         'turns of the arm joints, together': Curve('rad', lambda run: travel(
             run, slice(3, None))),
         'tool off its goal': Curve('mm', lambda run: 1e3 * run.errors['tool'])},
        (Check('1 : 10', 'tool off its goal', 1.0, since=7.9),
         Check('1 : 1', 'tool off its goal', 1.0, since=7.9),
         Check('100 : 1', 'tool off its goal', 1.0, since=7.9)),
        look=Look(('tool', 'base_link'), view=(-70.0, 28.0)))


def forms() -> Scene:
    """Return the scene of both forms of the method at an algorithmic singularity."""
    return Scene(
        'Two forms of the method at an algorithmic singularity',
        'Each task alone is far from singular, yet from 0.6 s to 4.3 s they contradict each '
        'other. What does each form do at the edge, where the second task loses its last '
        'direction?',
        'The undamped recursion demands ever more speed for what is left of the second task; '
        'uniform scaling then slows the first task as well. Damped, it stays at 3 rad/s and keeps '
        'the first task, but leaves the edge late. The sequential form inverts the second task '
        'as if it were alone: it is slow all the time, and misses the second task where both are '
        'possible.',
        _planar_robot, np.array(PLANAR_START), 10.0, _planar_goals,
        {'recursive, damped': Variant(PLANAR_STACK, DAMPED),
         'recursive, undamped': Variant(PLANAR_STACK, UNDAMPED),
         'sequential': Variant(PLANAR_STACK, DAMPED,
                               lambda settings, n: SequentialSolver(n))},
        {'end-effector off its goal': Curve('mm', lambda run: 1e3 * run.errors['end_effector']),
         'joint 1 off its goal': Curve('rad', lambda run: run.errors['joint1']),
         'fastest joint': Curve('rad/s', lambda run: np.abs(run.velocities).max(axis=1))},
        (Check('recursive, damped', 'fastest joint', 4.0),
         Check('recursive, damped', 'end-effector off its goal', 3.0),
         Check('recursive, damped', 'joint 1 off its goal', 1e-3, since=8.0),
         Check('recursive, undamped', 'fastest joint', PLANAR_SPEED, 1e-9),
         Check('sequential', 'fastest joint', 1.0),
         Check('sequential', 'end-effector off its goal', 1.0),
         Check('sequential', 'joint 1 off its goal', 0.35, 0.1, since=8.0)),
        moving=True, look=Look(('link3',), view=(-90.0, 55.0), ground=-0.12, enlarged=2.3))


def failed_joint() -> Scene:
    """Return the scene of a joint that fails in motion (lecture 1.1)."""
    robot, stack = _panda(), package_share() / 'config' / 'failed_joint_stack.yaml'
    first = robot.state(FAILED_START).pose(FAILED_TOOL)
    poses = [_moved(first, shift, turn) for shift, turn in FAILED_GOALS]
    column, off, turned = robot.joint_index(FAILED_JOINT), 'tool off its goal', 'tool turned'
    locked, working, untold = 'locked', 'no failure', 'in vain'
    ends = [(SECONDS_PER_POSE * number - 0.02, SECONDS_PER_POSE * number)
            for number in range(1, len(poses) + 1)]
    reached = [Check(case, curve, most, since=since, until=until)
               for case in (locked, working) for curve, most in ((off, 0.5), (turned, 0.1))
               for since, until in ends]
    missed = [Check(untold, off, error, 0.02, since, until)
              for error, (since, until) in zip((9.3, 77.2, 26.8), ends)]
    return Scene(
        'A joint fails in motion',
        f'Joint 3 of 7 stands still from {FAILS:g} s on. Does the tool still reach its poses, of '
        'six rows?',
        'Yes, if the controller is told, by a lock: the other six joints are enough. One that '
        'goes on to command the joint in vain misses all of them.',
        _panda, np.array(FAILED_START), SECONDS_PER_POSE * len(poses),
        lambda now: {'tool': _at(now, poses, SECONDS_PER_POSE)},
        {locked: Variant(stack, failure=Failure(FAILED_JOINT, FAILS, True)),
         working: Variant(stack), untold: Variant(stack, failure=Failure(
             FAILED_JOINT, FAILS, False))},
        {off: Curve('mm', lambda run: 1e3 * run.errors['tool']),
         turned: Curve('°', lambda run: np.degrees([
             report.tasks[0].errors[1][0] for report in run.reports])),
         'command of joint 3': Curve('rad/s', lambda run: np.abs(run.velocities[:, column])),
         'fastest joint, share of its limit': Curve('%', lambda run: 100.0 * np.abs(
             run.velocities / run.robot.velocity).max(axis=1))},
        (*reached, Check(locked, 'command of joint 3', 0.0, since=FAILS),
         Check(locked, 'fastest joint, share of its limit', 100.0), *missed),
        captions=((0.0, 'all joints work'), (FAILS, 'joint 3 has failed: locked, the others go '
                                                    'on')),
        look=Look((FAILED_TOOL,), view=(-40.0, 25.0)))


# {name: function that makes the scene}; files are read only then.
SCENES: Mapping[str, Callable[[], Scene]] = {
    'camera': camera, 'bounds': bounds, 'weights': weights, 'forms': forms,
    'failed_joint': failed_joint}


def sight(run: Run) -> Array:
    """Return the angle between the axis of the camera and the direction of the object (T,) [°]."""
    target = run.stack.tasks['look'].goal
    axis = run.values(lambda state: state.rotation('camera')[:, 2])
    way = target - run.values(lambda state: state.position('camera'))
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(axis, way), axis=1),
                                 (axis * way).sum(axis=1)))


def travel(run: Run, columns: slice) -> Array:
    """Return the path length of some velocities of a run at each sample (T,) [m or rad]."""
    return run.times[1] * np.cumsum(np.abs(run.velocities[:, columns]).sum(axis=1))


def _planar_goals(now: float) -> dict[str, list[float]]:
    """Return the goals of the planar arm, which contradict each other for a while."""
    turn = math.sin(math.tau * now / 10.0)
    return {'end_effector': [0.8 + 0.2 * math.sin(math.tau * now / 5.0), 0.9, 0.0],
            'joint1': [0.1 - 0.55 * turn]}


def _moved(pose: Array, shift: Sequence[float], turn: Sequence[float]) -> Array:
    """Return a pose (4, 4), shifted and turned in the root."""
    goal = pose.copy()
    goal[:3, 3] += shift
    goal[:3, :3] = rotation_from_rpy(*turn).dot(pose[:3, :3])
    return goal


@cache
def _panda() -> Robot:
    """Return the arm with seven joints."""
    return Robot.from_file(ROBOTS / 'panda.yaml')


@cache
def _mobile_robot() -> Robot:
    """Return the arm on wheels."""
    return Robot.from_file(ROBOTS / 'mobile_arm.urdf', base='differential')


@cache
def _planar_robot() -> Robot:
    """Return the planar arm with fast joints."""
    return Robot.from_file(ROBOTS / 'planar_3r.yaml', limits={
        f'joint{number}': {'velocity': PLANAR_SPEED} for number in (1, 2, 3)})


def _steps(demo: Demo) -> Callable[[float], Mapping[str, Goal]]:
    """Return the goals of a demo over time, each step for `SECONDS_PER_GOAL`."""
    def goals(now: float) -> Mapping[str, Goal]:
        return {goal['task']: goal['xyz']
                for goal in _at(now, demo.steps, SECONDS_PER_GOAL)}

    return goals


def _at(now: float, steps: Sequence[Step], seconds: float) -> Step:
    """Return the step at a time [s], each of a duration [s]; the last one from its start on."""
    return steps[min(int(now / seconds + 1e-9), len(steps) - 1)]


def _captions(demo: Demo) -> tuple[tuple[float, str], ...]:
    """Return the start time and the caption of each step."""
    return tuple((SECONDS_PER_GOAL * index, '; '.join(goal['say'] for goal in step))
                 for index, step in enumerate(demo.steps))

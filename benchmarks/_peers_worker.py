# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
One package of benchmarks/peers.py, in a process of its own.

It reads commands from its standard input and answers each, one JSON object a line. Only numpy and
the package itself are imported, so that a package whose dependencies exclude those of the others
can run in another Python environment.
"""

from copy import copy
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
import json
import os
from pathlib import Path
import sys
import time

import numpy as np

# Of `Recursion`: singular values that count as zero, as a share of the largest, and the factor of
# damped least squares [m or rad].
SMALLEST, LAMBDA = 1e-9, 0.1
# Of `Tsid`: weight of the rest of all joints where there is no posture task.
REST = 1e-6
# Error that counts as none, where a package takes one [m or rad].
EXACT = 1e-7
# Largest step that leads nowhere [rad].
STILL = 1e-9
# From when on changes of the velocity count as those of a motion under way [s].
UNDER_WAY = 1.0


class Peer:
    """
    A package at work on one robot and one list of tasks.

    Parameters
    ----------
    given : dict
        `urdf` (path), `joints` (names, in the order of all arrays here), `speed` (their limits),
        `period` [s], `gain` [1/s], `variant`, and `tasks`, the most important first: dicts with
        `name`, `type`, `frame`, and `cost`, that of a metre or radian of its error.

    """

    def __init__(self, given):
        self.given, self.tasks = given, given['tasks']
        self.joints, self.period = given['joints'], given['period']
        # Share of the error that is taken away in one cycle.
        self.share = given['gain'] * given['period']
        self.hard = given['variant'] == 'first task hard'
        self.load()

    def load(self):
        """Read the robot."""

    def start(self, goals):
        """Take goals, one for each task: a pose (4, 4), or joint positions (n,)."""
        raise NotImplementedError

    def _full(self, q):
        """Return joint positions in the order of the model."""
        full = np.empty(len(q))
        full[self.order] = q
        return full

    def aim(self, q):
        """Prepare a cycle; what a user of the package would not have to do, so not timed."""

    def at(self, q):
        """Return a peer that is prepared for cycles in a state."""
        return self

    def velocity(self, q):
        """Return the joint velocities of one cycle (n,); None where there is no solution."""
        raise NotImplementedError

    def positions(self, q, steps):
        """
        Return the joint positions at which the goals are reached, from q (n,).

        By default, as with a library without such a call, in steps of the velocity of a cycle,
        until none leads anywhere.
        """
        for _ in range(steps):
            self.aim(q)
            found = self.velocity(q)
            if found is None:
                break
            q = q + self.period * np.asarray(found)
            if np.abs(found).max() * self.period < STILL:
                break
        return q

    def axes(self, task):
        """Return 1 for the axes of a frame that an orientation is about, 0 for the others."""
        return np.array([float(axis in task.get('axes', 'xyz')) for axis in 'xyz'])


class TpController(Peer):
    """`Controller.update` of this package."""

    def load(self):
        from tp_controller import Robot
        self.robot = Robot.from_urdf(Path(self.given['urdf']), joints=self.joints)

    def start(self, goals):
        from tp_controller import Controller, Settings, Stack
        stack = Stack.from_yaml(self.given['stack'], self.robot)
        settings = Settings(period=self.period)
        self.controller = Controller(self.robot, stack, settings)
        self.stack, self.now, self.goal = stack, 0.0, goals[0]
        for task, goal in zip(self.tasks, goals):
            if task['type'] == 'posture':
                goal = dict(zip(self.joints, goal.tolist()))
            elif task['type'] == 'position':
                goal = goal[:3, 3]
            elif task['type'] == 'orientation':
                goal = goal[:3, :3]
            self.controller.set_goal(task['name'], goal, 0.0)

    def positions(self, q, steps):
        from tp_controller import PositionSolver
        if not hasattr(self, 'search'):
            self.search = PositionSolver(self.robot, self.stack)
        return self.search.solve({'tool': self.goal}, q, timeout=10.0).q

    def velocity(self, q):
        self.now += self.period
        return self.controller.update(q, self.now, elapsed=self.period).velocity


class Pink(Peer):
    """
    pink with DAQP, costs and damping of examples/arm_panda.py.

    It would refuse to go on where the tolerance of DAQP takes a joint beyond its limit by a
    millionth; its example of a humanoid turns that off, too.
    """

    def load(self):
        import pink
        import pinocchio
        self.pink = pink
        self.model = pinocchio.buildModelFromUrdf(self.given['urdf'])
        self.order = [self.model.idx_vs[self.model.getJointId(name)] for name in self.joints]

    def start(self, goals):
        from pink import tasks
        import pinocchio
        self.configuration = self.pink.Configuration(
            self.model, self.model.createData(), pinocchio.neutral(self.model))
        made = []
        for task, goal in zip(self.tasks, goals):
            cost = task['cost']
            if task['type'] == 'posture':
                made.append(tasks.PostureTask(cost=cost, gain=self.share))
                made[-1].set_target(self._full(goal))
                continue
            made.append(tasks.FrameTask(
                task['frame'], position_cost=0.0 if task['type'] == 'orientation' else cost,
                orientation_cost=0.0 if task['type'] == 'position' else cost * self.axes(task),
                lm_damping=1.0, gain=self.share))
            made[-1].set_target(pinocchio.SE3(goal))
        damping = tasks.DampingTask(cost=1e-3)
        self.soft = [*(made[1:] if self.hard else made), damping]
        self.constraints = made[:1] if self.hard else None

    def velocity(self, q):
        self.configuration.update(self._full(q))
        try:
            found = self.pink.solve_ik(self.configuration, self.soft, self.period, solver='daqp',
                                       constraints=self.constraints, safety_break=False)
        except self.pink.PinkError:
            return None
        return found[self.order]


class Mink(Peer):
    """
    mink with DAQP, limits and costs of the complete example of its tutorial.

    That has a posture task; without one, damping is that of its examples of arms.
    """

    def load(self):
        import mink
        import mujoco
        self.mink = mink
        # MuJoCo must not merge links that do not move, which are frames here.
        option = ('<mujoco><compiler fusestatic="false" discardvisual="true" boundmass="1e-3" '
                  'boundinertia="1e-6" balanceinertia="true"/></mujoco></robot>')
        text = Path(self.given['urdf']).read_text(encoding='utf-8')
        self.model = mujoco.MjModel.from_xml_string(text.replace('</robot>', option))
        self.order = [self.model.joint(name).qposadr[0] for name in self.joints]
        self.limits = [mink.ConfigurationLimit(self.model),
                       mink.VelocityLimit(self.model, dict(zip(self.joints,
                                                               self.given['speed'])))]

    def start(self, goals):
        self.configuration = self.mink.Configuration(self.model)
        made = []
        for task, goal in zip(self.tasks, goals):
            cost = task['cost']
            if task['type'] == 'posture':
                made.append(self.mink.PostureTask(self.model, cost=cost, gain=self.share))
                made[-1].set_target(self._full(goal))
                continue
            made.append(self.mink.FrameTask(
                task['frame'], 'body',
                position_cost=0.0 if task['type'] == 'orientation' else cost,
                orientation_cost=0.0 if task['type'] == 'position' else cost * self.axes(task),
                gain=self.share))
            made[-1].set_target(self.mink.SE3.from_matrix(goal))
        self.soft = made[1:] if self.hard else made
        self.constraints = made[:1] if self.hard else None
        posture = any(task['type'] == 'posture' for task in self.tasks)
        self.damping = 1e-12 if posture else 1e-3

    def velocity(self, q):
        self.configuration.update(self._full(q))
        try:
            found = self.mink.solve_ik(self.configuration, self.soft, self.period, 'daqp',
                                       self.damping, limits=self.limits,
                                       constraints=self.constraints)
        except self.mink.MinkError:
            return None
        return found[self.order]


class Placo(Peer):
    """
    placo with the weights of its documentation, and limits as there.

    Its tasks have no gain: they take the whole error away in one cycle. So every cycle gets a
    goal that is only a share of the way ahead.
    """

    def load(self):
        import placo
        self.placo = placo
        self.robot = placo.RobotWrapper(self.given['urdf'], placo.Flags.ignore_collisions)
        self.order = [self.robot.get_joint_v_offset(name) for name in self.joints]
        self.places = [self.robot.get_joint_offset(name) for name in self.joints]
        self.full = np.array(self.robot.state.q)

    def start(self, goals):
        self.goals = goals
        self.solver = self.robot.make_solver()
        self.solver.mask_fbase(True)
        self.solver.dt = self.period
        self.solver.enable_velocity_limits(True)
        self.made = []
        for index, task in enumerate(self.tasks):
            # A weight multiplies the square of an error, a cost the error.
            priority, weight = 'soft', task['cost'] ** 2
            if index == 0 and self.hard:
                priority = 'scaled'
            self.made.append(self._add(task, priority, weight))

    def _add(self, task, priority, weight):
        """Return a task of the solver."""
        name, frame, kind = task['name'], task.get('frame'), task['type']
        if kind == 'posture':
            made = self.solver.add_joints_task()
            made.configure(name, priority, weight)
        elif kind == 'pose':
            made = self.solver.add_frame_task(frame, np.eye(4))
            made.configure(name, priority, weight, weight)
        elif kind == 'position':
            made = self.solver.add_position_task(frame, np.zeros(3))
            made.configure(name, priority, weight)
        else:
            made = self.solver.add_orientation_task(frame, np.eye(3))
            made.configure(name, priority, weight)
            made.mask.set_axises(task.get('axes', 'xyz'), 'world')
        return made

    def aim(self, q):
        self._place(q)
        for task, made, goal in zip(self.tasks, self.made, self.goals):
            if task['type'] == 'posture':
                made.set_joints(dict(zip(self.joints, q + self.share * (goal - q))))
                continue
            ahead = on_the_way(np.array(self.robot.get_T_world_frame(task['frame'])), goal,
                               self.share)
            if task['type'] == 'pose':
                made.T_world_frame = ahead
            elif task['type'] == 'position':
                made.target_world = ahead[:3, 3]
            else:
                made.R_world_frame = ahead[:3, :3]

    def at(self, q):
        other = copy(self)
        other.start(self.goals)
        other.aim(q)
        return other

    def velocity(self, q):
        self._place(q)
        try:
            found = self.solver.solve(False)
        except RuntimeError:
            return None
        return found[self.order] / self.period

    def _place(self, q):
        """Put the robot where it is."""
        self.full[self.places] = q
        self.robot.state.q = self.full
        self.robot.update_kinematics()


class Embodik(Peer):
    """embodik with priorities, its default settings, or mode MIN_ERROR for every task."""

    def load(self):
        import embodik
        self.embodik = embodik
        self.model = embodik.RobotModel(self.given['urdf'])
        self.order = [self.model.get_joint_velocity_index(name) for name in self.joints]

    def start(self, goals):
        kinds = self.embodik.TaskType
        self.goal = goals[0]
        self.solver = solver = self.embodik.KinematicsSolver(self.model)
        solver.dt = self.period
        for index, (task, goal) in enumerate(zip(self.tasks, goals)):
            name, kind = task['name'], task['type']
            if kind == 'posture':
                made = solver.add_posture_task(name)
                made.set_target_configuration(self._full(goal))
            else:
                made = solver.add_frame_task(name, task['frame'],
                                             getattr(kinds, f'FRAME_{kind.upper()}'))
                made.set_target_pose(goal[:3, 3].copy(), np.asfortranarray(goal[:3, :3]))
                made.set_orientation_mask(self.axes(task))
            made.priority, made.weight = index, self.given['gain']
            if self.given['variant'] == 'MIN_ERROR':
                made.solve_mode = self.embodik.TaskSolveMode.MIN_ERROR

    def positions(self, q, steps):
        options = self.embodik.PositionIKOptions()
        options.max_iterations = steps
        options.position_tolerance = options.orientation_tolerance = EXACT
        task, = self.tasks
        found = self.solver.solve_position(self._full(q), np.asfortranarray(self.goal),
                                           task['frame'], options)
        return np.array(found.q_solution)[self.order]

    def velocity(self, q):
        found = self.solver.solve_velocity(self._full(q), apply_limits=True)
        if found.status != self.embodik.SolverStatus.SUCCESS:
            return None
        return np.asarray(found.joint_velocities)[self.order]


class Oink(Peer):
    """
    OInK of roboplan, with priorities and the values of the usage example in its documentation.

    Version 0.7 projects lower tasks into the null space of those above and solves one quadratic
    program, so priorities are strict until a limit is active. The example also limits the error
    of positions, for barriers, which there are none of here. A frame task has no axes: an
    orientation about some of them becomes one about all.
    """

    def load(self):
        from roboplan import core, optimal_ik
        self.optimal_ik = optimal_ik
        self.scene = core.Scene('robot', core.loadUrdfSceneDescription(self.given['urdf']))
        self.scene.addGroup('joints', self.joints)
        self.target = core.CartesianConfiguration

    def start(self, goals):
        optimal_ik = self.optimal_ik
        self.solver = optimal_ik.Oink(self.scene, 'joints')
        self.order = self.solver.q_indices
        self.step = np.zeros(len(self.joints))
        self.made = [self._task(task, goal, priority)
                     for priority, (task, goal) in enumerate(zip(self.tasks, goals), 1)]
        self.limits = [optimal_ik.PositionLimit(self.solver, gain=1.0), optimal_ik.VelocityLimit(
            self.solver, self.period, np.array(self.given['speed']))]

    def _task(self, task, goal, priority):
        """Return a task with its goal."""
        optimal_ik, kind = self.optimal_ik, task['type']
        if kind == 'posture':
            return optimal_ik.ConfigurationTask(
                self.solver, goal, np.full(len(goal), 0.05),
                optimal_ik.ConfigurationTaskOptions(task_gain=self.share, priority=priority))
        return optimal_ik.FrameTask(
            self.solver, self.scene, self.target('', task['frame'], goal),
            optimal_ik.FrameTaskOptions(
                position_cost=0.0 if kind == 'orientation' else 1.0,
                orientation_cost=0.0 if kind == 'position' else 0.1,
                task_gain=self.share, lm_damping=0.01, priority=priority))

    def velocity(self, q):
        try:
            self.solver.solveIk(self._full(q), self.made, self.limits, self.step,
                                regularization=1e-6)
        except RuntimeError:
            return None
        return self.step / self.period


class Tsid(Peer):
    """
    TSID: a step of its inverse dynamics in every cycle, integrated to velocities.

    Weights, and how accelerations are integrated, are those of its exercise with a UR5. The gains
    are not: with Kp = gain / period and Kd = 1 / period, a task that nothing limits has after one
    cycle the velocity that the others give it. Without a posture task velocities are damped by a
    small weight, or they would stay what they are in the null space. A joint may go from full
    speed to full speed the other way within a cycle.
    """

    def load(self):
        # TSID needs its conversions, but does not import it.
        import_module('pinocchio')
        import tsid
        self.tsid = tsid
        self.robot = tsid.RobotWrapper(self.given['urdf'], [''], False)
        self.model = self.robot.model()
        self.order = [self.model.idx_vs[self.model.getJointId(name)] for name in self.joints]

    def start(self, goals):
        tsid = self.tsid
        self.rate = np.zeros(len(self.joints))
        self.problem = tsid.InverseDynamicsFormulationAccForce('problem', self.robot, False)
        self.problem.computeProblemData(0.0, self._full(self.rate), self.rate)
        # The formulation refers to its tasks, and does not keep them.
        self.made = [self._limits()]
        for task, goal in zip(self.tasks, goals):
            self._add(self._task(task, goal), task['cost'] ** 2)
        if all(task['type'] != 'posture' for task in self.tasks):
            rest = tsid.TaskJointPosture('rest', self.robot)
            rest.setKp(np.zeros(len(self.joints)))
            rest.setReference(self._constant(self.rate))
            self._add(rest, REST)
        self.solver = tsid.SolverHQuadProgFast('solver')
        self.solver.resize(self.problem.nVar, self.problem.nEq, self.problem.nIn)

    def _limits(self):
        """Add the limits of joints and return them."""
        speed = self._full(np.array(self.given['speed']))
        made = self.tsid.TaskJointPosVelAccBounds('limits', self.robot, self.period, False)
        made.setPositionBounds(self.model.lowerPositionLimit, self.model.upperPositionLimit)
        made.setVelocityBounds(speed)
        made.setAccelerationBounds(2.0 * speed / self.period)
        self.problem.addMotionTask(made, 1.0, 0, 0.0)
        return made

    def _task(self, task, goal):
        """Return a task with its goal."""
        import pinocchio
        if task['type'] == 'posture':
            made = self.tsid.TaskJointPosture(task['name'], self.robot)
            made.setKp(np.full(len(self.joints), self.given['gain'] / self.period))
            made.setReference(self._constant(self._full(goal)))
            return made
        made = self.tsid.TaskSE3Equality(task['name'], self.robot, task['frame'])
        made.setKp(np.full(6, self.given['gain'] / self.period))
        made.setMask(np.array([*np.full(3, float(task['type'] != 'orientation')),
                               *(self.axes(task) if task['type'] != 'position' else np.zeros(3))]))
        made.setReference(self.tsid.TrajectorySE3Constant(
            task['name'], pinocchio.SE3(goal)).computeNext())
        return made

    def _constant(self, q):
        """Return a reference that does not move."""
        return self.tsid.TrajectoryEuclidianConstant('reference', q).computeNext()

    def _add(self, made, weight):
        """Add a task, which takes away the velocity that it does not demand within a cycle."""
        made.setKd(np.full(len(made.Kp), 1.0 / self.period))
        self.problem.addMotionTask(made, weight, 1, 0.0)
        self.made.append(made)

    def velocity(self, q):
        found = self.solver.solve(self.problem.computeProblemData(0.0, self._full(q), self.rate))
        if found.status != 0:
            self.rate = np.zeros(len(self.joints))
            return None
        change = self.period * self.problem.getAccelerations(found)
        mean = self.rate + 0.5 * change
        self.rate = self.rate + change
        return mean[self.order]


class Recursion(Peer):
    """
    The plain recursion of *lecture* 2.2 and 4 (docs/sources.md), with Pinocchio's kinematics.

    Every task acts in the null space of those above, by pseudoinverses or, in variant `damped`,
    by damped least squares with the exact projector. One factor for all joints keeps their
    velocity limits. There are no position limits.
    """

    def load(self):
        import pinocchio
        self.pinocchio = pinocchio
        self.model = pinocchio.buildModelFromUrdf(self.given['urdf'])
        self.data = self.model.createData()
        self.order = [self.model.idx_vs[self.model.getJointId(name)] for name in self.joints]
        self.speed = self._full(np.array(self.given['speed']))

    def start(self, goals):
        self.goals = [self._full(goal) if task['type'] == 'posture' else goal
                      for task, goal in zip(self.tasks, goals)]
        self.frames = [self.model.getFrameId(task.get('frame', 'universe')) for task in self.tasks]

    def velocity(self, q):
        q, damped = self._full(q), self.given['variant'] == 'damped'
        self.pinocchio.computeJointJacobians(self.model, self.data, q)
        self.pinocchio.updateFramePlacements(self.model, self.data)
        found, P = np.zeros(len(q)), np.eye(len(q))
        for task, goal, frame in zip(self.tasks, self.goals, self.frames):
            error, J = self._error_and_jacobian(task, goal, frame, q)
            J_bar = J @ P
            inverse = np.linalg.pinv(J_bar, rcond=SMALLEST)
            used = inverse
            if damped:
                used = J_bar.T @ np.linalg.inv(J_bar @ J_bar.T + LAMBDA ** 2 * np.eye(len(J)))
            found = found + used @ (self.given['gain'] * error - J @ found)
            P = P - inverse @ J_bar
        return (found / max(np.max(np.abs(found) / self.speed), 1.0))[self.order]

    def _error_and_jacobian(self, task, goal, frame, q):
        """Return what a task misses, and how joints change it."""
        if task['type'] == 'posture':
            return goal - q, np.eye(len(q))
        pose = self.data.oMf[frame]
        J = self.pinocchio.getFrameJacobian(self.model, self.data, frame,
                                            self.pinocchio.LOCAL_WORLD_ALIGNED)
        if task['type'] == 'position':
            return goal[:3, 3] - pose.translation, J[:3]
        turn = self.pinocchio.log3(goal[:3, :3] @ pose.rotation.T)
        if task['type'] == 'orientation':
            chosen = self.axes(task) > 0.0
            return turn[chosen], J[3:][chosen]
        return np.concatenate((goal[:3, 3] - pose.translation, turn)), J


# {package: (distribution, what is imported, class)}
PACKAGES = {'tp_controller': ('tp_controller', 'tp_controller', TpController),
            'pink': ('pin-pink', 'pink', Pink), 'mink': ('mink', 'mink', Mink),
            'placo': ('placo', 'placo', Placo), 'embodik': ('embodik', 'embodik', Embodik),
            'oink': ('roboplan-oink', 'roboplan.optimal_ik', Oink),
            'tsid': ('tsid', 'tsid', Tsid), 'recursion': ('pin', 'pinocchio', Recursion)}


def on_the_way(pose, goal, share):
    """Return the pose (4, 4) that is a share of the way from a pose to a goal."""
    R = goal[:3, :3] @ pose[:3, :3].T
    vector = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = np.linalg.norm(vector), 0.5 * (np.trace(R) - 1.0)
    ahead = pose.copy()
    ahead[:3, 3] += share * (goal[:3, 3] - pose[:3, 3])
    if sine > 0.0:
        x, y, z = vector / sine
        turn = share * np.arctan2(sine, cosine)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        ahead[:3, :3] = (np.eye(3) + np.sin(turn) * cross +
                         (1.0 - np.cos(turn)) * cross @ cross) @ pose[:3, :3]
    return ahead


def measure(peer, states, cycles, pause):
    """Return the processor time of a cycle [µs], and the share of cycles without a solution."""
    prepared = [(peer.at(q), q) for q in states]
    failed = spent = 0
    # Without pauses the clock is not read in each cycle.
    batch = 1 if pause else cycles
    for first in range(0, cycles, batch):
        time.sleep(pause)
        began = time.thread_time_ns()
        for k in range(first, first + batch):
            ready, q = prepared[k % len(prepared)]
            failed += ready.velocity(q) is None
        spent += time.thread_time_ns() - began
    return {'micros': spent / cycles / 1e3, 'failed': failed / cycles}


def simulate(peer, q, cycles, limits):
    """
    Run a closed loop with a robot that does what it is told, at rest first.

    Returns
    -------
    dict
        `q` where it ends, `failed`: share of the cycles without a solution (the robot stands
        still in them), `speed` and `position`: by how much limits were exceeded at most, as a
        share of the limit and [rad], `change` and `start`: largest change of a velocity from one
        cycle to the next [rad/s], after the first second and in it, `seconds` of processor time.

    """
    lower, upper, fastest = limits
    velocity, failed, speed, position = np.zeros(len(q)), 0, -np.inf, -np.inf
    changes, spent = np.zeros(cycles), 0
    for cycle in range(cycles):
        peer.aim(q)
        began = time.thread_time_ns()
        found = peer.velocity(q)
        spent += time.thread_time_ns() - began
        failed += found is None
        previous, velocity = velocity, np.zeros(len(q)) if found is None else np.array(found)
        q = q + peer.period * velocity
        changes[cycle] = np.abs(velocity - previous).max()
        speed = max(speed, (np.abs(velocity) / fastest).max() - 1.0)
        position = max(position, (lower - q).max(), (q - upper).max())
    first = int(UNDER_WAY / peer.period)
    return {'q': q.tolist(), 'failed': failed / cycles, 'speed': max(speed, 0.0),
            'position': max(position, 0.0), 'change': changes[first:].max(initial=0.0),
            'start': changes[:first].max(initial=0.0), 'seconds': 1e-9 * spent}


class Worker:
    """Answers commands; each method is one."""

    def __init__(self, package):
        distribution, module, self._peer = PACKAGES[package]
        import_module(module)
        try:
            self.version = f'{module} {version(distribution)}'
        except PackageNotFoundError:
            self.version = f'{package} of this checkout'
        self._loaded = {}

    def load(self, key, **given):
        """Load a robot and tasks."""
        self._loaded[key] = self._peer(given)
        return {}

    def start(self, key, goals):
        """Set goals."""
        self._loaded[key].start([np.array(goal) for goal in goals])
        return {}

    def time(self, key, states, cycles, pause):
        """Measure cycles in states far from each other."""
        return measure(self._loaded[key], np.array(states), cycles, pause)

    def positions(self, key, goals, q, steps):
        """Solve inverse kinematics; return the positions, and how long it took [s]."""
        self.start(key, goals)
        peer, start = self._loaded[key], np.array(q)
        began = time.thread_time_ns()
        found = peer.positions(start, steps)
        spent = 1e-9 * (time.thread_time_ns() - began)
        return {'q': np.asarray(found).tolist(), 'seconds': spent}

    def run(self, key, goals, q, cycles, limits):
        """Simulate."""
        self.start(key, goals)
        return simulate(self._loaded[key], np.array(q), cycles, np.array(limits))


def main():
    """Answer commands until there are no more."""
    # What libraries print must not come between the answers.
    answers = os.fdopen(os.dup(1), 'w', encoding='utf-8', buffering=1)
    os.dup2(2, 1)
    try:
        worker = Worker(sys.argv[1])
        print(json.dumps({'version': worker.version}), file=answers)
    except ImportError as error:
        print(json.dumps({'skipped': str(error)}), file=answers)
        return
    for line in sys.stdin:
        command = json.loads(line)
        print(json.dumps(getattr(worker, command.pop('do'))(**command)), file=answers)


if __name__ == '__main__':
    main()

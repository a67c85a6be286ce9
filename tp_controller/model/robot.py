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

"""The robot: names, limits and kinematics of a URDF tree, evaluated by Pinocchio."""

import math
from pathlib import Path

import numpy as np
import pinocchio
from tp_controller.errors import RobotError, unknown
from tp_controller.model.dh import urdf_from_dh
from tp_controller.model.mobile_base import BASES, DEFAULT_VELOCITY, DEFAULT_WORLD
from tp_controller.model.spatial import cross
from tp_controller.model.urdf import (
    build_model,
    check_tree,
    FREE_FLYER,
    joint_limits,
    mimic_rules,
    moving_joints,
    parse,
    resolve_mimic,
    share_limits,
)
from tp_controller.resources import read_source

# The frame that Pinocchio has before all others.
WORLD = 0
LIMIT_KEYS = ('lower', 'upper', 'velocity', 'acceleration')
# A base has no position limits.
BASE_LIMIT_KEYS = ('velocity', 'acceleration')


class Robot:
    """
    A robot whose driven joints, and base if that moves, the controller commands.

    Joints of the description that are not driven are passive: they stay where the state says.
    Mimic joints follow the joint they mimic.

    Velocities are arrays (n,) and configurations arrays (nq,). With a fixed base both have one
    entry for each driven joint. What a base adds stands before the joints:

    ============================ ========================================= ======================
    base                         velocities, in the axes of the base       coordinates in q
    ============================ ========================================= ======================
    ``planar``                   along x, y, about z                       x, y, yaw
    ``differential``             along x, about z                          x, y, yaw
    ``underwater``               along x, y, z, about z                    x, y, z, qx, qy, qz, qw
    ``floating``                 along x, y, z, about x, y, z              x, y, z, qx, qy, qz, qw
    ============================ ========================================= ======================

    Attributes
    ----------
    name : str
    urdf : str
        The description as URDF text.
    base : str
        ``fixed``, ``planar``, ``differential``, ``floating`` or ``underwater``.
    moves : bool
        Whether the base does.
    n, nq : int
        Number of velocities and of coordinates.
    velocity_names, coordinate_names : tuple of str
        What each of them is about: the base, as ``base_x``, then the driven joints.
    velocity_units : tuple of str
        ``'rad'`` or ``'m'``, what each velocity is the rate of.
    joint_names, passive_names : tuple of str
        Driven joints, in their order in every array; passive ones.
    joint_units : tuple of str
        ``'rad'`` or ``'m'`` for each driven joint.
    joint_columns, joint_rows : slice
        Where the driven joints are in an array (n,), and in an array (nq,).
    lower, upper : ndarray (n,)
        Position limits [rad or m], infinite where there are none, as for the base.
    velocity : ndarray (n,)
        Limits of the absolute velocity [rad/s or m/s].
    acceleration : ndarray (n,)
        Limits of the absolute acceleration [rad/s² or m/s²], infinite where there are none.
    continuous : ndarray (n,) of bool
        Joints that turn without end.
    passive_neutral : ndarray (p,)
        Where passive joints are taken to be until something is heard of them [rad or m].
    mass : float
        Of all links; 0 where the description gives none [kg].
    frame_names : tuple of str
        All links, and the world before them where the base moves; `root` is the first, every
        pose and Jacobian is expressed in it by default.
    base_frame : str
        The link that all others hang on.
    base_reach : tuple of int
        The rows of a twist in the root (linear, then angular) along which the pose of the base
        can be changed, if not at once.

    """

    def __init__(self, urdf, joints=None, limits=None, base='fixed', world_frame=DEFAULT_WORLD):
        """Build from URDF text; see `from_urdf`."""
        if not isinstance(base, str) or base not in BASES:
            raise RobotError(unknown('base', base, BASES))
        tree = parse(urdf)
        check_tree(tree)
        elements = moving_joints(tree)
        self.urdf = urdf
        self.base, self._base = base, BASES[base]
        self.moves = self._base.moves
        self._model = build_model(tree, self.moves)
        self.name = self._model.name
        self.mass = float(sum(inertia.mass for inertia in self._model.inertias))
        self._frame_ids = {frame.name: self._model.getFrameId(frame.name, frame.type)
                           for frame in self._model.frames
                           if frame.type == pinocchio.FrameType.BODY}
        self.base_frame = next(iter(self._frame_ids))
        self.base_reach = self._base.reach
        if self.moves:
            self._add_world(world_frame)
        self.frame_names = tuple(self._frame_ids)
        self.root = self.frame_names[0]
        mimics = mimic_rules(elements)
        self._select_joints(elements, mimics, joints)
        self._read_limits(elements, mimics, limits or {})
        self._map_configuration(mimics)

    @classmethod
    def from_urdf(cls, source, base='fixed', joints=None, limits=None,
                  world_frame=DEFAULT_WORLD):
        """
        Return the robot of a URDF.

        Parameters
        ----------
        source : str or pathlib.Path
            URDF text, a file's path, or ``package://<package>/<path>``.
        base : str
            ``fixed``, ``planar``, ``differential``, ``floating`` or ``underwater``.
        joints : sequence of str, optional
            The driven joints, in the order wanted; all that can be driven by default.
        limits : dict, optional
            ``{joint: {lower, upper, velocity, acceleration}}``; replaces single limits of the
            URDF. The velocities of a base, ``base_x`` …, are named like joints; they have no
            position limits, and 0.5 m/s or rad/s is the default of the others.
        world_frame : str
            Name of the frame that a base moves in.

        Raises
        ------
        RobotError
            The description cannot be read, a joint is of an unsupported type, a name in
            `joints` or `limits` is unknown, or `world_frame` is a link; the message lists what
            is valid.

        """
        try:
            urdf = read_source(source, lambda text: '<' in text)
        except (OSError, ValueError) as error:
            raise RobotError(f'robot description: {error}') from error
        return cls(urdf, joints, limits, base, world_frame)

    @classmethod
    def from_dh(cls, table, convention=None, joints=None, limits=None, base='fixed',
                world_frame=DEFAULT_WORLD):
        """
        Return the robot of a Denavit-Hartenberg table; see `tp_controller.model.dh.urdf_from_dh`.

        The other arguments are those of `from_urdf`.

        Raises
        ------
        RobotError
            Names the row and key that is wrong.

        """
        return cls(urdf_from_dh(table, convention), joints, limits, base, world_frame)

    @classmethod
    def from_file(cls, name, joints=None, limits=None, base='fixed', world_frame=DEFAULT_WORLD):
        """
        Return the robot of a file: a DH table if it ends in ``.yaml`` or ``.yml``, else a URDF.

        The other arguments are those of `from_urdf`.

        Raises
        ------
        RobotError
            The file is missing or its content is not usable.

        """
        if Path(str(name)).suffix in ('.yaml', '.yml'):
            return cls.from_dh(Path(name) if '://' not in str(name) else name,
                               joints=joints, limits=limits, base=base, world_frame=world_frame)
        return cls.from_urdf(name, base, joints, limits, world_frame)

    def check_frame(self, name):
        """Return `name` if it is a frame of the robot, else raise `RobotError`."""
        if not isinstance(name, str) or name not in self._frame_ids:
            raise RobotError(unknown('frame', name, self.frame_names))
        return name

    def joint_index(self, name):
        """Return the index of a driven joint in arrays (n,), else raise `RobotError`."""
        if not isinstance(name, str) or name not in self._joint_indices:
            raise RobotError(unknown('driven joint', name, self.joint_names))
        return self._joint_indices[name]

    def neutral(self):
        """Return q with every joint as near to zero as its limits allow, the base at the root."""
        return self.configuration(np.clip(np.zeros(self.n), self.lower, self.upper)[
            self.joint_columns])

    def configuration(self, joints, T_root_base=None):
        """
        Return the configuration of joint positions and a pose of the base.

        Parameters
        ----------
        joints : array_like
            Positions of the driven joints [rad or m].
        T_root_base : ndarray (4, 4), optional
            Pose of `base_frame`; that of the root by default. What the base has no coordinate
            for is left out.

        Returns
        -------
        ndarray (nq,)

        """
        T = np.eye(4) if T_root_base is None else T_root_base
        return np.array([*self._base.coordinates(T[:3, :3], T[:3, 3]), *joints])

    def positions(self, q):
        """
        Return what position limits are about, one entry for each velocity.

        Parameters
        ----------
        q : ndarray (nq,)
            Configuration.

        Returns
        -------
        ndarray (n,)
            Positions of the driven joints [rad or m]; zeros for the base, which has no limits.

        """
        if not self.moves:
            return q
        positions = np.zeros(self.n)
        positions[self.joint_columns] = q[self.joint_rows]
        return _read_only(positions)

    def base_placement(self, q):
        """Return x, y, z [m] and the quaternion ``xyzw`` (7,) of `base_frame` in the root."""
        return self._base.placement(q)

    def base_twist(self, velocity):
        """
        Return the twist of the base in its own axes.

        Parameters
        ----------
        velocity : ndarray (n,)
            [m/s or rad/s]

        Returns
        -------
        ndarray (6,)
            Linear, then angular [m/s, rad/s].

        """
        twist = np.zeros(6)
        twist[list(self._base.columns)] = velocity[:self.joint_columns.start]
        return twist

    def base_velocities(self, twist):
        """Return the entries of a twist (6,) that are velocities of the base."""
        return twist[list(self._base.columns)]

    def fixed_to_base(self, frame):
        """Return T_base_frame (4, 4) of a frame that no joint moves; None for any other one."""
        index = self._frame_ids[self.check_frame(frame)]
        found = self._model.frames[index]
        carrier = self._model.frames[self._frame_ids[self.base_frame]].parentJoint
        return found.placement.homogeneous if found.parentJoint == carrier else None

    def state(self, q, passive=None):
        """
        Return a new `RobotState` at `q`.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration: coordinates of the base, then positions of the driven joints
            [rad or m].
        passive : array_like (len(passive_names),), optional
            Positions of the passive joints; zero, or what is nearest within their limits.

        Raises
        ------
        RobotError
            Wrong shape, not finite, or no quaternion.

        """
        return RobotState(self, q, passive)

    def _select_joints(self, elements, mimics, joints):
        """Sort the moving joints into driven and passive ones."""
        names = [name for name in self._model.names if name in elements]
        drivable = [name for name in names if name not in mimics]
        driven = drivable if joints is None else list(joints)
        for name in driven:
            if name in mimics:
                raise RobotError(f'joint {name!r} mimics {mimics[name][0]!r}: drive that one')
            if name not in drivable:
                raise RobotError(unknown('joint', name, drivable))
        if len(set(driven)) < len(driven):
            raise RobotError(f'driven joints named twice: {driven}')
        if not driven and not self.moves:
            raise RobotError('the robot has no joint to drive')
        taken = {*self._base.names, *self._base.coordinate_names}.intersection(names)
        if taken:
            raise RobotError(f'joints named like one of the base: {", ".join(sorted(taken))}')
        self.joint_names = tuple(driven)
        self.passive_names = tuple(name for name in drivable if name not in driven)
        self.velocity_names = self._base.names + self.joint_names
        self.joint_units = tuple('m' if elements[name].get('type') == 'prismatic' else 'rad'
                                 for name in driven)
        self.velocity_units = self._base.units + self.joint_units
        self.coordinate_names = self._base.coordinate_names + self.joint_names
        self.n, self.nq = len(self.velocity_names), len(self.coordinate_names)
        self.joint_columns = slice(len(self._base.names), self.n)
        self.joint_rows = slice(len(self._base.coordinate_names), self.nq)
        self._joint_indices = {name: index for index, name in enumerate(
            driven, start=self.joint_columns.start)}

    def _add_world(self, name):
        """Take the frame that the base moves in among the frames, as the first."""
        if not isinstance(name, str) or not name:
            raise RobotError(f'the world frame needs a name, not {name!r}')
        if name in self._frame_ids:
            raise RobotError(f'the world frame cannot be named like a link: {name!r}')
        self._frame_ids = {name: WORLD, **self._frame_ids}

    def _read_limits(self, elements, mimics, overrides):
        """Take the limits of the velocities from the URDF, replaced where overridden."""
        for name, limits in overrides.items():
            self._check_override(name, limits)
        rows = {name: {'lower': -math.inf, 'upper': math.inf, 'velocity': DEFAULT_VELOCITY,
                       'acceleration': math.inf} for name in self._base.names}
        rows.update((name, joint_limits(name, elements[name])) for name in self.joint_names)
        for follower in mimics:
            leader, multiplier, offset = resolve_mimic(follower, mimics)
            if leader in rows:
                share_limits(rows[leader], joint_limits(follower, elements[follower]),
                              multiplier, offset)
        for name, row in rows.items():
            what = self._what(name)
            row.update(overrides.get(name, {}))
            if not row['lower'] < row['upper']:
                followers = [follower for follower in mimics
                             if resolve_mimic(follower, mimics)[0] == name]
                shared = f' (those of {", ".join(followers)} included)' if followers else ''
                raise RobotError(f'{what}: lower limit {row["lower"]:g} must be below '
                                 f'upper limit {row["upper"]:g}{shared}')
            if not row['velocity'] >= 0.0:
                raise RobotError(f'{what}: velocity limit {row["velocity"]} '
                                 'must not be negative')
            if not row['acceleration'] > 0.0:
                raise RobotError(f'{what}: acceleration limit {row["acceleration"]} '
                                 'must be positive')
        ranges = [joint_limits(name, elements[name]) for name in self.passive_names]
        self.passive_neutral = np.array([min(max(0.0, row['lower']), row['upper'])
                                          for row in ranges])
        self.lower, self.upper, self.velocity, self.acceleration = (
            _read_only(np.array([float(row[key]) for row in rows.values()]))
            for key in LIMIT_KEYS)
        # A joint that was given limits turns within them, whatever its type says.
        self.continuous = _read_only(np.array(
            [name in elements and elements[name].get('type') == 'continuous'
             for name in self.velocity_names], dtype=bool)
            & np.isinf(self.lower) & np.isinf(self.upper))

    def _check_override(self, name, limits):
        """Raise `RobotError` where limits cannot replace those of a velocity."""
        if not isinstance(name, str) or name not in self.velocity_names:
            raise RobotError(unknown('driven joint', name, self.velocity_names))
        what = self._what(name)
        if not isinstance(limits, dict):
            raise RobotError(f'{what}: limits need a mapping of '
                             f'{", ".join(LIMIT_KEYS)}, not {limits!r}')
        for key, value in limits.items():
            if key not in LIMIT_KEYS:
                raise RobotError(f'{what}: {unknown("limit", key, LIMIT_KEYS)}')
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise RobotError(f'{what}: {key} limit must be a number, not {value!r}')
            if name in self._base.names and key not in BASE_LIMIT_KEYS:
                raise RobotError(f'{what}: a base has no position limits, only velocity and '
                                 'acceleration')

    def _what(self, name):
        """Return what a message calls a velocity."""
        return name if name in self._base.names else f'joint {name}'

    def _map_configuration(self, mimics):
        """Prepare the way from q and passive positions to Pinocchio's configuration."""
        model = self._model
        names = [name for name in model.names[1:] if name != FREE_FLYER]
        # The positions of the joints are `_joint_map` q + `_passive_map` p + `_offset`.
        self._joint_map = np.zeros((len(names), len(self.joint_names)))
        self._passive_map = np.zeros((len(names), len(self.passive_names)))
        self._offset = np.zeros(len(names))
        for row, name in enumerate(names):
            leader, multiplier, self._offset[row] = resolve_mimic(name, mimics)
            if leader in self._joint_indices:
                self._joint_map[row, self.joint_names.index(leader)] = multiplier
            else:
                self._passive_map[row, self.passive_names.index(leader)] = multiplier
        self._driven_rows = [model.joints[model.getJointId(name)].idx_q
                             for name in self.joint_names]
        # J_driven = J_model `_expand`. None where the configuration is q itself.
        self._expand = np.zeros((model.nv, self.n))
        first = model.nv - len(names)
        self._expand[list(self._base.columns), range(self.joint_columns.start)] = 1.0
        self._expand[first:, self.joint_columns] = self._joint_map
        if not self.moves and np.array_equal(self._expand, np.eye(model.nv)):
            self._expand = None
        # Motion k turns the axis of motion j where it comes before it on the way from the root;
        # the motions of a base are about axes of its own, so each turns all of them.
        self._turned = np.triu(np.ones((model.nv, model.nv)))
        self._turned[:first, :first] = 1.0

    def _configuration(self, q, offset):
        """Return Pinocchio's configuration at q, with the positions that are none of it."""
        if not self.moves:
            return self._joint_map.dot(q) + offset
        return np.concatenate((self._base.placement(q),
                               self._joint_map.dot(q[self.joint_rows]) + offset))

    def integrate(self, q, velocity, dt):
        """
        Return the configuration after `dt` seconds at a constant velocity.

        A base moves along the arc that constant velocities in its own axes make.

        Parameters
        ----------
        q : ndarray (nq,)
            Configuration [rad or m].
        velocity : ndarray (n,)
            [rad/s or m/s]
        dt : float
            [s]

        Returns
        -------
        ndarray (nq,)
            Angles of continuous joints, and the yaw of a base, are not wrapped.

        """
        if self._expand is None:
            return pinocchio.integrate(self._model, q, dt * velocity)
        displacement = dt * self._expand.dot(velocity)
        moved = pinocchio.integrate(self._model, self._configuration(q, self._offset),
                                    displacement)
        joints = moved[self._driven_rows]
        if not self.moves:
            return joints
        return np.concatenate((self._base.moved(q, moved[:7], displacement[:6]), joints))


class RobotState:
    """
    The robot at one configuration, its kinematics evaluated once.

    Frames are asked for by name; what was computed for one is kept until the next `update`. All
    arrays are read-only copies, so they stay true to the configuration they were taken at.

    Attributes
    ----------
    robot : Robot
    q : ndarray (nq,)
        Configuration [rad or m].
    positions : ndarray (n,)
        What position limits are about; see `Robot.positions`.
    velocity : ndarray (n,)
        That the robot was told to have since the state before, for tasks that look ahead; at rest
        unless somebody sets it [rad/s or m/s].

    """

    def __init__(self, robot, q, passive=None):
        self.robot = robot
        self._data = robot._model.createData()
        self._offset = robot._offset
        self._placements, self._jacobians = {}, {}
        self.velocity = np.zeros(robot.n)
        if passive is None and robot.passive_names:
            passive = robot.passive_neutral
        self.update(q, passive)

    def update(self, q, passive=None):
        """
        Move to another configuration and evaluate the kinematics there.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration [rad or m].
        passive : array_like (p,), optional
            Passive positions; unchanged where left out.

        Raises
        ------
        RobotError
            Wrong shape, not finite or no quaternion; the state stays what it was.

        """
        robot = self.robot
        q = positions = _positions(q, robot.coordinate_names, 'q')
        if robot.moves:
            q = robot._base.check(q)
            positions = robot.positions(q)
        if passive is not None and robot.passive_names:
            passive = _positions(passive, robot.passive_names, 'passive')
            self._offset = robot._offset + robot._passive_map.dot(passive)
        self.q, self.positions = q, positions
        self._placements.clear()
        self._jacobians.clear()
        self._center_of_mass = None
        configuration = q if robot._expand is None else robot._configuration(q, self._offset)
        pinocchio.computeJointJacobians(robot._model, self._data, configuration)

    def rotation(self, frame):
        """Return R_root_frame (3, 3)."""
        return (self._placements.get(frame) or self._place(frame))[0]

    def position(self, frame):
        """Return the origin of a frame (3,), in the root frame [m]."""
        return (self._placements.get(frame) or self._place(frame))[1]

    def pose(self, frame):
        """Return T_root_frame (4, 4)."""
        return (self._placements.get(frame) or self._place(frame))[2]

    def jacobian(self, frame):
        """
        Return the Jacobian of a frame, in the axes of the root frame.

        Parameters
        ----------
        frame : str
            Its name.

        Returns
        -------
        ndarray (6, n)
            Rows 0 to 2 give the velocity of the frame's origin, 3 to 5 its angular velocity;
            columns are as in `Robot.velocity_names`.

        """
        J = self._jacobians.get(frame)
        if J is None:
            if frame not in self._placements:
                self._place(frame)
            robot = self.robot
            J = pinocchio.getFrameJacobian(robot._model, self._data, robot._frame_ids[frame],
                                           pinocchio.LOCAL_WORLD_ALIGNED)
            if J.ndim == 1:  # of a robot with one joint
                J = J.reshape(6, 1)
            if robot._expand is not None:
                J = J.dot(robot._expand)
            self._jacobians[frame] = _read_only(J)
        return J

    def jacobian_gradient(self, frame, weights):
        """
        Return the gradient of a weighted sum of the entries of a frame's Jacobian.

        Parameters
        ----------
        frame : str
            Its name.
        weights : ndarray (6, n)
            Of the entries of `jacobian`.

        Returns
        -------
        ndarray (n,)
            ∂/∂q_k of Σ weights ∘ J.

        """
        robot = self.robot
        self.jacobian(frame)
        J = pinocchio.getFrameJacobian(robot._model, self._data, robot._frame_ids[frame],
                                       pinocchio.LOCAL_WORLD_ALIGNED).reshape(6, -1)
        if robot._expand is not None:
            weights = weights.dot(robot._expand.T)
        v, w, of_v, of_w = J[:3].T, J[3:].T, weights[:3].T, weights[3:].T
        # Column j of J is (v_j, ω_j). Where motion k comes before motion j it turns both,
        # ∂J_j/∂q_k = (ω_k × v_j, ω_k × ω_j); otherwise it moves the frame, by ω_j × v_k.
        turns = cross(v, of_v) + cross(w, of_w)
        shifts = cross(of_v, w)
        turned = robot._turned
        gradient = (w.dot(turns.T) * turned + v.dot(shifts.T) * (1.0 - turned)).sum(axis=1)
        return gradient if robot._expand is None else robot._expand.T.dot(gradient)

    def center_of_mass(self):
        """
        Return the centre of mass of all links and its Jacobian.

        Returns
        -------
        c : ndarray (3,)
            In the root [m].
        J : ndarray (3, n)

        """
        if self._center_of_mass is None:
            robot = self.robot
            J = pinocchio.jacobianCenterOfMass(robot._model, self._data, False).reshape(3, -1)
            if robot._expand is not None:
                J = J.dot(robot._expand)
            # Pinocchio leaves out what is fixed to the root.
            still = robot._model.inertias[0]
            share = still.mass / robot.mass
            self._center_of_mass = (
                _read_only(share * still.lever + (1.0 - share) * self._data.com[0]),
                _read_only((1.0 - share) * J))
        return self._center_of_mass

    def _place(self, frame):
        """Evaluate the placement of a frame: R_root_frame, its origin, and both as a pose."""
        robot = self.robot
        index = robot._frame_ids[robot.check_frame(frame)]
        placement = pinocchio.updateFramePlacement(robot._model, self._data, index)
        # The rotation and translation of a placement are windows into Pinocchio's data, which
        # the next update changes; this matrix is a copy.
        T = _read_only(placement.homogeneous)
        self._placements[frame] = placed = T[:3, :3], T[:3, 3], T
        return placed


def _read_only(array):
    """Return the array, protected against writing."""
    array.setflags(write=False)
    return array


def _positions(values, names, what):
    """Return joint positions as a protected array, one for each name."""
    try:
        values = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise RobotError(f'{what} needs {len(names)} positions ({", ".join(names)}): '
                         f'{error}') from error
    if values.shape != (len(names),):
        raise RobotError(f'{what} needs {len(names)} positions ({", ".join(names)}), '
                         f'got an array of shape {values.shape}')
    # A square beyond the range of a float would be no position either.
    if not math.isfinite(values.dot(values)):
        bad = [name for name, value in zip(names, values) if not abs(value) < 1e150]
        raise RobotError(f'{what} is not finite for {", ".join(bad)}')
    return _read_only(values)

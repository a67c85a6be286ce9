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
from tp_controller.dh import urdf_from_dh
from tp_controller.errors import RobotError, unknown
from tp_controller.resources import read_source
from tp_controller.urdf import (
    build_model,
    check_tree,
    joint_limits,
    mimic_rules,
    moving_joints,
    parse,
    resolve_mimic,
    share_limits,
)

BASES = ('fixed',)
LIMIT_KEYS = ('lower', 'upper', 'velocity', 'acceleration')


class Robot:
    """
    A robot whose `n` driven joints the controller commands.

    Joints of the description that are not driven are passive: they stay where the state says.
    Mimic joints follow the joint they mimic.

    Attributes
    ----------
    name : str
    urdf : str
        The description as URDF text.
    n : int
        Number of driven joints.
    joint_names, passive_names : tuple of str
        Driven joints, in the order of every (n,) array; passive ones.
    joint_units : tuple of str
        ``'rad'`` or ``'m'`` for each driven joint.
    lower, upper : ndarray (n,)
        Position limits [rad or m], infinite where there are none.
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
        All links; `root` is the first, every pose and Jacobian is expressed in it by default.

    """

    def __init__(self, urdf, joints=None, limits=None):
        """Build from URDF text; see `from_urdf`."""
        tree = parse(urdf)
        check_tree(tree)
        elements = moving_joints(tree)
        self.urdf = urdf
        self._model = build_model(tree)
        self.name = self._model.name
        self.mass = float(sum(inertia.mass for inertia in self._model.inertias))
        self._frame_ids = {frame.name: self._model.getFrameId(frame.name, frame.type)
                           for frame in self._model.frames
                           if frame.type == pinocchio.FrameType.BODY}
        self.frame_names = tuple(self._frame_ids)
        self.root = self.frame_names[0]
        mimics = mimic_rules(elements)
        self._select_joints(elements, mimics, joints)
        self._read_limits(elements, mimics, limits or {})
        self._map_configuration(mimics)

    @classmethod
    def from_urdf(cls, source, base='fixed', joints=None, limits=None):
        """
        Return the robot of a URDF.

        Parameters
        ----------
        source : str or pathlib.Path
            URDF text, a file's path, or ``package://<package>/<path>``.
        base : str
            ``fixed``.
        joints : sequence of str, optional
            The driven joints, in the order wanted; all that can be driven by default.
        limits : dict, optional
            ``{joint: {lower, upper, velocity, acceleration}}``; replaces single limits of the
            URDF.

        Raises
        ------
        RobotError
            The description cannot be read, a joint is of an unsupported type, or a name in
            `joints` or `limits` is unknown; the message lists what is valid.

        """
        if base not in BASES:
            raise RobotError(unknown('base', base, BASES))
        try:
            urdf = read_source(source, lambda text: '<' in text)
        except (OSError, UnicodeDecodeError) as error:
            raise RobotError(f'robot description: {error}') from error
        return cls(urdf, joints, limits)

    @classmethod
    def from_dh(cls, table, convention=None, joints=None, limits=None):
        """
        Return the robot of a Denavit-Hartenberg table; see `tp_controller.dh.urdf_from_dh`.

        Raises
        ------
        RobotError
            Names the row and key that is wrong.

        """
        return cls(urdf_from_dh(table, convention), joints, limits)

    @classmethod
    def from_file(cls, name, joints=None, limits=None):
        """
        Return the robot of a file: a DH table if it ends in ``.yaml`` or ``.yml``, else a URDF.

        Raises
        ------
        RobotError
            The file is missing or its content is not usable.

        """
        if Path(str(name)).suffix in ('.yaml', '.yml'):
            return cls.from_dh(Path(name) if '://' not in str(name) else name,
                               joints=joints, limits=limits)
        return cls.from_urdf(name, joints=joints, limits=limits)

    def check_frame(self, name):
        """Return `name` if it is a frame of the robot, else raise `RobotError`."""
        if not isinstance(name, str) or name not in self._frame_ids:
            raise RobotError(unknown('frame', name, self.frame_names))
        return name

    def joint_index(self, name):
        """Return the index of a driven joint, else raise `RobotError`."""
        if not isinstance(name, str) or name not in self._joint_indices:
            raise RobotError(unknown('driven joint', name, self.joint_names))
        return self._joint_indices[name]

    def neutral(self):
        """Return the driven positions (n,) nearest to zero that the limits allow [rad or m]."""
        return np.clip(np.zeros(self.n), self.lower, self.upper)

    def state(self, q, passive=None):
        """
        Return a new `RobotState` at `q`.

        Parameters
        ----------
        q : array_like (n,)
            Positions of the driven joints [rad or m].
        passive : array_like (len(passive_names),), optional
            Positions of the passive joints; zero, or what is nearest within their limits.

        Raises
        ------
        RobotError
            Wrong shape or not finite.

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
        if not driven:
            raise RobotError('the robot has no joint to drive')
        self.joint_names = tuple(driven)
        self.passive_names = tuple(name for name in drivable if name not in driven)
        self._joint_indices = {name: index for index, name in enumerate(driven)}
        self.n = len(driven)
        self.joint_units = tuple('m' if elements[name].get('type') == 'prismatic' else 'rad'
                                 for name in driven)

    def _read_limits(self, elements, mimics, overrides):
        """Take the limits of the driven joints from the URDF, replaced where overridden."""
        for name, limits in overrides.items():
            self.joint_index(name)
            if not isinstance(limits, dict):
                raise RobotError(f'joint {name}: limits need a mapping of '
                                 f'{", ".join(LIMIT_KEYS)}, not {limits!r}')
            for key, value in limits.items():
                if key not in LIMIT_KEYS:
                    raise RobotError(f'joint {name}: {unknown("limit", key, LIMIT_KEYS)}')
                if isinstance(value, bool) or not isinstance(value, (int, float)):
                    raise RobotError(f'joint {name}: {key} limit must be a number, '
                                     f'not {value!r}')
        rows = {name: joint_limits(name, elements[name]) for name in self.joint_names}
        for follower in mimics:
            leader, multiplier, offset = resolve_mimic(follower, mimics)
            if leader in rows:
                share_limits(rows[leader], joint_limits(follower, elements[follower]),
                              multiplier, offset)
        for name, row in rows.items():
            row.update(overrides.get(name, {}))
            if not row['lower'] < row['upper']:
                followers = [follower for follower in mimics
                             if resolve_mimic(follower, mimics)[0] == name]
                shared = f' (those of {", ".join(followers)} included)' if followers else ''
                raise RobotError(f'joint {name}: lower limit {row["lower"]:g} must be below '
                                 f'upper limit {row["upper"]:g}{shared}')
            if not row['velocity'] >= 0.0:
                raise RobotError(f'joint {name}: velocity limit {row["velocity"]} '
                                 'must not be negative')
            if not row['acceleration'] > 0.0:
                raise RobotError(f'joint {name}: acceleration limit {row["acceleration"]} '
                                 'must be positive')
        ranges = [joint_limits(name, elements[name]) for name in self.passive_names]
        self.passive_neutral = np.array([min(max(0.0, row['lower']), row['upper'])
                                          for row in ranges])
        self.lower, self.upper, self.velocity, self.acceleration = (
            _read_only(np.array([float(row[key]) for row in rows.values()]))
            for key in LIMIT_KEYS)
        # A joint that was given limits turns within them, whatever its type says.
        self.continuous = _read_only(np.array(
            [elements[name].get('type') == 'continuous' for name in self.joint_names])
            & np.isinf(self.lower) & np.isinf(self.upper))

    def _map_configuration(self, mimics):
        """Prepare the way from driven and passive positions to Pinocchio's configuration."""
        model = self._model
        # The configuration is `_expand` q + `_passive_map` p + `_offset`, and with it
        # J_driven = J_model `_expand`. None where the configuration is q itself.
        expand = np.zeros((model.nv, self.n))
        self._passive_map = np.zeros((model.nv, len(self.passive_names)))
        self._offset = np.zeros(model.nv)
        for row, name in enumerate(model.names[1:]):
            leader, multiplier, self._offset[row] = resolve_mimic(name, mimics)
            if leader in self._joint_indices:
                expand[row, self._joint_indices[leader]] = multiplier
            else:
                self._passive_map[row, self.passive_names.index(leader)] = multiplier
        self._driven_rows = [model.joints[model.getJointId(name)].idx_v
                             for name in self.joint_names]
        # Motion k turns the axis of motion j where it comes before it on the way from the root.
        self._turned = np.triu(np.ones((model.nv, model.nv)))
        same = expand.shape == (self.n, self.n) and np.array_equal(expand, np.eye(self.n))
        self._expand = None if same else expand

    def integrate(self, q, velocity, dt):
        """
        Return the driven positions after `dt` seconds at a constant velocity.

        Parameters
        ----------
        q, velocity : ndarray (n,)
            [rad or m], [rad/s or m/s]
        dt : float
            [s]

        Returns
        -------
        ndarray (n,)
            Angles of continuous joints are not wrapped.

        """
        if self._expand is None:
            return pinocchio.integrate(self._model, q, dt * velocity)
        moved = pinocchio.integrate(self._model, self._expand.dot(q),
                                    dt * self._expand.dot(velocity))
        return moved[self._driven_rows]


class RobotState:
    """
    The robot at one configuration, its kinematics evaluated once.

    Frames are asked for by name; what was computed for one is kept until the next `update`. All
    arrays are read-only copies, so they stay true to the configuration they were taken at.

    Attributes
    ----------
    q : ndarray (n,)
        Driven positions [rad or m].
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
        q : array_like (n,)
            Driven positions [rad or m].
        passive : array_like (p,), optional
            Passive positions; unchanged where left out.

        Raises
        ------
        RobotError
            Wrong shape or not finite; the state stays what it was.

        """
        robot = self.robot
        q = _positions(q, robot.joint_names, 'q')
        if passive is not None and robot.passive_names:
            passive = _positions(passive, robot.passive_names, 'passive')
            self._offset = robot._offset + robot._passive_map.dot(passive)
        self.q = q
        self._placements.clear()
        self._jacobians.clear()
        self._center_of_mass = None
        configuration = q if robot._expand is None else robot._expand.dot(q) + self._offset
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
            Rows 0 to 2 give the velocity of the frame's origin, 3 to 5 its angular velocity.

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
        v, w = J[:3], J[3:]
        # Column j of J is (v_j, ω_j). Where motion k comes before motion j it turns both,
        # ∂J_j/∂q_k = (ω_k × v_j, ω_k × ω_j); otherwise it moves the frame, by ω_j × v_k.
        turns = np.cross(v, weights[:3], axis=0) + np.cross(w, weights[3:], axis=0)
        shifts = np.cross(weights[:3], w, axis=0)
        turned = robot._turned
        gradient = (w.T.dot(turns) * turned + v.T.dot(shifts) * (1.0 - turned)).sum(axis=1)
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

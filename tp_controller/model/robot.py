# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot model: names, limits and kinematics of a URDF tree, evaluated by Pinocchio."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike
import pinocchio
from tp_controller.errors import RobotError, unknown
from tp_controller.model.dh import Table, urdf_from_dh
from tp_controller.model.joint_choice import choose_joints, JointChoice
from tp_controller.model.joint_groups import Groups, joint_groups
from tp_controller.model.kinematics import Kinematics
from tp_controller.model.limits import (
    as_overrides,
    in_degrees,
    limit_arrays,
    LIMIT_KEYS,
    LimitOverrides,
    nearest_to_zero,
)
from tp_controller.model.mobile_base import BASES, DEFAULT_WORLD
from tp_controller.model.sources import describe, Source
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.model.urdf import build_model, check_tree, mimic_rules, moving_joints, parse
from tp_controller.model.xacro_files import xacro_values, XacroArguments

# Index of Pinocchio's universe frame, before all others.
UNIVERSE_INDEX = 0
# Suffixes of DH tables.
DH_SUFFIXES = ('.yaml', '.yml')


class Robot:
    """
    Model of a robot: the controller commands its driven joints, and its base if that moves.

    Joints of the description that are not driven are passive: their positions are part of the
    state. Mimic joints follow the joint they mimic.

    Velocities are arrays (n,) and configurations arrays (nq,). With a fixed base both have one
    entry for each driven joint. The entries of a moving base precede the joints:

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
    name, base_frame, urdf : str
        Name and root link of the description, and the description as URDF text.
    base : str
        ``fixed``, ``planar``, ``differential``, ``floating`` or ``underwater``.
    moves : bool
        Whether the base moves.
    n, nq : int
        Number of velocities and of coordinates.
    velocity_names, coordinate_names : tuple of str
        Names of their entries: the base, as ``base_x``, then the driven joints.
    velocity_units, joint_units : tuple of str
        ``'rad'`` or ``'m'``: the unit of the integral of each velocity; of each driven joint.
    joint_names, passive_names : tuple of str
        Driven joints, in their order in every array; passive ones.
    groups : dict of tuple of str
        Names of the velocities of a moving base, as ``base``, and those of other groups.
    joint_columns, joint_rows : slice
        Entries of the driven joints in an array (n,), and in an array (nq,).
    lower, upper : ndarray (n,)
        Position limits [rad or m], infinite if there are none, as for the base.
    velocity : ndarray (n,)
        Limits of the absolute velocity [rad/s or m/s].
    acceleration, jerk : ndarray (n,)
        Limits of the absolute values [rad/s² or m/s², rad/s³ or m/s³], infinite if there are none.
    continuous : ndarray (n,) of bool
        Joints that turn without limits.
    passive_neutral : ndarray (p,)
        Positions of passive joints that are assumed until others are received [rad or m].
    remarks : tuple of str
        Probable mistakes in the description.
    mass : float
        Total mass of the links; 0 if the description gives none [kg].
    frame_names : tuple of str
        All links, and the world before them if the base moves; `root` is the first, every pose
        and Jacobian is expressed in it by default.
    kinematics : Kinematics
        Model of the robot in Pinocchio.
    base_reach : tuple of int
        Rows of a twist in the root (linear, then angular) along which the pose of the base can
        be changed, if not at once.

    """

    # Each of `LIMIT_KEYS` is an attribute.
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    def __init__(self, urdf: str, joints: Sequence[str] | None = None,
                 limits: LimitOverrides | None = None, base: str = 'fixed',
                 world_frame: str = DEFAULT_WORLD, groups: Groups | None = None) -> None:
        """Build from URDF text; see `from_urdf`."""
        if not isinstance(base, str) or base not in BASES:
            raise RobotError(unknown('base', base, BASES))
        tree = parse(urdf)
        check_tree(tree)
        elements = moving_joints(tree)
        self.urdf, self.base, self._base = urdf, base, BASES[base]
        self.moves, self.base_reach = self._base.moves, self._base.reach
        model = build_model(tree, self.moves)
        self.name: str = model.name
        frame_ids = {frame.name: model.getFrameId(frame.name, frame.type)
                     for frame in model.frames if frame.type == pinocchio.FrameType.BODY}
        self.base_frame = next(iter(frame_ids))
        if self.moves:
            frame_ids = _with_world(frame_ids, world_frame)
        self.frame_names, self.root = tuple(frame_ids), next(iter(frame_ids))
        mimics, limits = mimic_rules(elements), as_overrides(limits)
        self._name_joints(choose_joints(model.names, elements, mimics, self._base, joints,
                                        limits), elements)
        self.groups = joint_groups(groups or {}, self.velocity_names, self._base.names)
        limited = limit_arrays(self._base, self.joint_names, elements, mimics, limits)
        for key, values in limited.values.items():
            setattr(self, key, values)
        self.continuous, self.remarks = limited.continuous, _degree_remarks(self)
        self.passive_neutral = nearest_to_zero(self.passive_names, elements)
        _set_ranges(model, self)
        self.kinematics = Kinematics(model, frame_ids, self._base, self.joint_names,
                                     self.passive_names, mimics)
        self.mass = self.kinematics.mass

    @classmethod
    def from_urdf(cls, source: Source, base: str = 'fixed', joints: Sequence[str] | None = None,
                  limits: LimitOverrides | None = None, world_frame: str = DEFAULT_WORLD,
                  xacro_arguments: XacroArguments | None = None,
                  groups: Groups | None = None) -> 'Robot':
        """
        Return the robot of a URDF, or of what can be turned into one.

        Parameters
        ----------
        source : str, pathlib.Path or pinocchio.Model
            Text in URDF or MJCF; a file in URDF, xacro or MJCF, by its path or as
            ``package://<package>/<path>``; ``robot_descriptions:<name>``; or a model.
        base : str
            ``fixed``, ``planar``, ``differential``, ``floating`` or ``underwater``.
        joints : sequence of str, optional
            Driven joints, in the desired order; all that can be driven by default. Joints with
            equal lower and upper limits cannot, unless `limits` are given for them.
        limits : dict, optional
            ``{joint: {lower, upper, velocity, acceleration, jerk}}``; replaces single limits of
            the URDF. The velocities of a base, ``base_x`` …, are named like joints; they have no
            position limits, and 0.5 m/s or rad/s is the default of the others.
        world_frame : str
            Name of the frame that a base moves in.
        xacro_arguments : dict or list of str, optional
            ``{name: value}`` or ``['name:=value', …]``.
        groups : dict or str, optional
            ``{name: names}`` of joints or groups before it, for tasks; or that as YAML.

        Raises
        ------
        RobotError
            The description cannot be read, a joint is of an unsupported type, a name in
            `joints`, `limits` or `groups` is unknown, or `world_frame` is a link; the message
            lists the valid values.

        """
        found = describe(source, xacro_arguments)
        robot = cls(found.urdf, joints, limits, base, world_frame, groups)
        robot.remarks += found.remarks_on(robot.moves)
        return robot

    @classmethod
    def from_dh(cls, table: Table, convention: str | None = None,
                joints: Sequence[str] | None = None, limits: LimitOverrides | None = None,
                base: str = 'fixed', world_frame: str = DEFAULT_WORLD,
                groups: Groups | None = None) -> 'Robot':
        """
        Return the robot of a Denavit-Hartenberg table; see `tp_controller.model.dh.urdf_from_dh`.

        The other arguments are those of `from_urdf`.

        Raises
        ------
        RobotError
            The table is not valid; the message names the row and the key.

        """
        return cls(urdf_from_dh(table, convention), joints, limits, base, world_frame, groups)

    @classmethod
    def from_file(cls, name: Source, joints: Sequence[str] | None = None,
                  limits: LimitOverrides | None = None, base: str = 'fixed',
                  world_frame: str = DEFAULT_WORLD,
                  xacro_arguments: XacroArguments | None = None,
                  groups: Groups | None = None) -> 'Robot':
        """
        Return the robot of a file: a DH table if it ends in ``.yaml`` or ``.yml``.

        All other files, and the other arguments, are those of `from_urdf`.

        Raises
        ------
        RobotError
            The file is missing or its content is not usable.

        """
        if not isinstance(name, (str, Path)) or Path(name).suffix not in DH_SUFFIXES:
            return cls.from_urdf(name, base, joints, limits, world_frame, xacro_arguments, groups)
        if xacro_values(xacro_arguments):
            raise RobotError(f'xacro arguments are for the file of a xacro, not for {name}')
        return cls.from_dh(Path(name) if '://' not in str(name) else name, None, joints, limits,
                           base, world_frame, groups)

    def check_frame(self, name: object) -> str:
        """Return `name` if it is a frame of the robot, else raise `RobotError`."""
        return self.kinematics.check_frame(name)

    def reach(self, frame: str, reference: str | None = None) -> float:
        """
        Return an upper bound of the distance of two frames, of which the root is the default [m].

        It is the length of all links between them, laid in a line; infinite if the base moves
        one relative to the other.
        """
        return self.kinematics.reach(self.check_frame(frame),
                                     self.check_frame(self.root if reference is None
                                                      else reference))

    def joint_index(self, name: object) -> int:
        """Return the index of a driven joint in arrays (n,), else raise `RobotError`."""
        if not isinstance(name, str) or name not in self._joint_indices:
            raise RobotError(unknown('driven joint', name, self.joint_names))
        return self._joint_indices[name]

    def neutral(self) -> Array:
        """Return q with every joint as near to zero as its limits allow, the base at the root."""
        return self.configuration(np.clip(np.zeros(self.n), self.lower, self.upper)[
            self.joint_columns])

    def configuration(self, joints: ArrayLike, T_root_base: Array | None = None) -> Array:
        """
        Return q (nq,) with positions of the driven joints [rad or m].

        ``T_root_base`` (4, 4) is the pose of `base_frame`, by default that of the root. Components
        without a coordinate of the base are ignored.
        """
        T = np.eye(4) if T_root_base is None else T_root_base
        return np.array([*self._base.coordinates(T[:3, :3], T[:3, 3]), *np.asarray(joints)])

    def positions(self, q: Array) -> Array:
        """
        Return the positions that are subject to limits (n,), for a configuration (nq,).

        Those of the driven joints [rad or m], and zeros for the base, which has no limits.
        """
        return self.kinematics.positions(q)

    def base_placement(self, q: Array) -> Array:
        """Return x, y, z [m] and the quaternion ``xyzw`` (7,) of `base_frame` in the root."""
        return self._base.placement(q)

    def base_twist(self, velocity: Array) -> Array:
        """Return the twist (6,) of the base in its own axes at a velocity (n,) [m/s, rad/s]."""
        twist = np.zeros(6)
        twist[list(self._base.columns)] = velocity[:self.joint_columns.start]
        return twist

    def base_velocities(self, twist: Array) -> Array:
        """Return the entries of a twist (6,) that are velocities of the base."""
        return twist[list(self._base.columns)]

    def fixed_to_base(self, frame: str) -> Array | None:
        """Return T_base_frame (4, 4) of a frame that no joint moves; None for other frames."""
        frames, ids = self.kinematics.model.frames, self.kinematics.frame_ids
        found, carrier = frames[ids[self.check_frame(frame)]], frames[ids[self.base_frame]]
        return found.placement.homogeneous if found.parentJoint == carrier.parentJoint else None

    def integrate(self, q: Array, velocity: Array, dt: float) -> Array:
        """
        Return the configuration (nq,) after `dt` seconds at a velocity (n,) [rad/s or m/s].

        A base moves along the arc of a constant twist in its own axes. Angles of continuous
        joints, and the yaw of a base, are not wrapped.
        """
        return self.kinematics.integrate(*_vectors(self, q, velocity), dt)

    def state(self, q: ArrayLike, passive: ArrayLike | None = None) -> RobotState:
        """
        Return a new `RobotState` at `q`.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration: coordinates of the base, then positions of the driven joints
            [rad or m].
        passive : array_like (len(passive_names),), optional
            Positions of the passive joints; zero by default, clamped to their limits.

        Raises
        ------
        RobotError
            Wrong shape, not finite, or no quaternion.

        """
        return RobotState(self.kinematics, q,
                          self.passive_neutral if passive is None else passive)

    def _name_joints(self, chosen: JointChoice, elements: Mapping[str, Element]) -> None:
        """Name velocities and coordinates after the base and the driven joints."""
        self.joint_names, self.passive_names = chosen.driven, chosen.passive
        self.velocity_names = self._base.names + self.joint_names
        self.joint_units = tuple('m' if elements[name].get('type') == 'prismatic' else 'rad'
                                 for name in self.joint_names)
        self.velocity_units = self._base.units + self.joint_units
        self.coordinate_names = self._base.coordinate_names + self.joint_names
        self.n, self.nq = len(self.velocity_names), len(self.coordinate_names)
        self.joint_columns = slice(len(self._base.names), self.n)
        self.joint_rows = slice(len(self._base.coordinate_names), self.nq)
        self._joint_indices = {name: index for index, name in enumerate(
            self.joint_names, start=self.joint_columns.start)}

    @property
    def limits(self) -> dict[str, Array]:
        """Return the arrays (n,) of all limits by their keys."""
        return {key: getattr(self, key) for key in LIMIT_KEYS}


def _degree_remarks(robot: Robot) -> tuple[str, ...]:
    """Return a remark on the position limits that look like degrees, if there are any."""
    degrees = in_degrees(robot.velocity_names, robot.velocity_units, robot.lower, robot.upper)
    return (f'position limits beyond two turns, which look like degrees: {", ".join(degrees)}; '
            'limits are in rad',) if degrees else ()


def _set_ranges(model: pinocchio.Model, robot: Robot) -> None:
    """Set the position limits of a model to those of a robot: the reach of a frame needs them."""
    for name, lower, upper in zip(robot.joint_names, robot.lower[robot.joint_columns],
                                  robot.upper[robot.joint_columns]):
        row = model.joints[model.getJointId(name)].idx_q
        model.lowerPositionLimit[row], model.upperPositionLimit[row] = lower, upper


def _with_world(frame_ids: dict[str, int], name: object) -> dict[str, int]:
    """Return the frames, preceded by the world frame that a base moves in."""
    if not isinstance(name, str) or not name:
        raise RobotError(f'the world frame needs a name, not {name!r}')
    if name in frame_ids:
        raise RobotError(f'the world frame cannot be named like a link: {name!r}')
    return {name: UNIVERSE_INDEX, **frame_ids}


def _vectors(robot: Robot, q: ArrayLike, velocity: ArrayLike) -> tuple[Array, Array]:
    """Return a configuration and a velocity as arrays; raise `RobotError` for other shapes."""
    q, velocity = np.asarray(q, dtype=float), np.asarray(velocity, dtype=float)
    if q.shape != (robot.nq,) or velocity.shape != (robot.n,):
        raise RobotError(f'needs q ({robot.nq},) and velocity ({robot.n},), '
                         f'got arrays of shapes {q.shape} and {velocity.shape}')
    return q, velocity


def check_robot(robot: object) -> Robot:
    """Return `robot`, or raise `RobotError` if it is not a `Robot`."""
    if isinstance(robot, Robot):
        return robot
    raise RobotError('needs a Robot first, such as Robot.from_file(file), got '
                     f'{type(robot).__name__}')

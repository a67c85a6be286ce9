# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Regions that frames stay inside or outside of (lecture 3.1)."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import GoalError
from tp_controller.model.shapes import KINDS, parse_shape, Shape, Sphere
from tp_controller.model.spatial import Array, pose, read_only, skew
from tp_controller.model.state import RobotState
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.frame import (
    frame_and_reference,
    frame_key,
    MovingGoalTask,
    reference_key,
    RelativeTask,
)
from tp_controller.tasks.keys import finite_vector, has_shape, Keys, non_negative, positive
from tp_controller.tasks.pose import parse_pose, PoseTask
from tp_controller.tasks.sketch import arrow, Body, Sketch
from tp_controller.tasks.twin import make_twin, REGION, Twin
from tp_controller.tasks.yaml_keys import DEFAULT_TIMEOUT, yaml_key

PLACE = 'a place (x, y, z, or x, y, z, qx, qy, qz, qw)'


class PlacedTask(RelativeTask, MovingGoalTask, BoundedTask):
    """
    Base class of tasks about a frame, and something that has a place in a reference frame.

    The goal is the place, a pose (4, 4) in internal form; a twist is its velocity. A subclass
    implements `measure`.
    """

    frame: str = frame_key('frame of the robot whose origin the task is about')
    at: ArrayLike | None = yaml_key(
        'place of the shape at the start: x, y, z, or x, y, z, qx, qy, qz, qw, in the reference '
        'frame (default: at its origin)', default=None, unit='m')
    reference: str = reference_key(
        'frame that the shape belongs to and moves with (default: the root)')
    timeout: float = yaml_key('time that a velocity of the shape stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)

    def check_keys(self, keys: Keys) -> None:
        """Set the place as the goal."""
        super().check_keys(keys)
        if self.at is not None:
            self.goal = keys.check('at', parse_place, self.at)

    @abstractmethod
    def measure(self, point: Array) -> tuple[Array, Array]:
        """Return values (m,) of a point (3,) in the axes of the place, and gradients (m, 3)."""

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the bounded values (m,) [m], and their Jacobian (m, n)."""
        values, normals, _ = self._values_and_normals(state)
        return values, normals.dot(self._motion.jacobian(state)[:3])

    def own_motion(self, state: RobotState, now: float) -> float | Array:
        """Return the velocity of the values due to the motion of the place, (m,) or 0 [m/s]."""
        twist = self.feed_forward(now)
        if twist is None:
            return 0.0
        _, normals, offset = self._values_and_normals(state)
        return -normals.dot(twist[:3] + skew(twist[3:]).dot(offset))

    def way_back(self, state: RobotState) -> list[Sketch]:
        """Return an arrow from the frame to the bounds; nothing inside them."""
        values, normals, _ = self._values_and_normals(state)
        back = state.rotation(self.reference).dot(self._distance_back(values).dot(normals))
        place = state.position(self.frame)
        return arrow('error', place, place + back)

    def twin_of(self, shape: Shape, inside: bool) -> Twin | None:
        """Return the twin of a type whose values are those of a shape at the place."""
        if not isinstance(self.goal, np.ndarray) or type(shape) not in KINDS:
            return None
        region = (*frame_and_reference(self.robot, self.frame, self.reference), inside,
                  KINDS.index(type(shape)), shape.sizes, read_only(self.goal))
        return make_twin(REGION, self._law(), (region, self._limits()), self.mode)

    def _values_and_normals(self, state: RobotState) -> tuple[Array, Array, Array]:
        """Return values (m,), normals (m, 3) and offset from the place in the reference (3,)."""
        R = self.goal[:3, :3]
        offset = self._motion.position(state) - self.goal[:3, 3]
        values, gradients = self.measure(R.T.dot(offset))
        return values, gradients.dot(R.T), offset

    def start(self, state: RobotState) -> None:
        """Set the origin of the reference frame as the place, unless there is one."""
        super().start(state)
        if self.goal is None:
            self.goal = np.eye(4)


class RegionTask(PoseTask, PlacedTask):
    """
    Base class of tasks about a sphere around a frame, and a shape in a reference frame.

    The goal is the pose of the shape in the reference frame: a 4×4 homogeneous matrix, or
    ``x, y, z`` [m] and a quaternion ``xyzw`` (7,). A twist is its velocity.
    """

    sketch_parts = {'frame': True, 'goal': True, 'region': True, 'sphere': False, 'error': False}
    # The frame stays inside the shape.
    inside: ClassVar[bool]

    shape: Any = yaml_key(
        '{box: [x, y, z]}, {sphere: radius}, {cylinder: [radius, length]} along z, or '
        'half_space, the space below its plane z = 0', parse_shape, unit='m')
    radius: float = yaml_key('radius of a sphere around the frame, all of which counts',
                             non_negative, 0.0, unit='m')

    def check_keys(self, keys: Keys) -> None:
        """Set bounds and units."""
        super().check_keys(keys)
        if self.shape is not None and self.radius is not None:
            self.lower, self.upper = keys.check('radius', self.bounds) or np.zeros((2, 1))
            self.units = ('m',) * len(self.lower)

    @abstractmethod
    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper limits (m,) of the values, or raise ValueError."""

    def twin_of_shape(self) -> Twin | None:
        """Return the twin of a type whose values are those of the shape."""
        return self.twin_of(self.shape, self.inside)

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the region, the frame with its sphere, and an arrow back to the bounds."""
        drawn, T_root_region = self._frame_and_goal(state)
        if self.radius:
            drawn.append(Body('sphere', pose(np.eye(3), state.position(self.frame)),
                              Sphere(self.radius), True))
        if T_root_region is None:
            return drawn
        return [*drawn, Body('region', T_root_region, self.shape, self.inside),
                *self.way_back(state)]


class KeepIn(RegionTask):
    """
    Keep a frame, or a sphere around it, inside a box, sphere, cylinder or half-space.

    A box has one row for each pair of faces, a cylinder the distance from its axis and the one
    along it, a sphere the distance from its centre, and a half-space the one from its plane.
    """

    type_name = 'keep_in'
    make_twin = RegionTask.twin_of_shape
    inside = True
    example = {'frame': 'panda_hand_tcp', 'shape': {'box': [0.6, 0.8, 0.5]},
               'at': [0.3, 0.0, 0.4], 'radius': 0.05}

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper limits (m,) of the values, or raise ValueError."""
        if self.radius >= self.shape.inner_radius:
            raise ValueError(f'must fit into the shape, so be less than '
                             f'{self.shape.inner_radius:g}, got {self.radius:g}')
        lower, upper = self.shape.inner_bounds()
        return lower + self.radius, upper - self.radius

    def measure(self, point: Array) -> tuple[Array, Array]:
        """Return values (m,) of a point (3,) in the axes of the shape, and gradients (m, 3)."""
        return self.shape.within(point)


class KeepOut(RegionTask):
    """
    Keep a frame, or a sphere around it, outside a box, sphere, cylinder or half-space.

    The only row is the distance from the surface, negative inside.
    """

    type_name = 'keep_out'
    make_twin = RegionTask.twin_of_shape
    inside = False
    example = {'frame': 'panda_hand_tcp', 'shape': {'sphere': 0.5}, 'at': [0.3, 0.0, 0.4],
               'radius': 0.05}

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and upper limits (1,) of the distance [m]."""
        return np.array([self.radius]), np.array([np.inf])

    def measure(self, point: Array) -> tuple[Array, Array]:
        """Return the distance (1,) of a point (3,) from the shape, and its gradient (1, 3)."""
        distance, gradient = self.shape.distance(point)
        return np.array([distance]), gradient[np.newaxis]


def parse_place(place: ArrayLike) -> Array:
    """Return the pose (4, 4) of a pose or of x, y, z alone, or raise `GoalError`."""
    if has_shape(place, (3,)):
        return pose(np.eye(3), finite_vector(place, 3, PLACE))
    if has_shape(place, (4, 4)) or has_shape(place, (7,)):
        return parse_pose(place, 'a place')
    raise GoalError(f'{PLACE} needs 3 or 7 numbers, got {place!r}')

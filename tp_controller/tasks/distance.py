# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Distance between two frames, or between a frame and a point (lecture 3.1, inequality tasks)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.shapes import Sphere
from tp_controller.model.spatial import Array, pose
from tp_controller.model.state import RobotState
from tp_controller.tasks.frame import reference_key
from tp_controller.tasks.keys import finite_vector, Keys, optional, positive
from tp_controller.tasks.region import PlacedTask
from tp_controller.tasks.sketch import Body, Path, Sketch
from tp_controller.tasks.twin import Twin
from tp_controller.tasks.yaml_keys import DEFAULT_TIMEOUT, yaml_key

# Only the distance from its centre counts, not its radius.
AROUND = Sphere(1.0)


class Distance(PlacedTask):
    """
    Keep the distance of a frame from a point or another frame between bounds.

    The only row is the distance of the origin from the point, with the direction between both as
    its gradient; where they coincide it is x of the reference.

    The goal is the point (3,) [m] in the reference frame; a twist is its velocity.
    """

    type_name = 'distance'
    goal_type = 'point'
    twist_rows = slice(0, 3)
    units = ('m',)
    example = {'frame': 'panda_hand_tcp', 'reference': 'panda_link1', 'minimum': 0.4,
               'maximum': 0.7}
    sketch_parts = {'frame': True, 'goal': True, 'reference': False, 'line': True, 'region': True,
                    'error': False}

    minimum: float | None = yaml_key('least distance (at least one of minimum and maximum)',
                                     optional(positive), None, unit='m')
    maximum: float | None = yaml_key('largest distance', optional(positive), None, unit='m')
    at: Array | None = yaml_key(
        'point at the start, x, y, z, in the reference frame (default: its origin)',
        optional(lambda at: parse_point(at, 'the point')), None, unit='m')
    reference: str = reference_key(
        'frame that the point belongs to and moves with (default: the root)')
    timeout: float = yaml_key('time that a velocity of the point stays in force', positive,
                              DEFAULT_TIMEOUT, unit='s', acts=False)

    def check_keys(self, keys: Keys) -> None:
        """Set the bounds."""
        super().check_keys(keys)
        least, most = self.minimum, self.maximum
        self.lower = -np.inf if least is None else least
        self.upper = np.inf if most is None else most
        if {'minimum', 'maximum'} & {key for key, _ in keys.faults}:
            return
        if least is None and most is None:
            keys.faults.append(('minimum', 'needs a bound: give minimum, maximum or both'))
        elif self.lower >= self.upper:
            keys.faults.append(('minimum', f'must be less than maximum = {most:g}, got {least:g}'))

    def measure(self, point: Array) -> tuple[Array, Array]:
        """Return the distance (1,) of a point (3,) from the place [m], and its gradient (1, 3)."""
        return AROUND.within(point)

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        return self.twin_of(AROUND, inside=True)

    def parse_goal(self, goal: ArrayLike) -> Array:
        """Return the pose (4, 4) of a point (3,) [m], or raise `GoalError`."""
        return parse_point(goal, f'the goal of task {self.name!r}')

    def goal_in_reference(self, goal: Array, T_reference_frame: Array) -> Array:
        """Transform a point from another frame to the reference frame."""
        return T_reference_frame.dot(goal)

    def goal_pose(self, state: RobotState) -> Array:
        """Return the pose of the point (4, 4)."""
        return self.goal

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return frame and point, a line between them, the bounds, and an arrow back to them."""
        drawn, T_root_goal = self._frame_and_goal(state)
        if T_root_goal is None:
            return drawn
        bounds = [Body(f'region/{name}', T_root_goal, Sphere(radius), name == 'maximum')
                  for name, radius in (('minimum', self.minimum), ('maximum', self.maximum))
                  if radius is not None]
        line = Path('line', np.array([T_root_goal[:3, 3], state.position(self.frame)]))
        return [*drawn, line, *bounds, *self.way_back(state)]


def parse_point(point: ArrayLike, what: str) -> Array:
    """Return the pose (4, 4) of a point (3,), or raise `GoalError`."""
    return pose(np.eye(3), finite_vector(point, 3, f'{what} (a point x, y, z)'))

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks about the relative pose of two parts of the robot: two arms that carry an object."""

from tp_controller.tasks.frame import frame_key
from tp_controller.tasks.pose import Pose
from tp_controller.tasks.position import Position


def moving_reference_key() -> str:
    """Declare the required key `reference`; see `yaml_key`."""
    reference: str = frame_key('frame of the robot that goals, errors and axes are expressed in; '
                               'it may move with the joints as well')
    return reference


class RelativePosition(Position):
    """
    Keep the origin of a frame at a point of another frame (slides (1)).

    The goal is a point (3,) in the reference frame [m]. Both frames move.
    """

    type_name = 'relative_position'
    example = {'frame': 'panda_hand_tcp', 'reference': 'panda_link4'}
    sketch_parts = {**Position.sketch_parts, 'reference': True}

    reference = moving_reference_key()


class RelativePose(Pose):
    """
    Keep a frame at a pose in another frame, as two hands on one object.

    The goal is a 4×4 homogeneous matrix, or ``x, y, z`` [m] and a quaternion ``xyzw`` (7,), in
    the reference frame. Both frames move.
    """

    type_name = 'relative_pose'
    example = {'frame': 'panda_hand_tcp', 'reference': 'panda_link4'}
    sketch_parts = {**Pose.sketch_parts, 'reference': True}

    reference = moving_reference_key()

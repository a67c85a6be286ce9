# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks about the pose of the base, for vehicles with an arm (lecture 3.1)."""

from tp_controller.tasks.frame import FrameTask, parse_axes
from tp_controller.tasks.orientation import Orientation
from tp_controller.tasks.pose import Pose
from tp_controller.tasks.yaml_keys import yaml_key


class BaseTask(FrameTask):
    """
    Mixin that turns a task about a frame into one about the base; precedes the type.

    By default the axes are those of the world that the base can move along or about.
    """

    needs = ('moving_base',)
    without = ('frame', 'reference')

    frame: str = yaml_key('frame of the base', default=None,
                          parse_for=lambda task, frame: task.robot.base_frame)
    axes: tuple[str, ...] = yaml_key(
        'axes of the world frame that count (default: those that the base can move along or '
        'about)', default=None,
        parse_for=lambda task, axes: parse_axes(
            task.base_axes() if axes is None else axes, task.axis_names()))

    def base_axes(self) -> list[str]:
        """Return the axes that the base can move along or about."""
        return [axis for axis, row in zip(self.axis_names(), range(6)[self.twist_rows])
                if row in self.robot.base_reach]


class BasePose(BaseTask, Pose):
    """
    Bring the base to a pose in the world, or keep a vehicle in place.

    The goal is a 4×4 homogeneous matrix, or ``x, y, z`` [m] and a quaternion ``xyzw`` (7,), in
    the world frame.
    """

    type_name = 'base_pose'
    example = {}


class BaseOrientation(BaseTask, Orientation):
    """
    Turn the base to an orientation in the world (lecture 3.1).

    The goal is a quaternion ``xyzw`` (4,) or a rotation matrix (3, 3), in the world frame.
    """

    type_name = 'base_orientation'
    example = {}

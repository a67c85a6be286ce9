# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The task types, one class each.

A new type is a subclass of `Task` (or of `FrameTask`, `JointTask`, `BoundedTask`,
`GradientTask`) with a `type_name`; it registers itself. Other packages register their types
through the entry point group ``tp_controller.tasks``, whose entries name the class or its module.
"""

from functools import lru_cache
from importlib.metadata import entry_points

from tp_controller.errors import in_words, TpControllerError
from tp_controller.tasks.base_pose import BaseOrientation, BasePose
from tp_controller.tasks.bounded import BoundedTask
from tp_controller.tasks.center_of_mass import CenterOfMass
from tp_controller.tasks.com_polygon import ComPolygon
from tp_controller.tasks.cone import FieldOfView, Tilt
from tp_controller.tasks.distance import Distance
from tp_controller.tasks.frame import frame_key, FrameTask, reference_key
from tp_controller.tasks.gradient import GradientTask
from tp_controller.tasks.joint import Joint, JointTask, JointVelocity, Posture
from tp_controller.tasks.joint_limit_distance import JointLimitDistance
from tp_controller.tasks.joint_limits import JointLimits
from tp_controller.tasks.keys import Keys
from tp_controller.tasks.manipulability import Manipulability, ManipulabilityAbove
from tp_controller.tasks.obstacles import Obstacles
from tp_controller.tasks.orientation import Orientation
from tp_controller.tasks.orientation_range import OrientationRange
from tp_controller.tasks.pointing import LookAt, Pointing
from tp_controller.tasks.pose import Pose
from tp_controller.tasks.position import Position
from tp_controller.tasks.region import KeepIn, KeepOut
from tp_controller.tasks.relative import RelativePose, RelativePosition
from tp_controller.tasks.self_collision import SelfCollision
from tp_controller.tasks.speed_limit import SpeedLimit
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.twist import Twist
from tp_controller.tasks.yaml_keys import yaml_key
from tp_controller.untrusted.calls import foreign

ENTRY_POINTS = 'tp_controller.tasks'

__all__ = [
    'BaseOrientation', 'BasePose', 'BoundedTask', 'CenterOfMass', 'ComPolygon', 'Distance',
    'Evaluation', 'FieldOfView', 'FrameTask', 'GradientTask', 'Joint', 'JointLimitDistance',
    'JointLimits', 'JointTask', 'JointVelocity', 'KeepIn', 'KeepOut', 'Keys', 'LookAt',
    'Manipulability', 'ManipulabilityAbove', 'Obstacles', 'Orientation', 'OrientationRange',
    'Pointing', 'Pose', 'Position', 'Posture', 'RelativePose', 'RelativePosition', 'SelfCollision',
    'SpeedLimit', 'Task', 'Tilt', 'Twist', 'frame_key', 'reference_key', 'task_types', 'yaml_key']


@lru_cache(maxsize=1)
def _load_entry_points() -> None:
    """Load the types of other packages."""
    for entry in entry_points(group=ENTRY_POINTS):
        try:
            with foreign:
                entry.load()
        except Exception as error:
            # Code of other packages may raise any exception.
            raise TpControllerError(f'task types of {entry.value!r}: {in_words(error)}') from error


def task_types() -> dict[str, type[Task]]:
    """Return {type name: class} of all types, including those of other packages."""
    _load_entry_points()
    return dict(Task.types)

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

"""Tasks about the pose of the base, for vehicles with an arm (lecture 3.1)."""

from tp_controller.errors import TaskError
from tp_controller.model.robot import Robot
from tp_controller.tasks.frame import Axes, FrameTask
from tp_controller.tasks.keys import Gain, Tolerance
from tp_controller.tasks.orientation import Orientation
from tp_controller.tasks.pose import Pose
from tp_controller.tasks.task import DEFAULT_GAIN, DEFAULT_MODE, DEFAULT_TIMEOUT


class BaseTask(FrameTask):
    """
    Mixin that turns a task about a frame into one about the base; precedes the type.

    Parameters
    ----------
    robot : Robot
        Robot with a base that moves.
    name : str
    axes : str or list of str, optional
        Selected axes of the world frame; by default those that the base can move along or
        about.
    gain, tolerance, timeout, mode
        See `Task`.

    Raises
    ------
    TaskError
        The base is fixed, or keys are wrong.

    """

    keys = {'axes': 'axes of the world frame that count (default: those that the base can move '
                    'along or about)'}

    def __init__(self, robot: Robot, name: str, *, axes: Axes | None = None,
                 gain: Gain = DEFAULT_GAIN, tolerance: Tolerance | None = None,
                 timeout: float = DEFAULT_TIMEOUT, mode: str = DEFAULT_MODE) -> None:
        if not robot.moves:
            raise TaskError(name, [('type', f'{self.type_name} needs a robot whose base moves; '
                                            f'the base of this one is {robot.base}')])
        if axes is None:
            axes = [axis for axis, row in zip(self.axis_names(), range(6)[self.twist_rows])
                    if row in robot.base_reach]
        super().__init__(robot, name, frame=robot.base_frame, axes=axes, gain=gain,
                         tolerance=tolerance, timeout=timeout, mode=mode)


class BasePose(BaseTask, Pose):
    """
    Bring the base to a pose in the world, or keep a vehicle in place.

    The goal is a 4×4 homogeneous matrix, or ``x, y, z`` [m] and a quaternion ``xyzw`` (7,), in
    the world frame.
    """

    type_name = 'base_pose'


class BaseOrientation(BaseTask, Orientation):
    """
    Turn the base to an orientation in the world (lecture 3.1, base orientation).

    The goal is a quaternion ``xyzw`` (4,) or a rotation matrix (3, 3), in the world frame.
    """

    type_name = 'base_orientation'

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

"""Visual model of a robot without one, from an example robot of the same name and kinematics."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from tp_controller.errors import RobotError
from tp_controller.model.robot import Robot
from tp_controller.tools.view.meshes import SHARE_FOLDER

# Folder in which pip installs the robots of example-robot-data.
ROBOTS = SHARE_FOLDER / 'example-robot-data' / 'robots'
# Largest difference of entries of the poses of a frame that counts as equal [m, rad].
MATCH_TOLERANCE = 1e-4
# Number of random configurations at which two robots are compared.
MATCH_SAMPLES = 3


def matching_robot(robot: Robot) -> Robot | None:
    """
    Return the example robot with the kinematics of a robot; None if there is none.

    It has the name and all joints of the robot, and the frames of both coincide at random
    configurations. Its base is fixed.
    """
    for path in sorted(ROBOTS.glob(f'*/*/{Path(robot.name).name}.urdf')):
        try:
            found = Robot.from_urdf(path, joints=robot.joint_names)
            own = Robot.from_urdf(robot.urdf, joints=robot.joint_names)
        except RobotError:
            continue
        if _is_same(own, found):
            return found
    return None


def attachments(robot: Robot, other: Robot, tree: Element) -> dict[str, tuple[str, np.ndarray]]:
    """
    Return the attachments of the links of another robot, whose description is a tree.

    Returns
    -------
    dict
        {link: (frame of the robot, pose (4, 4) of the link on it)}; joints missing from the
        robot stay at their neutral position.

    """
    parents: Mapping[str, str] = {
        next(joint.iter('child')).attrib['link']: next(joint.iter('parent')).attrib['link']
        for joint in tree.findall('joint')}
    state = other.state(other.neutral())
    found = {}
    for link in other.frame_names:
        frame: str | None = link
        while frame is not None and frame not in robot.frame_names:
            frame = parents.get(frame)
        if frame is not None:
            found[link] = frame, np.linalg.solve(state.pose(frame), state.pose(link))
    return found


def _is_same(one: Robot, other: Robot) -> bool:
    """Return whether the common frames of two robots coincide."""
    shared = [frame for frame in one.frame_names if frame in other.frame_names]
    if one.base_frame != other.base_frame or len(shared) <= len(one.joint_names):
        return False
    random = np.random.default_rng(0)
    for _ in range(MATCH_SAMPLES):
        q = random.uniform(-1.0, 1.0, one.n)
        states = one.state(q), other.state(q)
        if max(np.abs(states[0].pose(frame) - states[1].pose(frame)).max()
               for frame in shared) > MATCH_TOLERANCE:
            return False
    return True

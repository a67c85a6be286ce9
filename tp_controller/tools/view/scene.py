# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot in a scene of the browser: links, ground, and the path of a frame."""

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tools.view.parts import add_part, corners, lowest, outer_points, place
from tp_controller.tools.view.visuals import Visuals, visuals_of
import viser

GROUND = '/ground'
ROBOT = '/robot'
# Size of the ground, and spacing of its fine and coarse lines [m].
GROUND_SIZE, CELL, SECTION = 8.0, 0.25, 1.0
GROUND_COLOUR, CELL_COLOUR, SECTION_COLOUR = (228, 232, 238), (206, 212, 221), (176, 184, 196)
SHADOW = 0.3
# Colours of the sky at the zenith and at the horizon; number of shades.
SKY_COLOURS, SHADES = ((186, 203, 224), (240, 243, 247)), 64
ENVIRONMENT_BRIGHTNESS = 0.25
TRAIL_COLOUR = (0, 114, 178)
# Number of points of a trail, and smallest distance between two of them [m].
MOST_TRAIL_POINTS, TRAIL_STEP = 400, 0.004
TRAIL_WIDTH = 3.0
# Largest height of the lowest point of a base that stands on the root plane [m].
BASE_TOLERANCE = 0.02
# Smallest change of an entry of a pose that is sent [m, 1].
LINK_TOLERANCE = 1e-7


class RobotScene:
    """
    Robot in a scene.

    The shapes of each link are sent once; `show` only moves them.

    Parameters
    ----------
    scene : viser.SceneApi
        Scene of a server, shared by its browsers.
    robot : Robot
    name : str
        Name of the parent node of the links.
    looks : Visuals, optional
        Visual model; by default that of the description.

    Attributes
    ----------
    state : RobotState
        Displayed state of the robot.
    frames : dict
        {link: handle} of the links with a shape.
    parts : dict
        {link: list of Part}
    remarks : tuple of str
        Parts of the description that are not shown, with the reasons.

    """

    def __init__(self, scene: viser.SceneApi, robot: Robot, name: str = ROBOT,
                 looks: Visuals | None = None) -> None:
        looks = visuals_of(robot) if looks is None else looks
        self.robot, self.parts, self.remarks = robot, looks.parts, looks.remarks
        self._corners = corners(looks.parts)
        self._root = scene.add_frame(name, show_axes=False)
        self.frames: dict[str, viser.FrameHandle] = {}
        self._shown: dict[str, Array] = {}
        for number, (link, parts) in enumerate(looks.parts.items()):
            if parts:
                # A slash in a name would create a branch.
                node = f'{name}/{number}_{link.replace("/", "_")}'
                self.frames[link] = scene.add_frame(node, show_axes=False)
                for index, part in enumerate(parts):
                    add_part(scene, f'{node}/{index}', part)
        self.state: RobotState = robot.state(robot.neutral())
        self._place()

    def show(self, q: ArrayLike, passive: ArrayLike | None = None) -> None:
        """
        Show a configuration.

        Parameters
        ----------
        q : array_like (nq,)
            Configuration [rad or m].
        passive : array_like (p,), optional
            Passive positions; unchanged where left out.

        Raises
        ------
        RobotError
            The configuration has a wrong shape or is not finite.

        """
        self.state.update(q, passive)
        self._place()

    def ground(self) -> float:
        """
        Return the height of the ground below the displayed robot [m].

        This is the height of the root if the fixed links stand on it: an arm may reach below its
        base. Otherwise it is the height of the lowest point of the robot, as the root may be the
        pelvis above two legs; but never above the root.
        """
        model, ids = self.robot.kinematics.model, self.robot.kinematics.frame_ids
        fixed = {link: parts for link, parts in self.parts.items()
                 if model.frames[ids[link]].parentJoint == 0}
        if abs(lowest(self.state, fixed)) < BASE_TOLERANCE:
            return 0.0
        return min(lowest(self.state, self.parts), 0.0)

    def outer_points(self) -> Array:
        """Return points (k, 3) that enclose the displayed robot [m]."""
        if self._corners:
            return outer_points(self.state, self._corners)
        return np.array([self.state.position(frame) for frame in self.robot.frame_names])

    def remove(self) -> None:
        """Remove the robot from the scene."""
        self._root.remove()

    def _place(self) -> None:
        """Move the links whose poses have changed."""
        for link, frame in self.frames.items():
            T = self.state.pose(link)
            if link not in self._shown or np.abs(T - self._shown[link]).max() > LINK_TOLERANCE:
                self._shown[link] = T
                place(frame, T)


class Trail:
    """
    Path of a point, limited to its latest `MOST_TRAIL_POINTS` points.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str

    """

    def __init__(self, scene: viser.SceneApi, name: str) -> None:
        self._scene, self._name = scene, name
        self._points: list[Array] = []
        self._line: viser.LineSegmentsHandle | None = None

    def add(self, point: Array) -> None:
        """Add a point (3,) [m] if it is far enough from the last one."""
        if self._points and np.linalg.norm(point - self._points[-1]) < TRAIL_STEP:
            return
        self._points = [*self._points[1 - MOST_TRAIL_POINTS:], np.array(point)]
        if len(self._points) < 2:
            return
        segments = np.stack((self._points[:-1], self._points[1:]), axis=1)
        if self._line is None:
            self._line = self._scene.add_line_segments(
                self._name, segments, TRAIL_COLOUR, thickness=TRAIL_WIDTH,
                thickness_units='screen')
        else:
            self._line.points = segments.astype(np.float32)

    def clear(self) -> None:
        """Remove the path."""
        self._points = []
        if self._line is not None:
            self._line.remove()
            self._line = None


def add_ground(scene: viser.SceneApi, height: float = 0.0) -> viser.GridHandle:
    """Add light and the ground at a height [m]; return the ground."""
    scene.configure_environment_map('studio', environment_intensity=ENVIRONMENT_BRIGHTNESS)
    return scene.add_grid(
        GROUND, GROUND_SIZE, GROUND_SIZE, cell_size=CELL, section_size=SECTION,
        cell_color=CELL_COLOUR, section_color=SECTION_COLOUR, shadow_opacity=SHADOW,
        position=(0.0, 0.0, height), plane_color=GROUND_COLOUR, plane_opacity=1.0)


def add_sky(scene: viser.SceneApi) -> None:
    """
    Add the sky as the background.

    The sky follows the camera of a browser, but not the camera of a rendered picture.
    """
    shares = np.linspace(0.0, 1.0, SHADES)[:, np.newaxis, np.newaxis]
    sky = (1.0 - shares) * np.array(SKY_COLOURS[0]) + shares * np.array(SKY_COLOURS[1])
    scene.set_background_image(np.repeat(sky, 2, axis=1).astype(np.uint8), format='png')


def tip(robot: Robot) -> str:
    """Return the frame at the end of the longest chain of joints."""
    model, ids = robot.kinematics.model, robot.kinematics.frame_ids
    return max(robot.frame_names, key=lambda frame: (
        len(model.supports[model.frames[ids[frame]].parentJoint]),
        float(np.linalg.norm(model.frames[ids[frame]].placement.translation))))

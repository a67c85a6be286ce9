# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Motion of a recording as a page for the browser, without a server."""

from collections.abc import Sequence
from contextlib import redirect_stdout
import io
import math

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.motion import Moment
from tp_controller.tools.recording.robots import configurations, path_of, tool_frames
from tp_controller.tools.view.camera import FIELD_OF_VIEW, first_view
from tp_controller.tools.view.gate import Gate, LOCAL
from tp_controller.tools.view.guard import Guard
from tp_controller.tools.view.markers import drawable, MarkerScene
from tp_controller.tools.view.scene import (
    add_ground,
    add_sky,
    RobotScene,
    TRAIL_COLOUR,
    TRAIL_WIDTH,
)
import viser

# Name of the node with the whole path of the tool.
PATH = '/path'
# Longest pause of the replay, where the recording has no messages [s].
LONGEST_GAP = 2.0
# Largest number of link poses in a page; robots with many links have a lower frame rate.
MOST_POSES = 1_000_000
# Number of configurations that define the view.
VIEWS = 20


def replay_page(history: History, robot: Robot) -> str:
    """
    Return a self-contained page that shows the motion of a robot.

    Parameters
    ----------
    history : History
        Content of the recording.
    robot : Robot
        Robot, shown with the meshes that are available.

    Returns
    -------
    str
        HTML; empty if no configuration is known.

    """
    times, q, passive, moments = configurations(history, robot)
    if not len(times):
        return ''
    step = math.ceil(len(times) * len(robot.frame_names) / MOST_POSES)
    times, q, passive, moments = times[::step], q[::step], passive[::step], moments[::step]
    # viser would print the address of this temporary server.
    with redirect_stdout(io.StringIO()), Guard(Gate(LOCAL), pictures=True).watching():
        server = viser.ViserServer(LOCAL, 0, verbose=False)
        try:
            return _recorded(server, history, robot, times, q, passive, moments)
        finally:
            server.stop()


def _recorded(server: viser.ViserServer, history: History, robot: Robot, times: Array, q: Array,
              passive: Array, moments: Sequence[Moment]) -> str:
    """Return the page; see `configurations`."""
    shown = RobotScene(server.scene, robot)
    shown.show(q[0], passive[0])
    add_ground(server.scene, shown.ground())
    add_sky(server.scene)
    frames = tool_frames(history, robot)
    _look(server, shown, q, passive)
    if frames:
        _add_path(server.scene, path_of(robot, next(iter(frames.values())), q, passive))
    markers = MarkerScene(server.scene)
    recorded, drawn = server.get_scene_serializer(), None
    for row, (moment, wait) in enumerate(zip(moments, np.diff(times, append=times[-1]))):
        shown.show(q[row], passive[row])
        if moment.markers is not drawn:
            drawn = moment.markers
            markers.draw(drawable(history.markers(moment)))
        recorded.insert_sleep(float(min(wait, LONGEST_GAP)))
    return recorded.as_html()


def _look(server: viser.ViserServer, shown: RobotScene, q: Array, passive: Array) -> None:
    """Set a view that contains the robot all the time."""
    points = []
    for row in np.unique(np.linspace(0, len(q) - 1, VIEWS).astype(int)):
        shown.state.update(q[row], passive[row])
        points.append(shown.outer_points())
    camera = server.initial_camera
    camera.position, camera.look_at = first_view(np.concatenate(points))
    camera.fov = FIELD_OF_VIEW


def _add_path(scene: viser.SceneApi, points: Array) -> None:
    """Add the path of a tool (T, 3)."""
    if len(points) > 1:
        scene.add_line_segments(PATH, np.stack((points[:-1], points[1:]), axis=1), TRAIL_COLOUR,
                                thickness=TRAIL_WIDTH, thickness_units='screen')

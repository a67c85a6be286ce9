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

"""Goals that can be dragged in RViz."""

from collections.abc import Callable, Mapping
from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped
import numpy as np
from rclpy.node import Node
from tp_controller.errors import in_words
from tp_controller.model.spatial import Array, pose
from tp_controller.ros import Message
from tp_controller.ros.interface.goal_messages import messages_of
from tp_controller.ros.interface.markers import to_pose
from tp_controller.tasks.sketch import Sketch, Triad
from tp_controller.tasks.task import Task
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
)

TOPIC, GOAL = '~/interactive_goals', 'goal'
# How long the arrows are [m].
SIZE = 0.15
# Beyond this a goal has moved [m, or of rotation matrices].
MOVED = 1e-6
# Quaternions (w, x, y, z) that turn x to each axis, along and about which a goal is dragged.
SQUARE = 0.5 ** 0.5
DIRECTIONS = {'x': (SQUARE, SQUARE, 0.0, 0.0), 'z': (SQUARE, 0.0, SQUARE, 0.0),
              'y': (SQUARE, 0.0, 0.0, SQUARE)}


class InteractiveGoals:
    """
    Has a marker to be dragged for every task whose goal is a pose or a point.

    What is dragged is handed on as the goal message that it stands for. Without the package
    ``interactive_markers`` nothing is there.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to, below ``~/interactive_goals``.
    warn : callable
        Told in a sentence if the package is there and does not work.

    """

    def __init__(self, node: Node, warn: Callable[[str], object]) -> None:
        # Of interactive_markers, which may be missing.
        self._server: Any = None
        self._take: Callable[[str, str, Message], object] | None = None
        # {task: (root frame, type of its goals, where the marker is)}
        self._shown: dict[str, tuple[str, type, Array]] = {}
        try:
            from interactive_markers import InteractiveMarkerServer
            self._server = InteractiveMarkerServer(node, TOPIC)
        except ImportError:
            return
        except Exception as error:
            # Of a package of others, which nobody has to have.
            warn(f'goals cannot be dragged in RViz: {in_words(error)}')

    @property
    def watched(self) -> bool:
        """Return whether anybody shows the markers."""
        return self._server is not None and self._server.update_pub.get_subscription_count() > 0

    def close(self) -> None:
        """Remove everything."""
        if self._server is not None:
            self._server.shutdown()
            self._server = None

    def follow(self, take: Callable[[str, str, Message], object] | None) -> None:
        """Hand goals to a function of the task, its topic and a message; to none for None."""
        self._take = take

    def show(self, root: str, tasks: Mapping[str, Task],
             sketches: Mapping[str, list[Sketch]]) -> None:
        """
        Put the markers where the goals are.

        Parameters
        ----------
        root : str
            Root frame of the robot.
        tasks : mapping
            {name: Task}
        sketches : mapping
            {name: sketches} of those that are shown.

        """
        there = {}
        for name, parts in sketches.items():
            kind, T = _kind(tasks.get(name)), _goal(parts)
            if kind is not None and T is not None:
                there[name] = root, kind, T if kind is PoseStamped else pose(np.eye(3), T[:3, 3])
        for name in self._shown.keys() - there.keys():
            self._server.erase(name)
        for name, (frame, kind, T) in there.items():
            before = self._shown.get(name)
            if before is None or before[:2] != (frame, kind):
                self._server.insert(_marker(name, frame, kind, T), feedback_callback=self._on_drag)
            elif np.abs(before[2] - T).max() > MOVED:
                self._server.setPose(name, to_pose(T))
        self._shown = there
        self._server.applyChanges()

    def _on_drag(self, feedback: InteractiveMarkerFeedback) -> None:
        """Take a goal that was dragged."""
        shown = self._shown.get(feedback.marker_name)
        if feedback.event_type != InteractiveMarkerFeedback.POSE_UPDATE or shown is None:
            return
        frame, kind, _ = shown
        # The marker is not where it was put: it goes back there if the goal is refused.
        self._shown[feedback.marker_name] = frame, kind, np.full((4, 4), np.inf)
        if self._take is not None:
            message = kind(header=feedback.header)
            if kind is PoseStamped:
                message.pose = feedback.pose
            else:
                message.point = feedback.pose.position
            self._take(feedback.marker_name, GOAL, message)


def _kind(task: Task | None) -> type | None:
    """Return the type of the goal messages of a task, None where nobody can drag them."""
    kinds = [] if task is None else [entry.kind for entry in messages_of(task)
                                     if entry.topic == GOAL]
    return next((kind for kind in kinds if kind in (PoseStamped, PointStamped)), None)


def _goal(parts: list[Sketch]) -> Array | None:
    """Return the pose T_root_goal, as (4, 4), of a sketch; None where it has none."""
    return next((part.T for part in parts if isinstance(part, Triad) and part.part == GOAL), None)


def _marker(name: str, root: str, kind: type, T: Array) -> InteractiveMarker:
    """Return a marker with arrows to move it, and rings to turn it if it is a pose."""
    marker = InteractiveMarker(name=name, description=name, scale=SIZE, pose=to_pose(T))
    # Without a stamp RViz answers in this frame.
    marker.header.frame_id = root
    modes = {'move': InteractiveMarkerControl.MOVE_AXIS}
    if kind is PoseStamped:
        modes['turn'] = InteractiveMarkerControl.ROTATE_AXIS
    for axis, (w, x, y, z) in DIRECTIONS.items():
        for verb, mode in modes.items():
            control = InteractiveMarkerControl(name=f'{verb}_{axis}', interaction_mode=mode)
            turn = control.orientation
            turn.w, turn.x, turn.y, turn.z = w, x, y, z
            marker.controls.append(control)
    return marker

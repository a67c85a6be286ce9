# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Interactive markers for goals in RViz."""

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

INTERACTIVE_GOALS_TOPIC, GOAL = '~/interactive_goals', 'goal'
# Length of the arrows [m].
ARROW_LENGTH = 0.15
# Smallest change of a goal pose that moves its marker [m, or 1 in rotation matrices].
LEAST_CHANGE = 1e-6
# Quaternions (w, x, y, z) that rotate x to each axis, along and about which a goal is dragged.
ROOT_HALF = 0.5 ** 0.5
DIRECTIONS = {'x': (ROOT_HALF, ROOT_HALF, 0.0, 0.0), 'z': (ROOT_HALF, 0.0, ROOT_HALF, 0.0),
              'y': (ROOT_HALF, 0.0, 0.0, ROOT_HALF)}


class InteractiveGoals:
    """
    Interactive markers, one for every task with a pose or point as goal.

    A dragged marker is passed on as a goal message. Without the package ``interactive_markers``
    there are no markers.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to, below ``~/interactive_goals``.
    warn : callable
        Called with a message if the package is installed but does not work.

    """

    def __init__(self, node: Node, warn: Callable[[str], object]) -> None:
        # Server of interactive_markers, which may be missing.
        self._server: Any = None
        self._take: Callable[[str, str, Message], object] | None = None
        # {task: (root frame, type of its goals, pose of the marker)}
        self._shown: dict[str, tuple[str, type, Array]] = {}
        try:
            from interactive_markers import InteractiveMarkerServer
            self._server = InteractiveMarkerServer(node, INTERACTIVE_GOALS_TOPIC)
        except ImportError:
            return
        except Exception as error:
            # Raised by an optional third-party package.
            warn(f'goals cannot be dragged in RViz: {in_words(error)}')

    @property
    def watched(self) -> bool:
        """Return whether the markers have a subscriber."""
        return self._server is not None and self._server.update_pub.get_subscription_count() > 0

    def close(self) -> None:
        """Remove the markers."""
        if self._server is not None:
            self._server.shutdown()
            self._server = None

    def follow(self, take: Callable[[str, str, Message], object] | None) -> None:
        """Pass goals to a function of the task, its topic and a message; None: to none."""
        self._take = take

    def show(self, root: str, tasks: Mapping[str, Task],
             sketches: Mapping[str, list[Sketch]]) -> None:
        """
        Update the markers to the poses of the goals.

        Parameters
        ----------
        root : str
            Root frame of the robot.
        tasks : mapping
            {name: Task}
        sketches : mapping
            {name: sketches} of the tasks to show.

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
            elif np.abs(before[2] - T).max() > LEAST_CHANGE:
                self._server.setPose(name, to_pose(T))
        self._shown = there
        self._server.applyChanges()

    def _on_drag(self, feedback: InteractiveMarkerFeedback) -> None:
        """Pass on a dragged goal."""
        shown = self._shown.get(feedback.marker_name)
        if feedback.event_type != InteractiveMarkerFeedback.POSE_UPDATE or shown is None:
            return
        frame, kind, _ = shown
        # The marker has left its pose: it moves back there if the goal is refused.
        self._shown[feedback.marker_name] = frame, kind, np.full((4, 4), np.inf)
        if self._take is not None:
            message = kind(header=feedback.header)
            if kind is PoseStamped:
                message.pose = feedback.pose
            else:
                message.point = feedback.pose.position
            self._take(feedback.marker_name, GOAL, message)


def _kind(task: Task | None) -> type | None:
    """Return the goal message type of a task, or None if its goals cannot be dragged."""
    kinds = [] if task is None else [entry.kind for entry in messages_of(task)
                                     if entry.topic == GOAL]
    return next((kind for kind in kinds if kind in (PoseStamped, PointStamped)), None)


def _goal(parts: list[Sketch]) -> Array | None:
    """Return T_root_goal, as (4, 4), of a sketch, or None without a goal."""
    return next((part.T for part in parts if isinstance(part, Triad) and part.part == GOAL), None)


def _marker(name: str, root: str, kind: type, T: Array) -> InteractiveMarker:
    """Return a marker with arrows for translation, and rings for rotation of a pose."""
    marker = InteractiveMarker(name=name, description=name, scale=ARROW_LENGTH, pose=to_pose(T))
    # Without a stamp RViz replies in this frame.
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

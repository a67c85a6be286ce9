# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Markers of the tasks, for RViz and other viewers."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion
from numpy.typing import ArrayLike
from std_msgs.msg import ColorRGBA
from tp_controller.errors import in_words
from tp_controller.model.spatial import quaternion_from_rotation
from tp_controller.tasks.primitives import checked, Primitive, primitives, Rgba
from tp_controller.tasks.sketch import Sketch
from visualization_msgs.msg import Marker, MarkerArray

# Lifetime of the markers: in periods, and at least [s].
LIFE_PERIODS, SHORTEST_LIFE = 3.0, 1.0


class Markers:
    """
    Converter of sketches to markers, with deletion of outdated ones.

    Parameters
    ----------
    period : float
        Time from one message to the next [s].
    refused : callable
        Called with the name of a task that cannot be drawn, and the reason.

    """

    def __init__(self, period: float, refused: Callable[[str, str], object]) -> None:
        life = max(SHORTEST_LIFE, LIFE_PERIODS * period)
        self._life = Duration(sec=int(life), nanosec=int(life % 1.0 * 1e9))
        self._refused = refused
        self._shown: dict[tuple[str, int], None] = {}

    def message(self, stamp: Time, root: str,
                sketches: Mapping[str, Iterable[Sketch]]) -> MarkerArray:
        """
        Return all markers, and deletions of those that only the last message had.

        Parameters
        ----------
        stamp : builtin_interfaces.msg.Time
            Time of the message.
        root : str
            Root frame of the robot.
        sketches : mapping
            {task: sketches}

        Returns
        -------
        visualization_msgs.msg.MarkerArray

        """
        array = MarkerArray(markers=[
            marker for name, parts in sketches.items()
            for marker in self._task_markers(name, parts)])
        for marker in array.markers:
            marker.lifetime = self._life
        shown = {(marker.ns, marker.id): None for marker in array.markers}
        array.markers.extend(Marker(ns=ns, id=number, action=Marker.DELETE)
                             for ns, number in self._shown if (ns, number) not in shown)
        self._shown = shown
        for marker in array.markers:
            marker.header.frame_id, marker.header.stamp = root, stamp
        return array

    def _task_markers(self, name: str, parts: Iterable[Sketch]) -> list[Marker]:
        """Return the markers of a task, or an empty list if they are invalid."""
        found, numbers = [], Counter[str]()
        try:
            for part in parts:
                for marker in map(_to_marker, primitives(part)):
                    marker.ns = f'{name}/{part.part}'
                    # Raises an error for text that cannot be published.
                    marker.ns.encode()
                    marker.id = numbers[marker.ns]
                    numbers[marker.ns] += 1
                    found.append(marker)
        except Exception as error:
            # Task types of other packages may return anything.
            self._refused(name, f'its sketch cannot be drawn: {in_words(error)}')
            return []
        return found


def to_pose(T: ArrayLike) -> Pose:
    """Return a pose message."""
    T_checked = checked(T, (4, 4))
    x, y, z, w = quaternion_from_rotation(T_checked[:3, :3]).tolist()
    px, py, pz = T_checked[:3, 3].tolist()
    return Pose(position=Point(x=px, y=py, z=pz), orientation=Quaternion(x=x, y=y, z=z, w=w))


def _to_marker(primitive: Primitive) -> Marker:
    """Return a primitive as a marker."""
    marker = Marker(
        type=int(primitive.kind), action=Marker.ADD, pose=to_pose(primitive.T),
        color=_to_colour(primitive.colour), text=primitive.text,
        points=[Point(x=x, y=y, z=z) for x, y, z in primitive.points.tolist()],
        colors=[_to_colour(colour) for colour in primitive.colours])
    marker.scale.x, marker.scale.y, marker.scale.z = primitive.size
    return marker


def _to_colour(colour: Rgba) -> ColorRGBA:
    """Return a colour message."""
    red, green, blue, alpha = colour
    return ColorRGBA(r=red, g=green, b=blue, a=alpha)

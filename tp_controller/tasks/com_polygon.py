# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygon that the centre of mass stays above."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, skews
from tp_controller.model.state import RobotState
from tp_controller.model.support_polygon import Edges, support_edges
from tp_controller.tasks.aim import across, parse_axis
from tp_controller.tasks.bounded import BoundedTask, distance_back, History, Observation
from tp_controller.tasks.keys import finite_vector, Keys, non_negative, UnitRows
from tp_controller.tasks.sketch import arrow, Dot, Path, Sketch
from tp_controller.tasks.twin import COM_POLYGON, make_twin, Twin
from tp_controller.tasks.yaml_keys import yaml_key

DEFAULT_EDGE_MARGIN = 0.02
# Numbers of contact points that are valid.
FEWEST_CONTACTS, MOST_CONTACTS = 3, 32
# Least ratio of the extents of the points of one frame across and along a line.
LEAST_WIDTH = 1e-3
# Name of the row of contacts that are all on one line, which support nothing beside it.
ON_ONE_LINE = 'contacts on one line'


class EdgeHistory(History):
    """
    `History` of the edges of a support polygon, in the same array whatever their number.

    Each has the row of the contact at its first end, with its key in one more column; −1 marks a
    contact at which no edge begins.
    """

    def __init__(self, robot: Robot, contacts: int) -> None:
        super().__init__(robot, contacts, robot.n + 1)
        self._contacts = contacts

    def note(self, now: float, q: Array, seen: Observation) -> Array:
        """Record a cycle; see `History`."""
        keys = np.array(seen.keys)
        first, noted = keys // (2 * self._contacts), np.full((self._contacts, self._n), -1.0)
        noted[first] = np.column_stack((seen.J, keys))
        before = super().note(now, q, Observation(seen.value, noted))[first]
        return np.where(before[:, -1:] == keys[:, np.newaxis], before[:, :-1], seen.J)


class ComPolygon(BoundedTask):
    """
    Keep the centre of mass above the support polygon.

    It is the convex hull of the contacts, points that move with frames of the robot. Everything is
    projected along `up`. Each edge of the hull, from a to b, has one row: the distance σ of the
    centre of mass c from it, positive inside, with the velocity relative to the nearest point of
    its line::

        σ = nᵀ (c − a)        J = nᵀ (J_c − (1 − s) J_a − s J_b),  s = (b − a)ᵀ (c − a) / ‖b − a‖²

    The rows change with the hull. Contacts on one line have one row, minus the distance from them.
    """

    type_name = 'com_polygon'
    needs = ('masses',)
    units = ('m',)
    example = {'contacts': {'panda_link0': [[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0],
                                            [-0.1, 0.1, 0.0]]}}
    sketch_parts = {'frame': True, 'plumb': True, 'polygon': True, 'error': False}

    contacts: Mapping[str, Array] = yaml_key(
        'frames whose origins are contact points, or {frame: [[x, y, z], …]} with points of '
        f'frames, {FEWEST_CONTACTS} to {MOST_CONTACTS} in all', unit='m',
        parse_for=lambda task, contacts: parse_contacts(task.robot, contacts))
    margin: float = yaml_key('least distance from the edges', non_negative, DEFAULT_EDGE_MARGIN,
                             unit='m')
    up: Array = yaml_key(
        'direction against gravity in the root: x, -x, y, -y, z, -z or three numbers', parse_axis,
        'z')

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        super().__init__(*arguments, **keys)
        self._history = EdgeHistory(self.robot, len(self._names))

    def check_keys(self, keys: Keys) -> None:
        """Set the bound."""
        super().check_keys(keys)
        self.lower = self.margin

    def set_up(self) -> None:
        """Name the contacts, and find the horizontal axes."""
        super().set_up()
        # The number of rows is the number of edges.
        self.groups = tuple(UnitRows(slice(None), unit, limit) for _, unit, limit in self.groups)
        self._horizontal = across(self.up)
        self._names = [frame if len(points) == 1 else f'{frame} {number}'
                       for frame, points in self.contacts.items()
                       for number, _ in enumerate(points, 1)]

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the distances from the edges (m,) [m], and their Jacobian (m, n)."""
        seen = self.observe_rows(state)
        return seen.value, seen.J

    def observe_rows(self, state: RobotState) -> Observation:
        """Return the `Observation` at a state; rows are named after the ends of their edges."""
        edges, J_contacts = self._edges(state), self._contact_jacobians(state)
        share = edges.share[:, np.newaxis, np.newaxis]
        near = (1.0 - share) * J_contacts[edges.first] + share * J_contacts[edges.last]
        directions = edges.normals.dot(self._horizontal)[:, np.newaxis]
        J = (directions @ (state.center_of_mass()[1] - near))[:, 0]
        count = len(self._names)
        keys = (2 * count * edges.first + edges.last + count * edges.flat).tolist()
        return Observation(edges.distances, J, self.row_names_of(keys), keys)

    def row_names_of(self, keys: Iterable[float]) -> Sequence[str]:
        """Return the names of edges by their keys; see `Task`."""
        count = len(self._names)
        ends = [divmod(int(key), 2 * count) for key in keys]
        return [ON_ONE_LINE if last >= count else f'{self._names[first]} – {self._names[last]}'
                for first, last in ends]

    def make_twin(self) -> Twin | None:
        """Return the inputs in the compiled core; see `Task`."""
        index, count = self.robot.kinematics.frame_index, len(self._names)
        frames = [float(index(frame)) for frame, points in self.contacts.items() for _ in points]
        return make_twin(COM_POLYGON, (count, *self._law()[1:]), (
            np.array(frames), np.concatenate(list(self.contacts.values())), self._horizontal,
            self._limits()), self.mode)

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return centre of mass, plumb line, polygon, and an arrow from the line to the bounds."""
        center, points, edges = state.center_of_mass()[0], self._points(state), self._edges(state)
        foot = center - (center - points.mean(axis=0)).dot(self.up) * self.up
        back = distance_back(edges.distances, self.lower, self.upper)
        worst = int(np.abs(back).argmax())
        corners = points[[*edges.first, edges.last[-1]]]
        return [Dot('frame', center), Path('plumb', np.array([center, foot])),
                Path('polygon', corners),
                *arrow('error', foot,
                       foot + back[worst] * edges.normals[worst].dot(self._horizontal))]

    def _edges(self, state: RobotState) -> Edges:
        """Return the edges of the support polygon as the centre of mass sees them."""
        H = self._horizontal
        return support_edges(self._points(state).dot(H.T), H.dot(state.center_of_mass()[0]))

    def _contact_jacobians(self, state: RobotState) -> Array:
        """Return J (k, 3, n) of the contact points."""
        found = []
        for frame, points in self.contacts.items():
            J = state.jacobian(frame)
            found.append(J[:3] - skews(points.dot(state.rotation(frame).T)) @ J[3:])
        return np.concatenate(found)

    def _points(self, state: RobotState) -> Array:
        """Return the contact points (k, 3) in the root [m]."""
        return np.concatenate([state.position(frame) + points.dot(state.rotation(frame).T)
                               for frame, points in self.contacts.items()])


def parse_contacts(robot: Robot, contacts: object) -> dict[str, Array]:
    """Return {frame: points (k, 3) in the frame [m]}, or raise ValueError or `RobotError`."""
    if isinstance(contacts, (list, tuple)):
        contacts = {str(frame): [[0.0, 0.0, 0.0]] for frame in contacts}
    if not isinstance(contacts, Mapping) or not all(
            isinstance(points, (list, tuple)) for points in contacts.values()):
        raise ValueError('needs a list of frames, or {frame: [[x, y, z], …]}, got '
                         f'{contacts!r}')
    found = {robot.check_frame(frame): np.array(
        [finite_vector(point, 3, f'a contact of {frame}') for point in points]).reshape(-1, 3)
        for frame, points in contacts.items()}
    count = sum(map(len, found.values()))
    if not FEWEST_CONTACTS <= count <= MOST_CONTACTS:
        raise ValueError(f'needs {FEWEST_CONTACTS} to {MOST_CONTACTS} contact points, got {count}')
    if len(found) == 1:
        points, = found.values()
        extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if extents[1] <= LEAST_WIDTH * extents[0]:
            raise ValueError('needs contact points that are not all on one line')
    return found

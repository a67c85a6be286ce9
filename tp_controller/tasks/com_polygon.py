# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygon that the centre of mass stays above."""

from collections.abc import Mapping, Sequence

import numpy as np
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, skews
from tp_controller.model.state import RobotState
from tp_controller.model.support_polygon import Edges, support_edges
from tp_controller.tasks.aim import across, parse_axis
from tp_controller.tasks.bounded import BoundedTask, distance_back, Observation
from tp_controller.tasks.keys import finite_vector, Keys, non_negative, UnitRows
from tp_controller.tasks.sketch import arrow, Dot, Path, Sketch
from tp_controller.tasks.yaml_keys import yaml_key

DEFAULT_EDGE_MARGIN = 0.02
# Numbers of contact points that are valid.
FEWEST_CONTACTS, MOST_CONTACTS = 3, 32
# Least ratio of the extents of the points of one frame across and along a line.
LEAST_WIDTH = 1e-3
# Name of the row of contacts that are all on one line, which support nothing beside it.
ON_ONE_LINE = 'contacts on one line'


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
        if edges.flat:
            return Observation(edges.distances, J, [ON_ONE_LINE], [ON_ONE_LINE])
        keys = list(zip(edges.first.tolist(), edges.last.tolist()))
        return Observation(edges.distances, J, [
            f'{self._names[first]} – {self._names[last]}' for first, last in keys], keys)

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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Distances between pairs of solids, computed by Pinocchio and its collision library Coal.

clearance.h leaves out pairs that are far apart, and computes those of lines (capsules and spheres)
and half-spaces. It leaves to Coal all other pairs, those whose corners are needed, and those whose
nearest points rounding would decide.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple, Protocol

import coal
import numpy as np
import pinocchio
from tp_controller.model.compiled import Motion
from tp_controller.model.kinematics import Kinematics
from tp_controller.model.solids import Solid
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.solver.compiled import core, MOST

# Tolerance on the distance of solids that do not overlap [m]. With 1e-6, Coal's default, normals
# at a cylinder are wrong by up to 0.03. For overlapping solids Coal reaches 1e-6: it found the
# distances of all of 40,000 random pairs; with 1e-8 it missed two of 8,000.
DISTANCE_TOLERANCE = 1e-9
# Largest inclination of sides that face each other, from one end to the other [m]. Without corners
# a hand that is pressed flat on a table rattles (100 reversals/s), and 300 runs of
# benchmarks/inequalities.py come as deep as 5.7 mm (obstacles). With 0.001, Coal's default, they
# come 2.2 mm deep, with 0.002 to 0.005 at most 0.04 mm, and reverse as often.
PATCH_TOLERANCE = 0.003
# A pair counts as far if a lower bound of its distance exceeds `within` by this [m].
BOUND_MARGIN = 1e-6
# Least angle between lines [rad], least distance of their nearest points, and least difference in
# height of the ends of a line over a half-space [m], for the compiled core to measure them. Closer
# to parallel, or to each other, nearest points and normals differ from Coal's by more than 1e-12.
LEAST_ANGLE, LEAST_GAP, LEAST_RISE = 0.03, 1e-3, 1e-9
# Coal checks all pairs of a batch in one call if the core leaves it more than this share of them.
MANY = 0.5
# Number of pairs per call into Coal, half a millisecond if all of them are near.
PAIRS_PER_BATCH = 128
HALF_TURN = pinocchio.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))


@dataclass
class Distances:
    """
    Distances, normals and nearest points of pairs of solids.

    Attributes
    ----------
    pairs : list of int
        Indices of the pairs in the `Clearance`.
    corners : list of int
        0 for the nearest points of a pair; 1, 2, … for the corners of sides or edges that face
        each other flatly.
    distances : ndarray (m,)
        Negative if the solids overlap: the penetration depth [m].
    normals : ndarray (m, 3)
        From the second towards the first, the direction of increasing distance.
    points : ndarray (m, 3)
        In the middle between the nearest points, or between a corner and the opposite side [m].

    """

    pairs: list[int]
    corners: list[int]
    distances: Array
    normals: Array
    points: Array


class CompiledClearance(Protocol):
    """A clearance in the compiled core."""

    def measure(self, motion: Motion, close: float) -> tuple[list[int], list[int], bytes]:
        """
        Return the indices of near pairs and of those left to Coal, and numbers of the former.

        The numbers are the distances (m,), normals (m, 3) and points (m, 3).
        """

    def merge(self, pairs: list[int], nearest: int, depths: list[float], ways: list[Array],
              points: list[Array]) -> tuple[list[int], bytes] | None:
        """
        Return pairs and numbers with contacts of Coal; None if one is not finite.

        The first contacts are the nearest points of their pairs, the others corners.
        """


class Clearance:
    """
    Distances between pairs of solids that are near each other.

    If flat sides or parallel edges face each other, the nearest points jump from one end to the
    other as the solids rock. A robot in contact would oscillate. For close pairs all corners of
    the contact patch are therefore returned, at the distance of the nearest points.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the robot that the solids are fixed to.
    solids : sequence of Solid
        All solids.
    pairs : sequence of (int, int)
        Their indices, the first below the second; only the second may be a half-space.
    within : float
        Pairs that are farther apart are omitted [m].
    before : Clearance, optional
        Previous clearance of the same robot and `within`. Unchanged pairs are reused, and moved:
        adding one obstacle to 6,400 pairs takes a tenth of the time.

    Attributes
    ----------
    names : list of str
        Names of the pairs.
    frames : list of str
        Frames that the solids are fixed to.
    first, second : ndarray (p,) of int
        Index in `frames` for each pair.

    """

    def __init__(self, kinematics: Kinematics, solids: Sequence[Solid],
                 pairs: Sequence[tuple[int, int]], within: float,
                 before: 'Clearance | None' = None) -> None:
        there = [] if before is None else before._batches
        self._batches: list[_Batch] = []
        for number, start in enumerate(range(0, len(pairs), PAIRS_PER_BATCH)):
            some = list(pairs[start:start + PAIRS_PER_BATCH])
            if number < len(there) and there[number].take(solids, some):
                self._batches.append(there[number])
            else:
                self._batches.append(_Batch(kinematics, solids, some, start, within))
        self.names = [name for batch in self._batches for name in batch.names]
        self.frames = list(dict.fromkeys(solid.frame for solid in solids))
        frame = np.array([self.frames.index(solid.frame) for solid in solids], dtype=int)
        self.first, self.second = (frame[indices] for indices in np.concatenate(
            [np.zeros((2, 0), dtype=int), *(batch.indices for batch in self._batches)], axis=1))
        self._compiled = _compiled(kinematics, solids, pairs, within)

    def near(self, state: RobotState) -> list[int]:
        """Return the indices of the pairs that are nearer than `within`."""
        return [pair for batch in self._batches for pair in batch.near(state)]

    def nearest(self, state: RobotState, close: float = -math.inf) -> Distances:
        """
        Return the distances of the pairs that are nearer than `within`.

        Parameters
        ----------
        state : RobotState
            State with the poses of the frames.
        close : float
            Pairs nearer than this also have their corners returned [m].

        Returns
        -------
        Distances
            In the root.

        """
        if self._compiled is None or state.motion is None:
            return self._distances(self._contacts(state, None, close))
        near, left, numbers = self._compiled.measure(state.motion, close)
        measured = _split(near, [0] * len(near), numbers)
        others = self._contacts(state, left, close) if left else None
        if others is None or not others.pairs:
            return measured
        merged = self._compiled.merge(others.pairs, others.corners.count(0), others.depths,
                                      others.ways, others.points)
        if merged is None:
            return _merged(measured, self._distances(others))
        return _split(merged[0], measured.corners + others.corners, merged[1])

    def _contacts(self, state: RobotState, among: Sequence[int] | None, close: float
                  ) -> '_Contacts':
        """Return Coal's contacts of near pairs, among those with given indices or all."""
        pairs: list[int] = []
        contacts: list[coal.Contact] = []
        for batch in self._batches:
            some = batch.near(state, among)
            pairs += some
            contacts += batch.contacts(some)
        found = _Contacts(pairs, [0] * len(pairs),
                          [contact.penetration_depth for contact in contacts],
                          [contact.normal for contact in contacts],
                          [contact.pos for contact in contacts])
        for row in [row for row, depth in enumerate(found.depths) if depth < close]:
            pair, way = pairs[row], found.ways[row]
            if math.isfinite(way.dot(way)):
                for number, corner in enumerate(self._batch(pair).corners(pair, way), 1):
                    found.add(pair, number, found.depths[row], way, corner)
        return found

    def _distances(self, contacts: '_Contacts') -> Distances:
        """Return contacts as distances."""
        # Coal's normals go from the first to the second.
        found = Distances(contacts.pairs, contacts.corners, np.array(contacts.depths),
                          -_rows(contacts.ways), _rows(contacts.points))
        if not math.isfinite(found.normals.sum()):
            self._guess(found)
        return found

    def _guess(self, near: Distances) -> None:
        """Estimate the distances that Coal did not find."""
        near.points = near.points.copy()
        for row in np.flatnonzero(~np.isfinite(near.normals.sum(axis=1))).tolist():
            pair = near.pairs[row]
            near.distances[row] = 0.0
            near.normals[row], near.points[row] = self._batch(pair).guess(pair)

    def _batch(self, pair: int) -> '_Batch':
        """Return the batch that contains a pair."""
        return self._batches[pair // PAIRS_PER_BATCH]


class _Contacts(NamedTuple):
    """Pairs and numbers of corners as in `Distances`; depths, normals and points as Coal's."""

    pairs: list[int]
    corners: list[int]
    depths: list[float]
    ways: list[Array]
    points: list[Array]

    def add(self, pair: int, corner: int, depth: float, way: Array, point: Array) -> None:
        """Add one more contact."""
        self.pairs.append(pair)
        self.corners.append(corner)
        self.depths.append(depth)
        self.ways.append(way)
        self.points.append(point)


class _Batch:
    """
    Batch of the pairs of a `Clearance`.

    Creating and evaluating all pairs are calls into C++ that no other thread of Python can
    interrupt: 60 ms for the 5,640 pairs of TIAGo with two arms.
    """

    def __init__(self, kinematics: Kinematics, solids: Sequence[Solid],
                 pairs: Sequence[tuple[int, int]], start: int, within: float) -> None:
        self._kinematics, self._given, self._start = kinematics, pairs, start
        self.names = [f'{solids[one].name} – {solids[other].name}' for one, other in pairs]
        self.indices = np.array(pairs, dtype=int).T
        # {index of a solid: that of its object in the model}
        self._objects = {solid: index for index, solid in enumerate(sorted(
            {solid for pair in pairs for solid in pair}))}
        self._solids = [solids[solid] for solid in self._objects]
        self._pairs = [(self._objects[one], self._objects[other]) for one, other in pairs]
        self._model = pinocchio.GeometryModel()
        for index, each in enumerate(self._solids):
            self._model.addGeometryObject(pinocchio.GeometryObject(
                str(index), *self._placed(each), each.geometry))
        for one, other in self._pairs:
            self._model.addCollisionPair(pinocchio.CollisionPair(one, other))
        self._data = self._model.createData()
        request = coal.CollisionRequest(coal.CONTACT, 1)
        # Solids nearer than the margin count as colliding; beyond the bound the search ends early.
        request.security_margin = request.distance_upper_bound = within
        request.gjk_tolerance = DISTANCE_TOLERANCE
        patch_request = coal.ContactPatchRequest()
        patch_request.setPatchTolerance(PATCH_TOLERANCE)
        # Pinocchio's own requests start from the previous result, so distances depend on it.
        requests, patch_requests = self._data.collisionRequests, self._data.contactPatchRequests
        for index in range(len(pairs)):
            requests[index], patch_requests[index] = request, patch_request
        # Created once: iterating over Pinocchio's own lists costs 1 µs per pair.
        self._results = list(self._data.collisionResults)
        self._patches = list(self._data.contactPatchResults)

    def _placed(self, each: Solid) -> tuple[int, pinocchio.SE3]:
        """Return the joint that moves a solid, and the placement of the solid on it."""
        joint, placement = self._kinematics.attachment(each.frame)
        return joint, placement * pinocchio.SE3(each.pose)

    def take(self, solids: Sequence[Solid], pairs: list[tuple[int, int]]) -> bool:
        """
        Replace the solids by those of another clearance, with other poses on their frames.

        Return False, without any change, if the solids or their pairs differ otherwise.
        """
        if pairs != self._given:
            return False
        after = [solids[index] for index in self._objects]
        if not all(map(_same, self._solids, after)):
            return False
        for number, (old, new) in enumerate(zip(self._solids, after)):
            if new is not old:
                self._model.geometryObjects[number].placement = self._placed(new)[1]
        self._solids = after
        return True

    def near(self, state: RobotState, among: Sequence[int] | None = None) -> list[int]:
        """Return the indices of the pairs nearer than `within`, among given ones or all."""
        start, end = self._start, self._start + len(self._pairs)
        pairs = range(start, end) if among is None else \
            among[bisect_left(among, start):bisect_left(among, end)]
        if not pairs:
            return []
        state.place(self._model, self._data)
        if len(pairs) > MANY * len(self._pairs):
            # This loop in C++ ends early for far pairs. Excluding these in numpy took longer.
            pinocchio.computeCollisions(self._model, self._data, False)
            return [pair for pair in pairs if self._results[pair - start].isCollision()]
        return [pair for pair in pairs
                if pinocchio.computeCollision(self._model, self._data, pair - start)]

    def contacts(self, pairs: Sequence[int]) -> list[coal.Contact]:
        """Return Coal's contacts of near pairs."""
        return [self._results[pair - self._start].getContact(0) for pair in pairs]

    def corners(self, pair: int, way: Array) -> list[Array]:
        """
        Return the corners of the contact patch of a pair; empty if that is a point.

        `way` is the normal of Coal's contact.
        """
        for index in self._pairs[pair - self._start]:
            if not isinstance(self._solids[index].geometry, coal.Cylinder):
                continue
            T = self._data.oMg[index]
            if T.rotation[:, 2].dot(way) < 0.0:
                # Coal orders the points of a cylinder's end in the axes of the cylinder, and finds
                # no patch if that direction is wrong. Half a turn about x corrects only that.
                self._data.oMg[index] = T * HALF_TURN
        pinocchio.computeContactPatch(self._model, self._data, pair - self._start)
        patch = self._patches[pair - self._start].getContactPatch(0)
        return [patch.getPoint(index) for index in range(patch.size())] if patch.size() > 1 else []

    def guess(self, pair: int) -> tuple[Array, Array]:
        """Estimate a normal and a point for solids whose distance Coal did not find."""
        first, second = self._pairs[pair - self._start]
        one, other = self._data.oMg[first], self._data.oMg[second]
        plane = isinstance(self._solids[second].geometry, coal.Halfspace)
        away = other.rotation[:, 2] if plane else one.translation - other.translation
        return away / (math.sqrt(away.dot(away)) or 1.0), one.translation


def _compiled(kinematics: Kinematics, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]],
              within: float) -> CompiledClearance | None:
    """Return a clearance in the core; None without a core, or if there are too many solids."""
    if core is None or not pairs or len(solids) > MOST:
        return None
    found: CompiledClearance = core.Clearance(
        np.array([[kinematics.frame_index(solid.frame), *solid.numbers] for solid in solids]),
        list(pairs), within)
    return found


def _merged(one: Distances, other: Distances) -> Distances:
    """
    Return distances sorted by pair, then the corners, which only `other` has.

    `CompiledClearance.merge` computes the same.
    """
    pairs = one.pairs + other.pairs
    nearest = len(one.pairs) + other.corners.count(0)
    order = [*sorted(range(nearest), key=pairs.__getitem__), *range(nearest, len(pairs))]
    return Distances([pairs[row] for row in order], one.corners + other.corners,
                     *(np.concatenate(both)[order] for both in (
                         (one.distances, other.distances), (one.normals, other.normals),
                         (one.points, other.points))))


def _split(pairs: list[int], corners: list[int], numbers: bytes) -> Distances:
    """Return the distances of pairs from the numbers of the core."""
    m, found = len(pairs), np.frombuffer(numbers)
    return Distances(pairs, corners, found[:m], found[m:4 * m].reshape(m, 3),
                     found[4 * m:].reshape(m, 3))


def _rows(vectors: Sequence[Array]) -> Array:
    """Return vectors (3,) as a matrix (m, 3), a read-only copy, in a third of numpy's time."""
    return np.frombuffer(b''.join(vectors)).reshape(-1, 3)  # type: ignore[arg-type]


def _same(one: Solid, other: Solid) -> bool:
    """Return whether two solids are equal except for their poses."""
    return one is other or bool((one.name, one.frame) == (other.name, other.frame)
                                and one.geometry == other.geometry)

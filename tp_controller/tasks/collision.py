# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Base class of the tasks of collision avoidance: distances of pairs of solid shapes."""

from collections.abc import Sequence

import numpy as np
from tp_controller.model.clearance import Clearance, Distances
from tp_controller.model.robot import Robot
from tp_controller.model.solids import Solid
from tp_controller.model.spatial import Array, cross, skews
from tp_controller.model.state import RobotState
from tp_controller.model.urdf_solids import urdf_solids
from tp_controller.solver.compiled import core
from tp_controller.tasks.bounded import BoundedTask, Observation
from tp_controller.tasks.capsules import parse_capsules
from tp_controller.tasks.keys import Keys, non_negative, positive, UnitRows
from tp_controller.tasks.sketch import Gaps, Sketch
from tp_controller.tasks.task import Task
from tp_controller.tasks.yaml_keys import yaml_key

# Defaults of the keys `distance` and `within` [m].
DEFAULT_DISTANCE = 0.02
DEFAULT_WITHIN = 0.2
# Flat sides nearer than `distance` plus this count with all their corners [m]. In 300 runs of
# benchmarks/inequalities.py 0.005, 0.02 and no limit give the same results; without a limit,
# meshes of Panda take four times as long (1.8 ms instead of 0.45 ms a cycle).
CORNER_MARGIN = 0.02
# Largest number of drawn distances.
MOST_DRAWN = 30
# Largest number of pairs; TIAGo with two arms has 5,690, and 11,200 with 100 obstacles.
MOST_PAIRS = 15_000


class CollisionTask(BoundedTask):
    """
    Base class of tasks that keep pairs of solid shapes a distance apart (lecture 3.1).

    Each pair of shapes nearer than `within` gives one row: the distance d between the nearest
    points p_a and p_b, negative if they overlap, with the velocity ``nᵀ (v_a − v_b)`` along the
    unit normal n from b to a. The cost of pairs farther apart is negligible.
    """

    # The nearest points of flat sides jump from one end to the other. With 0.5 there are more
    # reversals: 1.42/s instead of 1.25/s in 150 runs of benchmarks/inequalities.py.
    jump = 0.06
    needs = ('shapes',)
    sketch_parts = {'distance': False}
    example = {'capsules': 'package://tp_controller/config/panda_capsules.yaml', 'within': 0.5}

    distance: float = yaml_key('least distance allowed', non_negative, DEFAULT_DISTANCE, unit='m')
    within: float = yaml_key('distance below which a pair is considered', positive,
                             DEFAULT_WITHIN, unit='m')
    links: list[str] | None = yaml_key(
        'link, or list of links, to consider (default: all that have shapes)', default=None,
        parse_for=lambda task, links: _links(task.robot, links))
    capsules: dict[str, list[Solid]] = yaml_key(
        'shapes for links, in place of those of the URDF: {link: {from: [x, y, z], to: [x, y, z], '
        'radius: …}}, a list for several, without `to` a sphere, in the frame of the link [m]; or '
        'a file with such a mapping', default=None,
        parse_for=lambda task, capsules: parse_capsules(
            task.robot, {} if capsules is None else capsules))
    units = ('m',)

    def check_keys(self, keys: Keys) -> None:
        """Set the bounds, and the solids of the selected links."""
        super().check_keys(keys)
        self.lower = self.distance
        if None not in (self.distance, self.within) and self.within <= self.distance:
            keys.faults.append(('within', f'must be more than distance = {self.distance:g}, got '
                                          f'{self.within:g}'))
        self._solids = self._selected_solids(keys)

    def set_up(self) -> None:
        """Prepare the distances, of no pairs yet."""
        super().set_up()
        # The number of rows is the number of near pairs.
        self.groups = tuple(UnitRows(slice(None), unit, limit) for _, unit, limit in self.groups)
        self._clearance = Clearance(self.robot.kinematics, [], [], self.within)
        self._ends: list[tuple[int, int]] = []
        # Distances of the last cycle, for sketches: only cycles may use the clearance.
        self._near: Distances | None = None

    def _selected_solids(self, keys: Keys) -> list[Solid]:
        """Return the solids of the selected links, and record faults of the keys."""
        named, given = self.links, self.capsules
        if any(key in ('capsules', 'links') for key, _ in keys.faults):
            return []
        wanted = list(named or self.robot.frame_names)
        drawn = keys.check('links', urdf_solids, self.robot.urdf,
                           [link for link in wanted if link not in given])
        if drawn is None:
            return []
        solids = [each for link in wanted for each in given.get(link, ())] + drawn
        shapeless = [link for link in named or () if all(link != each.frame for each in solids)]
        if shapeless or not solids:
            keys.faults.append((
                'capsules', f'needed for {", ".join(shapeless) or "some links"}: the robot '
                            'description has no collision shapes there'))
        return solids

    def _set_pairs(self, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]]) -> None:
        """Set the pairs of solids."""
        self._clearance = Clearance(self.robot.kinematics, solids, pairs, self.within,
                                    self._clearance)
        indices = [self.robot.kinematics.frame_index(frame) for frame in self._clearance.frames]
        # Indices of the frames of both solids of each pair, for the compiled core.
        self._ends = [(indices[one], indices[other]) for one, other in zip(
            self._clearance.first.tolist(), self._clearance.second.tolist())]

    def observe(self, state: RobotState) -> tuple[Array, Array]:
        """Return the distances of the near pairs (m,) [m], and their Jacobian (m, n)."""
        seen = self.observe_rows(state)
        return seen.value, seen.J

    def observe_rows(self, state: RobotState) -> Observation:
        """Return the `Observation` at a state; rows are named after their pairs."""
        clearance = self._clearance
        near = self._near = clearance.nearest(state, self.distance + CORNER_MARGIN)
        names = [clearance.names[pair] for pair in near.pairs]
        keys = list(zip(names, near.corners))
        J = np.empty((len(keys), self.robot.n))
        if core is None or state.motion is None or not core.parting(
                state.motion, self._ends, near.pairs, near.normals, near.points, J):
            J = rows_of(state, clearance, near)
        return Observation(near.distances, J, names, keys)

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the distances of the last cycle, smallest first."""
        near = self._near
        if near is None:
            return []
        rows = [row for row in near.distances.argsort(kind='stable').tolist()
                if near.corners[row] == 0][:MOST_DRAWN]
        if not rows:
            return []
        half = 0.5 * near.distances[rows, np.newaxis] * near.normals[rows]
        return [Gaps('distance', near.points[rows] + half, near.points[rows] - half,
                     near.distances[rows], self.distance, self.within)]

    def inherit_goal(self, other: Task) -> None:
        """Inherit the goal, and the distances to draw until the next cycle."""
        super().inherit_goal(other)
        if self._near is None and self.is_compatible(other):
            self._near = other._near


def rows_of(state: RobotState, clearance: Clearance, near: Distances) -> Array:
    """Return the Jacobian (m, n) of the distances of near pairs; collision.h computes the same."""
    if not near.pairs:
        return np.zeros((0, len(state.velocity)))
    jacobians = np.array([state.jacobian(frame) for frame in clearance.frames])
    origins = np.array([state.position(frame) for frame in clearance.frames])
    # Velocity of the point of each frame at the origin of the root: v₀ = v − ω × o. It gives
    # nᵀ (v₀ + ω × p) = nᵀ v₀ + (p × n)ᵀ ω for every frame.
    jacobians[:, :3] += skews(origins) @ jacobians[:, 3:]
    relative = jacobians[clearance.first[near.pairs]] - jacobians[clearance.second[near.pairs]]
    twists = np.concatenate([near.normals, cross(near.points, near.normals)], axis=1)
    rows: Array = (twists[:, np.newaxis] @ relative)[:, 0]
    return rows


def _links(robot: Robot, links: str | Sequence[str] | None) -> list[str] | None:
    """Return the links named by a string or list; None for None; raise if invalid."""
    if links is None:
        return None
    links = [links] if isinstance(links, str) else links
    if not isinstance(links, (list, tuple)) or not links:
        raise ValueError(f'needs a link or a list of links, got {links!r}')
    return list(dict.fromkeys(map(robot.check_frame, links)))

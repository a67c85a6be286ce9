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

"""Collision avoidance: distances between links, and from links to obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np
from tp_controller.errors import GoalError, RobotError, unknown
from tp_controller.model.collision import (
    capsule,
    Clearance,
    Distances,
    Solid,
    solid,
    urdf_solids,
)
from tp_controller.model.robot import Robot
from tp_controller.model.shapes import HalfSpace, parse_shape, Shape
from tp_controller.model.spatial import Array, cross, skews
from tp_controller.model.srdf import srdf_pairs
from tp_controller.model.state import RobotState
from tp_controller.resources import load_yaml, read_source
from tp_controller.tasks.bounded import (
    BoundedTask,
    DEFAULT_BOUND_GAIN,
    DEFAULT_RETURN_SPEED,
    Observation,
)
from tp_controller.tasks.frame import parse_reference
from tp_controller.tasks.keys import (
    finite_vector,
    Gain,
    Keys,
    non_negative,
    positive,
    Tolerance,
    UnitRows,
)
from tp_controller.tasks.region import parse_place
from tp_controller.tasks.sketch import Body, Gaps, Sketch
from tp_controller.tasks.task import Evaluation, Task

# Defaults of the keys `distance` and `within` [m].
DEFAULT_DISTANCE = 0.02
DEFAULT_WITHIN = 0.2
# Flat sides nearer than `distance` plus this count with all their corners [m]. In 300 runs of
# benchmarks/inequalities.py 0.005, 0.02 and no limit give the same results; without a limit,
# meshes of Panda take four times as long (1.8 ms instead of 0.45 ms a cycle).
CORNER_MARGIN = 0.02
# Largest number of drawn distances.
MOST_DRAWN = 30
# Number of random postures used to find pairs whose shapes overlap by design. One pair of Panda is
# near in 39 % of the postures: 30 misclassify it in 8 of 100 cases, 100 in 1.
SAMPLED_POSTURES = 100
# Range ± of these postures for joints without limits [rad or m].
SAMPLED_RANGE = math.pi
# Largest number of pairs; TIAGo with two arms has 5,690, and 11,200 with 100 obstacles.
MOST_PAIRS = 15_000
# Largest number of obstacles; each costs time in every cycle.
MOST_OBSTACLES = 100
# Name that stands for all present obstacles in an update.
ALL_OBSTACLES = '*'
CAPSULE_KEYS = ('from', 'to', 'radius')
OBSTACLE_KEYS = ('shape', 'at', 'lifetime')
CAPSULE_FORM = '{from: [x, y, z], to: [x, y, z], radius: …} [m]'
OBSTACLE_FORM = '{shape: {box: [x, y, z]}, at: [x, y, z]} [m]'


class CollisionTask(BoundedTask):
    """
    Base class of tasks that keep pairs of solid shapes a distance apart.

    Each pair of shapes nearer than `within` gives one row: the distance d between the nearest
    points p_a and p_b, negative if they overlap, with the velocity ``nᵀ (v_a − v_b)`` along the
    unit normal n from b to a. The cost of pairs farther apart is negligible.
    """

    # The nearest points of flat sides jump from one end to the other. With 0.5 there are more
    # reversals: 1.42/s instead of 1.25/s in 150 runs of benchmarks/inequalities.py.
    jump = 0.06
    keys = {
        'distance': 'least distance allowed [m]',
        'within': 'distance below which a pair is considered [m]',
        'links': 'link, or list of links, to consider (default: all that have shapes)',
        'capsules': 'shapes for links, in place of those of the URDF: {link: {from: [x, y, z], '
                    'to: [x, y, z], radius: …}}, a list for several, without `to` a sphere, in '
                    'the frame of the link [m]; or a file with such a mapping',
    }

    def __init__(self, robot: Robot, name: str, keys: Keys, *,
                 distance: float = DEFAULT_DISTANCE, within: float = DEFAULT_WITHIN,
                 links: str | Sequence[str] | None = None, capsules: Any = None,
                 gain: Gain = DEFAULT_BOUND_GAIN, return_speed: float = DEFAULT_RETURN_SPEED,
                 tolerance: Tolerance | None = None) -> None:
        self.distance = keys.check('distance', non_negative, distance)
        self.within = keys.check('within', positive, within)
        if None not in (self.distance, self.within) and self.within <= self.distance:
            keys.faults.append(('within', f'must be more than distance = {self.distance:g}, got '
                                          f'{self.within:g}'))
        super().__init__(robot, name, ['m'], keys, self.distance, np.inf, gain=gain,
                         return_speed=return_speed, tolerance=tolerance)
        # The number of rows is the number of near pairs.
        self.groups = tuple(UnitRows(slice(None), unit, limit)
                            for _, unit, limit in self.groups or ())
        self._solids = self._solids_of(keys, links, capsules)
        self._clearance = Clearance(robot.kinematics, [], [], self.within)
        # Distances of the last cycle, for sketches: only cycles may use the clearance.
        self._near: Distances | None = None

    def _solids_of(self, keys: Keys, links: str | Sequence[str] | None,
                   capsules: Any) -> list[Solid]:
        """Return the solids of the selected links, and record faults of the keys."""
        faults = len(keys.faults)
        given = keys.check('capsules', _capsules, self.robot, {} if capsules is None else capsules)
        named = keys.check('links', _links, self.robot, links)
        if len(keys.faults) > faults:
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
        if not near.pairs:
            return Observation(near.distances, np.zeros((0, self.robot.n)), names, keys)
        jacobians = np.array([state.jacobian(frame) for frame in clearance.frames])
        origins = np.array([state.position(frame) for frame in clearance.frames])
        # Velocity of the point of each frame at the origin of the root: v₀ = v − ω × o. It gives
        # nᵀ (v₀ + ω × p) = nᵀ v₀ + (p × n)ᵀ ω for every frame.
        jacobians[:, :3] += skews(origins) @ jacobians[:, 3:]
        relative = jacobians[clearance.first[near.pairs]] \
            - jacobians[clearance.second[near.pairs]]
        twists = np.concatenate([near.normals, cross(near.points, near.normals)], axis=1)
        return Observation(near.distances, (twists[:, np.newaxis] @ relative)[:, 0], names, keys)

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


class SelfCollision(CollisionTask):
    """
    Keep the links of the robot a distance apart.

    Pairs are not checked if at most one moving joint is between their links, if no driven joint
    moves them against each other, if an SRDF or `ignore` names them, or if they are in `left_out`.

    Attributes
    ----------
    pairs : list of str
        Names of the checked pairs.
    left_out : list of str
        Names of pairs nearer than `distance` in most random postures within the joint limits:
        their shapes overlap by design.

    """

    type_name = 'self_collision'
    keys = {
        'srdf': 'SRDF whose disable_collisions name links that may touch: text, a file or '
                'package://<package>/<path>',
        'ignore': 'more pairs of links that may touch, [[link, link], …]',
    }

    def __init__(self, robot: Robot, name: str, *, distance: float = DEFAULT_DISTANCE,
                 within: float = DEFAULT_WITHIN, links: str | Sequence[str] | None = None,
                 srdf: str | None = None, ignore: Sequence[Sequence[str]] | None = None,
                 capsules: Any = None, gain: Gain = DEFAULT_BOUND_GAIN,
                 return_speed: float = DEFAULT_RETURN_SPEED,
                 tolerance: Tolerance | None = None) -> None:
        keys = Keys()
        super().__init__(robot, name, keys, distance=distance, within=within, links=links,
                         capsules=capsules, gain=gain, return_speed=return_speed,
                         tolerance=tolerance)
        harmless: set[frozenset[str]] = set()
        if srdf is not None:
            harmless |= keys.check('srdf', srdf_pairs, srdf) or set()
        if ignore is not None:
            harmless |= keys.check('ignore', _pairs, robot, ignore) or set()
        keys.raise_faults(name)
        pairs = self._candidates(harmless)
        if len(pairs) > MOST_PAIRS:
            keys.faults.append(('links', f'at most {MOST_PAIRS} pairs of shapes, got {len(pairs)}'
                                         ': name fewer links, or pairs that may touch'))
            keys.raise_faults(name)
        near = self._mostly_near(pairs)
        self.left_out = list(near.values())
        self._set_pairs(self._solids, [pair for index, pair in enumerate(pairs)
                                       if index not in near])
        self.pairs = list(self._clearance.names)
        if not self.pairs:
            keys.faults.append(('links', self._no_pairs()))
        keys.raise_faults(name)
        if self.left_out:
            self.remarks = (f'not kept apart, as nearer than distance = {self.distance:g} in most '
                            f'postures: {", ".join(self.left_out)}',)

    def _no_pairs(self) -> str:
        """Return the message about a task without pairs."""
        if self.left_out:
            return (f'all pairs are nearer than distance = {self.distance:g} in most postures: '
                    f'{", ".join(self.left_out)}')
        links = list(dict.fromkeys(each.frame for each in self._solids))
        return ('no two of them can come near each other, or all pairs are ignored: name all '
                f'links that are to be kept apart, got {", ".join(links)}')

    def _candidates(self, harmless: set[frozenset[str]]) -> list[tuple[int, int]]:
        """Return the pairs of solids (int, int) whose links can move against each other."""
        rows = {frame: row for row, frame in enumerate(
            dict.fromkeys(each.frame for each in self._solids))}
        every, driven = self.robot.kinematics.joints_between(list(rows))
        checked = (every > 1.0) & (driven > 0.0)
        for links in harmless:
            if len(links) == 2 and links <= rows.keys():
                one, other = (rows[link] for link in links)
                checked[one, other] = checked[other, one] = False
        row = [rows[each.frame] for each in self._solids]
        return [(one, other) for one, other in np.argwhere(
            np.triu(checked[row][:, row], 1)).tolist()]

    def _mostly_near(self, pairs: Sequence[tuple[int, int]]) -> dict[int, str]:
        """Return {index: name} of the pairs nearer than `distance` in most postures."""
        robot = self.robot
        state = robot.state(robot.neutral())
        clearance = Clearance(robot.kinematics, self._solids, pairs, self.distance)
        times = np.zeros(len(pairs))
        # A fixed seed gives the same postures each time the stack is read.
        chance = np.random.default_rng(0)
        joints = robot.joint_columns
        lower = np.maximum(robot.lower[joints], -SAMPLED_RANGE)
        upper = np.minimum(robot.upper[joints], SAMPLED_RANGE)
        for _ in range(SAMPLED_POSTURES):
            state.update(robot.configuration(chance.uniform(lower, np.maximum(lower, upper))))
            times[clearance.near(state)] += 1
        return {pair: clearance.names[pair]
                for pair in np.flatnonzero(times > 0.5 * SAMPLED_POSTURES).tolist()}


@dataclass(frozen=True, eq=False)
class Obstacle:
    """
    Obstacle of the task `obstacles`.

    Attributes
    ----------
    shape : object
        One of `tp_controller.model.shapes`.
    pose : ndarray (4, 4)
        T_reference_obstacle.
    lifetime : float
        Time after which it is removed [s].
    since : float
        Time of its last update [s].

    """

    shape: Shape
    pose: Array
    lifetime: float = math.inf
    since: float = -math.inf

    def gone(self, now: float) -> bool:
        """Return whether its lifetime has expired."""
        return now - self.since > self.lifetime < math.inf


class Obstacles(CollisionTask):
    """
    Keep the links of the robot a distance away from obstacles.

    A goal changes the obstacles: ``{name: {shape: …, at: …, lifetime: …}}`` adds or moves them,
    ``{name: None}`` removes one, and ``{'*': None}`` removes all.
    """

    type_name = 'obstacles'
    goal_type = 'obstacles'
    keys = {
        'obstacles': '{name: {shape: …, at: …}}, shapes and places as for keep_out, but only a '
                     'half_space needs no place (default: none, they come as goals)',
        'reference': 'frame that the obstacles belong to and move with (default: the root)',
    }

    reference: str

    def __init__(self, robot: Robot, name: str, *, obstacles: Any = None,
                 reference: str | None = None, distance: float = DEFAULT_DISTANCE,
                 within: float = DEFAULT_WITHIN, links: str | Sequence[str] | None = None,
                 capsules: Any = None, gain: Gain = DEFAULT_BOUND_GAIN,
                 return_speed: float = DEFAULT_RETURN_SPEED,
                 tolerance: Tolerance | None = None) -> None:
        keys = Keys()
        self.reference = keys.check('reference', parse_reference, robot, reference)
        super().__init__(robot, name, keys, distance=distance, within=within, links=links,
                         capsules=capsules, gain=gain, return_speed=return_speed,
                         tolerance=tolerance)
        self._fixed = keys.check('obstacles', _obstacles, {} if obstacles is None else obstacles)
        if self.reference is not None:
            _, driven = robot.kinematics.joints_between(
                [self.reference, *(each.frame for each in self._solids)])
            self._solids = [each for each, joints in zip(self._solids, driven[0, 1:])
                            if joints > 0.0]
            if not self._solids and not keys.faults:
                keys.faults.append(('links', 'the joints move none of these links against '
                                             f'{self.reference}'))
        if not keys.faults and len(self._fixed) > self._largest_number():
            keys.faults.append(('obstacles', self._too_many(len(self._fixed))))
        keys.raise_faults(name)
        # Names of the obstacles in the order of their solids.
        self._order: list[str] = []
        self._update_solids()

    @property
    def obstacles(self) -> dict[str, Obstacle]:
        """Return {name: Obstacle} of the present obstacles."""
        return {name: obstacle for name, obstacle in {**self._fixed, **(self.goal or {})}.items()
                if obstacle is not None}

    def _largest_number(self) -> int:
        """Return the largest number of obstacles."""
        return min(MOST_OBSTACLES, MOST_PAIRS // len(self._solids))

    def _too_many(self, count: int) -> str:
        """Return the message about too many obstacles."""
        return f'at most {self._largest_number()} obstacles, got {count}'

    def _update_solids(self) -> None:
        """Update the solids and pairs to the present obstacles."""
        around = self.obstacles
        order = list(self._order)
        for name in [name for name in order if name not in around]:
            # The last one moves to its index. All others keep theirs, so existing pairs are kept.
            last = order.pop()
            if last != name:
                order[order.index(name)] = last
        self._order = order + [name for name in around if name not in order]
        there = [solid(name, self.reference, around[name].shape, around[name].pose)
                 for name in self._order]
        links = len(self._solids)
        self._set_pairs(self._solids + there, [
            (link, links + other) for other in range(len(there)) for link in range(links)])

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        over = [name for name, obstacle in self.obstacles.items() if obstacle.gone(now)]
        if over:
            self.set_goal(dict.fromkeys(over), now)
        return super().make_evaluation(state, now)

    def set_goal(self, goal: dict[str, Obstacle | None], now: float) -> None:
        """Add, move or remove obstacles, as `parse_goal` returned them."""
        # None disables an obstacle of the stack.
        there = dict.fromkeys(self._fixed) if ALL_OBSTACLES in goal else dict(self.goal or {})
        for name, obstacle in goal.items():
            if obstacle is not None:
                there[name] = replace(obstacle, since=now)
            elif name in self._fixed:
                there[name] = None
            else:
                there.pop(name, None)
        super().set_goal(there, now)
        self._update_solids()

    def parse_goal(self, goal: Any) -> dict[str, Obstacle | None]:
        """Return {name: Obstacle or None}, or raise `GoalError`."""
        try:
            changes = _obstacles(goal, removals=True)
        except (GoalError, ValueError) as error:
            raise GoalError(f'the goal of task {self.name!r}: {error}') from error
        left = set() if ALL_OBSTACLES in changes else set(self.obstacles)
        left |= {name for name, obstacle in changes.items() if obstacle is not None}
        if len(left) > self._largest_number():
            raise GoalError(f'the goal of task {self.name!r}: {self._too_many(len(left))}')
        return changes

    def goal_in_reference(self, goal: dict[str, Obstacle | None],
                          T_reference_frame: Array) -> dict[str, Obstacle | None]:
        """Transform obstacles from another frame to the reference frame."""
        return {name: None if obstacle is None else
                replace(obstacle, pose=T_reference_frame.dot(obstacle.pose))
                for name, obstacle in goal.items()}

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the obstacles and the distances of the last cycle."""
        T_root_reference = state.pose(self.reference)
        return [*super().sketch(state),
                *(Body(f'obstacle/{name}', T_root_reference.dot(obstacle.pose), obstacle.shape)
                  for name, obstacle in self.obstacles.items())]

    def inherit_goal(self, other: Task) -> None:
        """Inherit the obstacles that a task that this one replaces received as goals."""
        inherits = self.goal is None and self.is_compatible(other) and other.goal is not None
        super().inherit_goal(other)
        if inherits:
            self.goal = {name: obstacle for name, obstacle in other.goal.items()
                         if obstacle is not None}
            self._update_solids()


def _links(robot: Robot, links: str | Sequence[str] | None) -> list[str] | None:
    """Return the links named by a string or list; None for None; raise if invalid."""
    if links is None:
        return None
    links = [links] if isinstance(links, str) else links
    if not isinstance(links, (list, tuple)) or not links:
        raise ValueError(f'needs a link or a list of links, got {links!r}')
    return list(dict.fromkeys(map(robot.check_frame, links)))


def _pairs(robot: Robot, pairs: Sequence[Sequence[str]]) -> set[frozenset[str]]:
    """Return pairs of links as a set of sets; raise if invalid."""
    if not isinstance(pairs, (list, tuple)) or not all(
            isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in pairs):
        raise ValueError(f'needs pairs of links, [[link, link], …], got {pairs!r}')
    return {frozenset(map(robot.check_frame, pair)) for pair in pairs}


def _capsules(robot: Robot, capsules: Any) -> dict[str, list[Solid]]:
    """Return {link: list of Solid}; raise if invalid; `capsules` may name a file."""
    if isinstance(capsules, str):
        capsules = _load(capsules)
    if not isinstance(capsules, dict):
        raise ValueError(f'needs a mapping {{link: {CAPSULE_FORM}}}, got {capsules!r}')
    solids = {}
    for link, several in capsules.items():
        robot.check_frame(link)
        several = several if isinstance(several, list) else [several]
        if not several:
            raise ValueError(f'{link} needs {CAPSULE_FORM}, got []')
        solids[link] = [
            _capsule(link + (f'[{index}]' if len(several) > 1 else ''), link, each)
            for index, each in enumerate(several, 1)]
    return solids


def _load(source: str) -> Any:
    """Return the value of a YAML text or file, or raise ValueError."""
    try:
        text = read_source(source, lambda text: '{' in text)
    except OSError as error:
        raise ValueError(str(error)) from error
    try:
        return load_yaml(text)
    except ValueError as error:
        raise ValueError(str(error) if text is source else f'{source}: {error}') from error


def _capsule(name: str, link: str, keys: Any) -> Solid:
    """Return the solid of one capsule, or raise ValueError."""
    _check_form(name, keys, CAPSULE_KEYS, {'from', 'radius'}, CAPSULE_FORM)
    try:
        start = finite_vector(keys['from'], 3, 'from')
        end = finite_vector(keys.get('to', start), 3, 'to')
        return capsule(name, link, start, end, _positive('radius', keys['radius']))
    except (GoalError, ValueError) as error:
        raise ValueError(f'{name}: {error}') from error


def _obstacles(given: Any, removals: bool = False) -> dict[str, Obstacle | None]:
    """Return {name: Obstacle}, None for an obstacle to remove; raise if invalid."""
    if not isinstance(given, dict):
        raise ValueError(f'needs a mapping {{name: {OBSTACLE_FORM}}}, got {given!r}')
    return {_name(name, keys, removals): _obstacle(name, keys, removals)
            for name, keys in given.items()}


def _name(name: object, keys: object, removals: bool) -> str:
    """Return the name of an obstacle, or raise ValueError."""
    if not isinstance(name, str) or not name \
            or (name == ALL_OBSTACLES and not (removals and keys is None)):
        raise ValueError(f'an obstacle needs a name, got {name!r}')
    return name


def _obstacle(name: str, keys: Any, removals: bool) -> Obstacle | None:
    """Return one obstacle, None to remove it, or raise ValueError."""
    if removals and keys is None:
        return None
    _check_form(name, keys, OBSTACLE_KEYS if removals else OBSTACLE_KEYS[:2], {'shape'},
                OBSTACLE_FORM)
    try:
        shape, lifetime = parse_shape(keys['shape']), math.inf
        if 'lifetime' in keys:
            lifetime = _positive('lifetime', keys['lifetime'])
        if keys.get('at') is not None:
            return Obstacle(shape, parse_place(keys['at']), lifetime)
        # Only a half-space, such as the floor, has a default place.
        if not isinstance(shape, HalfSpace):
            raise ValueError(f'needs a place, {OBSTACLE_FORM}')
        return Obstacle(shape, np.eye(4), lifetime)
    except (GoalError, ValueError, RobotError) as error:
        raise ValueError(f'{name}: {error}') from error


def _check_form(name: str, keys: Any, valid: Sequence[str], needed: set[str],
                form: str) -> None:
    """Raise ValueError if a needed key is missing, or a key is invalid."""
    if not isinstance(keys, dict):
        raise ValueError(f'{name} needs {form}, got {keys!r}')
    for key in keys:
        if key not in valid:
            raise ValueError(f'{name}: {unknown("key", key, valid)}')
    if not needed <= set(keys):
        raise ValueError(f'{name} needs {form}, got {keys!r}')


def _positive(key: str, value: object) -> float:
    """Return a positive float, or raise a ValueError that names the key."""
    try:
        return positive(value)
    except ValueError as error:
        raise ValueError(f'{key} {error}') from error

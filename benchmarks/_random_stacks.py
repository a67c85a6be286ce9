# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Random stacks of all registered task types, on robots of example-robot-data.

Types are not named here: a type declares its keys, each key is drawn by its name, and the type
refuses what does not go together. A required key without an entry in `KEYS` has the value of the
example of its type.
"""

from functools import lru_cache
from inspect import Parameter
from pathlib import Path
from typing import Any
import zlib

from _robots import example_urdf
import numpy as np
from scipy.spatial.transform import Rotation
from tp_controller import GoalError, Robot, Stack, StackError
from tp_controller.tasks import BoundedTask, Task, task_types
import yaml

# Paths below robots/ of example-robot-data.
ROBOTS = (
    'a1_description/urdf/a1.urdf', 'alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf',
    'allegro_hand_description/urdf/allegro_left_hand.urdf',
    'anymal_b_simple_description/robots/anymal-kinova.urdf', 'b1_description/urdf/b1-z1.urdf',
    'baxter_description/urdf/baxter.urdf', 'bolt_description/robots/bolt.urdf',
    'borinot_description/urdf/borinot_flying_arm_2.urdf',
    'g1_description/urdf/g1_29dof_rev_1_0.urdf', 'go2_description/urdf/go2.urdf',
    'hextilt_description/urdf/hextilt_flying_arm_5.urdf',
    'hyq_description/robots/hyq_no_sensors.urdf', 'icub_description/robots/icub_reduced.urdf',
    'kinova_description/robots/kinova.urdf', 'panda_description/urdf/panda.urdf',
    'romeo_description/urdf/romeo_small.urdf', 'so_arm_description/urdf/so101.urdf',
    'solo_description/robots/solo12.urdf', 'talos_data/robots/talos_left_arm.urdf',
    'talos_data/robots/talos_reduced.urdf', 'tiago_description/robots/tiago_no_hand.urdf',
    'tiago_pro_description/robots/tiago_pro.urdf',
    'ur_description/urdf/ur5_robot.urdf', 'ur_description/urdf/ur10_joint_limited_robot.urdf',
    'xarm_description/urdf/xarm7.urdf', 'z1_description/urdf/z1.urdf')
BASES = 'fixed', 'fixed', 'planar', 'floating'
RATES = 20, 50, 100, 100, 250, 1000
ACCELERATIONS = None, None, 5.0, 15.0, 60.0
# Fewest and most tasks.
LEVELS = 2, 6
# How often a task shares the level above, a key with a default is drawn, a task keeps its default
# goal, and has a feed-forward velocity.
SHARED, GIVEN, DEFAULT, LEADING = 0.15, 0.25, 0.15, 0.1
# Where goals come from: positions of the joints within their limits, in ranges twice as wide, or
# the same with all places `FARTHER` away.
GOALS = 'within', 'outside', 'far'
FARTHER = 3.0
# Largest feed-forward velocities [m/s or rad/s], in force for ever [s].
FASTEST, FOREVER = 0.2, 1e5
# Random postures that show which frames the joints move, and tries to find keys that fit.
POSTURES, TRIES = 3, 12


class Drawn:
    """
    A robot, a start, a stack and its goals, drawn from a generator of its own.

    Attributes
    ----------
    robot : Robot
    rate : int
        Cycles per second.
    acceleration : float or None
        Limit of every joint, and the base [rad/s² or m/s²].
    start : ndarray (nq,)
    entries : list of list of dict
        The stack, as YAML gives it.
    goals, leading : dict
        {task: goal}, {task: feed-forward velocity}.

    """

    def __init__(self, number: int, seed: int = 0) -> None:
        self.random = np.random.default_rng((zlib.crc32(b'stacks'), number, seed))
        self.path = ROBOTS[number % len(ROBOTS)]
        self.base = str(self.random.choice(BASES))
        self.rate = int(self.random.choice(RATES))
        self.acceleration = self.random.choice(np.array(ACCELERATIONS, dtype=object))
        self.robot = _robot(self.path, self.base, self.acceleration)
        self.start = self.place()
        self.state = self.robot.state(self.start)
        moved = _moved(self.path, self.base)
        self.frames = [str(each) for each in self.random.choice(
            moved, min(3, len(moved)), replace=False)]
        self.goals: dict[str, Any] = {}
        self.leading: dict[str, Any] = {}
        self.entries: list[list[dict[str, Any]]] = []
        for count in range(int(self.random.integers(*LEVELS, endpoint=True))):
            self._add(f't{count}')

    def place(self, widened: float = 0.0) -> np.ndarray:
        """Return a random configuration (nq,); `widened` as a share of the range of each joint."""
        return _place(self.robot, self.random, widened)

    def stack(self) -> Stack:
        """Return the stack."""
        return Stack.from_yaml(_text(self.entries), self.robot)

    @property
    def name(self) -> str:
        """Return the robot, and its base."""
        return f'{Path(self.path).stem}, {self.base}'

    @property
    def title(self) -> str:
        """Return the types, the highest priority first."""
        levels = ['+'.join(_kind(task) for task in level) for level in self.entries]
        return ' > '.join(levels)

    def _add(self, name: str) -> None:
        """Add a task of a random type, with keys and a goal that it accepts."""
        types = task_types()
        for _ in range(TRIES):
            kind = types[str(self.random.choice(sorted(types)))]
            entry = {name: {'type': kind.type_name, **self._keys(kind)}}
            entries = [*self.entries, [entry]]
            if self.entries and self.random.random() < SHARED:
                entries = [*self.entries[:-1], [*self.entries[-1], entry]]
            try:
                task = Stack.from_yaml(_text(entries), self.robot).tasks[name]
            except StackError:
                continue
            if self._aim(task):
                self.entries = entries
                return

    def _keys(self, kind: type[Task]) -> dict[str, Any]:
        """Return the required keys of a type, and some that can be left out."""
        keys = {}
        # Joints are drawn as rows, not as masks.
        drawn = KEYS.keys() - ({'joints'} if kind.used_joints else set())
        for key, default in kind.accepted_keys().items():
            if default is Parameter.empty or key in ALWAYS or (
                    key in drawn and self.random.random() < GIVEN):
                keys[key] = KEYS[key](self) if key in KEYS else kind.example[key]
        if 'capsules' in keys:
            keys['links'] = list(keys['capsules'])
        return keys

    def _aim(self, task: Task) -> bool:
        """Draw goal and feed-forward velocity of a task; return False where it refuses them."""
        random = self.random
        try:
            task.start(self.state)
            if task.goal_type and random.random() > DEFAULT:
                self.goals[task.name] = goal = GOAL[task.goal_type](self, task)
                task.parse_goal(goal)
            if task.feed_forward_type and random.random() < LEADING:
                size = 6 if task.feed_forward_type == 'twist' else task.rows
                self.leading[task.name] = random.uniform(-FASTEST, FASTEST, size)
        except GoalError:
            self.goals.pop(task.name, None)
            return False
        return True


# Keys and goals ----------------------------------------------------------------------------


def _capsules(drawn: Drawn) -> dict[str, Any]:
    """Return capsules for the frames."""
    return {frame: {'from': [0.0, 0.0, 0.0], 'to': drawn.random.uniform(-0.1, 0.1, 3).tolist(),
                    'radius': float(drawn.random.uniform(0.02, 0.06))} for frame in drawn.frames}


def _contacts(drawn: Drawn) -> dict[str, Any]:
    """Return the corners of a foot, fixed to one of the frames."""
    x, y = drawn.random.uniform(0.1, 0.5, 2).tolist()
    return {_frame(drawn): [[x, y, 0.0], [-x, y, 0.0], [-x, -y, 0.0], [x, -y, 0.0]]}


def _joints(drawn: Drawn) -> list[str]:
    """Return the names of some joints."""
    count = drawn.random.integers(1, max(2, len(drawn.robot.joint_names) // 2))
    return [str(each) for each in drawn.random.choice(
        drawn.robot.joint_names, min(count, len(drawn.robot.joint_names)), replace=False)]


def _minimum(drawn: Drawn) -> float:
    """Return a share of the manipulability of a frame at the start, or more than there is."""
    J = drawn.state.jacobian(drawn.frames[0])
    singular = np.linalg.svd(J, compute_uv=False)
    return float(max(np.prod(singular), 1e-4) * drawn.random.uniform(0.3, 2.0))


def _shape(drawn: Drawn) -> Any:
    """Return a shape of any kind."""
    x, y, z = drawn.random.uniform(0.1, 0.8, 3).tolist()
    return ({'box': [x, y, z]}, {'sphere': x}, {'cylinder': [x, y]}, 'half_space')[
        drawn.random.integers(4)]


def _frame(drawn: Drawn) -> str:
    """Return one of the frames."""
    return str(drawn.random.choice(drawn.frames))


def _uniform(lower: float, upper: float) -> Any:
    """Return what draws a number."""
    return lambda drawn: float(drawn.random.uniform(lower, upper))


def _one_of(*choices: Any) -> Any:
    """Return what draws one of these."""
    return lambda drawn: choices[drawn.random.integers(len(choices))]


# {key: what draws it}; those of `ALWAYS` even where they can be left out.
KEYS = {
    'frame': _frame, 'reference': _frame, 'joints': _joints, 'shape': _shape,
    'capsules': _capsules, 'contacts': _contacts, 'minimum': _minimum,
    'half_angle': _uniform(0.2, 1.0), 'linear': _uniform(0.02, 0.3),
    'angular': _uniform(0.1, 1.0), 'margin': _uniform(0.0, 0.3),
    'radius': _uniform(0.0, 0.05), 'distance': _uniform(0.0, 0.1), 'max_speed': _uniform(0.1, 1.0),
    'gain': _uniform(0.5, 5.0), 'mode': _one_of('least_squares', 'scale'),
    'axis': _one_of('x', '-y', 'z'), 'up': _one_of('x', '-y', 'z'),
    'towards': _one_of('direction', 'point'), 'timeout': _uniform(FOREVER, FOREVER),
    'axes': _one_of('x', 'yz', 'xyz', 'z', ['z', 'rx'], ['x', 'ry', 'rz'])}
ALWAYS = 'gain', 'capsules', 'linear', 'timeout'


def _somewhere(drawn: Drawn, task: Task) -> Any:
    """Return the value that a task has at some joint positions, or farther away."""
    kind = drawn.random.choice(GOALS)
    value = np.array(task.value(drawn.robot.state(drawn.place(0.5 * (kind != 'within')))))
    if kind == 'far' and task.goal_type in ('point', 'pose'):
        value[..., -1 if value.ndim == 2 else slice(None)][:3] *= FARTHER
    return value


def _point(drawn: Drawn, task: Task) -> np.ndarray:
    """Return a point (3,), of an inequality task near where its frame can be."""
    if not isinstance(task, BoundedTask):
        return np.asarray(_somewhere(drawn, task))
    state = drawn.robot.state(drawn.place())
    assert task.frame is not None
    return np.asarray(state.position(task.frame) + 0.3 * drawn.random.normal(size=3))


def _pose(drawn: Drawn, task: Task) -> np.ndarray:
    """Return a pose (4, 4), of an inequality task near where its frame can be."""
    if not isinstance(task, BoundedTask):
        return np.asarray(_somewhere(drawn, task))
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=drawn.random).as_matrix()
    T[:3, 3] = _point(drawn, task)
    return T


def _obstacles(drawn: Drawn, task: Task) -> dict[str, Any]:
    """Return up to three obstacles near the frames."""
    obstacles = {}
    for count in range(int(drawn.random.integers(1, 4))):
        place = drawn.robot.state(drawn.place()).position(_frame(drawn))
        quaternion = Rotation.random(random_state=drawn.random).as_quat()
        obstacles[f'o{count}'] = {'shape': _shape(drawn), 'at': [*place, *quaternion]}
    return obstacles


def _velocity(drawn: Drawn, task: Task) -> np.ndarray:
    """Return a velocity of each row."""
    return np.asarray(drawn.random.uniform(-FASTEST, FASTEST, task.rows))


# {type of goal: what draws it}
GOAL = {'point': _point, 'pose': _pose, 'quaternion': _somewhere, 'direction': _somewhere,
        'joints': _somewhere, 'obstacles': _obstacles, 'joint_velocities': _velocity}


# Robots ------------------------------------------------------------------------------------


@lru_cache(maxsize=None)
def _robot(path: str, base: str, acceleration: float | None) -> Robot:
    """Return a robot; made once."""
    urdf = example_urdf(path)
    if acceleration is None:
        return Robot.from_urdf(urdf, base=base)
    names = _robot(path, base, None).velocity_names
    return Robot.from_urdf(urdf, base=base, limits={
        name: {'acceleration': acceleration} for name in names})


@lru_cache(maxsize=None)
def _moved(path: str, base: str) -> list[str]:
    """Return the frames that at least three driven joints move, or as many as there are."""
    robot, random = _robot(path, base, None), np.random.default_rng(0)
    columns = np.zeros((len(robot.frame_names), robot.n), dtype=bool)
    for _ in range(POSTURES):
        state = robot.state(_place(robot, random))
        columns |= [np.abs(state.jacobian(frame)).max(axis=0) > 1e-6
                    for frame in robot.frame_names]
    counts = columns[:, robot.joint_columns].sum(axis=1)
    return [frame for frame, count in zip(robot.frame_names, counts)
            if count >= min(3, counts.max())]


def _place(robot: Robot, random: np.random.Generator, widened: float = 0.0) -> np.ndarray:
    """Return a random configuration (nq,); joints without end and turns are within ±π."""
    lower, upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    wider = widened * (upper - lower)
    zero = robot.configuration(np.zeros(len(robot.joint_names)))
    return robot.integrate(zero, random.uniform(lower - wider, upper + wider), 1.0)


# Text --------------------------------------------------------------------------------------


def _kind(task: dict[str, Any]) -> str:
    """Return the type of an entry."""
    (keys,) = task.values()
    return str(keys['type'])


def _text(entries: list[list[dict[str, Any]]]) -> str:
    """Return a stack as YAML."""
    levels = [level if len(level) > 1 else level[0] for level in entries]
    return str(yaml.safe_dump(levels, sort_keys=False))

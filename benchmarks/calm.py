# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Send goals, most of them out of reach, and measure whether the robot comes to rest.

Run as ``python benchmarks/calm.py``; ``--goals 10 --rates 20 100`` for a first impression. The
loop is closed, the stack is tool pose > posture; for the planar arm the tool task is a position in
its plane. Every run draws a start and a goal. The number of the goal says which kind it is:

far (every second goal)
    A position out of reach: in a random direction from the root, 1.1 to 2 times as far away as the
    tool reaches. For a moving base: within ± 2 m in x and y, and 1.1 to 2 times as far above or
    below the middle of the heights that the tool reaches. The orientation is random.
turned (every fourth goal)
    A position that the tool has at random joint positions, with a random orientation. Some of
    these goals can be reached. For the planar arm: 1 to 1.1 times as far away as it reaches.
outside (every fourth goal)
    A pose that the tool has at joint positions drawn from ranges twice as wide as the limits. Some
    of these goals can be reached. For the planar arm: as turned.

The goal stays the same. The first 10 s are not measured, the next 2 s are (1 s at 1000 Hz).
Counted are, per second and for the joint that has most of them:

reversal
    A cycle in which a velocity that rose falls, or that fell rises, both by more than 0.01 rad/s
    (m/s).
flip
    A cycle in which a velocity changes its sign, with more than 0.01 rad/s (m/s) before and after.
swing
    A rise of a velocity that a fall by more than 0.01 rad/s (m/s) follows, or the other way round,
    however many cycles they take.

A run with at most one reversal per second is calm. Every run can be repeated alone:
``calm.run('Panda', 100, None, 7)``.

``--stacks 1000`` measures random stacks of all registered task types instead, on fixed, planar and
floating bases (`_random_stacks`); ``calm.run_stack(7)`` repeats one.
"""

import argparse
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
import math
import multiprocessing
import re
import time
import zlib

from _motion import reversals, sign_flips, swings
from _random_stacks import Drawn
from _robots import load_robot
import numpy as np
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.tasks import task_types

# {robot: tool}
TOOLS = {
    'Panda': 'panda_hand_tcp', 'UR5': 'tool0', 'Talos arm': 'gripper_left_base_link',
    'TIAGo': 'arm_tool_link', 'Baxter': 'left_gripper', 'planar 3R': 'link3',
    'TIAGo on wheels': 'arm_tool_link',
}
PLANAR = 'planar 3R'
RATES = 20, 100, 1000
ACCELERATIONS = None, 15.0
GOALS = 40
# What is waited for, and what is measured [s].
SETTLING, MEASURED = 10.0, 2.0
MEASURED_AT_MOST = 1000
CALM = 1.0
KINDS = 'far', 'turned', 'far', 'outside'
# A base starts, and has its goals, within ± this in x and y [m].
AREA = 2.0
SAMPLES = 2000
# What commands go through: cycles they come late, time constant of the actuators [s], noise on
# the measured positions [rad or m].
PLANTS = {'ideal': (0, 0.0, 0.0), 'delay1': (1, 0.0, 0.0), 'delay2': (2, 0.0, 0.0),
          'lag': (0, 0.05, 0.0), 'lag10': (0, 0.01, 0.0), 'noise': (0, 0.0, 1e-4)}
# Exponents of random weights.
WEIGHTS = -2.0, 2.0


@dataclass(frozen=True)
class Run:
    """What came of one run: per second, and of the velocity [rad/s or m/s]."""

    robot: str
    rate: int
    acceleration: float | None
    number: int
    kind: str
    reversals: float
    flips: float
    swings: float
    # Largest change within a cycle, and largest velocity.
    jump: float
    fastest: float

    @property
    def calm(self) -> bool:
        """Say whether the robot came to rest."""
        return self.reversals <= CALM


class Scene:
    """What a run is about, drawn from a generator of its own."""

    def __init__(self, name: str, rate: int, acceleration: float | None, number: int,
                 seed: int = 0, jerk: float | None = None) -> None:
        self.name, self.rate, self.kind = name, rate, KINDS[number % len(KINDS)]
        self.random = np.random.default_rng(
            (zlib.crc32(name.encode()), rate, int(acceleration or 0), number, seed))
        self.robot, self.tool = _robot(name, acceleration, jerk), TOOLS[name]
        self.start = self.place()
        if name == PLANAR:
            self.goal = self._goal_in_plane()
        else:
            self.goal = np.eye(4)
            self.goal[:3, :3] = Rotation.random(random_state=self.random).as_matrix()
            getattr(self, f'_{self.kind}')()
        # Drawn last, so that start and goal are the same with and without them.
        self.weights = self._weights()

    def place(self, widened: float = 0.0) -> np.ndarray:
        """Return a random configuration (nq,); `widened` as a share of the range of each joint."""
        return _place(self.robot, self.random, widened)

    def stack(self) -> Stack:
        """Return the stack."""
        wanted = 'position, axes: xy' if self.name == PLANAR else 'pose'
        return Stack.from_yaml(f"""
- tool: {{type: {wanted}, frame: {self.tool}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
""", self.robot)

    def settings(self, weighted: bool) -> Settings:
        """Return the settings."""
        return Settings(period=1.0 / self.rate, braking_gain=min(10.0, float(self.rate)),
                        weights=tuple(self.weights) if weighted else ())

    def _far(self) -> None:
        """Set a position out of reach."""
        middle, reach = _reach(self.name)
        beyond = reach * self.random.uniform(1.1, 2.0)
        if self.robot.moves:
            self.goal[:2, 3] = self.random.uniform(-AREA, AREA, 2)
            self.goal[2, 3] = middle + self.random.choice((-1.0, 1.0)) * beyond
            return
        way = self.random.normal(size=3)
        self.goal[:3, 3] = beyond * way / np.linalg.norm(way)

    def _turned(self) -> None:
        """Set a position within reach."""
        self.goal[:3, 3] = self.robot.state(self.place()).position(self.tool)

    def _outside(self) -> None:
        """Set a pose that joints would have outside of their limits."""
        self.goal = self.robot.state(self.place(0.5)).pose(self.tool)

    def _goal_in_plane(self) -> np.ndarray:
        """Return a goal (3,) for the planar arm."""
        shares = (1.1, 2.0) if self.kind == 'far' else (1.0, 1.1)
        angle = self.random.uniform(-np.pi, np.pi)
        distance = _reach(self.name)[1] * self.random.uniform(*shares)
        return distance * np.array([math.cos(angle), math.sin(angle), 0.0])

    def _weights(self) -> np.ndarray:
        """Return random weights (n,), of a base alone where one moves."""
        weights = 10.0 ** self.random.uniform(*WEIGHTS, self.robot.n)
        if self.robot.moves:
            weights[self.robot.joint_columns] = 1.0
        return weights


def _place(robot: Robot, random: np.random.Generator, widened: float = 0.0) -> np.ndarray:
    """Return a random configuration (nq,); joints without end and the yaw are within ±π."""
    lower, upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    if robot.moves:
        lower[:2], upper[:2] = -AREA, AREA
    wider = widened * (upper - lower)
    return random.uniform(lower - wider, upper + wider)


@lru_cache(maxsize=None)
def _robot(name: str, acceleration: float | None, jerk: float | None = None) -> Robot:
    """Return a robot; made once."""
    return load_robot(name, acceleration, jerk=jerk)


@lru_cache(maxsize=None)
def _reach(name: str) -> tuple[float, float]:
    """
    Return what the reach of a tool is measured from, and how far it goes [m].

    With a base that moves these are heights, else distances from the root.
    """
    robot, random = _robot(name, None), np.random.default_rng(0)
    if name == PLANAR:
        return 0.0, float(np.linalg.norm(robot.state(np.zeros(robot.nq)).position(TOOLS[name])))
    state, positions = robot.state(robot.neutral()), np.empty((SAMPLES, 3))
    for position in positions:
        state.update(_place(robot, random))
        position[:] = state.position(TOOLS[name])
    if robot.moves:
        least, most = float(positions[:, 2].min()), float(positions[:, 2].max())
        return 0.5 * (least + most), 0.5 * (most - least)
    return 0.0, float(np.linalg.norm(positions, axis=1).max())


class Plant:
    """A robot that does what it is told, late or not at once."""

    def __init__(self, scene: Scene | Drawn, kind: str) -> None:
        self._robot, self._random = scene.robot, scene.random
        self._period = 1.0 / scene.rate
        late, self._lag, self._noise = PLANTS[kind]
        self._waiting = deque([np.zeros(scene.robot.n)] * late)
        self._velocity = np.zeros(scene.robot.n)
        self._lower, self._upper = (np.full(scene.robot.nq, bound) for bound in (-np.inf, np.inf))
        self._lower[scene.robot.joint_rows] = scene.robot.lower[scene.robot.joint_columns]
        self._upper[scene.robot.joint_rows] = scene.robot.upper[scene.robot.joint_columns]
        self._q = scene.start

    def measured(self) -> np.ndarray:
        """Return what the encoders say (nq,)."""
        if not self._noise:
            return self._q
        return self._q + self._noise * self._random.standard_normal(len(self._q))

    def move(self, velocity: np.ndarray) -> None:
        """Take a command (n,), and move for a period."""
        self._waiting.append(velocity)
        wanted = self._waiting.popleft()
        mean = wanted
        if self._lag:
            # What is missing decays during the cycle.
            share = self._period / self._lag
            missing = self._velocity - wanted
            mean = wanted + missing * (1.0 - math.exp(-share)) / share
            self._velocity = wanted + missing * math.exp(-share)
        moved = self._robot.integrate(self._q, mean, self._period)
        self._q = np.clip(moved, self._lower, self._upper)


def record(scene: Scene, plant: str = 'ideal', weighted: bool = False,
           seconds: float | None = None) -> np.ndarray:
    """Return all commands (T, n) of a run."""
    cycles = round((_seconds(scene.rate) if seconds is None else seconds) * scene.rate)
    controller = Controller(scene.robot, scene.stack(), scene.settings(weighted))
    robot = Plant(scene, plant)
    controller.update(scene.start, 0.0)
    controller.set_goal('tool', scene.goal, 0.0)
    commands = np.empty((cycles, scene.robot.n))
    for cycle in range(cycles):
        commands[cycle] = controller.update(robot.measured(), cycle / scene.rate).velocity
        robot.move(commands[cycle])
    return commands


def run(name: str, rate: int, acceleration: float | None, number: int, plant: str = 'ideal',
        weighted: bool = False, seed: int = 0, jerk: float | None = None) -> Run:
    """
    Return what came of a run.

    Parameters
    ----------
    name : str
        One of `TOOLS`.
    rate : int
        Cycles per second.
    acceleration : float, optional
        Limit of every joint, and the base [rad/s² or m/s²].
    number : int
        Which start and goal.
    plant : str
        One of `PLANTS`.
    weighted : bool
        Whether joints have random weights.
    seed : int
        For other starts and goals.
    jerk : float, optional
        The same beside an acceleration limit [rad/s³ or m/s³].

    """
    scene = Scene(name, rate, acceleration, number, seed, jerk)
    try:
        commands = record(scene, plant, weighted)[round(SETTLING * rate):]
    except Exception as error:
        raise RuntimeError(
            f'run({name!r}, {rate}, {acceleration}, {number}): {error}') from error
    return _measured(name, rate, acceleration, number, scene.kind, commands)


def run_stack(number: int, plant: str = 'ideal', seed: int = 0) -> Run:
    """Return the outcome of a random stack; the arguments as in `run`."""
    scene = Drawn(number, seed)
    try:
        commands = record_stack(scene, plant)[round(SETTLING * scene.rate):]
    except Exception as error:
        raise RuntimeError(f'run_stack({number}, {plant!r}, {seed}): {error}') from error
    return _measured(scene.name, scene.rate, scene.acceleration, number, scene.title, commands)


def record_stack(scene: Drawn, plant: str = 'ideal') -> np.ndarray:
    """Return all commands (T, n) of a random stack, whose goals are constant."""
    controller = Controller(scene.robot, scene.stack(), Settings(
        period=1.0 / scene.rate, braking_gain=min(10.0, float(scene.rate))))
    robot = Plant(scene, plant)
    controller.update(scene.start, 0.0)
    for name, goal in scene.goals.items():
        controller.set_goal(name, goal, 0.0)
    for name, velocity in scene.leading.items():
        controller.set_feed_forward(name, velocity, 0.0)
    commands = np.empty((round(_seconds(scene.rate) * scene.rate), scene.robot.n))
    for cycle in range(len(commands)):
        commands[cycle] = controller.update(robot.measured(), cycle / scene.rate).velocity
        robot.move(commands[cycle])
    return commands


def _seconds(rate: int) -> float:
    """Return how long a run takes [s]."""
    return SETTLING + (MEASURED if rate < MEASURED_AT_MOST else 0.5 * MEASURED)


def _measured(name: str, rate: int, acceleration: float | None, number: int, kind: str,
              commands: np.ndarray) -> Run:
    """Return the `Run` of the commands (T, n) that are measured."""
    period = 1.0 / rate
    return Run(name, rate, acceleration, number, kind, reversals(commands, period),
               sign_flips(commands, period), swings(commands, period),
               float(np.abs(np.diff(commands, axis=0)).max()), float(np.abs(commands).max()))


def measure_stacks(count: int, plant: str, seed: int, jobs: int) -> list[Run]:
    """Return the runs of random stacks, and print a row for each type of task."""
    with multiprocessing.Pool(jobs) as pool:
        runs = pool.starmap(run_stack, [(number, plant, seed) for number in range(count)],
                            chunksize=1)
    print('| type | runs with it | not calm |\n| --- | --- | --- |')
    for name in task_types():
        those = [each for each in runs if name in re.split(r' > |\+', each.kind)]
        print(f'| `{name}` | {len(those)} | {sum(not each.calm for each in those)} |')
    return runs


def measure_goals(options: argparse.Namespace) -> list[Run]:
    """Return the runs with goals out of reach, and print a row for each kind."""
    head = ('robot', 'Hz', 'acceleration limit', 'not calm', 'reversals 1/s', 'flips 1/s',
            'swings 1/s', 'largest change in a cycle')
    print('| ' + ' | '.join(head) + ' |\n|' + ' --- |' * len(head), flush=True)
    every: list[Run] = []
    with multiprocessing.Pool(options.jobs) as pool:
        limits = ACCELERATIONS if options.jerk is None else ACCELERATIONS[1:]
        for case in product(options.robots, options.rates, limits):
            began = time.monotonic()
            work = [(*case, number, options.plant, options.weights, options.seed, options.jerk)
                    for number in range(options.goals)]
            runs = pool.starmap(run, work, chunksize=1)
            print(f'{row(runs)}  <!-- {time.monotonic() - began:.0f} s -->', flush=True)
            every += runs
    return every


def row(runs: list[Run]) -> str:
    """Return the row of runs of the same robot, rate and acceleration."""
    first = runs[0]
    restless = sum(not each.calm for each in runs)
    cells = (first.robot, first.rate, _limit(first), f'{restless} of {len(runs)}',
             f'{max(each.reversals for each in runs):.1f}',
             f'{max(each.flips for each in runs):.1f}',
             f'{max(each.swings for each in runs):.1f}',
             f'{max(each.jump for each in runs):.3f}')
    return '| ' + ' | '.join(map(str, cells)) + ' |'


def finding(each: Run) -> str:
    """Return what is to be said of a run that does not come to rest."""
    return (f'{each.number}: {each.robot}, {each.rate} Hz, {_limit(each)}, {each.kind}: '
            f'{each.reversals:.1f} reversals/s, {each.flips:.1f} flips/s, '
            f'{each.swings:.1f} swings/s, '
            f'{each.jump:.3f} in a cycle, up to {each.fastest:.2f}')


def _limit(each: Run) -> str:
    """Return how an acceleration limit is shown."""
    return 'none' if each.acceleration is None else f'{each.acceleration:g}'


def _options() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--goals', type=int, default=GOALS,
                        help='of each robot, rate and acceleration limit')
    parser.add_argument('--robots', nargs='+', choices=TOOLS, default=list(TOOLS))
    parser.add_argument('--rates', nargs='+', type=int, default=list(RATES))
    parser.add_argument('--plant', choices=PLANTS, default='ideal')
    parser.add_argument('--weights', action='store_true', help='random ones')
    parser.add_argument('--stacks', type=int, default=0,
                        help='random stacks of all task types, in place of the rest')
    parser.add_argument('--jerk', type=float,
                        help='limit beside the acceleration limits [rad/s³ or m/s³]')
    parser.add_argument('--seed', type=int, default=0, help='for other starts and goals')
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    return parser.parse_args()


def main() -> None:
    """Run and print."""
    options = _options()
    if options.stacks:
        every = measure_stacks(options.stacks, options.plant, options.seed, options.jobs)
    else:
        every = measure_goals(options)
    restless = [each for each in every if not each.calm]
    swinging = [each for each in every if each.calm and each.swings > CALM]
    for found, shown in ((restless, 'are not calm'), (swinging, 'are, but swing more than that')):
        print(f'\n{len(found)} of {len(every)} runs {shown}')
        for each in found:
            print(finding(each))


if __name__ == '__main__':
    main()

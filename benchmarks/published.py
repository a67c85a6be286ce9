# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Solve the problems that others have published beside their own solvers.

Run as ``python benchmarks/published.py``; ``--problems 500`` for a first impression. All of them
are solved without damping, and compared with an optimum that owes nothing to the solver.

1. ``--lexls test_01.dat``: the hierarchy stored with LexLS (Dimitrov, Sherikov and Wieber, 2015),
   forces beside accelerations, and its solution; ``tests/test_01.dat`` of jrl-umi3218/lexls.
2. The 10,000 random problems of ``basic_with_limits`` in sns_ik (Flacco, De Luca and Khatib,
   2015; Rethink Robotics), drawn as ``sns_ik_lib/test/sns_vel_ik_base_test.cpp`` of
   RethinkRobotics-opensource/sns_ik draws them. Each task is feasible with a known scale. The
   optimum is a linear program.
3. The 17 hierarchies of NIPM-HLSP (Pfeiffer, Escande and Righetti, 2021), made as
   ``tests/test1.cpp`` of pfeiffer-kai/NIPM-HLSP makes them. The optimum is the reference of the
   tests.
4. ``--esns panda.urdf``: the loop of eSNS-vel, a Panda that follows a square while its elbow
   swings along y, in front of a wall; ``main.m`` and ``panda.urdf`` of Hellod035/eSNS_vel. Where
   a task has one row, as here, least squares are never worse than its scaling.
5. ``--opensot FOLDER``: the stacks of two examples of OpenSoT, ``examples/cpp/panda_ik.cpp`` and
   ``coman_ik.cpp``, with the robots in ``tests/robots`` of ADVRHumanoids/OpenSoT. Goals are
   drawn anew. Times are shares of that of all tasks in one weighted level.

None of these files belongs to this repository: clone theirs. What has no file is left out.
"""

import argparse
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
import runpy
import time
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.optimize import linprog
from tp_controller import Level, solve

Array = np.ndarray
# That of the tests: slow, proven by its multipliers, and with nothing of the solver in it.
bounded_lexicographic = runpy.run_path(str(
    Path(__file__).resolve().parents[1] / 'test' / 'unit' / 'reference.py'))[
        'bounded_lexicographic']
# What LexLS writes for a bound that is none.
NO_BOUND = 1e12
# [s]
PERIOD = 0.01


class Hierarchy(NamedTuple):
    """Levels (J, v) or (J, lower, upper) within bounds on x."""

    levels: list[tuple[Array, ...]]
    lower: Array
    upper: Array

    def solved(self) -> Array:
        """Return our solution (n,)."""
        levels = [Level(J, demand[0]) if len(demand) == 1 else
                  Level(J, lower=demand[0], upper=demand[1]) for J, *demand in self.levels]
        return solve(levels, self.lower, self.upper, scaling='redistribute').velocity

    def best(self) -> Array:
        """Return the solution of the reference (n,)."""
        return bounded_lexicographic(self.levels, len(self.lower), self.lower, self.upper)

    def missed(self, x: Array) -> Array:
        """Return what each level misses, ‖v − J x‖ or its distance from the bounds."""
        return np.array([np.linalg.norm(J @ x - (demand[0] if len(demand) == 1
                                                 else np.clip(J @ x, *demand)))
                         for J, *demand in self.levels])


def table(title: str, *columns: str) -> None:
    """Print a title and the head of a table."""
    print(f'\n{title}\n\n| {" | ".join(columns)} |\n|{" --- |" * len(columns)}')


def row(*cells: Any) -> None:
    """Print a row of a table."""
    texts = (f'{each:.3g}' if isinstance(each, float) else str(each) for each in cells)
    print(f'| {" | ".join(texts)} |', flush=True)


# 1. LexLS

def read_lexls(path: Path) -> tuple[Hierarchy, Array]:
    """Return a stored hierarchy, its first level as bounds, and the stored solution (n,)."""
    sections: dict[str, list[list[float]]] = {}
    for line in path.read_text(encoding='utf-8').splitlines():
        if line.startswith('#'):
            section = sections.setdefault(line.strip(), [])
        elif line.strip():
            section.append([float(each) for each in line.split()])
    n = int(sections['#nVar'][0][0])
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    for variable, least, most, _ in sections['#OBJECTIVE 0']:
        lower[int(variable) - 1], upper[int(variable) - 1] = bound(least), bound(most)
    levels: list[tuple[Array, ...]] = []
    for number in range(1, int(sections['#nObj'][0][0])):
        rows = np.array(sections[f'#OBJECTIVE {number}'])
        J, least, most = rows[:, :n], bound(rows[:, n]), bound(rows[:, n + 1])
        levels.append((J, least) if (least == most).all() else (J, least, most))
    return Hierarchy(levels, lower, upper), np.ravel(sections['#Solution'])


def bound(value: Any) -> Any:
    """Return bounds, infinite where there is none."""
    return np.where(np.abs(value) >= NO_BOUND, np.copysign(np.inf, value), value)


def lexls(path: Path) -> None:
    """Compare with the stored solution."""
    hierarchy, stored = read_lexls(path)
    table('LexLS: what each level misses', 'level', 'tp_controller', 'stored', 'reference')
    found = [hierarchy.missed(x) for x in (hierarchy.solved(), stored, hierarchy.best())]
    for number, values in enumerate(zip(*found), 1):
        row(number, *(f'{value:.8g}' for value in values))


# 2. sns_ik

def glibc_rand(seed: int) -> Iterator[int]:
    """Yield what rand() of glibc returns after srand(seed)."""
    state = [seed]
    for _ in range(30):
        state.append(16807 * state[-1] % 2147483647)
    state = state[3:] + state[:3]
    for drawn in count():
        state = state[1:] + [(state[0] + state[-3]) % 2 ** 32]
        if drawn >= 310:
            yield state[-1] >> 1


class Draws:
    """Random numbers as sns_ik draws them: std::mt19937 for reals, rand() for integers."""

    def __init__(self, real_seed: int, integer_seed: int) -> None:
        self._bits = np.random.MT19937()
        self._bits._legacy_seeding(real_seed)
        self._integers = glibc_rand(integer_seed)
        # What the seeds are set with.
        self.real(0.0, 1.0)
        self.integer(0, 9)

    def real(self, low: float, high: float, size: int = 1) -> Array:
        """Return uniform numbers (size,), two words each, the low one first."""
        words = self._bits.random_raw(2 * size).astype(float)
        return low + (high - low) * ((words[::2] + words[1::2] * 2.0 ** 32) / 2.0 ** 64)

    def integer(self, low: int, high: int) -> int:
        """Return a number from low to high − 1."""
        return next(self._integers) % (high - low) + low


def sns_problems(number: int) -> Iterator[tuple[Array, Array, Array, Array, float]]:
    """Yield J, v, lower and upper, and a scale with which v is feasible."""
    draws = Draws(65444, 24635)
    for _ in range(number):
        m = draws.integer(1, 6)
        n = draws.integer(m, m + 4)
        J = draws.real(-2.0, 2.0, m * n).reshape(m, n)
        lower, upper = draws.real(-5.0, -0.5, n), draws.real(0.5, 5.0, n)
        feasible = J @ (lower + (upper - lower) * draws.real(0.0, 1.0, n))
        scale = min(1.0, float(draws.real(0.2, 1.2)[0]))
        yield J, feasible / scale, lower, upper, scale


def largest_scale(J: Array, v: Array, lower: Array, upper: Array) -> float:
    """Return the largest s ≤ 1 for which J x = s v has a solution within the bounds."""
    cost = np.zeros(J.shape[1] + 1)
    cost[-1] = -1.0
    found = linprog(cost, A_eq=np.column_stack([J, -v]), b_eq=np.zeros(len(v)),
                    bounds=[*zip(lower, upper), (0.0, 1.0)],
                    options={'primal_feasibility_tolerance': 1e-10,
                             'dual_feasibility_tolerance': 1e-10})
    return float(found.x[-1])


def sns(number: int) -> None:
    """Compare the scales of the tasks with the feasible and the largest ones."""
    below, gaps, turned, beyond = 0, [], [], []
    for J, v, lower, upper, feasible in sns_problems(number):
        x = solve([Level(J, v, 'scale')], lower, upper, scaling='redistribute').velocity
        scale = float(v @ J @ x / (v @ v))
        below += scale < feasible - 1e-10
        gaps.append(largest_scale(J, v, lower, upper) - scale)
        turned.append(np.linalg.norm(J @ x - scale * v) / np.linalg.norm(v))
        beyond.append(max(0.0, *(lower - x), *(x - upper)))
    table('sns_ik, basic_with_limits', 'problems', 'below the feasible scale',
          'largest gap to the optimal scale', 'largest change of direction', 'beyond a bound')
    row(number, below, float(max(gaps)), float(max(turned)), float(max(beyond)))


# 3. NIPM-HLSP

# Equations and inequalities of each level, and whether their rows are random.
NIPM: list[tuple[int, list[int], list[int], bool]] = [
    (2, [2], [0], True), (4, [2, 4], [0, 0], True), (1, [0], [1], False), (1, [0], [2], False),
    (1, [1], [1], False), (2, [0, 2], [1, 0], False), (4, [0, 4], [2, 0], False),
    (4, [1, 4], [2, 1], False), (3, [1, 2, 3], [0, 0, 0], False),
    (6, [2, 4, 6], [0, 0, 0], False), (6, [1, 3, 6], [2, 4, 6], False),
    (2, [0, 2], [0, 0], False), (4, [2, 4], [0, 0], True), (6, [2, 4, 6], [0, 0, 0], True),
    (2, [2], [1], True), (4, [1, 4], [2, 2], True), (9, [1, 3, 9], [2, 2, 2], True)]
# What their equations and inequalities demand, level by level: random rows, then the others.
RANDOM_DEMANDS = (10.0, -2.0), (20.0, -3.0), (30.0, -4.0)
DEMANDS = (1.0, -1.0), (10.0, -2.0), (20.0, -3.0)


def nipm_problems() -> Iterator[Hierarchy]:
    """Yield the hierarchies: A x = b, and A x ≥ b for the inequalities."""
    integers = glibc_rand(1)

    def random(m: int, n: int) -> Array:
        # Eigen 3 fills a matrix column by column.
        return np.array([2.0 * next(integers) / (2 ** 31 - 1) - 1.0
                         for _ in range(m * n)]).reshape(n, m).T

    for number, (n, equations, inequalities, is_random) in enumerate(NIPM):
        levels: list[tuple[Array, ...]] = []
        for at, (m, r) in enumerate(zip(equations, inequalities)):
            demand, least = (RANDOM_DEMANDS if is_random else DEMANDS)[at]
            if is_random:
                A, B = random(m, n), random(r, n) * (1.0 if at else -1.0)
            else:
                A, B = np.eye(m, n), -np.eye(r, n)
            b, c = np.full(m, demand), np.full(r, least)
            if number == 3:
                B, c = np.array([[-1.0], [1.0]]), np.zeros(2)
            levels.append((np.vstack([A, B]), np.append(b, c), np.append(b, c + np.inf))
                          if r else (A, b))
        yield Hierarchy(levels, np.full(n, -np.inf), np.full(n, np.inf))


def nipm() -> None:
    """Compare what levels miss with the reference."""
    table('NIPM-HLSP: what levels miss more than the reference', 'hierarchy', 'joints', 'levels',
          'largest difference')
    for number, hierarchy in enumerate(nipm_problems()):
        difference = hierarchy.missed(hierarchy.solved()) - hierarchy.missed(hierarchy.best())
        row(number, len(hierarchy.lower), len(hierarchy.levels), float(difference.max()))


# 4. eSNS

ESNS_START = (0.470893845888598, 0.127875358808930, 0.0, -1.733620831648753, 0.0,
              1.935877135576721, -0.190196085937739)
ESNS_LOWER = np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159])
ESNS_UPPER = np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159])
ESNS_SPEED, ESNS_STEPS, ESNS_SECONDS = 2.0, 1000, 10.0
# The fourth link stays behind x = 0.2 m.
WALL = 0.2
# Gains of the limits, and of the tool [1/s].
OF_LIMITS, OF_TOOL = 20.0, 100.0


def square() -> Array:
    """Return points of a square in the plane of y and z, at rest in its corners (steps, 3)."""
    corners = np.array([[0.55, 0.13 + y, 0.6 + z] for y, z in (
        (0.15, -0.2), (0.15, 0.2), (-0.15, 0.2), (-0.15, -0.2), (0.15, -0.2))])
    t = np.linspace(0.0, 1.0, ESNS_STEPS // 4)[:, np.newaxis]
    share = t ** 3 * (10.0 - 15.0 * t + 6.0 * t ** 2)
    return np.concatenate([begin + share * (end - begin)
                           for begin, end in zip(corners, corners[1:])])


class Model:
    """Positions and Jacobians of the frames of a URDF."""

    def __init__(self, path: Path, joints: int | None = None) -> None:
        self.model = pin.buildModelFromUrdf(str(path))
        self._data = self.model.createData()
        self._joints = joints or self.model.nv
        self._spare = np.zeros(self.model.nq - (joints or self.model.nq))

    def update(self, q: Array) -> None:
        """Move to a configuration, other joints than the first ones at zero."""
        q = np.append(q, self._spare)
        pin.computeJointJacobians(self.model, self._data, q)
        pin.updateFramePlacements(self.model, self._data)
        self.center, self.J_center = pin.centerOfMass(self.model, self._data, q).copy(), \
            pin.jacobianCenterOfMass(self.model, self._data, q)

    def pose(self, frame: str) -> pin.SE3:
        """Return the pose of a frame."""
        return self._data.oMf[self.model.getFrameId(frame)].copy()

    def J(self, frame: str) -> Array:
        """Return the Jacobian of a frame, along the axes of the base (6, n)."""
        return pin.getFrameJacobian(self.model, self._data, self.model.getFrameId(frame),
                                    pin.LOCAL_WORLD_ALIGNED)[:, :self._joints]


def esns(path: Path) -> None:
    """Follow the square within limits of joints and behind the wall."""
    model, q = Model(path, 7), np.array(ESNS_START)
    points = square()
    feed_forward = np.diff(points, axis=0, append=points[-1:]) / PERIOD
    # Corners are passed by a point that is repeated.
    feed_forward[ESNS_STEPS // 4 - 1::ESNS_STEPS // 4] = 0.0
    errors, depth, speed, beyond, worse, slower = [], [], [], [], [], 0
    for step, (point, velocity) in enumerate(zip(points, feed_forward)):
        model.update(q)
        error = point - model.pose('panda_grasptarget').translation
        elbow = model.pose('panda_link4').translation
        J, J_elbow = model.J('panda_grasptarget')[:3], model.J('panda_link4')[:3]
        v = velocity + OF_TOOL * error
        wall = J_elbow[:1], np.array([-10.0]), OF_LIMITS * (WALL - elbow[:1])
        swing = J_elbow[1:2], np.array([0.2 * np.sin((step + 1) / 25.0)])
        hierarchy = Hierarchy(
            [wall, *((J[axis:axis + 1], v[axis:axis + 1]) for axis in range(3)), swing],
            np.maximum(-ESNS_SPEED, OF_LIMITS * (ESNS_LOWER - q)),
            np.minimum(ESNS_SPEED, OF_LIMITS * (ESNS_UPPER - q)))
        x = hierarchy.solved()
        missed = hierarchy.missed(x)
        worse.append(float((missed - hierarchy.missed(hierarchy.best())).max()))
        slower += missed[-1] > 1e-6
        errors.append(np.linalg.norm(error))
        depth.append(elbow[0] - WALL)
        speed.append(np.abs(x).max())
        beyond.append(max(*(ESNS_LOWER - q), *(q - ESNS_UPPER)))
        q = q + PERIOD * x
    arrived = int(np.argmax(np.array(errors) < 1e-3))
    table('eSNS: a Panda on a square, 10 s', 'tool within 1 mm after [s]', 'then off by [mm]',
          'link 4 beyond the wall [mm]', 'fastest joint [rad/s]', 'beyond a position limit [rad]',
          'steps in which the elbow is slower', 'missed more than the reference [m/s]')
    row(PERIOD * arrived, 1e3 * float(max(errors[arrived:])), 1e3 * float(max(0.0, *depth)),
        float(max(speed)), float(max(0.0, *beyond)), slower, float(max(worse)))


# 5. OpenSoT

COMAN = {'RHipSag': -25.0, 'RKneeSag': 50.0, 'RAnkSag': -25.0, 'LHipSag': -25.0,
         'LKneeSag': 50.0, 'LAnkSag': -25.0, 'LShSag': 20.0, 'LShLat': 20.0, 'LShYaw': -15.0,
         'LElbj': -80.0, 'RShSag': 20.0, 'RShLat': -20.0, 'RShYaw': 15.0, 'RElbj': -80.0}
# Of an error in each step: tools, posture.
OF_POSE, OF_POSTURE = 0.1, 0.01
MOST_STEPS, REACHED = 1000, 1e-3

Levels = list[tuple[Array, Array]]
Stacks = Callable[[Array], dict[str, Levels]]


def weighted(*parts: tuple[float, tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return one level of several, each with a weight of its squared error."""
    return (np.concatenate([weight ** 0.5 * J for weight, (J, _) in parts]),
            np.concatenate([weight ** 0.5 * v for weight, (_, v) in parts]))


def towards(model: Model, frame: str, goal: pin.SE3, gain: float) -> tuple[Array, Array]:
    """Return the level of a pose."""
    pose = model.pose(frame)
    turn = pose.rotation @ pin.log3(pose.rotation.T @ goal.rotation)
    return model.J(frame), gain * np.append(goal.translation - pose.translation, turn)


def follow(model: Model, q: Array, stacks: Stacks, name: str, frame: str,
           goal: Array) -> tuple[int, list[float]]:
    """Return the steps in which a stack reaches a goal, and the times of its solutions [s]."""
    times: list[float] = []
    for step in range(MOST_STEPS):
        model.update(q)
        if np.linalg.norm(goal - model.pose(frame).translation) <= REACHED:
            return step, times
        levels = [Level(*each) for each in stacks(q)[name]]
        lower, upper = limits(model.model, q)
        begin = time.perf_counter()
        x = solve(levels, lower, upper, scaling='redistribute').velocity
        times.append(time.perf_counter() - begin)
        q = pin.integrate(model.model, q, x)
    return MOST_STEPS, times


def limits(model: pin.Model, q: Array) -> tuple[Array, Array]:
    """Return the bounds of a step (nv,), (nv,), none on a floating base."""
    base = 6 if model.nq > model.nv else 0
    joints = slice(model.nq - model.nv + base, None)
    fastest, free = PERIOD * model.velocityLimit[base:], np.full(base, np.inf)
    back = np.minimum(fastest, np.maximum(q - model.lowerPositionLimit, 0.0)[joints])
    forth = np.minimum(fastest, np.maximum(model.upperPositionLimit - q, 0.0)[joints])
    return np.append(-free, -back), np.append(free, forth)


def panda_stacks(model: Model, goal: Array) -> Stacks:
    """Return the stacks of ``panda_ik``: the position of the tool, and a posture of zeros."""
    def stacks(q: Array) -> dict[str, Levels]:
        tool = (model.J('panda_link8')[:3],
                OF_POSE * (goal - model.pose('panda_link8').translation))
        posture = np.eye(7), -OF_POSTURE * q
        return {'one level': [weighted((1.0, tool), (1e-4, posture))],
                'two levels': [tool, posture]}
    return stacks


def coman_stacks(model: Model, start: Array, goal: pin.SE3) -> Stacks:
    """Return the stacks of ``coman_ik``: both soles above the centre of mass and the wrists."""
    frames = 'l_sole', 'r_sole', 'l_wrist'
    model.update(start)
    poses, center = {name: model.pose(name) for name in frames}, model.center

    def stacks(q: Array) -> dict[str, Levels]:
        soles = weighted(*((1.0, towards(model, name, poses[name], 1.0)) for name in frames[:2]))
        left = towards(model, 'l_wrist', poses['l_wrist'], OF_POSE)
        right = towards(model, 'r_wrist', goal, OF_POSE)
        com = model.J_center, OF_POSE * (center - model.center)
        move = OF_POSTURE * pin.difference(model.model, q, start)
        posture = np.eye(len(move))[6:], move[6:]
        return {'one level': [soles, weighted((0.1, left), (1.0, right), (1.0, com),
                                              (1e-4, posture))],
                'two levels': [soles, weighted((1.0, com), (0.1, left), (1.0, right)), posture],
                'three levels': [soles, com, weighted((0.1, left), (1.0, right)), posture],
                'four levels': [soles, com, left, right, posture]}
    return stacks


def panda_runs(path: Path, number: int) -> Iterator[tuple[Model, Array, Stacks, str, Array]]:
    """Yield random starts and goals of a Panda."""
    model, random = Model(path), np.random.default_rng(1)
    joints = model.model.lowerPositionLimit, model.model.upperPositionLimit
    for _ in range(number):
        start, other = random.uniform(*joints), random.uniform(*joints)
        model.update(other)
        goal = model.pose('panda_link8').translation
        yield model, start, panda_stacks(model, goal), 'panda_link8', goal


def coman_runs(path: Path, number: int) -> Iterator[tuple[Model, Array, Stacks, str, Array]]:
    """Yield random goals for the right wrist of a COMAN."""
    model, random = Model(path), np.random.default_rng(1)
    start = pin.neutral(model.model)
    for name, angle in COMAN.items():
        start[model.model.joints[model.model.getJointId(name)].idx_q] = np.radians(angle)
    for _ in range(number):
        model.update(start)
        goal = model.pose('r_wrist')
        goal.translation += random.uniform(-0.2, 0.2, 3)
        yield model, start, coman_stacks(model, start, goal), 'r_wrist', goal.translation


def opensot(folder: Path, number: int) -> None:
    """Follow random goals with every stack; time them in turns."""
    table('OpenSoT', 'example', 'stack', 'goals reached', 'steps, median',
          'time of a solve, share of one level')
    for name, runs in (
            ('panda_ik', panda_runs(folder / 'panda' / 'panda.urdf', number)),
            ('coman_ik', coman_runs(
                folder / 'coman_floating_base' / 'coman_floating_base.urdf', number))):
        found: dict[str, list[tuple[int, list[float]]]] = {}
        for model, start, stacks, frame, goal in runs:
            model.update(start)
            for stack in stacks(start):
                found.setdefault(stack, []).append(
                    follow(model, start, stacks, stack, frame, goal))
        unit = np.median(np.concatenate([times for _, times in found['one level']]))
        for stack, results in found.items():
            steps = [each for each, _ in results if each < MOST_STEPS]
            share = np.median(np.concatenate([times for _, times in results])) / unit
            row(name, stack, f'{len(steps)} of {number}',
                int(np.median(steps)) if steps else '-', float(share))


def main() -> None:
    """Print a table of every source whose data there are."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0].strip())
    parser.add_argument('--problems', type=int, default=10_000, help='of sns_ik')
    parser.add_argument('--lexls', type=Path, help='test_01.dat')
    parser.add_argument('--esns', type=Path, help='panda.urdf')
    parser.add_argument('--opensot', type=Path, help='tests/robots')
    parser.add_argument('--runs', type=int, default=30, help='of each example of OpenSoT')
    arguments = parser.parse_args()
    sns(arguments.problems)
    nipm()
    if arguments.lexls:
        lexls(arguments.lexls)
    if arguments.esns:
        esns(arguments.esns)
    if arguments.opensot:
        opensot(arguments.opensot, arguments.runs)


if __name__ == '__main__':
    main()

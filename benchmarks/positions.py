# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Solve inverse kinematics for poses that are reachable by construction.

Run as ``python benchmarks/positions.py``; ``--goals 50`` for a first impression. The goals are the
poses of random postures within the joint limits, every search starts at `Robot.neutral`, and all
options are the default ones, but for a timeout that no search needs. *Reached* is within 1e-6 m
and rad, *direct* by the first descent. Times are those of `PositionSolver.solve`, on the wall.

*Batch* is the time of `solve_positions` with one thread over that with two, for the same goals
eight times, medians of five runs. *Out of reach*: goals at 1.2 to 2 times their distance; the
share whose error is within 1 % of the best of 200 descents. *In order*: each answer is nudged 50
times and descends again; the share of answers of which no level gets better by 1 % unless one
above it gets worse.
"""

import argparse
from collections.abc import Callable, Iterator
from itertools import product
import time

from _robots import CONFIG, load_robot
import numpy as np
from tp_controller import PositionSolver, Robot, solve_positions, Stack
from tp_controller.positions.random_postures import random_postures

SEED, GOALS = 0, 1000
PATIENCE = 10.0
# A batch has all goals so many times, and is solved so often.
COPIES, RUNS = 8, 5
DESCENTS, NUDGES, NUDGE, NOTABLE = 200, 50, 0.05, 0.01
# Costs that are no errors.
EXACT, KEPT = 1e-12, 1e-6
POSE = '- tool: {{type: pose, frame: {0}}}'
DIRECTED = POSE.replace('pose', 'position') + '\n- direction: {{type: pointing, frame: {0}}}'
# KUKA LBR iiwa 14 R820, from its data sheet: d [m], alpha and position limits [rad].
IIWA = [{'name': f'joint_{number}', 'd': d, 'alpha': alpha, 'lower': -limit, 'upper': limit,
         'velocity': 1.5}
        for number, (d, alpha, limit) in enumerate((
            (0.36, -np.pi / 2, 2.967), (0.0, np.pi / 2, 2.094), (0.42, np.pi / 2, 2.967),
            (0.0, -np.pi / 2, 2.094), (0.4, -np.pi / 2, 2.967), (0.0, np.pi / 2, 2.094),
            (0.126, 0.0, 3.054)), 1)]
TALOS = ['torso_1_joint', 'torso_2_joint', *(f'arm_left_{i}_joint' for i in range(1, 8))]


def shipped(name: str) -> Robot:
    """Return a robot of config/robots."""
    return Robot.from_file(CONFIG / 'robots' / f'{name}.yaml')


# {name: (robot, stack, frame)}
CASES: dict[str, tuple[Callable[[], Robot], str, str]] = {
    'Panda': (lambda: shipped('panda'), POSE, 'panda_hand_tcp'),
    'UR5e': (lambda: shipped('ur5e'), POSE, 'tool0'),
    'Gen3': (lambda: shipped('gen3'), POSE, 'end_effector_link'),
    'xArm 7': (lambda: shipped('xarm7'), POSE, 'link_eef'),
    'iiwa 14': (lambda: Robot.from_dh(IIWA), POSE, 'link7'),
    'Talos, arm and torso': (lambda: Robot.from_urdf(load_robot('Talos').urdf, joints=TALOS),
                             POSE, 'arm_left_7_link'),
    'TIAGo, planar base': (lambda: load_robot('TIAGo on wheels'), POSE, 'arm_tool_link'),
    'SO-101, direction': (lambda: load_robot('SO-101'), DIRECTED, 'gripper_frame_link'),
}
# {name: (robot, stack, tasks with a goal)}
ORDERED = {
    'pose > posture': ('Panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- posture: {type: posture}
""", ['tool']),
    'pose > elbow > posture': ('Panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
- posture: {type: posture}
""", ['tool', 'elbow']),
    'keep_in > position > posture': ('Panda', """
- cell: {type: keep_in, frame: panda_link4, shape: {box: [0.6, 0.6, 1.2]}, at: [0, 0, 0.5]}
- tool: {type: position, frame: panda_hand_tcp}
- posture: {type: posture}
""", ['tool']),
    'pose > keep_in > posture': ('UR5', """
- tool: {type: position, frame: tool0}
- low: {type: keep_in, frame: forearm_link, shape: {box: [2.0, 2.0, 0.6]}}
- posture: {type: posture}
""", ['tool']),
    'self_collision > pose > posture': ('Panda, URDF', """
- apart: {type: self_collision}
- tool: {type: pose, frame: panda_hand_tcp}
- posture: {type: posture}
""", ['tool']),
}


def goals_of(robot: Robot, stack: Stack, names: list[str], count: int, stretch: bool = False
             ) -> Iterator[dict[str, np.ndarray]]:
    """Yield values of tasks at random postures; `stretch`: farther away than these."""
    generator = np.random.default_rng(SEED)
    for q in random_postures(robot, robot.neutral(), generator, count):
        state = robot.state(q)
        found = {name: np.array(stack.tasks[name].value(state)) for name in names}
        if stretch:
            for goal in found.values():
                goal[:3, 3] *= generator.uniform(1.2, 2.0)
        yield found


def measure(name: str, count: int) -> str:
    """Return a row of the table for a robot."""
    make, text, frame = CASES[name]
    robot = make()
    stack = Stack.from_yaml(text.format(frame), robot)
    names = list(stack.tasks)
    goals = list(goals_of(robot, stack, names, count))
    solver, times, found = PositionSolver(robot, stack), [], []
    for number, goal in enumerate(goals):
        began = time.perf_counter()
        found.append(solver.solve(goal, seed=number, timeout=PATIENCE))
        times.append(1e3 * (time.perf_counter() - began))
    reached = np.mean([each.reached for each in found])
    direct = np.mean([each.attempts == 1 for each in found])
    one, two = batch_times(robot, stack, goals * COPIES)
    return (f'| {name} | {100 * reached:.1f} | {100 * direct:.0f} | {np.median(times):.3f} '
            f'| {np.percentile(times, 99):.2f} | {max(times):.1f} | {one / two:.2f} |')


def batch_times(robot: Robot, stack: Stack, goals: list[dict[str, np.ndarray]]) -> np.ndarray:
    """Return the median times (2,) of a batch with one thread and with two [s]."""
    batch = {name: [goal[name] for goal in goals] for name in goals[0]}
    times = np.empty((RUNS, 2))
    for run, jobs in product(range(RUNS), (1, 2)):
        began = time.perf_counter()
        solve_positions(robot, stack, batch, jobs=jobs, timeout=PATIENCE)
        times[run, jobs - 1] = time.perf_counter() - began
    return np.median(times, axis=0)


def out_of_reach(name: str, count: int) -> float:
    """Return the share of goals out of reach whose error is the least, for one robot."""
    make, text, frame = CASES[name]
    robot = make()
    stack = Stack.from_yaml(text.format(frame), robot)
    solver, good = PositionSolver(robot, stack), []
    for number, goal in enumerate(goals_of(robot, stack, ['tool'], count, stretch=True)):
        errors = []
        for attempts in (20, DESCENTS):
            found = solver.solve(goal, seed=number, attempts=attempts, timeout=PATIENCE)
            errors.append(np.linalg.norm([error for error, _, _ in found.tasks[0].errors]))
        good.append(errors[0] <= 1.01 * errors[1] + EXACT)
    return float(np.mean(good))


def in_order(name: str, count: int) -> tuple[float, float]:
    """Return the share of answers that are in order, and of those that reach their goals."""
    robot_name, text, names = ORDERED[name]
    robot = load_robot(robot_name)
    stack = Stack.from_yaml(text, robot)
    solver, generator = PositionSolver(robot, stack), np.random.default_rng(SEED)
    good, reached = [], []
    for number, goal in enumerate(goals_of(robot, stack, names, count)):
        posture = {'posture': robot.neutral()[robot.joint_rows]}
        found = solver.solve({**posture, **goal}, seed=number, timeout=PATIENCE)
        costs = costs_of(found)
        reached.append(all(task.reached for task in found.tasks if task.name in names))
        nudged = (solver.solve({**posture, **goal}, attempts=1, timeout=PATIENCE, start=np.clip(
            found.q + NUDGE * generator.normal(size=robot.nq), robot.lower, robot.upper))
            for _ in range(NUDGES))
        good.append(not any(is_better(costs_of(each), costs) for each in nudged))
    return float(np.mean(good)), float(np.mean(reached))


def costs_of(found: object) -> list[float]:
    """Return the norm of the error of each task of a solution."""
    return [float(np.linalg.norm([error for error, _, _ in task.errors])) for task in found.tasks]


def is_better(errors: list[float], others: list[float]) -> bool:
    """Return whether a level has less error than in another solution, and none above has more."""
    for error, other in zip(errors, others):
        if error < (1.0 - NOTABLE) * other - KEPT:
            return True
        if error > other + KEPT:
            return False
    return False


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--goals', type=int, default=GOALS, help='goals of each robot')
    count = parser.parse_args().goals
    print('| robot | reached [%] | direct [%] | median [ms] | 99 % [ms] | longest [ms] | batch |')
    print('|---|---|---|---|---|---|---|')
    for name in CASES:
        print(measure(name, count), flush=True)
    few = max(count // 10, 1)
    print('\n| out of reach | least error [%] |\n|---|---|')
    for name in ('Panda', 'UR5e', 'iiwa 14', 'SO-101, direction'):
        if CASES[name][1] is POSE:
            print(f'| {name} | {100 * out_of_reach(name, few):.0f} |', flush=True)
    print('\n| stack | in order [%] | reached [%] |\n|---|---|---|')
    for name in ORDERED:
        order, reached = in_order(name, few)
        print(f'| {name} | {100 * order:.0f} | {100 * reached:.0f} |', flush=True)


if __name__ == '__main__':
    main()

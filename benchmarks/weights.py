# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Weight joints over many orders of magnitude, and measure what that does to the first level.

Run as ``python benchmarks/weights.py``; ``--states 20`` for a first impression. Weights say which
joints move least among all motions that meet the tasks equally well. They must not change what
the first task achieves.

The first table compares the velocity of the first level with random weights and with equal ones,
in the states of `loss.py`, as a share of the demand; the logarithms of the weights are uniformly
distributed from 1e-4 to 1e4. The second table shows the error after 10 s in closed loops at 100 Hz
with an ideal robot and goals within reach.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence

from _robots import load_robot, PANDA_READY
from loss import CASES, State, states, velocity
import numpy as np
from tp_controller import Controller, Robot, Settings, Stack

STATES = 200
EXPONENTS = -4.0, 4.0
# What counts as the same.
SAME = 1e-6
PERIOD, SECONDS = 0.01, 10.0
JOINT = """
- one: {type: joint, joints: panda_joint1, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
JOINT_START = 0.0, *PANDA_READY[1:]
JOINT_GOAL = 1.0
MOBILE = """
- tool: {type: pose, frame: tool, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
# base_x, base_y, base_yaw, torso_lift, arm_1 …, and where its tool has to go [m].
MOBILE_START = 0.0, 0.0, 0.0, 0.15, 0.0, -0.8, 0.0, 1.6, 0.0, -0.8, 0.0
MOBILE_MOVE = 3.0, 0.0, 0.0
POSE = """
- tool: {type: pose, frame: panda_hand_tcp, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
SINGLE = 1.0, 1e2, 1e3, 1e4
# How far the joints of a goal that can be reached are from the start [rad].
NEAR = 0.5
DRAWN = 20


def differences(case: str, count: int, bounded: bool) -> np.ndarray:
    """Return by how much weights change the velocity of the first level (count,)."""
    robot_name, stack_text = CASES[case]
    robot, random = load_robot(robot_name), np.random.default_rng(1)
    equal, found = Settings(), []
    for state in states(robot, stack_text, count):
        if not bounded:
            free = np.full(robot.n, np.inf)
            state = State(state.levels, -free, free)
        weighted = Settings(weights=tuple(10.0 ** random.uniform(*EXPONENTS, robot.n)))
        first = state.levels[0]
        change = first.J @ (velocity(weighted, state) - velocity(equal, state))
        found.append(np.linalg.norm(change) / np.linalg.norm(first.v))
    return np.array(found)


def final_error(robot: Robot, stack_text: str, start: Sequence[float], goal: object,
                weights: Iterable[float]) -> float:
    """Return the first error of the first task after a closed loop [m or rad]."""
    stack = Stack.from_yaml(stack_text, robot)
    controller = Controller(robot, stack, Settings(period=PERIOD, weights=tuple(weights)))
    q = np.array(start)
    controller.update(q, 0.0)
    controller.set_goal(next(iter(stack.tasks)), goal, 0.0)
    for cycle in range(round(SECONDS / PERIOD)):
        command = controller.update(q, cycle * PERIOD)
        q = robot.integrate(q, command.velocity, PERIOD)
    return float(command.report.tasks[0].errors[0][0])


def loops(drawn: int) -> Iterator[tuple[str, float]]:
    """Yield what was run, and its final error [m or rad]."""
    panda, mobile = load_robot('Panda'), load_robot('mobile arm')
    goal = mobile.state(MOBILE_START).pose('tool').copy()
    goal[:3, 3] += MOBILE_MOVE
    for weight in SINGLE:
        yield (f'Panda, joint 1 of weight {weight:g} by 1 rad',
               final_error(panda, JOINT, JOINT_START, [JOINT_GOAL], [weight] + [1.0] * 6))
    for weight in SINGLE:
        weights = np.ones(mobile.n)
        weights[:mobile.joint_columns.start] = weight
        yield (f'mobile arm, base of weight {weight:g}',
               final_error(mobile, MOBILE, MOBILE_START, goal, weights))
    random, errors = np.random.default_rng(2), []
    for _ in range(drawn):
        place = np.clip(PANDA_READY + random.uniform(-NEAR, NEAR, panda.n), panda.lower,
                        panda.upper)
        goal = panda.state(place).pose('panda_hand_tcp')
        weights = 10.0 ** random.uniform(*EXPONENTS, panda.n)
        errors.append(final_error(panda, POSE, PANDA_READY, goal, weights))
    yield f'Panda, pose, {drawn} goals with random weights: median', float(np.median(errors))
    yield f'Panda, pose, {drawn} goals with random weights: largest', max(errors)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--states', type=int, default=STATES)
    parser.add_argument('--goals', type=int, default=DRAWN, help='with random weights')
    options = parser.parse_args()
    print(f'| stack | limits | median | 90th percentile | most | states with more than {SAME:g} '
          '|\n|' + ' --- |' * 6, flush=True)
    for case in CASES:
        for bounded in (False, True):
            found = differences(case, options.states, bounded)
            print(f'| {case} | {"kept" if bounded else "none"} | {np.median(found):.1e} '
                  f'| {np.percentile(found, 90):.1e} | {found.max():.1e} '
                  f'| {100.0 * np.mean(found > SAME):.1f} % |', flush=True)
    print('\n| closed loop | error after 10 s |\n| --- | --- |', flush=True)
    for shown, error in loops(options.goals):
        print(f'| {shown} | {error:.2e} |', flush=True)


if __name__ == '__main__':
    main()

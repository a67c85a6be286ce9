# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Measure what the first two levels miss beyond what the limits make impossible, at random states.

Run as ``python benchmarks/loss.py``; ``--states 100`` for a first impression. Joint positions are
uniformly distributed in their ranges. Every level demands a velocity in a random direction: the
first level 0.3 to 2 (m/s, or m/s and rad/s), the others 0.3 to 2 rad/s, a posture up to half the
speed limits of the joints. The joints are at rest and have their velocity and position limits.

The loss of a level is (‖v − J x‖ − ‖v − J x*‖) / ‖v‖, where x is the velocity of the solver and
x* the exact optimum: for the first level the optimum within the limits; for the second level the
optimum among the velocities that are optimal for the first. The loss of the second level is
negative where it gains what the first level loses.

Every state is solved on its own, without what the solver remembers from cycle to cycle. With
``--cycles 100`` every state is solved 100 times in a row, and the solver remembers: this is the
loss of a robot whose tasks demand the impossible for a while.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
import runpy

from _robots import CONFIG, load_robot
import numpy as np
from scipy.optimize import lsq_linear
from tp_controller import Level, Robot, RobotState, Settings, Stack
from tp_controller.solver.solve import solve_cycle

# That of the tests: slow, proven by its multipliers, and with nothing of the solver in it.
constrained_lstsq = runpy.run_path(
    str(CONFIG.parent / 'test' / 'unit' / 'reference.py'))['constrained_lstsq']
SEED = 0
STATES, STATES_BELOW = 1000, 300
SPEEDS = 0.3, 2.0
# What counts as worse than possible.
WORSE = 0.01
# By how much the two references may differ, as a share of the demand.
AGREED = 1e-7
# SciPy's own limit, n, is too low for some states.
MOST_STEPS = 1000
# {name: (robot, stack)}
CASES = {
    'Panda, pose > posture': ('Panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- posture: {type: posture}
"""),
    'Panda, pose > elbow position': ('Panda', """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
"""),
    'Panda, position > two axes of orientation > posture': ('Panda', """
- position: {type: position, frame: panda_hand_tcp}
- direction: {type: orientation, frame: panda_hand_tcp, axes: xy}
- posture: {type: posture}
"""),
    'UR5, pose > posture': ('UR5', """
- tool: {type: pose, frame: tool0}
- posture: {type: posture}
"""),
    'UR5, position > two axes of orientation > posture': ('UR5', """
- position: {type: position, frame: tool0}
- direction: {type: orientation, frame: tool0, axes: xy}
- posture: {type: posture}
"""),
    'Baxter, relative pose > left position > posture': ('Baxter', """
- grip: {type: pose, frame: left_gripper, reference: right_gripper}
- left: {type: position, frame: left_gripper}
- posture: {type: posture}
"""),
    'Talos, left pose > right pose > head > posture': ('Talos', """
- left: {type: pose, frame: arm_left_7_link}
- right: {type: pose, frame: arm_right_7_link}
- head: {type: orientation, frame: head_2_link, axes: yz}
- posture: {type: posture}
"""),
}
# {name: settings}
SETTINGS = {
    'default': Settings(),
    'regularisation alone': Settings(damping=0.0, release_region=0.0),
    'exact': Settings(damping=0.0, release_region=0.0, regularisation=0.0),
}


@dataclass
class State:
    """What the solver is given: `Level`s, and bounds (n,) on the velocities [rad/s or m/s]."""

    levels: list[Level]
    lower: np.ndarray
    upper: np.ndarray


# How the solver is called, and what the Jacobians of a stack are, stands in these two only.
def velocity(settings: Settings, state: State, cycles: int = 1) -> np.ndarray:
    """Return the velocities (n,) that the solver finds in the last of some cycles."""
    options, memory = settings.solver(len(state.lower)), ()
    for _ in range(cycles):
        solution = solve_cycle(state.levels, state.lower, state.upper, options, settings.period,
                               memory=memory)
        memory = solution.memory
    return solution.velocity


def jacobians(stack: Stack, state: RobotState) -> list[np.ndarray]:
    """Return the Jacobian of every level."""
    return [task.jacobian(state) for task in stack.tasks.values()]


def states(robot: Robot, stack_text: str, count: int) -> Iterator[State]:
    """Yield random states."""
    random = np.random.default_rng(SEED)
    stack = Stack.from_yaml(stack_text, robot)
    state = robot.state(robot.neutral())
    types = [task.type_name for task in stack.tasks.values()]
    for _ in range(count):
        state.update(random.uniform(robot.lower, robot.upper))
        levels = []
        for J, type_name in zip(jacobians(stack, state), types):
            if type_name == 'posture':
                v = 0.5 * robot.velocity * random.uniform(-1.0, 1.0, robot.n)
            else:
                v = random.standard_normal(len(J))
                v *= random.uniform(*SPEEDS) / np.linalg.norm(v)
            levels.append(Level(J, v))
        yield State(levels, *bounds(robot, state.positions))


def bounds(robot: Robot, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the velocities (n,) that joints at rest and without acceleration limits may have."""
    gain = Settings().braking_gain
    return (-np.minimum(robot.velocity, gain * (positions - robot.lower)),
            np.minimum(robot.velocity, gain * (robot.upper - positions)))


def missing(level: Level, x: np.ndarray) -> float:
    """Return the share of the demand of a level that is missing."""
    return float(np.linalg.norm(level.v - level.J @ x) / np.linalg.norm(level.v))


def best_first(state: State) -> np.ndarray:
    """Return an exact optimum (n,) of the first level, two references agreeing on it."""
    first, n = state.levels[0], len(state.lower)
    x = constrained_lstsq(first.J, first.v, np.eye(n), state.lower, state.upper,
                          np.zeros((0, n)), np.zeros(n))
    other = lsq_linear(first.J, first.v, (state.lower, state.upper), 'bvls', tol=1e-12,
                       max_iter=MOST_STEPS).x
    if abs(missing(first, x) - missing(first, other)) > AGREED:
        raise ArithmeticError('the references differ in '
                              f'{missing(first, x)} and {missing(first, other)}')
    return x


def best_second(state: State, x: np.ndarray) -> np.ndarray:
    """Return an exact optimum (n,) of the second level, the first staying as in x."""
    first, second = state.levels[:2]
    return constrained_lstsq(second.J, second.v, np.eye(len(x)), state.lower, state.upper,
                             first.J, x)


@lru_cache(maxsize=None)
def references(case: str, count: int, count_below: int) -> list[tuple[State, list[float]]]:
    """Return states, each with the least that its first levels can miss: one, or two of them."""
    robot_name, stack_text = CASES[case]
    found = []
    for number, state in enumerate(states(load_robot(robot_name), stack_text, count)):
        x = best_first(state)
        least = [missing(state.levels[0], x)]
        if number < count_below:
            least.append(missing(state.levels[1], best_second(state, x)))
        found.append((state, least))
    return found


def losses(case: str, settings: Settings, count: int, count_below: int,
           cycles: int) -> list[np.ndarray]:
    """Return the losses of the first and of the second level."""
    found: list[list[float]] = [[], []]
    for state, least in references(case, count, count_below):
        x = velocity(settings, state, cycles)
        for values, level, best in zip(found, state.levels, least):
            values.append(missing(level, x) - best)
    return [np.array(values) for values in found]


def row(case: str, shown: str, number: int, values: np.ndarray) -> str:
    """Return the row of a level."""
    figures = [f'{100.0 * figure:.2g} %' for figure in (
        np.median(values), *np.percentile(values, (90, 99)), values.max())]
    cells = (case, shown, number, *figures, f'{100.0 * np.mean(values > WORSE):.1f} %')
    return '| ' + ' | '.join(map(str, cells)) + ' |'


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--states', type=int, default=STATES)
    parser.add_argument('--below', type=int, default=STATES_BELOW,
                        help='states in which the second level is measured, too')
    parser.add_argument('--cycles', type=int, default=1, help='for which every state lasts')
    options = parser.parse_args()
    print('| stack | settings | level | median | 90th percentile | 99th | most '
          f'| states with more than {100.0 * WORSE:g} % |\n|' + ' --- |' * 8, flush=True)
    every: dict[tuple[str, int], list[np.ndarray]] = {}
    for case in CASES:
        for shown, settings in SETTINGS.items():
            found = losses(case, settings, options.states, options.below, options.cycles)
            for number, values in enumerate(found, start=1):
                print(row(case, shown, number, values), flush=True)
                every.setdefault((shown, number), []).append(values)
    for (shown, number), parts in every.items():
        print(row('all', shown, number, np.concatenate(parts)))


if __name__ == '__main__':
    main()

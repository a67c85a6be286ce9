# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Two exercises of the lab: a planar arm with three joints, at 60 Hz in simulated time.

The settings are those of the lab sheet: gain 1, start at q = [0, 0.6, 0.3]. Exercise 2 uses damped
least squares with λ = 0.1 and joint speeds of at most 1 rad/s. Each measured value is printed
beside the expected one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.model.spatial import Array
from tp_controller.resources import package_share
from tp_controller.tools.demos.motion import Look, Motion
from tp_controller.tools.demos.outcome import films, Measurement, Outcome
from tp_controller.tools.demos.simulation import Run, simulate
from tp_controller.tools.plots.curves import plot_errors, plot_positions, plot_velocities

Point = Sequence[float] | Array

EXERCISE_PERIOD = 1.0 / 60.0
EXERCISE_START = (0.0, 0.6, 0.3)
END_EFFECTOR = 'link3'
# Parameters of the film: view from nearly above [deg], ground below the round links [m], and size
# factor of the goals, which must exceed the links.
TOP_VIEW, GROUND_HEIGHT, ENLARGED = (-90.0, 55.0), -0.12, 2.3
GOAL_TIME = 10.0
GOAL_COUNT = 6
# End-effector goals [m]: the first cannot be reached with joint 1 at zero, the second can.
CONFLICT, COMPATIBLE = (0.5, 1.2), (0.75, 0.9)
ORDERS = {'end-effector first': 'lab2_end_effector_first', 'joint 1 first': 'lab2_joint_first'}
# As in lecture 2.2 and 4: uniform scaling, no relaxed directions, no transition.
UNDAMPED = Settings(period=EXERCISE_PERIOD, damping=0.0, scaling='uniform', release_region=0.0,
                    blend=0.0)
LECTURE_DAMPING = replace(UNDAMPED, damping=0.1, singular_region=math.inf)
# Results of exercise 1 after 10 s at 60 Hz, from an independent program. They depend on the step
# size: at 1 kHz the end-effector error is 0.1 mm.
REFERENCE_ERROR = 1.733e-3
REFERENCE_Q = (0.74633, -0.21186, -0.71626)


def lab1(folder: str | Path) -> Outcome:
    """Run exercise 1, motion in the null space of a position, with figures in a folder."""
    motion = null_space_motion()
    limits = motion.robot.velocity
    measurements = (
        Measurement('end-effector error, largest', 'mm',
                    1e3 * motion.errors['end_effector'].max(), 1e3 * REFERENCE_ERROR, 1e-3),
        *(Measurement(f'{name} after {motion.times[-1]:.0f} s', 'rad', measured, reference, 2e-5)
          for name, measured, reference in zip(motion.robot.joint_names, motion.q[-1],
                                               REFERENCE_Q)),
        Measurement('joint speed, largest', 'rad/s', motion.top_speed, limits.min(), 0.0,
                    bound=True))
    error = ('end-effector', 'mm', 1e3 * motion.errors['end_effector'])
    folder = Path(folder)
    paths = (
        *_film(folder / 'lab1.webp', motion, 'The joints move, the end-effector stays',
               [motion.robot.state(EXERCISE_START).position(END_EFFECTOR)]),
        plot_positions(folder / 'lab1_positions.png', motion.times, motion.q,
                       motion.robot.joint_names, title='Null-space motion: joint positions'),
        plot_errors(folder / 'lab1_error.png', motion.times, [error],
                    title='Null-space motion: how far the end-effector drifts'))
    return Outcome('Exercise 1: end-effector stays, y(t) = [sin t, cos t, sin t] below it',
                   measurements, (), paths)


def lab2(folder: str | Path, seed: int = 1) -> Outcome:
    """
    Run exercise 2: end-effector and joint 1 position, in both orders of priority.

    Parameters
    ----------
    folder : str or pathlib.Path
        Folder of the figures.
    seed : int
        Seed of the random end-effector goals.

    """
    measurements = [each for goal in (CONFLICT, COMPATIBLE) for each in _measure_two_tasks(goal)]
    goals = np.random.default_rng(seed).uniform(-1.0, 1.0, size=(GOAL_COUNT, 2))
    motions = {order: two_tasks(order, goals) for order in ORDERS}
    for order, motion in motions.items():
        measurements.append(Measurement(
            f'random goals, {order}: joint speed', 'rad/s', motion.top_speed,
            motion.robot.velocity.min(), 0.0, bound=True))
    measurements.append(Measurement(
        'random goals, joint 1 first: joint 1', 'rad',
        motions['joint 1 first'].errors['joint1'].max(), 0.0, 1e-9))
    title = 'Exercise 2: end-effector position and joint 1 position, in both orders'
    return Outcome(title, tuple(measurements), tuple(_goal_lines(goals, motions)),
                   tuple(_two_task_figures(Path(folder), goals, motions)))


def null_space_motion(duration: float = 10.0) -> Run:
    """Return the recorded motion of exercise 1."""
    def set_goals(controller: Controller, now: float) -> None:
        controller.set_goal('null_space_motion', [math.sin(now), math.cos(now), math.sin(now)],
                            now)

    return _record('lab1', UNDAMPED, duration, set_goals)


def two_tasks(order: str, goals: ArrayLike, goal_time: float = GOAL_TIME) -> Run:
    """
    Return the recorded motion of exercise 2.

    Parameters
    ----------
    order : str
        One of `ORDERS`.
    goals : array_like (k, 2)
        Consecutive goals of the end-effector [m].
    goal_time : float
        Duration of each goal [s].

    Returns
    -------
    Run

    """
    steps = round(goal_time / EXERCISE_PERIOD)
    points = np.asarray(goals, dtype=float)

    def set_goals(controller: Controller, now: float) -> None:
        step = round(now / EXERCISE_PERIOD)
        if step % steps == 0 and step < steps * len(points):
            controller.set_goal('end_effector', [*points[step // steps], 0.0], now)

    return _record(ORDERS[order], LECTURE_DAMPING, goal_time * len(points), set_goals)


def best_joint1(goal: Point) -> float:
    """
    Return the minimal |q₁| for which the end-effector can reach a goal [rad].

    Joints 2 and 3 reach any point in a disc around joint 2. For a goal outside of the disc of
    q₁ = 0, the minimal rotation stretches the arm: cosine law with sides a₁, |goal| and a₂ + a₃.
    The goal must be within reach of the robot.
    """
    if best_error(goal) == 0.0:
        return 0.0
    upper_arm, reach, distance = 0.75, 1.0, math.hypot(*goal)
    cosine = (upper_arm ** 2 + distance ** 2 - reach ** 2) / (2.0 * upper_arm * distance)
    return abs(math.atan2(goal[1], goal[0])) - math.acos(cosine)


def best_error(goal: Point) -> float:
    """Return the minimal end-effector error with joint 1 at zero [m]."""
    return max(math.hypot(goal[0] - 0.75, goal[1]) - 1.0, 0.0)


def _record(stack: str, settings: Settings, duration: float,
            set_goals: Callable[[Controller, float], None]) -> Run:
    """Simulate a stack; call `set_goals(controller, now)` in every cycle."""
    config = package_share() / 'config'
    robot = Robot.from_file(config / 'robots' / 'planar_3r.yaml')
    controller = Controller(robot, Stack.from_yaml(config / f'{stack}.yaml', robot), settings)
    return simulate(controller, EXERCISE_START, round(duration / EXERCISE_PERIOD) + 1,
                    lambda now: set_goals(controller, now))


def _measure_two_tasks(goal: Point) -> Iterator[Measurement]:
    """Yield the measurements of one goal after 10 s, in both orders."""
    label = f'goal ({goal[0]:g}, {goal[1]:g})'
    best = {'end-effector first': (0.0, best_joint1(goal)),
            'joint 1 first': (best_error(goal), 0.0)}
    for order, (error, joint1) in best.items():
        motion = two_tasks(order, np.atleast_2d(goal))
        yield Measurement(f'{label}, {order}: end-effector', 'mm',
                          1e3 * motion.errors['end_effector'][-1], 1e3 * error, 0.1)
        yield Measurement(f'{label}, {order}: joint 1', 'rad', motion.errors['joint1'][-1],
                          joint1, 2e-4)


def _goal_lines(goals: Array, motions: Mapping[str, Run]) -> Iterator[str]:
    """Yield a table of the final errors of each random goal."""
    first, second = motions.values()
    yield ''
    yield ('Random goals: errors after 10 s, and the smallest possible error with '
           'joint 1 at zero')
    yield (f'{"goal [m]":<18} {"end-effector first":^24}   {"joint 1 first":^24}   '
           f'{"possible":>8}')
    yield f'{"":<18} {"mm":>11} {"joint 1 rad":>12}   {"mm":>11} {"joint 1 rad":>12}   {"mm":>8}'
    steps = round(GOAL_TIME / EXERCISE_PERIOD)
    for index, goal in enumerate(goals):
        # The sample at the change already has the new goal.
        last = (index + 1) * steps - 1
        cells = [f'{1e3 * motion.errors["end_effector"][last]:>11.2f} '
                 f'{motion.errors["joint1"][last]:>12.5f}' for motion in (first, second)]
        yield (f'({goal[0]:6.3f}, {goal[1]:6.3f})   {cells[0]}   {cells[1]}   '
               f'{1e3 * best_error(goal):>8.2f}')
    yield ''


def _two_task_figures(folder: Path, goals: Array,
                      motions: Mapping[str, Run]) -> Iterator[Path]:
    """Write the figures of exercise 2 and yield their paths."""
    changes = GOAL_TIME * np.arange(1, GOAL_COUNT)
    for order, motion in motions.items():
        name = ORDERS[order]
        caption = order[0].upper() + order[1:]
        names, times = motion.robot.joint_names, motion.times
        yield from _film(folder / f'{name}.webp', motion, caption,
                         [(*goal, 0.0) for goal in goals])
        yield plot_positions(folder / f'{name}_positions.png', times, motion.q, names,
                             title=f'{caption}: joint positions', changes=changes)
        yield plot_velocities(folder / f'{name}_velocities.png', times, motion.velocities,
                              motion.robot.velocity, names,
                              title=f'{caption}: joint velocities', changes=changes)
    yield plot_errors(
        folder / 'lab2_errors.png', times,
        [(order, unit, motion.errors[task]) for task, unit in (('end_effector', 'm'),
                                                               ('joint1', 'rad'))
         for order, motion in motions.items()],
        title='Error of the end-effector (top) and of joint 1 (bottom)', changes=changes)


def _film(path: Path, motion: Run, title: str, points: Sequence[Point]) -> tuple[Path, ...]:
    """Return the path of a film, with numbered goals if there are several; see `films`."""
    goals = [(GOAL_TIME * index, 'end_effector', point) for index, point in enumerate(points)]
    captions = [(now, f'{title}: goal {number} of {len(goals)}' if len(goals) > 1 else title)
                for number, (now, *_) in enumerate(goals, 1)]
    return films(path, Motion(
        title, motion.robot, motion.times, motion.q, motion.stack,
        Look((END_EFFECTOR,), view=TOP_VIEW, ground=GROUND_HEIGHT, enlarged=ENLARGED), goals,
        captions))

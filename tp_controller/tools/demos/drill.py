# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
``tp_controller demo drill``: drilling, a task of five rows, above three inequality tasks.

The tip of a 7-DoF arm follows a target that moves and turns; the rotation about the drill is free.
The lower levels, in this order, require markers on the hand in the view of a camera, a distance
from singularities, and a distance from the joint limits. If the drill needs it, these bounds are
violated, the lowest first.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from tp_controller import Controller, KinematicSimulator, Robot, RobotState, Settings, Stack
from tp_controller.control.units import with_unit
from tp_controller.model.shapes import Cylinder
from tp_controller.model.spatial import Array
from tp_controller.resources import package_share
from tp_controller.tasks.cone import FieldOfView
from tp_controller.tasks.joint_limits import JointLimits
from tp_controller.tools.demos.motion import FixedObject, Look, Motion
from tp_controller.tools.demos.outcome import films, Measurement, Outcome
from tp_controller.tools.plots.curves import plot_bounds

PERIOD = 0.01
DURATION = 40.0
START = (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785)
TOOL = 'panda_hand_tcp'
# Period of the target [s].
TARGET_PERIOD = 20.0
# Time after which the drill follows the target [s].
SETTLED = 3.0
# Largest errors of the first level [mm, °].
MOST_TIP_ERROR, MOST_AXIS_ERROR = 0.5, 0.5
# A drill with its bit, with the tip at the origin of the tool frame.
DRILL = (FixedObject(TOOL, Cylinder(0.03, 0.07), (0.0, 0.0, -0.085)),
         FixedObject(TOOL, Cylinder(0.006, 0.05), (0.0, 0.0, -0.025)))
VIEW = (-40.0, 25.0)
LOWER = {'markers': 'angle between marker and camera [rad]',
         'mobile': 'manipulability, share of its minimum [1]',
         'joints': 'joint nearest to its limit: distance [rad]'}
CAPTIONS = {'markers': 'markers in view', 'mobile': 'away from singularities',
            'joints': 'away from joint limits'}


def target(now: float) -> tuple[Array, Array]:
    """Return the target tip (3,) [m] and drill axis (3,), a unit vector, at a time [s]."""
    turn = 2.0 * np.pi * now / TARGET_PERIOD
    tip = np.array([0.5 + 0.12 * np.sin(turn), 0.35 * np.sin(2.0 * turn),
                    0.3 + 0.12 * np.cos(turn)])
    axis = np.array([0.35 * np.sin(turn + 0.5), 0.5 * np.sin(2.0 * turn), -1.0])
    return tip, axis / np.linalg.norm(axis)


@dataclass(frozen=True, eq=False)
class _Recording:
    """Recorded run, one sample for each period."""

    robot: Robot
    stack: Stack
    times: Array  # (T,) [s]
    q: Array  # (T, n) [rad]
    velocities: Array  # (T, n), commands [rad/s]
    tips: Array  # (T, 3), targets of the tip [m]
    tip: Array  # (T,), error of the tip [mm]
    axis: Array  # (T,), error of the drill [°]
    values: Mapping[str, Array]  # {lower task: (T,)}, described by `LOWER`
    outside: Mapping[str, Array]  # {lower task: (T,)}, violations of its bounds


def record(duration: float = DURATION) -> _Recording:
    """Return the record of a run of a duration [s]."""
    config = package_share() / 'config'
    robot = Robot.from_file(config / 'robots' / 'panda.yaml')
    stack = Stack.from_yaml(config / 'drill_stack.yaml', robot)
    controller = Controller(robot, stack, Settings(period=PERIOD))
    simulator = KinematicSimulator(robot, START)
    rows = []
    for step in range(round(duration / PERIOD)):
        now = step * PERIOD
        tip, axis = _follow(controller, now)
        command = controller.update(simulator.q, now)
        state = robot.state(simulator.q)
        rows.append((now, simulator.q, command.velocity, tip, *_errors(state, tip, axis),
                     _lower_values(robot, stack, state),
                     [task.errors[0][0] for task in command.report.tasks[2:5]]))
        simulator.command(command.velocity)
        simulator.step(PERIOD)
    times, q, velocities, tips, tip_errors, axis_errors, values, outside = (
        np.array(column) for column in zip(*rows))
    return _Recording(robot, stack, times, q, velocities, tips, tip_errors, axis_errors,
                      dict(zip(LOWER, values.T)), dict(zip(LOWER, outside.T)))


def _errors(state: RobotState, tip: Array, axis: Array) -> tuple[float, float]:
    """Return the errors of tip [mm] and drill [°]."""
    shown = state.rotation(TOOL)[:, 2]
    angle = np.arctan2(np.linalg.norm(np.cross(shown, axis)), shown.dot(axis))
    return float(1e3 * np.linalg.norm(state.position(TOOL) - tip)), float(np.degrees(angle))


def _lower_values(robot: Robot, stack: Stack, state: RobotState) -> list[float]:
    """Return the values that `LOWER` describes."""
    tasks = stack.tasks
    margin = np.minimum(state.q - robot.lower, robot.upper - state.q).min()
    markers = cast(FieldOfView, tasks['markers'])
    return [markers.angle(state), tasks['mobile'].value(state)[0], margin]


def drill(folder: str | Path) -> Outcome:
    """Run the demonstration, and write its figures to a folder."""
    motion = record()
    settled = motion.times >= SETTLED
    share = 100.0 * np.abs(motion.velocities / motion.robot.velocity).max()
    beyond = np.maximum(motion.robot.lower - motion.q, motion.q - motion.robot.upper).max()
    measurements = (
        Measurement(f'tip, largest error from {SETTLED:.0f} s on', 'mm',
                    motion.tip[settled].max(), MOST_TIP_ERROR, 0.0, bound=True),
        Measurement(f'drill, largest error from {SETTLED:.0f} s on', '°',
                    motion.axis[settled].max(), MOST_AXIS_ERROR, 0.0, bound=True),
        Measurement('joint speed, share of the limit', '%', share, 100.0, 0.0, bound=True),
        Measurement('beyond a position limit', 'rad', beyond, 0.0, 0.0, bound=True))
    return Outcome('Drilling along a moving target, with lower tasks', measurements,
                   tuple(_violations(motion)), tuple(_figures(Path(folder), motion)))


def _follow(controller: Controller, now: float) -> tuple[Array, Array]:
    """Set the target and its velocity at a time; return the target."""
    tip, axis = target(now)
    next_tip, next_axis = target(now + PERIOD)
    controller.set_goal('tip', tip, now)
    controller.set_feed_forward('tip', (next_tip - tip) / PERIOD, now)
    controller.set_goal('drill', axis, now)
    controller.set_feed_forward('drill', np.cross(axis, next_axis - axis) / PERIOD, now)
    return tip, axis


def _violations(motion: _Recording) -> Iterator[str]:
    """Yield lines with the times and sizes of violated bounds."""
    yield ''
    yield 'Violated bounds of the tasks below:'
    for name, task in list(motion.stack.tasks.items())[2:5]:
        (_, unit, tolerance), = task.groups
        outside = motion.outside[name]
        for first, last in _intervals(outside > tolerance):
            yield (f'  {name:<8} {motion.times[first]:5.1f} s to {motion.times[last]:5.1f} s, '
                   f'by {with_unit(f"{outside[first:last + 1].max():.3f}", unit)}')
    yield ''


def _intervals(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return (first, last) of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(int)))
    return [(first, last - 1) for first, last in zip(edges[::2], edges[1::2])]


def _figures(folder: Path, motion: _Recording) -> Iterator[Path]:
    """Write the figures and yield their paths."""
    tasks, nothing = motion.stack.tasks, -np.inf
    markers, joints = cast(FieldOfView, tasks['markers']), cast(JointLimits, tasks['joints'])
    settled = motion.times >= SETTLED
    yield plot_bounds(
        folder / 'drill.png', motion.times[settled],
        [(label, values[settled], lower, upper) for label, values, lower, upper in (
            ('tip off by [mm]', motion.tip, nothing, MOST_TIP_ERROR),
            ('drill off by [°]', motion.axis, nothing, MOST_AXIS_ERROR),
            (LOWER['markers'], motion.values['markers'], nothing, float(markers.upper)),
            (LOWER['mobile'], motion.values['mobile'], 1.0, np.inf),
            (LOWER['joints'], motion.values['joints'], joints.margin, np.inf))],
        title='Drilling > markers in view > away from singularities > away from joint limits')
    goals = [(now, name, goal) for now in motion.times.tolist()
             for name, goal in zip(('tip', 'drill'), target(now))]
    yield from films(folder / 'drill.webp', Motion(
        'Drilling along a moving target', motion.robot, motion.times, motion.q, motion.stack,
        Look((TOOL,), DRILL, view=VIEW), goals, list(_captions(motion))))


def _captions(motion: _Recording) -> Iterator[tuple[float, str]]:
    """Yield (time, text) for each change of the set of violated tasks."""
    tolerances = {name: motion.stack.tasks[name].groups[0].tolerance for name in motion.outside}
    shown = None
    for sample, now in enumerate(motion.times.tolist()):
        outside = [name for name, values in motion.outside.items()
                   if values[sample] > tolerances[name]]
        text = f'relaxed: {", ".join(CAPTIONS[name] for name in outside)}' if outside \
            else 'the drill and all tasks below are satisfied'
        if text != shown:
            shown = text
            yield now, text

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
``tp_controller demo drill``: drilling, a task of five rows, above three inequality tasks.

The tip of a 7-DoF arm follows a target that moves and turns; the rotation about the drill is free.
The lower levels, in this order, require markers on the hand in the view of a camera, a distance
from singularities, and a distance from the joint limits. If the drill needs it, these bounds are
violated, the lowest first.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.units import with_unit
from tp_controller.model.shapes import Cylinder
from tp_controller.model.spatial import Array
from tp_controller.resources import package_share
from tp_controller.tasks.cone import FieldOfView
from tp_controller.tasks.joint_limits import JointLimits
from tp_controller.tools.demos.motion import FixedObject, Look, Motion
from tp_controller.tools.demos.outcome import films, Measurement, Outcome
from tp_controller.tools.demos.simulation import intervals, Run, simulate
from tp_controller.tools.plots.curves import BoundedCurves, plot_bounds

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


def record(duration: float = DURATION) -> Run:
    """Return the run of a duration [s]."""
    config = package_share() / 'config'
    robot = Robot.from_file(config / 'robots' / 'panda.yaml')
    stack = Stack.from_yaml(config / 'drill_stack.yaml', robot)
    controller = Controller(robot, stack, Settings(period=PERIOD))
    return simulate(controller, START, round(duration / PERIOD),
                    lambda now: _follow(controller, now))


def drill_errors(motion: Run) -> tuple[Array, Array]:
    """Return the errors of tip (T,) [mm] and drill (T,) [°]."""
    tips, axes = map(np.array, zip(*map(target, motion.times.tolist())))
    tip = np.linalg.norm(motion.values(lambda state: state.position(TOOL)) - tips, axis=1)
    shown = motion.values(lambda state: state.rotation(TOOL)[:, 2])
    angle = np.arctan2(np.linalg.norm(np.cross(shown, axes), axis=1), (shown * axes).sum(axis=1))
    return 1e3 * tip, np.degrees(angle)


def lower_values(motion: Run) -> dict[str, Array]:
    """Return {lower task: values (T,)}, described by `LOWER`."""
    tasks = motion.stack.tasks
    markers = cast(FieldOfView, tasks['markers'])
    return {'markers': motion.values(markers.angle),
            'mobile': motion.values(lambda state: tasks['mobile'].value(state)[0]),
            'joints': motion.clearance}


def drill(folder: str | Path) -> Outcome:
    """Run the demonstration, and write its figures to a folder."""
    motion = record()
    tip, axis = drill_errors(motion)
    settled = motion.times >= SETTLED
    share = 100.0 * np.abs(motion.velocities / motion.robot.velocity).max()
    measurements = (
        Measurement(f'tip, largest error from {SETTLED:.0f} s on', 'mm',
                    tip[settled].max(), MOST_TIP_ERROR, 0.0, bound=True),
        Measurement(f'drill, largest error from {SETTLED:.0f} s on', '°',
                    axis[settled].max(), MOST_AXIS_ERROR, 0.0, bound=True),
        Measurement('joint speed, share of the limit', '%', share, 100.0, 0.0, bound=True),
        Measurement('beyond a position limit', 'rad', -motion.clearance.min(), 0.0, 0.0,
                    bound=True))
    return Outcome('Drilling along a moving target, with lower tasks', measurements,
                   tuple(_violations(motion)), tuple(_figures(Path(folder), motion, tip, axis)))


def _follow(controller: Controller, now: float) -> None:
    """Set the target and its velocity at a time."""
    tip, axis = target(now)
    next_tip, next_axis = target(now + PERIOD)
    controller.set_goal('tip', tip, now)
    controller.set_feed_forward('tip', (next_tip - tip) / PERIOD, now)
    controller.set_goal('drill', axis, now)
    controller.set_feed_forward('drill', np.cross(axis, next_axis - axis) / PERIOD, now)


def _violations(motion: Run) -> Iterator[str]:
    """Yield lines with the times and sizes of violated bounds."""
    yield ''
    yield 'Violated bounds of the tasks below:'
    for name, task in list(motion.stack.tasks.items())[2:5]:
        (_, unit, tolerance), = task.groups
        outside = motion.errors[name]
        for first, last in intervals(outside > tolerance):
            yield (f'  {name:<8} {motion.times[first]:5.1f} s to {motion.times[last]:5.1f} s, '
                   f'by {with_unit(f"{outside[first:last + 1].max():.3f}", unit)}')
    yield ''


def _figures(folder: Path, motion: Run, tip: Array, axis: Array) -> Iterator[Path]:
    """Write the figures and yield their paths."""
    tasks, nothing = motion.stack.tasks, -np.inf
    markers, joints = cast(FieldOfView, tasks['markers']), cast(JointLimits, tasks['joints'])
    settled, lower = motion.times >= SETTLED, lower_values(motion)
    yield plot_bounds(
        folder / 'drill.png', motion.times[settled],
        [BoundedCurves(label, {'': values[settled]}, *bounds) for label, values, *bounds in (
            ('tip off by [mm]', tip, nothing, MOST_TIP_ERROR),
            ('drill off by [°]', axis, nothing, MOST_AXIS_ERROR),
            (LOWER['markers'], lower['markers'], nothing, float(markers.upper)),
            (LOWER['mobile'], lower['mobile'], 1.0, np.inf),
            (LOWER['joints'], lower['joints'], joints.margin, np.inf))],
        title='Drilling > markers in view > away from singularities > away from joint limits')
    goals = [(now, name, goal) for now in motion.times.tolist()
             for name, goal in zip(('tip', 'drill'), target(now))]
    yield from films(folder / 'drill.webp', Motion(
        'Drilling along a moving target', motion.robot, motion.times, motion.q, motion.stack,
        Look((TOOL,), DRILL, view=VIEW), goals, list(_captions(motion))))


def _captions(motion: Run) -> Iterator[tuple[float, str]]:
    """Yield (time, text) for each change of the set of violated tasks."""
    tolerances = {name: motion.stack.tasks[name].groups[0].tolerance for name in LOWER}
    shown = None
    for sample, now in enumerate(motion.times.tolist()):
        outside = [name for name in LOWER if motion.errors[name][sample] > tolerances[name]]
        text = f'relaxed: {", ".join(CAPTIONS[name] for name in outside)}' if outside \
            else 'the drill and all tasks below are satisfied'
        if text != shown:
            shown = text
            yield now, text

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Plots of a recording."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tp_controller.errors import in_words, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tools.plots.curves import plot_errors, plot_tool_path, plot_velocities
from tp_controller.tools.plots.drawing import label
from tp_controller.tools.recording.goals import Goal
from tp_controller.tools.recording.history import History, nearest
from tp_controller.tools.recording.robots import (
    command_names,
    configurations,
    path_of,
    tool_frames,
)
from tp_controller.tools.recording.task_curves import MOST_CURVES

# Largest number of goals in a plot.
MOST_CHANGES = 40
# Topic of the same type that has no velocities.
POSITION_COMMANDS = 'position_controller/commands'


def draw(history: History, robot: Robot | None, folder: Path,
         remarks: list[str]) -> Iterator[tuple[str, Path]]:
    """
    Draw all plots for which the recording has data.

    Parameters
    ----------
    history : History
        History to plot.
    robot : Robot or None
        Robot, for its limits and the path of its tool.
    folder : pathlib.Path
        Folder of the plots.
    remarks : list of str
        List to which failures are added.

    Yields
    ------
    str, pathlib.Path
        Title of a plot, and its file.

    """
    changes = [goal.time for goal in history.goals.goals][:MOST_CHANGES]
    for name, plots in (('errors', _draw_errors(history, folder, changes)),
                        ('velocities', _draw_velocities(history, robot, folder, changes)),
                        ('velocities of the base', _draw_base(history, robot, folder, changes)),
                        ('path', _draw_path(history, robot, folder))):
        try:
            yield from plots
        except (OSError, TpControllerError, ImportError):
            raise
        except Exception as error:
            # Arbitrary recorded data may be impossible to plot.
            remarks.append(f'no plot of {name}: {in_words(error)}')


def _draw_errors(history: History, folder: Path,
                 changes: list[float]) -> Iterator[tuple[str, Path]]:
    """Draw the errors of the tasks."""
    times, errors, causes = history.curves.plotted()
    if errors:
        yield 'Task errors', plot_errors(folder / 'errors.png', times, errors, causes=causes,
                                         changes=changes, log=True)


def _draw_velocities(history: History, robot: Robot | None, folder: Path,
                     changes: list[float]) -> Iterator[tuple[str, Path]]:
    """Draw the velocities of the joints."""
    topic = command_topic(history)
    if topic:
        times, velocities = history.commands[topic].rows()
        names = command_names(history, robot, velocities.shape[1])
        limits, units = _limits(robot, names)
        yield 'Joint velocities', plot_velocities(
            folder / 'velocities.png', times, velocities[:, :MOST_CURVES], limits[:MOST_CURVES],
            [label(name) for name in names[:MOST_CURVES]], units=units[:MOST_CURVES],
            changes=changes)


def command_topic(history: History) -> str:
    """Return the topic of the joint velocities; empty if there is none."""
    topics = [topic for topic in history.commands if not topic.endswith(POSITION_COMMANDS)]
    return nearest(topics, ['velocity_controller/commands'], history.namespace)


def _limits(robot: Robot | None, names: list[str]) -> tuple[Array, list[str]]:
    """Return the velocity limits and units of joints; infinite limits if unknown."""
    known = {} if robot is None else dict(zip(robot.velocity_names, zip(
        robot.velocity.tolist(), robot.velocity_units)))
    rows = [known.get(name, (np.inf, 'rad')) for name in names]
    return np.array([limit for limit, _ in rows]), [unit for _, unit in rows]


def _draw_base(history: History, robot: Robot | None, folder: Path,
               changes: list[float]) -> Iterator[tuple[str, Path]]:
    """Draw the velocities of a base."""
    topic = nearest(list(history.twists), ['cmd_vel'], history.namespace)
    if not topic or robot is None or not robot.moves:
        return
    times, twists = history.twists[topic].rows()
    count = robot.joint_columns.start
    velocities = np.array([robot.base_velocities(twist) for twist in twists])
    yield 'Velocities of the base', plot_velocities(
        folder / 'base_velocities.png', times, velocities, robot.velocity[:count],
        robot.velocity_names[:count], units=robot.velocity_units[:count],
        title='Velocities of the base', changes=changes)


def _draw_path(history: History, robot: Robot | None,
               folder: Path) -> Iterator[tuple[str, Path]]:
    """Draw the path of the frame of the task with the highest priority."""
    if robot is None:
        return
    times, q, passive, _ = configurations(history, robot)
    frames = tool_frames(history, robot)
    if len(times) < 2 or not frames:
        return
    task, frame = next(iter(frames.items()))
    yield f'Path of {frame}', plot_tool_path(
        folder / 'tool_path.png', path_of(robot, frame, q, passive),
        _points(history.goals.goals, task, robot), times=times, title=f'Path of {label(frame)}')


def _points(goals: list[Goal], task: str, robot: Robot) -> Array:
    """Return the positions (k, 3) of accepted goals of a task in the root frame [m]."""
    return np.array([goal.point for goal in goals
                     if goal.task == task and goal.point is not None and goal.accepted
                     and goal.frame in ('', robot.root)]).reshape(-1, 3)

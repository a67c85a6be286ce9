# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``tp_controller demo``: robots carry out stacks of tasks, through real topics."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import zip_longest
import os
from pathlib import Path
import time
from typing import cast, TYPE_CHECKING

import numpy as np
from tp_controller.demos.film import write_film
from tp_controller.demos.live_page import start_page
from tp_controller.demos.motion import Motion
from tp_controller.demos.processes import (
    ended_by_sigterm,
    NodeProcess,
    own_domain,
    start_nodes,
)
from tp_controller.demos.scenarios import Demo, Goal, goal_fields
from tp_controller.errors import TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.plots.curves import plot_errors, plot_tool_path, plot_velocities
from tp_controller.tasks.frame import FrameTask
from tp_controller.untrusted import errors_of

if TYPE_CHECKING:  # Imported when a demo starts: nothing else here needs ROS.
    from tp_controller.nodes.client import Client
    from tp_controller.nodes.recorder import Recorder

# Discovery mostly takes less than 50 ms, now and then 3 s.
START_SECONDS = 20.0
GOAL_SECONDS = 20.0
# A goal is looked at a little longer than it takes to reach it.
LINGER_SECONDS = 0.5
PROGRESS_SECONDS = 1.0
# A velocity has to be repeated, or it times out.
REPEAT_SECONDS = 0.1
# Errors in units that suit their size.
SHOWN = {'m': '{:8.2f} mm', 'rad': '{:6.2f}°', 'm/s': '{:8.2f} mm/s'}
FACTORS = {'m': 1e3, 'rad': np.degrees(1.0), 'm/s': 1e3}
DONE = ('reached', 'satisfied')


@dataclass(frozen=True)
class TaskOutcome:
    """
    What became of one task under one goal.

    Attributes
    ----------
    goal : str
        Number and name of the goal, empty for a task that went on with its own.
    task, error, status, reason : str
        As the status of the controller has them.
    asked : bool
        The goal was for this task.

    """

    goal: str
    task: str
    error: str
    status: str
    asked: bool
    reason: str

    @property
    def reached(self) -> bool:
        """Return whether the task is reached or satisfied."""
        return self.status in DONE

    def __str__(self) -> str:
        """Return a line of the table."""
        outcome = self.status if self.reached else self.reason or 'moving'
        if self.asked and not self.reached:
            outcome = f'not reached: {self.reason or "out of time"}'
        mark = '>' if self.asked else ' '
        return f'{self.goal:<42} {mark} {self.task:<8} {self.error:<24} {outcome}'


def run_demo(demo: Demo, folder: Path, page: bool = False) -> bool:
    """
    Run a demo, print its table and write its figures.

    Parameters
    ----------
    demo : Demo
        One of `DEMOS`.
    folder : pathlib.Path
        Where figures and logs go.
    page : bool
        Show it on a page in the browser while it runs, too.

    Returns
    -------
    bool
        Whether every goal was reached, within the limits.

    """
    with ExitStack() as stack:
        all_started = stack.enter_context(ended_by_sigterm())
        environment = stack.enter_context(own_domain())
        # The client lives in this process, which has to be in the same domain.
        os.environ.update(environment)
        if page:
            print(start_page(stack, environment, folder), flush=True)
        nodes = start_nodes(stack, demo.file(''), environment, folder)
        all_started()
        from tp_controller.nodes.client import Client
        from tp_controller.nodes.recorder import Recorder
        client = stack.enter_context(Client())
        recorder = Recorder(client, demo.robot)
        _wait_until_running(client, recorder, nodes)
        print(demo.file('_stack').read_text())
        client.wait(lambda: False, LINGER_SECONDS)
        outcomes: list[TaskOutcome] = []
        changes: list[float] = []
        for number, step in enumerate(demo.steps, 1):
            changes.append(recorder.now())
            outcomes.extend(_carry_out(client, nodes, step, number))
    print(f'\n{"goal":<42} {"  task":<10} {"error":<24} outcome')
    print('\n'.join(map(str, outcomes)))
    print('\n> marks the task that the goal was for. The others keep their own goals, in the '
          'null space of the tasks above.')
    within = _check_limits(demo.robot, recorder)
    print('\nWritten:')
    for path in _figures(folder, demo, recorder, changes):
        print(f'  {path}', flush=True)
    return within and all(outcome.reached for outcome in outcomes if outcome.asked)


def _wait_until_running(client: 'Client', recorder: 'Recorder',
                        nodes: Sequence[NodeProcess]) -> None:
    """Wait for the first commands, until everything that is recorded comes in."""
    def ready() -> bool:
        _check_alive(nodes)
        return recorder.hears() and not client.stop_reason() and bool(client.tasks())

    if not client.wait(ready, START_SECONDS):
        raise TpControllerError(f'the controller did not start: {client.stop_reason()}\n'
                                + '\n'.join(node.output() for node in nodes))


def _check_alive(nodes: Sequence[NodeProcess]) -> None:
    """Raise with the output of a node that ended."""
    for node in nodes:
        if not node.running():
            raise TpControllerError(f'a node ended:\n{node.output()}')


def _carry_out(client: 'Client', nodes: Sequence[NodeProcess], step: Sequence[Goal],
               number: int) -> list[TaskOutcome]:
    """Send goals, show the progress, and return what became of every task."""
    titles = {goal['task']: f'{number} {goal["say"]}' for goal in step}
    for goal in step:
        client.send(goal['task'], **goal_fields(goal))
    lasts = max(goal.get('for', 0.0) for goal in step)
    began = time.monotonic()
    shown, sent = 0.0, began

    def reached() -> bool:
        nonlocal shown, sent
        _check_alive(nodes)
        now = time.monotonic()
        if lasts and now - sent > REPEAT_SECONDS:
            sent = now
            client.repeat()
        if now - shown > PROGRESS_SECONDS:
            shown = now
            for task, title in titles.items():
                print(f'{title:<42}   {task:<8} {_errors(client.task_status(task)):<24} '
                      f'{now - began:4.1f} s', flush=True)
        return now - began >= lasts and all(
            client.task_status(task)['status'] == 'reached' for task in titles)

    client.wait(reached, GOAL_SECONDS)
    # Asked all the same, or a velocity would not be repeated.
    client.wait(lambda: reached() and False, LINGER_SECONDS)
    # A controller that stopped meanwhile, as where joint states come late, goes on by itself.
    client.wait(reached, began + GOAL_SECONDS - time.monotonic())
    return [_outcome(client, title, task, task in titles) for task, title in zip_longest(
        client.task_names(), titles.values(), fillvalue='')]


def _outcome(client: 'Client', title: str, task: str, asked: bool) -> TaskOutcome:
    """Return what became of a task."""
    status = client.task_status(task)
    return TaskOutcome(title, task, _errors(status), status['status'], asked,
                       status['reason'] or client.stop_reason())


def _errors(status: Mapping[str, str]) -> str:
    """Return the errors of a task, with units that suit their size."""
    return ', '.join(SHOWN[unit].format(FACTORS[unit] * error)
                     for unit, error in errors_of(status).items() if unit in SHOWN)


def _check_limits(robot: Robot, recorder: 'Recorder') -> bool:
    """Say how much of the limits was used; return whether none was exceeded."""
    velocities = np.array([command for _, command in recorder.commands])
    positions = np.array([robot.positions(q) for _, q in recorder.states])
    shares = (np.abs(velocities) / robot.velocity).max(axis=0)
    margins = np.minimum(positions - robot.lower, robot.upper - positions).min(axis=0)
    nearest, base = margins.argmin(), shares[:robot.joint_columns.start]
    of_base = f' ({100.0 * base.max():.0f} % of one of the base)' if robot.moves else ''
    print(f'\n{len(velocities)} commands, {len(positions)} joint states: at most '
          f'{100.0 * shares.max():.0f} % of a velocity limit{of_base}, never nearer than '
          f'{margins[nearest]:.3f} {robot.velocity_units[nearest]} to a position limit')
    return bool(shares.max() <= 1.0 and margins[nearest] >= 0.0)


def _figures(folder: Path, demo: Demo, recorder: 'Recorder',
             goal_times: Sequence[float]) -> Iterator[Path]:
    """Write the figures and yield their paths."""
    robot, leader = demo.robot, cast(FrameTask, demo.stack.tasks[demo.leader])
    # Time zero is the first goal; a little of the rest before it is shown, too.
    recorder.cut(goal_times[0] - LINGER_SECONDS, goal_times[0])
    changes = np.array(goal_times) - goal_times[0]
    times, q = (np.array(column) for column in zip(*recorder.states))
    command_times, velocities = (np.array(column) for column in zip(*recorder.commands))
    yield plot_errors(folder / 'errors.png', *_error_curves(recorder),
                      reasons=_reasons(recorder), changes=changes, log=True)
    yield plot_velocities(folder / 'velocities.png', command_times, velocities, robot.velocity,
                          robot.velocity_names, units=robot.velocity_units, changes=changes,
                          title='Velocities of base and joints' if robot.moves
                          else 'Joint velocities')
    state = robot.state(q[0])
    path = []
    for configuration in q:
        state.update(configuration)
        path.append(state.position(leader.frame))
    goals = [(change, goal['xyz']) for step, change in zip(demo.steps, changes)
             for goal in step if goal['task'] == demo.leader]
    yield plot_tool_path(folder / 'tool_path.png', np.array(path),
                         np.array([goal for _, goal in goals]), times=times)
    yield write_film(folder / 'film.webp', Motion(
        demo.title, robot, times, q, demo.stack, (leader.frame, *demo.frames),
        list(_film_goals(demo, changes)), _captions(demo, changes), demo.objects, demo.carried,
        demo.view, demo.ground))


def _film_goals(demo: Demo, changes: Array) -> Iterator[tuple[float, str, list[float]]]:
    """Yield time, task and goal of the goals that are drawn."""
    for step, change in zip(demo.steps, changes.tolist()):
        for goal in step:
            if goal['task'] == demo.leader:
                fields = goal_fields(goal)
                yield change, demo.leader, [*fields['xyz'], *fields.get('quat_xyzw', ())]


def _captions(demo: Demo, changes: Array) -> list[tuple[float, str]]:
    """Return when a step began, and what it is about."""
    return [(change, f'{number}/{len(demo.steps)}  ' + '; '.join(goal['say'] for goal in step))
            for number, (step, change) in enumerate(zip(demo.steps, changes.tolist()), 1)]


def _error_curves(recorder: 'Recorder') -> tuple[Array, list[tuple[str, str, Array]]]:
    """
    Return times (T,) and (task, unit, errors (T,)) of all that are not zero throughout.

    While the controller is stopped there are none: not a number, which interrupts the line.
    """
    times = np.array([moment for moment, _ in recorder.errors])
    known = dict.fromkeys(key for _, errors in recorder.errors for key in errors)
    curves = [(task, unit, np.array([errors.get((task, unit), np.nan)
                                     for _, errors in recorder.errors]))
              for task, unit in known if unit in ('m', 'rad')]
    return times, [curve for curve in curves if np.nanmax(curve[2]) > 0.0]


def _reasons(recorder: 'Recorder') -> dict[str, list[str]]:
    """Return what limits each task, at the times of the errors, in whatever order of shares."""
    rows = [reasons for _, reasons in recorder.reasons]
    return {task: ['; '.join(sorted(reasons.get(task, '').split('; '))) for reasons in rows]
            for task in dict.fromkeys(task for reasons in rows for task in reasons)}

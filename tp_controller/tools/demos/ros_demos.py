# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller demo``: robots execute stacks of tasks over ROS 2 topics."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
import os
from pathlib import Path
from typing import cast, TYPE_CHECKING

import numpy as np
from tp_controller.errors import TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tasks.frame import FrameTask
from tp_controller.tools.demos.live_page import LivePage, start_page
from tp_controller.tools.demos.motion import Motion
from tp_controller.tools.demos.outcome import films
from tp_controller.tools.demos.processes import (
    ended_by_sigterm,
    NodeProcess,
    own_domain,
    start_nodes,
)
from tp_controller.tools.demos.scenarios import Demo, goal_fields
from tp_controller.tools.demos.startup import check_alive, load, missing, report_if_slow, Startup
from tp_controller.tools.demos.steps import Steps, TaskOutcome
from tp_controller.tools.plots.curves import plot_errors, plot_tool_path, plot_velocities

if TYPE_CHECKING:  # Imported when a demo starts: nothing else here needs ROS.
    from tp_controller.ros.client.client import Client
    from tp_controller.tools.demos.motion_recorder import Recorder

# Recorded and displayed time before the first goal [s].
LINGER_SECONDS = 0.5


def run_demo(demo: Demo, folder: Path, page: bool = False, output: str = 'velocity') -> bool:
    """
    Run a demo, print its table and write its figures.

    Parameters
    ----------
    demo : Demo
        One of `DEMOS`.
    folder : pathlib.Path
        Folder of figures and logs.
    page : bool
        Whether to show it on a page in the browser, too.
    output : str
        Parameter `output` of the controller.

    Returns
    -------
    bool
        Whether every goal was reached within the limits.

    """
    with ExitStack() as stack:
        all_started = stack.enter_context(ended_by_sigterm())
        environment = stack.enter_context(own_domain())
        # The client runs in this process, which must be in the same domain.
        os.environ.update(environment)
        running = stack.enter_context(ExitStack())
        # The nodes start during the following imports.
        nodes = start_nodes(running, demo.file(''), environment, folder, output)
        startup = Startup(nodes, _print)
        live = _start_page(stack, environment, folder) if page else None
        all_started()
        with report_if_slow('importing the client', _print):
            from tp_controller.ros.client.client import Client
            from tp_controller.tools.demos.motion_recorder import Recorder
        client = stack.enter_context(Client())
        recorder = Recorder(client, demo.robot)
        startup.wait(lambda: _not_recorded(client, recorder), client.spin)
        if live is not None:
            _print(live.wait(client.spin, _print))
        print(demo.file('_stack').read_text())
        outcomes, changes = _carry_out(demo, client, recorder, nodes)
        within = _check_limits(demo.robot, recorder)
        if live is not None:
            live.conclude(client, _conclusion(outcomes))
        # The nodes would take processor time from the figures.
        running.close()
        print('\nWritten:')
        for path in _figures(folder, demo, recorder, changes):
            _print(f'  {path}')
    return within and all(outcome.reached for outcome in outcomes if outcome.asked)


def _carry_out(demo: Demo, client: 'Client', recorder: 'Recorder', nodes: Sequence[NodeProcess]
               ) -> tuple[list[TaskOutcome], list[float]]:
    """Run the steps of a demo; print and return the outcomes, and return their times."""
    # Time zero is the first goal; a short time before it is shown, too.
    recorder.restart(LINGER_SECONDS)
    client.wait(lambda: False, LINGER_SECONDS)
    steps = Steps(client, lambda: check_alive(nodes), lambda: len(recorder.commands) / demo.rate)
    outcomes: list[TaskOutcome] = []
    changes: list[float] = []
    for number, step in enumerate(demo.steps, 1):
        changes.append(recorder.now())
        outcomes.extend(steps.carry_out(step, number))
    print(f'\n{"goal":<42} {"  task":<10} {"error":<24} outcome')
    print('\n'.join(map(str, outcomes)))
    print('\n> marks the task that the goal was for. The others keep their own goals, in the '
          'null space of the tasks above.')
    if steps.pauses:
        print(f'\nThe controller paused {steps.pauses} times, because joint states or its own '
              f'cycles were late: this machine is busy ({load()}).')
    return outcomes, changes


def _conclusion(outcomes: Sequence[TaskOutcome]) -> str:
    """Return the conclusion on the page: a title, and a line for each goal."""
    asked = [outcome for outcome in outcomes if outcome.asked]
    reached = sum(outcome.reached for outcome in asked)
    lines = [f'{outcome.say}: {outcome.text} ({" ".join(outcome.error.split())})'
             for outcome in asked]
    return '\n'.join(('The demo has finished', f'{reached} of {len(asked)} goals reached', '',
                      *lines, '', 'This page is no longer connected once the demo has ended. To '
                      'play with a robot: tp_controller view'))


def _start_page(stack: ExitStack, environment: Mapping[str, str], folder: Path) -> LivePage | None:
    """Start the page of a demo; on failure print the reason."""
    try:
        return start_page(stack, environment, folder)
    except TpControllerError as error:
        _print(str(error))
        return None


def _not_recorded(client: 'Client', recorder: 'Recorder') -> str:
    """Return the first missing kind of data; empty if all were received."""
    if not recorder.states:
        return 'the joint states of the simulator'
    reason = missing(client)
    return reason or ('' if recorder.commands else 'the commands of the controller')


def _print(line: str) -> None:
    """Print a line without buffering."""
    print(line, flush=True)


def _check_limits(robot: Robot, recorder: 'Recorder') -> bool:
    """Print the used share of the limits; return whether none was exceeded."""
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
    changes = np.array(goal_times)
    times, q = (np.array(column) for column in zip(*recorder.states))
    command_times, velocities = (np.array(column) for column in zip(*recorder.commands))
    error_times, errors, causes = recorder.curves.plotted()
    yield plot_errors(folder / 'errors.png', error_times, errors, causes=causes,
                      changes=changes, log=True)
    yield plot_velocities(folder / 'velocities.png', command_times, velocities, robot.velocity,
                          robot.velocity_names, units=robot.velocity_units, changes=changes,
                          title='Velocities of base and joints' if robot.moves
                          else 'Joint velocities')
    state = robot.state(q[0])
    path = []
    for configuration in q:
        state.update(configuration)
        path.append(state.position(leader.frame))
    goals = list(_film_goals(demo, changes))
    yield plot_tool_path(folder / 'tool_path.png', np.array(path),
                         np.array([goal[:3] for *_, goal in goals]), times=times)
    yield from films(folder / 'film.webp', Motion(
        demo.title, robot, times, q, demo.stack,
        replace(demo.look, frames=(leader.frame, *demo.look.frames)), goals,
        _captions(demo, changes)))


def _film_goals(demo: Demo, changes: Array) -> Iterator[tuple[float, str, list[float]]]:
    """Yield time, task and goal of the goals to draw."""
    for step, change in zip(demo.steps, changes.tolist()):
        for goal in step:
            if goal['task'] == demo.leader:
                fields = goal_fields(goal)
                yield change, demo.leader, [*fields['xyz'], *fields.get('quat_xyzw', ())]


def _captions(demo: Demo, changes: Array) -> list[tuple[float, str]]:
    """Return the start time and the caption of each step."""
    return [(change, f'{number}/{len(demo.steps)}  ' + '; '.join(goal['say'] for goal in step))
            for number, (step, change) in enumerate(zip(demo.steps, changes.tolist()), 1)]

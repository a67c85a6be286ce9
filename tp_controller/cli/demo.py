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

"""``tp_controller demo``: a 7-DoF arm carries out a stack of tasks, through real topics."""

from contextlib import ExitStack
from dataclasses import dataclass
import os
import time

import numpy as np
from tp_controller.cli.plots import animate_arm, plot_errors, plot_tool_path, plot_velocities
from tp_controller.cli.processes import ended_by_sigterm, NodeProcess, own_domain
from tp_controller.errors import TpControllerError
from tp_controller.resources import load_yaml, package_share
from tp_controller.robot import Robot
from tp_controller.spatial import quaternion_from_rotation, rotation_from_rpy

TOOL = 'panda_hand_tcp'
# Discovery mostly takes less than 50 ms, now and then 3 s.
START_SECONDS = 20.0
GOAL_SECONDS = 20.0
# A goal is looked at a little longer than it takes to reach it.
LINGER_SECONDS = 0.5
PROGRESS_SECONDS = 1.0


@dataclass(frozen=True)
class Row:
    """What became of one task under one goal."""

    goal: str
    task: str
    error: str
    reached: bool
    asked: bool
    reason: str

    def __str__(self):
        """Return a line of the table."""
        outcome = 'reached' if self.reached else f'not reached: {self.reason or "out of time"}'
        if not self.asked:
            outcome = 'reached' if self.reached else (self.reason or 'moving')
        mark = '>' if self.asked else ' '
        return f'{self.goal:<42} {mark} {self.task:<8} {self.error:<24} {outcome}'


def panda(folder):
    """
    Run the demo, print its table and write its figures.

    Parameters
    ----------
    folder : pathlib.Path
        Where figures and logs go.

    Returns
    -------
    bool
        Whether every goal was reached, within the limits.

    """
    config = package_share() / 'config'
    robot = Robot.from_file(config / 'robots' / 'panda.yaml')
    goals = load_yaml((config / 'demo_goals.yaml').read_text())
    arguments = ['--params-file', str(config / 'demo.yaml')]
    with ExitStack() as stack:
        all_started = stack.enter_context(ended_by_sigterm())
        environment = stack.enter_context(own_domain())
        # The client lives in this process, which has to be in the same domain.
        os.environ.update(environment)
        nodes = [stack.enter_context(NodeProcess(name, arguments, environment,
                                                 folder / f'{name}.log'))
                 for name in ('simulator_node', 'controller_node')]
        all_started()
        from tp_controller.nodes.client import Client, Recorder
        client = stack.enter_context(Client())
        recorder = Recorder(client, robot.joint_names)
        _wait_until_running(client, nodes)
        print((config / 'demo_stack.yaml').read_text())
        rows, changes = [], []
        for number, goal in enumerate(goals, 1):
            changes.append(recorder.now())
            rows.extend(_carry_out(client, nodes, goal, f'{number} {goal["say"]}'))
    print(f'\n{"goal":<42} {"  task":<10} {"error":<24} outcome')
    print('\n'.join(map(str, rows)))
    print('\n> marks the task the goal was for; the others go on with their own, as far as the '
          'tasks above let them.')
    within = _check_limits(robot, recorder)
    print('\nWritten:')
    for path in _figures(folder, robot, recorder, goals, changes):
        print(f'  {path}', flush=True)
    return within and all(row.reached for row in rows if row.asked)


def _wait_until_running(client, nodes):
    """Wait for the first commands."""
    def ready():
        _check_alive(nodes)
        return client.status is not None and not client.hold() and client.tasks()

    if not client.wait(ready, START_SECONDS):
        raise TpControllerError(f'the controller did not start: {client.hold()}\n'
                                + '\n'.join(node.output() for node in nodes))


def _check_alive(nodes):
    """Raise with the output of a node that ended."""
    for node in nodes:
        if not node.running():
            raise TpControllerError(f'a node ended:\n{node.output()}')


def _carry_out(client, nodes, goal, title):
    """Send a goal, show the progress, and return a row for every task."""
    fields = {'xyz': goal['xyz']}
    if 'rpy' in goal:
        fields['quat_xyzw'] = quaternion_from_rotation(rotation_from_rpy(*goal['rpy']))
    client.send(goal['task'], **fields)
    shown, began = 0.0, time.monotonic()

    def reached():
        nonlocal shown
        _check_alive(nodes)
        status = client.task_status(goal['task'])
        if time.monotonic() - shown > PROGRESS_SECONDS:
            shown = time.monotonic()
            print(f'{title:<42}   {goal["task"]:<8} {_errors(status):<24} '
                  f'{shown - began:4.1f} s', flush=True)
        return status['status'] == 'reached'

    client.wait(reached, GOAL_SECONDS)
    client.wait(lambda: False, LINGER_SECONDS)
    return [_row(client, '' if index else title, task, task == goal['task'])
            for index, task in enumerate(client.task_names())]


def _row(client, title, task, asked):
    """Return the row of a task."""
    status = client.task_status(task)
    return Row(title, task, _errors(status), status['status'] == 'reached', asked,
               status['reason'])


def _errors(status):
    """Return the errors of a task, with units that suit their size."""
    parts = []
    for key, value in status.items():
        if key == 'error [m]':
            parts.append(f'{1e3 * float(value):8.2f} mm')
        elif key == 'error [rad]':
            parts.append(f'{np.degrees(float(value)):6.2f}°')
    return ', '.join(parts)


def _check_limits(robot, recorder):
    """Say how much of the limits was used; return whether none was exceeded."""
    velocities = np.array([command for _, command in recorder.commands])
    q = np.array([positions for _, positions in recorder.states])
    share = (np.abs(velocities) / robot.velocity).max()
    margin = np.minimum(q - robot.lower, robot.upper - q).min()
    print(f'\n{len(velocities)} commands, {len(q)} joint states: at most {100.0 * share:.0f} % of '
          f'a velocity limit, never nearer than {margin:.3f} rad to a position limit')
    return bool(share <= 1.0 and margin >= 0.0)


def _figures(folder, robot, recorder, goals, changes):
    """Write the figures and yield their paths."""
    # Time zero is the first goal; a little of the rest before it is shown, too.
    recorder.cut(changes[0] - LINGER_SECONDS, changes[0])
    changes = np.array(changes) - changes[0]
    times, q = (np.array(column) for column in zip(*recorder.states))
    command_times, velocities = (np.array(column) for column in zip(*recorder.commands))
    status_times = np.array([moment for moment, errors in recorder.errors if errors])
    kept = [errors for _, errors in recorder.errors if errors]
    yield plot_errors(
        folder / 'errors.png', status_times,
        [(task, unit, np.array([errors[task, unit] for errors in kept]))
         for task, unit in kept[0]], title='Task errors', changes=changes, log=True)
    yield plot_velocities(folder / 'velocities.png', command_times, velocities, robot.velocity,
                          robot.joint_names, changes=changes)
    state = robot.state(q[0])
    path = []
    for positions in q:
        state.update(positions)
        path.append(state.position(TOOL))
    tool_goals = [goal['xyz'] for goal in goals if goal['task'] == 'tool']
    yield plot_tool_path(folder / 'tool_path.png', np.array(path), np.array(tool_goals),
                         times=times)
    yield animate_arm(folder / 'arm.gif', robot, q, times,
                      goals=_goals_over_time(times, goals, changes, path[0]),
                      title='Panda: tool, elbow, posture')


def _goals_over_time(times, goals, changes, start):
    """Return the goal of the tool at each time (T, 3); where it started before the first."""
    current = np.tile(start, (len(times), 1))
    for goal, change in zip(goals, changes):
        if goal['task'] == 'tool':
            current[times >= change] = goal['xyz']
    return current

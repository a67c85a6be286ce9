# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Roll-outs: they are what the closed loop does later."""

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.roll_out import HORIZON, RollOuts

# The period of roll-outs, in which nothing is pending or blended in.
ALIKE = Settings(period=0.02, command_delay=0, blend=0.0, braking_gain=10.0)
PANDA = """
- tool: {type: pose, frame: panda_hand_tcp}
- wrist: {type: position, frame: panda_link7, axes: z}
- rest: {type: posture}
"""
BASE = """
- tool: {type: position, frame: tool, gain: 2.0}
"""


def closed_loop(robot, stack, goals, q, settings, seconds):
    """Yield (time, q, report) of each cycle."""
    controller = Controller(robot, Stack.from_yaml(stack, robot), settings)
    controller.update(q, 0.0)
    for name, goal in goals.items():
        controller.set_goal(name, goal, 0.0)
    for cycle in range(1, int(seconds / settings.period)):
        now = cycle * settings.period
        command = controller.update(q, now)
        yield now, q, command.report
        q = robot.integrate(q, command.velocity, settings.period)


def panda(limits=None):
    """Return (robot, stack, goals, start) of a Panda whose wrist is in conflict with its tool."""
    robot = Robot.from_file(robots.PANDA_DH, limits=limits or {})
    goals = {'tool': [0.4, 0.3, 0.4, 1.0, 0.0, 0.0, 0.0], 'wrist': [0.0, 0.0, 0.7]}
    return robot, PANDA, goals, np.array(robots.PANDA_READY)


def base():
    """Return (robot, stack, goals, start) of a robot that drives to its goal."""
    robot = Robot.from_file(robots.CONFIG / 'robots' / 'mobile_arm.urdf', base='differential')
    return robot, BASE, {'tool': [3.0, 1.0, 0.0]}, robot.neutral()


@pytest.mark.parametrize('case', [
    panda, base, lambda: panda({'panda_joint1': {'acceleration': 2.0}})])
def test_roll_out_is_what_the_closed_loop_does(case):
    robot, stack, goals, q = case()
    cycles = list(closed_loop(robot, stack, goals, q, ALIKE, 1.2 * HORIZON))
    begin = 25
    course = RollOuts(robot, cycles[begin][2]._solved).unchanged
    distances = [np.abs(later - course.q).max() for _, later, _ in cycles[begin:]]
    assert min(distances) < 1e-9 and int(np.argmin(distances)) > 20
    reached = {task.name for task in cycles[-1][2].tasks if task.reached}
    assert {name for name, time in course.arrivals.items() if time <= HORIZON} == reached
    for name, arrival in course.arrivals.items():
        since = max(now for now, _, report in cycles
                    if not next(task for task in report.tasks if task.name == name).reached)
        assert arrival == pytest.approx(since - cycles[begin][0], rel=0.05, abs=0.05)


@pytest.mark.parametrize('period', [0.001, 0.01])
def test_period_of_a_roll_out_does_not_change_where_it_ends(period):
    robot, stack, goals, q = panda()
    *_, (_, _, report) = closed_loop(robot, stack, goals, q, ALIKE, 0.5)
    usual = RollOuts(robot, report._solved).unchanged
    rolled = RollOuts(robot, report._solved)
    rolled.setup = rolled.setup.with_settings(period=period)
    assert rolled.unchanged.q == pytest.approx(usual.q, abs=2e-3)
    assert rolled.unchanged.arrivals == pytest.approx(usual.arrivals, rel=0.1)


def test_roll_out_without_the_core_is_the_same(monkeypatch):
    robot, stack, goals, q = panda()
    *_, (_, _, report) = closed_loop(robot, stack, goals, q, ALIKE, 0.5)
    usual = RollOuts(robot, report._solved).unchanged
    monkeypatch.setattr('tp_controller.control.roll_out.compiled_step', lambda *_: None)
    found = RollOuts(robot, report._solved).unchanged
    assert found.q == pytest.approx(usual.q, abs=1e-8)
    assert found.arrivals == pytest.approx(usual.arrivals)


def test_changes_of_a_setup_are_those_of_the_controller():
    robot, stack, goals, q = panda()
    *_, (_, _, report) = closed_loop(robot, stack, goals, q, ALIKE, 0.5)
    rolled = RollOuts(robot, report._solved)
    setup, ends = rolled.setup, {}
    changes = {
        'exchange': setup.exchanged('tool', 'wrist'), 'above': setup.above('wrist', ['tool']),
        'without': setup.without('tool'),
        'slow': setup._replace(velocity=0.02 * setup.velocity),
        'elsewhere': setup.in_middle(['panda_joint1', 'panda_joint6']),
        'goal': setup.with_goals_at(robot.neutral(), None, ['wrist'])}
    for name, change in changes.items():
        ends[name] = rolled.course(change)
    usual = rolled.unchanged
    assert 'tool' in usual.arrivals and 'wrist' not in usual.arrivals
    assert 'wrist' in ends['exchange'].arrivals and 'tool' not in ends['exchange'].arrivals
    assert ends['above'].q == pytest.approx(ends['exchange'].q)
    assert 'tool' not in ends['without'].errors and 'wrist' in ends['without'].arrivals
    assert ends['slow'].arrivals['tool'] > 1.5 * usual.arrivals['tool']
    assert ends['elsewhere'].arrivals.get('tool') != usual.arrivals['tool']
    assert ends['goal'].errors['wrist'] != pytest.approx(usual.errors['wrist'], rel=0.1)
    # Nothing of that has changed the tasks of the cycle.
    assert RollOuts(robot, report._solved).unchanged.q == pytest.approx(usual.q, abs=1e-12)


def test_limits_are_raised_or_taken_away_in_a_setup_only():
    robot, stack, goals, q = panda()
    *_, (_, _, report) = closed_loop(robot, stack, goals, q, ALIKE, 0.5)
    setup = RollOuts(robot, report._solved).setup
    names, before = ['panda_joint2'], (robot.velocity[1], robot.upper[1], robot.lower[1])
    assert setup.without_limits('velocity', names).velocity[1] == 3.0 * robot.velocity[1]
    assert setup.without_limits('upper', names).robot.upper[1] > 1e5
    assert setup.without_limits('lower', names).robot.lower[1] < -1e5
    assert (robot.velocity[1], robot.upper[1], robot.lower[1]) == before


def test_directions_that_a_task_leaves_out_are_neither_demanded_nor_missed():
    robot = robots.cartesian()
    *_, (_, _, report) = closed_loop(
        robot, '- tool: {type: pose, frame: z}\n',
        {'tool': [0.5, 0.5, 0.1, 1.0, 0.0, 0.0, 0.0]}, np.zeros(3), ALIKE, 0.5)
    rolled = RollOuts(robot, report._solved)
    assert 'tool' not in rolled.unchanged.arrivals
    position = rolled.course(rolled.setup.with_part('tool', np.eye(6)[:, :3]))
    assert position.arrivals['tool'] <= HORIZON
    assert report.tasks[0].hint == ('leave out rx, ry and rz: the robot cannot move along or '
                                    'about them here')


def test_tasks_of_other_packages_are_not_rolled_out(monkeypatch):
    robot, stack, goals, q = panda()
    *_, (_, _, report) = closed_loop(robot, stack, goals, q, ALIKE, 0.1)
    assert RollOuts(robot, report._solved).unchanged is not None
    monkeypatch.setattr(type(report._solved.tasks[1][0]), '__module__', 'elsewhere')
    assert RollOuts(robot, report._solved).unchanged is None

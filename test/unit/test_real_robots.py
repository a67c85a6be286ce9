# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The files and pages of real robots: tables, limits, stacks, home, and what they say."""

from importlib import import_module
from pathlib import Path
import re

import numpy as np
import pytest
from tp_controller import Controller, GoalError, KinematicSimulator, Robot, Settings, Stack
from tp_controller.model.simulator import initial_positions
from tp_controller.model.spatial import rotation_from_rpy
import yaml

ROOT = Path(__file__).resolve().parents[2]
FILES = ROOT / 'config' / 'robots'
PAGES = ROOT / 'docs' / 'robots'
ROBOTS = ('ur5e', 'fr3', 'gen3', 'xarm7')
# Tool, and at home + 0.1, 0.2 … rad its position [m], x axis and z axis: from the URDFs of the
# manufacturers, made by xacro.
POSES = {
    'ur5e': ('tool0', (0.40219, 0.22238, 0.25853), (-0.58565, -0.78638, 0.1965),
             (-0.73207, 0.40908, -0.54473)),
    'fr3': ('fr3_hand_tcp', (0.40063, 0.2772, 0.70585), (0.82406, -0.47714, 0.30537),
            (0.54238, 0.50892, -0.66845)),
    'gen3': ('end_effector_link', (0.52358, -0.07744, 0.54455), (0.41358, 0.44897, -0.79207),
             (0.7629, 0.30393, 0.57063)),
    'xarm7': ('link_eef', (0.28318, 0.20321, 0.53529), (0.82721, -0.161, -0.53834),
              (-0.51053, 0.18484, -0.83976)),
}
# Jerk at which the Franka Research 3 stops [rad/s³].
FR3_JERK = 5000.0


def load(name):
    """Return a YAML file of config/robots/."""
    return yaml.safe_load((FILES / name).read_text(encoding='utf-8'))


def parameters(name, node):
    """Return the parameters of a node in the file of a robot."""
    return load(f'{name}_parameters.yaml')[f'/**/{node}']['ros__parameters']


def first_motion(name):
    """Return what the second parameter file of a robot sets, the one for the first motion."""
    node, = load(f'{name}_first.yaml').items()
    assert node[0] == '/**/tp_controller'
    return node[1]['ros__parameters']


def robot_of(name):
    """Return a robot with the limits of its parameter file."""
    given = parameters(name, 'tp_controller')
    return Robot.from_file(FILES / f'{name}.yaml', joints=given['joints'],
                           limits=given['limits'])


def stack_of(name, robot, kind='stack'):
    """Return a stack of a robot."""
    return Stack.from_yaml(FILES / f'{name}_{kind}.yaml', robot)


def home_of(name, robot):
    """Return the configuration that its simulator starts in."""
    return initial_positions(parameters(name, 'tp_simulator')['initial_positions'], robot)


def motion(name, goal, seconds, period=0.01):
    """Return positions, commands and the last report on the way from home to a pose."""
    robot = robot_of(name)
    controller = Controller(robot, stack_of(name, robot), Settings(period=period))
    simulator = KinematicSimulator(robot, home_of(name, robot))
    controller.set_goal('tool', goal, now=0.0)
    positions, commands = [], []
    for cycle in range(round(seconds / period)):
        command = controller.update(simulator.q, now=period * cycle)
        simulator.command(command.velocity)
        simulator.step(period)
        positions.append(simulator.q.copy())
        commands.append(command.velocity)
    return np.array(positions), np.array(commands), command.report


@pytest.mark.parametrize('name', ROBOTS)
def test_table_has_the_kinematics_of_the_manufacturer(name):
    robot = robot_of(name)
    tool, position, x_axis, z_axis = POSES[name]
    T = robot.state(home_of(name, robot) + 0.1 * np.arange(1, robot.n + 1)).pose(tool)
    assert T[:3, 3] == pytest.approx(position, abs=2e-5)
    assert T[:3, 0] == pytest.approx(x_axis, abs=4e-5)
    assert T[:3, 2] == pytest.approx(z_axis, abs=4e-5)


@pytest.mark.parametrize('name', ROBOTS)
def test_parameters_and_table_agree(name):
    table, robot = Robot.from_file(FILES / f'{name}.yaml'), robot_of(name)
    assert table.joint_names == robot.joint_names
    for limit in ('lower', 'upper', 'velocity', 'acceleration'):
        assert np.array_equal(getattr(table, limit), getattr(robot, limit)), limit
    assert np.isfinite(robot.acceleration).all() and np.isfinite(robot.velocity).all()
    for node in ('tp_simulator', 'tp_controller'):
        for key in {'robot', 'stack'} & set(parameters(name, node)):
            file = parameters(name, node)[key].removeprefix('package://tp_controller/')
            assert (ROOT / file).is_file()


@pytest.mark.parametrize('name', ROBOTS)
def test_nodes_have_every_parameter_of_the_files(name):
    pytest.importorskip('rclpy')
    for node, module in (('tp_simulator', 'simulator_node'), ('tp_controller', 'controller_node')):
        specs = import_module(f'tp_controller.ros.{module}').PARAMETERS
        defaults = {spec.name: spec.default for spec in specs}
        for key, value in parameters(name, node).items():
            assert key == 'limits' or isinstance(value, type(defaults[key])), (node, key)


@pytest.mark.parametrize('name', ROBOTS)
def test_home_is_bent_within_limits_and_the_same_in_both_files(name):
    robot = robot_of(name)
    home, tool = home_of(name, robot), stack_of(name, robot).tasks['tool'].frame
    assert stack_of(name, robot, 'home').tasks['home'].goal == pytest.approx(home)
    assert (home > robot.lower + 0.1).all() and (home < robot.upper - 0.1).all()
    assert np.linalg.svd(robot.state(home).jacobian(tool))[1][-1] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize('name', ROBOTS)
def test_tool_reaches_goals_and_no_limit_is_exceeded(name):
    robot = robot_of(name)
    tool, random = stack_of(name, robot).tasks['tool'].frame, np.random.default_rng(3)
    for _ in range(4):
        q = home_of(name, robot) + random.uniform(-0.6, 0.6, robot.n)
        q = np.clip(q, robot.lower + 0.1, robot.upper - 0.1)
        goal = robot.state(q).pose(tool)
        positions, commands, report = motion(name, goal, 8.0)
        reached, = (task.status for task in report.tasks if task.name == 'tool')
        assert reached == 'reached'
        assert robot.state(positions[-1]).pose(tool) == pytest.approx(goal, abs=2e-3)
        assert (np.abs(commands) <= robot.velocity + 1e-9).all()
        changes = np.diff(commands, axis=0, prepend=np.zeros((1, robot.n)))
        assert (np.abs(changes) <= 0.01 * robot.acceleration + 1e-9).all()
        assert (positions >= robot.lower - 1e-9).all() and (positions <= robot.upper + 1e-9).all()


def test_jerk_of_fr3_stays_allowed_if_commands_are_late_by_a_cycle():
    robot, period = robot_of('fr3'), 0.001
    q = home_of('fr3', robot) + [0.5, 0.3, -0.4, 0.4, 0.3, -0.3, 0.6]
    _, commands, _ = motion('fr3', robot.state(q).pose('fr3_link8'), 3.0, period)
    random = np.random.default_rng(0)
    late = np.arange(len(commands)) - random.integers(0, 2, len(commands))
    received = commands[np.maximum(late, 0)]
    for taken in (commands, received):
        accelerations = np.diff(taken, axis=0) / period
        assert np.abs(accelerations).max() <= 10.0
        assert np.abs(np.diff(accelerations, axis=0)).max() / period <= FR3_JERK
    # What its own limit of acceleration would do.
    assert 3.0 * 10.0 / period > FR3_JERK >= 3.0 * robot.acceleration.max() / period


@pytest.mark.parametrize('name', ROBOTS)
def test_first_motion_has_a_tenth_of_the_velocities_and_sets_nothing_else_anew(name):
    robot, first = robot_of(name), first_motion(name)
    assert set(first) == {'limits', 'workspace', 'largest_jump', 'largest_turn'}
    assert tuple(first['limits']) == robot.joint_names
    assert all(set(limit) == {'velocity', 'acceleration'} for limit in first['limits'].values())
    velocity, acceleration = np.transpose([list(limit.values())
                                           for limit in first['limits'].values()])
    assert velocity == pytest.approx(0.1 * robot.velocity, rel=1e-3)
    assert (acceleration <= 0.5 * robot.acceleration).all()
    assert (velocity / acceleration <= 0.6 + 1e-9).all()


@pytest.mark.parametrize('name', ROBOTS)
def test_goals_of_the_first_motion_are_near_the_tool_above_the_table_and_within_reach(name):
    robot, limits = robot_of(name), first_motion(name)
    limits.pop('limits')
    controller = Controller(robot, stack_of(name, robot), Settings(**limits))
    home = home_of(name, robot)
    controller.update(home, now=0.0)
    T = robot.state(home).pose(controller.stack.tasks['tool'].frame)

    def goal(place=T[:3, 3], turn=0.0):
        there = T.copy()
        there[:3, 3] = place
        there[:3, :3] = there[:3, :3] @ rotation_from_rpy(0.0, 0.0, turn)
        controller.set_goal('tool', there, now=0.0)

    goal(T[:3, 3] - 0.05 * T[:3, 2], 0.2)
    for refused, reason in (({'place': T[:3, 3] - 0.15 * T[:3, 2]}, 'largest_jump'),
                            ({'turn': 0.4}, 'largest_turn'),
                            ({'place': (*T[:2, 3], 0.15)}, 'workspace: z = 0.15'),
                            ({'place': (0.0, 1.0, T[2, 3])}, 'workspace: y = 1')):
        with pytest.raises(GoalError, match=reason):
            goal(**refused)


def forms_of(value):
    """Return how a page may write a limit: as a number, in degrees, or as a multiple of π."""
    return {f'{value:g}', f'{np.degrees(value):g}°', {np.pi: 'π', 2.0 * np.pi: '2π'}.get(value)}


@pytest.mark.parametrize('name', ROBOTS)
def test_page_shows_the_limits_of_the_table(name):
    page, robot = (PAGES / f'{name}.md').read_text(encoding='utf-8'), robot_of(name)
    rows = dict(re.findall(r'^\| (position|velocity|acceleration) \| (.*?) \|', page,
                           re.MULTILINE))
    for row, limits in (('position', (robot.lower, robot.upper)), ('velocity', (robot.velocity,)),
                        ('acceleration', (robot.acceleration,))):
        for value in {abs(value) for limit in limits for value in limit if np.isfinite(value)}:
            shown = re.findall(r'[\d.]*(?:π|°|\b)', rows[row])
            assert forms_of(value).intersection(shown), (row, value)


@pytest.mark.parametrize('name', ROBOTS)
def test_page_names_the_versions_it_was_checked_against(name):
    page = (PAGES / f'{name}.md').read_text(encoding='utf-8')
    checked, = re.findall(r'^- \*\*checked\*\*: (.*)$', page, re.MULTILINE)
    day, sources = re.fullmatch(r'(\d{4}-\d\d-\d\d) against (.*)', checked).groups()
    versions = re.findall(r'\[\w[\w-]*@(\w+)\]\((\S+)/tree/(\w+)\) of (\d{4}-\d\d-\d\d)', sources)
    assert len(versions) == sources.count('@') > 0
    for commit, _, linked, committed in versions:
        assert linked.startswith(commit)
        assert committed <= day
    driver, = re.findall(r'^- \*\*driver\*\*: \[[^]]*\]\((https://github.com/[\w-]+/\w+)', page,
                         re.MULTILINE)
    assert versions[0][1] == driver


@pytest.mark.parametrize('name', ROBOTS)
def test_page_shows_order_and_files(name):
    page = (PAGES / f'{name}.md').read_text(encoding='utf-8')
    joints, = re.findall(r'^- \*\*joints, in this order\*\*: (.*)$', page, re.MULTILINE)
    first, *_, last = re.findall(r'`(\w+)`', joints)
    assert (first, last) == robot_of(name).joint_names[::robot_of(name).n - 1]
    for part in ('', '_parameters', '_first', '_stack', '_home'):
        assert f'../../config/robots/{name}{part}.yaml' in page

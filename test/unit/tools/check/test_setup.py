# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The same check in one process, in two, and on a cluster."""

from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
import os

import pytest
from robots import moving_panda, planar
from tp_controller import Robot, Settings, SettingsError, Stack
from tp_controller.model.simulator import start_configuration
from tp_controller.tasks.position import Position
from tp_controller.tools.check import check, checker
from tp_controller.tools.check.setup import built, in_process, Plan, Setup

YAML = """
- near: {type: keep_in, frame: link3, shape: {sphere: 1.5}}
- tip: {type: position, frame: link3, axes: xy, gain: 3}
- easy: {type: joint_limit_distance}
- angle: {type: joint, joints: joint1}
"""
OPTIONS = {'samples': 12, 'runs': 4, 'seconds': 1.0, 'seed': 3}


def limited():
    """Return a planar arm with limits of its own."""
    return Robot.from_urdf(planar().urdf, limits={
        name: {'lower': -2.0, 'upper': 2.0, 'acceleration': 5.0} for name in planar().joint_names})


def without_times(report):
    """Return what a seed repeats of a report."""
    return replace(report, timing=None, findings=tuple(
        each for each in report.findings if each.kind != 'cycle time'))


def process_of(setup, seed):
    """Return in which process work is done, and which setup it has."""
    return os.getpid(), id(setup), setup.stack.tasks['tip'].gain, seed


def end(setup, seed):
    """End the process."""
    os._exit(1)


def checked():
    """Return a robot, and a stack with changes since it was read."""
    robot = limited()
    stack = Stack.from_yaml(YAML, robot)
    stack.tasks['tip'].set_gain(2.0)
    stack.enable('angle', False)
    return robot, stack


def setup_of(robot, stack):
    """Return a setup of a check."""
    return Setup(robot, stack, Settings(), 0.01, 1.0, start_configuration(robot))


@pytest.mark.slow
def test_two_processes_find_what_one_does():
    one, two = (check(*checked(), jobs=jobs, **OPTIONS) for jobs in (1, 2))
    assert without_times(one) == without_times(two)
    assert one.ended and one.tasks[1].gain_period == pytest.approx(0.02)
    assert [task.level for task in one.tasks] == [1, 2, 3, 0]


@pytest.mark.filterwarnings('ignore::DeprecationWarning', 'ignore::ResourceWarning',
                            'ignore::pytest.PytestUnraisableExceptionWarning')
@pytest.mark.slow
def test_a_cluster_finds_what_one_process_does():
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None
                                  ) as cluster, distributed.Client(cluster) as client:
        found = check(*checked(), executor=client.get_executor(), **OPTIONS)
    assert without_times(found) == without_times(check(*checked(), **OPTIONS))


@pytest.mark.slow
def test_a_process_builds_a_robot_once():
    with checker._workers(setup_of(*checked()), 2, None) as spread:
        found = list(spread(process_of, list(range(40))))
    assert [seed for *_, seed in found] == list(range(40))
    assert os.getpid() not in {process for process, *_ in found}
    setups = {process: {each for other, each, *_ in found if other == process}
              for process, *_ in found}
    assert all(len(each) == 1 for each in setups.values())


@pytest.mark.slow
def test_a_process_that_ends_is_noticed():
    with checker._workers(setup_of(*checked()), 2, None) as spread:
        with pytest.raises(BrokenProcessPool):
            list(spread(end, [1, 2]))


@pytest.mark.parametrize('robot', [limited(), moving_panda('differential'),
                                   moving_panda('floating')], ids=lambda robot: robot.base)
def test_a_plan_builds_the_same_robot(robot):
    stack = Stack.from_yaml(f'- tip: {{type: pose, frame: {robot.frame_names[-1]}}}', robot)
    stack.tasks['tip'].set_tolerance({'m': 0.02})
    setup = Setup(robot, stack, Settings(damping=0.3), 0.01, 1.0, start_configuration(robot))
    made = Plan.of(setup).build()
    for name in ('lower', 'upper', 'velocity', 'acceleration'):
        assert (getattr(made.robot, name) == getattr(robot, name)).all()
    assert (made.robot.base, made.robot.root) == (robot.base, robot.root)
    assert made.robot.frame_names == robot.frame_names
    assert made.settings == setup.settings
    assert [value for _, _, value in made.stack.tasks['tip'].groups] == [0.02, 0.005]


def test_a_plan_that_is_known_is_not_built_again():
    robot = limited()
    setup = Setup(robot, Stack.from_yaml(YAML, robot), Settings(), 0.01, 1.0,
                  start_configuration(robot))
    plan = Plan.of(setup)
    assert built(plan) is built(Plan.of(setup))
    assert built(Plan.of(replace(setup, seconds=2.0))) is not built(plan)
    assert len({in_process(process_of, plan, seed)[1] for seed in (1, 2)}) == 1


def test_a_stack_without_yaml_stays_in_one_process():
    robot = planar()
    stack = Stack([[Position(robot, 'tip', frame='link3')]])
    assert check(robot, stack, samples=2, runs=0).samples == 2
    with pytest.raises(SettingsError, match='one job'):
        check(robot, stack, samples=2, runs=0, jobs=2)


def test_a_plan_keeps_the_groups_of_joints():
    robot = Robot.from_urdf(planar().urdf, groups={'first': ['joint1', 'joint2']})
    stack = Stack.from_yaml('- tip: {type: position, frame: link3, joints: first}', robot)
    assert Plan.of(setup_of(robot, stack)).build().robot.groups == robot.groups

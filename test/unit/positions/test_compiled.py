# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Searches in the compiled core are those of the reference, step by step."""

import numpy as np
import pytest
import robots
from tp_controller import PositionSolver, solve_position, Stack
from tp_controller.positions.compiled import Searches
from tp_controller.positions.position_stack import PositionStack
from tp_controller.positions.random_postures import random_postures
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
TOOL = robots.PANDA_TOOL
STACKS = {
    'pose': f'- tool: {{type: pose, frame: {TOOL}}}\n',
    'levels': f'- limits: {{type: joint_limits}}\n- tool: {{type: position, frame: {TOOL}}}\n'
              '- elbow: {type: position, frame: panda_link4, axes: z}\n'
              '- posture: {type: posture}\n',
    'shared level': f'- [tool: {{type: position, frame: {TOOL}}}, turn: {{type: orientation, '
                    f'frame: {TOOL}}}]\n- [a: {{type: joint, joints: panda_joint1}}, '
                    'b: {type: joint, joints: panda_joint3}]\n',
    'bounds': f'- cell: {{type: keep_in, frame: {TOOL}, shape: {{box: [1.0, 1.0, 1.0]}}, '
              'at: [0.2, 0, 0.5]}\n'
              f'- away: {{type: keep_out, frame: {TOOL}, shape: {{sphere: 0.3}}, '
              'at: [0.4, 0, 0.4]}\n'
              f'- aim: {{type: pointing, frame: {TOOL}}}\n'
              f'- span: {{type: distance, frame: {TOOL}, at: [0, 0, 0], '
              'minimum: 0.3, maximum: 0.7}\n'
              f'- upright: {{type: tilt, frame: {TOOL}, axis: -z, direction: z, '
              'within: 0.6}\n'
              f'- view: {{type: field_of_view, frame: {TOOL}, half_angle: 0.5, '
              'target: [0.5, 0.3, 0.0]}\n- middle: {type: joint_limit_distance, gain: 0.1}\n',
    'range': f'- range: {{type: orientation_range, frame: {TOOL}, target: [1, 0, 0, 0], '
             'maximum: [0.5, 0.6, 1.0]}\n'
             f'- tool: {{type: position, frame: {TOOL}}}\n',
}
BASES = ('fixed', 'planar', 'differential', 'underwater', 'floating')


def pair(text, base='fixed'):
    """Return tasks with searches in the core, and with searches of the reference."""
    robot = robots.panda() if base == 'fixed' else robots.moving_panda(base)
    both = []
    for compiled in (True, False):
        tasks = PositionStack(robot, Stack.from_yaml(text, robot))
        searches = Searches(robot, tasks)
        if not compiled:
            searches._compiled = None
        both.append((tasks, searches))
    return robot, both


@pytest.mark.slow
@pytest.mark.parametrize('base', BASES)
@pytest.mark.parametrize('name', STACKS)
def test_searches_are_those_of_the_reference(name, base):
    robot, both = pair(STACKS[name], base)
    generator = np.random.default_rng(0)
    same = []
    for _ in range(6):
        goal, *starts = random_postures(robot, robot.neutral(), generator, 4)
        found = []
        for tasks, searches in both:
            for task in tasks.stack.active_tasks:
                if not task.bounded:
                    task.goal = None
                    task.start(robot.state(goal))
            needed = min(2, len(tasks.groups))
            searches.begin(robot.passive_neutral)
            wanted = searches.find(np.array(starts), needed, 2, np.inf)
            first = searches.find(np.array(starts), needed, 1, np.inf)[0]
            found.append((first, searches.finish(first, np.inf), wanted))
        (one, last, wanted), (other, last_of_other, wanted_of_other) = found
        # Rounding may lead a descent that is long to another place.
        same.append(one.descents == other.descents and len(wanted) == len(wanted_of_other)
                    and np.allclose(one.q, other.q, atol=1e-4)
                    and np.allclose(one.costs[:needed], other.costs[:needed], rtol=1e-6, atol=1e-9)
                    and all(np.allclose(each.costs, its.costs, rtol=1e-3, atol=1e-9)
                            for each, its in zip([last, *wanted],
                                                 [last_of_other, *wanted_of_other])))
    assert np.mean(same) >= 0.8


@pytest.mark.parametrize('base', BASES)
def test_one_step_is_that_of_the_reference(base, monkeypatch):
    robot, both = pair(STACKS['levels'], base)
    generator = np.random.default_rng(1)
    # A goal nearby: few steps, which rounding does not turn elsewhere.
    for _ in range(20):
        q = random_postures(robot, robot.neutral(), generator, 1)[0]
        near = robot.integrate(q, generator.uniform(-0.02, 0.02, robot.n), 1.0)
        found = []
        for tasks, searches in both:
            for task in tasks.stack.active_tasks:
                if not task.bounded:
                    task.goal = None
                    task.start(robot.state(near))
            searches.begin(robot.passive_neutral)
            found.append(searches.find(tasks.within_limits(q)[np.newaxis], 3, 1, np.inf)[0])
        np.testing.assert_allclose(found[0].q, found[1].q, rtol=0.0, atol=1e-9)


def test_passive_positions_reach_the_core():
    robot = robots.urdf_robot('panda', tuple(f'panda_joint{number}' for number in range(1, 7)))
    text = '- tip: {type: position, frame: panda_leftfinger}'
    its = PositionSolver(robot, Stack.from_yaml(text, robot))
    passive = robot.passive_neutral + 0.02
    goal = robot.state(np.array([0.3, 0.3, 0.3, -1.2, 0.3, 0.9]), passive).position(
        'panda_leftfinger')
    found = its.solve({'tip': goal}, passive=passive)
    assert its._searches._compiled.fit
    np.testing.assert_allclose(robot.state(found.q, passive).position('panda_leftfinger'), goal,
                               rtol=0.0, atol=1e-6)


def test_task_without_a_twin_leads_to_the_reference():
    robot = robots.panda()
    text = STACKS['pose'] + f'- agile: {{type: manipulability_above, frame: {TOOL}, ' \
                            'minimum: 0.01}\n'
    tasks = PositionStack(robot, Stack.from_yaml(text, robot))
    assert Searches(robot, tasks)._compiled is None
    goal = robot.state(np.array(robots.PANDA_READY)).pose(TOOL)
    stack = Stack.from_yaml(text, robot)
    assert solve_position(robot, stack, {'tool': goal}, timeout=60.0).reached


def test_core_refuses_what_does_not_fit():
    robot = robots.panda()
    search = core.Search(robot.lower, robot.upper, np.ones(7), np.zeros((0, 7)))
    q, costs = np.empty((1, 7)), np.empty((1, 1))
    assert search.find(np.zeros((1, 7)), 1, 1.0, q, costs) is None
    with pytest.raises(ValueError, match='as many lower as upper limits'):
        core.Search(robot.lower, robot.upper[:3], np.ones(7), np.zeros((0, 7)))
    with pytest.raises(ValueError, match='marks'):
        core.Search(robot.lower, robot.upper, np.ones(6), np.zeros((0, 7)))
    with pytest.raises(ValueError, match='nudges'):
        core.Search(robot.lower, robot.upper, np.ones(7), np.zeros((2, 6)))
    motion = robot.kinematics.motion()
    stack = Stack.from_yaml('- posture: {type: posture}\n', robot)
    stack.start(robot.state(robot.neutral()))
    twin = stack.tasks['posture'].twin.task
    for tasks in ((), ((None,),), ((),), [twin], ((robot,),)):
        with pytest.raises(ValueError, match='tasks'):
            search.set_tasks(motion, tasks)
    with pytest.raises(ValueError, match='set_tasks'):
        search.set_tasks(robots.planar().kinematics.motion(), ((twin,),))
    search.set_tasks(motion, ((twin,),))
    motion.move(robot.neutral(), robot.kinematics.offset, None)
    start = np.zeros((1, 7))
    for given in ((np.zeros((1, 6)), 1, 1.0, q, costs), (np.zeros((0, 7)), 1, 1.0, q, costs),
                  (np.full((1, 7), np.nan), 1, 1.0, q, costs), (start, 2, 1.0, q, costs),
                  (start, 1, 'soon', q, costs), (start, 1, 1.0, q[:, :3], costs),
                  (start, 1, 1.0, q[:0], costs), (start, 1, 1.0, q[0], costs),
                  (start, 1, 1.0, q, np.empty((1, 2))), (None, 1, 1.0, q, costs)):
        assert search.find(*given) is None
    assert search.find(start, 1, 1.0, q, costs) == (1, 1)
    assert not search.finish(1.0, np.full(7, np.nan), costs[0])
    assert search.finish(1.0, q[0], costs[0])
    goals, numbers = ((0, 0, start),), np.empty((1, 2))
    for given in ((((0, 1, start),), start, start, 1, 1, 1.0, q, numbers),
                  (((0, 0, start[:, :3]),), start, start, 1, 1, 1.0, q, numbers),
                  ((), start, start, 1, 1, 1.0, q, numbers),
                  (goals, start[:0], start, 1, 1, 1.0, q, numbers),
                  (goals, start, start[:, :3], 1, 1, 1.0, q, numbers),
                  (goals, start, start, 2, 1, 1.0, q, numbers),
                  (goals, start, start, 1, 0, 1.0, q, numbers),
                  (goals, start, start, 1, 1, 1.0, q[:0], numbers),
                  (goals, start, start, 1, 1, 1.0, q, numbers[0]),
                  (goals, np.zeros((2, 7)), start, 1, 1, 1.0, q, numbers)):
        assert not search.find_each(*given)
    assert search.find_each(goals, start, start[:0], 1, 1, 1.0, q, numbers)
    assert numbers.tolist() == [[1.0, 0.0]]
    for call in (search.find, search.finish, search.find_each):
        with pytest.raises(ValueError, match='seconds'):
            call()

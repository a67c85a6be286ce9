# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Hints: given where the change that they suggest brings back enough, and as few as needed."""

import numpy as np
import pytest
import robots
from robots import cartesian
from tp_controller import Controller, Settings, Stack

NOW = Settings(blend=0.0, reserve=0.0, period=0.01)


def hints(stack, q=(0.0, 0.0, 0.0), goals=(), robot=None, settings=NOW):
    """Return {task: hint} of the first cycle."""
    robot = robot or cartesian()
    controller = Controller(robot, Stack.from_yaml(stack, robot), settings)
    for name, goal in dict(goals).items():
        controller.set_goal(name, goal, 0.0)
    return {task.name: task.hint for task in controller.update(q, 0.0).report.tasks}


@pytest.mark.parametrize('goal, hint', [
    # With both limits at 1 m/s it takes 1.9 s, and 0.1 m decay to 1 mm in 0.5 s.
    ([2.0, 2.0, 0.1], 'wait 2 s until it arrives, or raise the velocity limits of slide_x and '
                      'slide_y'),
    ([2.0, 0.05, 0.1], 'wait 2 s until it arrives, or raise the velocity limit of slide_x')])
def test_all_limits_that_matter_are_raised_together(goal, hint):
    assert hints('- tool: {type: position, frame: z, gain: 10}', goals={'tool': goal}) == {
        'tool': hint}


def test_a_limit_is_raised_only_if_that_saves_a_fifth_of_the_time():
    # The last 1 m decays to 1 mm in 7 s in any case.
    assert hints('- tool: {type: position, frame: z}', goals={'tool': [2.0, 0.0, 0.1]}) == {
        'tool': 'wait 8 s until it arrives'}


def test_a_joint_that_is_at_its_end_first_is_not_waited_for():
    # It is there in 2 s, and the task would be at its goal in 2.5 s.
    assert hints('- tool: {type: position, frame: z, gain: 10}',
                 goals={'tool': [2.5, 0.0, 0.1]}) == {'tool': ''}


def test_limits_of_joints_that_do_not_matter_to_the_task_are_left_alone():
    assert hints("""
- other: {type: joint, joints: slide_y, target: [1.9], gain: 10}
- this: {type: joint, joints: slide_x, target: [1.9], gain: 10}
""") == {'other': 'wait 2 s until it arrives, or raise the velocity limit of slide_y',
         'this': 'wait 2 s until it arrives, or raise the velocity limit of slide_x'}


def test_velocity_that_is_demanded_without_a_goal_is_not_waited_for():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml(
        '- go: {type: joint_velocity, joints: slide_x}', robot), NOW)
    controller.update([0.0, 0.0, 0.0], 0.0)
    controller.set_goal('go', [2.0], 0.0)
    task, = controller.update([0.0, 0.0, 0.0], 0.0).report.tasks
    assert task.hint == 'raise the velocity limit of slide_x'


def test_task_that_leaves_no_joint_to_others_is_exchanged_with_none():
    # A posture above would leave nothing to the tool, whatever its goal.
    found = hints("""
- tool: {type: position, frame: z, axes: x}
- rest: {type: posture, target: [0.5, 0.0, 0.0]}
""")
    assert found['rest'] == 'choose goals of tool and rest that are compatible'


def test_where_one_joint_at_a_limit_stops_all_another_scaling_is_advised():
    stack = """
- x: {type: position, frame: z, axes: x}
- y: {type: joint, joints: slide_y, target: [0.5]}
"""
    for scaling, hint in ('uniform', 'set scaling to redistribute'), ('redistribute', ''):
        assert hints(stack, (2.0, 0.0, 0.0), {'x': [2.5, 0.0, 0.0]}, settings=Settings(
            scaling=scaling, blend=0.0))['y'] == hint


def test_goals_that_are_compatible_are_not_called_incompatible():
    stack, q = """
- tool: {type: position, frame: panda_hand_tcp}
- elbow: {type: orientation, frame: panda_link5}
- rest: {type: posture, target: [2.0, 1.0, -2.0, -1.0, 2.0, 3.0, 2.0]}
""", (-0.5, 0.2, -2.4, -0.7, 0.2, 0.8, 1.4)
    robot = robots.panda()
    there = robot.state([2.0, 1.0, -2.0, -1.0, 2.0, 3.0, 2.0])
    tasks = Stack.from_yaml(stack, robot).tasks
    goals = {name: tasks[name].value(there) for name in ('tool', 'elbow')}
    assert hints(stack, q, goals, robot)['rest'] == (
        'put rest above tool and elbow until all are there: their goals are compatible')
    # Other goals would not help from here.
    assert hints(stack, q, {**goals, 'tool': goals['tool'] + 0.1}, robot)['rest'] == ''


def test_a_task_that_misses_little_gets_no_advice():
    found = {limit: hints('- tool: {type: position, frame: z}', goals={'tool': [limit, 0.0, 0.1]})
             for limit in (1.08, 1.3)}
    assert found == {1.08: {'tool': ''}, 1.3: {'tool': 'wait 7 s until it arrives'}}


def test_a_blocked_task_that_arrives_once_the_one_above_is_there_waits():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml("""
- tool: {type: position, frame: z, axes: x}
- fast: {type: joint, joints: slide_x, target: [0.15], gain: 5}
""", robot), NOW)
    controller.set_goal('tool', [0.15, 0.0, 0.0], 0.0)
    fast = controller.update([0.0, 0.0, 0.0], 0.0).report.tasks[1]
    # 0.15 m decay to 1 mm.
    assert (fast.reason, fast.hint) == ('blocked by tool', 'wait 5 s until it arrives')


def test_a_task_without_an_error_waits_for_its_velocity():
    robot = cartesian({'slide_x': {'acceleration': 1.0}})
    controller = Controller(robot, Stack.from_yaml(
        '- go: {type: joint_velocity, joints: slide_x, timeout: 0.1}', robot), NOW)
    controller.update([0.0, 0.0, 0.0], 0.0)
    controller.set_goal('go', [0.5], 0.0)
    task, = controller.update([0.0, 0.0, 0.0], 0.01).report.tasks
    assert task.hint == 'wait 0.5 s'


@pytest.mark.slow
def test_hint_leaves_controller_and_tasks_as_they_are():
    robot = robots.panda()
    stack = """
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4}
"""
    velocities = []
    for reads in False, True:
        controller, q = Controller(robot, Stack.from_yaml(stack, robot), NOW), robots.PANDA_READY
        found = []
        for cycle in range(40):
            command = controller.update(q, 0.01 * cycle)
            if cycle == 0:
                controller.set_goal('tool', [0.4, 0.3, 0.4, 1.0, 0.0, 0.0, 0.0], 0.0)
                controller.set_goal('elbow', [0.3, 0.3, 0.3], 0.0)
            q = q + 0.01 * command.velocity
            found += [task.hint for task in command.report.tasks if reads]
        assert any(found) == reads
        velocities.append(command.velocity)
    assert np.array_equal(*velocities)


def test_task_that_fails_in_a_roll_out_gets_no_hint():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml('- tool: {type: position, frame: z}', robot),
                            NOW)
    controller.set_goal('tool', [2.0, 0.0, 0.1], 0.0)
    task, = controller.update([0.0, 0.0, 0.0], 0.0).report.tasks

    def fail(state, now):
        raise RuntimeError

    controller.stack.tasks['tool'].evaluate = fail
    assert task.reason and task.hint == ''


def test_what_blocks_together_is_changed_together():
    assert hints("""
- a: {type: joint, joints: slide_x, target: [0.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [0.5]}
""")['c'] == 'put c above a and b (a and b then miss their goals)'
    assert hints("""
- a: {type: joint, joints: slide_x, target: [2.0]}
- c: {type: position, frame: z, axes: x}
""", q=(2.0, 0.0, 0.0), goals={'c': [2.5, 0.0, 0.0]})['c'] == (
        'put c above a, and choose a goal farther from the upper position limit of slide_x '
        '(a then misses its goal)')


def test_other_goals_are_not_advised_where_an_exchange_leads_both_tasks_to_theirs():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml("""
- tool: {type: pose, frame: panda_hand_tcp}
- elbow: {type: position, frame: panda_link4, axes: z}
- rest: {type: posture}
""", robot), Settings(blend=0.0, period=0.02, command_delay=0))
    q = np.array(robots.PANDA_READY)
    controller.update(q, 0.0)
    controller.set_goal('tool', [0.4, 0.3, 0.4, 1.0, 0.0, 0.0, 0.0], 0.0)
    controller.set_goal('elbow', [0.0, 0.0, 0.63], 0.0)
    for cycle in range(1, 26):
        command = controller.update(q, 0.02 * cycle)
        q = q + 0.02 * command.velocity
    assert command.report.tasks[1].hint == 'exchange tool and elbow in the stack'


def test_limits_that_act_only_without_the_tasks_above_are_neither_a_reason_nor_to_be_raised():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml("""
- a: {type: joint, joints: slide_x, target: [0.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [1.9], gain: 50}
""", robot), NOW)
    # Without a and b, c would move at 1 m/s, a hundredth of its demand.
    task = controller.update([0.0, 0.0, 0.0], 0.0).report.tasks[2]
    assert task.reason == 'blocked by a and b together'
    assert task.hint == 'put c above a and b (a and b then miss their goals)'


def test_axes_are_left_out_only_where_the_robot_cannot_move_along_axes_of_the_task():
    # The elbow moves on a sphere about the shoulder; from the radius it is led back.
    robot = robots.panda()
    state = robot.state(robots.PANDA_READY)
    there = state.pose('panda_link4')[:3, 3]
    shoulder = state.pose('panda_link2')[:3, 3]
    found = hints('- elbow: {type: position, frame: panda_link4}', robots.PANDA_READY,
                  {'elbow': shoulder + 1.5 * (there - shoulder) + [0.0, 0.3, 0.0]}, robot)
    assert 'leave out' not in found['elbow']


def test_a_task_that_misses_little_in_ten_seconds_waits():
    # It is blocked for the last centimetre only.
    found = hints("""
- wall: {type: joint_limits, margin: 0.01}
- tool: {type: position, frame: z, axes: x, gain: 5}
""", goals={'tool': [2.05, 0.0, 0.0]})
    # 2.05 m at 1 m/s, until a fifth is left.
    assert found['tool'] == 'wait 2 s until most of its error is gone'

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

"""Hints: given where the change that they suggest brings back enough, and as few as needed."""

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
    # With both limits at 1 m/s it takes 2 s to (2, 2).
    ([2.0, 2.0, 0.1], 'wait 2 s, or raise the velocity limits of slide_x and slide_y'),
    ([2.0, 0.5, 0.1], 'wait 2 s, or raise the velocity limit of slide_x'),
    # Without the limit of y a tenth of what is missing would come back.
    ([2.0, 1.3, 0.1], 'wait 2 s, or raise the velocity limits of slide_x and slide_y')])
def test_all_limits_that_matter_are_raised_together(goal, hint):
    assert hints('- tool: {type: position, frame: z}', goals={'tool': goal}) == {'tool': hint}


def test_a_joint_that_is_at_its_end_first_is_not_waited_for():
    # It is there in 2 s, and the task would be at its goal in 2.5 s.
    assert hints('- tool: {type: position, frame: z}', goals={'tool': [2.5, 0.0, 0.1]}) == {
        'tool': 'raise the velocity limit of slide_x'}


def test_limits_of_joints_that_do_not_matter_to_the_task_are_left_alone():
    assert hints("""
- other: {type: joint, joints: slide_y, target: [1.9]}
- this: {type: joint, joints: slide_x, target: [1.9]}
""") == {'other': 'wait 2 s, or raise the velocity limit of slide_y',
         'this': 'wait 2 s, or raise the velocity limit of slide_x'}


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
        'the goals are compatible: go there by way of another posture')
    assert hints(stack, q, {**goals, 'tool': goals['tool'] + 0.1}, robot)['rest'] == (
        'choose goals of tool and rest that are compatible')


def test_a_task_that_misses_little_gets_no_advice():
    found = {limit: hints('- tool: {type: position, frame: z}', goals={'tool': [limit, 0.0, 0.1]})
             for limit in (1.08, 1.3)}
    assert found == {1.08: {'tool': ''},
                     1.3: {'tool': 'wait 1 s, or raise the velocity limit of slide_x'}}


def test_what_blocks_together_is_changed_together():
    assert hints("""
- a: {type: joint, joints: slide_x, target: [0.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [0.5]}
""")['c'] == 'put c above a and b'
    assert hints("""
- a: {type: joint, joints: slide_x, target: [2.0]}
- c: {type: position, frame: z, axes: x}
""", q=(2.0, 0.0, 0.0), goals={'c': [2.5, 0.0, 0.0]})['c'] == (
        'put c above a, and choose a goal, or an arm posture, farther from the upper position '
        'limit of slide_x')

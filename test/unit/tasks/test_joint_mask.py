# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks name the joints that they may move, and weigh their rows."""

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack, StackError
from tp_controller.tasks.task import Evaluation
from tp_controller.tasks.velocity import VelocityTask

GROUPS = {'arm': [f'arm_{number}' for number in range(1, 8)], 'torso': 'torso_lift'}
ROBOT = Robot.from_file(str(robots.CONFIG / 'robots' / 'mobile_arm.urdf'), base='differential',
                        groups=GROUPS)
BASE, TORSO, ARM = slice(0, 2), slice(2, 3), slice(3, 10)
TOOL = 'tool: {type: position, frame: tool'
Q = ROBOT.configuration([0.15, 0.0, -0.8, 0.0, 1.6, 0.0, -0.8, 0.0])


def masks(text):
    """Return the mask of each task of a stack as a text of 0 and 1; empty for none."""
    return [''.join('01'[int(each)] for each in task.joint_mask)
            if task.joint_mask is not None else ''
            for task in Stack.from_yaml(text, ROBOT).tasks.values()]


@pytest.mark.parametrize('keys, mask', [
    ('', ''), ('joints: arm', '0001111111'), ('joints: [arm, torso]', '0011111111'),
    ('joints: [arm_7, base_yaw]', '0100000001'), ('excluded_joints: base', '0011111111'),
    ('joints: [torso, base], excluded_joints: [base_x]', '0110000000'),
    ('joints: [base, torso, arm]', ''), ('joints: base', '1100000000')])
def test_keys_choose_joints_by_name_and_group(keys, mask):
    assert masks(f'- {TOOL}, {keys}}}\n') == [mask]


def test_joints_of_a_joint_task_are_its_rows_and_no_mask():
    stack = Stack.from_yaml('- lift: {type: joint, joints: torso}\n'
                            '- arm: {type: posture, joints: arm, excluded_joints: base}\n', ROBOT)
    lift, arm = stack.tasks.values()
    assert (lift.joints, lift.joint_mask) == (('torso_lift',), None)
    assert arm.joints == tuple(GROUPS['arm'])
    assert arm.joint_mask.tolist() == [False] * 2 + [True] * 8


@pytest.mark.parametrize('task, message', [
    (f'{TOOL}, joints: arms}}', r"unknown joint or group 'arms' \(did you mean 'arm'\?\); valid: "
                                'base, arm, torso, base_x, base_yaw, torso_lift, arm_1'),
    (f'{TOOL}, excluded_joints: legs}}', "unknown joint or group 'legs'; valid: base, arm, torso"),
    (f'{TOOL}, joints: []}}', 'needs a joint, a group or a list of them'),
    (f'{TOOL}, joints: 3}}', 'needs a joint, a group or a list of them'),
    (f'{TOOL}, joints: base, excluded_joints: [base]}}', 'leaves the task no joint to move'),
    ('lift: {type: joint, joints: base}', "unknown driven joint or group 'base_x'"),
    ('lift: {type: joint, joints: [arm, arm_2]}', 'names a joint twice')])
def test_joints_that_are_none_are_refused(task, message):
    with pytest.raises(StackError, match=message):
        Stack.from_yaml(f'- {task}\n', ROBOT)


def test_tasks_of_one_level_have_the_same_joints():
    other = TOOL.replace('tool:', 'other:')
    assert masks(f'- [{TOOL}, joints: arm}}, {other}, excluded_joints: [base, torso]}}]\n') \
        == ['0001111111'] * 2
    for keys in ('}', ', joints: torso}'):
        with pytest.raises(StackError, match=r'line 1: .*need the same joints \(tool, other\)'):
            Stack.from_yaml(f'- [{TOOL}, joints: arm}}, {other}{keys}]\n', ROBOT)


def cycle(text, x):
    """Return the command of a controller whose first task moves by x [m] along x of the base."""
    controller = Controller(ROBOT, Stack.from_yaml(text, ROBOT), Settings(blend=0.0, period=0.01))
    controller.update(Q, 0.0)
    name = next(iter(controller.stack.tasks))
    here = controller.stack.tasks[name].value(ROBOT.state(Q))
    controller.set_goal(name, here + np.array([x, 0.0, 0.0]), 0.0)
    return controller.update(Q, 0.01)


def test_tool_is_moved_by_its_joints_only_whoever_is_below():
    alone = cycle(f'- {TOOL}, joints: arm}}\n', 0.01).velocity
    assert np.abs(alone[ARM]).max() > 1e-3 and np.abs(alone[:3]).max() < 1e-15
    driven = cycle(f'- {TOOL}, excluded_joints: [arm, torso]}}\n', 0.01).velocity
    assert np.abs(driven[BASE]).max() > 1e-3 and np.abs(driven[2:]).max() < 1e-15
    J = ROBOT.state(Q).jacobian('tool')[:3]
    both = cycle(f'- {TOOL}, joints: arm}}\n- lift: {{type: joint, joints: torso, '
                 'target: {torso_lift: 0.2}}\n', 0.01).velocity
    assert both[TORSO] > 1e-3
    np.testing.assert_allclose(J @ both, J @ alone, atol=1e-9)


class Forward(VelocityTask):
    """Velocity of one row, whose level a type of another package makes."""

    def __init__(self, robot, name, **given):
        super().__init__(robot, name, ('m',), **given)

    def evaluate(self, state, now):
        """Return the evaluation."""
        return Evaluation(self, self.make_evaluation(state, now).level, np.zeros(1))

    def jacobian(self, state):
        """Return the row."""
        return state.jacobian('tool')[:1]

    def parse_goal(self, goal):
        """Return the goal."""
        return np.array(goal)


def test_types_of_other_packages_have_masks_too():
    task = Forward(ROBOT, 'forward', joints='arm')
    stack = Stack([[task]])
    level = stack.evaluate(ROBOT.state(Q), 0.0)[0][0].level
    assert level.joints.tolist() == [False] * 3 + [True] * 7


@pytest.mark.parametrize('task, weights', [
    ('{type: pose, frame: tool, weights: 3}', 3.0),
    ('{type: pose, frame: tool, weights: {m: 100}}', [100.0] * 3 + [1.0] * 3),
    ('{type: position, frame: tool, weights: [1, 2, 3]}', [1.0, 2.0, 3.0]),
    ('{type: joint, joints: [arm_2, torso, arm_1], weights: {torso: 5, arm_1: 2}}',
     [1.0, 5.0, 2.0]),
    ('{type: posture, weights: {arm: 10}}', [1.0] + [10.0] * 7),
    ('{type: posture, weights: {arm_2: 3, arm: 10}}', [1.0, 10.0, 3.0] + [10.0] * 5),
    ('{type: posture, weights: {arm: 10, arm_2: 3}}', [1.0, 10.0, 3.0] + [10.0] * 5)])
def test_weights_are_given_by_row_unit_joint_and_group(task, weights):
    task = Stack.from_yaml(f'- task: {task}\n', ROBOT).tasks['task']
    assert task.row_weights.tolist() == weights
    task.start(ROBOT.state(Q))
    level = task.evaluate(ROBOT.state(Q), 0.0).level
    assert level.weights.tolist() == np.broadcast_to(weights, task.rows).tolist()


@pytest.mark.parametrize('task, message', [
    ('{type: position, frame: tool, weights: [1, 2]}', 'one for each of the 3 rows, got 2'),
    ('{type: position, frame: tool, weights: 0}', 'weights: must be positive'),
    ('{type: position, frame: tool, weights: {rad: 1}}', "unknown name of rows 'rad'; valid: m"),
    ('{type: joint, joints: arm, weights: {torso: 2}}', "unknown name of rows 'torso'"),
    ('{type: joint, joints: arm, weights: {arm_1: -2}}', 'weights: arm_1 must be positive'),
    ('{type: joint, joints: hand}',
     "joints: unknown driven joint or group 'hand'; valid: arm, torso, torso_lift, arm_1")])
def test_weights_that_are_none_are_refused(task, message):
    with pytest.raises(StackError, match=message):
        Stack.from_yaml(f'- task: {task}\n', ROBOT)


def test_tasks_of_a_level_weigh_against_each_other():
    other = TOOL.replace('tool:', 'other:')
    stack = Stack.from_yaml(f'- [{TOOL}, weights: 4}}, {other}}}]\n', ROBOT)
    stack.start(ROBOT.state(Q))
    level, = stack.levels(ROBOT.state(Q), 0.0)
    assert level.weights.tolist() == [4.0] * 3 + [1.0] * 3

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Causes: at random states beside solving again without them, and cases worked out by hand."""

import importlib
import re

import numpy as np
import pytest
import robots
from robots import cartesian
from scipy.spatial.transform import Rotation
from tp_controller import Controller, KinematicSimulator, Robot, Settings, Stack
from tp_controller.control.causes import Cause
from tp_controller.control.reasons import suffice

NOW = Settings(blend=0.0, reserve=0.0, period=0.01)


@pytest.fixture
def sweep(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('causes')


@pytest.mark.parametrize('case', [
    'Panda', 'UR5', 'xArm 7', 'TIAGo on wheels', 'Baxter', 'Talos'])
@pytest.mark.slow
def test_causes_in_motion_are_what_brings_back_what_is_missing(sweep, case):
    findings = sweep.measure(case, 20)
    assert findings.faults == [] and findings.true == findings.found
    assert findings.true >= 10 and max(findings.shares) < 0.06


def test_limits_that_act_before_all_joints_are_scaled_are_causes(sweep):
    # A joint limits the demand, and another one the motion that is left within a box.
    findings = sweep.Findings()
    for scene in list(sweep.drive('Panda', 4))[5:8]:
        sweep.compare(scene, '', findings)
    assert findings.faults == [] and findings.true == findings.found >= 6


def first_report(robot, stack, q, settings=NOW, goals=()):
    """Return the report of the first cycle as {task: TaskReport}."""
    controller = Controller(robot, Stack.from_yaml(stack, robot), settings)
    for name, goal in dict(goals).items():
        controller.set_goal(name, goal, 0.0)
    return {task.name: task for task in controller.update(q, 0.0).report.tasks}


def kinds(task):
    """Return (kind, name, share) of the causes of a task."""
    return [(cause.kind, cause.name, pytest.approx(cause.share, abs=1e-9))
            for cause in task.causes]


def test_task_above_that_takes_the_direction_is_named():
    tasks = first_report(cartesian(), """
- left: {type: joint, joints: slide_x, target: [0.5]}
- right: {type: joint, joints: slide_x, target: [-0.5]}
""", [0.0, 0.0, 0.0])
    assert tasks['left'].causes == () and tasks['left'].reason == tasks['left'].hint == ''
    assert kinds(tasks['right']) == [('task', 'left', 1.0)]
    assert tasks['right'].reason == 'blocked by left'
    assert tasks['right'].hint == ('exchange left and right in the stack (left then misses its '
                                   'goal), or choose goals that '
                                   'are compatible')


def test_task_above_is_named_however_long_it_has_been_pushed_against():
    # The tool rests at a joint limit; the posture below has been pushing ever since.
    robot = Robot.from_file(robots.PANDA_DH, limits={'panda_joint2': {'upper': 0.2}})
    controller = Controller(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {robots.PANDA_TOOL}, gain: 2.0}}\n'
        '- posture: {type: posture, gain: 1.0}\n', robot))
    simulator = KinematicSimulator(robot, robots.PANDA_READY)
    controller.set_goal('tool', [0.65, 0.0, 0.2], 0.0)
    for cycle in range(600):
        command = controller.update(simulator.q, 0.01 * cycle)
        simulator.command(command.velocity)
        simulator.step(0.01)
    tool, posture = command.report.tasks
    assert [cause.name for cause in tool.causes] == ['panda_joint2']
    assert (posture.causes[0].kind, posture.causes[0].name) == ('task', 'tool')
    assert posture.causes[0].share == pytest.approx(1.0)
    assert posture.reason.startswith('blocked by tool')


def test_task_within_its_tolerance_has_no_causes():
    tasks = first_report(cartesian(), """
- left: {type: joint, joints: slide_x, target: [0.5]}
- right: {type: joint, joints: slide_x, target: [-0.5], tolerance: 1.0}
""", [0.0, 0.0, 0.0])
    assert tasks['right'].reached and tasks['right'].causes == ()


def test_task_on_the_same_level_is_named_as_well():
    tasks = first_report(cartesian(), """
- - left: {type: joint, joints: slide_x, target: [0.5]}
  - right: {type: joint, joints: slide_x, target: [-0.5]}
""", [0.0, 0.0, 0.0])
    assert kinds(tasks['left']) == [('task', 'right', 1.0)]
    assert kinds(tasks['right']) == [('task', 'left', 1.0)]
    assert tasks['right'].hint == ('give left and right levels of their own, right first (left '
                                   'then misses its goal)')


def test_two_tasks_that_each_suffice_hold_back_together_and_none_alone():
    task = first_report(cartesian(), """
- a: {type: joint, joints: slide_x, target: [0.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [0.5]}
""", [0.0, 0.0, 0.0])['c']
    assert task.causes == ()
    assert task.reason == 'blocked by a and b together'


def test_of_those_that_block_together_only_the_ones_that_matter_are_named():
    task = first_report(cartesian(), """
- idle: {type: joint, joints: slide_y, target: [0.3]}
- cell: {type: keep_in, frame: z, shape: {box: [3, 3, 3]}}
- a: {type: joint, joints: slide_x, target: [0.0]}
- [still: {type: joint, joints: slide_z, target: [0.1]}, b: {type: position, frame: z, axes: x}]
- c: {type: joint, joints: slide_x, target: [0.5]}
""", [0.0, 0.0, 0.0])['c']
    assert task.causes == ()
    assert task.reason == 'blocked by a and b together'


def test_task_and_limit_that_each_suffice_are_named_together():
    # The limit is not felt as long as the task above has the direction.
    task = first_report(cartesian(), """
- a: {type: joint, joints: slide_x, target: [2.0]}
- b: {type: joint, joints: slide_y, target: [0.1]}
- c: {type: position, frame: z, axes: x}
""", [2.0, 0.0, 0.0], goals={'c': [2.5, 0.0, 0.0]})['c']
    assert task.causes == ()
    assert task.reason == 'blocked by a and the upper position limit of slide_x together'
    # Each is told of as it is where it blocks a task alone.
    assert task.phrases == ('blocked by a', 'slide_x at its upper position limit')


def test_limit_acts_through_the_task_above_that_it_limits():
    # Joint x is too slow for the tool, which therefore takes all of the elbow's joint.
    robot = robots.planar()
    tasks = first_report(robot, """
- tool: {type: position, frame: link3, axes: xy}
- turn: {type: joint, joints: joint3, target: [2.0], gain: 0.3}
""", robots.PLANAR_START, goals={'tool': np.array([0.5, 1.6, 0.0])})
    named = {cause.name: cause.kind for cause in tasks['turn'].causes}
    assert named.get('tool') == 'task'
    assert 'velocity limit' in named.values()


@pytest.mark.parametrize('scaling, shares', [
    # Of (1, 0.5) that is missing, one half or the whole of the other part stays.
    ('redistribute', {'slide_x': 1.0 - 0.5 / np.hypot(1.0, 0.5),
                      'slide_y': 1.0 - 1.0 / np.hypot(1.0, 0.5)}),
    # All are scaled to 1/2; without the limit of x, that of y lets 2/3 pass.
    ('uniform', {'slide_x': 1.0 - (1.0 / 3.0) / 0.5})])
def test_limits_are_named_with_the_share_that_each_costs(scaling, shares):
    settings = Settings(blend=0.0, reserve=0.0, period=0.01, scaling=scaling)
    task = first_report(cartesian(), '- tool: {type: position, frame: z}', [0.0, 0.0, 0.0],
                        settings, {'tool': [2.0, 1.5, 0.1]})['tool']
    assert kinds(task) == [('velocity limit', name, share) for name, share in shares.items()]


def test_limits_that_say_the_same_are_one_cause():
    # 0.1 m before its end braking leaves a joint its speed limit exactly.
    task = first_report(cartesian(), '- tool: {type: position, frame: z}', [1.9, 0.0, 0.0],
                        NOW, {'tool': [4.0, 0.0, 0.0]})['tool']
    assert kinds(task) == [('velocity limit', 'slide_x', 1.0)]


def test_reserve_is_a_cause_where_a_joint_is_kept_ready():
    robot = cartesian({'slide_x': {'acceleration': 1000.0}})
    tasks = first_report(robot, """
- first: {type: joint, joints: slide_y, target: [0.1]}
- second: {type: joint, joints: slide_x, target: [0.9]}
""", [0.0, 0.0, 0.0], Settings(blend=0.0, reserve=0.4, period=0.01))
    # As the first level itself it could have all of it.
    assert kinds(tasks['second']) == [('reserve', 'slide_x', 1.0)]
    assert 'reserve' in tasks['second'].reason
    assert tasks['second'].hint == 'wait 7 s until it arrives'


@pytest.mark.parametrize('reserve', [0.0, 0.4])
def test_velocity_limit_below_the_first_level_is_a_cause_where_another_joint_accelerates(reserve):
    tasks = first_report(cartesian({'slide_x': {'acceleration': 1000.0}}), """
- first: {type: joint, joints: slide_x, target: [0.1]}
- second: {type: joint, joints: [slide_y, slide_z], target: [1.9, 0.0]}
""", [0.0, 0.0, 0.0], Settings(blend=0.0, reserve=reserve, period=0.01))
    assert kinds(tasks['second']) == [('velocity limit', 'slide_y', 1.0)]


def test_report_names_the_reserve_where_that_slows_the_command():
    robot = cartesian({'slide_x': {'acceleration': 1000.0}})
    controller = Controller(robot, Stack.from_yaml("""
- first: {type: joint, joints: slide_y, target: [0.1]}
- second: {type: joint, joints: slide_x, target: [0.9]}
""", robot), Settings(blend=0.0, reserve=0.4, period=0.01))
    report = controller.update([0.0, 0.0, 0.0], 0.0).report
    assert report.limiting == (
        'slide_x at its velocity limit minus the reserve for the first level')


def test_accelerating_is_a_cause_until_the_joint_is_fast():
    robot = cartesian({'slide_x': {'acceleration': 10.0}})
    task = first_report(robot, '- j: {type: joint, joints: slide_x, target: [0.9]}',
                        [0.0, 0.0, 0.0])['j']
    assert kinds(task) == [('accelerating', '', 1.0)]
    assert task.hint == 'wait 7 s until it arrives'


def test_joints_that_accelerate_are_one_cause_and_what_is_missing_then_another():
    robot = cartesian({name: {'acceleration': 1.0} for name in ('slide_x', 'slide_y')})
    # Of (1.5, 0.5) it gets (0.01, 0.01) now, and (1, 0.5) later.
    task = first_report(robot, '- tool: {type: position, frame: z, axes: xy}', [0.0, 0.0, 0.0],
                        goals={'tool': [1.5, 0.5, 0.0]})['tool']
    now = np.hypot(1.5 - 0.01, 0.5 - 0.01)
    assert kinds(task) == [('accelerating', '', 1.0 - 0.5 / now),
                           ('velocity limit', 'slide_x', 0.5 / now)]
    assert task.reason == 'accelerating; slide_x soon at its velocity limit'
    assert task.hint == 'wait 8 s until it arrives'


def test_a_joint_that_has_accelerated_is_at_its_limit_and_no_longer_soon():
    robot = cartesian({'slide_x': {'acceleration': 10.0}})
    controller = Controller(robot, Stack.from_yaml(
        '- j: {type: joint, joints: slide_x, target: [2.0]}', robot),
        Settings(period=0.01, command_delay=0))
    reasons = [controller.update([0.0, 0.0, 0.0], 0.01 * cycle).report.tasks[0].reason
               for cycle in range(20)]
    assert reasons[0] == 'slide_x soon at its velocity limit; accelerating'
    assert reasons[-1] == 'slide_x at its velocity limit'


def test_with_uniform_scaling_a_limit_slows_all_tasks():
    stack = """
- x: {type: joint, joints: slide_x, target: [2.0]}
- y: {type: joint, joints: slide_y, target: [0.5]}
"""
    tasks = first_report(cartesian(), stack, [0.0, 0.0, 0.0], settings=Settings(
        scaling='uniform'))
    assert tasks['x'].reason == 'slide_x at its velocity limit, which slows all tasks'
    assert tasks['y'].reason == (
        'slide_x at its velocity limit, which slows all tasks; blocked by x')


def test_bounds_of_a_task_are_named():
    tasks = first_report(cartesian(), """
- cell: {type: keep_in, frame: z, shape: {box: [1, 1, 1]}}
- tool: {type: position, frame: z}
""", [0.5, 0.0, 0.0], goals={'tool': [0.9, 0.0, 0.0]})
    assert kinds(tasks['tool']) == [('bounds', 'cell', 1.0)]
    assert tasks['tool'].reason == 'blocked by the bounds of cell'
    assert tasks['tool'].phrases == ('blocked by the bounds of cell',)
    assert tasks['cell'].causes == () and tasks['cell'].reason == ''
    assert tasks['cell'].phrases == ()


def test_direction_that_the_robot_has_not_is_impossible_and_the_goal_out_of_reach():
    robot = robots.planar()
    x, y, _ = robot.state(robots.PLANAR_START).position('link3')
    task = first_report(robot, '- tool: {type: position, frame: link3}', robots.PLANAR_START,
                        goals={'tool': [x, y, 0.31]})['tool']
    assert kinds(task) == [('impossible', '', 1.0)]
    assert task.reason == 'out of reach by 0.31 m' and task.phrases == ('out of reach',)
    assert task.hint == 'the goal is out of reach: choose another one'


def test_goal_beyond_the_reach_of_an_arm_is_out_of_reach_once_the_arm_rests():
    robot, q = robots.panda(), np.array(robots.PANDA_READY)
    controller = Controller(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {robots.PANDA_TOOL}, gain: 2.0}}', robot), NOW)
    controller.set_goal('tool', [0.0, 0.0, 1.5], 0.0)
    said = []
    for cycle in range(2000):
        command = controller.update(q, 0.01 * cycle)
        q = q + 0.01 * command.velocity
        if cycle % 50 == 0:
            said.append(command.report.tasks[0].reason)
    error = command.report.tasks[0].errors[0][0]
    assert said[-1] == f'out of reach by {error:.2g} m'
    assert 'out of reach by' not in said[1]


def test_tool_is_out_of_reach_while_the_other_arm_moves():
    robot = robots.urdf_robot('baxter')
    q = robot.neutral()
    controller = Controller(robot, Stack.from_yaml("""
- left: {type: position, frame: left_gripper, gain: 2.0}
- right: {type: position, frame: right_gripper, gain: 2.0}
""", robot), NOW)
    state = robot.state(q)
    start = state.position('right_gripper')
    controller.set_goal('left', [2.0, 1.0, 0.3], 0.0)
    said = []
    for cycle in range(1500):
        controller.set_goal('right', start + [0.0, 0.05 * np.sin(0.01 * cycle), 0.0], 0.01 * cycle)
        command = controller.update(q, 0.01 * cycle)
        q = robot.integrate(q, command.velocity, 0.01)
        if cycle % 100 == 99:
            left, right = command.report.tasks
            said.append(left.reason)
            assert left.phrases[0] == 'out of reach' and not re.search(r'\d m', str(left.phrases))
    assert np.abs(command.velocity).max() > 0.02
    assert said[-1] == f'out of reach by {left.errors[0][0]:.2g} m'
    assert 'out of reach by' not in said[0]
    assert said[0].startswith('the goal is 2.26 m from base, and out of reach')


@pytest.mark.parametrize('goal, beyond', [(0.4, False), (1.4, True), (0.0, False)])
def test_goal_within_reach_of_a_straight_arm_is_not_called_out_of_reach(goal, beyond):
    # No joint moves its tip along the arm, neither outwards nor back.
    robot = Robot.from_dh([{'name': f'j{number}', 'a': 0.5, 'velocity': 1.0, 'lower': -3.0,
                            'upper': 3.0} for number in range(2)])
    task = first_report(robot, '- tip: {type: position, frame: link2, axes: xy}', [0.0, 0.0],
                        goals={'tip': [goal, 0.0, 0.0]})['tip']
    assert task.reason == ('out of reach by 0.4 m' if beyond else
                           'the robot cannot move in this direction here')


# A base that may turn meanwhile, and one that has to face forward.
@pytest.mark.parametrize('task', ['position, frame: base_link', 'base_pose'])
def test_wheels_that_cannot_go_sideways_do_not_make_a_goal_out_of_reach(task):
    reasons = {}
    for base in ('planar', 'differential'):
        robot = Robot.from_file(robots.CONFIG / 'robots' / 'mobile_arm.urdf', base=base)
        for y, z in ((0.5, 0.0), (0.0, 0.5)):
            goal = [0.0, y, z, 0.0, 0.0, 0.0, 1.0] if task == 'base_pose' else [0.0, y, z]
            found = first_report(robot, f'- base: {{type: {task}}}', robot.neutral(),
                                 goals={'base': goal})
            reasons[base, z] = found['base'].reason
    assert reasons['differential', 0.0] == 'the robot cannot move in this direction here'
    assert reasons['planar', 0.0] == ''
    if task != 'base_pose':
        assert reasons['planar', 0.5] == reasons['differential', 0.5] == 'out of reach by 0.5 m'


def test_looking_whether_a_goal_is_out_of_reach_leaves_no_trace_in_the_task():
    robot = robots.planar()
    controller = Controller(robot, Stack.from_yaml(
        '- turn: {type: orientation, frame: link3}', robot), NOW)
    controller.update(robots.PLANAR_START, 0.0)
    rolled = Rotation.from_rotvec([1.0, 0.0, 0.0]) * Rotation.from_rotvec([0.0, 0.0, 0.9])
    controller.set_goal('turn', rolled.as_quat(), 0.0)
    report = controller.update(robots.PLANAR_START, 0.01).report
    direction = controller.stack.tasks['turn']._rotation_error
    before = direction.memory.copy()
    assert report.tasks[0].reason == 'out of reach by 1 rad'
    assert before[3] and np.array_equal(direction.memory, before)


def test_goal_behind_two_limits_that_each_suffice_is_not_out_of_reach():
    # Uniform scaling: each of two joints at its limit stops all others, and z is free.
    task = first_report(cartesian(), '- tool: {type: position, frame: z}\n', [2.0, 2.0, 0.0],
                        Settings(blend=0.0, reserve=0.0, period=0.01, scaling='uniform'),
                        {'tool': [3.0, 3.0, 0.1]})['tool']
    assert task.causes == ()
    assert task.reason == 'slide_x and slide_y at their upper position limits'


def test_while_a_change_fades_in_no_empty_name_is_told():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(
        '- tool: {type: position, frame: panda_hand_tcp}\n'
        '- low: {type: position, frame: panda_hand_tcp}\n', robot))
    simulator = KinematicSimulator(robot, robots.PANDA_READY)
    for cycle in range(150):
        if cycle == 20:
            controller.set_goal('low', [0.3, 0.3, 0.3], 0.01 * cycle)
        command = controller.update(simulator.q, 0.01 * cycle)
        simulator.command(command.velocity)
        simulator.step(0.01)
        for task in command.report.tasks:
            assert 'by  ' not in task.reason and 'together' not in task.reason, task.reason


def test_while_a_change_fades_in_only_those_that_block_are_named():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml("""
- idle: {type: joint, joints: slide_y}
- high: {type: joint, joints: slide_x}
- low: {type: joint, joints: slide_x, target: [-0.5]}
""", robot), Settings(period=0.01, blend=0.4))
    controller.update([0.0, 0.0, 0.0], 0.0)
    controller.set_goal('idle', [0.5], 0.0)
    tasks = controller.update([0.0, 0.0, 0.0], 0.01).report.tasks
    assert [task.reason for task in tasks] == [
        'a change is still being blended in', '', 'blocked by high']


def test_change_that_fades_in_is_a_cause():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml(
        '- j: {type: joint, joints: slide_x}', robot), Settings(period=0.01, blend=0.4))
    controller.update([0.0, 0.0, 0.0], 0.0)
    controller.set_goal('j', [0.5], 0.0)
    task, = controller.update([0.0, 0.0, 0.0], 0.01).report.tasks
    assert kinds(task) == [('transition', '', 1.0)]
    assert task.reason == 'a change is still being blended in'


def test_damping_is_a_cause_and_so_is_the_singularity_that_it_is_for():
    robot = robots.planar()
    task = first_report(robot, '- tool: {type: position, frame: link3, axes: xy}',
                        [0.0, 0.02, 0.0], goals={'tool': [1.3, 0.05, 0.0]})['tool']
    assert {cause.kind for cause in task.causes} >= {'singularity'}
    assert 'near a singularity' in task.reason


def test_damping_that_is_left_of_a_joint_limit_is_a_cause_that_passes():
    # The tool has rested at a joint limit; its way back is free, but not yet forgotten.
    robot = Robot.from_file(robots.PANDA_DH, limits={'panda_joint2': {'upper': 0.2}})
    controller = Controller(robot, Stack.from_yaml(
        f'- tool: {{type: position, frame: {robots.PANDA_TOOL}, gain: 2.0}}\n'
        '- posture: {type: posture, gain: 1.0}\n', robot), NOW)
    simulator, named = KinematicSimulator(robot, robots.PANDA_READY), []
    for cycle in range(301):
        controller.set_goal('tool', [0.65, 0.0, 0.2] if cycle < 300 else [0.5, 0.0, 0.4], 0.0)
        command = controller.update(simulator.q, 0.01 * cycle)
        simulator.command(command.velocity)
        simulator.step(0.01)
        named.append({cause.kind: cause.share for cause in command.report.tasks[1].causes})
    assert 'damping' not in named[-1] and named[-1]['curvature'] > 0.5
    assert named[-2]['task'] == pytest.approx(1.0) and named[-2].get('curvature', 0.0) < 0.1
    assert command.report.tasks[1].reason.startswith('damped so that it does not oscillate')


def test_reason_names_the_largest_causes_and_the_phrases_all():
    robot = robots.panda()
    q = np.array(robots.PANDA_READY)
    target = (q + [0.95, 0.8, 0.73, 0.6, -0.9, 0.8, 0.7]).round(3).tolist()
    task = first_report(robot, f'- rest: {{type: posture, gain: 3.2, target: {target}}}', q)[
        'rest']
    assert len(task.causes) > 3
    named = tuple(f'{cause.name} at its velocity limit' for cause in task.causes)
    notable = [cause for cause in task.causes if cause.share >= 0.1]
    assert 0 < len(notable) < 3
    assert task.phrases == named and task.reason == '; '.join(named[:len(notable)])


@pytest.mark.parametrize('turned, count, reason', [
    (0.5, 7, 'panda_joint1, panda_joint2, panda_joint3 and 4 more at their velocity limits'),
    ([0.5, *[0.0] * 6], 1, 'panda_joint1 at its velocity limit')])
def test_limits_that_each_cost_less_than_a_tenth_are_named_together(turned, count, reason):
    robot = Robot.from_file(robots.PANDA_DH, limits={
        f'panda_joint{number}': {'velocity': 0.01} for number in range(1, 8)})
    q = np.array(robots.PANDA_READY)
    target = (q + turned).tolist()
    task = first_report(robot, f'- rest: {{type: posture, target: {target}}}', q)['rest']
    # Of seven joints that lack the same, each costs 1 − √(6 / 7) of it.
    assert task.reason == reason and len(task.phrases) == len(task.causes) == count
    assert 'panda_joint1 at its velocity limit' in task.phrases


def test_of_many_that_block_together_three_are_named_and_the_others_counted():
    task = first_report(cartesian(), """
- a: {type: joint, joints: slide_x, target: [2.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [2.0]}
- d: {type: position, frame: z, axes: x}
- e: {type: joint, joints: slide_x, target: [2.0]}
- f: {type: position, frame: z, axes: x}
""", [2.0, 0.0, 0.0], goals={'f': [2.5, 0.0, 0.0]})['f']
    assert task.reason == ('blocked by a, b, c, 2 more tasks and 1 upper position limit '
                           'together')
    assert len(task.phrases) == 6


def test_only_rows_of_joints_that_move_the_task_are_named():
    tasks = first_report(cartesian(), """
- limits: {type: joint_limits, margin: 0.5}
- x: {type: joint, joints: slide_x, target: [1.8]}
- y: {type: position, frame: z, axes: y}
""", [1.5, 1.5, 0.0], goals={'y': [0.0, 1.9, 0.0]})
    assert tasks['x'].reason == 'blocked by the bounds of limits (slide_x)'
    assert tasks['y'].reason == 'blocked by the bounds of limits (slide_y)'


def test_disabled_task_has_neither_cause_nor_reason():
    robot = cartesian()
    controller = Controller(robot, Stack.from_yaml(
        '- j: {type: joint, joints: slide_x, target: [1.0]}', robot), NOW)
    controller.enable('j', False)
    task, = controller.update([0.0, 0.0, 0.0], 0.0).report.tasks
    assert (task.causes, task.reason, task.hint, task.status) == ((), '', '', 'disabled')


def test_curvature_that_is_about_to_be_forgotten_is_a_cause():
    # Uniform scaling: without any curvature the task above would be faster, and leave less.
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml("""
- [cell: {type: keep_in, frame: panda_hand_tcp, shape: {box: [0.8, 0.49, 0.77]},
          at: [-0.2, -0.56, 0.74]}, margin: {type: joint_limits, margin: 0.1}]
- second: {type: position, frame: panda_link4, gain: 2.0}
- joints: {type: joint, joints: [panda_joint3, panda_joint7], gain: 0.5}
""", robot), Settings(period=0.01, scaling='uniform'))
    simulator = KinematicSimulator(robot, [-1.53, 0.31, 0.008, -0.986, -1.332, 1.225, -2.03])
    controller.set_goal('second', [0.147, 0.286, 0.391], 0.0)
    controller.set_goal('joints', [-0.919, -0.205], 0.0)
    missing = []
    for cycle in range(250):
        command = controller.update(simulator.q, 0.01 * cycle)
        task = command.report.tasks[-1]
        missing.append(1.0 - task.achieved_speed / task.demanded_speed)
        if cycle == 224:
            assert missing[-1] > 0.3 and task.phrases == ('damped so that it does not oscillate',)
        simulator.command(command.velocity)
        simulator.step(0.01)
    assert missing[-1] < 0.01


def test_limits_that_act_only_without_the_tasks_that_block_are_not_named():
    # Without a and b two thirds of what is missing come back, to the velocity limit.
    task = first_report(cartesian(), """
- a: {type: joint, joints: slide_x, target: [0.0]}
- b: {type: position, frame: z, axes: x}
- c: {type: joint, joints: slide_x, target: [1.5]}
""", [0.0, 0.0, 0.0])['c']
    assert task.reason == 'blocked by a and b together'


def test_causes_that_leave_most_unexplained_do_not_stand_for_those_that_act_together():
    # Each of the two limits alone brings back 0.27 of what is missing.
    task = first_report(cartesian(), '- tool: {type: position, frame: z, axes: xy}',
                        [0.0, 0.0, 0.0], NOW, {'tool': [1.8, 1.8, 0.0]})['tool']
    assert [round(cause.share, 2) for cause in task.causes] == [0.29, 0.29]
    assert suffice(task.causes)
    assert not suffice(task.causes[:1])
    assert suffice([Cause('singularity', '', 0.02)])


def test_the_joint_that_slows_all_is_named_even_if_the_next_limit_is_as_low():
    # Both joints are scaled to half; without the limit of x it would be 0.51.
    tasks = first_report(cartesian(), """
- x: {type: joint, joints: slide_x, target: [2.0]}
- y: {type: joint, joints: slide_y, target: [1.96]}
- z: {type: joint, joints: slide_x, target: [0.2]}
""", [0.0, 0.0, 0.0], Settings(scaling='uniform', blend=0.0))
    slows = 'slide_x at its velocity limit, which slows all tasks'
    assert tasks['z'].reason == f'blocked by x; {slows}'
    assert max(cause.share for cause in tasks['y'].causes if cause.kind != 'task') < 0.1
    assert tasks['y'].reason.startswith('slide_x')


def test_a_motion_that_is_impossible_but_for_rounding_is_no_singularity():
    # The point is on a sphere, but for 1e-7 m, as where a description rounds its angles.
    robot = Robot.from_dh([
        {'name': 'a', 'alpha': 1.5707963, 'd': 0.3, 'velocity': 9.0},
        {'name': 'b', 'alpha': -1.5707963, 'velocity': 9.0},
        {'name': 'c', 'd': 0.3, 'a': 1e-7, 'velocity': 9.0}])
    task = first_report(robot, '- tip: {type: position, frame: link3}', [0.3, 0.4, 0.2],
                        goals={'tip': [0.5, 0.5, 0.9]})['tip']
    assert {cause.kind for cause in task.causes} == {'impossible'}


def test_an_arm_does_not_block_another_with_which_it_shares_damping_only():
    robot = Robot.from_urdf(robots.urdf_path('baxter'), joints=[
        f'{side}_{joint}' for side in ('left', 'right')
        for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')])
    stack = Stack.from_yaml("""
- left: {type: pose, frame: left_gripper}
- right: {type: pose, frame: right_gripper}
- rest: {type: posture}
""", robot)
    controller, q = Controller(robot, stack, NOW), robot.neutral()
    controller.update(q, 0.0)
    controller.set_goal('left', [2.0, 0.6, 0.4, 0.0, 0.0, 0.0, 1.0], 0.0)
    controller.set_goal('right', [2.0, -0.7, 0.5, 0.0, 0.0, 0.0, 1.0], 0.0)
    for cycle in range(1, 200):
        command = controller.update(q, 0.01 * cycle)
        q = robot.integrate(q, command.velocity, 0.01)
        left, right, rest = command.report.tasks
        assert 'left' not in [cause.name for cause in right.causes]
    # What both couple is blocked by both.
    assert {'left', 'right'} & {cause.name for cause in rest.causes}

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Changes of the stack, of goals and settings while the robot moves."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack

PERIOD = 1e-3
# Joints brake early enough that no limit becomes active.
CALM = Settings(period=PERIOD, braking_gain=50.0)
STACK = """
- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}
- orientation: {type: orientation, frame: panda_hand_tcp, gain: 2.0}
- elbow: {type: position, frame: panda_link4, axes: z, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
SWAPPED = """
- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}
- elbow: {type: position, frame: panda_link4, axes: z, gain: 2.0}
- orientation: {type: orientation, frame: panda_hand_tcp, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
START = np.array([0.0, -0.4, 0.2, -2.0, 0.1, 1.6, 0.8])
# After the goals of the start have faded in.
CHANGE = 0.6


class Run:
    """A Panda on its way to a goal of every task; it does as it is told."""

    def __init__(self, settings=CALM, acceleration=None, text=STACK,
                 goals=('tool', 'orientation', 'elbow')):
        limits = None if acceleration is None else {
            name: {'acceleration': acceleration} for name in robots.panda().joint_names}
        self.robot = Robot.from_file(robots.PANDA_DH, limits=limits)
        self.controller = Controller(self.robot, Stack.from_yaml(text, self.robot), settings)
        self.q, self.now = START.copy(), 0.0
        self.velocities, self.errors = [], []
        self.update()
        state = self.robot.state(START)
        self.goal = state.position('panda_hand_tcp') + [0.1, 0.15, -0.05]
        wanted = {'tool': self.goal, 'elbow': state.position('panda_link4') - 0.05,
                  'orientation': [0.9238795, 0.3826834, 0.0, 0.0]}
        for name in goals:
            self.controller.set_goal(name, wanted[name], self.now)

    def update(self):
        """Run one cycle."""
        self.command = self.controller.update(self.q, self.now)
        self.velocities.append(self.command.velocity)
        if hasattr(self, 'goal'):
            state = self.robot.state(self.q)
            achieved = state.jacobian('panda_hand_tcp')[:3] @ self.command.velocity
            demand = 2.0 * (self.goal - state.position('panda_hand_tcp'))
            self.errors.append(np.linalg.norm(achieved - demand))
        self.q = self.q + PERIOD * self.command.velocity
        self.now += PERIOD

    def until(self, end):
        """Run until a time."""
        while self.now < end - 1e-9:
            self.update()

    def fastest_change(self, since, until=np.inf):
        """Return the largest change of a joint velocity, per second, between two times."""
        changes = np.abs(np.diff(self.velocities, axis=0)).max(axis=1) / PERIOD
        times = PERIOD * np.arange(1, len(changes) + 1)
        return changes[(times > since - 0.5 * PERIOD) & (times < until)].max()


def leave_out(run):
    """Take a task out."""
    run.controller.enable('orientation', False)


def swap(run):
    """Swap two tasks."""
    run.controller.replace_stack(Stack.from_yaml(SWAPPED, run.robot))


def raise_gain(run):
    """Make a task faster."""
    text = STACK.replace('orientation, frame: panda_hand_tcp, gain: 2.0',
                         'orientation, frame: panda_hand_tcp, gain: 6.0')
    run.controller.replace_stack(Stack.from_yaml(text, run.robot))


def set_gain(run):
    """Make a task faster, without another stack."""
    run.controller.set_gain('orientation', 6.0)


def turn_back(run):
    """Give a task another goal."""
    run.controller.set_goal('orientation', [1.0, 0.0, 0.0, 0.0], run.now)


def weigh(run):
    """Change a setting."""
    run.controller.settings = replace(run.controller.settings,
                                      weights=(1.0, 5.0, 1.0, 1.0, 1.0, 1.0, 1.0))


CHANGES = [leave_out, swap, raise_gain, set_gain, turn_back]


@pytest.mark.slow
@pytest.mark.parametrize('change', CHANGES)
def test_a_change_on_the_way_makes_no_jump(change):
    fast = {}
    for blend in (0.0, 0.4):
        run = Run(replace(CALM, blend=blend))
        run.until(CHANGE)
        change(run)
        run.until(CHANGE + 0.5)
        fast[blend] = run.fastest_change(CHANGE)
    # Without blending the velocity jumps within one period.
    assert fast[0.0] > 30.0
    assert fast[0.4] < 16.0


def test_a_change_of_settings_makes_no_jump():
    fast = {}
    for blend in (0.0, 0.4):
        run = Run(replace(CALM, blend=blend), text='\n'.join(STACK.splitlines()[:3]),
                  goals=('tool', 'orientation'))
        run.until(CHANGE)
        weigh(run)
        run.until(CHANGE + 0.5)
        fast[blend] = run.fastest_change(CHANGE)
    assert fast[0.0] > 20.0 * fast[0.4]


@pytest.mark.slow
@pytest.mark.parametrize('change', CHANGES)
def test_levels_that_the_change_leaves_as_they_are_are_not_disturbed_by_it(change):
    run = Run()
    run.until(CHANGE)
    change(run)
    del run.errors[:]
    run.until(CHANGE + 0.5)
    assert max(run.errors) < 1e-12


BELOW = """
- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}
- elbow: {type: position, frame: panda_link4, axes: z, gain: 2.0}
- posture: {type: posture, gain: 0.5, target: {panda_joint1: 0.8}}
"""


def put(run, text=BELOW):
    """Replace the stack."""
    run.controller.replace_stack(Stack.from_yaml(text, run.robot))


def replace_by_the_same(run):
    """Replace the stack by one that is the same."""
    put(run, STACK)


def replace_twice(run):
    """Replace the stack by the same, and that by another one."""
    put(run, STACK)
    put(run)


def replace_and_disable(run):
    """Replace the stack, and leave out a task of the new one."""
    put(run)
    run.controller.enable('elbow', False)


REPLACEMENTS = [swap, raise_gain, put, replace_by_the_same, replace_twice,
                replace_and_disable]


def follow(change, moment='after', settings=CALM, speed=0.1, twist=False):
    """Follow a goal that moves in every cycle, before and after a change; return the run."""
    run = Run(settings)
    start = run.goal
    while run.now < CHANGE + 0.5:
        if moment == 'before' and abs(run.now - CHANGE) < 0.5 * PERIOD:
            change(run)
        run.goal = start + speed * np.array([0.0, run.now, 0.3 * run.now])
        run.controller.set_goal('tool', run.goal, run.now)
        if moment == 'after' and abs(run.now - CHANGE) < 0.5 * PERIOD:
            change(run)
        run.update()
    return run


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.parametrize('moment', ['before', 'after'])
@pytest.mark.parametrize('change', REPLACEMENTS)
@pytest.mark.slow
def test_first_task_does_not_feel_that_the_stack_is_replaced_while_its_goal_moves(
        change, moment, scaling):
    run = follow(change, moment, replace(CALM, scaling=scaling))
    # 2/s times what the tool lags behind is 0.1 m/s.
    assert max(run.errors[round(CHANGE / PERIOD) - 1:]) < 1e-10 * 0.1
    assert run.fastest_change(CHANGE, CHANGE + 0.05) < 5.0


@pytest.mark.slow
@pytest.mark.parametrize('replacement', [STACK, STACK.replace('- posture: {', '- posture: {'
                                                              'tolerance: 0.5, timeout: 3.0, ')])
def test_stack_in_its_own_place_changes_nothing(replacement):
    still, replaced = (follow(change) for change in (
        lambda run: None, lambda run: put(run, replacement)))
    np.testing.assert_array_equal(still.velocities, replaced.velocities)
    assert 'blended' not in replaced.command.report.tasks[-1].reason


@pytest.mark.slow
def test_stack_that_is_replaced_in_every_cycle_changes_nothing_either():
    still, run = (Run() for _ in range(2))
    still.until(CHANGE)
    while run.now < CHANGE - 1e-9:
        run.update()
        put(run, STACK)
    np.testing.assert_array_equal(still.velocities, run.velocities)


def test_default_goal_is_inherited_by_the_next_stack():
    run = Run(goals=('orientation', 'elbow'))
    run.until(CHANGE)
    goal = run.controller.stack.tasks['tool'].goal
    put(run)
    run.update()
    assert run.controller.stack.tasks['tool'].goal is goal
    tool = run.command.report.tasks[0]
    assert tool.errors[0][0] < 1e-6 and abs(tool.demanded_speed - tool.achieved_speed) < 1e-12


def test_restart_blends_to_the_default_goals_it_takes():
    run = Run(goals=())
    run.until(0.01)
    # After a push the robot returns to the default goals.
    run.q = run.q + 0.2
    run.until(0.5)
    speed = np.abs(run.velocities[-1]).max()
    assert speed > 0.05
    run.controller.restart()
    found = run.q.copy()
    run.until(1.0)
    assert run.controller.stack.tasks['posture'].goal == pytest.approx(found)
    # At once it would be the whole speed within a period of 1 ms.
    assert run.fastest_change(0.5) < 10.0 * speed


def twin(task):
    """Return a copy of a task, with its goal, that no controller has used."""
    task = copy(task)
    task.owner = None
    return task


@pytest.mark.slow
@pytest.mark.parametrize('change', CHANGES)
def test_the_change_is_complete_after_its_time(change):
    run = Run()
    run.until(CHANGE)
    change(run)
    run.until(CHANGE + 0.45)
    stack = run.controller.stack
    fresh = Controller(run.robot, Stack([[twin(task) for task in group]
                                         for group in stack.active]), run.controller.settings)
    np.testing.assert_allclose(run.controller.update(run.q, run.now).velocity,
                               fresh.update(run.q, run.now).velocity, rtol=0, atol=1e-12)


def test_a_change_begins_in_the_next_cycle():
    run, other = Run(), Run()
    run.until(CHANGE)
    other.until(CHANGE)
    leave_out(run)
    run.update()
    other.update()
    assert 1e-6 < np.abs(run.velocities[-1] - other.velocities[-1]).max() < 1e-2


def test_of_a_change_as_much_is_made_in_the_first_cycle_as_in_a_period():
    robot, settings = robots.panda(), Settings(period=0.01, blend=0.4)
    for pause in (0.01, 0.004, 5.0):
        controller = Controller(robot, Stack.from_yaml(
            '- j: {type: joint_velocity, timeout: 9}\n', robot), settings)
        controller.update(START, 0.0)
        controller.set_goal('j', np.full(7, 0.2), 0.0)
        share = min(pause, 0.01) / 0.4
        np.testing.assert_allclose(controller.update(START, pause).velocity,
                                   0.2 * share ** 2 * (3.0 - 2.0 * share), rtol=1e-9)


def test_changes_that_follow_each_other_make_no_jump_either():
    run = Run()
    for number in range(12):
        run.until(CHANGE + 0.05 * number)
        run.controller.enable('orientation', number % 2 == 1)
    run.until(CHANGE + 1.2)
    assert run.fastest_change(CHANGE) < 20.0


@pytest.mark.parametrize('change', CHANGES)
def test_a_change_keeps_to_the_acceleration_limit(change):
    run = Run(replace(CALM, blend=0.0), acceleration=8.0)
    run.until(CHANGE)
    change(run)
    run.until(CHANGE + 0.5)
    assert run.fastest_change(0.001) <= 8.0 + 1e-9
    # The task that keeps its place pays next to nothing for that.
    assert max(run.errors[round(CHANGE / PERIOD):]) < 1e-3


@pytest.mark.slow
def test_goals_in_quick_succession_are_one_motion_and_not_faded():
    velocities = {}
    for blend in (0.0, 0.4):
        run = Run(replace(CALM, blend=blend))
        for step in range(2500):
            run.controller.set_goal('tool', run.goal + [0.0, 0.0, 2e-5 * step], run.now)
            run.update()
        velocities[blend] = run.velocities
    # Only the first one fades in.
    np.testing.assert_allclose(velocities[0.4][-1], velocities[0.0][-1], rtol=0, atol=1e-2)


def test_the_report_says_that_a_change_is_still_going_on():
    run = Run()
    run.until(CHANGE)
    turn_back(run)
    run.update()
    tasks = {task.name: task for task in run.command.report.tasks}
    assert tasks['tool'].reason == ''
    assert tasks['orientation'].reason == 'a change is still being blended in'
    run.until(CHANGE + 0.45)
    assert {task.name: task for task in run.command.report.tasks}['orientation'].reason == ''


def test_after_zeros_were_commanded_the_robot_starts_from_rest():
    run = Run(acceleration=5.0)
    run.until(CHANGE)
    assert np.abs(run.velocities[-1]).max() > 0.1
    run.controller.halt(run.now)
    run.now += PERIOD
    run.update()
    assert np.abs(run.velocities[-1]).max() <= 5.0 * PERIOD + 1e-12


def test_first_update_acts_at_once():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml('- j: {type: joint_velocity, timeout: 9}\n',
                                                   robot))
    wanted = np.full(7, 0.1)
    controller.set_goal('j', wanted, 0.0)
    np.testing.assert_allclose(controller.update(START, 0.0).velocity, wanted)


def test_the_offset_fades_without_a_corner():
    from tp_controller.control.transition import Transition
    transition = Transition().begin(np.array([2.0, 0.0]), 5.0, 0.4, 0)
    # 1 − 3 s² + 2 s³ after the share s of the time.
    for share, left in ((0.0, 1.0), (0.25, 0.84375), (0.5, 0.5), (0.75, 0.15625)):
        level, = transition.levels([], np.array([0.1, 0.3]), 5.0 + 0.4 * share)
        np.testing.assert_allclose(level.v, [0.1 + 2.0 * left, 0.3], rtol=0, atol=1e-12)
    assert transition.levels([], np.zeros(2), 5.4 + 1e-9) is None


def test_bounds_of_the_new_stack_hold_while_a_change_fades_out():
    from tp_controller import Level
    from tp_controller.control.transition import Transition
    transition = Transition().begin(np.ones(2), 0.0, 0.4, 1)
    first, demand = (Level(np.eye(2)[:1], np.array([v])) for v in (0.1, 0.2))
    bound = Level(np.eye(2)[1:], upper=np.array([0.3]), lower=np.array([-0.3]))
    eased = transition.levels([first, bound, demand], np.zeros(2), 0.1)
    assert len(eased) == 3 and eased[0] is first and eased[1] is bound
    # Below a task that changes they do not, or they would change its direction meanwhile.
    below = transition.levels([first, demand, bound], np.zeros(2), 0.1)
    assert len(below) == 2 and below[0] is first and below[1].v is not None


@pytest.mark.slow
@pytest.mark.parametrize('pause', [0.0, 0.05])
def test_a_change_further_down_does_not_cut_short_the_one_above_it(pause):
    run = Run()
    run.until(CHANGE)
    turn_back(run)
    run.until(CHANGE + pause)
    run.controller.set_goal('posture', START + 0.2, run.now)
    run.until(CHANGE + 0.5)
    assert run.fastest_change(CHANGE) < 16.0


def test_acceleration_limits_count_with_the_time_that_has_passed():
    robot = Run(acceleration=5.0).robot
    for given in (False, True):
        controller = Controller(robot, Stack.from_yaml(
            '- j: {type: joint_velocity, timeout: 9}\n', robot), replace(CALM, blend=0.0))
        controller.set_goal('j', np.ones(7), 0.0)
        controller.update(START, 0.0)
        late, elapsed = (0.0, 0.4 * PERIOD) if given else (0.4 * PERIOD, None)
        before = controller.update(START, PERIOD).velocity
        after = controller.update(START, PERIOD + late, elapsed=elapsed).velocity
        np.testing.assert_allclose(after - before, 5.0 * 0.4 * PERIOD, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_settings_that_are_the_same_change_nothing():
    run, other = Run(), Run()
    run.until(CHANGE)
    other.until(CHANGE)
    run.controller.settings = replace(CALM)
    run.update()
    other.update()
    assert run.velocities[-1].tolist() == other.velocities[-1].tolist()
    assert run.command.report.tasks[0].reason == ''


def test_the_start_is_a_straight_ramp_and_not_a_detour_to_where_joints_are_fast():
    # With the acceleration limits in the aim, joint 1 swung to −0.7 rad/s and back.
    acceleration = dict(zip(robots.panda().joint_names, (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)))
    robot = Robot.from_file(robots.PANDA_DH, limits={
        name: {'acceleration': value} for name, value in acceleration.items()})
    controller = Controller(robot, Stack.from_yaml(
        '- tool: {type: pose, frame: panda_hand_tcp, gain: 2.0}\n'
        '- elbow: {type: position, frame: panda_link4, axes: y, gain: 1.5}\n'
        '- posture: {type: posture, gain: 0.5}\n', robot), Settings(period=0.005))
    q = np.array([0.3, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8])
    controller.update(q, 0.0)
    goal = robot.state(q).pose('panda_hand_tcp').copy()
    goal[:3, 3] += [0.0, 0.2, 0.0]
    controller.set_goal('tool', goal, 0.0)
    velocities = []
    for cycle in range(1, 100):
        velocities.append(controller.update(q, 0.005 * cycle).velocity)
        q = q + 0.005 * velocities[-1]
    velocities = np.array(velocities)
    # No joint goes one way first and then, faster, the other.
    for joint in range(7):
        most, least = velocities[:, joint].max(), velocities[:, joint].min()
        assert min(most, -least) < 0.1


def test_a_stack_may_be_replaced_before_it_has_ever_run():
    run = Run()
    run.until(CHANGE)
    for _ in range(2):
        run.controller.replace_stack(Stack.from_yaml(
            '- other: {type: position, frame: panda_link4}\n', run.robot))
        run.controller.enable('other', False)
        run.controller.enable('other', True)
    run.update()
    assert np.isfinite(run.velocities[-1]).all()
    assert run.fastest_change(CHANGE) < 20.0


# Changes that repeat

def set_damping(run, number):
    """Change a setting to and fro."""
    run.controller.settings = replace(run.controller.settings, damping=0.1 + 0.01 * (number % 2))


def set_weights(run, number):
    """Make a joint heavier and lighter."""
    run.controller.settings = replace(
        run.controller.settings, weights=(3.0 if number % 2 else 1.0, *(1.0,) * 6))


def toggle(run, number):
    """Disable and enable a task."""
    run.controller.enable('elbow', number % 2 == 1)


def alternate(run, number):
    """Replace the stack by another one and back."""
    put(run, BELOW if number % 2 else STACK)


def reaching(change, rate, settings=None, gain=2.0, seconds=6.0):
    """Return a run at 100 Hz to a goal of the tool, in which something changes all the time."""
    run = Run(settings or Settings(period=0.01), text=STACK.replace('gain: 2.0', f'gain: {gain}'),
              goals=('tool',))
    changes = 0
    for cycle in range(1, round(seconds / 0.01)):
        run.now = 0.01 * cycle
        while rate and run.now > 0.1 + changes / rate:
            changes += 1
            change(run, changes)
        run.command = run.controller.update(run.q, run.now)
        run.velocities.append(run.command.velocity)
        run.q = run.q + 0.01 * run.command.velocity
    return run


@pytest.mark.parametrize('rate', [5.0, 20.0, 50.0, 100.0])
@pytest.mark.parametrize('change', [set_damping, set_weights, toggle, alternate])
@pytest.mark.slow
def test_changes_that_repeat_do_not_keep_the_robot_from_its_goal(change, rate):
    run = reaching(change, rate)
    missed = run.goal - run.robot.state(run.q).position('panda_hand_tcp')
    assert np.linalg.norm(missed) < 1e-3
    # Velocities as smooth as they are after a single change.
    assert np.abs(np.diff(run.velocities[1:], axis=0)).max() / 0.01 < 16.0


def unchanged(robot, text, q, every, goal, blend=0.4, passive=None):
    """Return the velocities on the way to a goal; a setting without effect changes at times."""
    controller = Controller(robot, Stack.from_yaml(text, robot),
                            Settings(period=0.01, blend=blend))
    # The first update acts at once, so that nothing fades in at first.
    controller.set_goal('tool', goal, 0.0)
    velocities = [controller.update(q, 0.0, passive).velocity]
    for cycle in range(1, 200):
        if every and cycle % every == 0:
            controller.settings = replace(controller.settings,
                                          release_region=0.02 + 1e-12 * (cycle % (2 * every)))
        q = robot.integrate(q, velocities[-1], 0.01)
        velocities.append(controller.update(q, 0.01 * cycle).velocity)
    return velocities


@pytest.mark.slow
@pytest.mark.parametrize('every', [1, 5, 20])
@pytest.mark.parametrize('blend, gain', [(0.4, 2.0), (0.4, 20.0), (4.0, 2.0)])
def test_changes_that_change_nothing_leave_no_trace(blend, gain, every):
    text = f'- tool: {{type: position, frame: panda_hand_tcp, gain: {gain}}}\n'
    goal = robots.panda().state(START).position('panda_hand_tcp') + [0.02, 0.03, 0.0]
    run, still = (unchanged(robots.panda(), text, START, each, goal, blend)
                  for each in (every, 0))
    assert np.abs(still[0]).max() > 0.1
    np.testing.assert_allclose(run, still, rtol=0, atol=1e-9)


def test_where_the_robot_was_before_a_change_its_passive_joints_were_as_well():
    robot = Robot.from_file(robots.PLANAR_DH, joints=['joint1', 'joint3'])
    run, still = (unchanged(
        robot, '- tool: {type: position, frame: link3, axes: xy, gain: 2.0}\n',
        np.array([0.2, 0.9]), every, [0.6, 0.4, 0.0], passive=[0.8]) for every in (1, 0))
    assert np.abs(still[0]).max() > 0.1
    np.testing.assert_allclose(run, still, rtol=0, atol=1e-9)


def test_goal_out_of_reach_is_no_rattling_while_settings_change():
    # A robot that forgets at each of them how hard it pushes reverses in every cycle.
    run = Run(Settings(period=0.01), text='- tool: {type: position, frame: panda_hand_tcp, '
              'gain: 2.0}\n- posture: {type: posture, gain: 0.5}\n', goals=())
    run.controller.set_goal('tool', [0.5, 0.3, 1.8], 0.0)
    for cycle in range(1, 1000):
        if cycle % 50 == 0:
            set_damping(run, cycle // 50)
        run.velocities.append(run.controller.update(run.q, 0.01 * cycle).velocity)
        run.q = run.q + 0.01 * run.velocities[-1]
    assert np.abs(run.velocities[-300:]).max() < 0.05


def test_levels_that_are_rearranged_remember_what_they_pushed_against():
    run = Run(Settings(period=0.01), text='- tool: {type: position, frame: panda_hand_tcp}\n'
              '- posture: {type: posture}\n', goals=())
    run.controller.set_goal('tool', [0.5, 0.3, 1.8], 0.0)
    for cycle in range(1, 300):
        run.q = run.q + 0.01 * run.controller.update(run.q, 0.01 * cycle).velocity
    of_tool, of_posture = run.controller._memory.damping
    put(run, '- other: {type: position, frame: panda_link4, axes: z}\n'
        '- posture: {type: posture}\n- tool: {type: position, frame: panda_hand_tcp}\n')
    assert of_tool > 0.0
    tasks = run.controller._tasks
    memory = run.controller._memory.for_groups(tasks.changes.groups, tasks.stack.active)
    assert memory.damping == (0.0, of_posture, of_tool)


@pytest.mark.slow
@pytest.mark.parametrize('every', [1, 5, 50])
def test_arm_leaves_a_singularity_while_settings_change(every):
    robot = robots.planar()
    controller = Controller(robot, Stack.from_yaml(
        '- tool: {type: position, frame: link3, axes: xy, gain: 2.0}\n', robot),
        Settings(period=0.01))
    q = np.zeros(3)
    goal = robot.state(q).position('link3') - [0.6, 0.0, 0.0]
    controller.set_goal('tool', goal, 0.0)
    for cycle in range(1, 800):
        if cycle % every == 0:
            controller.settings = replace(controller.settings, damping=0.1 + 1e-3 * (cycle % 2))
        q = q + 0.01 * controller.update(q, 0.01 * cycle).velocity
    np.testing.assert_allclose(robot.state(q).position('link3'), goal, atol=1e-3)


def test_offset_that_gets_company_goes_on_fading_as_fast_as_it_did():
    from tp_controller.control.transition import Transition
    transition = Transition().begin(np.array([2.0, -1.0]), 0.0, 0.4, 0)

    def left(now):
        level, = transition.levels([], np.zeros(2), now)
        return level.v

    step, now = 1e-6, 0.15
    rate, there = (left(now) - left(now - step)) / step, left(now)
    transition = transition.begin(there + [0.5, 0.0], now, 0.4, 0)
    np.testing.assert_allclose(left(now), there + [0.5, 0.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose((left(now + step) - left(now)) / step, rate, atol=1e-3)
    # It is over as long after the second change as after any.
    np.testing.assert_allclose(left(now + 0.4 - 1e-6), 0.0, atol=1e-9)
    assert transition.levels([], np.zeros(2), now + 0.4 + 1e-9) is None


@pytest.mark.slow
def test_offset_with_a_change_in_every_cycle_follows_a_filter_of_second_order():
    from scipy.linalg import expm
    from tp_controller.control.transition import Transition
    transition, T, D, left = Transition(), 1e-4, 0.4, np.array([1.0])
    for cycle in range(4000):
        transition = transition.begin(left, T * cycle, D, 0)
        left = transition.levels([], np.zeros(1), T * (cycle + 1))[0].v
    filtered = expm(4000 * T * np.array([[0.0, 1.0], [-6.0 / D ** 2, -4.0 / D]]))[0, 0]
    assert left[0] == pytest.approx(filtered, abs=1e-3)
    for cycle in range(4000, 60000):
        transition = transition.begin(left, T * cycle, D, 0)
        levels = transition.levels([], np.zeros(1), T * (cycle + 1))
        if levels is None:
            break
        left = levels[0].v
    # In the end it has gone, although changes go on.
    assert levels is None and abs(left[0]) < 1e-6


def test_halt_while_a_change_fades_in_leaves_nothing_of_it():
    robot, settings = robots.panda(), Settings(period=0.01, blend=0.4)
    controller = Controller(robot, Stack.from_yaml(
        '- j: {type: joint_velocity, timeout: 9}\n', robot), settings)
    controller.update(START, 0.0)
    controller.set_goal('j', np.full(7, 0.2), 0.0)
    for cycle in range(1, 20):
        controller.update(START, 0.01 * cycle)
    controller.halt(0.2)
    for cycle in range(1, 30):
        share = cycle * 0.01 / 0.4
        np.testing.assert_allclose(controller.update(START, 0.2 + 0.01 * cycle).velocity,
                                   0.2 * share ** 2 * (3.0 - 2.0 * share), rtol=1e-9)


def test_robot_that_was_halted_and_moved_by_hand_starts_from_rest():
    run = Run()
    run.until(CHANGE)
    run.controller.halt(run.now)
    run.q, run.now = run.q + 0.2, run.now + 5.0
    run.update()
    assert np.abs(run.velocities[-1]).max() < 0.01


@pytest.mark.slow
def test_first_task_tracks_exactly_while_a_lower_one_changes_all_the_time():
    run = Run()
    start = run.goal
    for cycle in range(1000):
        run.goal = start + 0.1 * np.array([0.0, run.now, 0.3 * run.now])
        run.controller.set_goal('tool', run.goal, run.now)
        run.controller.enable('elbow', cycle % 2 == 0)
        run.update()
    # Its own first goal has faded in.
    assert max(run.errors[420:]) < 1e-10
    assert run.fastest_change(0.0) < 16.0

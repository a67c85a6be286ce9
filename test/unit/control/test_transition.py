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

"""Changes of the stack, of goals and settings while the robot moves."""

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
            wanted = 2.0 * (self.goal - state.position('panda_hand_tcp'))
            self.errors.append(np.linalg.norm(achieved - wanted))
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


def turn_back(run):
    """Give a task another goal."""
    run.controller.set_goal('orientation', [1.0, 0.0, 0.0, 0.0], run.now)


def weigh(run):
    """Change a setting."""
    run.controller.settings = replace(run.controller.settings,
                                      weights=(1.0, 5.0, 1.0, 1.0, 1.0, 1.0, 1.0))


CHANGES = [leave_out, swap, raise_gain, turn_back]


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
def test_first_task_does_not_feel_that_the_stack_is_replaced_while_its_goal_moves(
        change, moment, scaling):
    run = follow(change, moment, replace(CALM, scaling=scaling))
    # 2/s times what the tool lags behind is 0.1 m/s.
    assert max(run.errors[round(CHANGE / PERIOD) - 1:]) < 1e-10 * 0.1
    assert run.fastest_change(CHANGE, CHANGE + 0.05) < 5.0


@pytest.mark.parametrize('replacement', [STACK, STACK.replace('- posture: {', '- posture: {'
                                                              'tolerance: 0.5, timeout: 3.0, ')])
def test_stack_in_its_own_place_changes_nothing(replacement):
    still, replaced = (follow(change) for change in (
        lambda run: None, lambda run: put(run, replacement)))
    np.testing.assert_array_equal(still.velocities, replaced.velocities)
    assert 'blended' not in replaced.command.report.tasks[-1].reason


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
    assert tool.errors[0][0] < 1e-6 and abs(tool.wanted_speed - tool.achieved_speed) < 1e-12


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


@pytest.mark.parametrize('change', CHANGES)
def test_the_change_is_complete_after_its_time(change):
    run = Run()
    run.until(CHANGE)
    change(run)
    run.until(CHANGE + 0.45)
    fresh = Controller(run.robot, run.controller.stack, run.controller.settings)
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
    transition = Transition(0.4)
    transition.begin(np.array([2.0, 0.0]), 5.0, 0)
    # 1 − 3 s² + 2 s³ after the share s of the time.
    for share, left in ((0.0, 1.0), (0.25, 0.84375), (0.5, 0.5), (0.75, 0.15625)):
        level, = transition.levels([], np.array([0.1, 0.3]), 5.0 + 0.4 * share)
        np.testing.assert_allclose(level.v, [0.1 + 2.0 * left, 0.3], rtol=0, atol=1e-12)
    assert transition.levels([], np.zeros(2), 5.4 + 1e-9) is None


def test_bounds_of_the_new_stack_hold_while_a_change_fades_out():
    from tp_controller import Level
    from tp_controller.control.transition import Transition
    transition = Transition(0.4)
    transition.begin(np.ones(2), 0.0, 1)
    first, demand = (Level(np.eye(2)[:1], np.array([wanted])) for wanted in (0.1, 0.2))
    bound = Level(np.eye(2)[1:], upper=np.array([0.3]), lower=np.array([-0.3]))
    eased = transition.levels([first, bound, demand], np.zeros(2), 0.1)
    assert len(eased) == 3 and eased[0] is first and eased[1] is bound
    # Below a task that changes they do not, or they would change its direction meanwhile.
    below = transition.levels([first, demand, bound], np.zeros(2), 0.1)
    assert len(below) == 2 and below[0] is first and below[1].v is not None


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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Tasks follow trajectories: exactly, without jumps, and without harm to the tasks above."""

import math

import numpy as np
import pytest
import robots
from robots import PANDA_READY, PANDA_TOOL
from scipy.spatial.transform import Rotation
from tp_controller import Controller, GoalError, KinematicSimulator, Settings, Stack
from tp_controller.model.spatial import pose
from tp_controller.solver.compiled import core

PERIOD = 0.01
STACK = f"""
- elbow: {{type: position, frame: panda_link4, axes: y, gain: 3.0}}
- tool: {{type: pose, frame: {PANDA_TOOL}, gain: 3.0}}
- posture: {{type: posture, gain: 0.5}}
"""
TOOL_ONLY = f'- tool: {{type: pose, frame: {PANDA_TOOL}, gain: 2.0}}\n- rest: {{type: posture}}'
DOWN = np.array([1.0, 0.0, 0.0, 0.0])


class Run:
    """A simulated arm under a controller, and its commands."""

    def __init__(self, stack=TOOL_ONLY, **settings):
        self.robot = robots.panda()
        self.controller = Controller(self.robot, Stack.from_yaml(stack, self.robot),
                                     Settings(period=PERIOD, **settings))
        self.simulator = KinematicSimulator(self.robot, PANDA_READY)
        self.now, self.places, self.commands, self.reports = 0.0, [], [], []
        self.go(1)

    def go(self, cycles, before=lambda now: None):
        """Run some cycles; `before` is called ahead of each."""
        for _ in range(cycles):
            before(self.now)
            command = self.controller.update(self.simulator.q, self.now)
            self.simulator.command(command.velocity)
            self.simulator.step(PERIOD)
            self.now += PERIOD
            self.places.append(self.pose())
            self.commands.append(command.velocity)
            self.reports.append(command.report)

    def pose(self, frame=PANDA_TOOL):
        """Return the pose of a frame now."""
        return self.robot.state(self.simulator.q).pose(frame).copy()

    def task(self, name='tool'):
        """Return the last report of a task."""
        return next(task for task in self.reports[-1].tasks if task.name == name)


def circle(times, speed=0.2, radius=0.1):
    """Return poses on a circle that starts where the arm is (n, 7)."""
    angles = speed / radius * np.asarray(times)
    start = robots.panda().state(PANDA_READY).position(PANDA_TOOL)
    places = start + radius * np.stack(
        (np.cos(angles) - 1.0, np.sin(angles), np.zeros_like(angles)), axis=-1)
    return np.concatenate((places, np.tile(DOWN, (len(places), 1))), axis=1)


def streamed(run, path, seconds, rate, seed=0):
    """Stream chunks of 16 values, delayed at random and a fifth of them lost; return errors."""
    rng, waiting, step = np.random.default_rng(seed), [], 1.0 / rate
    sent, errors = -math.inf, []

    def before(now):
        nonlocal sent
        if now - sent >= 3.0 * step:
            sent, times = now, now + step * np.arange(16)
            if not run.places[1:] or rng.random() > 0.2:
                waiting.append((now + rng.uniform(0.0, 2.0) * step, times))
        for due in [each for each in waiting if each[0] <= now]:
            waiting.remove(due)
            run.controller.set_trajectory('tool', due[1], path(due[1]), now)

    for _ in range(round(seconds / PERIOD)):
        run.go(1, before)
        errors.append(np.linalg.norm(run.places[-1][:3, 3] - path([run.now])[0, :3]))
    return np.array(errors)


@pytest.mark.slow
@pytest.mark.parametrize('rate', [10.0, 20.0, 50.0])
def test_chunks_of_a_circle_are_followed_within_a_millimetre(rate):
    run = Run()
    errors = streamed(run, circle, 5.0, rate)
    assert errors[150:].max() < 1e-3
    assert np.abs(np.diff(run.commands[150:], axis=0)).max() < 3.0 * PERIOD


def test_velocity_of_the_middle_of_a_cycle_removes_the_lag():
    # With that of its beginning the tool would be period a / (2 K) behind, here 1 mm.
    run = Run()
    times = run.now + 0.02 * np.arange(200)
    run.controller.set_trajectory('tool', times, circle(times), run.now)
    run.go(300)
    errors = [np.linalg.norm(place[:3, 3] - circle([PERIOD * (i + 1)])[0, :3])
              for i, place in enumerate(run.places)]
    assert max(errors[200:300]) < 4e-4


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
def test_cycles_that_follow_stay_in_the_core_with_the_twin_that_there_is():
    run = Run()
    times = run.now + np.linspace(0.1, 2.0, 30)
    run.controller.set_trajectory('tool', times, circle(times), run.now)
    run.go(2)
    task = run.controller.stack.tasks['tool']
    before, goal = task.twin, task.goal.copy()
    run.go(20)
    assert task.twin is before and not np.array_equal(task.goal, goal)


def test_trajectory_turns_the_tool_as_well():
    run = Run()
    start = run.pose()
    turn = Rotation.from_rotvec([0.3, 0.2, 1.0])
    end = pose(turn.as_matrix() @ start[:3, :3], start[:3, 3] + [0.05, 0.1, 0.0])
    run.controller.set_trajectory('tool', [run.now + 2.0], [end], run.now)
    run.go(230)
    np.testing.assert_allclose(run.pose(), end, atol=1e-3)
    middle = Rotation.from_matrix(run.places[100][:3, :3] @ start[:3, :3].T)
    assert middle.magnitude() == pytest.approx(0.5 * turn.magnitude(), abs=0.02)


def test_centre_of_mass_follows_points_from_the_speed_that_it_has():
    robot = robots.named('ur5')
    controller = Controller(robot, Stack.from_yaml(
        '- balance: {type: center_of_mass, axes: xz, gain: 2.0}\n- rest: {type: posture}', robot),
        Settings(period=PERIOD, blend=0.0))
    simulator = KinematicSimulator(robot, [0.3, -1.2, 1.4, -0.6, 0.8, 0.1])
    centers, velocities, errors = [], [], []

    def go(cycles, begin):
        for cycle in range(begin, begin + cycles):
            command = controller.update(simulator.q, PERIOD * cycle)
            simulator.command(command.velocity)
            simulator.step(PERIOD)
            centers.append(robot.state(simulator.q).center_of_mass()[0].copy())
            velocities.append(command.velocity)
            errors.append(command.report.tasks[0].errors[0][0])

    go(1, 0)
    controller.set_goal('balance', centers[0] + (0.05, 0.0, 0.02), 0.0)
    go(30, 1)
    times = np.linspace(0.8, 3.0, 23)
    path = centers[0] + np.stack((0.05 * np.sin(2.0 * times), 0.0 * times,
                                  0.03 * np.cos(2.0 * times)), axis=-1)
    controller.set_trajectory('balance', times, path, 0.31)
    go(300, 31)
    np.testing.assert_allclose(centers[199][[0, 2]], [
        np.interp(2.0, times, path[:, axis]) for axis in (0, 2)], atol=1e-3)
    np.testing.assert_allclose(centers[-1][[0, 2]], path[-1, [0, 2]], atol=1e-3)
    assert max(errors[90:290]) < 1e-3
    before = np.linalg.norm(velocities[30])
    assert before > 0.1
    np.testing.assert_allclose(velocities[31], velocities[30], atol=0.1 * before)


def test_workspace_limits_the_places_of_frames_only():
    robot = robots.named('ur5')
    controller = Controller(robot, Stack.from_yaml(
        '- balance: {type: center_of_mass}', robot), Settings(
            period=PERIOD, workspace=(-0.01, 0.01, -0.01, 0.01, 0.0, 0.01)))
    q = [0.3, -1.2, 1.4, -0.6, 0.8, 0.1]
    controller.update(q, 0.0)
    center = robot.state(q).center_of_mass()[0]
    controller.set_trajectory('balance', [0.5], [center + (0.01, 0.0, 0.0)], 0.0)


def test_posture_follows_joint_positions_by_name():
    run = Run('- posture: {type: posture, gain: 1.0}')
    path = [{'panda_joint1': 0.3 * math.sin(time), 'panda_joint4': -2.356 + 0.1 * time}
            for time in 0.05 * np.arange(60)]
    run.controller.set_trajectory('posture', run.now + 0.05 * np.arange(60), path, run.now)
    run.go(200)
    q = run.simulator.q
    assert q[0] == pytest.approx(0.3 * math.sin(run.now - PERIOD), abs=1e-3)
    assert q[3] == pytest.approx(-2.356 + 0.1 * (run.now - PERIOD), abs=1e-3)
    np.testing.assert_allclose(q[[1, 2, 4, 5, 6]], np.array(PANDA_READY)[[1, 2, 4, 5, 6]],
                               atol=1e-6)


def test_task_above_is_not_disturbed_and_the_one_below_has_the_rest():
    exact = {'damping': 0.0, 'release_region': 0.0, 'regularisation': 0.0}
    run = Run(STACK, **exact)
    elbow = run.robot.state(run.simulator.q).position('panda_link4')[1]
    streamed(run, circle, 2.0, 20.0)
    state = run.robot.state(run.simulator.q)
    assert state.position('panda_link4')[1] == pytest.approx(elbow, abs=1e-4)
    # The velocity of the level above is the same as if it were alone.
    alone = Controller(run.robot, Stack.from_yaml(STACK.split('\n- tool')[0], run.robot),
                       run.controller.settings)
    J = state.jacobian('panda_link4')[1]
    alone.set_goal('elbow', run.controller.stack.tasks['elbow'].goal, run.now)
    wanted = J @ alone.update(run.simulator.q, run.now).velocity
    assert J @ run.controller.update(run.simulator.q, run.now).velocity == pytest.approx(
        wanted, abs=1e-9)


def test_trajectory_is_the_goal_and_its_velocity_to_all_tasks():
    run = Run(STACK, blend=0.0)
    twin = Controller(run.robot, Stack.from_yaml(STACK, run.robot),
                      run.controller.settings)
    times = run.now + 0.05 * np.arange(100)
    run.controller.set_trajectory('tool', times, circle(times), run.now)
    tool = run.controller.stack.tasks['tool']
    twin.update(run.simulator.q, 0.0)
    for _ in range(100):
        q, now = run.simulator.q.copy(), run.now
        run.go(1)
        twin.set_goal('tool', tool.goal, now)
        twin.set_feed_forward('tool', tool.feed_forward(now), now)
        np.testing.assert_allclose(run.commands[-1], twin.update(q, now).velocity, atol=1e-9)


def test_motion_starts_from_the_speed_of_the_task():
    run = Run(blend=0.0)
    run.controller.set_goal('tool', circle([1.5])[0], run.now)
    run.go(30)
    before = run.commands[-1]
    run.controller.set_trajectory('tool', [run.now + 2.0], circle([1.0]), run.now)
    run.go(1)
    assert np.linalg.norm(before) > 0.1
    np.testing.assert_allclose(run.commands[-1], before, atol=0.1 * np.linalg.norm(before))


@pytest.mark.parametrize('speed, peak', [(0.1, 0.1), ({'m': 0.2, 'rad': 0.05}, 0.2)])
def test_speed_makes_a_goal_a_straight_line(speed, peak):
    run = Run()
    start, goal = run.pose(), circle([1.0])[0]
    run.controller.set_goal('tool', goal, run.now, speed=speed)
    run.go(700)
    places = np.array([place[:3, 3] for place in run.places])
    way = goal[:3] - start[:3, 3]
    across = np.cross(places - start[:3, 3], way / np.linalg.norm(way))
    assert np.abs(across).max() < 1e-3
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() / PERIOD == pytest.approx(
        peak, rel=0.02)
    np.testing.assert_allclose(places[-1], goal[:3], atol=1e-4)


def test_number_for_a_pose_limits_its_turn_to_that_of_a_point_a_quarter_of_a_metre_off():
    run = Run()
    end = run.pose()
    end[:3, :3] = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix() @ end[:3, :3]
    run.controller.set_goal('tool', end, run.now, speed=0.1)
    run.go(500)
    turns = [Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).magnitude()
             for before, after in zip(run.places, run.places[1:])]
    assert max(turns) / PERIOD == pytest.approx(0.1 / 0.25, rel=0.03)
    np.testing.assert_allclose(run.pose(), end, atol=1e-3)


def test_duration_of_a_goal_is_its_time():
    run = Run()
    run.controller.set_goal('tool', circle([1.0])[0], run.now, duration=1.5)
    run.go(149)
    assert not run.task().reached
    run.go(10)
    np.testing.assert_allclose(run.pose()[:3, 3], circle([1.0])[0, :3], atol=1e-3)


def test_way_at_a_speed_leads_through_all_values():
    run = Run()
    values = circle([0.5, 1.0, 1.5])
    run.controller.set_trajectory('tool', None, values, run.now, speed=0.1)
    run.go(600)
    places = np.array([place[:3, 3] for place in run.places])
    for value in values:
        assert np.linalg.norm(places - value[:3], axis=1).min() < 1.5e-3
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() / PERIOD == pytest.approx(
        0.1, rel=0.02)


def test_values_in_another_frame_are_those_of_goals():
    run = Run()
    run.controller.set_trajectory('tool', [run.now + 1.0], [[0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0]],
                                  run.now, frame=PANDA_TOOL)
    start = run.pose()
    run.go(150)
    np.testing.assert_allclose(run.pose()[:3, 3], start[:3, 3] - [0.0, 0.0, 0.05], atol=1e-3)


def test_report_says_how_far_a_trajectory_is():
    run = Run()
    run.controller.set_trajectory('tool', [run.now + 1.0], circle([0.3]), run.now)
    run.go(51)
    assert run.task().progress == pytest.approx(0.5)
    assert not run.task().reached
    assert run.task('rest').progress is None
    run.go(80)
    assert run.task().progress is None
    assert run.task().status == 'reached'


def moving_run(seconds=4.0, stack=TOOL_ONLY):
    """Return a run that follows a trajectory."""
    run = Run(stack)
    times = run.now + 0.05 * np.arange(round(seconds / 0.05))
    run.controller.set_trajectory('tool', times, circle(times), run.now)
    run.go(100)
    return run


def test_cancelled_trajectory_comes_to_rest():
    run = moving_run()
    assert run.controller.cancel_trajectory('tool', run.now)
    run.go(60)
    assert np.linalg.norm(run.places[-1][:3, 3] - run.places[-2][:3, 3]) < 1e-3 * PERIOD
    assert np.linalg.norm(run.places[-1][:3, 3] - run.places[99][:3, 3]) < 0.05
    assert np.abs(np.diff(run.commands[98:], axis=0)).max() < 0.1
    assert not run.controller.cancel_trajectory('tool', run.now)


@pytest.mark.parametrize('stop', ['halt', 'slow_down', 'disable', 'goal', 'forget'])
def test_whatever_ends_the_cycles_of_a_task_ends_its_trajectory(stop):
    run = moving_run()
    controller, now = run.controller, run.now
    {'halt': lambda: controller.halt(now),
     'slow_down': lambda: controller.slow_down(run.simulator.q, now, 1.0),
     'disable': lambda: (controller.enable('tool', False), controller.enable('tool', True)),
     'goal': lambda: controller.set_goal('tool', circle([now])[0], now),
     'forget': controller.forget_goals}[stop]()
    # Its velocity, too, which a task would otherwise go on with until its timeout.
    assert controller.stack.tasks['tool'].feed_forward(now) is None
    run.now += 1.0
    run.go(200)
    assert np.abs(run.commands[-1]).max() < 2e-2
    assert np.linalg.norm(run.places[-1][:3, 3] - run.places[99][:3, 3]) < 0.1
    assert run.task().progress is None


def test_stack_that_is_replaced_goes_on_with_the_trajectory_of_a_common_task():
    run = moving_run()
    run.controller.replace_stack(Stack.from_yaml(
        TOOL_ONLY.replace('gain: 2.0', 'gain: 3.0'), run.robot))
    run.go(150)
    assert run.task().progress is not None
    np.testing.assert_allclose(run.pose()[:3, 3], circle([run.now])[0, :3], atol=1e-3)
    other = TOOL_ONLY.replace('pose,', 'position,')
    run.controller.replace_stack(Stack.from_yaml(other, run.robot))
    run.go(1)
    assert run.task().progress is None


def test_feed_forward_is_refused_while_a_trajectory_runs():
    run = moving_run()
    with pytest.raises(GoalError, match='follows a trajectory, with its velocity: cancel it'):
        run.controller.set_feed_forward('tool', np.zeros(6), run.now)
    run.go(400)
    run.controller.set_feed_forward('tool', np.zeros(6), run.now)


@pytest.mark.parametrize('arguments, message', [
    (('tool', [], []), 'empty; to end one that runs, cancel it'),
    (('tool', [1.0], []), 'empty'),
    (('tool', [1.0], 3.0), 'needs a sequence of goals, got float'),
    (('tool', [1.0, 2.0], circle([1.0])), 'a time for each of its 1 values'),
    (('tool', ['a'], circle([1.0])), 'times must be numbers'),
    (('tool', [math.nan], circle([1.0])), 'times must be finite'),
    (('tool', [2.0, 2.0], circle([1.0, 2.0])),
     'must increase, but value 2 of 2 is at the same time as value 1'),
    # Times since the start of the computer.
    (('tool', [1e6, 1e6 - 0.5], circle([1.0, 2.0])), 'value 2 of 2 is 0.5 s before value 1'),
    (('tool', [2.0, 3.0], [circle([1.0])[0], [1.0]]), 'value 2 of 2: the goal of task'),
    (('tool', [0.001], circle([1.0])), 'ended 0.009 s ago'),
    (('tool', None, circle([1.0])), 'needs times or a speed'),
    (('hand', [1.0], circle([1.0])), 'hand'),
    (('bound', [1.0], circle([1.0])), 'follows no trajectory: it needs'),
    (('off', [1.0], circle([1.0])[:, :3]), 'is disabled'),
    (('tool', [1.0], circle([1.0]), None), 'now'),
    (('tool', [1.0], circle([1.0]), 0.01, 'nowhere'), 'nowhere'),
])
def test_faulty_trajectories_are_refused_with_the_reason(arguments, message):
    run = Run(TOOL_ONLY + f'\n- bound: {{type: joint_limits}}\n'
              f'- off: {{type: position, frame: {PANDA_TOOL}}}')
    run.controller.enable('off', False)
    if len(arguments) == 3:
        arguments = (*arguments, run.now)
    with pytest.raises(GoalError, match=message):
        run.controller.set_trajectory(*arguments)
    assert run.task().progress is None


@pytest.mark.parametrize('speed, message', [
    (0.0, 'more than 0 m/s'), ('fast', 'more than 0 m/s'), ({'m': 0.1}, 'for rad, too'),
    ({'kg': 0.1}, 'kg'), ({'m': math.inf, 'rad': 1.0}, 'not inf')])
def test_faulty_speeds_are_refused(speed, message):
    run = Run()
    with pytest.raises(GoalError, match=message):
        run.controller.set_goal('tool', circle([1.0])[0], run.now, speed=speed)


def test_goal_has_a_speed_or_a_duration_or_a_posture():
    run = Run()
    for keys in ({'speed': 1.0, 'duration': 1.0}, {'speed': 1.0, 'posture': PANDA_READY}):
        with pytest.raises(GoalError, match='one of them only'):
            run.controller.set_goal('tool', circle([1.0])[0], run.now, **keys)
    with pytest.raises(GoalError, match='more than 0 s'):
        run.controller.set_goal('tool', circle([1.0])[0], run.now, duration=-1.0)


def test_trajectory_needs_cycles_that_run():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(TOOL_ONLY, robot))
    with pytest.raises(GoalError, match='the robot is stopped'):
        controller.set_trajectory('tool', [1.0], circle([1.0]), 0.0)
    controller.update(PANDA_READY, 0.0)
    controller.halt(0.01)
    with pytest.raises(GoalError, match='the robot is stopped'):
        controller.set_trajectory('tool', [1.0], circle([1.0]), 0.02)


@pytest.mark.parametrize('limits, message', [
    ({'workspace': (-1.0, 1.0, -0.05, 0.05, -1.0, 1.0)}, 'outside the workspace: y'),
    ({'largest_jump': 0.05}, 'value 2 is 0.1.* m from the one before, more than largest_jump'),
    ({'largest_turn': 0.5}, 'value 2 is 1 rad from the one before, more than largest_turn')])
def test_trajectory_keeps_the_limits_of_goals(limits, message):
    run = Run(**limits)
    times = run.now + np.array([0.5, 1.0, 1.5])
    poses = circle([0.0, 0.8, 1.6])
    turn = Rotation.from_rotvec([0.0, 0.0, 1.0]) * Rotation.from_quat(DOWN)
    poses[1:, 3:] = turn.as_quat()
    with pytest.raises(GoalError, match=message):
        run.controller.set_trajectory('tool', times, poses, run.now)
    run.controller.set_trajectory('tool', times, circle([0.0, 0.1, 0.2]), run.now)


def test_curve_between_its_values_keeps_the_workspace_too():
    # Both values are inside, and the curve swings beyond the second one.
    run = Run(workspace=(-1.0, 1.0, -1.0, 0.1, -1.0, 1.0))
    poses = circle([0.0, 0.0, 0.0, 0.0])
    poses[1:, 1] = (0.05, 0.0999, 0.0999)
    with pytest.raises(GoalError, match='outside the workspace: y'):
        run.controller.set_trajectory('tool', run.now + np.array([0.3, 0.4, 0.5, 1.5]), poses,
                                      run.now)


def test_clock_that_is_set_back_or_leaps_is_survived():
    run = moving_run()
    for shift in (-0.5, -50.0, 100.0):
        run.now += shift
        run.go(3)
        assert np.isfinite(run.commands[-1]).all()
    assert run.task().progress is None

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Functions that tasks maximize: their gradients, and how tasks follow them."""

import inspect
import math

import numpy as np
import pytest
import robots
from tp_controller import Controller, GoalError, Robot, Settings, Stack, TaskError
from tp_controller.model.spatial import pose, rotation_from_vector
from tp_controller.tasks import GradientTask, Keys, task_types
from tp_controller.tasks.joint_limit_distance import MAX_CURVED

TOOL = robots.PANDA_TOOL
START = (0.3, -0.9, 0.6, -2.2, 0.5, 1.9, 0.2)
# More cases than the example of a type: keys.
CASES = {
    'manipulability': [{'frame': TOOL}, {'frame': TOOL, 'axes': 'xyz', 'gain': 3.0},
                       {'frame': 'panda_link5', 'axes': ['rz', 'x']}],
    'joint_limit_distance': [{}, {'gain': 0.1, 'max_speed': 0.2}],
}
KINDS = {name: kind for name, kind in task_types().items() if issubclass(kind, GradientTask)}
CONTRACT = [pytest.param(name, dict(kind.example), id=f'{name}-example')
            for name, kind in KINDS.items()]
CONTRACT += [pytest.param(name, keys, id=f'{name}-{index}')
             for name, cases in CASES.items() for index, keys in enumerate(cases)]


def make(name, keys, robot=None):
    """Return a task of a type."""
    return KINDS[name](robot or robots.robot_for(KINDS[name]), 'task', **keys)


def inside(robot, rng, margin=0.1):
    """Return random positions (n,), some way within the limits."""
    lower, upper = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
    return rng.uniform(lower + margin, upper - margin)


def slope(function, robot, q, h=1e-6):
    """Return the gradient (n,) of a function of a state, by differences."""
    def at(step, axis):
        return function(robot.state(robot.integrate(q, axis, step)))
    return np.array([(at(h, axis) - at(-h, axis)) / (2 * h) for axis in np.eye(robot.n)])


@pytest.mark.parametrize('name, keys', CONTRACT)
def test_gradient_is_the_derivative_of_the_function(name, keys):
    task, rng = make(name, keys), np.random.default_rng(0)
    for _ in range(5):
        q = inside(task.robot, rng)
        value, gradient = task.measure(task.robot.state(q))
        numeric = slope(lambda state: task.measure(state)[0], task.robot, q)
        np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-6)
        assert task.value(task.robot.state(q)) == [value]


@pytest.mark.parametrize('name, keys', CONTRACT)
def test_demand_is_the_gradient_times_the_gain_up_to_the_top_speed(name, keys):
    task, rng = make(name, keys), np.random.default_rng(1)
    for _ in range(5):
        state = task.robot.state(inside(task.robot, rng))
        demand = keys.get('gain', 1.0) * task.measure(state)[1] / task.slowdown(state)
        level = task.level(state, 0.0)
        assert level.is_identity
        speed = min(np.linalg.norm(demand), keys.get('max_speed', 0.5))
        np.testing.assert_allclose(level.v, speed * demand / np.linalg.norm(demand))
    slow, gradient = make(name, {**keys, 'gain': 1e-6}), task.measure(state)[1]
    np.testing.assert_allclose(slow.level(state, 0.0).v, 1e-6 * gradient, rtol=1e-4)


@pytest.mark.parametrize('half', [2.0, 0.3, 0.01])
@pytest.mark.parametrize('place', [0.01, 0.5, 0.9])
def test_joint_nears_the_middle_at_a_bounded_rate_however_short_its_range(half, place):
    robot = Robot.from_dh([{'name': 'joint', 'a': 0.5, 'lower': -half, 'upper': half}])
    speeds = [make('joint_limit_distance', {'gain': gain, 'max_speed': 100.0}, robot).level(
        robot.state(np.array([place * half])), 0.0).v[0] for gain in (1e-3, 1.0, 1e3, 1e6)]
    # A higher gain is faster, never beyond 10/s.
    assert (np.diff(speeds) < 0.0).all()
    assert -10.0 * place * half < speeds[-1] < speeds[0] < 0.0
    if place < MAX_CURVED:
        assert speeds[-1] == pytest.approx(-10.0 * place * half, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize('keys', [
    'type: manipulability, frame: panda_hand_tcp', 'type: joint_limit_distance, gain: 0.3'])
def test_function_grows_in_the_null_space_of_the_task_above_without_disturbing_it(keys):
    robot = robots.panda()
    stack = Stack.from_yaml(f"""
- tool: {{type: pose, frame: {TOOL}, gain: 5.0}}
- objective: {{{keys}}}
""", robot)
    controller, q = Controller(robot, stack, Settings(period=0.01)), np.array(START)
    start = robot.state(q)
    task, values = stack.tasks['objective'], []
    for cycle in range(3000):
        command = controller.update(q, 0.01 * cycle)
        q = q + 0.01 * command.velocity
        values.append(task.value(robot.state(q))[0])
    assert (np.diff(values) > -1e-9).all() and values[-1] > values[0] + 0.05
    np.testing.assert_allclose(robot.state(q).pose(TOOL), start.pose(TOOL), atol=1e-4)
    # At the top what is left of the gradient is what the tool needs.
    assert command.report.tasks[1].status == 'reached'
    J = robot.state(q).jacobian(TOOL)
    gradient = task.measure(robot.state(q))[1]
    left = gradient - np.linalg.pinv(J) @ J @ gradient
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(gradient)


def test_gradient_of_weighted_entries_of_a_jacobian_is_their_derivative():
    """Also where joints mimic others, and in trees whose branches do not belong to the frame."""
    rng = np.random.default_rng(2)
    for name, frame in (('panda', 'panda_rightfinger'), ('tiago', 'arm_4_link'),
                        ('baxter', 'left_gripper')):
        robot = robots.urdf_robot(name)
        q, weights = 0.3 * rng.normal(size=robot.n), rng.normal(size=(6, robot.n))
        numeric = slope(lambda state: (weights * state.jacobian(frame)).sum(), robot, q)
        found = robot.state(q).jacobian_gradient(frame, weights)
        np.testing.assert_allclose(found, numeric, atol=1e-7)
        assert np.abs(numeric).max() > 0.1


@pytest.mark.parametrize('base', ['planar', 'differential', 'underwater', 'floating'])
def test_gradient_of_weighted_entries_of_a_jacobian_counts_with_the_turns_of_a_base(base):
    rng = np.random.default_rng(4)
    robot = robots.moving_panda(base)
    turn = [0.0, 0.0, 0.7] if base != 'floating' else [0.3, -0.5, 0.7]
    q = robot.configuration(inside(robots.panda(), rng),
                            pose(rotation_from_vector(turn), [0.3, -0.2, 0.1]))
    weights = rng.normal(size=(6, robot.n))
    numeric = slope(lambda state: (weights * state.jacobian(TOOL)).sum(), robot, q)
    np.testing.assert_allclose(robot.state(q).jacobian_gradient(TOOL, weights), numeric, atol=1e-7)
    assert np.abs(numeric[robot.velocity_names.index('base_yaw')]) > 0.1


def test_measure_is_the_product_of_the_singular_values():
    state = robots.panda().state(robots.PANDA_READY)
    for axes, rows in ((None, slice(0, 6)), ('xyz', slice(0, 3)), (['y', 'rx'], [1, 3])):
        task = make('manipulability', {'frame': TOOL, 'axes': axes})
        J = state.jacobian(TOOL)[rows]
        assert math.exp(task.value(state)[0]) == pytest.approx(
            math.sqrt(np.linalg.det(J @ J.T)))


def test_stretched_arm_on_a_singularity_gets_a_finite_velocity():
    robot = robots.panda()
    task = make('manipulability', {'frame': 'panda_link7'})
    level = task.level(robot.state(np.zeros(7)), 0.0)
    assert np.isfinite(level.v).all() and np.linalg.norm(level.v) <= 0.5 + 1e-12


def test_distance_from_limits_is_the_measure_of_the_source_in_the_middle_of_the_ranges():
    robot, task = robots.panda(), make('joint_limit_distance', {})
    rng = np.random.default_rng(3)
    middle, half = 0.5 * (robot.lower + robot.upper), 0.5 * (robot.upper - robot.lower)
    q = middle + rng.uniform(-0.79, 0.79, 7) * half
    source = (robot.upper - robot.lower) ** 2 / (4 * (robot.upper - q) * (q - robot.lower))
    assert task.value(robot.state(q))[0] == pytest.approx(-source.sum())
    assert task.measure(robot.state(middle))[1] == pytest.approx(np.zeros(7))


def test_joints_without_limits_stay_out_of_the_distance_from_limits():
    robot = robots.mixed()
    task = make('joint_limit_distance', {}, robot)
    gradient = task.measure(robot.state([2.0, 0.5, 1.0, 1.0]))[1]
    assert (gradient[:2] < 0.0).all() and (gradient[2:] == 0.0).all()
    free = Robot.from_dh([{'name': 'spin', 'a': 1.0, 'type': 'continuous', 'velocity': 1.0}])
    with pytest.raises(TaskError, match='no joint of the robot has position limits'):
        make('joint_limit_distance', {}, free)


def test_task_that_maximizes_a_function_takes_no_goal_and_says_so():
    task = make('joint_limit_distance', {})
    with pytest.raises(GoalError, match="task 'task' takes no goal: it maximizes an objective"):
        task.parse_goal([0.0])


def test_faults_of_keys_are_named():
    for name, keys, fault in (
            ('manipulability', {'frame': 'tool'}, 'frame: unknown frame'),
            ('manipulability', {'frame': TOOL, 'axes': 'w'}, 'axes: needs some of x'),
            ('joint_limit_distance', {'max_speed': 0.0}, 'max_speed: must be positive'),
            ('joint_limit_distance', {'gain': -1.0}, 'gain: must be positive')):
        with pytest.raises(TaskError, match=fault):
            make(name, keys)
    with pytest.raises(TaskError, match='axes: 3 joints cannot move along 6 axes'):
        make('manipulability', {'frame': 'link3'}, robots.planar())
    with pytest.raises(TaskError, match='frame: unknown.*max_speed: must be'):
        make('manipulability', {'frame': 'tool', 'max_speed': -1.0})


class Reach(GradientTask):
    """Maximize the height of a frame: a task type of another package."""

    type_name = None

    def __init__(self, robot, name, *, frame, **options):
        keys = Keys()
        self.frame = keys.check('frame', robot.check_frame, frame)
        super().__init__(robot, name, keys, **options)
        keys.raise_faults(name)

    def measure(self, state):
        """Return the height of the frame and its gradient."""
        return state.position(self.frame)[2], state.jacobian(self.frame)[2]


def test_function_of_another_package_is_maximized():
    robot = robots.panda()
    task = Reach(robot, 'up', frame=TOOL, gain=2.0)
    controller, q = Controller(robot, Stack([[task]])), np.array(robots.PANDA_READY)
    start = robot.state(q).position(TOOL)[2]
    for cycle in range(300):
        q = q + 0.01 * controller.update(q, 0.01 * cycle).velocity
    assert robot.state(q).position(TOOL)[2] > start + 0.3


@pytest.mark.parametrize('name', KINDS)
def test_every_type_says_what_it_is_and_takes_no_goal(name):
    task_type = KINDS[name]
    assert task_type.type_name == name and inspect.getdoc(task_type)
    assert task_type.goal_type is None and task_type.feed_forward_type is None

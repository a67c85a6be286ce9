# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Exercises 1 and 2 of *lab* (docs/sources.md): the demos beside a plain program and geometry.

The plain program below is the listing of *lab* without its errors: rows 0 and 1 of the Jacobian
are the linear velocities, and the scaling takes absolute values in both orders.
"""

import math
import os
import subprocess
import sys

import numpy as np
from PIL import Image
import pytest
from robots import REPOSITORY
from tp_controller.tasks.sketch import Dot
from tp_controller.tools.cli.main import main
from tp_controller.tools.demos import lab
from tp_controller.tools.demos.motion import Playback

LENGTHS = np.array([0.75, 0.5, 0.5])
DT = 1.0 / 60.0
ORDERS = ('end-effector first', 'joint 1 first')


def kinematics(q):
    """Return position (2,) and Jacobian (2, 3) of the planar arm's end-effector."""
    angles = np.cumsum(q)
    position = np.array([LENGTHS @ np.cos(angles), LENGTHS @ np.sin(angles)])
    J = np.array([[-LENGTHS[i:] @ np.sin(angles[i:]) for i in range(3)],
                  [LENGTHS[i:] @ np.cos(angles[i:]) for i in range(3)]])
    return position, J


def damped(J):
    """Return DLS(J, 0.1), the damped inverse of *lab*, exercise 2."""
    return J.T @ np.linalg.inv(J @ J.T + 0.1 ** 2 * np.eye(len(J)))


def plain_exercise1(steps, dt=DT, inverse=np.linalg.pinv):
    """Return the positions (steps + 1, 3) of exercise 1."""
    q = [np.array([0.0, 0.6, 0.3])]
    goal = kinematics(q[0])[0]
    for k in range(steps):
        position, J = kinematics(q[-1])
        y = np.array([math.sin(k * dt), math.cos(k * dt), math.sin(k * dt)])
        P = np.eye(3) - np.linalg.pinv(J) @ J
        q.append(q[-1] + dt * (inverse(J) @ (goal - position) + P @ y))
    return np.array(q)


def plain_exercise2(order, goals, steps_per_goal):
    """Return the positions (steps + 1, 3) of exercise 2."""
    q = [np.array([0.0, 0.6, 0.3])]
    for k in range(steps_per_goal * len(goals)):
        position, J = kinematics(q[-1])
        tasks = [(J, goals[k // steps_per_goal] - position),
                 (np.array([[1.0, 0.0, 0.0]]), -q[-1][:1])]
        (J1, error1), (J2, error2) = tasks if order == 'end-effector first' else tasks[::-1]
        P = np.eye(3) - np.linalg.pinv(J1) @ J1
        velocity = damped(J1) @ error1
        velocity = velocity + damped(J2 @ P) @ (error2 - J2 @ velocity)
        q.append(q[-1] + DT * velocity / max(1.0, np.abs(velocity).max()))
    return np.array(q)


def tool_errors(q, goal):
    """Return the distances of the end-effector from a goal, for positions (T, 3)."""
    return np.array([np.linalg.norm(kinematics(row)[0] - goal) for row in q])


@pytest.fixture(scope='module')
def null_space_motion():
    """Return the recording of exercise 1."""
    return lab.null_space_motion()


@pytest.fixture(scope='module')
def outcomes(tmp_path_factory):
    """Return both experiments as the command line runs them, and {film: its motion}."""
    folder, motions = tmp_path_factory.mktemp('lab'), {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab, 'films', lambda path, motion: motions.update({path.name: motion}) or ())
        return {'lab1': lab.lab1(folder / 'lab1'), 'lab2': lab.lab2(folder / 'lab2'),
                'films': motions}


def test_the_plain_program_gives_the_reference_numbers():
    q = plain_exercise1(600)
    goal = kinematics(q[0])[0]
    assert tool_errors(q, goal).max() == pytest.approx(1.733e-3, abs=1e-6)
    assert q[-1] == pytest.approx([0.74633, -0.21186, -0.71626], abs=1e-5)
    assert tool_errors(plain_exercise1(600, inverse=damped), goal).max() == \
        pytest.approx(1.885e-3, abs=1e-6)


def test_null_space_motion_is_the_plain_programs_at_every_step(null_space_motion):
    np.testing.assert_allclose(null_space_motion.q, plain_exercise1(600), atol=1e-9)


def test_null_space_motion_has_the_reference_numbers(null_space_motion):
    errors = null_space_motion.errors['end_effector']
    assert errors.max() == pytest.approx(1.733e-3, abs=1e-6)
    assert null_space_motion.q[-1] == pytest.approx([0.74633, -0.21186, -0.71626], abs=1e-5)
    assert null_space_motion.times[-1] == pytest.approx(10.0)
    # The arm does move meanwhile, and no limit changed what it does.
    assert np.ptp(null_space_motion.q, axis=0).min() > 0.5
    assert null_space_motion.top_speed < 1.0


@pytest.mark.parametrize('order', ORDERS)
def test_two_tasks_are_the_plain_programs_at_every_step(order):
    goals = np.random.default_rng(4).uniform(-1.0, 1.0, (3, 2))
    motion = lab.two_tasks(order, goals, goal_time=3.0)
    plain = plain_exercise2(order, goals, 180)
    np.testing.assert_allclose(motion.q, plain, atol=1e-9)
    # The limit was met, and by joints that move either way.
    assert motion.velocities.max() == 1.0
    assert motion.velocities.min() == -1.0
    errors = [np.linalg.norm(kinematics(row)[0] - goals[min(k // 180, 2)])
              for k, row in enumerate(plain)]
    np.testing.assert_allclose(motion.errors['end_effector'], errors, atol=1e-9)
    np.testing.assert_allclose(motion.errors['joint1'], np.abs(plain[:, 0]), atol=1e-9)


@pytest.mark.parametrize('order, error, joint1, q', [
    (ORDERS[0], 0.00006, 0.30266, (0.3027, 1.4857, 0.0)),
    (ORDERS[1], 0.22577, 0.0, (0.0, 1.7762, 0.0)),
])
def test_the_lower_of_two_conflicting_tasks_gives_way(order, error, joint1, q):
    motion = lab.two_tasks(order, [(0.5, 1.2)])
    assert motion.errors['end_effector'][-1] == pytest.approx(error, abs=5e-6)
    assert motion.errors['joint1'][-1] == pytest.approx(joint1, abs=5e-6)
    assert motion.q[-1] == pytest.approx(q, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize('order', ORDERS)
def test_compatible_tasks_are_both_met_in_either_order(order):
    motion = lab.two_tasks(order, [(0.75, 0.9)])
    assert motion.errors['end_effector'][-1] < 1e-4
    assert motion.errors['joint1'][-1] < 1e-4
    assert motion.q[-1] == pytest.approx([0.0, 1.1198, 0.9021], abs=5e-4)


@pytest.mark.parametrize('goal', [(0.5, 1.2), (0.75, 0.9), (-0.712, 0.897), (-0.4, -0.15),
                                  (0.1, -0.95), (1.0, 1.0)])
def test_the_best_that_is_possible_is_what_a_search_finds(goal):
    q1 = np.linspace(-math.pi, math.pi, 200001)
    # Joints 2 and 3 reach every point within 1 m of joint 2.
    beyond = np.hypot(goal[0] - 0.75 * np.cos(q1), goal[1] - 0.75 * np.sin(q1)) - 1.0
    assert lab.best_error(goal) == pytest.approx(max(beyond[100000], 0.0), abs=1e-9)
    assert lab.best_joint1(goal) == pytest.approx(np.abs(q1[beyond <= 1e-12]).min(), abs=1e-4)


def test_the_best_in_conflict_is_that_of_the_cosine_law():
    assert lab.best_joint1((0.5, 1.2)) == pytest.approx(0.3027, abs=5e-5)
    assert lab.best_error((0.5, 1.2)) == pytest.approx(0.2258, abs=5e-5)


@pytest.mark.parametrize('name', ['lab1', 'lab2'])
@pytest.mark.slow
def test_both_experiments_come_out(outcomes, name):
    assert outcomes[name].passed, str(outcomes[name])
    assert 'WRONG' not in str(outcomes[name])


@pytest.mark.slow
def test_random_goals_are_met_by_the_task_that_is_first(outcomes):
    table = str(outcomes['lab2']).split('Random goals')[-1].splitlines()
    rows = [[float(cell) for cell in line.split(')')[1].split()]
            for line in table if line.startswith('(')]
    assert len(rows) == 6
    for error_first, _, error_second, joint1_first, possible in rows:
        assert error_first < 1.0
        assert joint1_first == 0.0
        assert error_second == pytest.approx(possible, abs=1.0)
    # Some of the goals are beyond what is possible with joint 1 at zero.
    assert max(possible for *_, possible in rows) > 100.0


@pytest.mark.slow
@pytest.mark.parametrize('name, count', [('lab1', 2), ('lab2', 5)])
def test_figures_are_written_and_show_something(outcomes, name, count):
    paths = outcomes[name].paths
    assert len(set(paths)) == count
    for path in paths:
        assert str(path) in str(outcomes[name])
        with Image.open(path) as picture:
            assert picture.width > 400
            assert np.asarray(picture.convert('L')).std() > 10.0


@pytest.mark.slow
@pytest.mark.parametrize('name, goals', [
    ('lab1', 1), ('lab2_end_effector_first', lab.GOAL_COUNT),
    ('lab2_joint_first', lab.GOAL_COUNT)])
def test_films_show_every_goal_with_its_caption(outcomes, name, goals):
    motion = outcomes['films'][f'{name}.webp']
    assert len(motion.goals) == goals
    playback, last = Playback(motion), len(motion.times) - 1
    playback.seek(last)
    goal, = (sketch for sketch in playback.sketches()['end_effector'] if isinstance(sketch, Dot))
    np.testing.assert_allclose(goal.p, motion.goals[-1][2])
    assert motion.caption(last).endswith(f'goal {goals} of {goals}' if goals > 1 else 'stays')


def test_the_outcome_is_printed_and_returned(monkeypatch, capsys, tmp_path):
    good = lab.Measurement('quantity', 'mm', 1.0, 1.001, 0.01)
    wrong = lab.Measurement('another', 'rad', 0.5, 0.6, 0.01)
    for rows, passed in (((good,), True), ((good, wrong), False)):
        outcome = lab.Outcome('title', rows, (), (tmp_path / 'figure.png',))
        monkeypatch.setattr(lab, 'lab1', lambda folder: outcome)
        monkeypatch.setattr(lab, 'lab2', lambda folder, seed: outcome)
        for name in ('lab1', 'lab2'):
            assert main(['demo', name, '--output', str(tmp_path)]) == 1 - passed
            printed = capsys.readouterr().out
            assert 'figure.png' in printed
            assert ('WRONG' in printed) is not passed


@pytest.mark.parametrize('measured, passed', [(0.9, True), (1.0, True), (1.1, False),
                                              (math.nan, False)])
def test_a_bound_holds_from_below(measured, passed):
    assert lab.Measurement('speed', 'rad/s', measured, 1.0, 0.0, bound=True).passed is passed


@pytest.mark.slow
def test_the_documented_errors_at_random_goals_are_the_ones_printed(outcomes):
    page = (REPOSITORY / 'docs' / 'lab.md').read_text(encoding='utf-8')
    printed = [line for line in str(outcomes['lab2']).splitlines() if line.startswith('(')]
    first, joint, second, _, possible = np.array(
        [[float(cell) for cell in line.split(')')[1].split()] for line in printed]).T
    assert len(first) == 6 and f'the end-effector to {first.max():.1f} mm' in page
    missed = second[possible > 0.0]
    assert len(missed) == 4 and missed == pytest.approx(possible[possible > 0.0], abs=0.01)
    assert f'{missed.min():.0f} mm to {missed.max():.0f} mm' in page
    assert f'{joint.max():.3f} rad' in page


@pytest.mark.slow
def test_the_documented_comparison_of_forms_is_the_one_measured():
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
    printed = subprocess.run(
        [sys.executable, str(REPOSITORY / 'benchmarks' / 'forms.py')], check=True, timeout=120,
        capture_output=True, encoding='utf-8',
        env={**environment, 'PYTHONIOENCODING': 'utf-8'}).stdout
    documented = (REPOSITORY / 'docs' / 'sequential.md').read_text(encoding='utf-8').splitlines()
    lines = [line for line in printed.splitlines() if line]
    assert len(lines) == 12
    for line in lines:
        assert line in documented

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Exercises 1 and 2 of *lab* (docs/sources.md): 60 Hz, Euler steps, gain 1.

The expected numbers were computed beforehand.
"""

import math

import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack

DT = 1.0 / 60.0
CYCLES = 600
TOOL = '- tool: {type: position, frame: link3, axes: xy}\n'
MOTION = '- motion: {type: joint_velocity}\n'
# Damped everywhere, uniform scaling, nothing relaxed, no transition.
AS_IN_LAB = {'singular_region': math.inf, 'scaling': 'uniform', 'release_region': 0.0,
             'blend': 0.0}
JOINT = '- base: {type: joint, joints: joint1, target: [0.0]}\n'


def exercise_1(damping):
    """Return the largest error of the end-effector [m] and q after 10 s."""
    unlimited = {name: {'velocity': math.inf} for name in robots.planar().joint_names}
    robot = Robot.from_file(robots.PLANAR_DH, limits=unlimited)
    controller = Controller(robot, Stack.from_yaml(TOOL + MOTION, robot),
                            Settings(period=DT, damping=damping, **AS_IN_LAB))
    q, errors = np.array(robots.PLANAR_START), []
    start = robot.state(q).position('link3').copy()
    for cycle in range(CYCLES):
        t = cycle * DT
        controller.set_goal('motion', [math.sin(t), math.cos(t), math.sin(t)], t)
        q = q + DT * controller.update(q, t).velocity
        errors.append(np.linalg.norm(robot.state(q).position('link3') - start))
    return max(errors), q


def by_formula(rest):
    """Return what `exercise_1` does, for a damped end-effector and the share `rest` of y."""
    robot = robots.planar()
    q, errors = np.array(robots.PLANAR_START), []
    start = robot.state(q).position('link3')[:2].copy()
    for cycle in range(CYCLES):
        t, state = cycle * DT, robot.state(q)
        J = state.jacobian('link3')[:2]
        first = J.T @ np.linalg.solve(J @ J.T + 0.01 * np.eye(2),
                                      start - state.position('link3')[:2])
        P = np.eye(3) - np.linalg.pinv(J) @ J
        q = q + DT * (first + rest * P @ [math.sin(t), math.cos(t), math.sin(t)])
        errors.append(np.linalg.norm(robot.state(q).position('link3')[:2] - start))
    return max(errors), q


def exercise_2(order, goal):
    """Return the error of the end-effector [m] and q after 10 s."""
    robot = robots.planar()
    controller = Controller(robot, Stack.from_yaml(order, robot),
                            Settings(period=DT, damping=0.1, **AS_IN_LAB))
    controller.set_goal('tool', [*goal, 0.0], 0.0)
    q = np.array(robots.PLANAR_START)
    for cycle in range(CYCLES):
        velocity = controller.update(q, cycle * DT).velocity
        assert np.abs(velocity).max() <= 1.0
        q = q + DT * velocity
    return np.linalg.norm(robot.state(q).position('link3')[:2] - goal), q


def test_exercise_1_moves_in_the_null_space_of_the_end_effector():
    error, q = exercise_1(damping=0.0)
    assert error == pytest.approx(1.733e-3, abs=5e-7)
    assert q == pytest.approx([0.74633, -0.21186, -0.71626], abs=1e-5)


def test_exercise_1_with_damping_strays_a_little_more():
    # The number computed beforehand damps the end-effector only. The product damps all levels;
    # the rows of a projector have the singular value 1, so y comes out as y / (1 + λ²).
    assert by_formula(rest=1.0)[0] == pytest.approx(1.885e-3, abs=5e-7)
    error, q = exercise_1(damping=0.1)
    expected, q_expected = by_formula(rest=1.0 / 1.01)
    assert error == pytest.approx(expected, rel=1e-9)
    assert error == pytest.approx(1.860e-3, abs=5e-7)
    np.testing.assert_allclose(q, q_expected, atol=1e-9)


# The goal (0.5, 1.2) and joint 1 at 0 cannot both be had: with joints 2 and 3 stretched to 1 m,
# the law of cosines gives the closest angle and the closest distance.
GOAL = np.array([0.5, 1.2])
CLOSEST_ANGLE = math.atan2(1.2, 0.5) - math.acos((0.75 ** 2 + 1.3 ** 2 - 1.0) / (2 * 0.75 * 1.3))
CLOSEST_DISTANCE = math.hypot(0.75 - 0.5, 1.2) - 1.0


def test_exercise_2_end_effector_first():
    error, q = exercise_2(TOOL + JOINT, GOAL)
    assert error == pytest.approx(0.06e-3, abs=0.005e-3)
    assert q == pytest.approx([0.30266, 1.4857, 0.0], abs=1e-4)
    assert q[0] == pytest.approx(CLOSEST_ANGLE, abs=2e-4)


def test_exercise_2_joint_first():
    error, q = exercise_2(JOINT + TOOL, GOAL)
    assert error == pytest.approx(0.22577, abs=5e-6)
    assert q == pytest.approx([0.0, 1.7762, 0.0], abs=1e-4)
    assert error == pytest.approx(CLOSEST_DISTANCE, abs=2e-5)


@pytest.mark.parametrize('order', [TOOL + JOINT, JOINT + TOOL])
def test_exercise_2_meets_both_tasks_where_both_can_be_met(order):
    error, q = exercise_2(order, np.array([0.75, 0.9]))
    assert error < 1e-4
    assert q == pytest.approx([0.0, 1.1198, 0.9021], abs=1e-3)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Extremes of commands: where they are found, and that they do not depend on how many at once."""

import math

import numpy as np
import pytest
from robots import moving_panda, panda
from tp_controller import Robot
from tp_controller.model.simulator import start_configuration
from tp_controller.tools.check import extremes as module
from tp_controller.tools.check.extremes import EXTREMES, Extremes, Worst

PERIOD = 0.01


def test_worst_command_of_a_limit_is_found_with_its_joint_and_run():
    robot = panda()
    found = Extremes(robot, PERIOD, 4)
    assert found.worst() == dict.fromkeys(EXTREMES, Worst())
    q = start_configuration(robot)
    q[0] = robot.upper[0] - 0.01
    velocity = np.zeros(7)
    velocity[0], velocity[5] = 2.0, -3.0 * robot.velocity[5]
    found.add(q, velocity)
    worst = found.worst()
    assert worst['velocity'].value == pytest.approx(3.0)
    assert (worst['velocity'].name, worst['velocity'].run) == ('panda_joint6', 4)
    assert worst['jump'].value == pytest.approx(3.0)
    assert worst['position'].name == 'panda_joint1'
    assert worst['position'].value == pytest.approx(0.01)
    # No joint has an acceleration limit.
    assert worst['acceleration'] == Worst()
    # What is slower later is not the worst.
    found.add(q, np.zeros(7))
    assert found.worst()['velocity'] == worst['velocity']


def test_accelerations_are_changes_over_the_period():
    robot = Robot.from_urdf(panda().urdf, limits={'panda_joint1': {'acceleration': 10.0}})
    found, velocity = Extremes(robot, PERIOD, 0), np.zeros(7)
    velocity[0] = 1.5
    for factor in (1.0, -1.0, -1.0):
        found.add(start_configuration(robot), factor * velocity)
    assert found.worst()['acceleration'] == Worst(pytest.approx(3.0 / (10.0 * PERIOD)),
                                                  'panda_joint1', 0)


@pytest.mark.parametrize('together', [1, 3, 50])
def test_extremes_are_those_of_each_command_however_many_are_evaluated_at_once(monkeypatch,
                                                                               together):
    monkeypatch.setattr(module, 'CYCLES_TOGETHER', together)
    robot, random = moving_panda('planar'), np.random.default_rng(2)
    found, before, most = Extremes(robot, PERIOD, 0), np.zeros(robot.n), dict.fromkeys(
        EXTREMES, -math.inf)
    for _ in range(20):
        q = start_configuration(robot)
        q[robot.joint_rows] += random.uniform(-2.0, 2.0, 7)
        velocity = robot.velocity * random.uniform(-1.0, 1.0, robot.n)
        found.add(q, velocity)
        past = np.maximum(robot.lower - robot.positions(q), robot.positions(q) - robot.upper)
        moved = robot.positions(robot.integrate(q, velocity, PERIOD))
        values = {
            'velocity': np.abs(velocity) / robot.velocity,
            'jump': np.abs(velocity - before) / robot.velocity,
            'position': np.maximum(robot.lower - moved, moved - robot.upper)
            - np.maximum(past, 0.0)}
        most.update({kind: max(most[kind], share.max()) for kind, share in values.items()})
        before = velocity
    worst = found.worst()
    for kind in ('velocity', 'jump', 'position'):
        assert worst[kind].value == pytest.approx(most[kind], abs=1e-12)

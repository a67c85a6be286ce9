# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""The memory of the solver after a cycle has lasted."""

import math

import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.control.settling import settled, SETTLING_STEPS, SettlingMemory


def search(bend, most, velocity=lambda memory: np.array([memory])):
    """Return the memory that settles where a bend (a function of it) is left, and the steps."""
    found, steps = SettlingMemory(most), 1
    while not found.has_settled(bend(found.memory), velocity(found.memory)):
        steps += 1
    return found.memory, steps


@pytest.mark.parametrize('bend, root', [
    (lambda h: 0.3 * h + 1.4, 2.0), (lambda h: 0.8 * h + 0.1, 0.5),
    (lambda h: 5.0 - h, 2.5), (lambda h: math.exp(-h), 0.5671), (lambda h: 0.93 * h, 0.0),
    (lambda h: 3.0 if h < 1.0 else 0.1, 1.0)],
    ids=['slow', 'slower', 'against', 'curved', 'forgotten', 'jump'])
def test_memory_settles_at_its_fixed_point(bend, root):
    memory, _ = search(bend, 8.0)
    assert memory == pytest.approx(root, rel=0.06, abs=0.01)


def test_memory_that_grows_stays_at_the_present_one():
    assert search(lambda h: 2.0 * h, 3.0) == (3.0, 1)


def test_of_two_fixed_points_the_memory_settles_at_the_upper_one():
    # The lower one, at 0.1, attracts as well; the one between them, at 1, does not.
    memory, _ = search(lambda h: h - 0.05 * (h - 0.1) * (h - 1.0) * (h - 3.0), 4.0)
    assert memory == pytest.approx(3.0, rel=0.03)


def test_memories_that_move_the_robot_alike_are_not_told_apart():
    def bend(memory):
        return 1.0 if memory < 0.5 else 0.0

    _, told_apart = search(bend, 1.0)
    _, alike = search(bend, 1.0, lambda memory: np.ones(1))
    assert alike == 2 < told_apart <= SETTLING_STEPS


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
def test_settled_cycle_is_the_one_that_time_leads_to(scaling):
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(
        f'- keep: {{type: keep_in, frame: {robots.PANDA_TOOL}, shape: {{box: [0.3, 0.3, 0.3]}}, '
        f'at: [0.3, 0, 0.4]}}\n- tool: {{type: pose, frame: {robots.PANDA_TOOL}}}\n'
        '- posture: {type: posture}\n', robot), Settings(scaling=scaling, blend=0.0))
    q = np.array(robots.PANDA_READY)
    controller.update(q, 0.0)
    there = robot.state(q + 0.5)
    for task in controller.stack.tasks.values():
        if not task.bounded:
            controller.set_goal(task.name, task.value(there), 0.0)
    for number in range(1, 60):
        command = controller.update(q, 0.01 * number)
        q = robot.integrate(q, command.velocity, 0.01)
    cycle = command.report._cycle.search.variants.cycle
    memory, most = cycle.memory, np.array(cycle.memory)
    assert any(memory)
    for _ in range(1000):
        solution = cycle.solver.solve(cycle.levels, cycle.bounds, memory)
        memory = tuple(np.minimum(solution.memory, most))
    assert settled(cycle).velocity == pytest.approx(solution.velocity, abs=0.01)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Cycles of the compiled core in copies: after a fork, after pickling, and as deep copies."""

import copy
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest
import robots
from robots import REPOSITORY
from tp_controller import Controller, Settings, Stack
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
READY = np.array(robots.PANDA_READY)
STACK = (f'- tool: {{type: pose, frame: {robots.PANDA_TOOL}, gain: 2.0}}\n'
         '- guard: {type: joint_limits}\n- posture: {type: posture}\n')
# The child of a fork and its parent go on with the same controller.
FORK = """
import os, sys
import numpy as np
from robots import PANDA_READY, panda
from tp_controller import Controller, Settings, Stack
robot, q = panda(), np.array(PANDA_READY)
controller = Controller(robot, Stack.from_yaml(sys.argv[1], robot), Settings(blend=0.0))
controller.update(q, 0.0)
goal = robot.state(q).pose(controller.stack.tasks['tool'].frame).copy()
goal[:3, 3] += 0.1
controller.set_goal('tool', goal, 0.0)
def cycles(first):
    found = []
    for number in range(first, first + 20):
        found.append(controller.update(q, 0.01 * number).velocity)
    assert hasattr(controller._last, 'numbers')
    return np.concatenate(found)
cycles(1)
child = os.fork()
found = cycles(21)
with open(sys.argv[2] + ('/child' if child == 0 else '/parent'), 'wb') as file:
    file.write(found.tobytes())
if child == 0:
    os._exit(0)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def moved(controller):
    """Return the commands (40, n) of a controller on the way to a goal."""
    goal = controller.robot.state(READY).pose(robots.PANDA_TOOL).copy()
    goal[:3, 3] += 0.1
    q, found = READY, []
    for cycle in range(40):
        if cycle == 1:
            controller.set_goal('tool', goal, 0.0)
        found.append(controller.update(q, 0.01 * cycle).velocity)
        q = q + 0.01 * found[-1]
    assert hasattr(controller._last, 'numbers') and np.any(found)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, 'fork'), reason='needs fork')
def test_parent_and_child_of_a_fork_go_on_alike(tmp_path):
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(
        [str(REPOSITORY), str(REPOSITORY / 'test')])}
    subprocess.run([sys.executable, '-c', FORK, STACK, str(tmp_path)], check=True,
                   env=environment, timeout=120)
    child, parent = ((tmp_path / name).read_bytes() for name in ('child', 'parent'))
    assert child == parent and any(parent)


@pytest.mark.parametrize('copied', [lambda it: pickle.loads(pickle.dumps(it)), copy.deepcopy],
                         ids=['pickle', 'deepcopy'])
def test_copies_of_robot_and_stack_command_the_same(copied):
    robot = robots.panda()
    given, settings = Stack.from_yaml(STACK, robot), Settings(blend=0.0)
    assert given.tasks['guard'].twin
    expected = moved(Controller(robot, given.copy(), settings))
    other, stack = copied((robot, given))
    assert np.array_equal(moved(Controller(other, stack, settings)), expected)


def test_controllers_are_not_pickled():
    robot = robots.panda()
    controller = Controller(robot, Stack.from_yaml(STACK, robot), Settings(blend=0.0))
    with pytest.raises(TypeError, match='cannot pickle'):
        pickle.dumps(controller)
    moved(controller)

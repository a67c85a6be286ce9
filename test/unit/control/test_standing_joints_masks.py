# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Locked joints in stacks whose tasks may move some joints only, drawn at random."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.causes import residual_of
from tp_controller.control.step import Commanded
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
TOOL, READY, T = robots.PANDA_TOOL, np.array(robots.PANDA_READY), 0.01
NAMES = [f'panda_joint{number}' for number in range(1, 8)]
LOCKED_AT, MOVED_AT, CYCLES = 10, 2, 40
# Acceleration limit [rad/s²]; a joint brakes from its largest speed within half of the cycles.
DECELERATION = 15.0
TASKS = (
    {'type': 'position', 'frame': TOOL}, {'type': 'orientation', 'frame': TOOL, 'axes': 'xy'},
    {'type': 'position', 'frame': 'panda_link4', 'axes': 'xz'},
    {'type': 'keep_in', 'frame': TOOL, 'shape': {'sphere': 0.6}, 'at': [0.0, 0.0, 0.4]},
    {'type': 'speed_limit', 'frame': TOOL, 'linear': 0.2}, {'type': 'joint_limits', 'margin': 0.4})


def drawn_stack(rng):
    """Return the entries of two to four tasks, of which most may move some joints only."""
    entries = []
    for index, number in enumerate(rng.choice(len(TASKS), rng.integers(1, 4), replace=False)):
        task, some = dict(TASKS[number]), rng.choice(NAMES, 4, replace=False).tolist()
        key = str(rng.choice(['joints', 'excluded_joints', '']))
        if key and not (key == 'joints' and task['type'] == 'joint_limits'):
            task[key] = some
        if rng.random() < 0.5:
            task['weights'] = float(10.0 ** rng.uniform(-1.0, 1.0))
        entries.append({f't{index}': task})
    return [*entries, {'posture': {'type': 'posture', 'excluded_joints': some}}]


def pair(rng, accelerates):
    """Return two controllers of a drawn stack: in the core, and by the reference."""
    robot = Robot.from_file(robots.PANDA_DH, limits={
        name: {'acceleration': DECELERATION} for name in NAMES} if accelerates else None)
    entries, options = drawn_stack(rng), {
        'period': T, 'blend': 0.0, 'command_delay': 0, 'release_region': 0.0, 'reserve': 0.0,
        'scaling': str(rng.choice(['redistribute', 'uniform']))}
    one, other = (Controller(robot, Stack(entries, robot), Settings(**options)) for _ in range(2))
    other._core.solve = lambda *given: None
    for task in other.stack.tasks.values():
        task.make_twin = lambda: None
    return one, other


def assert_no_leak(cycle):
    """Assert that no level changes those above it."""
    levels = cycle.levels
    *parts, whole = [cycle.solver.solve(levels[:count], cycle.bounds, cycle.memory[:count]).whole
                     for count in range(1, len(levels) + 1)]
    for count, part in enumerate(parts, 1):
        for level in levels[:count]:
            scale = 1.0 + np.abs(level.J).max() * np.abs(whole).max()
            np.testing.assert_allclose(residual_of(level, whole), residual_of(level, part),
                                       rtol=0.0, atol=1e-9 * scale)


@settings(max_examples=60)
@given(seed=st.integers(0, 2 ** 32 - 1), locks=st.integers(1, 3), accelerates=st.booleans())
@pytest.mark.slow
def test_locked_joints_stand_and_levels_keep_order_and_joints(seed, locks, accelerates):
    rng = np.random.default_rng(seed)
    one, other = pair(rng, accelerates)
    locked = sorted(rng.choice(7, locks, replace=False).tolist())
    q, place = READY.copy(), one.robot.state(READY + rng.uniform(-0.5, 0.5, 7))
    for cycle in range(CYCLES):
        for controller in (one, other):
            if cycle == MOVED_AT:
                for name, task in controller.stack.tasks.items():
                    if not task.bounded:
                        controller.set_goal(name, task.value(place), T * cycle)
            if cycle == LOCKED_AT:
                controller.lock([NAMES[joint] for joint in locked], T * cycle)
        other._last = Commanded(one._memory)
        found, expected = (each.update(q, T * cycle).velocity for each in (one, other))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
        if cycle >= LOCKED_AT + (CYCLES // 2 if accelerates else 1):
            assert one._last.cycle.standing == tuple(locked)
            assert not found[locked].any()
        problem, memory = one._last.cycle, one._last.cycle.memory
        # Where joints must go on moving, one factor for all is no solution of all levels.
        if not accelerates or one.settings.scaling == 'redistribute':
            assert_no_leak(problem)
        first = problem.levels[0]
        if first.joints is not None and not accelerates:
            alone = problem.solver.solve([first], problem.bounds, memory[:1]).velocity
            assert np.abs(alone[~first.joints]).max() < 1e-12
        q = q + T * found

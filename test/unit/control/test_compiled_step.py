# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Cycles in one call of the compiled core are those of `step`."""

from dataclasses import replace
from functools import lru_cache
import importlib
import math
import sys
from threading import Thread

import numpy as np
import pytest
import robots
from robots import REPOSITORY
from tp_controller import Controller, Robot, RobotError, Settings, Stack
from tp_controller.control.cycle_record import CycleRecord
from tp_controller.control.step import Commanded
from tp_controller.solver.compiled import core
from tp_controller.tasks.position import Position
from tp_controller.tasks.twin import FRAME, JOINT_LIMITS, JOINTS

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
READY = np.array(robots.PANDA_READY)
TOOL = robots.PANDA_TOOL
STACK = (f'- limits: {{type: joint_limits}}\n- tool: {{type: pose, frame: {TOOL}, gain: 2.0}}\n'
         '- elbow: {type: position, frame: panda_link4, axes: z}\n'
         '- posture: {type: posture, gain: 0.5}\n')
# Stacks whose tasks all have twins, share a level, or are in part evaluated in Python.
STACKS = {
    'four levels': STACK,
    'shared level': f'- [tool: {{type: position, frame: {TOOL}}}, {{turn: {{type: orientation, '
                    f'frame: {TOOL}, mode: scale}}}}]\n'.replace('{turn', 'turn')
                    .replace('scale}}]', 'least_squares}]')
                    + '- [a: {type: joint, joints: panda_joint1}, '
                      'b: {type: joint, joints: panda_joint3}]\n',
    'Python between': STACK.replace('- elbow', '- keep: {type: manipulability_above, frame: '
                                    f'{TOOL}, minimum: 0.05}}\n- elbow'),
    'bounds': f'- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.2, angular: 0.5}}\n'
              f'- [keep: {{type: keep_out, frame: {TOOL}, shape: {{cylinder: [0.3, 0.8]}}, '
              'at: [0.55, 0.1, 0.3]}, cell: {type: keep_in, frame: panda_link4, '
              'shape: {box: [0.4, 0.4, 1.2]}, at: [0, 0, 0.4]}]\n'
              + STACK.partition('- posture')[0]
              + f'- range: {{type: orientation_range, frame: {TOOL}, axes: xz, '
              'maximum: [0.1, 0.2]}\n'
              f'- view: {{type: field_of_view, frame: {TOOL}, half_angle: 0.3, '
              'target: [0.5, 0.3, 0.0]}\n- middle: {type: joint_limit_distance, gain: 0.1}\n',
    'Python beside': f'- [most: {{type: manipulability, frame: {TOOL}}}, '
                     f'tool: {{type: position, frame: {TOOL}}}]\n- [posture: {{type: posture}}, '
                     'more: {type: joint, joints: panda_joint2}]\n',
    'directions': f'- [look: {{type: pointing, frame: {TOOL}, axis: x}}, '
                  f'tool: {{type: position, frame: {TOOL}}}]\n- camera: {{type: look_at, frame: '
                  'panda_link5, target: panda_hand_tcp, up: x}\n- posture: {type: posture}\n',
    'velocities': f'- move: {{type: twist, frame: {TOOL}}}\n'
                  '- turn: {type: joint_velocity, joints: panda_joint1}\n',
    'masks': f'- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.1, '
             'excluded_joints: panda_joint1}\n'
             f'- tool: {{type: position, frame: {TOOL}, '
             'joints: [panda_joint1, panda_joint2, panda_joint4]}\n'
             f'- most: {{type: manipulability, frame: {TOOL}, joints: [panda_joint5]}}\n'
             '- [a: {type: joint, joints: panda_joint3, weights: 5, excluded_joints: '
             'panda_joint7}, '
             'b: {type: joint, joints: panda_joint6, excluded_joints: panda_joint7}]\n'
             '- posture: {type: posture, excluded_joints: panda_joint2, '
             'weights: {panda_joint1: 10}}\n',
    'nothing': '- posture: {type: posture}\n',
}


@lru_cache(maxsize=None)
def panda(base='fixed'):
    """Return a Panda on a base."""
    return robots.panda() if base == 'fixed' else robots.moving_panda(base)


def by_step(controller):
    """Let `step`, and the references of the tasks, compute all cycles; return the controller."""
    controller._core.solve = lambda *given: None
    for task in controller.stack.tasks.values():
        task.make_twin = lambda: None
    return controller


def counting(controller):
    """Return a list that gets a record, or None, for each cycle."""
    found, solve = [], controller._core.solve

    def counted(*given):
        found.append(solve(*given))
        return found[-1]

    controller._core.solve = counted
    return found


def pair(text, robot=None, **settings):
    """Return two controllers of a stack: in one call, and by `step`."""
    robot = robot or panda()
    one, other = (Controller(robot, Stack.from_yaml(text, robot), Settings(
        **{'period': 0.01, **settings})) for _ in range(2))
    return one, by_step(other)


def close(found, expected, tolerance=1e-12):
    """Assert that two arrays agree."""
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance)


def assert_equal_cycles(one, other):
    """Assert that two cycles have the same problem, outcome and memory."""
    for found, expected in zip(one.cycle.levels, other.cycle.levels, strict=True):
        close(found.J, expected.J)
        assert (found.v is None) == (expected.v is None)
        assert (found.mode, found.is_identity) == (expected.mode, expected.is_identity)
        np.testing.assert_array_equal(found.joints, expected.joints)
        np.testing.assert_array_equal(found.weights, expected.weights)
        for name in ('v', 'lower', 'upper'):
            if getattr(expected, name) is not None:
                close(getattr(found, name), getattr(expected, name))
    for found, expected in zip(sum(one.evaluations, []), sum(other.evaluations, []), strict=True):
        close(found.error, expected.error)
        assert found.task.name == expected.task.name
        assert list(found.row_names) == list(expected.row_names)
    bounds, others = one.cycle.bounds, other.cycle.bounds
    close(bounds.lower, others.lower)
    close(bounds.upper, others.upper)
    close(bounds.settled.lower, others.settled.lower)
    close(bounds.hold, others.hold)
    assert (bounds.cap is None) == (others.cap is None)
    close(one.velocity, other.velocity)
    close(one.outcome.solution.velocity, one.velocity)
    for index in range(len(one.cycle.levels)):
        found, expected = one.outcome.solution.levels[index], other.outcome.solution.levels[index]
        close(found.velocity, expected.velocity, 1e-9)
        close(found.multipliers, expected.multipliers, 1e-9)
        close(found.scale, expected.scale, 1e-9)
        close(found.unreachable, expected.unreachable, 1e-9)
    close(one.place.q, other.place.q)
    assert_equal_memories(one.memory, other.memory)


def assert_equal_memories(one, other):
    """Assert that two memories are the same."""
    close(one.velocity, other.velocity)
    close(one.acceleration, other.acceleration, 1e-9)
    close(one.before, other.before)
    close(one.pending, other.pending)
    np.testing.assert_allclose(one.damping, other.damping, rtol=1e-12, atol=1e-12)
    close(one.time, other.time)
    assert one.commanded == other.commanded
    for fade, same in zip(one.transition.fades, other.transition.fades, strict=True):
        close(fade.offset, same.offset)
    assert one.escape[:3] == other.escape[:3]


@pytest.mark.slow
@pytest.mark.parametrize('scaling', ['uniform', 'redistribute'])
@pytest.mark.parametrize('delay', [0, 2])
@pytest.mark.parametrize('base', ['fixed', 'planar'])
@pytest.mark.parametrize('name', STACKS)
def test_cycles_are_those_of_step(name, base, delay, scaling):
    robot = panda(base)
    one, other = pair(STACKS[name], robot, command_delay=delay, scaling=scaling, blend=0.05)
    records = counting(one)
    q, rng = robot.configuration(READY, np.eye(4)) if robot.moves else READY, None
    rng = np.random.default_rng(0)
    for cycle in range(80):
        now = 0.01 * cycle
        if cycle == 10:
            for task in one.stack.tasks.values():
                if task.goal is None or task.bounded:
                    continue
                goal = np.array(task.value(robot.state(q)), dtype=float)
                if goal.ndim == 1 and task.type_name != 'pointing':
                    goal = goal + rng.uniform(-0.3, 0.3, goal.shape)
                elif goal.shape == (4, 4):
                    goal[:3, 3] += rng.uniform(-0.5, 0.5, 3)
                for controller in (one, other):
                    controller.set_goal(task.name, goal, now)
        # From the same memory: differences of rounding must not add up.
        other._last = Commanded(one._memory)
        velocity = one.update(q, now).velocity
        other.update(q, now)
        if isinstance(one._last, CycleRecord):
            assert_equal_cycles(one._last, other._last)
        assert_equal_memories(one._memory, other._memory)
        q = robot.integrate(q, velocity, 0.01)
    # All but the first cycle, and those of the transition.
    assert sum(record is not None for record in records) >= 60


@pytest.mark.slow
@pytest.mark.parametrize('scaling', ['uniform', 'redistribute'])
@pytest.mark.parametrize('delay', [0, 2])
def test_cycles_with_jerk_limits_are_those_of_step(delay, scaling):
    robot = Robot.from_file(robots.PANDA_DH, limits={
        name: {'acceleration': 7.5, 'jerk': 200.0} for name in panda().joint_names})
    one, other = pair(STACK, robot, command_delay=delay, scaling=scaling, blend=0.05)
    # In no cycle do two joints reach their bounds in a tie, which each side may break its way.
    records, q, rng = counting(one), READY, np.random.default_rng(1)
    for cycle in range(200):
        now = 0.01 * cycle - 0.004 * (cycle % 2)
        if cycle % 60 == 10:
            T = robot.state(q).pose(TOOL).copy()
            T[:3, 3] += rng.uniform(-0.4, 0.4, 3)
            for controller in (one, other):
                controller.set_goal('tool', T, now)
        other._last = Commanded(one._memory)
        velocity = one.update(q, now).velocity
        close(velocity, other.update(q, now).velocity)
        if isinstance(one._last, CycleRecord):
            assert_equal_cycles(one._last, other._last)
            # The causes read the demand over in the record.
            assert one._last.causes(np.zeros(4)) is not None
        assert_equal_memories(one._memory, other._memory)
        q = robot.integrate(q, velocity, 0.01)
    assert sum(record is not None for record in records) >= 160


def lock_and_unlock(controller, q, cycle):
    """Set goals, lock two joints and unlock one, in three cycles of a controller."""
    now = 0.01 * cycle
    if cycle == 20:
        controller.lock(['panda_joint1', 'panda_joint4'], now)
    if cycle == 50:
        controller.unlock(['panda_joint1'], now)
    for task in controller.stack.tasks.values() if cycle == 5 else ():
        if task.type_name in ('joint', 'posture', 'position'):
            controller.set_goal(task.name, task.value(controller.robot.state(q)) + 0.2, now)
        elif task.type_name == 'joint_velocity':
            controller.set_goal(task.name, [1.0], now)


@pytest.mark.slow
@pytest.mark.parametrize('scaling', ['uniform', 'redistribute'])
@pytest.mark.parametrize('limits', [
    {}, {'acceleration': 4.0}, {'acceleration': 4.0, 'jerk': 80.0}])
@pytest.mark.parametrize('name', STACKS)
def test_cycles_with_locks_are_those_of_step(name, limits, scaling):
    robot = Robot.from_file(robots.PANDA_DH, limits=dict.fromkeys(panda().joint_names, limits))
    one, other = pair(STACKS[name], robot, scaling=scaling, blend=0.05)
    records, q = counting(one), READY + 0.05
    for cycle in range(60):
        for controller in (one, other):
            lock_and_unlock(controller, q, cycle)
        # From the same memory: differences of rounding must not add up.
        other._last = Commanded(one._memory)
        velocity = one.update(q, 0.01 * cycle).velocity
        close(velocity, other.update(q, 0.01 * cycle).velocity)
        if isinstance(one._last, CycleRecord):
            assert (standing := one._last.cycle.standing) == other._last.cycle.standing
            for found, expected in zip(one._last.cycle.levels, other._last.cycle.levels):
                close(*(np.delete(level.J, standing, axis=1) for level in (found, expected)))
        q = robot.integrate(q, velocity, 0.01)
    assert other._last.cycle.standing == (robot.joint_names.index('panda_joint4'),)
    assert sum(record is not None for record in records) >= 35


@pytest.mark.slow
@pytest.mark.parametrize('number', range(26))
def test_random_stacks_are_those_of_step(number, monkeypatch):
    monkeypatch.syspath_prepend(str(REPOSITORY / 'benchmarks'))
    drawn = importlib.import_module('_random_stacks').Drawn(number)
    one, other = (Controller(drawn.robot, drawn.stack(), Settings(
        period=1.0 / drawn.rate, blend=0.0)) for _ in range(2))
    records, q = counting(one), drawn.start
    by_step(other)
    for cycle in range(10):
        now = cycle / drawn.rate
        if cycle == 2:
            for controller in (one, other):
                for task, goal in drawn.goals.items():
                    controller.set_goal(task, goal, now)
        other._last = Commanded(one._memory)
        velocity = one.update(q, now).velocity
        close(velocity, other.update(q, now).velocity, 1e-6)
        q = drawn.robot.integrate(q, velocity, 1.0 / drawn.rate)
    assert sum(record is not None for record in records) >= 6


@pytest.mark.slow
def test_report_is_that_of_step_and_stays_valid():
    one, other = pair(STACK)
    for controller in (one, other):
        controller.set_velocity_limits(dict.fromkeys(one.robot.velocity_names, 0.05))
        controller.update(READY, 0.0)
        T = one.robot.state(READY).pose(TOOL).copy()
        T[:3, 3] += [0.2, 0.1, 0.2]
        controller.set_goal('tool', T, 0.0)
    reports, expected, q = [], [], READY
    for cycle in range(1, 60):
        command = one.update(q, 0.01 * cycle)
        report = other.update(q, 0.01 * cycle).report
        q = q + 0.01 * command.velocity
        # Hints take time.
        if cycle % 6 == 1:
            reports.append(command.report)
            expected.append([(task.status, task.reason, task.hint, task.errors, task.causes)
                             for task in report.tasks] + [report.scale, report.limiting])
    # Read after all cycles, the last one first.
    for report, wanted in reversed(list(zip(reports, expected))):
        tasks = [(task.status, task.reason, task.hint, task.errors, task.causes)
                 for task in report.tasks]
        for found, its in zip(tasks, wanted):
            assert found[:3] == its[:3]
            close([error for error, _, _ in found[3]], [error for error, _, _ in its[3]], 1e-9)
            assert [cause[:2] for cause in map(vars_of, found[4])] == \
                [cause[:2] for cause in map(vars_of, its[4])]
        close(report.scale, wanted[-2], 1e-9)
        assert report.limiting == wanted[-1]
    assert any('velocity limit' in task.reason for task in reports[-1].tasks)


def vars_of(cause):
    """Return a cause as a tuple."""
    return cause.kind, cause.name, cause.share


def test_inputs_act_in_the_next_cycle_whoever_sets_them():
    one, other = pair('- tool: {type: position, frame: panda_hand_tcp}\n', blend=0.0)
    records = counting(one)
    goal = one.robot.state(READY).position(TOOL) + 0.1

    def both(change):
        for controller in (one, other):
            change(controller)

    def stack_task(controller):
        return controller.stack.tasks['tool']

    changes = [
        lambda c: None, lambda c: c.set_goal('tool', goal, 0.0), lambda c: None,
        lambda c: c.set_gain('tool', 3.0), lambda c: setattr(stack_task(c), 'gain', np.array(5.0)),
        lambda c: setattr(stack_task(c), 'goal', goal + 0.1),
        lambda c: c.set_feed_forward('tool', [0.1, 0.0, 0.0], 0.05), lambda c: None,
        lambda c: setattr(stack_task(c), 'mode', 'scale'), lambda c: c.enable('tool', False),
        lambda c: c.enable('tool', True), lambda c: c.halt(0.1),
        lambda c: setattr(c, 'settings', replace(c.settings, damping=0.2)),
        lambda c: c.replace_stack(Stack.from_yaml('- posture: {type: posture}\n', c.robot)),
        lambda c: None]
    for cycle, change in enumerate(changes):
        both(change)
        for part in (0.0, 0.5):
            found, expected = (controller.update(READY, 0.01 * (cycle + part))
                               for controller in (one, other))
            close(found.velocity, expected.velocity)
            assert one._memory.escape[:3] == other._memory.escape[:3]
        assert [task.status for task in found.report.tasks] == \
            [task.status for task in expected.report.tasks]
    assert len(records) == 2 * len(changes) and None not in records


def test_goal_that_is_blended_in_needs_step():
    one, _ = pair('- tool: {type: position, frame: panda_hand_tcp}\n', blend=0.1)
    records, goal = counting(one), one.robot.state(READY).position(TOOL) + 0.1
    for cycle in range(30):
        if cycle == 5:
            one.set_goal('tool', goal, 0.05)
        one.update(READY, 0.01 * cycle)
    assert None not in records[:5] and records[5] is None and records[-1] is not None


def test_feed_forward_velocity_times_out():
    one, other = pair('- tool: {type: position, frame: panda_hand_tcp, timeout: 0.1}\n', blend=0.0)
    for cycle in range(30):
        if cycle == 5:
            for controller in (one, other):
                controller.set_feed_forward('tool', [0.1, 0.0, 0.0], 0.05)
        found, expected = (controller.update(READY, 0.01 * cycle).velocity
                           for controller in (one, other))
        close(found, expected)
        assert found.any() == (5 <= cycle <= 15)


def test_robot_that_rests_at_a_singularity_is_nudged():
    robot = robots.planar()
    one, other = pair('- tool: {type: position, frame: link3, axes: xy}\n', robot, blend=0.0)
    records, q, overrides = counting(one), np.zeros(3), []
    for cycle in range(200):
        # New nudges are allowed after the second goal.
        if cycle in (3, 190):
            for controller in (one, other):
                controller.set_goal('tool', [0.4, 0.0, 0.0], 0.01 * cycle)
        found, expected = (controller.update(q, 0.01 * cycle) for controller in (one, other))
        close(found.velocity, expected.velocity, 1e-9)
        assert one._memory.escape[:3] == other._memory.escape[:3]
        overrides.append(one._last.outcome.override)
        q = q + 0.01 * found.velocity
    assert 'leaving a singularity' in overrides and records[10] is not None
    assert np.abs(q).max() > 0.1


def test_passive_joints_and_states_between_cycles():
    robot = robots.urdf_robot('panda_urdf') if 'panda_urdf' in robots.URDFS else panda()
    one, other = pair(STACK, robot)
    for cycle in range(10):
        for controller in (one, other):
            controller.update(READY[:robot.n] + 0.01 * cycle, 0.01 * cycle,
                              passive=np.zeros(len(robot.passive_names)) if cycle % 2 else None)
        (q, _), (expected, _) = one.configuration(), other.configuration()
        close(q, expected)
        # A goal in a frame of the robot is one at the present positions.
        for controller in (one, other):
            controller.set_goal('elbow', [0.0, 0.0, 0.1], 0.01 * cycle, frame='panda_link5')
        close(one.stack.tasks['elbow'].goal, other.stack.tasks['elbow'].goal)


@pytest.mark.parametrize('q', [READY[:-1], READY * math.nan, READY + 1e10, 'x', None, 3.0])
def test_positions_that_are_none_are_refused_and_nothing_changes(q):
    one, other = pair(STACK)
    for controller in (one, other):
        controller.update(READY, 0.0)
        controller.update(READY, 0.01)
    for controller in (one, other):
        with pytest.raises(RobotError):
            controller.update(q, 0.02)
    close(one.update(READY, 0.02).velocity, other.update(READY, 0.02).velocity)
    assert_equal_memories(one._memory, other._memory)


def test_numbers_of_other_types_are_positions_too():
    one, other = pair(STACK)
    for cycle, q in enumerate((READY, READY.tolist(), READY.astype(np.float32),
                               np.asfortranarray(READY)[::1], np.repeat(READY, 2)[::2])):
        close(one.update(q, 0.01 * cycle).velocity, other.update(q, 0.01 * cycle).velocity)


class Failing(Position):
    """A position that Python evaluates, and that fails if told so."""

    type_name = ''
    fails = False

    def error(self, state):
        """Return the error."""
        return 1.0 / (not self.fails) * super().error(state)


@pytest.mark.parametrize('faults', ['stop', 'switch off'])
def test_task_of_python_that_fails_is_treated_as_by_step(faults):
    robot = panda()
    found = []
    for uses in (True, False):
        stack = Stack([[Failing(robot, 'tool', frame=TOOL)],
                       [Position(robot, 'elbow', frame='panda_link4')]])
        controller = Controller(robot, stack, Settings(period=0.01, task_faults=faults))
        if not uses:
            by_step(controller)
        controller.update(READY, 0.0)
        controller.update(READY, 0.01)
        stack.tasks['tool'].fails = True
        outcome = []
        for cycle in (2, 3):
            try:
                outcome.append([task.status for task in controller.update(
                    READY, 0.01 * cycle).report.tasks])
            except Exception as error:
                outcome.append(str(error))
        found.append(outcome)
    assert found[0] == found[1]


def test_tasks_of_python_that_remember_cycles_do_not_make_twins_anew():
    controller = Controller(panda(), Stack.from_yaml(STACKS['Python between'], panda()),
                            Settings(period=0.01))
    for cycle in range(3):
        controller.update(READY, 0.01 * cycle)
    twins = controller._core._step.layout.twins
    controller.update(READY, 0.03)
    assert controller._core._step.layout.twins is twins
    controller.set_gain('tool', 3.0)
    for cycle in range(4, 40):
        controller.update(READY, 0.01 * cycle)
    assert controller._core._step.layout.twins is not twins


def cycle_of_core():
    """Return what `run` of the core gets in a cycle."""
    controller = Controller(panda(), Stack.from_yaml(STACKS['Python between'], panda()),
                            Settings(period=0.01))
    given = []
    for cycle in range(3):
        controller.update(READY, 0.01 * cycle)
        compiled = controller._core._step
        if compiled is not None and not given:
            given.append(compiled)
    step = given[0]
    state = controller.robot.state(READY)
    levels = tuple(each.level for each in controller.stack.evaluate_tasks(step.given, state, 0.0))
    return step._compiled, [controller._last.numbers, state.motion, True, READY, 0.03, math.nan,
                            levels, np.empty(7)]


def snake():
    """Return a robot with as many joints as a Panda, and fewer frames."""
    joint = {'a': 0.1, 'alpha': 0.0, 'd': 0.0, 'theta': 0.0, 'type': 'revolute', 'lower': -1.0,
             'upper': 1.0, 'velocity': 1.0}
    return Robot.from_dh([{'name': f'joint{number}', **joint} for number in range(7)])


def test_cycles_that_do_not_fit_are_left_to_step():
    compiled, fits = cycle_of_core()
    level = fits[6][0]
    assert isinstance(compiled.run(*fits), bytes)
    for place, wrong in (
            (0, b''), (0, fits[0][:64]), (0, None), (0, bytearray(fits[0])), (1, None),
            (1, compiled), (1, robots.planar().state(np.zeros(3)).motion),
            (1, snake().state(np.zeros(7)).motion), (3, READY[1:]),
            (3, READY * math.nan), (3, READY + 1e10), (3, None), (4, None), (4, math.nan),
            (5, 'x'), (6, ()), (6, (level, level)), (6, [level]), (6, None), (6, (None,)),
            (6, (replace(level, J=level.J[:, 1:]),)), (6, (replace(level, lower=None),)),
            (7, np.empty(6)), (7, np.empty(7, int)), (7, None)):
        given = [*fits]
        given[place] = wrong
        assert compiled.run(*given) is None, (place, wrong)
    with pytest.raises(ValueError, match='run'):
        compiled.run(*fits[1:])
    assert isinstance(compiled.run(*fits), bytes)


def test_equal_records_give_equal_bits():
    compiled, fits = cycle_of_core()
    first = compiled.run(*fits)
    second = compiled.run(first, *fits[1:])
    assert compiled.run(*fits) == first and compiled.run(first, *fits[1:]) == second
    assert first != second


def test_tasks_that_do_not_fit_are_refused_and_nothing_changes():
    compiled, fits = cycle_of_core()
    before, motion = compiled.run(*fits), fits[1]
    far = core.Task(FRAME, (6, False, np.array(2.0), None, 0.0, 1.0, None, None),
                    (10 ** 6, -1, bytes(range(6)), None, None))
    law = (1, False, np.array(2.0), None, 0.0, 1.0, None, None)
    demand = core.Task(JOINTS, law, (np.zeros(1), False, None, np.zeros(1)))
    bounds = core.Task(JOINT_LIMITS, law, (np.zeros(1), -np.ones(1), np.ones(1), 0.2))
    for given in ((motion, ((demand, bounds),)), (motion, ((None, demand, bounds),)),
                  (motion, ((None, bounds, demand),)), (motion, ((far,),)), (motion, ((),)),
                  (motion, (far,)), (motion, [(None,)]),
                  (motion, (('x',),)), (None, ((None,),)), (motion,),
                  (robots.planar().state(np.zeros(3)).motion, ((None,),))):
        with pytest.raises(ValueError, match='task'):
            compiled.set_tasks(*given)
    assert compiled.run(*fits) == before


def test_steps_that_do_not_fit_together_are_refused():
    controller = Controller(panda(), Stack.from_yaml(STACK, panda()), Settings(period=0.01))
    options = controller._options
    fits = [options.solver.core, options.limits.compiled, options.limits.cap, 0.01, 2]
    core.Step(*fits)
    planar = Controller(robots.planar(), Stack.from_yaml('- posture: {type: posture}\n',
                                                         robots.planar()))
    for place, wrong in ((0, None), (1, None), (1, planar._options.limits.compiled),
                         (2, np.ones(6)), (3, 'x'), (4, -1), (4, 10 ** 6)):
        given = [*fits]
        given[place] = wrong
        with pytest.raises((ValueError, TypeError)):
            core.Step(*given)


def test_objects_that_are_lent_are_given_back():
    compiled, fits = cycle_of_core()
    motion, task = fits[1], core.Task(FRAME, (6, False, np.array(2.0), None, 0.0, 1.0, None, None),
                                      (1, -1, bytes(range(6)), None, None))

    def use():
        assert compiled.run(*fits) is not None
        assert compiled.run(*fits[:7], None) is None
        controller = Controller(panda(), Stack.from_yaml(STACK, panda()), Settings(period=0.01))
        options = controller._options
        step = core.Step(options.solver.core, options.limits.compiled, None, 0.01, 2)
        step.set_tasks(motion, ((task,), (task, None)))
        with pytest.raises(ValueError):
            step.set_tasks(motion, ((task, 'x'),))

    use()
    # All of Python counts True.
    objects = [each for each in (*fits, *fits[6], task, core.Step) if each is not True]
    before = [sys.getrefcount(each) for each in objects]
    use()
    assert [sys.getrefcount(each) for each in objects] == before


def test_controllers_in_threads_command_what_they_do_alone():
    def commands():
        controller, q, found = Controller(panda(), Stack.from_yaml(STACK, panda()), Settings(
            period=0.01)), READY, []
        for cycle in range(300):
            if cycle == 3:
                T = panda().state(READY).pose(TOOL).copy()
                T[:3, 3] += 0.1
                controller.set_goal('tool', T, 0.03)
            found.append(controller.update(q, 0.01 * cycle).velocity)
            q = q + 0.01 * found[-1]
        return found

    expected, found = commands(), []
    threads = [Thread(target=lambda: found.append(commands())) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4 and all(np.array_equal(each, expected) for each in found)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""Causes that the compiled core finds are those of the reference."""

from copy import copy
import importlib
import sys
from threading import Thread

import numpy as np
import pytest
import robots
from robots import REPOSITORY
from tp_controller import Controller, Settings, Stack
from tp_controller.control.causes import missing
from tp_controller.control.cycle_record import CycleRecord
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
READY = np.array(robots.PANDA_READY)
TOOL = robots.PANDA_TOOL
STACKS = {
    'one level': f'- tool: {{type: pose, frame: {TOOL}}}\n',
    'two levels': f'- tool: {{type: pose, frame: {TOOL}}}\n- posture: {{type: posture}}\n',
    # Without one of two tasks of a level, the other one may demand a velocity of every joint.
    'shared levels': f'- [tool: {{type: position, frame: {TOOL}}}, turn: {{type: orientation, '
                     f'frame: {TOOL}}}, elbow: {{type: position, frame: panda_link4}}]\n'
                     '- [posture: {type: posture}, joint: {type: joint, joints: panda_joint2}]\n',
    'bounds': f'- keep: {{type: keep_in, frame: {TOOL}, shape: {{box: [0.3, 0.3, 0.3]}}, '
              f'at: [0.3, 0, 0.4]}}\n- tool: {{type: pose, frame: {TOOL}}}\n'
              '- posture: {type: posture}\n',
}
SLOW = dict.fromkeys((f'panda_joint{number}' for number in range(1, 8)), 0.1)


def assert_same(found, expected):
    """Assert that causes are the same, in the same order but for equal shares."""
    shares = {(cause.kind, cause.name): cause.share for cause in found}
    assert shares == pytest.approx(
        {(cause.kind, cause.name): cause.share for cause in expected}, abs=1e-9)
    assert [cause.share for cause in found] == pytest.approx(
        [cause.share for cause in expected], abs=1e-9)


def compared(command):
    """Return the kinds of the causes in a cycle of the core, after a comparison."""
    cycle, kinds = command.report._cycle, set()
    for report, evaluation in zip(command.report.tasks, cycle.evaluations):
        expected = () if report.reached else cycle.search.of(evaluation)
        assert_same(report.causes, expected)
        lasting = cycle.search.variants.lasting.velocity
        # Of what is missing by rounding alone, rounding chooses the causes.
        if cycle.search.is_limited(evaluation) and missing(
                cycle.search.variants.whole_level(evaluation), lasting) > 1e-12:
            assert cycle.combined_causes(report._index) == cycle.search.combined_causes(evaluation)
        kinds.update(cause.kind for cause in expected)
    assert cycle._found is not None
    return kinds


# In the last one a task without rows shares a level.
@pytest.mark.slow
@pytest.mark.parametrize('locks', [0, 1, 2])
@pytest.mark.parametrize('number', [*range(26), 118])
def test_causes_in_random_stacks_are_those_of_the_reference(number, locks, monkeypatch):
    monkeypatch.syspath_prepend(str(REPOSITORY / 'benchmarks'))
    drawn = importlib.import_module('_random_stacks').Drawn(number)
    controller = Controller(drawn.robot, drawn.stack(), Settings(
        period=1.0 / drawn.rate, blend=0.0, scaling=('redistribute', 'uniform')[number % 4 == 0]))
    q, cycles, names = drawn.start, 0, drawn.robot.velocity_names
    for cycle in range(8 if number < 26 else 12):
        now = cycle / drawn.rate
        if cycle == 1 and locks < len(names):
            controller.lock(np.random.default_rng(number).choice(names, locks, False), now)
        if cycle == 2:
            for task, goal in drawn.goals.items():
                controller.set_goal(task, goal, now)
        command = controller.update(q, now)
        if isinstance(controller._last, CycleRecord):
            compared(command)
            cycles += 1
        q = drawn.robot.integrate(q, command.velocity, 1.0 / drawn.rate)
    assert cycles >= 4


def test_causes_are_the_same_where_the_fast_path_solves_a_cycle_that_has_forgotten(monkeypatch):
    # Level by level, with the memory of the cycle, a joint stays at its limit.
    monkeypatch.syspath_prepend(str(REPOSITORY / 'benchmarks'))
    scene = list(importlib.import_module('causes').drive('Panda', 14))[13]
    assert compared(scene) == {'curvature'}


def test_causes_that_act_before_all_joints_are_scaled_are_those_of_the_reference(monkeypatch):
    monkeypatch.syspath_prepend(str(REPOSITORY / 'benchmarks'))
    scenes = list(importlib.import_module('causes').drive('Panda', 4))[5:8]
    assert all('lower position limit' in compared(scene) for scene in scenes)


def limited(name, robot=None, **settings):
    """Return a slow controller whose goals are far away, after some cycles."""
    robot = robot or robots.panda()
    controller = Controller(robot, Stack.from_yaml(STACKS[name], robot), Settings(
        **{'period': 0.01, 'blend': 0.0, **settings}))
    controller.set_velocity_limits(SLOW)
    controller.update(READY, 0.0)
    there = robot.state(READY + 0.5)
    for task in controller.stack.tasks.values():
        if not task.bounded:
            controller.set_goal(task.name, task.value(there), 0.0)
    for cycle in range(1, 10):
        command = controller.update(READY, 0.01 * cycle)
    return controller, command


@pytest.mark.slow
@pytest.mark.parametrize('settings', [
    {}, {'scaling': 'uniform'}, {'weights': (1.0, 5.0, 1.0, 0.2, 1.0, 1.0, 3.0)},
    {'command_delay': 0}, {'damping': 0.0}, {'singular_region': 2.0}])
@pytest.mark.parametrize('name', STACKS)
def test_causes_at_limits_are_those_of_the_reference(name, settings):
    controller, command = limited(name, **settings)
    for cycle in range(10, 20):
        assert compared(command) - {'task'}
        command = controller.update(READY + 0.01 * cycle, 0.01 * cycle)


@pytest.mark.parametrize('scaling', ['redistribute', 'uniform'])
@pytest.mark.parametrize('name', STACKS)
def test_causes_with_locked_joints_are_those_of_the_reference(name, scaling):
    controller, _ = limited(name, scaling=scaling)
    controller.lock(['panda_joint2', 'panda_joint5'], 0.1)
    kinds = set()
    for cycle in range(10, 20):
        command = controller.update(READY + 0.01 * cycle, 0.01 * cycle)
        assert controller._last.cycle.standing == (1, 4)
        kinds |= compared(command)
    assert 'lock' in kinds


@pytest.mark.parametrize('attribute, value, kind', [
    ('acceleration', np.full(7, 0.5), 'accelerating'),
    ('acceleration', np.array([0.5, *[np.inf] * 6]), 'accelerating'),
    ('upper', READY, 'upper position limit'), ('lower', READY, 'lower position limit')])
def test_each_limit_is_a_cause_with_its_own_name(attribute, value, kind):
    robot = copy(robots.panda())
    setattr(robot, attribute, value)
    _, command = limited('one level', robot)
    assert kind in compared(command)


def test_tasks_that_are_reached_are_not_searched():
    controller, command = limited('two levels')
    least = []
    causes = controller._last.layout.search.causes

    class Search:
        """The search of the core, which notes what it gets."""

        def causes(self, record, before, given):
            least.append(given)
            return causes(record, before, given)

    controller._last.layout = controller._last.layout._replace(search=Search())
    controller.stack.tasks['posture'].set_tolerance(10.0)
    assert [bool(task.causes) for task in command.report.tasks] == [True, False]
    assert len(least) == 1 and np.isinf(least[0]).tolist() == [False, True]


def test_cycles_that_the_core_leaves_are_searched_by_the_reference():
    controller, command = limited('two levels')
    expected = [task.causes for task in controller.update(READY, 0.1).report.tasks]
    command = controller.update(READY, 0.1)

    class Nothing:
        """A search that finds nothing."""

        def causes(self, *given):
            """Leave it to the reference."""

    controller._last.layout = controller._last.layout._replace(search=Nothing())
    for task, causes in zip(command.report.tasks, expected):
        assert causes
        assert [cause.kind for cause in task.causes] == [cause.kind for cause in causes]


@pytest.mark.parametrize('name, last, wrong_ones', [
    ('causes', np.zeros(3), (np.zeros(2), None, [0.0] * 3, np.zeros(3, int))),
    ('combined_causes', 2, (-1, 3, 2 ** 70, 1.0, None))])
def test_records_that_are_none_are_left_to_the_reference(name, last, wrong_ones):
    controller, _ = limited('bounds')
    record = controller._last
    find, fits = getattr(record.layout.search, name), [record.numbers, record._before, last]
    expected = find(*fits)
    assert any(expected)
    size = len(record.numbers)
    numbers = np.frombuffer(record.numbers)
    for place in range(len(numbers)):
        # Any number may be wrong, and counts of rows among them.
        for wrong in (-1.0, 1e300, np.nan):
            broken = numbers.copy()
            broken[place] = wrong
            find(broken.tobytes(), *fits[1:])
    for place, wrong in ((0, b''), (0, record.numbers[:size // 2]), (0, None), (0, 'x'),
                         (0, bytearray(record.numbers)), (1, b''), (1, None),
                         *[(2, wrong) for wrong in wrong_ones]):
        given = [*fits]
        given[place] = wrong
        assert find(*given) is None, (place, wrong)
    with pytest.raises(ValueError, match='causes'):
        find(*fits[1:])
    assert find(*fits) == expected


def test_objects_that_are_lent_are_given_back():
    controller, _ = limited('shared levels')
    record = controller._last
    given = record.numbers, record._before, np.zeros(len(record.errors))

    def use():
        assert any(record.layout.search.causes(*given))
        assert record.layout.search.causes(*given[:2], None) is None
        assert record.layout.search.combined_causes(*given[:2], 0) is not None
        assert record.layout.search.combined_causes(*given) is None

    use()
    before = [sys.getrefcount(each) for each in given]
    use()
    assert [sys.getrefcount(each) for each in given] == before


def test_reports_are_read_in_threads_while_the_controller_goes_on():
    controller, command = limited('shared levels')
    expected = [task.causes for task in command.report.tasks]
    found = []

    def read(report):
        found.append([task.causes for task in report.tasks])

    last = controller._last
    reports = [type(command.report)(controller.robot, (), {}, last) for _ in range(40)]
    threads = [Thread(target=read, args=(report,)) for report in reports]
    for cycle, thread in enumerate(threads):
        thread.start()
        controller.update(READY, 0.2 + 0.01 * cycle)
    for thread in threads:
        thread.join()
    assert len(found) == 40
    for causes in found:
        for one, other in zip(causes, expected):
            assert_same(one, other)

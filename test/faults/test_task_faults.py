# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A task of another package that fails is named, and the robot stops or the rest goes on."""

import inspect
from itertools import repeat
import math
from types import SimpleNamespace

import numpy as np
import pytest
import robots
from tp_controller import Controller, EvaluationError, GoalError, Settings, Stack, StackError
from tp_controller.control.sketcher import Sketcher
from tp_controller.solver.level import Level
from tp_controller.tasks import BoundedTask, Evaluation, Keys, Posture, Task
from tp_controller.tasks import task_errors as guard
from tp_controller.tasks.sketch import Dot

N = 3
GOAL = (0.5, 0.2, -0.4)
# {method: what the fault says}, for all that is called in a cycle.
CALLED = {'start': 'start raised', 'value': 'start raised', 'evaluate': 'evaluate raised',
          'make_evaluation': 'evaluate raised', 'error': 'evaluate raised',
          'jacobian': 'evaluate raised', 'velocity': 'evaluate raised',
          'feed_forward': 'evaluate raised'}
# {what is wrong: (what evaluate makes of a good answer, what the fault says)}
ANSWERS = {
    'nothing': (lambda good: None, 'must return an Evaluation of the task, got NoneType'),
    'another type': (lambda good: (good.level, good.error), 'got tuple'),
    'of another task': (lambda good: Evaluation(None, good.level, good.error), 'of the task'),
    'no level': (lambda good: replaced(good, level=None), 'its level: needs J (m, n) and v (m,)'),
    'a J of lists': (lambda good: level(good, J=[[1.0], [1.0, 2.0]]), 'its level: J must be'),
    'a J of text': (lambda good: level(good, J='J'), 'its level: J must be'),
    'a flat J': (lambda good: level(good, J=np.ones(N)), 'J must be (m, n), got an array of'),
    'a narrow J': (lambda good: level(good, J=np.ones((N, 2))), 'must have 3 columns, got 2'),
    'a high J': (lambda good: level(good, J=np.ones((4, N))), 'got (4, 3) and (3,)'),
    'a column for v': (lambda good: level(good, v=np.ones((N, 1))), 'got an array of shape'),
    'no v': (lambda good: level(good, v=None), 'its level: needs v, or a bound'),
    'bounds': (lambda good: replaced(good, level=Level(np.eye(N), lower=-np.ones(N))),
               'its level must have a velocity'),
    'NaN in J': (lambda good: level(good, J=np.full((N, N), math.nan)), 'not finite'),
    'inf in v': (lambda good: level(good, v=np.full(N, math.inf)), 'not finite'),
    'huge v': (lambda good: level(good, v=np.full(N, 1e200)), 'beyond 1e+100'),
    'complex v': (lambda good: level(good, v=1j * np.ones(N)), 'complex numbers'),
    'a mode': (lambda good: level(good, mode='rush'), "unknown mode 'rush'"),
    'no error': (lambda good: replaced(good, error=None), 'error must be an array of 3 finite'),
    'a short error': (lambda good: replaced(good, error=np.zeros(2)), 'array of 3 finite floats'),
    'NaN in the error': (lambda good: replaced(good, error=np.full(N, math.nan)), '3 finite'),
    'words for errors': (lambda good: replaced(good, error=np.array(['a'] * N)), '3 finite'),
    'names': (lambda good: replaced(good, row_names=['one']), 'a name for each of the 3 rows'),
    'a number for names': (lambda good: replaced(good, row_names=3), 'row_names must be')}
BOTH = ('stop', 'switch off')


def replaced(good, **changes):
    """Return an evaluation with other parts."""
    parts = {'level': good.level, 'error': good.error, 'row_names': good.row_names, **changes}
    return Evaluation(good.task, **parts)


def level(good, **changes):
    """Return an evaluation whose level has other parts."""
    parts = {'J': good.level.J, 'v': good.level.v, 'mode': good.level.mode, **changes}
    return replaced(good, level=Level(**parts))


class Faulty(Posture):
    """A posture that fails on demand."""

    type_name = ''
    # Method that raises, and what.
    broken, error_type = '', ZeroDivisionError
    answer = None

    def __getattribute__(self, name):
        """Return an attribute, or what fails in its place."""
        found = super().__getattribute__(name)
        if name != super().__getattribute__('broken'):
            return found

        def fail(*arguments, **options):
            raise super(Faulty, self).__getattribute__('error_type')('division by zero')
        fail.__name__ = name
        return fail

    def evaluate(self, state, now):
        """Return what is no use, if that is wanted."""
        good = super().evaluate(state, now)
        return good if self.answer is None else self.answer(good)


def controller_of(task_faults='stop', task_budget=math.inf):
    """Return a controller of a faulty task above a posture, and the faulty task."""
    robot = robots.planar()
    task = Faulty(robot, 'faulty')
    rest = Posture(robot, 'rest', target=dict(zip(robot.joint_names, GOAL)))
    settings = Settings(task_faults=task_faults, task_budget=task_budget, blend=0.0)
    return Controller(robot, Stack([[task], [rest]]), settings), task


def run(controller, cycles=1, q=np.zeros(N), start=0.0):
    """Return the last command of some cycles of a robot that follows exactly, and where it is."""
    for cycle in range(cycles):
        command = controller.update(q, start + 0.01 * cycle)
        q = q + 0.01 * command.velocity
    return command, q


def report_of(command, name='faulty'):
    """Return the report of a task."""
    return next(task for task in command.report.tasks if task.name == name)


def fail_in(task, method):
    """Let a method of a task raise from now on."""
    task.broken = method
    if method == 'feed_forward':
        task.set_feed_forward(np.zeros(N), 0.0)


@pytest.mark.parametrize('method', CALLED)
def test_robot_stops_where_a_task_raises_and_goes_on_once_it_does_not(method):
    controller, task = controller_of()
    fail_in(task, method)
    for _ in range(2):
        with pytest.raises(EvaluationError) as error:
            run(controller)
        assert str(error.value).startswith(f'task faulty: {CALLED[method]} ZeroDivisionError: ')
        assert (error.value.task, error.value.reason) == ('faulty', str(error.value)[13:])
    task.broken = ''
    assert report_of(run(controller)[0]).status == 'reached'


@pytest.mark.parametrize('method', CALLED)
def test_rest_goes_on_without_a_task_that_raises(method):
    controller, task = controller_of('switch off')
    fail_in(task, method)
    command, q = run(controller, 1000)
    assert np.allclose(q, GOAL, atol=1e-3)
    report = report_of(command)
    assert (report.status, report.level) == ('failed', None)
    assert report.reason == report.fault == f'{CALLED[method]} ZeroDivisionError: division by zero'
    assert report.phrases == (report.fault,)
    assert report.hint and report_of(command, 'rest').status == 'reached'
    assert command.report.reached


@pytest.mark.parametrize('policy', BOTH)
@pytest.mark.parametrize('kind', ANSWERS)
def test_answer_that_is_no_use_is_a_fault(kind, policy):
    controller, task = controller_of(policy)
    run(controller)
    task.answer, message = ANSWERS[kind]
    if policy == 'stop':
        with pytest.raises(EvaluationError) as error:
            run(controller)
        found = error.value.reason
    else:
        command, _ = run(controller)
        assert np.isfinite(command.velocity).all()
        found = report_of(command).reason
    assert message in found and len(found) < 300


@pytest.mark.parametrize('error_type', [
    RecursionError, MemoryError, StopIteration, AssertionError, KeyError, GoalError, OSError,
    np.linalg.LinAlgError, UnicodeError, Warning])
def test_any_exception_is_a_fault(error_type):
    controller, task = controller_of('switch off')
    task.broken, task.error_type = 'evaluate', error_type
    assert 'division by zero' in report_of(run(controller)[0]).reason


def test_exception_without_a_message_is_one_with_its_type():
    class Mute(Exception):

        def __str__(self):
            raise ValueError

    controller, task = controller_of('switch off')
    task.broken, task.error_type = 'evaluate', Mute
    assert report_of(run(controller)[0]).reason == 'evaluate raised Mute: without a message'


def test_fault_stays_until_the_task_is_enabled_again():
    controller, task = controller_of('switch off')
    task.broken = 'evaluate'
    _, q = run(controller, 50)
    task.broken = ''
    command, q = run(controller, 50, q, 0.5)
    assert report_of(command).status == 'failed'
    controller.enable('faulty', False)
    assert report_of(run(controller, 1, q, 1.0)[0]).status == 'failed'
    controller.enable('faulty', True)
    command, _ = run(controller, 1, q, 1.1)
    assert (report_of(command).status, report_of(command).reason) == ('reached', '')


def test_task_that_still_fails_is_switched_off_again():
    controller, task = controller_of('switch off')
    task.broken = 'evaluate'
    run(controller)
    controller.enable('faulty', True)
    assert report_of(run(controller, 1, start=1.0)[0]).status == 'failed'


def test_new_stack_gives_a_task_another_chance():
    controller, task = controller_of('switch off')
    controller.enable('rest', False)
    task.broken = 'evaluate'
    run(controller)
    other = Faulty(robots.planar(), 'faulty')
    controller.replace_stack(Stack([[other], [controller.stack.tasks['rest']]]))
    reports = run(controller, 1, start=1.0)[0].report.tasks
    assert {task.name: task.status for task in reports} == {
        'faulty': 'reached', 'rest': 'disabled'}


def test_all_tasks_may_fail():
    robot = robots.planar()
    tasks = [Faulty(robot, name) for name in ('one', 'other')]
    for task in tasks:
        task.broken = 'evaluate'
    controller = Controller(robot, Stack([tasks]), Settings(task_faults='switch off'))
    command, _ = run(controller)
    assert not command.velocity.any()
    assert [task.status for task in command.report.tasks] == ['failed', 'failed']


def test_velocity_has_no_jump_where_a_task_is_switched_off():
    robot = robots.planar()
    task = Faulty(robot, 'faulty', target=dict(zip(robot.joint_names, GOAL)))
    controller = Controller(robot, Stack([[task]]), Settings(task_faults='switch off'))
    before, q = run(controller, 30)
    task.broken = 'evaluate'
    after, _ = run(controller, 1, q, 0.3)
    assert np.abs(before.velocity).max() > 0.05
    assert np.abs(after.velocity - before.velocity).max() < 0.01


# Tasks of this package


def test_task_of_this_package_that_raises_is_named(monkeypatch):
    controller, _ = controller_of('switch off')
    rest = controller.stack.tasks['rest']
    run(controller)
    with monkeypatch.context() as patch:
        patch.setattr(rest, 'evaluate', lambda state, now: 1 / 0)
        assert report_of(run(controller)[0], 'rest').reason.endswith(
            'raised ZeroDivisionError: division by zero')


@pytest.mark.parametrize('where', ['with a task of another package', 'alone'])
def test_velocity_that_is_not_finite_is_never_commanded(where, monkeypatch):
    robot = robots.planar()
    task = Posture(robot, 'rest')
    stack = [[task]] + ([[Faulty(robot, 'faulty')]] if where != 'alone' else [])
    controller = Controller(robot, Stack(stack))
    run(controller)
    monkeypatch.setattr(task, 'error', lambda state: np.full(N, math.nan))
    with pytest.raises(EvaluationError, match='task rest: its level: .* not finite'):
        run(controller)


# Time


class Clock:
    """A clock that a task turns."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(guard.time, 'perf_counter', lambda: self.now)

    def turn(self, task, seconds):
        """Let the evaluation of a task take a time from now on."""
        def answer(good):
            self.now += seconds
            return good

        task.answer = answer


@pytest.mark.parametrize('policy', BOTH)
def test_task_that_takes_too_long_again_and_again_is_a_fault(policy, monkeypatch):
    controller, task = controller_of(policy, task_budget=0.5)
    Clock(monkeypatch).turn(task, 0.006)
    run(controller, 2)
    reason = 'evaluate took more than 5 ms in 3 cycles in a row, now 6 ms'
    if policy == 'stop':
        with pytest.raises(EvaluationError, match=f'task faulty: {reason}'):
            run(controller)
        run(controller, 2)
    else:
        assert report_of(run(controller)[0]).reason == reason
        controller.enable('faulty', True)
        assert report_of(run(controller, 2)[0]).status == 'reached'
        assert report_of(run(controller)[0]).status == 'failed'


@pytest.mark.parametrize('budget, seconds', [(0.5, 0.004), (math.inf, 100.0)])
def test_task_that_is_fast_enough_is_none(budget, seconds, monkeypatch):
    controller, task = controller_of(task_budget=budget)
    Clock(monkeypatch).turn(task, seconds)
    run(controller, 10)


def test_cycle_in_time_ends_the_count(monkeypatch):
    controller, task = controller_of(task_budget=0.5)
    clock = Clock(monkeypatch)
    for _ in range(5):
        clock.turn(task, 1.0)
        run(controller, 2)
        clock.turn(task, 0.0)
        run(controller)


def test_budget_follows_the_settings(monkeypatch):
    controller, task = controller_of(task_budget=math.inf)
    Clock(monkeypatch).turn(task, 0.006)
    run(controller, 5)
    controller.settings = Settings(task_budget=0.5)
    with pytest.raises(EvaluationError):
        run(controller, 3)
    controller.settings = Settings(task_budget=0.5, period=0.02)
    run(controller, 5)
    other = Stack([[Faulty(robots.planar(), 'faulty')]])
    controller.settings = Settings(task_budget=0.5)
    controller.replace_stack(other)
    Clock(monkeypatch).turn(other.tasks['faulty'], 0.006)
    with pytest.raises(EvaluationError):
        run(controller, 3)


# Goals, stacks and reports


@pytest.mark.parametrize('method, call', [
    ('parse_goal', lambda controller: controller.set_goal('faulty', GOAL, 0.0)),
    ('set_goal', lambda controller: controller.set_goal('faulty', GOAL, 0.0)),
    ('goal_remarks', lambda controller: controller.set_goal('faulty', GOAL, 0.0)),
    ('parse_feed_forward', lambda controller: controller.set_feed_forward('faulty', GOAL, 0.0)),
    ('set_feed_forward', lambda controller: controller.set_feed_forward('faulty', GOAL, 0.0))])
def test_goal_that_a_task_fails_to_take_is_refused(method, call):
    controller, task = controller_of()
    run(controller)
    task.broken = method
    with pytest.raises(GoalError, match=f'task faulty: {method} raised ZeroDivisionError: '):
        call(controller)
    assert report_of(run(controller)[0]).status == 'reached'


def test_goal_before_stays_in_force_where_a_new_one_fails():
    controller, task = controller_of()
    run(controller)
    controller.set_goal('faulty', GOAL, 0.0)
    for method in ('parse_goal', 'goal_remarks', 'with_goal'):
        if method == 'with_goal':
            controller.settings = Settings(largest_turn=3.0)
        task.broken = method
        with pytest.raises(GoalError, match='raised ZeroDivisionError: division by zero'):
            controller.set_goal('faulty', np.zeros(N), 0.0)
        task.broken = ''
        assert np.array_equal(task.goal, GOAL)


class FaultyPlace(Task):
    """A task about a frame that fails with goals in other frames, and their markers."""

    frame, reference, goal_type = 'link3', 'base_link', 'point'

    def __init__(self, robot, name, **common):
        keys = Keys()
        super().__init__(robot, name, ['m'], keys, **common)
        keys.raise_faults(name)

    def value(self, state):
        """Return the x coordinate."""
        return state.position(self.frame)[:1]

    def error(self, state):
        """Return the distance to the goal."""
        return self.goal - self.value(state)

    def jacobian(self, state):
        """Return its derivative."""
        return state.jacobian(self.frame)[:1]

    def parse_goal(self, goal):
        """Return any goal."""
        return np.atleast_1d(goal)

    def parse_feed_forward(self, velocity):
        """Return any velocity."""
        return np.atleast_1d(velocity)

    def goal_in_reference(self, goal, T_reference_frame):
        """Fail."""
        raise ZeroDivisionError

    def feed_forward_in_reference(self, velocity, R_reference_frame):
        """Fail."""
        raise ZeroDivisionError

    def goal_pose(self, state):
        """Fail."""
        raise ZeroDivisionError

    def goal_place(self, goal, state):
        """Fail."""
        raise ZeroDivisionError


def test_frames_of_goals_and_markers_may_fail_too():
    robot = robots.planar()
    controller = Controller(robot, Stack([[FaultyPlace(robot, 'place')],
                                          Stack.from_yaml('- tip: {type: position, frame: link3}',
                                                          robot).groups[0]]))
    run(controller)
    with pytest.raises(GoalError, match='goal_in_reference raised ZeroDivisionError'):
        controller.set_goal('place', 0.1, 0.0, frame='link1')
    with pytest.raises(GoalError, match='feed_forward_in_reference raised ZeroDivisionError'):
        controller.set_feed_forward('place', 0.1, 0.0, frame='link1')
    controller.settings = Settings(largest_jump=10.0)
    with pytest.raises(GoalError, match='raised ZeroDivisionError'):
        controller.set_goal('place', 0.1, 0.0)


@pytest.mark.parametrize('method', ['sketch', 'goal_pose', 'goal_place', 'probe'])
def test_task_that_cannot_be_drawn_is_left_out_and_named(method, monkeypatch):
    robot, refused = robots.planar(), []
    sketcher = Sketcher(robot, lambda *told: refused.append(told))
    stack = Stack.from_yaml('- [tip: {type: position, frame: link3}, two: {type: position, frame: '
                            'link2}]', robot)
    controller = Controller(robot, stack)
    assert sketcher.sketch(controller) == {}
    before, _ = run(controller)
    monkeypatch.setattr(stack.tasks['tip'], method, lambda *arguments: 1 / 0)
    drawn = sketcher.sketch(controller)
    assert drawn['tip'] == [] and [each.part for each in drawn['two']] == ['frame', 'goal']
    assert refused == [('tip', 'sketch raised ZeroDivisionError: division by zero')]
    after, _ = run(controller)
    assert np.array_equal(before.velocity, after.velocity)
    assert report_of(after, 'tip').status == 'reached'


def test_task_that_draws_without_end_is_drawn_in_part(monkeypatch):
    robot = robots.planar()
    controller, task = controller_of()
    run(controller)
    monkeypatch.setattr(task, 'sketch', lambda state: repeat(None))
    assert 0 < len(Sketcher(robot, pytest.fail).sketch(controller)['faulty']) < 1000


def test_task_that_takes_too_long_to_draw_is_not_drawn_any_more(monkeypatch):
    robot, refused, clock, drawn = robots.planar(), [], SimpleNamespace(now=0.0, step=0.0), []
    monkeypatch.setattr('tp_controller.control.sketcher.time',
                        SimpleNamespace(monotonic=lambda: clock.now))
    sketcher = Sketcher(robot, lambda *told: refused.append(told))
    controller, task = controller_of()
    run(controller)

    def sketch(state):
        clock.now += clock.step
        drawn.append(clock.now)
        return [Dot('frame', np.zeros(3))]

    monkeypatch.setattr(task, 'sketch', sketch)
    # Now and then it may: the machine may have stood still.
    for clock.step in (0.3, 0.3, 0.1, 0.3, 0.3):
        assert len(sketcher.sketch(controller)['faulty']) == 1
    assert not refused
    sketcher.sketch(controller)
    assert refused == [('faulty', 'sketch took more than 0.2 s, 3 times in a row')]
    assert sketcher.sketch(controller)['faulty'] == [] and len(drawn) == 6
    # Another task of that name is tried again.
    other, task = controller_of()
    run(other)
    monkeypatch.setattr(task, 'sketch', sketch)
    assert len(sketcher.sketch(other)['faulty']) == 1 and len(refused) == 1


def test_reason_is_found_without_a_task_that_cannot_be_tried_elsewhere(monkeypatch):
    robot, tried = robots.planar(), []
    task = FaultyPlace(robot, 'place', gain=5.0)
    controller = Controller(robot, Stack([[task]]), Settings(blend=0.0))

    def probe():
        tried.append(task)
        raise ZeroDivisionError

    monkeypatch.setattr(task, 'probe', probe)
    monkeypatch.setattr(task, 'goal_remarks', lambda goal, converted: ())
    controller.set_goal('place', 100.0, 0.0)
    command, _ = run(controller, 1500, np.array([0.3, 0.2, -0.4]))
    assert report_of(command, 'place').status == 'limited' and tried


def test_task_that_fails_to_reset_cannot_be_enabled_and_stops_no_other(monkeypatch):
    controller, task = controller_of()
    run(controller)
    controller.enable('faulty', False)
    task.broken = 'reset'
    with pytest.raises(GoalError, match='reset raised ZeroDivisionError'):
        controller.enable('faulty', True)
    reset = []
    monkeypatch.setattr(controller.stack.tasks['rest'], 'reset', lambda: reset.append('rest'))
    with pytest.raises(EvaluationError, match='task faulty: reset raised'):
        controller.restart()
    assert reset == ['rest']


def test_task_that_fails_to_forget_its_goal_keeps_no_other_from_it():
    controller, task = controller_of()
    run(controller)
    task.broken = 'forget_goal'
    with pytest.raises(EvaluationError, match='task faulty: forget_goal raised'):
        controller.forget_goals()
    assert controller.stack.tasks['rest'].goal is None


@pytest.mark.parametrize('method', ['inherit_goal', 'is_compatible'])
def test_stack_with_a_task_that_fails_to_inherit_its_goal_is_refused(method):
    controller, _ = controller_of()
    run(controller)
    before = controller.stack
    task = Faulty(robots.planar(), 'faulty')
    task.broken = method
    with pytest.raises(EvaluationError, match='task faulty: inherit_goal raised'):
        controller.replace_stack(Stack([[task]]))
    assert controller.stack is before
    run(controller)


def test_task_that_cannot_be_compared_counts_as_another_one():
    controller, task = controller_of()
    run(controller)
    task.broken = 'is_equivalent'
    controller.replace_stack(Stack([[task]]))
    assert report_of(run(controller)[0]).status == 'reached'


@pytest.mark.parametrize('errors', [None, 3, [(1.0,)], [('a', 'm', 1.0)], [(1.0, 'm', None)]])
def test_errors_that_cannot_be_reported_are_named(errors, monkeypatch):
    controller, task = controller_of()
    monkeypatch.setattr(task, 'reported_errors', lambda error, residual: errors)
    report = report_of(run(controller)[0])
    assert (report.status, report.level) == ('failed', 1)
    assert 'raised TypeError' in report.reason or 'raised ValueError' in report.reason


def test_errors_that_are_numbers_in_disguise_are_reported_as_numbers(monkeypatch):
    controller, task = controller_of()
    monkeypatch.setattr(task, 'reported_errors', lambda error, residual: [('1.0', 'm', '2.0')])
    assert report_of(run(controller)[0]).errors == ((1.0, 'm', 2.0),)


class Missing(Posture):
    """A task whose constructor forgets that of its base."""

    def __init__(self, robot, name, *, gain=1.0):
        pass


class Raising(Posture):
    """A task whose constructor raises."""

    def __init__(self, robot, name, *, gain=1.0):
        raise ZeroDivisionError('division by zero')


class NoSignature(Posture):
    """A task whose keys cannot be found."""

    @classmethod
    def accepted_keys(cls):
        """Raise."""
        raise ZeroDivisionError('division by zero')


class NoTask(Posture):
    """A task that makes something else."""

    def __new__(cls, *arguments, **keys):
        """Return no task."""
        return 3


@pytest.mark.parametrize('task_type, message', [
    (Missing, 'type x: its constructor must call that of Task'),
    (NoTask, 'type x: its constructor must call that of Task'),
    (Raising, 'type x: ZeroDivisionError: division by zero'),
    (NoSignature, 'type x: ZeroDivisionError: division by zero')])
def test_type_that_cannot_be_made_is_a_fault_of_the_stack(task_type, message, monkeypatch):
    monkeypatch.setitem(Task.types, 'x', task_type)
    monkeypatch.setattr(task_type, 'type_name', 'x')
    with pytest.raises(StackError) as error:
        Stack.from_yaml('- rest: {type: posture}\n- a: {type: x}', robots.planar())
    assert str(error.value) == f'line 2: a: {message}'


def test_class_that_inherits_the_name_of_a_type_does_not_take_its_place():
    class Other(Posture):
        """A posture."""

    assert Task.types['posture'] is Posture
    assert Other.type_name == 'posture'


def test_all_that_a_task_can_override_is_covered():
    """A new method of `Task` needs a case here, or has to be none that a cycle calls."""
    covered = {*CALLED, 'parse_goal', 'set_goal', 'parse_feed_forward', 'set_feed_forward',
               'goal_remarks', 'out_of_reach', 'goal_place', 'sketch', 'with_goal',
               'goal_in_reference',
               'feed_forward_in_reference', 'goal_pose', 'reset', 'forget_goal',
               'inherit_goal',
               'is_compatible', 'is_equivalent', 'reported_errors', 'accepted_keys',
               'described_keys', 'probe', 'at_positions', 'forget_cycles'}
    # Called by those above, `level` in place of `make_evaluation`; where a parameter is set, which
    # is refused whatever they raise; by the constructor; for the pages about task types; by
    # `evaluate`; for types of this package only; and by trajectories and batches of goals.
    inner = {'level', 'in_rows', 'set_gain', 'parse_tolerance', 'set_tolerance', 'check_keys',
             'set_up', 'weight_names', 'key_ranges', 'complete', 'make_twin', 'watch',
             'forget_feed_forward', 'move_goal', 'from_rows', 'parse_goals', 'row_names_of'}
    methods = {name for name, member in inspect.getmembers(Task)
               if not name.startswith('_') and (inspect.isfunction(member)
                                                or inspect.ismethod(member))}
    assert methods == covered | inner


def test_bounds_are_checked_as_well():
    class Bounds(BoundedTask):
        """Bounds on the first joint, with a demand in their place."""

        def __init__(self, robot, name):
            super().__init__(robot, name, ['rad'], Keys(), -1.0, 1.0)

        def observe(self, state):
            """Return the first joint."""
            return state.q[:1], np.eye(N)[:1]

        def parse_goal(self, goal):
            """Take none."""
            raise GoalError('none')

    robot = robots.planar()
    task = Bounds(robot, 'bounds')
    controller = Controller(robot, Stack([[task]]))
    assert report_of(run(controller)[0], 'bounds').status == 'satisfied'
    task.make_evaluation = lambda state, now: Evaluation(
        task, Level(np.eye(N)[:1], np.zeros(1)), np.zeros(1))
    with pytest.raises(EvaluationError, match='its level must have bounds'):
        run(controller)

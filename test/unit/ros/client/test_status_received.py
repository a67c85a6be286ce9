# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The status that others send is bounded, and never raises."""

import math
from types import SimpleNamespace

import pytest
from tp_controller.ros.client.status import (
    ControllerStatus,
    MOST_RECEIVED_TASKS,
    MOST_TASK_CAUSES,
    MOST_TASK_ERRORS,
    MOST_VALUES,
    received,
    TaskStatus,
)

TASK = {
    'type': 'pose', 'level': '2', 'status': 'limited', 'error [m]': '0.1',
    'tolerance [m]': '0.001', 'error [rad]': '2', 'tolerance [rad]': '0.01',
    'wanted speed': '0.4', 'achieved speed': '0.3',
    'reason': 'blocked by a and the velocity limit of b together',
    'causes': 'blocked by a; b at its velocity limit', 'hint': 'wait', 'goals accepted': '3',
    'goals refused': '1', 'last refusal': 'not finite', 'goal warning': 'out of reach',
    'goal listeners': '2', 'twist listeners': '1', 'gain warning': 'too high',
    'progress': '0.25'}


def entry(name, text, values):
    """Return an entry of a message, which need not be of ROS."""
    return SimpleNamespace(name=name, message=text, values=[
        SimpleNamespace(key=key, value=value) for key, value in values.items()])


def status(head='running', values={}, **tasks):
    """Return the status in a message."""
    return received(SimpleNamespace(status=[
        entry('left/arm', head, values),
        *(entry(f'left/arm: {name}', '', task) for name, task in tasks.items())]))


def task(**values):
    """Return the status of a task with these values."""
    return status(tool=values).tasks['tool']


def test_every_key_of_a_task_has_its_field():
    assert task(**TASK) == TaskStatus(
        'tool', 'pose', '2', 'limited', {'m': 0.1, 'rad': 2.0}, {'m': 0.001, 'rad': 0.01}, 0.4,
        0.3, TASK['reason'], 'wait', ('blocked by a', 'b at its velocity limit'), 3, 1,
        'not finite', 'out of reach', 'too high', {'goal': 2, 'twist': 1}, 0.25)


def test_a_controller_is_known_by_its_keys_and_its_head():
    found = status(values={'scale': '1', 'limiting': '', 'overruns': '4'}, b=TASK, a=TASK)
    assert found.from_controller and found.name == 'left/arm' and found.stop_reason == ''
    assert found.values['overruns'] == '4' and list(found.tasks) == ['b', 'a']
    other = status('no joint states', {'scale': '1'})
    assert not other.from_controller and other.stop_reason == 'no joint states'
    assert received(SimpleNamespace(status=[])) == ControllerStatus('', '')


def test_without_causes_the_reason_is_the_only_one():
    assert task(reason='blocked by a; slowed by damping').causes == (
        'blocked by a; slowed by damping',)
    assert task(reason='').causes == task().causes == ()
    # The sentence of a newer one is about the same, so it is no cause beside them.
    assert task(reason='blocked by a', causes='').causes == ()


@pytest.mark.parametrize('text, value', [
    ('0.25', 0.25), ('-1e-3', -1e-3), ('inf', math.inf), ('nan', math.nan), ('abc', math.nan),
    ('', math.nan), ('1,5', math.nan), ('\x00', math.nan), ('9' * 2000, math.inf)])
def test_what_is_no_number_is_not_a_number(text, value):
    found = task(**{'error [m]': text, 'wanted speed': text})
    assert [found.errors['m'], found.wanted_speed] == pytest.approx([value] * 2, nan_ok=True)


@pytest.mark.parametrize('text, value', [
    ('3', 3), ('-3', 0), ('', 0), ('3.5', 0), ('9' * 5000, 0), ('many', 0)])
def test_what_is_no_count_is_zero(text, value):
    assert task(**{'goals refused': text}).answers == (0, value)


def test_what_is_kept_is_bounded_and_printable():
    found = status('x' * 10_000, **{f'a{number}\n' + 'b' * 1000: TASK for number in range(1000)})
    assert len(found.tasks) == MOST_RECEIVED_TASKS and len(found.head) < 2100
    assert all(len(name) < 300 and name.isprintable() for name in found.tasks)
    many = status(values={f'{number}\x1b' + 'k' * 1000: '\x07' for number in range(1000)})
    assert len(many.values) == MOST_VALUES and set(many.values.values()) == {'\ufffd'}
    assert all(len(key) < 300 and key.isprintable() for key in many.values)
    few = task(**{f'error [{unit}]': '1' for unit in range(1000)})
    assert len(few.errors) == MOST_TASK_ERRORS
    assert task(**{'error [': '1'}).errors == {'': 1.0}
    assert len(task(causes='; '.join('abc' * 500)).causes) == MOST_TASK_CAUSES


def test_a_warning_that_the_reason_contains_is_not_repeated():
    assert task(**TASK).warnings == ['out of reach', 'too high']
    assert task(**TASK | {'reason': 'out of reach by 1 m'}).warnings == ['too high']


def test_summary_names_joints_that_are_locked():
    for locked, said in (('', 'running'), ('joint1, joint3', 'running, locked: joint1, joint3')):
        assert ControllerStatus('/c', 'running', {'locked': locked}).summary == said

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Stacks as lists and mappings: the stacks of the same YAML, and faults with their entries."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Controller, Stack, StackError
from tp_controller.resources import load_yaml
from tp_controller.tasks.stack_entries import yaml_of
import yaml

TOOL = {'type': 'pose', 'frame': robots.PANDA_TOOL, 'gain': 1.5, 'axes': 'xyz'}


def test_a_list_is_the_stack_of_the_same_yaml():
    robot = robots.panda()
    entries = [[{'limits': {'type': 'joint_limits', 'margin': 0.05}}], {'tool': TOOL},
               [{'a': {'type': 'position', 'frame': 'panda_link4', 'axes': 'z'}},
                {'rest': {'type': 'posture', 'target': {'panda_joint4': -2.0}}}]]
    stack, other = Stack(entries, robot), Stack.from_yaml(yaml.dump(entries), robot)
    assert [[task.name for task in level] for level in stack.groups] == [
        ['limits'], ['tool'], ['a', 'rest']]
    assert stack.tasks['tool'].gain == 1.5
    # The text is that of the parameter `stack`, one line for each level.
    again = Stack.from_yaml(stack.text, robot)
    assert stack.text.count('\n') == 3
    state = robot.state(robots.PANDA_READY)
    for each in (stack, other, again):
        each.start(state)
    for level, same, third in zip(*(each.levels(state, 0.0) for each in (stack, other, again))):
        np.testing.assert_array_equal(level.J, same.J)
        np.testing.assert_array_equal(level.J, third.J)
        assert level.v is None or level.v.tolist() == same.v.tolist() == third.v.tolist()
    assert Controller(robot, stack).stack.text == stack.text


def test_numpy_tuples_and_paths_are_values():
    target = dict(zip(robots.panda().joint_names, np.array(robots.PANDA_READY)))
    stack = Stack(({'tool': {**TOOL, 'gain': np.float32(2.0)}},
                   {'rest': {'type': 'posture', 'target': target, 'gain': np.array(0.5)}},
                   {'look': {'type': 'pointing', 'frame': robots.PANDA_TOOL,
                             'axis': np.array([0.0, 0.0, 1.0]), 'target': (1, 0.0, 2.0)}}),
                  robots.panda())
    assert stack.tasks['tool'].gain == 2.0 and stack.tasks['rest'].gain == 0.5
    with pytest.raises(StackError, match="file: .*'x.yaml'|x.yaml|unknown key 'file'"):
        Stack([{'rest': {'type': 'posture', 'file': Path('x.yaml')}}], robots.panda())


@pytest.mark.slow
@given(st.text(st.characters(exclude_categories=['Cs']), max_size=20)
       | st.floats(allow_nan=False, allow_infinity=False) | st.integers(-10 ** 9, 10 ** 9)
       | st.sampled_from(['1e3', '1e-3', '.5', 'yes', 'null', '~', '2001-01-01', '0x1', '- a']))
def test_values_are_read_as_they_are(value):
    entries = [{'a': {'key': value}}, [{'b': {'list': [value, value]}}]]
    text = yaml_of(entries)
    assert load_yaml(text) == entries and text.count('\n') == 2
    assert type(load_yaml(text)[0]['a']['key']) is type(value)


@pytest.mark.parametrize('entries, message', [
    ([{'tool': {**TOOL, 'gian': 1.0}}], "^tool: unknown key 'gian' .did you mean 'gain'"),
    ([{'a': {'type': 'posture'}}, {'b': {'type': 'pos'}}, {'c': {'type': 'pos'}}],
     "^b: unknown type 'pos'.*; valid: .*; c: unknown type 'pos'.*valid types: see entry 2"),
    ([{'a': {'type': 'posture'}}, {'a': {'type': 'posture'}}], 'used already, in entry 1'),
    ([{'a': {'type': 'posture'}}, {}], '^entry 2: a stack must be a list'),
    ([[]], '^entry 1: a level needs'), ([5], '^entry 1: '), ([{'a': 5}], '^a: needs a mapping'),
    ([{'a': {'type': 'posture'}}, {'b': {'type': object}}],
     "^entry 2: needs numbers, texts, lists and mappings, not <class 'object'> .type.$"),
    ([{(1, 2): {}}], r'^entry 1: a key must be a text, not \(1, 2\) \(tuple\)'),
    ([{'a': {'type': 'posture', 'gain': float('nan')}}], '^a, gain: .*got nan'),
    ([{'a': {'type': 'x' * 300_000}}], '^a text of .* characters; at most 250000 are read'),
    ([{'a': {'type': 10 ** 5000}}], '^entry 1: Exceeds the limit'),
    ({'tool': TOOL}, "^a stack must be a list such as .*; got {'tool'.*dict"),
    ('[]', '^a stack must be a list such as'), (None, 'got None')])
def test_faults_are_named_with_their_entries(entries, message):
    with pytest.raises(StackError, match=message):
        Stack(entries, robots.panda())


def test_a_list_inside_itself_is_refused():
    entries = [{'a': {'type': 'posture'}}]
    entries.append(entries)
    with pytest.raises(StackError, match='^entry 2: nested too deeply'):
        Stack(entries, robots.panda())


def test_a_list_without_a_robot_is_told_of_it():
    with pytest.raises(StackError, match=r'a list of mappings is read by Stack\(list, robot\)'):
        Stack([{'tool': TOOL}])
    with pytest.raises(StackError, match="needs a Robot, got 'text' .str"):
        Stack([], 'text')


def test_an_empty_list_is_an_empty_stack():
    stack = Stack([], robots.panda())
    assert stack.tasks == {} and Stack.from_yaml(stack.text, robots.panda()).tasks == {}

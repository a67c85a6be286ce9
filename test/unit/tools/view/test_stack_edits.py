# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What is changed in the text of a stack changes nothing else there."""

import itertools

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.resources import load_yaml
from tp_controller.tools.view.stack_edits import moved, numbers, stack_text, with_number
import yaml

TEXT = """\
# What this stack is for.
- first: {type: pose, frame: tip, gain: 2.0}  # at the end of a line
# Above the second.
# In two lines.
- [left: {type: position, frame: tip}, right: {type: position, frame: tool}]
- third:
    type: posture
    target: {joint1: 0.1}
"""
NAMES = [['first'], ['left', 'right'], ['third']]


def test_a_level_moves_with_its_comments_and_its_neighbours_stay_as_they_are():
    assert moved(TEXT, 'right', -1) == """\
# What this stack is for.
# Above the second.
# In two lines.
- [left: {type: position, frame: tip}, right: {type: position, frame: tool}]
- first: {type: pose, frame: tip, gain: 2.0}  # at the end of a line
- third:
    type: posture
    target: {joint1: 0.1}
"""


@pytest.mark.parametrize('task, step', list(itertools.product(
    ('first', 'left', 'right', 'third'), (-2, -1, 0, 1, 2))))
def test_only_the_order_of_the_entries_changes(task, step):
    entries = yaml.safe_load(TEXT)
    place = next(number for number, names in enumerate(NAMES) if task in names)
    order = [number for number in range(3) if number != place]
    order.insert(min(max(place + step, 0), 2), place)
    text = moved(TEXT, task, step)
    assert yaml.safe_load(text) == [entries[number] for number in order]
    assert sorted(text.splitlines()) == sorted(TEXT.splitlines())


def test_a_task_at_the_top_cannot_go_higher():
    assert moved(TEXT, 'first', -1) == TEXT
    assert moved(TEXT, 'third', 1) == TEXT


@pytest.mark.parametrize('text', [
    '[{a: {type: x}}, {b: {type: y, gain: 1.0}}, [{c: {type: z}}, {d: {type: z}}]]',
    '- a: &same {type: x}\n- b: *same\n- [c: {type: z}, d: {type: z}]\n',
    '- {a: {type: x}}\n- {b: {type: y}}\n- [c: {type: z}, d: {type: z}]'])
@pytest.mark.parametrize('task, order', [('b', (1, 0, 2)), ('d', (0, 2, 1))])
def test_stacks_in_other_notations_keep_what_they_say(text, task, order):
    entries = yaml.safe_load(text)
    assert yaml.safe_load(moved(text, task, -1)) == [entries[number] for number in order]


@pytest.mark.parametrize('text, said', [
    (TEXT, "no task 'fourth'"), ('a: 1\n', 'not a list'), ('- [', 'cannot be read')])
def test_what_cannot_be_moved_is_said(text, said):
    with pytest.raises(TpControllerError, match=said):
        moved(text, 'fourth', 1)


def test_numbers_are_those_of_the_stack_and_the_defaults_of_the_types():
    found = numbers("""\
- [apart: {type: self_collision, distance: 0.04}, eye: {type: field_of_view, half_angle: 1}]
- tip: {type: position, gain: [1.0, 2.0, 3.0], axes: xyz}
- own: {type: of_another_package, distance: 0.1}
- broken
""")
    assert found['apart']['distance'] == 0.04 and found['apart']['within'] == 0.2
    assert found['eye']['half_angle'] == 1.0
    assert set(found) == {'apart', 'eye', 'tip'} and 'gain' not in found['tip']


@pytest.mark.parametrize('task, key, line', [
    ('first', 'gain', '- first: {type: pose, frame: tip, gain: 0.25}  # at the end of a line'),
    ('left', 'gain', '- [left: {type: position, gain: 0.25, frame: tip}, '
                     'right: {type: position, frame: tool}]'),
    ('third', 'gain', '    gain: 0.25')])
def test_a_number_changes_where_it_is_or_is_added_and_nothing_else(task, key, line):
    text = with_number(TEXT, task, key, 0.25)
    changed = set(text.splitlines()) - set(TEXT.splitlines())
    assert changed == {line}
    assert numbers(text)[task][key] == 0.25
    assert [entry for entry in yaml.safe_load(text) if task not in str(entry)] == [
        entry for entry in yaml.safe_load(TEXT) if task not in str(entry)]


@pytest.mark.parametrize('text', [
    '[{a: {type: posture}}, {b: {type: posture, gain: 1.0}}]',
    '- a: &same {type: posture, gain: 1.0}\n- b: *same\n',
    '- a: {type: posture}\n- b:\n    type:  # of several lines\n      posture\n    gain: 3\n'])
@pytest.mark.parametrize('value', [0.25, 1e-5])
def test_stacks_in_other_notations_get_the_number_of_one_task(text, value):
    entries = yaml.safe_load(text)
    entries[1] = {'b': {**entries[1]['b'], 'gain': value}}
    assert load_yaml(with_number(text, 'b', 'gain', value)) == entries


@pytest.mark.parametrize('text, said', [
    (TEXT, "no task 'fourth'"), ('a: 1\n', 'not a list'), ('- [', 'cannot be read')])
def test_number_that_cannot_be_set_is_said(text, said):
    with pytest.raises(TpControllerError, match=said):
        with_number(text, 'fourth', 'gain', 1.0)


def test_text_of_a_file_is_its_content_and_a_missing_file_is_said(tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text(TEXT)
    assert stack_text(str(path)) == TEXT
    assert stack_text(TEXT) == TEXT
    with pytest.raises(TpControllerError, match='not available'):
        stack_text(str(tmp_path / 'elsewhere.yaml'))

# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Another order of tasks changes nothing else in the text of a stack."""

import itertools

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.view.reorder import levels, moved, stack_text
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


def test_levels_are_named_in_order_of_priority():
    assert levels(TEXT) == NAMES


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
    (TEXT, "no task 'fourth'"), ('a: 1\n', 'no list'), ('- [', 'cannot be read')])
def test_what_cannot_be_moved_is_said(text, said):
    with pytest.raises(TpControllerError, match=said):
        moved(text, 'fourth', 1)


def test_text_of_a_file_is_its_content_and_a_missing_file_is_said(tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text(TEXT)
    assert stack_text(str(path)) == TEXT
    assert stack_text(TEXT) == TEXT
    with pytest.raises(TpControllerError, match='not at hand'):
        stack_text(str(tmp_path / 'elsewhere.yaml'))

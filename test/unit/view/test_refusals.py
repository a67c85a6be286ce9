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

"""What ROS says of a value that is refused is told in plain words."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from tp_controller.view.refusals import refusal_in_words  # noqa: E402


@pytest.mark.parametrize('reason, words', [
    ('Parameter tasks.rest.gain out of range. Min: 0.0, Max: inf, value: -3.0',
     'the gain of task rest must be at least 0, not -3'),
    ('Parameter tasks.a.gain out of range. Min: 0.0, Max: 100.0, value: 500.0',
     'the gain of task a must be from 0 to 100, not 500'),
    ('Parameter damping out of range. Min: -inf, Max: 1.0, value: 2.0',
     'the damping must be at most 1, not 2'),
    ('Parameter rate out of range Min: 1, Max: 10, value: 11', 'the rate must be from 1 to 10, '
     'not 11'),
    ('Parameter rate out of range. Min: a, Max: b, value: c', 'Parameter rate out of range. '
     'Min: a, Max: b, value: c'),
    ('no valid stack: line 1', 'no valid stack: line 1')])
def test_a_value_out_of_range_is_refused_in_plain_words(reason, words):
    assert refusal_in_words(reason) == words

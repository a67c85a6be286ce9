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

"""Texts and numbers of others only show what they say, and never raise."""

import math

import pytest
from tp_controller.untrusted import count, errors_of, LONGEST_TEXT, MOST_TASK_ERRORS, number, plain


@pytest.mark.parametrize('text, shown', [
    ('', ''), ('blocked by tool, 0.4 m · °', 'blocked by tool, 0.4 m · °'),
    ('机械臂 бот', '机械臂 бот'),
    # Escape sequences, bells, carriage returns, C1 codes.
    ('\x1b]0;title\x07', '\ufffd]0;title\ufffd'), ('a\rb\x9b2Jc\x7f', 'a\ufffdb\ufffd2Jc\ufffd'),
    # Directions, invisible characters, half of a character.
    ('\u202eabc\u2066\u200f', '\ufffdabc\ufffd\ufffd'), ('a\u200bb\ufeff', 'a\ufffdb\ufffd'),
    ('\ud800', '\ufffd'), ('\U000e0041', '\ufffd'), ('\u2028\u2029\x85', '\ufffd' * 3),
    # Other spaces.
    ('1\xa0m\tx', '1 m x'), ('a\nb', 'a\ufffdb')])
def test_a_text_shows_what_it_says(text, shown):
    assert plain(text) == shown
    assert plain(shown) == shown
    plain(text).encode()


def test_lines_stay_where_they_may():
    assert plain('a\n\x1bb', lines=True) == 'a\n\ufffdb'


def test_every_character_is_shown_or_replaced():
    everything = ''.join(map(chr, range(0x110000)))
    shown = plain(everything, len(everything))
    assert len(shown) == len(everything) and shown.isprintable()


def test_a_long_text_is_cut_off():
    assert plain('x' * 10_000_000) == 'x' * LONGEST_TEXT + ' …'
    assert plain('abc', 3) == 'abc' and plain('abcd', 3) == 'abc …'


@pytest.mark.parametrize('text, value', [
    ('0.25', 0.25), ('-1e-3', -1e-3), ('inf', math.inf), ('nan', math.nan), ('abc', math.nan),
    ('', math.nan), ('1,5', math.nan), ('\x00', math.nan), ('9' * 5000, math.inf)])
def test_what_is_no_number_is_not_a_number(text, value):
    assert number(text) == pytest.approx(value, nan_ok=True)


@pytest.mark.parametrize('text, value', [
    ('3', 3), ('-3', 0), ('', 0), ('3.5', 0), ('9' * 5000, 0), ('many', 0)])
def test_what_is_no_count_is_zero(text, value):
    assert count(text) == value


def test_errors_are_those_of_a_status():
    assert errors_of({'type': 'pose', 'error [m]': '0.1', 'error [rad]': '2'}) == {
        'm': 0.1, 'rad': 2.0}
    assert math.isnan(errors_of({'error [m]': 'abc'})['m'])
    assert errors_of({'error [': '1'}) == {'': 1.0}
    assert len(errors_of({f'error [{unit}]': '1' for unit in range(1000)})) == MOST_TASK_ERRORS

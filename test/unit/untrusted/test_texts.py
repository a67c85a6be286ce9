# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Texts of others only show what they say, and never raise."""

import pytest
from tp_controller.untrusted.texts import LONGEST_TEXT, plain


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


@pytest.mark.slow
def test_every_character_is_shown_or_replaced():
    everything = ''.join(map(chr, range(0x110000)))
    shown = plain(everything, len(everything))
    assert len(shown) == len(everything) and shown.isprintable()


def test_a_long_text_is_cut_off():
    assert plain('x' * 10_000_000) == 'x' * LONGEST_TEXT + ' …'
    assert plain('abc', 3) == 'abc' and plain('abcd', 3) == 'abc …'

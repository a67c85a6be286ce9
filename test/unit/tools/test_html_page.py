# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Pages show texts as they are, and bounded tables."""

from tp_controller.tools.html_page import Cell, MOST_ROWS, page, table


def test_a_page_shows_texts_as_they_are():
    rows = [('</td>', Cell('1', 'number'))]
    text = page('<$title>', 'a & b\x1b', table('$x', ('<i>', 'n'), rows))
    for shown in ('<title>&lt;$title&gt;</title>', '<h1>&lt;$title&gt;</h1>', 'a &amp; b\ufffd',
                  '<h2>$x</h2>', '<tr><th>&lt;i&gt;</th><th>n</th></tr>',
                  '<tr><td>&lt;/td&gt;</td><td class="number">1</td></tr>'):
        assert shown in text


def test_a_share_has_a_bar_of_its_length():
    text = ''.join(table('', (), [(Cell('50%', 'number', 50.0), Cell('wrong'))]))
    assert '<td class="number" style="--share: 50%">50%</td><td class="bad">wrong</td>' in text
    assert '<h2>' not in text and '<th' not in text


def test_a_table_is_bounded_and_counts_the_rest():
    assert list(table('title', ('name',), [])) == []
    text = ''.join(table('title', ('name',), [('row',)] * (MOST_ROWS + 3), 4))
    assert text.count('<td>row</td>') == MOST_ROWS and text.endswith('<p>… and 7 more.</p>')

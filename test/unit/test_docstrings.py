# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Docstrings begin with a noun or an action, not with a clause of what, whether or how."""

import ast
from pathlib import Path
import re

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / 'tp_controller'
QUESTION = r'(what|whatever|where|whether|how|who|whoever|why|when|which)\b'
# A verb, or nothing, before such a clause. 'Return whether ...' is how predicates are described.
HEAD = re.compile(rf'((?P<verb>\w+)\s+)?(of\s+)?{QUESTION}', re.IGNORECASE)
PREDICATE = re.compile(r'(Returns?|Checks?) whether\b', re.IGNORECASE)
RELATIVE = re.compile(r'\b(what|whatever|whoever|whichever)\b', re.IGNORECASE)
# In all docstrings together, per 1,000 words.
MOST_RELATIVES = 3.0


def docstrings(tree):
    """Yield (line, docstring) of a module, its classes and functions."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, 'lineno', 1), text


def is_clause(text):
    """Return whether a docstring begins with a clause in place of a noun or an action."""
    return bool(HEAD.match(text)) and not PREDICATE.match(text)


@pytest.mark.parametrize('path', sorted(PACKAGE.rglob('*.py')),
                         ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_docstrings_begin_with_a_noun_or_a_verb(path):
    tree = ast.parse(path.read_text(encoding='utf-8'))
    assert [(line, text.splitlines()[0]) for line, text in docstrings(tree)
            if is_clause(text)] == []


@pytest.mark.slow
def test_docstrings_have_few_free_relatives():
    texts = [text for path in PACKAGE.rglob('*.py')
             for _, text in docstrings(ast.parse(path.read_text(encoding='utf-8')))]
    words = sum(len(text.split()) for text in texts)
    assert words > 10_000
    assert 1e3 * sum(len(RELATIVE.findall(text)) for text in texts) / words <= MOST_RELATIVES


@pytest.mark.parametrize('text, expected', [
    ('What a level leaves free.', True), ('Return what is missing.', True),
    ('Of what is left, take the smallest.', True), ('Say whether it moves.', True),
    ('Return whether it moves.', False), ('Return the residual (m,).', False),
    ('Whole numbers of a row.', False), ('Joint-state buffer with age checks.', False)])
def test_a_clause_is_told_from_a_noun(text, expected):
    assert is_clause(text) is expected

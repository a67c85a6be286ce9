# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""docs/formulas.md leads from every formula of the sources to code and test, and back."""

import ast
from dataclasses import dataclass
from functools import reduce
import importlib
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'formulas.md'
PACKAGE = ROOT / 'tp_controller'
LINK = re.compile(r'\[`([^`]+)`\]\(\.\./([^)]+)\)')
HEADINGS = ('Questions', 'Properties', 'What defines a Task?', 'Joint Limit Avoidance',
            'Pseudoinverse Calculation and Singularity Damping', 'Measures of Manipulability',
            'Manipulability Gradient Estimation')
# A section, such as 2.2 or exercise 1, or a number: (3) or [3].
SECTION = '|'.join((r'exercise \d', *map(re.escape, HEADINGS), r'\d\.\d', r'\b4\b'))
NUMBER = r'\(\d+\)|\[\d+\]'
PLACE = rf'(?:{NUMBER}|{SECTION})'
RANGE = re.compile(r'([(\[])(\d+)([)\]])[–-][(\[](\d+)')
CITATION = re.compile(
    rf'\b(lecture|lab|wiki|slides|notes),?\s+({PLACE}(?:(?:,\s+|\s+and\s+|[–-]|\s+){PLACE})*)',
    re.IGNORECASE)


def numbered(form, last, section=''):
    """Return the places 1 … last of a section, such as 2.2 (1)."""
    return {f'{section} {form.format(number)}'.strip() for number in range(1, last + 1)}


# Sections with formulas, and numbers of formulas, that each document has; without numbers of its
# own, [n] is the n-th displayed formula.
EXPECTED = {
    'lecture': {'1.1', '1.2', '2.1', '2.2', '3.1', '3.2', '3.3', '3.4', '3.5', '4'}
    | numbered('({})', 7, '2.2') | numbered('({})', 6, '4'),
    'lab': {'exercise 1', 'exercise 2', 'Questions'} | numbered('[{}]', 2, 'exercise 1')
    | numbered('[{}]', 9, 'exercise 2') - numbered('[{}]', 2, 'exercise 2'),
    'wiki': numbered('[{}]', 30) | {*HEADINGS[2:]},
    'slides': numbered('({})', 51),
    'notes': numbered('[{}]', 11) | {'Properties'},
}


@dataclass(frozen=True)
class Row:
    """A row of the page: its document, places, and (name, file) of code and tests."""

    document: str
    places: frozenset
    code: tuple
    tests: tuple


def places(text):
    """Return the places that a text names: 2.2 (3)–(5) is 2.2, 2.2 (3), 2.2 (4), 2.2 (5)."""
    text = RANGE.sub(lambda match: ', '.join(
        f'{match[1]}{number}{match[3]}' for number in range(int(match[2]), int(match[4]) + 1)
    ).removesuffix(match[3]), text)
    found, section = set(), ''
    for place in re.findall(PLACE, text):
        if re.fullmatch(NUMBER, place):
            found.add(f'{section} {place}'.strip())
        else:
            section = place
            found.add(place)
    return found


def rows():
    """Return the rows of the tables with code and tests."""
    found = []
    for section in PAGE.read_text(encoding='utf-8').split('\n## ')[1:]:
        heading, _, text = section.partition('\n')
        if heading.lower() not in EXPECTED:
            continue
        for line in text.strip().splitlines()[2:]:
            where, _, code, tests = line.strip('| ').split(' | ')
            found.append(Row(heading.lower(), frozenset(places(where)),
                             tuple(LINK.findall(code)), tuple(LINK.findall(tests))))
    return found


ROWS = rows()


def docstrings(path):
    """Return the docstrings of a file."""
    return [ast.get_docstring(node) or ''
            for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef))]


# {file: {(document, place)}} of the docstrings of the package.
CITED = {path.relative_to(ROOT).as_posix(): {
    (document.lower(), place) for text in docstrings(path)
    for document, cited in CITATION.findall(text) for place in places(cited)}
    for path in sorted(PACKAGE.rglob('*.py'))}


@pytest.mark.parametrize('document', EXPECTED)
def test_every_formula_has_a_row(document):
    named = set().union(*(row.places for row in ROWS if row.document == document))
    assert named == EXPECTED[document]


@pytest.mark.parametrize('name, path', sorted({each for row in ROWS for each in row.code}))
def test_code_is_there(name, path):
    module = importlib.import_module(path.removesuffix('.py').replace('/', '.'))
    found = reduce(getattr, name.split('.'), module)
    assert found.__module__ == module.__name__


@pytest.mark.slow
@pytest.mark.parametrize('name, path', sorted({each for row in ROWS for each in row.tests}))
def test_proof_is_there(name, path):
    tree = ast.parse((ROOT / path).read_text(encoding='utf-8'))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_row_has_code_and_a_proof():
    assert len(ROWS) > 70
    assert [row for row in ROWS if not row.places or not row.code or not row.tests] == []


@pytest.mark.parametrize('path', sorted({path for row in ROWS for _, path in row.code}))
def test_code_names_the_formulas_of_its_rows(path):
    for row in ROWS:
        if path in {file for _, file in row.code}:
            assert CITED[path] & {(row.document, place) for place in row.places}, row


@pytest.mark.parametrize('path', [path for path, cited in CITED.items() if cited])
def test_formulas_that_code_names_lead_to_it(path):
    known = {(row.document, place) for row in ROWS for place in row.places
             if path in {file for _, file in row.code}}
    assert CITED[path] <= known


@pytest.mark.slow
def test_sources_are_named_with_places():
    for path in sorted(PACKAGE.rglob('*.py')):
        for text in docstrings(path):
            named = len(re.findall(r'\b(?:lecture|wiki)\b', text, re.IGNORECASE))
            assert named == sum(document.lower() in ('lecture', 'wiki')
                                for document, _ in CITATION.findall(text)), (path, text)


@pytest.mark.parametrize('text, found', [
    ('2.2 (3)–(5)', {'2.2', '2.2 (3)', '2.2 (4)', '2.2 (5)'}),
    ('(1)-(2), (7)', {'(1)', '(2)', '(7)'}),
    ('exercise 1 [1], exercise 2 [7]', {'exercise 1', 'exercise 1 [1]', 'exercise 2',
                                        'exercise 2 [7]'}),
    ('2.2, 4', {'2.2', '4'}), ('[3], [4]', {'[3]', '[4]'})])
def test_places_are_read(text, found):
    assert places(text) == found

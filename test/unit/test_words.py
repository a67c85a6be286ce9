# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
One term for one thing, and the field's own: words that grew here do not come back.

Whoever knows another library for differential inverse kinematics, or a book on robotics, is to
read names, docstrings, messages and pages without having to guess.
"""

import ast
from collections import defaultdict
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[2]
# {what is not written: what is written instead}
WORDS = {
    r'wish(es|ed)?': 'demand, desired velocity',
    r'wants|ask(s|ed|ing) for': 'demands, desired',
    r'held back': 'limited, blocked',
    r'g(iven|ives?|ave|iving) up|lets? go|released?|releases|releasing': 'relaxed',
    r'climb(s|ed|ing)?': 'maximize, objective',
    r'ke(pt|eps?|eping) bounds': 'inequality task, satisfied',
    r'turned aside': 'direction changed',
    r'slowed to': 'scaled to',
    r'(leads?|leading) over|(takes?|taking|taken|took) over': 'transition, blending',
    r'things?': 'object, obstacle, or what it is',
    r'attitudes?': 'orientation',
    r'room|ways? out': 'clearance, direction',
    r"(lab|lecture|textbook)'s|textbooks?": 'the exercise or equation, with its source',
    r'held|holds? (still|what)|on hold': 'stopped, default goal, zero-order hold',
}
FOUND = re.compile('|'.join(rf'\b({word})\b' for word in WORDS), re.IGNORECASE)
# Names that users have written into their files, and those of ROS tools and of a page.
NAMES = re.compile('release_region|catkin_prepare_release|bloom-release|RELEASING')
SUFFIXES = {'.md', '.py', '.yaml', '.xml', '.toml', '.cfg'}
# Texts that each node, or each command, has of its own: {name: pattern of their modules}.
OWN = {'NAME': r'.*_node\.py', 'EXAMPLES': r'tools/cli/.*'}
FOLDERS = ('tp_controller', 'config', 'docs', 'launch', 'benchmarks', 'test', 'scripts',
           'examples')


def texts():
    """Return the files that people read."""
    found = [path for path in ROOT.iterdir() if path.suffix in SUFFIXES]
    for folder in FOLDERS:
        found += [path for path in (ROOT / folder).rglob('*')
                  if path.suffix in SUFFIXES and '_build' not in path.parts]
    return sorted(path for path in found if path != Path(__file__).resolve())


def faults(text):
    """Return (line, word, what to write instead) for a text; a name is its words."""
    text = NAMES.sub('', text).replace('_', ' ')
    return [
        (text.count('\n', 0, match.start()) + 1, match.group(),
         list(WORDS.values())[next(
             index for index, word in enumerate(WORDS)
             if re.fullmatch(word, match.group(), re.IGNORECASE))])
        for match in FOUND.finditer(text)]


@pytest.mark.parametrize('path', texts(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_text_has_the_words_of_the_field(path):
    assert not faults(path.read_text(encoding='utf-8'))


@pytest.mark.parametrize(('text', 'word'), [
    ('its wish', 'wish'), ('the task\nis Held back', 'Held back'), ('one thing', 'thing'),
    ("the lab's gain", "lab's"), ('def wished_velocity', 'wished'),
    ('a direction is released', 'released')])
def test_a_word_that_grew_here_is_found(text, word):
    assert [found for _, found, _ in faults(text)] == [word]


@pytest.mark.parametrize('text', ['release_region', 'nothing', 'something else', 'the threshold'])
def test_other_words_are_left_alone(text):
    assert not faults(text)


def is_literal(value):
    """Return whether a value is a number, a text, or a tuple of them."""
    return all(map(is_literal, value)) if isinstance(value, tuple) \
        else isinstance(value, (int, float, str, bytes))


def constants(text):
    """Return {name: value} of the constants of a module that are literals, such as 2 ** 3."""
    found = {}
    for node in ast.parse(text).body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            pairs = zip(target.elts, node.value.elts) if isinstance(target, ast.Tuple) \
                and isinstance(node.value, ast.Tuple) else [(target, node.value)]
            for name, value in pairs:
                if not isinstance(name, ast.Name) or not name.id.isupper() or any(
                        isinstance(each, (ast.Name, ast.Call)) for each in ast.walk(value)):
                    continue
                given = eval(ast.unparse(value), {'__builtins__': {}})
                if is_literal(given):
                    found[name.id] = given
    return found


def shared(modules):
    """Return {name: {module: value}} where constants of one name differ, from {module: text}."""
    found = defaultdict(dict)
    for module, text in modules.items():
        for name, value in constants(text).items():
            if name not in OWN or not re.fullmatch(OWN[name], module):
                found[name][module] = value
    return {name: values for name, values in found.items()
            if len({*map(repr, values.values())}) > 1}


@pytest.mark.slow
def test_constants_of_one_name_have_one_value():
    package = ROOT / 'tp_controller'
    assert not shared({path.relative_to(package).as_posix(): path.read_text(encoding='utf-8')
                       for path in package.rglob('*.py')})


def test_a_name_of_two_values_is_found():
    assert shared({'a': 'SAME = 1e-9\nN, M = 2 ** 3, 5\n', 'b': 'SAME: float = -1\nL = N = 8\n',
                   'c': "TEXT, OTHER = 'text', ('text', 1)\nM = len('M')\n",
                   'd': "L, TEXT = 8, 'texts'\nOTHER = 'text', 1\n"}) == {
        'SAME': {'a': 1e-9, 'b': -1}, 'TEXT': {'c': 'text', 'd': 'texts'}}


def test_each_node_has_a_name_of_its_own():
    assert not shared({'a_node.py': "NAME = 'a'\n", 'b_node.py': "NAME = 'b'\n"})
    assert shared({'a.py': "NAME = 'a'\n", 'b.py': "NAME = 'b'\n"})

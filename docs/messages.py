# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Collects every message that the product can print to a user, for a page of the site.

A message is a text of several words in the code of the package that is not a docstring, a
description of a key, parameter, setting or option (those have tables of their own), the text of a
picture, or XML.
"""

import ast
from pathlib import Path
import re

PACKAGE = Path(__file__).resolve().parents[1] / 'tp_controller'
# Modules that draw: their texts are labels.
DRAWING = ('tools/recording/pictures.py', 'tools/recording/report.py', 'tools/html_page.py',
           'tools/plots/curves.py', 'tools/plots/drawing.py')
# Calls and arguments whose texts describe something, and names that do.
DESCRIBING = {'Spec', '_number', '_choice', 'NewType', 'Demo', 'title', 'help', 'description',
              'epilog', 'keys', 'KEYS', 'EXAMPLES', 'COMMAND', '_spec', 'STYLE', 'DEMOS',
              'metadata', 'NUMBER', 'CHANGING', 'needs', 'example'}
# Functions that declare a key have such a name.
DECLARING = '_key'
FILLED = re.compile(r'{[^}]*}')
WORDS = re.compile(r'[A-Za-z]{2}.* .*\w|\w .*[A-Za-z]{2}')
XML = re.compile(r'</|/>|<\?|\w="|<\w+ \w+=')


def messages(path):
    """
    Return the messages in a file, each once, in their order.

    Parameters
    ----------
    path : pathlib.Path
        Python source.

    Returns
    -------
    list of str
        With what is filled in as ``{name}``.

    """
    found = {}
    _collect(ast.parse(path.read_text(encoding='utf-8')), found)
    return list(found)


def listing():
    """Return the messages of all files, as Markdown."""
    parts = []
    for path in sorted(PACKAGE.rglob('*.py')):
        name = path.relative_to(PACKAGE).as_posix()
        found = [] if name in DRAWING else messages(path)
        if found:
            parts.append(f'## {name}\n\n' + ''.join(f'- `{text}`\n' for text in found))
    return '\n'.join(parts)


def _collect(node, found):
    """Add the messages below a node of a syntax tree to the keys of a dict."""
    if _describes(node):
        return
    text = _text(node)
    if text is None:
        for child in ast.iter_child_nodes(node):
            _collect(child, found)
    elif WORDS.search(FILLED.sub('0', text)) and not XML.search(text):
        found[' '.join(text.split())] = True
        # What is filled in may be a message itself.
        for child in ast.walk(node):
            if isinstance(child, ast.FormattedValue) and _text(child.value) is None:
                _collect(child.value, found)


def _describes(node):
    """Say whether a node is a docstring or describes something that has a table of its own."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    if isinstance(node, (ast.Assign, ast.AnnAssign)):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return any(_name(target) in DESCRIBING for target in targets)
    if isinstance(node, ast.Call):
        name = _name(node.func)
        return name in DESCRIBING or name.endswith(DECLARING)
    return isinstance(node, ast.keyword) and node.arg in DESCRIBING


def _text(node):
    """Return a text with its placeholders; None where a node is none."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return ''.join(_text(part) if isinstance(part, ast.Constant)
                       else _text(part.value) or f'{{{_name(part.value)}}}'
                       for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        sides = _text(node.left), _text(node.right)
        if sides != (None, None):
            return ''.join(f'{{{_name(child)}}}' if side is None else side
                           for side, child in zip(sides, (node.left, node.right)))
    if isinstance(node, ast.Call) and _name(node.func) == 'unknown':
        what, name, valid = node.args
        return f'unknown {_text(what)} {{{_name(name)}}}; valid: {{{_name(valid)}}}'
    return None


def _name(node):
    """Return the name by which a value is shown."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        return node.attr
    if isinstance(node, ast.Call):
        if not node.args and _name(node.func) in ('max', 'strip', 'tolist'):
            return _name(node.func.value)
        return _name((node.args or [node.func])[-1])
    if isinstance(node, ast.Subscript):
        key = node.slice
        return key.value if isinstance(getattr(key, 'value', 0), str) else _name(node.value)
    if isinstance(node, ast.IfExp):
        return f'{_name(node.body)}|{_name(node.orelse)}'
    if isinstance(node, ast.Constant):
        return str(node.value)
    names = [_name(child) for child in ast.iter_child_nodes(node)
             if isinstance(child, ast.expr) and not isinstance(child, ast.Constant)]
    return next(filter(None, names), 'value')

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

from importlib.util import find_spec
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
LINTERS = ('flake8', 'flake8_builtins', 'flake8_comprehensions', 'flake8_import_order',
           'flake8_quotes', 'pydocstyle')
# Code of a rule: lines that break it, most of which ruff accepts.
FAULTS = {
    'A003': 'class Gap:\n    """A gap."""\n\n    def open(self):\n        """Begin it."""\n',
    'C408': 'print(dict())\n',
    'D208': 'def corners():\n    """\n    Return two:\n        the first,\n     a second.\n\n'
            '     """\n',
    'D402': 'def corners(box):\n    """Return {link: corners (k, 3) of a box}."""\n',
    'D413': 'def corners():\n    """\n    Return them.\n\n    Returns\n    -------\n    list\n'
            '    """\n',
    'E129': 'if (True and\n    not False):\n    print()\n',
    'E501': f'URL = "https://{"x" * 99}"\n',
    'I100': 'import sys\nimport os\n\nprint(os, sys)\n',
    'Q000': 'print("text")\n',
}


@pytest.mark.linter
@pytest.mark.filterwarnings('default')
def test_flake8():
    main_with_errors = pytest.importorskip('ament_flake8.main').main_with_errors
    code, errors = main_with_errors(argv=[str(ROOT)])
    assert code == 0, '\n'.join([f'Found {len(errors)} code style errors:', *errors])


def linters():
    """Return the arguments of Python with which `make lint` looks at the whole tree."""
    recipe = (ROOT / 'Makefile').read_text(encoding='utf-8').partition('\nlint:')[2]
    return [line.split()[1:-1] for line in recipe.partition('\n\n')[0].splitlines()
            if line.endswith(' .')]


@pytest.mark.linter
@pytest.mark.skipif(not all(map(find_spec, LINTERS)), reason='the linters are not installed')
@pytest.mark.parametrize('code', FAULTS)
def test_make_lint_finds_what_ament_flake8_and_ament_pep257_find(code, tmp_path):
    file = tmp_path / 'faulty.py'
    file.write_text(f'"""A file with a fault."""\n\n{FAULTS[code]}', encoding='utf-8')
    told = [subprocess.run([sys.executable, *linter, str(file)], cwd=ROOT, text=True,
                           capture_output=True).stdout for linter in linters()]
    assert any(f' {code}' in text for text in told), told

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LINES = ('Copyright 2026 tp_controller contributors', 'SPDX-License-Identifier: Apache-2.0')
COMMENTS = {'.py': '# ', '.h': '// ', '.cpp': '// '}
FOLDERS = ('tp_controller', 'launch', 'test', 'benchmarks', 'docs', 'examples')


@pytest.mark.linter
def test_every_source_file_starts_with_copyright_and_licence():
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob('*')
             if path.suffix in COMMENTS]
    assert {path.suffix for path in files} == set(COMMENTS)
    assert [str(path.relative_to(ROOT)) for path in files
            if path.read_text(encoding='utf-8').splitlines()[:2]
            != [COMMENTS[path.suffix] + line for line in LINES]] == []


@pytest.mark.linter
def test_contributing_says_which_licence_a_contribution_gets():
    assert '5. Submission of Contributions.' in (ROOT / 'CONTRIBUTING.md').read_text('utf-8')
    assert 'Apache License' in (ROOT / 'LICENSE').read_text('utf-8')

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

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
HEADER = (ROOT / 'setup.py').read_text(encoding='utf-8').partition('\n\n')[0]
FOLDERS = ('tp_controller', 'launch', 'test', 'benchmarks', 'docs', 'examples')


@pytest.mark.linter
@pytest.mark.filterwarnings('default')
def test_ament_finds_the_copyright_in_every_file():
    main = pytest.importorskip('ament_copyright.main').main
    assert main(argv=[str(ROOT)]) == 0, 'Found errors'


@pytest.mark.linter
def test_every_python_file_starts_with_the_same_licence():
    assert 'Apache License, Version 2.0' in HEADER
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob('*.py')]
    assert len(files) > 10
    assert [str(path.relative_to(ROOT)) for path in files
            if not path.read_text(encoding='utf-8').startswith(HEADER)] == []


@pytest.mark.linter
def test_contributing_says_which_licence_a_contribution_gets():
    # ament_copyright looks for the wording of the Apache licence in these two files.
    assert '5. Submission of Contributions.' in (ROOT / 'CONTRIBUTING.md').read_text('utf-8')
    assert 'Apache License' in (ROOT / 'LICENSE').read_text('utf-8')

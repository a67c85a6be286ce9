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
import re
import shutil
import subprocess

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / 'package.xml'
# What xmllint returns if it cannot read a schema, as without a network or a catalog.
NO_SCHEMA = 5


@pytest.mark.linter
def test_xmllint():
    main = pytest.importorskip('ament_xmllint.main').main
    if not shutil.which('xmllint'):
        pytest.skip('there is no xmllint')
    schema = re.search(r'xml-model href="(\S+)"', PACKAGE.read_text(encoding='utf-8'))[1]
    command = ['xmllint', '--noout', '--schema', schema, str(PACKAGE)]
    if subprocess.run(command, capture_output=True).returncode == NO_SCHEMA:
        pytest.skip(f'{schema} cannot be read')
    assert main(argv=[str(ROOT)]) == 0, 'Found errors'

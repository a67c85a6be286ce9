# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.linter
@pytest.mark.filterwarnings('default')
def test_pep257():
    main = pytest.importorskip('ament_pep257.main').main
    assert main(argv=[str(ROOT)]) == 0, 'Found code style errors'

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What docs/migration.md shows of other packages: scripts that run, and words that exist."""

from importlib.util import find_spec
import os
from pathlib import Path
import re
import subprocess
import sys

import pytest
from tp_controller import Robot
from tp_controller.tasks import task_types

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / 'docs' / 'migration.md').read_text(encoding='utf-8')
FILES = dict(re.findall(r'<!-- file: (\S+) -->\n```\w+\n(.*?)```', PAGE, re.DOTALL))


def run(name, folder):
    """Run a script of the page in a folder; return what it prints."""
    done = subprocess.run(
        [sys.executable, '-c', FILES[name]], cwd=folder, text=True, capture_output=True,
        timeout=120, env={**os.environ, 'PYTHONPATH': str(ROOT)})
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_scripts_are_those_of_another_package():
    assert set(FILES) == {'write_urdf.py', 'with_pink.py'}


def test_script_of_another_package_is_python_and_prints_what_is_shown(tmp_path):
    name = 'with_pink.py'
    compile(FILES[name], name, 'exec')
    if find_spec('pink') is None:
        pytest.skip('pink is not installed')
    run('write_urdf.py', tmp_path)
    shown = PAGE.partition(f'<!-- file: {name} -->')[2].split('```text\n')[1].partition('```')[0]
    assert run(name, tmp_path) == shown


@pytest.mark.slow
def test_urdf_that_the_scripts_read_is_the_panda(tmp_path):
    run('write_urdf.py', tmp_path)
    robot = Robot.from_urdf(tmp_path / 'panda.urdf')
    assert robot.n == 7 and 'panda_hand_tcp' in robot.frame_names


def test_gains_per_cycle_are_those_per_second():
    own = [float(gain) for gain in re.findall(r'gain: (\d\.\d)', PAGE)][:3]
    shares = re.findall(r'gain=(\d\.\d) \* period', FILES['with_pink.py'])
    assert [float(gain) for gain in shares] == own


def test_task_types_that_the_page_links_exist():
    linked = set(re.findall(r'\[`(\w+)`\]\(tasks/\w+\.md#\w+\)', PAGE))
    assert len(linked) > 15 and linked <= set(task_types())

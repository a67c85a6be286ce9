# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The pages build as a site without a warning, and what leads nowhere is one.

Sphinx, MyST and the theme are in the extra ``docs``; rosdoc2 brings the first two.
"""

import importlib.util
from pathlib import Path
import re
import shutil
import subprocess
import sys

import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
MISSING = [name for name in ('sphinx', 'myst_parser', 'furo')
           if importlib.util.find_spec(name) is None]
pytestmark = pytest.mark.skipif(
    bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (pip install '.[docs]')")


def build(source, target):
    """Build a folder of pages as `make docs` does; return what Sphinx had to say."""
    done = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-q', '-n', '-W', '--keep-going', source, target],
        cwd=DOCS.parent, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600)
    assert bool(done.returncode) == bool(done.stdout), done.stdout
    return done.stdout


def test_site_builds_without_a_warning(tmp_path):
    assert build(DOCS, tmp_path) == ''
    pages = {path.relative_to(DOCS).with_suffix('.html') for path in DOCS.rglob('*.md')}
    assert pages <= {path.relative_to(tmp_path) for path in tmp_path.rglob('*.html')}
    assert 'id="tp_controller.Controller.update"' in (tmp_path / 'reference.html').read_text(
        encoding='utf-8')
    for name, text in (('messages', 'blocked by the bounds of {}'),
                       ('command_line', '$ tp_controller check --help'),
                       ('check_report', 'findings, the worst first')):
        page = (tmp_path / 'generated' / f'{name}.html').read_text(encoding='utf-8')
        assert text in re.sub('<[^>]*>', '', page)


@pytest.fixture
def elsewhere(tmp_path):
    """Return a folder with the settings and two pages, as rosdoc2 makes a copy of all."""
    folder = tmp_path / 'copy'
    folder.mkdir()
    for name in ('conf.py', 'changelog.md'):
        shutil.copy(DOCS / name, folder)
    (folder / 'reference.md').write_text(
        '# Reference\n\n```{eval-rst}\n.. py:module:: tp_controller\n.. autoclass:: Robot\n```\n',
        encoding='utf-8')
    return folder


def write_first_page(folder, text):
    """Write the first page."""
    (folder / 'index.md').write_text(
        f'# Site\n\n{text}\n\n```{{toctree}}\nreference\nchangelog\ngenerated/messages\n'
        'generated/command_line\ngenerated/check_report\n```\n', encoding='utf-8')


def test_site_builds_in_another_folder(elsewhere, tmp_path):
    write_first_page(elsewhere, '[stack](../config/lab1.yaml) [changes](../CHANGELOG.rst)\n\n'
                     '```{eval-rst}\n`Robot.velocity_names` `tp_controller.solver.damping`\n```')
    assert build(elsewhere, tmp_path / 'site') == ''
    # As of every copy, the pages that are made with the site are beside the others.
    assert (elsewhere / 'generated' / 'messages.md').exists()
    assert (tmp_path / 'site' / 'generated' / 'messages.html').exists()
    text = (tmp_path / 'site' / 'index.html').read_text(encoding='utf-8')
    assert 'lab1.yaml' in text and 'href="changelog.html"' in text
    assert 'href="reference.html#tp_controller.Robot"' in text


def test_what_leads_nowhere_is_found(elsewhere, tmp_path):
    links, names = ('../config/no.yaml', 'no_page.md', 'reference.md#nowhere'), (
        'Robot.no_name', 'NoClass', 'tp_controller.no_module')
    write_first_page(elsewhere, '\n'.join(f'[a link]({link})' for link in links)
                     + '\n\n```{eval-rst}\n' + ' '.join(f'`{name}`' for name in names)
                     + '\n```')
    found = build(elsewhere, tmp_path / 'site')
    for wrong in ('config/no.yaml', 'no_page', 'nowhere', *names):
        assert wrong in found

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Files in folders that others may write to: their links are not followed."""

import os
import stat
import tempfile

import numpy as np
from PIL import Image
import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.demos.film import save_animation
from tp_controller.tools.demos.processes import NodeProcess, own_domain
from tp_controller.tools.files import new_file, open_lock, private_folder
from tp_controller.tools.plots.curves import plot_positions

TREASURE = 'not to be lost'


@pytest.fixture
def victim(tmp_path):
    """Return a file that a link of somebody else leads to."""
    file = tmp_path / 'victim'
    file.write_text(TREASURE)
    return file


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Return a temporary directory that everybody may write to."""
    folder = tmp_path / 'tmp'
    folder.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(folder))
    return folder


def locks(temporary):
    """Return where the locks of the domains are."""
    return temporary / f'tp_controller_domains_{os.getuid()}'


# Domains --------------------------------------------------------------------------------------


def test_the_locks_are_in_a_folder_for_nobody_else(temporary):
    before = os.umask(0)
    try:
        with own_domain() as environment:
            folder, = temporary.iterdir()
            assert folder == locks(temporary)
            assert stat.S_IMODE(folder.stat().st_mode) == 0o700
            assert stat.S_IMODE((folder / environment['ROS_DOMAIN_ID']).stat().st_mode) == 0o600
    finally:
        os.umask(before)


def test_a_domain_is_reserved_until_it_is_left(temporary):
    with own_domain() as first, own_domain() as second:
        assert first['ROS_DOMAIN_ID'] != second['ROS_DOMAIN_ID']
    with own_domain() as again:
        assert again['ROS_DOMAIN_ID'] == first['ROS_DOMAIN_ID']


def test_a_folder_that_everybody_may_write_to_is_made_private(temporary):
    locks(temporary).mkdir()
    locks(temporary).chmod(0o777)
    with own_domain():
        assert stat.S_IMODE(locks(temporary).stat().st_mode) == 0o700


def test_a_link_in_place_of_the_folder_is_refused(temporary, tmp_path):
    elsewhere = tmp_path / 'elsewhere'
    elsewhere.mkdir()
    locks(temporary).symlink_to(elsewhere)
    with pytest.raises(TpControllerError, match='must be a folder of your own'), own_domain():
        pass
    assert not list(elsewhere.iterdir())


def test_a_file_in_place_of_the_folder_is_refused(temporary):
    locks(temporary).write_text('')
    with pytest.raises(TpControllerError, match='must be a folder of your own'), own_domain():
        pass


def test_the_folder_of_somebody_else_is_refused(temporary, monkeypatch):
    with own_domain():
        pass
    me, name = os.getuid(), locks(temporary).name
    monkeypatch.setattr(os, 'getuid', lambda: me + 1)
    with pytest.raises(TpControllerError, match=f'it belongs to user {me}; set TMPDIR'), \
            private_folder(name):
        pass


def test_a_link_in_place_of_a_lock_is_not_followed(temporary, victim):
    locks(temporary).mkdir(0o700)
    (locks(temporary) / '101').symlink_to(victim)
    with pytest.raises(TpControllerError, match='no lock 101: Too many'), own_domain():
        pass
    assert victim.read_text() == TREASURE


def test_a_lock_that_is_there_keeps_its_content(temporary):
    with private_folder('mine') as folder:
        (temporary / 'mine' / 'lock').write_text(TREASURE)
        open_lock('lock', folder).close()
    assert (temporary / 'mine' / 'lock').read_text() == TREASURE


# Figures and logs -----------------------------------------------------------------------------


def test_a_new_file_replaces_an_old_one_and_makes_its_folder(tmp_path):
    path = tmp_path / 'deep' / 'file'
    for text in (b'a long one', b'short'):
        with new_file(path) as file:
            file.write(text)
    assert path.read_bytes() == b'short'


def draw_figure(path):
    """Draw a figure."""
    times = np.linspace(0.0, 1.0, 5)
    plot_positions(path, times, np.zeros((5, 1)), ['joint'], title='at rest')


def draw_film(path):
    """Draw a film."""
    save_animation(path, [Image.new('RGB', (8, 8))], 20.0)


def start_node(path):
    """Start a node with a log."""
    NodeProcess('simulator_node', [], dict(os.environ), path)


@pytest.mark.parametrize('write', [draw_figure, draw_film, start_node])
def test_a_link_in_place_of_an_output_is_refused(tmp_path, victim, write):
    link = tmp_path / 'out.png'
    link.symlink_to(victim)
    with pytest.raises(TpControllerError, match='out.png is a link, and is not written'):
        write(link)
    assert victim.read_text() == TREASURE


def test_figures_are_of_the_kind_that_their_names_say(tmp_path):
    draw_figure(tmp_path / 'figure.svg')
    assert '<svg' in (tmp_path / 'figure.svg').read_text()

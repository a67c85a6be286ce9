# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Files in folders that others may write to: their links are not followed."""

import os

import numpy as np
from PIL import Image
import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.demos.film import save_animation
from tp_controller.tools.demos.processes import NodeProcess
from tp_controller.tools.files import new_file
from tp_controller.tools.plots.curves import plot_positions

TREASURE = 'not to be lost'


@pytest.fixture
def victim(tmp_path):
    """Return a file that a link of somebody else leads to."""
    file = tmp_path / 'victim'
    file.write_text(TREASURE)
    return file


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

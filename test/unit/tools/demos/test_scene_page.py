# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes of a lecture on a page: the run is played, paused, exchanged and moved in time."""

from dataclasses import replace

import numpy as np
import pytest
from tp_controller.tools.demos.scenes import SCENES

viser = pytest.importorskip('viser', reason="needs pip install '.[view]'")
scene_page = pytest.importorskip('tp_controller.tools.demos.scene_page')


@pytest.fixture(scope='module')
def lesson():
    """Return a scene of two seconds, and its runs."""
    scene = replace(SCENES['weights'](), duration=2.0)
    return scene, scene.runs()


@pytest.fixture
def page(lesson):
    """Return the page of a scene."""
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    yield scene_page.ScenePage(server, *lesson)
    server.stop()


def shown(page):
    """Return the configuration that the page shows."""
    return page._stage._robot.state.q


def test_question_is_seen_and_the_answer_in_a_folder(lesson, monkeypatch):
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    texts, folders = [], []
    monkeypatch.setattr(server.gui, 'add_markdown', texts.append)
    folder = server.gui.add_folder
    monkeypatch.setattr(server.gui, 'add_folder', lambda label, **options: (
        folders.append((label, options, len(texts))), folder(label, **options))[1])
    scene_page.add_question(server.gui, lesson[0])
    server.stop()
    assert lesson[0].question in texts[0] and texts[1] == lesson[0].answer
    assert folders == [('Answer', {'expand_by_default': False}, 1)]


def test_run_is_played_to_its_end_and_again(page, lesson):
    run = lesson[1]['1 : 1']
    for _ in range(3):
        page.update(0.25)
    np.testing.assert_allclose(shown(page), run.q[75], atol=1e-12)
    assert page.clock.value == 0.75
    page.update(2.0)
    np.testing.assert_allclose(shown(page), run.q[-1], atol=1e-12)
    page.update(scene_page.LAST_SECONDS)
    np.testing.assert_allclose(shown(page), run.q[0], atol=1e-12)


def test_slider_moves_in_time_both_ways_and_a_paused_run_stays(page, lesson):
    run = lesson[1]['1 : 1']
    page._toggle()
    assert page.button.label == 'Play'
    for sample in (150, 20):
        page.clock.value = 0.01 * sample
        for _ in range(3):
            page.update(0.1)
        np.testing.assert_allclose(shown(page), run.q[sample], atol=1e-12)
    page._toggle()
    page.update(0.1)
    np.testing.assert_allclose(shown(page), run.q[30], atol=1e-12)


def test_other_run_is_shown_at_the_same_time_with_its_own_path(page, lesson):
    page.update(1.0)
    page.variant.value = '100 : 1'
    page.update(0.0)
    run = lesson[1]['100 : 1']
    np.testing.assert_allclose(shown(page), run.q[100], atol=1e-12)
    assert np.abs(run.q[100] - lesson[1]['1 : 1'].q[100]).max() > 0.01
    path = run.values(lambda state: state.position('base_link'))[:101]
    base = np.array(page._stage._trails[1]._points)
    assert len(base) > 5
    away = np.linalg.norm(base[:, np.newaxis] - path, axis=2).argmin(axis=1)
    np.testing.assert_allclose(base, path[away], atol=1e-12)
    # Each point once, in order of time.
    assert (np.diff(away) > 0).all()

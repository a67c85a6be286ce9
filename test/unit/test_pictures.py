# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The pictures of task types and method are there, are shown, and can be drawn anew."""

import importlib.util
from pathlib import Path
import re

import numpy as np
from PIL import Image
import pytest
from robots import urdf_path
from tp_controller import solve, Stack
from tp_controller.tasks import task_types

DOCS = Path(__file__).resolve().parents[2] / 'docs'
SECTION = re.compile(r'^## (\w+)\n(.*?)(?=^## |\Z)', re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r'^!\[([^\]]+)\]\(\.\./images/tasks/(\w+)\.png\)$', re.MULTILINE)


@pytest.fixture(scope='module')
def pictures():
    """Return docs/pictures.py as a module."""
    spec = importlib.util.spec_from_file_location('pictures', DOCS / 'pictures.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def shown():
    """Return {task type: names of the pictures in its section} of the pages about task types."""
    text = '\n'.join(page.read_text(encoding='utf-8')
                     for page in sorted((DOCS / 'tasks').glob('*.md')))
    return {kind: [name for _, name in PICTURE.findall(section)]
            for kind, section in SECTION.findall(text) if PICTURE.search(section)}


def test_every_scene_has_a_picture_and_is_shown_with_its_task_type(pictures):
    assert shown() == {kind: [kind] for kind in pictures.SCENES}
    assert {path.stem for path in pictures.FOLDER.iterdir()} == set(pictures.SCENES)
    assert set(pictures.SCENES) <= set(task_types())


def test_pictures_have_one_size_and_are_small(pictures):
    for path in pictures.FOLDER.iterdir():
        with Image.open(path) as picture:
            assert picture.size == (902, 379), path
        assert path.stat().st_size < 70_000, path


@pytest.mark.parametrize('kind', shown())
def test_every_scene_is_about_its_task_type(pictures, kind):
    scene = pictures.SCENES[kind]
    if scene.robot in ('baxter', 'panda with masses', 'talos'):
        urdf_path('baxter')  # skips where those robots are missing
    stack = Stack.from_yaml(scene.stack, pictures.ROBOTS[scene.robot]())
    assert [task.type_name for task in stack.tasks.values()].count(kind) == 1
    assert {name for _, name, _ in scene.goals} <= set(stack.tasks)


@pytest.mark.slow
def test_a_picture_drawn_again_is_the_same_and_its_bounds_are_kept(pictures, tmp_path):
    paths = [pictures.draw('keep_out', tmp_path / folder)[0] for folder in ('first', 'second')]
    assert paths[0] == tmp_path / 'first' / 'keep_out.png'
    assert paths[0].read_bytes() == paths[1].read_bytes()
    plot, _ = pictures.SCENES['keep_out'].plots
    with_task, without = (pictures.Run(pictures.SCENES['keep_out'], 'keep_out', without=off)
                          for off in (False, True))
    assert plot.values(with_task).min() > plot.lower > 0.0 > plot.values(without).min()


@pytest.mark.slow
def test_humanoid_reaches_as_far_as_the_page_says(pictures):
    urdf_path('talos')  # skips where it is missing
    text = (DOCS / 'tasks' / 'inequality.md').read_text(encoding='utf-8')
    said = re.search(r'The hand ends (\d+) mm before .* (\d+) mm inside of the edge; .* '
                     r'(\d+) mm in front of the toes', text)
    scene = pictures.SCENES['com_polygon']
    runs = [pictures.Run(scene, 'com_polygon', without=off) for off in (False, True)]
    inside, outside = (1e3 * pictures.nearest(run) for run in runs)
    short, arrived = (run.error('hand')[-1] for run in runs)
    assert [short, inside[-1], -outside[-1]] == pytest.approx(list(map(float, said.groups())),
                                                              abs=1.0)
    assert inside.min() > 29.9 and arrived < 0.1
    for run in runs:
        # The feet stay where they are.
        assert np.ptp(run.path('left_sole_link'), axis=0).max() < 1e-3


@pytest.mark.slow
def test_pictures_of_the_method_are_there_and_shown(pictures, tmp_path):
    text = (DOCS / 'method.md').read_text(encoding='utf-8')
    assert {path.stem for path in (DOCS / 'images').glob('method_*')} == set(pictures.METHOD)
    for name, make in pictures.METHOD.items():
        assert re.search(rf'^!\[[^\]]+\]\(images/{name}\.png\)$', text, re.MULTILINE)
        drawn = pictures.drawing.save(make(), tmp_path / f'{name}.png')
        with Image.open(drawn) as new, Image.open(DOCS / 'images' / f'{name}.png') as old:
            assert new.size == old.size == (902, 379)


def test_picture_of_the_levels_shows_what_its_caption_says(pictures):
    (J, v), lower = levels = pictures.UPPER_LEVEL, pictures.LOWER_LEVEL
    bound = pictures.LIMIT * np.ones(2)
    free = solve(levels).velocity
    assert np.allclose(J @ free, v) and np.allclose(lower[0] @ free, lower[1])
    assert free[0] > bound[0]
    assert np.allclose(J @ solve(levels, -bound, bound, scaling='redistribute').velocity, v)
    for other in (solve(levels, -bound, bound).velocity, free.clip(-bound, bound)):
        assert not np.allclose(J @ other, v, atol=0.05)

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

"""The film of a solid robot, rendered in a real browser."""

from importlib.util import find_spec

import numpy as np
from PIL import Image
import pytest
from robots import panda
from tp_controller import Stack, TpControllerError
from tp_controller.demos import film
from tp_controller.demos.motion import Motion
from tp_controller.view.browser import find_chromium, open_page

STACK = """\
- clear: {type: keep_out, frame: panda_hand_tcp, shape: {cylinder: [0.1, 0.8]},
          at: [0.6, 0.3, 0.4]}
- tool: {type: position, frame: panda_hand_tcp}
"""

pytestmark = [
    pytest.mark.skipif(find_spec('viser') is None, reason='needs viser'),
    pytest.mark.skipif(find_chromium() is None, reason='needs a Chromium on the PATH')]


def share(picture, colour, tolerance):
    """Return the share of pixels near a colour [%]."""
    return 100.0 * (np.abs(picture - np.array(colour)).max(axis=2) < tolerance).mean()


def test_film_shows_a_solid_robot_that_moves_its_goal_and_an_obstacle(
        tmp_path, monkeypatch, capsys):
    monkeypatch.delenv(film.CHOICE)
    robot = panda()
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8]) + np.outer([0.0, 1.0], [0.6, *6 * [0.0]])
    path = film.write_film(tmp_path / 'film.webp', Motion(
        'title', robot, np.array([0.0, 1.0]), q, Stack.from_yaml(STACK, robot),
        ('panda_hand_tcp',), goals=[(0.5, 'tool', [0.4, -0.3, 0.5])]))
    assert capsys.readouterr().err == ''
    with Image.open(path) as picture:
        assert picture.size == film.SIZE and picture.n_frames == 2
        pictures = []
        for frame in range(2):
            picture.seek(frame)
            # Without the caption.
            pictures.append(np.asarray(picture.convert('RGB')).astype(int)[:640])
    first, last = pictures
    moved = np.abs(first - last).max(axis=2) > 40
    assert 0.03 < moved.mean() < 0.5
    # Nothing of it is cut off at an edge.
    assert not any(edge.any() for edge in (moved[0], moved[:, 0], moved[:, -1]))
    brown = [(each[..., 0] > each[..., 2] + 60) & (each[..., 1] > 60) for each in pictures]
    assert all(0.02 < each.mean() < 0.3 for each in brown)
    orange = [share(each, (200, 90, 15), 60) for each in pictures]
    assert orange[1] > orange[0] + 0.01


def test_a_browser_that_ends_says_what_it_said_last():
    # Any program that is there will do.
    with open_page('false', 'http://127.0.0.1:1', 100, 100) as page:
        page._process.wait()
        with pytest.raises(TpControllerError, match=r'Chromium ended \(exit code 1\)'):
            page.check()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The examples run without ROS, are short, and do what they say; each is named in docs/."""

from contextlib import redirect_stdout
from functools import lru_cache
import io
from pathlib import Path
import re
import runpy

import numpy as np
import pytest
from tp_controller.tasks import Task

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / 'examples').glob('*.py'))
HEADER = (ROOT / 'setup.py').read_text(encoding='utf-8').partition('\n\n')[0]


@lru_cache
def run(name):
    """Return what an example prints."""
    printed = io.StringIO()
    # A task type that an example registers is not for other tests.
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(printed):
        patch.setattr(Task, 'types', dict(Task.types))
        runpy.run_path(str(ROOT / 'examples' / f'{name}.py'), run_name='__main__')
    return printed.getvalue()


def numbers(text):
    """Return the numbers of a text."""
    return [float(number) for number in re.findall(r'\d+(?:\.\d+)?', text)]


def test_there_are_seven():
    assert len(EXAMPLES) == 7


@pytest.mark.parametrize('path', EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_needs_no_ros(path):
    text = path.read_text(encoding='utf-8').removeprefix(HEADER).strip()
    assert text.count('\n') + 1 <= 40
    assert 'rclpy' not in text and '_msgs' not in text and 'tp_controller.ros' not in text


def test_page_about_the_library_lists_them_all():
    page = (ROOT / 'docs' / 'library.md').read_text(encoding='utf-8')
    listed = re.findall(r'\(\.\./examples/(\w+)\.py\)', page)
    assert sorted(listed) == [path.stem for path in EXAMPLES]


@pytest.mark.slow
def test_circle_is_followed_without_lag_if_its_velocity_is_sent():
    without, with_velocity = run('follow_circle').splitlines()
    # Radius, turning speed and gain: a first-order lag.
    radius, turning, gain = 120.0, 2.0 * np.pi / 6.0, 3.0
    assert numbers(without)[0] == pytest.approx(radius * turning / np.hypot(gain, turning), 0.01)
    assert numbers(with_velocity)[0] < 0.5


@pytest.mark.slow
def test_two_arms_reach_all_goals_and_the_grip_does_not_slip():
    *goals, slip = run('two_arms_carry').splitlines()
    assert len(goals) == 3 and all(line.endswith(' reached') for line in goals)
    assert numbers(slip)[0] < 1.0


def test_object_stays_in_view_only_with_the_task():
    without, with_task = run('field_of_view').splitlines()
    angle, allowed = numbers(without)
    assert angle > 1.5 * allowed and without.endswith('tool reached')
    angle, allowed = numbers(with_task)
    assert angle <= allowed and with_task.endswith('tool reached')


@pytest.mark.slow
def test_elbow_evades_the_ball_while_the_tool_stays():
    nearest, demanded, elbow, tool = numbers(run('avoid_obstacle'))
    # The ball comes nearer by 2.5 mm while the elbow evades it: its speed over the gain.
    assert demanded - 5.0 < nearest and elbow > 50.0 and tool < 0.5


def test_base_moves_for_the_far_goal_and_hardly_for_the_near_one():
    near, far = run('mobile_base').splitlines()
    assert numbers(near)[0] < 0.1 and near.endswith('reached')
    assert numbers(far)[0] > 2.0 and far.endswith('reached')


def test_own_task_type_limits_the_tool():
    printed = run('own_task_type')
    assert numbers(printed)[0] == pytest.approx(600.0, abs=0.5)
    assert printed.endswith('tool limited: blocked by the bounds of cable\n')


def test_own_solver_moves_the_tool_to_its_goal_and_the_posture_yields():
    assert run('own_solver') == 'tool 0.0 mm, posture limited: blocked by tool\n'

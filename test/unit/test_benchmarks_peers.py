# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The comparison with other packages: what it needs of this one, with none of the others there."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest
import robots
from scipy.spatial.transform import Rotation

SCRIPT = robots.REPOSITORY / 'benchmarks' / 'peers.py'
# {package: what is imported}
PEERS = {'pink': 'pink', 'mink': 'mink', 'placo': 'placo', 'embodik': 'embodik',
         'oink': 'roboplan', 'tsid': 'tsid'}


@pytest.fixture
def peers(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('peers')


@pytest.fixture
def worker(monkeypatch):
    """Return the module that runs a package."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('_peers_worker')


@pytest.fixture
def alone(tmp_path):
    """Return an environment in which no other package can be imported."""
    for name in PEERS.values():
        (tmp_path / f'{name}.py').write_text('raise ImportError("hidden by a test")\n')
    return {**os.environ, 'PYTHONPATH': os.pathsep.join((str(tmp_path),
                                                         str(robots.REPOSITORY)))}


class Slider:
    """A joint that is told to move at given velocities, one a cycle; None is no solution."""

    period = 0.5

    def __init__(self, velocities):
        self._velocities = iter(velocities)

    def aim(self, q):
        """Nothing to prepare."""

    def velocity(self, q):
        found = next(self._velocities)
        return None if found is None else np.array([found])


@pytest.mark.slow
def test_comparison_explains_its_options():
    done = subprocess.run([sys.executable, str(SCRIPT), '--help'], check=True, timeout=60,
                          capture_output=True, text=True)
    assert '--states' in done.stdout and '--python' in done.stdout


@pytest.mark.slow
def test_comparison_without_other_packages_shows_this_one_and_what_it_skipped(alone):
    done = subprocess.run(
        [sys.executable, str(SCRIPT), '--states', '2', '--seconds', '0.1', '--rounds', '1',
         '--poses', '3'],
        capture_output=True, text=True, timeout=120, env=alone)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    skipped = [f'skipped: {name} is not installed (hidden by a test)' for name in PEERS]
    assert lines[:len(skipped)] == skipped
    rows = [line for line in lines if line.startswith('| tp_controller')]
    # In both tables of times, in that of positions and in one for each stack.
    assert len(rows) == 6
    widths = {len(row.split('|')) for row in rows}
    heads = {len(line.split('|')) for line in lines if line.startswith('| ---')}
    assert widths == heads


@pytest.mark.slow
@pytest.mark.parametrize('name, tips', [
    ('Panda, pose > elbow position', ('panda_hand_tcp', 'panda_link4')),
    ('Talos upper body, 18 joints, 4 levels', ('arm_right_7_link', 'head_2_link'))])
def test_robot_for_all_packages_moves_like_its_source(peers, tmp_path, name, tips):
    scene = peers.Scene(name, tmp_path)
    random = np.random.default_rng(0)
    q = random.uniform(scene.robot.lower, scene.robot.upper)
    for tip in tips:
        np.testing.assert_allclose(scene.robot.state(q).pose(tip),
                                   scene.source.state(q).pose(tip), atol=1e-12)
    for limit in ('lower', 'upper', 'velocity'):
        np.testing.assert_array_equal(getattr(scene.robot, limit), getattr(scene.source, limit))


def test_share_of_a_way_turns_and_shifts_by_that_share(worker):
    turn = np.array([0.3, -1.2, 2.0])
    start, goal = np.eye(4), np.eye(4)
    start[:3, :3] = Rotation.from_rotvec([0.4, 0.1, -0.7]).as_matrix()
    goal[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ start[:3, :3]
    goal[:3, 3] = 1.0, -2.0, 3.0
    ahead = worker.on_the_way(start, goal, 0.25)
    np.testing.assert_allclose(ahead[:3, 3], (0.25, -0.5, 0.75))
    np.testing.assert_allclose(
        ahead[:3, :3], Rotation.from_rotvec(0.25 * turn).as_matrix() @ start[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(worker.on_the_way(goal, goal, 0.25), goal)


@pytest.mark.slow
@pytest.mark.parametrize('variant', ['', 'damped'])
def test_plain_recursion_moves_the_tool_as_it_should_whatever_the_elbow_does(
        peers, worker, tmp_path, variant):
    scene = peers.Scene('Panda, pose > elbow position', tmp_path)
    random, ready = np.random.default_rng(3), scene.ready
    goals = scene.goals(ready + 0.02 * random.standard_normal(7), scene.draw(random, 1.0))
    speed = np.full(7, 100.0)
    urdf = scene.write('unlimited', speed)
    found = {}
    for count in (1, 2):
        peer = worker.Recursion(scene.given('recursion', variant, urdf, speed, 1e-6, count))
        peer.start(list(map(np.array, goals[:count])))
        found[count] = peer.velocity(ready)
    J = scene.robot.state(ready).jacobian('panda_hand_tcp')
    np.testing.assert_allclose(J @ found[1], J @ found[2], atol=1e-9)
    assert np.linalg.norm(found[2] - found[1]) > 0.1
    (distance, angle), _ = peers.errors(scene, ready, goals)
    (later, turned), _ = peers.errors(scene, ready + 1e-6 * found[2], goals)
    if variant:
        assert later < distance
    else:
        # 2 per second.
        assert (distance - later) / distance == pytest.approx(2e-6, rel=1e-3)
        assert (angle - turned) / angle == pytest.approx(2e-6, rel=1e-3)


def test_motion_counts_what_exceeds_limits_and_how_velocities_change(worker):
    # At 2 Hz the first second is two cycles.
    found = worker.simulate(Slider([3.0, 1.0, None, 0.5]), np.zeros(1), 4,
                            np.array([[-1.0], [1.6], [2.0]]))
    assert found['q'] == [2.25]
    assert found['failed'] == 0.25
    assert found['speed'] == pytest.approx(0.5)
    assert found['position'] == pytest.approx(0.65)
    assert found['start'] == pytest.approx(3.0)
    assert found['change'] == pytest.approx(1.0)


@pytest.mark.slow
def test_goal_is_reached_by_the_first_task_alone(peers, tmp_path):
    scene = peers.Scene('Panda, pose > posture', tmp_path)
    goals = scene.goals(scene.ready, scene.ready + 0.5)
    there, *_ = peers.errors(scene, scene.ready, goals)
    away, posture = peers.errors(scene, scene.ready + 0.1, goals)
    # The last joint turns about an axis through the tool.
    turned, _ = peers.errors(scene, scene.ready + np.eye(7)[6] * 0.1, goals)
    assert turned == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.1))
    assert peers.reached({'errors': [there, posture]})
    assert not peers.reached({'errors': [away, posture]})
    assert not peers.reached({'errors': [turned, posture]})
    assert posture == (0.0, pytest.approx(0.4))

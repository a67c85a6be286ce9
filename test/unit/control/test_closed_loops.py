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

"""The benchmarks: random closed loops in a small version, and every benchmark runs at all."""

import importlib
import subprocess
import sys

import numpy as np
import pytest
import robots


@pytest.fixture
def closed_loops(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('closed_loops')


@pytest.mark.parametrize('robot', ['Panda', 'UR5', 'Baxter', 'planar 10R'])
def test_nothing_that_must_not_happen_happens_in_closed_loops(closed_loops, robot):
    result = closed_loops.run(robot, 2500, seed=12345)
    assert result.findings == []
    assert (result.failures, result.velocity, result.position) == (0, 0, 0)
    assert 0.0 < result.acceleration <= 1.0 + 1e-9
    # Limits did play a part.
    assert result.active > 100 and result.left <= 1
    assert np.isfinite(result.change)


@pytest.fixture
def inequalities(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('inequalities')


@pytest.mark.parametrize('kind', [
    'joint_limits', 'keep_in', 'keep_out', 'field_of_view', 'manipulability_above', 'speed_limit',
    'self_collision', 'obstacles'])
def test_bounds_are_kept_in_closed_loops_drawn_at_random(inequalities, kind):
    runs = [inequalities.run(kind, number) for number in range(2001, 2007)]
    assert list(inequalities.findings(runs)) == []
    assert all(each.reversals < 20.0 for each in runs)


@pytest.fixture
def motion(monkeypatch):
    """Return the module that counts."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('_motion')


def test_oscillations_of_the_worst_joint_are_counted_per_second(motion):
    cycles = np.arange(200)
    every = 0.02 * (-1.0) ** cycles
    slow = 0.1 * np.sin(2.0 * np.pi * (cycles + 0.5) / 50.0)
    steady = 0.3 * cycles
    commands = np.stack([steady, every, slow], axis=1)
    # Two seconds at 100 Hz: all but the first two and the first cycle can turn and flip.
    assert motion.reversals(commands, 0.01) == 99.0
    assert motion.sign_flips(commands, 0.01) == 99.5
    assert motion.swings(commands, 0.01) == 99.0
    # The slow one, four periods, changes by little in each cycle, and still swings.
    assert motion.reversals(commands[:, ::2], 0.01) == 0.0
    assert motion.swings(commands[:, ::2], 0.01) == 4.0
    assert motion.swings(0.04 * commands, 0.01) == 0.0


@pytest.fixture
def calm(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('calm')


@pytest.mark.parametrize('robot', [
    'Panda', 'UR5', 'Talos arm', 'TIAGo', 'Baxter', 'planar 3R', 'TIAGo on wheels'])
@pytest.mark.parametrize('rate, acceleration', [(20, None), (100, 15.0)])
def test_robot_comes_to_rest_where_its_goal_cannot_be_reached(calm, robot, rate, acceleration):
    runs = [calm.run(robot, rate, acceleration, number, seed=1) for number in range(2)]
    assert [each for each in runs if not each.calm] == []


@pytest.mark.parametrize('plant', ['delay1', 'delay2', 'lag'])
def test_robot_that_follows_late_comes_to_rest_too(calm, plant):
    runs = [calm.run('planar 3R', 100, None, number, plant, seed=1) for number in range(4)]
    assert [each for each in runs if not each.calm] == []


@pytest.mark.parametrize('command', [
    ['limits.py', '--states', '5'], ['paths.py', '--paths', '1', '--seconds', '0.1'],
    ['solver.py', '--rounds', '1'], ['closed_loops.py', '--cycles', '400', '--jobs', '2'],
    ['inequalities.py', '--runs', '1', '--jobs', '2'], ['stacks.py', '--rounds', '1'],
    ['sizes.py', '--rounds', '1'], ['robustness.py', '--problems', '20'],
    ['calm.py', '--goals', '4', '--rates', '20'], ['loss.py', '--states', '4', '--below', '2'],
    ['loss.py', '--states', '1', '--below', '1', '--cycles', '3'], ['forms.py'],
    ['weights.py', '--states', '2', '--goals', '1'],
    ['causes.py', '--states', '1']])
def test_benchmark_runs_and_prints_a_table(command):
    name, *options = command
    done = subprocess.run([sys.executable, str(robots.REPOSITORY / 'benchmarks' / name), *options],
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 6

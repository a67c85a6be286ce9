# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmarks: random closed loops in a small version, and every benchmark runs at all."""

import importlib
import subprocess
import sys

import numpy as np
import pytest
import robots
from tp_controller import Controller, Level, Robot, Settings, solve, Stack
from tp_controller.tasks import task_types


@pytest.fixture
def closed_loops(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('closed_loops')


@pytest.mark.slow
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
    'joint_limits', 'keep_in', 'keep_out', 'field_of_view', 'tilt', 'distance',
    'orientation_range', 'manipulability_above', 'speed_limit', 'self_collision', 'obstacles'])
@pytest.mark.slow
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
def jumps(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('jumps')


@pytest.mark.slow
def test_only_acceleration_limits_bound_the_change_of_a_command_in_a_cycle(jumps):
    # With these the command jumps, each for another kind of reason.
    runs = [('HyQ', 34), ('UR5', 15), ('Panda', 22), ('Panda', 89)]
    assert max(jumps.run(*each).size for each in runs) > 1.0
    assert max(jumps.run(*each, acceleration=15.0).size for each in runs) <= 0.15 * (1.0 + 1e-9)


def test_jumps_are_told_apart(jumps):
    J, most = np.array([[1.0, 0.5]]), np.full(2, 0.9)

    def solved(v, J=J, upper=9.0):
        row = Level(np.eye(2)[:1], upper=np.array([upper]))
        return solve([row, Level(J, np.array([v]))], -most, most, scaling='redistribute')

    calm = solved(0.4)
    assert jumps.kind_of(calm, solved(-0.4)) == 'demand'
    assert jumps.kind_of(calm, solved(0.41, upper=0.2)) == 'bounds'
    assert jumps.kind_of(calm, solved(0.41, J=J / 5.0)) == 'limits'
    assert jumps.kind_of(calm, solved(0.41)) == 'singular'


@pytest.fixture
def calm(monkeypatch):
    """Return the module of the benchmark."""
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    return importlib.import_module('calm')


@pytest.mark.slow
@pytest.mark.parametrize('robot', [
    'Panda', 'UR5', 'Talos arm', 'TIAGo', 'Baxter', 'planar 3R', 'TIAGo on wheels'])
@pytest.mark.parametrize('rate, acceleration', [(20, None), (100, 15.0)])
def test_robot_comes_to_rest_where_its_goal_cannot_be_reached(calm, robot, rate, acceleration):
    runs = [calm.run(robot, rate, acceleration, number, seed=1) for number in range(2)]
    assert [each for each in runs if not each.calm] == []


@pytest.mark.slow
@pytest.mark.parametrize('number', [
    # joint_limit_distance of a joint with a short range, above other tasks.
    306, 525,
    # Bounds that cannot be met, and push against those of a level above, or against a task.
    499, 792, 336])
def test_random_stack_comes_to_rest(calm, number):
    found = calm.run_stack(number)
    assert found.calm, found


def test_manipulability_that_no_posture_has_lets_the_tasks_below_come_to_rest(calm):
    """At 50 Hz the length of its row, near the maximum, changes in every cycle."""
    robot = Robot.from_urdf(robots.urdf_path('xarm7'))
    stack = Stack.from_yaml("""
- - region: {type: keep_in, frame: link7, shape: {box: [0.356, 0.198, 0.204]},
             at: [0.057, 0.437, 0.519]}
  - mobile: {type: manipulability_above, frame: link7, minimum: 0.098}
- twist: {type: twist, frame: link7, timeout: 100.0}
- look: {type: look_at, frame: link7, gain: 2.0}
- posture: {type: posture, gain: 0.5}
""", robot)
    controller = Controller(robot, stack, Settings(period=0.02))
    q = np.array([-2.944, -0.852, -1.121, 1.074, -1.994, 1.9, 1.361])
    controller.update(q, 0.0)
    controller.set_goal('twist', [0.149, 0.033, -0.037, 0.118, -0.045, -0.029], 0.0)
    controller.set_goal('look', [0.912, 0.657, 0.358], 0.0)
    controller.set_goal('posture', [1.638, 0.282, 1.742, -0.01, 2.287, 1.372, 0.638], 0.0)
    commands = []
    for cycle in range(600):
        commands.append(controller.update(q, 0.02 * cycle).velocity)
        q = np.clip(q + 0.02 * commands[-1], robot.lower, robot.upper)
    assert calm.reversals(np.array(commands[-100:]), 0.02) <= calm.CALM


@pytest.mark.slow
def test_random_stacks_have_all_types_of_tasks(monkeypatch):
    monkeypatch.syspath_prepend(robots.REPOSITORY / 'benchmarks')
    drawn = importlib.import_module('_random_stacks')
    stacks = [drawn.Drawn(number).stack() for number in range(60)]
    found = {task.type_name for stack in stacks for task in stack.tasks.values()}
    assert found == set(task_types())


@pytest.mark.slow
@pytest.mark.parametrize('plant', ['delay1', 'delay2', 'lag'])
def test_robot_that_follows_late_comes_to_rest_too(calm, plant):
    runs = [calm.run('planar 3R', 100, None, number, plant, seed=1) for number in range(4)]
    assert [each for each in runs if not each.calm] == []


@pytest.mark.parametrize('command', [
    ['limits.py', '--states', '5'], ['paths.py', '--paths', '1', '--seconds', '0.1'],
    ['solver.py', '--rounds', '1'], ['closed_loops.py', '--cycles', '400', '--jobs', '2'],
    ['inequalities.py', '--runs', '1', '--jobs', '2'], ['stacks.py', '--rounds', '1'],
    ['sizes.py', '--rounds', '1'], ['robustness.py', '--problems', '20'],
    ['calm.py', '--goals', '4', '--rates', '20'], ['calm.py', '--stacks', '4'],
    ['loss.py', '--states', '4', '--below', '2'],
    ['loss.py', '--states', '1', '--below', '1', '--cycles', '3'], ['forms.py'],
    ['weights.py', '--states', '2', '--goals', '1'], ['limit_weights.py', '--goals', '1'],
    ['masks.py', '--stacks', '50'],
    ['jumps.py', '--runs', '1'], ['references.py', '--runs', '1'],
    ['jerk.py', '--cycles', '120000', '--moves', '0', '--goals', '1'],
    ['causes.py', '--tasks', '2'], ['hints.py', '--hints', '2'],
    ['published.py', '--problems', '50']])
@pytest.mark.slow
def test_benchmark_runs_and_prints_a_table(command):
    name, *options = command
    done = subprocess.run([sys.executable, str(robots.REPOSITORY / 'benchmarks' / name), *options],
                          capture_output=True, text=True, timeout=300)
    if 'PackageNotFoundError' in done.stderr:
        pytest.skip(done.stderr.splitlines()[-1])
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) > 6


# x_1 ≤ 1; x_1 + x_2 = 3 and x_2 ≤ 2; 2 x_1 = 0: solved by (1, 2), which misses 2 in the last.
STORED = """#nVar
2
#nObj
3
#OBJECTIVE 0
1 -1e12 1 2
#OBJECTIVE 1
1 1 3 3 3
0 1 -1e12 2 2
#OBJECTIVE 2
2 0 0 0 3
#Solution
1
2
"""


@pytest.mark.slow
def test_published_hierarchy_is_read_and_compared_with_its_solution(tmp_path):
    (tmp_path / 'stored.dat').write_text(STORED, encoding='utf-8')
    done = subprocess.run(
        [sys.executable, str(robots.REPOSITORY / 'benchmarks' / 'published.py'),
         '--problems', '1', '--lexls', str(tmp_path / 'stored.dat')],
        capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    misses = [float(each) for each in done.stdout.splitlines()[-1].split('|')[2:5]]
    assert misses == pytest.approx([2.0, 2.0, 2.0])

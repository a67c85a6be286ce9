# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Compare with other packages for inverse kinematics: pink, mink, placo, embodik, OInK, tsid.

Run as ``python benchmarks/peers.py``. What is not installed is skipped; ``pip install -e
.[peers]`` installs what can live beside this package. placo 0.10 needs pinocchio 3 and this
package pinocchio 4: make an environment of its own for it, ``python3 -m venv placo; placo/bin/pip
install placo``, and add ``--python placo=placo/bin/python``. tsid 1.10 needs pinocchio 4.0, so
the same for ``tsid==1.10.0 pin==4.0.0``. A part of it, libtsid, is marked for Python 3.14 but does
not use Python: install it first, ``pip install --target <environment>/lib/python3.11/site-packages
--no-deps --only-binary :all: --python-version 3.14 libtsid==1.10.0``. ``recursion`` is the plain
recursion of *lecture* (docs/sources.md), in numpy with pinocchio.

Every package has a process of its own, and all read the same URDF. ``--only`` takes some of:

- ``times``: of one cycle, all packages in turns, so that a machine whose speed drifts disturbs all
  alike; they are processor time, as all times here.
- ``cold``: the same with one cycle per millisecond, as in a node: in between caches get cold.
- ``positions``: inverse kinematics of a Panda, for the poses of random postures within its limits.
  Where a package has no call for that, its steps are repeated until none leads anywhere; each is
  to take away half of the error, or all of it. *Reached* is within 1e-6 m and rad, and within the
  limits.
- ``motions``: closed loops with an ideal robot at 100 Hz show how well the tasks are carried out.
  Goals of the second task come from another posture than those of the first, so the two contradict
  each other.

Packages have the settings of their examples. Where these have no second frame, each task costs a
tenth of the one before, as in the README of pink. tp_controller and embodik have their defaults,
embodik once ``MIN_ERROR``. OInK has the values of its documentation; its orientations have all
axes. pink has ``safety_break=False``, since DAQP takes joints 1e-6 rad beyond their limits. placo
has ``scaled`` for the strict first task, since ``hard`` fails where it cannot be met; its tasks
have no gain, so its goals are set a share of the way ahead in every cycle, which is not timed.
TSID solves for accelerations, with Kp = 2/s / period and Kd = 1 / period, so that a free task has
the demanded velocity after one cycle; ``TaskJointPosVelAccBounds`` keeps the limits; its strict
level is not used.
"""

import argparse
from collections import namedtuple
import json
from pathlib import Path
import platform
import subprocess
import sys
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

from _robots import load_robot, PANDA_READY, TALOS_READY
import numpy as np
from tp_controller import Controller, Robot, Settings, Stack

GAIN = 2.0
# Costs of the tasks of one robot, for packages that weight them: those of the packages' own
# examples for a Panda; elsewhere each task costs a tenth of the one before, as in pink's README.
Case = namedtuple('Case', 'robot ready tasks costs')
TENTHS = {'pink': (1.0, 0.1, 0.01, 1e-3), 'mink': (1.0, 0.1, 0.01, 1e-3),
          'placo': (1.0, 0.1, 0.01, 1e-3), 'tsid': (1.0, 0.1, 0.01, 1e-3)}
TOOL = {'name': 'tool', 'type': 'pose', 'frame': 'panda_hand_tcp'}
POSTURE = {'name': 'posture', 'type': 'posture'}
CASES = {
    'Panda, pose > posture': Case('Panda, URDF', PANDA_READY, [TOOL, POSTURE], {
        'pink': (1.0, 1e-3), 'mink': (1.0, 0.1), 'placo': (1.0, 1e-3),
        'tsid': (1.0, 1e-3 ** 0.5)}),
    'Panda, pose > elbow position': Case('Panda, URDF', PANDA_READY, [
        TOOL, {'name': 'elbow', 'type': 'position', 'frame': 'panda_link4'}], TENTHS),
    'Talos upper body, 18 joints, 4 levels': Case('Talos', TALOS_READY, [
        {'name': 'left', 'type': 'pose', 'frame': 'arm_left_7_link'},
        {'name': 'right', 'type': 'pose', 'frame': 'arm_right_7_link'},
        {'name': 'head', 'type': 'orientation', 'frame': 'head_2_link', 'axes': 'yz'},
        POSTURE], TENTHS),
}
# {package: its variants}
VARIANTS = {
    'tp_controller': ('',), 'pink': ('', 'first task hard'),
    'mink': ('', 'first task hard'), 'placo': ('', 'first task hard'),
    'embodik': ('', 'MIN_ERROR'), 'oink': ('',), 'tsid': ('',), 'recursion': ('', 'damped')}
# As the packages call them.
SHOWN = {('pink', 'first task hard'): 'pink, first task as `constraints`',
         ('mink', 'first task hard'): 'mink, first task as `constraints`',
         ('placo', ''): 'placo, `soft`',
         ('placo', 'first task hard'): 'placo, first task `scaled`',
         ('embodik', ''): 'embodik', ('embodik', 'MIN_ERROR'): 'embodik, `MIN_ERROR`',
         ('oink', ''): 'OInK',
         ('recursion', ''): 'plain recursion, `pinv`',
         ('recursion', 'damped'): 'plain recursion, damped'}
# Times are those of a node at 1 kHz, motions those of one at 100 Hz.
TIMED_PERIOD, PERIOD = 1e-3, 0.01
CYCLES = 200
TIMED_STATES = 64
# Where a cycle begins once per millisecond [s].
PAUSE = 1e-3
# Of inverse kinematics: {share of the error that a step takes away}, time of a step [s], most
# steps, and the error that is none [m or rad]. No velocity limit matters with this factor.
LIBRARY = 'Panda, pose > posture'
SHARES, STEP, MOST_STEPS, EXACT = {'half': 0.5, 'all': 1.0}, 0.1, 300, 1e-6
UNLIMITED = 100.0
PARTS = ('times', 'cold', 'positions', 'motions')
# Joints of a robot that is simulated with all goals, and not with a share of them.
FEWEST = 7
# How many times too fast the states with active limits are, in the median.
TOO_FAST = 2.5
# Standard deviations of postures around the working posture [rad]: of states that are timed, and
# of postures that goals come from, which stay clear of position limits by a share of the range.
NEAR, FAR, MARGIN = 0.2, 1.0, 0.1
# What counts as reached [m], [rad].
CLOSE, TURNED = 1e-3, 0.01
# What is not worth a number: a micrometre [mm], and what limits are exceeded by.
MICRON, ROUNDING = 1e-3, 1e-9
STRIPPED = ('visual', 'collision', 'transmission', 'gazebo', 'material')
PURE = ('mimic', 'safety_controller', 'calibration', 'dynamics')


def plain_urdf(robot, speed):
    """
    Return URDF text that all packages read alike.

    It has no meshes, joints that are not driven are fixed, and velocity limits are `speed` (n,).
    """
    tree = ElementTree.fromstring(robot.urdf)
    for parent in list(tree.iter()):
        for child in [child for child in parent if child.tag in STRIPPED + PURE]:
            parent.remove(child)
    limits = dict(zip(robot.joint_names, speed))
    for joint in tree.findall('joint'):
        if joint.get('name') in limits:
            joint.find('limit').set('velocity', repr(float(limits[joint.get('name')])))
        else:
            joint.set('type', 'fixed')
            for child in [child for child in joint if child.tag in ('axis', 'limit')]:
                joint.remove(child)
    return ElementTree.tostring(tree, encoding='unicode')


def stack_text(tasks, gain):
    """Return the stack of this package in YAML."""
    lines = []
    for task in tasks:
        keys = ', '.join(f'{key}: {value}' for key, value in task.items() if key != 'name')
        lines.append(f'- {task["name"]}: {{{keys}, gain: {gain}}}')
    return '\n'.join(lines)


class Scene:
    """A case with what all packages are given: files of the robot, states and goals."""

    def __init__(self, name, folder):
        self.name, self.case = name, CASES[name]
        self.source = load_robot(self.case.robot)
        self.ready = np.array(self.case.ready)
        self.folder, self.text = folder, stack_text(self.case.tasks, GAIN)
        path = self.write('limits', self.source.velocity)
        self.robot = Robot.from_urdf(path, joints=self.source.joint_names)

    def write(self, name, speed):
        """Return the path of a URDF with velocity limits."""
        path = self.folder / f'{self.case.robot.split(",")[0]}_{len(self.case.tasks)}_{name}.urdf'
        path.write_text(plain_urdf(self.source, speed), encoding='utf-8')
        return path

    def goals(self, *postures):
        """Return goals that the tasks have reached in postures, one for each task."""
        found = []
        for task, q in zip(self.case.tasks, postures):
            found.append((q if task['type'] == 'posture' else
                          self.robot.state(q).pose(task['frame'])).tolist())
        return found

    def draw(self, random, deviation):
        """Return a posture around the working posture, clear of position limits."""
        robot, margin = self.robot, MARGIN * (self.robot.upper - self.robot.lower)
        return np.clip(self.ready + deviation * random.standard_normal(robot.n),
                       robot.lower + margin, robot.upper - margin)

    def timed_states(self):
        """Return states without active limits, and the factor of speeds that makes them so."""
        random = np.random.default_rng(1)
        controller = Controller(self.robot, Stack.from_yaml(self.text, self.robot),
                                Settings(period=TIMED_PERIOD))
        # Tasks take what they find in the first cycle for their goals.
        controller.update(self.ready, 0.0, elapsed=TIMED_PERIOD)
        found = []
        for q in (self.draw(random, NEAR) for _ in range(4 * TIMED_STATES)):
            command = controller.update(q, 0.0, elapsed=TIMED_PERIOD)
            if command.report.scale == 1.0:
                found.append((np.max(np.abs(command.velocity) / self.robot.velocity), q))
        found.sort(key=lambda pair: pair[0])
        middle = found[max(len(found) - TIMED_STATES, 0) // 2:][:TIMED_STATES]
        factor = np.median([share for share, _ in middle]) / TOO_FAST
        return [q.tolist() for _, q in middle], factor

    def given(self, package, variant, urdf, speed, period, count, gain=GAIN):
        """Return what a package loads; only the first `count` tasks."""
        costs = self.case.costs.get(package, (1.0,) * len(self.case.tasks))
        tasks = [{**task, 'cost': cost} for task, cost in zip(self.case.tasks, costs)][:count]
        return {'urdf': str(urdf), 'joints': list(self.robot.joint_names),
                'speed': speed.tolist(), 'period': period, 'gain': gain, 'variant': variant,
                'tasks': tasks, 'stack': stack_text(self.case.tasks[:count], gain)}


class Package:
    """The process of a package."""

    def __init__(self, name, python):
        self.name = name
        worker = Path(__file__).with_name('_peers_worker.py')
        self._process = subprocess.Popen([python, str(worker), name], stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE, text=True)

    def meet(self):
        """Return the version of the package, and why it cannot be used; one of them is None."""
        answer = self._answer()
        return answer.get('version'), answer.get('skipped')

    def do(self, command, **keys):
        """Return the answer to a command."""
        self._process.stdin.write(json.dumps({'do': command, **keys}) + '\n')
        self._process.stdin.flush()
        return self._answer()

    def close(self):
        """End the process."""
        self._process.stdin.close()
        self._process.wait()

    def _answer(self):
        """Return the next answer."""
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f'{self.name} ended with {self._process.wait()}; see above')
        return json.loads(line)


def prepare(scenes, packages):
    """
    Load everything that is timed.

    Returns
    -------
    states : dict
        {scene: states it is timed in}
    keys : list
        What is timed: (scene, limits active, package, variant).

    """
    keys, states = [], {}
    for scene in scenes:
        states[scene.name], factor = scene.timed_states()
        goals = scene.goals(*[scene.ready] * len(scene.case.tasks))
        for active in (False, True):
            speed = scene.source.velocity * (factor if active else 1.0)
            urdf = scene.write('slow' if active else 'fast', speed)
            for package in packages:
                for variant in VARIANTS[package.name]:
                    key = (scene.name, active, package.name, variant)
                    keys.append(key)
                    package.do('load', key=str(key), **scene.given(
                        package.name, variant, urdf, speed, TIMED_PERIOD, None))
                    package.do('start', key=str(key), goals=goals)
    return states, keys


def measure(prepared, packages, rounds, pause):
    """
    Return microseconds and shares of cycles without a solution, in turns.

    Parameters
    ----------
    prepared : tuple
        What `prepare` returns.
    packages : list of Package
        All that were prepared.
    rounds : int
        How often everything is measured.
    pause : float
        Time asleep before each cycle [s]; 0 measures a tight loop.

    Returns
    -------
    dict
        {(scene, limits active, package, variant): list of answers}

    """
    states, keys = prepared
    found, owners = {key: [] for key in keys}, {package.name: package for package in packages}
    for _ in range(rounds):
        for key, rows in found.items():
            rows.append(owners[key[2]].do(
                'time', key=str(key), states=states[key[0]], pause=pause,
                cycles=CYCLES // 4 if pause else CYCLES))
    return found


def drawn_goals(scene, count):
    """Return the goals of the first task, and of all; each comes from a posture of its own."""
    random = np.random.default_rng(0)
    tasks = len(scene.case.tasks)
    drawn = [scene.goals(*(scene.draw(random, FAR) for _ in range(tasks)))
             for _ in range(count)]
    return [goals[:1] for goals in drawn], drawn


def simulate(scene, package, variant, goals, cycles, period=PERIOD, gain=GAIN):
    """Return the runs of a package towards all goals."""
    key = str((scene.name, len(goals[0]), variant))
    package.do('load', key=key, **scene.given(
        package.name, variant, scene.write('limits', scene.source.velocity),
        scene.source.velocity, period, len(goals[0]), gain))
    robot = scene.robot
    limits = [robot.lower.tolist(), robot.upper.tolist(), robot.velocity.tolist()]
    runs = [package.do('run', key=key, goals=each, q=scene.ready.tolist(), cycles=cycles,
                       limits=limits) for each in goals]
    for run, each in zip(runs, goals):
        run['errors'] = errors(scene, np.array(run['q']), each)
    return runs


def errors(scene, q, goals):
    """Return for each task how far it is from its goal: (distance [m], angle [rad])."""
    found, state = [], scene.robot.state(q)
    for task, goal in zip(scene.case.tasks, map(np.array, goals)):
        if task['type'] == 'posture':
            found.append((0.0, np.abs(goal - q).max()))
            continue
        pose = state.pose(task['frame'])
        cosine = 0.5 * (np.trace(goal[:3, :3] @ pose[:3, :3].T) - 1.0)
        found.append((np.linalg.norm(goal[:3, 3] - pose[:3, 3]),
                      np.arccos(np.clip(cosine, -1.0, 1.0))))
    return found


def reached(run):
    """Return whether the first task has reached its goal."""
    distance, angle = run['errors'][0]
    return bool(distance < CLOSE and angle < TURNED)


def shown(package, variant):
    """Return how a variant is called in the tables."""
    return SHOWN.get((package, variant), package)


def print_times(times, scenes, title):
    """Print a table of times."""
    print(f'\n## {title}\n')
    print('| µs per cycle | ' + ' | '.join(
        f'{scene.name}: {kind}' for scene in scenes for kind in ('idle', 'limits active')) + ' |')
    print('| --- |' + ' --- |' * (2 * len(scenes)))
    for package, variant in dict.fromkeys(key[2:] for key in times):
        cells = []
        for scene in scenes:
            for active in (False, True):
                rows = times[scene.name, active, package, variant]
                micros = [row['micros'] for row in rows]
                cells.append(f'{np.median(micros):.0f} ({min(micros):.0f}–{max(micros):.0f})')
                failed = np.mean([row['failed'] for row in rows])
                if failed:
                    cells[-1] += f', {percent(failed)} unsolved'
        print(f'| {shown(package, variant)} | {" | ".join(cells)} |', flush=True)


def print_positions(scene, packages, count):
    """Solve inverse kinematics for a pose, and print."""
    print('\n## Inverse kinematics\n\n| package | ' + ' | '.join(
        f'{share} of the error: reached [%] | median, 99 % [ms]' for share in SHARES)
        + ' |\n| --- |' + ' --- | --- |' * len(SHARES), flush=True)
    random, robot = np.random.default_rng(0), scene.robot
    goals = [scene.goals(random.uniform(robot.lower, robot.upper))[:1] for _ in range(count)]
    for package in packages:
        for variant in VARIANTS[package.name]:
            cells = []
            for share in SHARES.values():
                found = positions(scene, package, variant, goals, share)
                times = [1e3 * each['seconds'] for each in found]
                good = [within(robot, each['q']) and exact(scene, each['q'], goal)
                        for each, goal in zip(found, goals)]
                cells += [f'{100.0 * np.mean(good):.1f}',
                          f'{np.median(times):.2f}, {np.percentile(times, 99):.1f}']
            print(f'| {shown(package.name, variant)} | {" | ".join(cells)} |', flush=True)


def positions(scene, package, variant, goals, share):
    """Return the answers of a package to goals of the first task alone."""
    key, speed = str((scene.name, 'positions', variant, share)), UNLIMITED * scene.source.velocity
    package.do('load', key=key, **scene.given(
        package.name, variant, scene.write('unlimited', speed), speed, STEP, 1, share / STEP))
    return [package.do('positions', key=key, goals=goal, q=scene.ready.tolist(), steps=MOST_STEPS)
            for goal in goals]


def within(robot, q):
    """Return whether positions are within the limits, to the rounding of a solver."""
    return bool((q >= robot.lower - EXACT).all() and (q <= robot.upper + EXACT).all())


def exact(scene, q, goals):
    """Return whether the first task is at its goal, to a micrometre and a microradian."""
    goal = np.array(goals[0])
    pose = scene.robot.state(q).pose(scene.case.tasks[0]['frame'])
    return bool(np.abs(goal - pose).max() < EXACT)


def percent(share):
    """Return a share for people."""
    return f'{100.0 * share:.3g} %'


def readable(value, least):
    """Return a number for people; what is nearer to zero than `least` is only that."""
    return f'{float(f"{value:.2g}"):g}' if abs(value) >= least else f'< {least:g}'


def print_head(scene):
    """Print the head of a table of motions."""
    second = scene.case.tasks[1]
    unit = 'rad' if second['type'] == 'posture' else 'mm'
    print(f'\n### {scene.name}\n')
    print('| package | reached, first task alone | reached, all tasks | disturbance of the first '
          'task [mm]: median, 95 %, most | '
          f'{second["name"]} misses its goal by [{unit}], median | '
          'velocity limit exceeded by, share | position limit exceeded by [rad] | '
          'change of a velocity per cycle [rad/s]: median, 95 %, most | '
          'cycles without a solution |')
    print('| --- |' + ' --- |' * 8, flush=True)


def print_motions(scene, name, alone, together):
    """Print a row of motions."""
    lost = 1e3 * np.array([run['errors'][0][0] - first['errors'][0][0]
                           for first, run in zip(alone, together) if reached(first)])
    posture = scene.case.tasks[1]['type'] == 'posture'
    misses = np.median([run['errors'][1][posture] for run in together])
    runs = alone + together
    changes = [run['change'] for run in together]
    row = (
        f'{sum(map(reached, alone))} of {len(alone)}',
        f'{sum(map(reached, together))} of {len(together)}',
        ', '.join(readable(value, MICRON) for value in (
            np.median(lost), np.percentile(lost, 95), lost.max())) if lost.size else '–',
        f'{misses:.2f}' if posture else f'{1e3 * misses:.1f}',
        readable(max(run['speed'] for run in runs), ROUNDING),
        readable(max(run['position'] for run in runs), ROUNDING),
        f'{np.median(changes):.2g}, {np.percentile(changes, 95):.2g}, {max(changes):.2g}',
        percent(np.mean([run['failed'] for run in together])))
    print(f'| {name} | {" | ".join(row)} |', flush=True)


def compare(scenes, packages, count, seconds):
    """Simulate and print, scene by scene."""
    cycles, alone = int(seconds / PERIOD), {}
    for scene in scenes:
        print_head(scene)
        # Cycles of a robot with many joints take longer.
        first, drawn = drawn_goals(scene, -(-count * FEWEST // max(scene.robot.n, FEWEST)))
        for package in packages:
            for variant in VARIANTS[package.name]:
                key = (package.name, variant, json.dumps(first))
                if key not in alone:
                    alone[key] = simulate(scene, package, variant, first, cycles)
                print_motions(scene, shown(package.name, variant), alone[key],
                              simulate(scene, package, variant, drawn, cycles))


def open_packages(names, pythons):
    """Return the packages with these names that are installed, and say which are not."""
    found, versions = [], []
    # All at once: they take a while to start.
    for package in [Package(name, pythons.get(name, sys.executable)) for name in names]:
        version, skipped = package.meet()
        if skipped:
            print(f'skipped: {package.name} is not installed ({skipped})')
            package.close()
        else:
            found.append(package)
            versions.append(version)
    print(', '.join([*versions, f'numpy {np.__version__}',
                     f'Python {platform.python_version()}']))
    return found


def main():
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--states', type=int, default=200, help='random goals of each stack')
    parser.add_argument('--seconds', type=float, default=10.0, help='time to reach each')
    parser.add_argument('--rounds', type=int, default=15, help='of times, in turns')
    parser.add_argument('--python', action='append', default=[], metavar='PACKAGE=PATH',
                        help='interpreter of an environment that has a package')
    parser.add_argument('--poses', type=int, default=1000, help='of inverse kinematics')
    parser.add_argument('--only', nargs='+', choices=PARTS, default=PARTS)
    parser.add_argument('--packages', nargs='+', choices=VARIANTS, default=VARIANTS)
    options = parser.parse_args()
    packages = open_packages(options.packages, dict(each.split('=', 1) for each in options.python))
    with TemporaryDirectory() as folder:
        scenes = [Scene(name, Path(folder)) for name in CASES]
        paces = {'times': ('Times', 0.0), 'cold': ('Once per millisecond', PAUSE)}
        chosen = [pace for part, pace in paces.items() if part in options.only]
        prepared = prepare(scenes, packages) if chosen else None
        for title, pause in chosen:
            print_times(measure(prepared, packages, options.rounds, pause), scenes, title)
        if 'positions' in options.only:
            print_positions(next(scene for scene in scenes if scene.name == LIBRARY), packages,
                            options.poses)
        if 'motions' in options.only:
            print('\n## Motions', flush=True)
            compare(scenes, packages, options.states, options.seconds)
    for package in packages:
        package.close()


if __name__ == '__main__':
    main()

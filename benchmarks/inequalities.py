# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Run every type of inequality task in random closed loops, and count what must not happen.

Run as ``python benchmarks/inequalities.py``; ``--runs 30`` for a first impression, ``--types
keep_in`` for some types only. Every run draws a robot, a start, the bounds, and two goals for the
tool, most of them beyond the bounds. The stack is inequality task > tool pose > posture, with 100
cycles per second and 2.5 s for each goal. The robot is ideal: its positions are the integral of
the commands.

A run that starts outside its bounds must not go further out, and must end inside. A reversal is a
cycle in which the velocity of a joint that rose falls, or that fell rises, both by more than
0.01 rad/s; counted per second, for the joint that has most. Every fifth run is repeated without
the inequality task for comparison.
"""

import argparse
from dataclasses import dataclass
from functools import lru_cache
import multiprocessing
import time

from _motion import reversals
from _robots import CONFIG, load_robot
import numpy as np
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Settings, Stack
from tp_controller.model.spatial import pose, quaternion_from_rotation

PERIOD = 0.01
LEG = 250
# {robot: (tool, link that carries a camera, links that are watched for collisions)}
ROBOTS = {
    'Panda': ('panda_hand_tcp', 'panda_link7', None),
    'UR5': ('tool0', 'wrist_2_link', ['forearm_link', 'wrist_1_link', 'wrist_2_link',
                                      'wrist_3_link']),
    'Baxter': ('left_gripper', 'left_wrist', ['left_lower_forearm', 'left_wrist', 'left_hand_link',
                                              'right_lower_forearm', 'right_wrist',
                                              'right_hand_link']),
}
CAPSULES = CONFIG / 'panda_capsules.yaml'
# How far inside its limits every joint starts, and what its goals are made of [rad].
MARGIN, WIDEST = 0.15, 2.8
# Speed of regions that move [m/s].
FASTEST = 0.2
# Largest excess that is still none: what a tolerance of 1 mm or 0.2° is in each unit.
ALLOWED = {'m': 1e-3, 'rad': np.radians(0.2), '1': 5e-3, 'm/s': 1e-3}
SHOWN = {'m': (1e3, 'mm'), 'rad': (180.0 / np.pi, '°'), '1': (100.0, '%'), 'm/s': (1e3, 'mm/s')}
# How deep a link may be in an obstacle at the start [m], and how far joints must move it [m/rad].
DEEPEST, LEAST_MOVED = 0.05, 0.1
REPEATED = 5


@dataclass
class Run:
    """What came of one run: excess over the bounds [unit], and reversals per second."""

    name: str
    unit: str
    start: float
    deepest: float
    end: float
    reversals: float
    # Not a number where the run was not repeated.
    reversals_without: float


class Scene:
    """What a run is about, drawn from one generator."""

    def __init__(self, kind, number):
        self.kind, self.name = kind, f'{kind}, run {number}'
        self.random = np.random.default_rng((list(BOUNDS).index(kind), number))
        robot_name = list(ROBOTS)[number % len(ROBOTS)]
        self.robot = _robot(robot_name)
        self.tool, self.camera, self.links = ROBOTS[robot_name]
        self.capsules = CAPSULES if robot_name == 'Panda' else None
        self.start = self.place()
        self.state = self.robot.state(self.start)
        # Where a region is and how it moves; None for what has none.
        self.at, self.speed = None, np.zeros(3)
        self.bounds = BOUNDS[kind](self)
        self.goals = [self.robot.state(self.place()).pose(self.tool) for _ in range(2)]

    def place(self):
        """Return random positions (n,), some way within the limits."""
        lower = np.maximum(self.robot.lower, -WIDEST) + MARGIN
        return self.random.uniform(lower, np.minimum(self.robot.upper, WIDEST) - MARGIN)

    def near(self, frame, least, most):
        """Return a point (3,) at a random distance from a frame."""
        way = self.random.normal(size=3)
        return self.state.position(frame) + way * (
            self.random.uniform(least, most) / np.linalg.norm(way))

    def region(self, point):
        """Return keys of a region of any shape about a point, turned at random."""
        random = self.random
        x, y, z = random.uniform(0.15, 0.4, 3)
        shape = (f'{{box: [{x}, {y}, {z}]}}', f'{{sphere: {0.7 * x}}}',
                 f'{{cylinder: [{0.7 * x}, {y}]}}')[random.integers(3)]
        self.at = pose(Rotation.random(random_state=random).as_matrix(), point)
        turn = quaternion_from_rotation(self.at[:3, :3])
        return f'shape: {shape}, at: [{", ".join(map(str, (*point, *turn)))}]'

    def stack(self, bounded):
        """Return the stack, with the bounds at its top or without them."""
        text = f"""
{self.bounds if bounded else ''}
- tool: {{type: pose, frame: {self.tool}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
"""
        return Stack.from_yaml(text, self.robot)


# What is drawn for each type ---------------------------------------------------------------


def _joint_limits(scene):
    """Keep joints a random margin away from their limits."""
    return f'- guard: {{type: joint_limits, margin: {scene.random.uniform(0.05, 0.3)}}}'


def _keep_in(scene):
    """Keep the tool in a region around it."""
    region = scene.region(scene.near(scene.tool, 0.0, 0.12))
    return f'- guard: {{type: keep_in, frame: {scene.tool}, {region}}}'


def _keep_out(scene):
    """Keep a ball around the tool out of a region, which moves in every third run."""
    region = scene.region(scene.near(scene.tool, 0.1, 0.5))
    if scene.random.random() < 1.0 / 3.0:
        way = scene.random.normal(size=3)
        scene.speed = way * (scene.random.uniform(0.0, FASTEST) / np.linalg.norm(way))
    return f'- guard: {{type: keep_out, frame: {scene.tool}, radius: 0.05, {region}}}'


def _field_of_view(scene):
    """Keep a point in view, and not too near to turn to."""
    ahead = scene.state.rotation(scene.camera)[:, 2] * scene.random.uniform(0.4, 1.5)
    x, y, z = scene.state.position(scene.camera) + ahead + 0.15 * scene.random.normal(size=3)
    return f"""
- [guard: {{type: field_of_view, frame: {scene.camera}, target: [{x}, {y}, {z}],
            half_angle: {scene.random.uniform(0.2, 0.7)}}},
   apart: {{type: keep_out, frame: {scene.camera}, shape: {{sphere: 0.2}}, at: [{x}, {y}, {z}]}}]
"""


def _tilt(scene):
    """Keep an axis of the tool near its direction at the start."""
    x, y, z = scene.state.rotation(scene.tool)[:, 2] + 0.2 * scene.random.normal(size=3)
    return (f'- guard: {{type: tilt, frame: {scene.tool}, direction: [{x}, {y}, {z}], '
            f'within: {scene.random.uniform(0.1, 0.7)}}}')


def _orientation_range(scene):
    """Keep the turn of the tool from its orientation at the start, or from one nearby."""
    start = Rotation.from_matrix(scene.state.rotation(scene.tool))
    turn = Rotation.from_rotvec(0.2 * scene.random.normal(size=3))
    target = (start * turn).as_quat().tolist()
    return (f'- guard: {{type: orientation_range, frame: {scene.tool}, target: {target}, '
            f'maximum: {scene.random.uniform(0.1, 1.0, 3).tolist()}}}')


def _distance(scene):
    """Keep the distance from a point near that at the start, which may be too small."""
    point = scene.near(scene.tool, 0.1, 0.5)
    x, y, z = point
    least, most = np.linalg.norm(point - scene.state.position(scene.tool)) \
        * scene.random.uniform((0.3, 1.2), (1.1, 2.5))
    return (f'- guard: {{type: distance, frame: {scene.tool}, at: [{x}, {y}, {z}], '
            f'minimum: {least}, maximum: {most}}}')


def _manipulability_above(scene):
    """Keep most of the manipulability there is at the start."""
    J = scene.state.jacobian(scene.tool)
    most = np.sqrt(np.linalg.det(J @ J.T)) * scene.random.uniform(0.5, 0.95)
    return (f'- guard: {{type: manipulability_above, frame: {scene.tool}, '
            f'minimum: {max(most, 1e-3)}}}')


def _speed_limit(scene):
    """Keep the tool slow."""
    linear, angular = scene.random.uniform((0.05, 0.2), (0.4, 1.0))
    return (f'- guard: {{type: speed_limit, frame: {scene.tool}, linear: {linear}, '
            f'angular: {angular}}}')


def _self_collision(scene):
    """Keep links apart: the arm and its stand, or two arms."""
    return f'- guard: {{type: self_collision, {_shapes(scene)}}}'


def _obstacles(scene):
    """Keep links away from three obstacles of any shape, which they may touch at the start."""
    while True:
        obstacles = ', '.join(
            f'obstacle{number}: {{{scene.region(scene.near(scene.tool, 0.2, 0.7))}}}'
            for number in range(3))
        scene.at = None
        text = f'- guard: {{type: obstacles, {_shapes(scene)}, obstacles: {{{obstacles}}}}}'
        if _can_leave(Stack.from_yaml(text, scene.robot).tasks['guard'], scene.state):
            return text


def _can_leave(task, state):
    """Say whether what is outside is not far outside, and not the foot of the robot."""
    distances, J = task.observe(state)
    excess = task.distance - distances
    moved = np.linalg.norm(J, axis=1)
    return (excess < DEEPEST).all() and (moved[excess > 0.0] > LEAST_MOVED).all()


def _shapes(scene):
    """Return the keys that say which links, and what they look like."""
    if scene.capsules:
        return f'capsules: {scene.capsules}'
    return f'links: [{", ".join(scene.links)}]'


# The place of a type seeds its runs: new ones come last.
BOUNDS = {
    'field_of_view': _field_of_view, 'joint_limits': _joint_limits, 'keep_in': _keep_in,
    'keep_out': _keep_out, 'manipulability_above': _manipulability_above,
    'obstacles': _obstacles, 'self_collision': _self_collision, 'speed_limit': _speed_limit,
    'tilt': _tilt, 'distance': _distance, 'orientation_range': _orientation_range,
}


@lru_cache(maxsize=None)
def _robot(name):
    """Return a robot; made once."""
    return load_robot(name)


# Running -----------------------------------------------------------------------------------


def run(kind, number):
    """Return the `Run` with a number; what goes wrong is told by its name."""
    try:
        return _run(kind, number)
    except Exception as error:
        raise RuntimeError(f'{kind}, run {number}: {error}') from None


def _run(kind, number):
    """Return the `Run` with a number."""
    scene = Scene(kind, number)
    unit, excess, commands = _loop(scene, True)
    without = np.nan
    if number % REPEATED == 0:
        without = reversals(_loop(scene, False)[2], PERIOD)
    return Run(scene.name, unit, excess[0], max(excess), excess[-1],
               reversals(commands, PERIOD), without)


def _loop(scene, bounded):
    """Return the unit of the bounds, the excess over them at every cycle, commands (T, n)."""
    robot, q = scene.robot, scene.start
    stack = scene.stack(bounded)
    controller = Controller(robot, stack, Settings(period=PERIOD, command_delay=0))
    guard = stack.tasks.get('guard')
    excess, commands = [], []
    controller.update(q, 0.0)
    for cycle in range(LEG * len(scene.goals)):
        now = cycle * PERIOD
        if cycle % LEG == 0:
            controller.set_goal('tool', scene.goals[cycle // LEG], now)
        if guard is not None and scene.speed.any():
            T = pose(scene.at[:3, :3], scene.at[:3, 3] + now * scene.speed)
            controller.set_goal('guard', T, now)
            controller.set_feed_forward('guard', [*scene.speed, 0.0, 0.0, 0.0], now)
        command = controller.update(q, now)
        if guard is not None:
            excess.append(_excess(command.report))
        commands.append(command.velocity)
        q = np.clip(robot.integrate(q, command.velocity, PERIOD), robot.lower, robot.upper)
    unit = command.report.tasks[0].errors[0][1]
    return unit, excess, np.array(commands)


def _excess(report):
    """Return how far outside of its bounds the guard was in a cycle."""
    guard, = (task for task in report.tasks if task.name == 'guard')
    return max(value for value, _, _ in guard.errors)


def rows(kind, runs):
    """Return the cells of a type."""
    scale, unit = SHOWN[runs[0].unit]
    inside = [each for each in runs if each.start == 0.0]
    outside = [each for each in runs if each.start > 0.0]
    deepest = scale * max((each.deepest for each in inside), default=0.0)
    deeper = scale * max((each.deepest - each.start for each in outside), default=0.0)
    allowed = ALLOWED[runs[0].unit]
    back = sum(each.end <= allowed for each in outside)
    with_, without = (np.array([getattr(each, name) for each in runs])
                      for name in ('reversals', 'reversals_without'))
    return [f'`{kind}`', len(runs), f'{deepest:.2g} {unit}', f'{back} of {len(outside)}',
            f'{deeper:.2g} {unit}', f'{with_.mean():.2f}, {with_.max():.1f}',
            f'{np.nanmean(without):.2f}, {np.nanmax(without):.1f}']


def findings(runs):
    """Yield what must not happen."""
    for each in runs:
        allowed = ALLOWED[each.unit]
        if each.deepest > each.start + allowed:
            yield f'{each.name}: {each.deepest:.4g} {each.unit} outside, from {each.start:.4g}'
        if each.start > 0.0 and each.end > allowed:
            yield f'{each.name}: not back, {each.end:.4g} {each.unit} outside'


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=1000, help='of each type')
    parser.add_argument('--types', nargs='+', choices=BOUNDS, default=list(BOUNDS))
    parser.add_argument('--jobs', type=int, default=1, help='processes')
    options = parser.parse_args()
    head = ('type', 'runs', 'deepest', 'started outside, came back', 'deeper than at the start',
            'reversals 1/s: mean, most', 'without the bounds')
    print('| ' + ' | '.join(head) + ' |\n|' + ' --- |' * len(head), flush=True)
    found = []
    with multiprocessing.Pool(options.jobs) as pool:
        for kind in options.types:
            began = time.monotonic()
            work = [(kind, number) for number in range(options.runs)]
            runs = pool.starmap(run, work, chunksize=5)
            print('| ' + ' | '.join(map(str, rows(kind, runs)))
                  + f' |  <!-- {time.monotonic() - began:.0f} s -->', flush=True)
            found.extend(findings(runs))
    for finding in found:
        print(finding)


if __name__ == '__main__':
    main()

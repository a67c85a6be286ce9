# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""
Jerk limits: a search for a counterexample, and what they cost.

``python benchmarks/jerk.py`` runs three parts; each can be left out or made smaller by its number.

``--cycles``
    Bounds of single joints in random and adversarial cycles: ranges, limits, periods and times of
    cycles are random, and each joint has one of `STRATEGIES` to choose its commands within the
    bounds. Printed is the farthest that any joint gets beyond one of its limits.
``--goals``
    A robot goes from random positions to random poses of the tool, with and without a jerk limit:
    the largest second difference of the commands, the cycles in which it is above the limit, and
    the time until the tool is there, and stays for a second, relative to that without.
``--moves``
    Single joints, with the limits of those of ``--cycles``, go from rest to one end of their range
    as fast as the bounds allow: the time until they are nearly there, relative to the time-optimal
    motion of ``ruckig``, if that is installed (``pip install ruckig``).
"""

import argparse
from dataclasses import dataclass
import itertools
import time
from types import SimpleNamespace

from _robots import load_robot
import numpy as np
from tp_controller import Controller, Settings, Stack
from tp_controller.control.joint_limits import JointMotion
from tp_controller.control.velocity_limits import VelocityLimits

try:
    import ruckig
except ImportError:
    ruckig = None

STRATEGIES = ('up', 'down', 'for a while', 'alternating', 'random', 'aims')
SCALINGS = ('redistribute', 'uniform')
# {name: robot, tool, cycles per second, accelerations [rad/s²], jerks [rad/s³]}. Of the FR3 those
# of rate_limiting.h of libfranka.
CASES = {
    'FR3, 1 kHz': ('FR3', 'fr3_link8', 1000, 10.0, 5000.0),
    'Panda, 100 Hz, 1000': ('Panda', 'panda_link8', 100, 7.5, 1000.0),
    'Panda, 100 Hz, 300': ('Panda', 'panda_link8', 100, 7.5, 300.0),
    'Panda, 100 Hz, 100': ('Panda', 'panda_link8', 100, 7.5, 100.0),
}
# What a tool is at its goal within [m, 1], rotations by the norm of their difference, and the
# longest that is waited for [s].
THERE, LONGEST = (1e-3, 1e-2), 10.0
# How long it has to stay: a robot may pass a singularity within, and leave once more [s].
STAYS = 1.0
# Speed of the joints below which a robot has come to rest elsewhere, after a second [rad/s].
STILL = 1e-4
# Share of the ranges from which starts and goals are.
WITHIN = 0.7
# Share of a way of which a joint may be away from its end to be there.
NEARLY = 0.01
# Second differences count as above a limit beyond this share.
ROUNDING = 1e-9


class Joints:
    """Single joints with limits and a period of their own, drawn from a generator."""

    def __init__(self, number, count, full_gain=False):
        self.random = random = np.random.default_rng(number)
        self.period = 10.0 ** random.uniform(-3.0, -1.3)
        middle, reach = random.uniform(-2.0, 2.0, count), 10.0 ** random.uniform(-4.0, 0.5, count)
        self.lower, self.upper = middle - reach, middle + reach
        self.velocity = 10.0 ** random.uniform(-1.0, 1.0, count)
        self.acceleration = 10.0 ** random.uniform(-0.5, 2.0, count)
        # From a tenth of a cycle to 300 s until the acceleration is there.
        self.jerk = self.acceleration / 10.0 ** random.uniform(-2.5, 0.5, count)
        self.acceleration[random.random(count) < 0.1] = np.inf
        limits = {key: getattr(self, key)
                  for key in ('lower', 'upper', 'velocity', 'acceleration', 'jerk')}
        gain = random.choice([1.0, random.uniform(0.02, 1.0)])
        gain = 1.0 / self.period if full_gain else gain / self.period
        self.limits = VelocityLimits(SimpleNamespace(limits=limits), self.period, gain)
        self.start = middle + random.uniform(-1.0, 1.0, count) * reach


def adversary(number, count=300, cycles=400):
    """
    Return how far joints get beyond their limits within the bounds, at most.

    Returns
    -------
    dict
        {limit: excess}, of positions in rad, of others as a share of the limit.

    """
    joints = Joints(number, count)
    random, T = joints.random, joints.period
    strategy = random.integers(0, len(STRATEGIES), count)
    regular, h = random.random() < 0.3, T
    q, v, a, before = joints.start, np.zeros(count), np.zeros(count), T
    demanding = random.random() < 0.5
    worst = dict.fromkeys(('position', 'velocity', 'acceleration', 'jerk'), -np.inf)
    for cycle in range(cycles):
        if cycle % 37 == 0:
            aim = random.uniform(-1.2, 1.2, count) * joints.velocity
            while_up = random.integers(0, 2, count)
        motion = JointMotion(q, v, h, (), T, a, before, aim if demanding else None)
        least, most = joints.limits.box(motion)
        share = np.select(
            [strategy == index for index in range(5)],
            [1.0, 0.0, while_up, random.integers(0, 2, count), random.random(count)])
        # Exactly the bounds, not what rounding makes of them.
        command = np.where(share == 1.0, most, np.minimum(least + share * (most - least), most))
        command = np.where(strategy == 5, np.clip(aim, least, most), command)
        rate = (command - v) / h
        changes = np.abs(rate - a) / (0.5 * (h + before))
        before, v, a = h, command, rate
        h = T if regular or random.random() < 0.3 else T * random.uniform(0.02, 1.0)
        q = q + v * h
        for key, excess in (('position', np.maximum(q - joints.upper, joints.lower - q)),
                            ('velocity', np.abs(v) / joints.velocity - 1.0),
                            ('acceleration', np.abs(a) / joints.acceleration - 1.0),
                            ('jerk', changes / joints.jerk - 1.0)):
            worst[key] = max(worst[key], float(excess.max()))
    return worst


@dataclass
class Motion:
    """A motion: its time to the goal [s], infinite if it does not stay there; differences."""

    time: float
    acceleration: np.ndarray
    jerk: np.ndarray
    above: int


def robot_of(case, limited=True):
    """Return the robot of a case, with or without its jerk limits."""
    name, _, _, accelerations, jerks = CASES[case]
    names = load_robot(name).joint_names
    values = np.broadcast_to(accelerations, len(names)), np.broadcast_to(jerks, len(names))
    return load_robot(name, limits={
        joint: {'acceleration': float(most)} | ({'jerk': float(jerk)} if limited else {})
        for joint, most, jerk in zip(names, *values)})


def is_there(pose, goal):
    """Return whether a tool is at its goal."""
    return np.linalg.norm(pose[:3, 3] - goal[:3, 3]) < THERE[0] \
        and np.linalg.norm(pose[:3, :3] - goal[:3, :3]) < THERE[1]


def move(robot, case, number, scaling='redistribute'):
    """Return the `Motion` of a robot to a goal, until it stays there or is at rest."""
    _, tool, rate, _, jerks = CASES[case]
    random = np.random.default_rng(number)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    start, end = middle + WITHIN * half * random.uniform(-1.0, 1.0, (2, robot.n))
    stack = Stack([{'tool': {'type': 'pose', 'frame': tool, 'gain': 2.0}},
                   {'posture': {'type': 'posture', 'gain': 0.5}}], robot)
    controller = Controller(robot, stack, Settings(period=1.0 / rate, scaling=scaling))
    goal, state = robot.state(end).pose(tool), robot.state(start)
    controller.set_goal('tool', goal, 0.0)
    q, v, a = start, np.zeros(robot.n), np.zeros(robot.n)
    found = Motion(np.inf, np.zeros(robot.n), np.zeros(robot.n), 0)
    for cycle in range(round(LONGEST * rate)):
        command = controller.update(q, cycle / rate)
        change = (command.velocity - v) * rate
        second = np.abs(change - a) * rate
        v, a = command.velocity, change
        found.acceleration = np.maximum(found.acceleration, np.abs(a))
        found.jerk = np.maximum(found.jerk, second)
        found.above += int((second > np.asarray(jerks) * (1.0 + ROUNDING)).any())
        q = robot.integrate(q, v, 1.0 / rate)
        if cycle % (rate // 100) == 0:
            state.update(q)
            there = is_there(state.pose(tool), goal)
            found.time = min(found.time, cycle / rate) if there else np.inf
            if cycle / rate >= found.time + STAYS:
                break
            if cycle > rate and np.abs(v).max() < STILL:
                break
    return found


def shares(limited, free):
    """Return the times with a limit relative to those without, of goals that both reach."""
    ratios = np.array([one.time / other.time for one, other in zip(limited, free)
                       if np.isfinite(one.time) and np.isfinite(other.time)])
    return ratios if len(ratios) else np.array([np.nan])


def arrival_times(joints, cycles=20_000):
    """Return the times (n,) in which joints from rest get near their upper limits [s]."""
    T, q, v = joints.period, joints.start, np.zeros(len(joints.start))
    a, before, found = 0.0 * v, T, np.full(len(v), np.nan)
    near = joints.upper - NEARLY * (joints.upper - joints.start)
    for cycle in range(cycles):
        motion = JointMotion(q, v, T, (), T, a, before, joints.velocity)
        command = joints.limits.box(motion)[1]
        v, a = command, (command - v) / T
        q = q + T * v
        found[np.isnan(found) & (q >= near)] = (cycle + 1) * T
        if np.isfinite(found).all():
            break
    return found


def optimal_time(joints, index):
    """Return the time at which the time-optimal motion to its limit takes a joint as near [s]."""
    way = float(joints.upper[index] - joints.start[index])
    given = ruckig.InputParameter(1)
    given.current_position, given.target_position = [0.0], [way]
    given.current_velocity = given.current_acceleration = [0.0]
    given.target_velocity = given.target_acceleration = [0.0]
    given.max_velocity = [float(joints.velocity[index])]
    given.max_acceleration = [min(float(joints.acceleration[index]), 1e6)]
    given.max_jerk = [float(joints.jerk[index])]
    motion = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(given, motion)
    early, late = 0.0, motion.duration
    for _ in range(50):
        middle = 0.5 * (early + late)
        position, *_ = motion.at_time(middle)
        early, late = (middle, late) if position[0] < (1.0 - NEARLY) * way else (early, middle)
    return late


def moves(count):
    """Print times of single joints relative to those of time-optimal motions."""
    ratios, shares_of = [], []
    for number in range(-(-count // 50)):
        joints = Joints(number, 50, full_gain=True)
        times = arrival_times(joints)
        for index in np.flatnonzero(np.isfinite(times)):
            optimal = optimal_time(joints, index)
            ratios.append(times[index] / optimal)
            shares_of.append(joints.period / optimal)
    ratios, few = np.array(ratios), np.array(shares_of) > 0.05
    print('| motions of single joints | number | time / time-optimal: median | 90 % | most |')
    print('|' + ' --- |' * 5)
    for title, which in (('of at least 20 cycles', ~few), ('of fewer', few)):
        print(f'| {title} | {which.sum()} | {np.median(ratios[which]):.3f} | '
              f'{np.quantile(ratios[which], 0.9):.3f} | {ratios[which].max():.3f} |', flush=True)


def search(cycles):
    """Print how far joints get beyond their limits in so many cycles of single joints."""
    count, length, worst, began = 300, 400, {}, time.monotonic()
    runs = -(-cycles // (count * length))
    for number in range(runs):
        for key, excess in adversary(number, count, length).items():
            worst[key] = max(worst.get(key, -np.inf), excess)
    excesses = ', '.join(f'{key} {excess:.1e}' for key, excess in worst.items())
    print(f'{runs * count * length:,} cycles, {time.monotonic() - began:.0f} s; farthest beyond '
          f'the limits: {excesses}', flush=True)


def goals(count, cases):
    """Print jerks, and times relative to those without a jerk limit, of motions to goals."""
    head = ('case', 'scaling', 'largest jerk, share of the limit', 'without',
            'cycles above', 'reached', 'without', 'time: mean', '99 %', 'most')
    print('| ' + ' | '.join(head) + ' |\n|' + ' --- |' * len(head))
    for case, scaling in itertools.product(cases, SCALINGS):
        limited, free = ([move(robot_of(case, each), case, number, scaling)
                          for number in range(count)] for each in (True, False))
        jerks = np.asarray(CASES[case][4])
        ratios = shares(limited, free)
        cells = (case, scaling, *(f'{max((each.jerk / jerks).max() for each in runs):.3f}'
                                  for runs in (limited, free)),
                 sum(each.above for each in limited),
                 *(sum(np.isfinite(each.time) for each in runs) for runs in (limited, free)),
                 f'{ratios.mean():.3f}', f'{np.quantile(ratios, 0.99):.3f}', f'{ratios.max():.3f}')
        print('| ' + ' | '.join(map(str, cells)) + ' |', flush=True)


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--cycles', type=int, default=10_000_000, help='of single joints')
    parser.add_argument('--goals', type=int, default=1000, help='of each case')
    parser.add_argument('--moves', type=int, default=2000, help='of single joints')
    parser.add_argument('--cases', nargs='+', choices=CASES, default=list(CASES))
    options = parser.parse_args()
    if options.cycles:
        search(options.cycles)
    if options.moves and ruckig is not None:
        moves(options.moves)
    if options.goals:
        goals(options.goals, options.cases)


if __name__ == '__main__':
    main()

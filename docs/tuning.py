# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Draw the pictures of docs/tuning.md: the same motion before and after a setting is changed.

``python docs/tuning.py`` writes docs/images/tuning/<case>.png for all cases, ``python
docs/tuning.py delay drift`` only those two, and prints the numbers that the page quotes. Each is
a closed loop without ROS. Every picture is one entry of `CASES`.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from tp_controller import (
    Controller,
    KinematicSimulator,
    Robot,
    Settings,
    SimulatorNoise,
    Stack,
)
from tp_controller.tools.plots import drawing

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'images' / 'tuning'
PERIOD = 0.01
TOOL = 'panda_hand_tcp'
# The tool straight down, far from every limit.
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
DOWN = (1.0, 0.0, 0.0, 0.0)
BEFORE = {'color': '#D55E00', 'linewidth': 1.6, 'linestyle': (0, (4, 1.5))}
AFTER = {'color': '#0072B2', 'linewidth': 2.0}


def no_goals(now):
    """Return no goals."""
    return ()


@dataclass(frozen=True)
class Setup:
    """
    One of two closed loops that are compared.

    Attributes
    ----------
    label : str
        What is set.
    stack : str
        YAML text.
    goals : callable
        Returns tuples (task, goal, feed-forward velocity or None) for a time [s]; they are sent
        in every cycle where they change.
    settings : dict
        Of the controller.
    seconds : float
    q : tuple of float
        Positions of the joints at the start [rad].
    limits : dict
        In place of those of the description.
    noise : SimulatorNoise
        Of the robot.
    file, base : str
        Robot in config/robots/, and how its base moves.

    """

    label: str
    stack: str
    goals: Callable = no_goals
    settings: dict = field(default_factory=dict)
    seconds: float = 5.0
    q: tuple = READY
    limits: dict = field(default_factory=dict)
    noise: SimulatorNoise = SimulatorNoise()
    file: str = 'panda.yaml'
    base: str = 'fixed'


class Run:
    """
    What happened in a closed loop.

    Attributes
    ----------
    setup : Setup
    times, q, commands : ndarray
        One row a cycle.
    tool : ndarray (cycles, 3)
        Position of the tool [m].
    report : Report
        The last one.

    """

    def __init__(self, setup, tool=TOOL):
        self.setup = setup
        file = ROOT / 'config' / 'robots' / setup.file
        self.robot = Robot.from_file(file, base=setup.base, limits=setup.limits)
        controller = Controller(self.robot, Stack.from_yaml(setup.stack, self.robot),
                                Settings(**{'period': PERIOD, 'command_delay': 0,
                                            **setup.settings}))
        start = self.robot.neutral()
        start[self.robot.joint_rows] = setup.q
        # The limits are those of the controller: the robot itself could go on.
        real = Robot.from_file(file, base=setup.base)
        simulator = KinematicSimulator(real, start, noise=setup.noise)
        sent, rows = {}, []
        self.times = PERIOD * np.arange(round(setup.seconds / PERIOD))
        for now in self.times:
            for name, goal, velocity in setup.goals(now):
                if goal is not None and sent.get(name) != goal:
                    controller.set_goal(name, goal, now)
                    sent[name] = goal
                if velocity is not None:
                    controller.set_feed_forward(name, velocity, now)
            command = controller.update(simulator.q, now)
            position = self.robot.state(simulator.q).position(tool).copy()
            rows.append((simulator.q.copy(), command.velocity.copy(), position))
            simulator.command(command.velocity)
            simulator.step(PERIOD)
        self.q, self.commands, self.tool = (np.array(column) for column in zip(*rows))
        self.report = command.report


# Stacks and goals -------------------------------------------------------------------------

POSE = """
- tool: {{type: pose, frame: panda_hand_tcp, gain: {gain}}}
- posture: {{type: posture, gain: 0.5}}
"""
POINT = '- tool: {type: position, frame: panda_hand_tcp, gain: 3.0}\n'
DOWNWARDS = ('- down: {type: pointing, frame: panda_hand_tcp, axis: z, target: [0, 0, -1], '
             'gain: 5.0}\n')
POSTURE = '- posture: {type: posture, gain: 0.5}\n'
# As the manufacturer publishes them [rad/s²].
ACCELERATIONS = {f'panda_joint{index}': {'acceleration': value} for index, value in enumerate(
    (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0), 1)}
SIDEWAYS = (0.35, 0.35, 0.45)
# Within reach, but not with the tool straight down.
FAR = (0.7, 0.2, 0.6)
# A pose behind the stand, on whose direct way joint 2 comes to its limit.
BEHIND = (-0.625, 0.279, 0.692, 0.030, 0.769, 0.530, -0.356)
LATE = SimulatorNoise(delay=0.05)
HEIGHT = 0.29
# Corner of the workspace that the tool passes above the stand, and how fast [m, m/s].
PASS_START, PASS_SPEED, PASS_SECONDS = np.array([0.06, -0.4, 0.75]), 0.2, 4.0
LIMITED = 2.0
WHEELED = {'file': 'mobile_arm.urdf', 'base': 'differential',
           'q': (0.15, 0.3, 0.5, 0.0, 1.2, 0.0, -0.6, 0.0)}
WHEELED_GOAL = (0.91, 0.22, 0.13)
# Middle [m], size [m] and angular speeds [rad/s] of a fast curve in space.
LISSAJOUS = (np.array([0.5, 0.0, 0.45]), np.array([0.142, 0.22, 0.228]),
             np.array([3.43, 4.29, 3.29]))


def stay(task, goal):
    """Return goals that are one goal, from the start on."""
    return lambda now: ((task, goal, None),)


def circle(now, feed_forward=True):
    """Return a goal on a circle of 0.12 m, once round in 3 s."""
    angle, rate = 2.0 * np.pi * now / 3.0, 2.0 * np.pi / 3.0
    c, s = 0.12 * np.cos(angle), 0.12 * np.sin(angle)
    return (('tool', (0.45 + c, 0.1 + s, 0.4),
             (-s * rate, c * rate, 0.0, 0.0, 0.0, 0.0) if feed_forward else None),)


def outwards(now):
    """Return a goal that moves away until it is out of reach."""
    return (('tool', (0.4 + 0.25 * min(now, 2.5), 0.0, 0.5),
             (0.25 if now < 2.5 else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),)


def passing(now):
    """Return a goal that passes above the stand."""
    moved = PASS_SPEED * min(now, PASS_SECONDS)
    return (('tool', (*(PASS_START + [0.0, moved, 0.0]), *DOWN),
             (0.0, PASS_SPEED if now < PASS_SECONDS else 0.0, 0.0, 0.0, 0.0, 0.0)),)


def lissajous(now):
    """Return a goal on a fast curve in space, begun smoothly."""
    middle, size, rate = LISSAJOUS
    phase = rate * now
    return (('tool', tuple(middle + size * np.sin(phase)),
             (*(size * rate * np.cos(phase)), 0.0, 0.0, 0.0)),)


def one_after_the_other(now):
    """Return a goal, and another one after two seconds."""
    return (('tool', (0.45, -0.15 if now < 2.0 else 0.15, 0.4, *DOWN), None),)


def ahead(now):
    """Return a goal 0.4 m ahead of where the tool of the arm on wheels starts."""
    return (('tool', WHEELED_GOAL, None),)


# Curves -----------------------------------------------------------------------------------


def goal_of(run, task='tool'):
    """Return the points that the tool is to be at (cycles, 3) [m]."""
    return np.array([next(goal for name, goal, _ in run.setup.goals(now) if name == task)[:3]
                     for now in run.times])


def distance(run):
    """Return how far the tool is from its goal [mm]."""
    return 1e3 * np.linalg.norm(run.tool - goal_of(run), axis=1)


def height(run):
    """Return how far the tool is above its goal [mm]."""
    return 1e3 * (run.tool[:, 2] - HEIGHT)


def fastest(run):
    """Return the speed of the fastest joint [rad/s]."""
    return np.abs(run.commands).max(axis=1)


def change(run):
    """Return the largest change of a velocity from cycle to cycle [rad/s]."""
    return np.abs(np.diff(run.commands, axis=0, prepend=run.commands[:1])).max(axis=1)


def joint(index, unit=1.0):
    """Return a curve: the position of a joint."""
    return lambda run: unit * run.q[:, index]


def speed(index):
    """Return a curve: the commanded velocity of a joint."""
    return lambda run: run.commands[:, index]


def tilt(run):
    """Return the angle between the axis of the tool and straight down [deg]."""
    return np.degrees([np.arccos(np.clip(-run.robot.state(q).rotation(TOOL)[2, 2], -1.0, 1.0))
                       for q in run.q])


def driven(run):
    """Return how far the base has come [m]."""
    return np.linalg.norm(run.q[:, :2] - run.q[0, :2], axis=1)


@dataclass(frozen=True)
class Plot:
    """
    A curve over time of both runs.

    Attributes
    ----------
    title : str
    curve : callable
        Returns the values of a run (cycles,).
    bound : float or None
        A limit.
    log : bool
        Draw it on a logarithmic scale.
    window : tuple of float
        Range of values that is shown; all of them if empty.

    """

    title: str
    curve: Callable
    bound: float | None = None
    log: bool = False
    window: tuple = ()

    def draw(self, axis, runs):
        """Draw both runs."""
        for run, style, when in zip(runs, (BEFORE, AFTER), ('before', 'after')):
            axis.plot(run.times, self.curve(run), label=f'{when}: {run.setup.label}', **style)
        if self.log:
            axis.set_yscale('log')
        lower, upper = self.window or axis.get_ylim()
        axis.set_ylim(lower, upper)
        if self.bound is not None:
            drawing.mark_bound(axis, self.bound, upper - self.bound)
        axis.set_title(self.title, loc='left', fontsize=10)
        axis.set_xlabel('time [s]')
        axis.set_xlim(0.0, runs[0].times[-1])
        drawing.tidy(axis)

    def numbers(self, run):
        """Return the largest value, the last, and their time as text."""
        values = np.asarray(self.curve(run))
        return (f'{self.title}: {values.min():.4g} … {values.max():.4g}, '
                f'at the end {values[-1]:.4g}')


@dataclass(frozen=True)
class Case:
    """A symptom: two setups, and two curves that show the difference."""

    before: Setup
    after: Setup
    plots: tuple
    tool: str = TOOL


def both(before, after, **common):
    """Return two setups that have something in common."""
    return Setup(**{**common, **before}), Setup(**{**common, **after})


ERROR = Plot('tool to its goal [mm]', distance)
FASTEST = Plot('fastest joint [rad/s]', fastest)
CASES = {
    'slow': Case(
        *both({'label': 'gain 1', 'stack': POSE.format(gain=1.0)},
              {'label': 'gain 3', 'stack': POSE.format(gain=3.0)},
              goals=stay('tool', (*SIDEWAYS, *DOWN)), limits=ACCELERATIONS),
        (ERROR, FASTEST)),
    'delay': Case(
        *both({'label': 'gain 20', 'stack': '[tool: {type: position, frame: panda_hand_tcp, '
                                            'axes: z, gain: 20.0}]'},
              {'label': 'gain 6', 'stack': '[tool: {type: position, frame: panda_hand_tcp, '
                                           'axes: z, gain: 6.0}]'},
              goals=stay('tool', (0.0, 0.0, HEIGHT)), noise=LATE, seconds=2.0),
        (Plot('tool above its goal [mm]', height), Plot('velocity of joint 4 [rad/s]', speed(3)))),
    'lag': Case(
        *both({'label': 'goals alone', 'goals': lambda now: circle(now, feed_forward=False)},
              {'label': 'goals with their velocity', 'goals': circle},
              stack=POINT + POSTURE, seconds=6.0),
        (ERROR, Plot('y of the tool [m]', lambda run: run.tool[:, 1]))),
    'singular': Case(
        *both({'label': 'default (both 0.1)'},
              {'label': 'damping and singular_region 0.5',
               'settings': {'damping': 0.5, 'singular_region': 0.5}},
              stack=POINT + POSTURE, goals=outwards, seconds=4.0),
        (Plot('fastest joint [rad/s]', fastest), ERROR)),
    'creeping': Case(
        *both({'label': 'damping and singular_region 0.5',
               'settings': {'damping': 0.5, 'singular_region': 0.5}},
              {'label': 'default (both 0.1)'},
              stack=POSE.format(gain=3.0), goals=passing, seconds=8.0,
              q=(-1.4, -0.6, 0.0, -2.4, 0.0, 1.8, 0.785)),
        (Plot('tool to its goal [mm]', distance, log=True), FASTEST)),
    'jumps': Case(
        *both({'label': 'no acceleration limits'},
              {'label': 'with acceleration limits', 'limits': ACCELERATIONS},
              stack=POINT + POSTURE, goals=outwards, seconds=4.0),
        (Plot('largest change of a velocity in a cycle [rad/s]', change),
         Plot('velocity of joint 2 [rad/s]', speed(1)))),
    'stops': Case(
        *both({'label': 'uniform scaling', 'settings': {'scaling': 'uniform'}},
              {'label': 'redistribution, the default'},
              stack=POSE.format(gain=2.0), goals=stay('tool', BEHIND), seconds=6.0),
        (ERROR, Plot('joint 2 [rad]', joint(1)))),
    'overshoot': Case(
        *both({'label': 'delay 0', 'settings': {'command_delay': 0}},
              {'label': 'delay 5', 'settings': {'command_delay': 5}},
              stack='[push: {type: joint_velocity, joints: [panda_joint1]}]', seconds=3.0,
              goals=lambda now: (('push', None, (1.5,)),), noise=LATE,
              limits={'panda_joint1': {'upper': LIMITED}}),
        (Plot('joint 1 beyond its limit [mrad]', lambda run: 1e3 * (run.q[:, 0] - LIMITED), 0.0,
              window=(-300.0, 30.0)),
         Plot('its velocity [rad/s]', speed(0)))),
    'demand': Case(
        *both({'label': 'pose', 'stack': POSE.format(gain=3.0),
               'goals': stay('tool', (*FAR, *DOWN))},
              {'label': 'position, then pointing down', 'goals': stay('tool', FAR),
               'stack': POINT + DOWNWARDS + POSTURE},
              seconds=6.0),
        (ERROR, Plot('tilt of the tool [°]', tilt))),
    'drift': Case(
        *both({'label': 'tool alone', 'stack': POINT},
              {'label': 'tool, then posture', 'stack': POINT + POSTURE},
              goals=circle, seconds=30.0),
        (Plot('joint 5 [rad]', joint(4)), Plot('joint 1 [rad]', joint(0)))),
    'reserve': Case(
        *both({'label': 'reserve 0', 'settings': {'reserve': 0.0}}, {'label': 'reserve 0.4'},
              stack=POINT + DOWNWARDS + POSTURE, goals=lissajous, limits=ACCELERATIONS,
              seconds=8.0),
        (ERROR, Plot('tilt of the tool [°]', tilt))),
    'blend': Case(
        *both({'label': 'blend 1.5', 'settings': {'blend': 1.5}},
              {'label': 'blend 0.2', 'settings': {'blend': 0.2}},
              stack=POSE.format(gain=4.0), goals=one_after_the_other, seconds=5.0),
        (ERROR, Plot('y of the tool [m]', lambda run: run.tool[:, 1]))),
    'weights': Case(
        *both({'label': 'no weights'},
              {'label': 'the base costs 20', 'settings': {'weights': (20.0,) * 2 + (1.0,) * 8}},
              stack='[tool: {type: position, frame: tool, gain: 2.0}]', goals=ahead, seconds=6.0,
              **WHEELED),
        (Plot('distance driven by the base [m]', driven), ERROR), tool='tool'),
}


# Drawing ----------------------------------------------------------------------------------


def draw(name, folder=FOLDER):
    """Draw the picture of a case; return its path and the numbers of its curves as lines."""
    case = CASES[name]
    runs = [Run(setup, case.tool) for setup in (case.before, case.after)]
    figure = Figure(figsize=(8.2, 3.2), dpi=drawing.PLOT_DPI, layout='constrained')
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.06)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(case.plots))
    for axis, plot in zip(axes, case.plots):
        plot.draw(axis, runs)
    figure.legend(*axes[0].get_legend_handles_labels(), loc='outside lower center', ncols=2,
                  frameon=False, fontsize=9.5, columnspacing=1.6)
    lines = [f'{run.setup.label}: {plot.numbers(run)}' for plot in case.plots for run in runs]
    return drawing.save(figure, Path(folder) / f'{name}.png'), lines


def main():
    """Draw the pictures of all cases, or of those named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('names', nargs='*', metavar='name', help=', '.join(CASES))
    for name in parser.parse_args().names or CASES:
        path, lines = draw(name)
        print(path.relative_to(ROOT), *lines, sep='\n  ')


if __name__ == '__main__':
    main()

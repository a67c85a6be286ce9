# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Draw the pictures of docs/tasks/: one for a task type, of a run with an ideal robot.

``python docs/pictures.py`` writes docs/images/tasks/<type>.png for all types, ``python
docs/pictures.py keep_out look_at`` only those two, and prints the numbers that the page quotes.
``python docs/pictures.py method_damping method_levels`` draws the two pictures of docs/method.md.
Some need robots of example-robot-data. On the left of a picture is the robot, on the right the
controlled quantities over time. Every picture of a task type is one entry of `SCENES`.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import files
from pathlib import Path
from xml.etree import ElementTree

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from tp_controller import Controller, Robot, Settings, solve, Stack
from tp_controller.model.shapes import Box, Cylinder, Sphere
from tp_controller.model.urdf import parse
from tp_controller.solver.damping import Damping
from tp_controller.tasks.manipulability import Mobility
from tp_controller.tools.plots import drawing

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'images' / 'tasks'
PERIOD = 0.01

START_COLOUR = '#A9B1BA'
END_COLOUR = drawing.LINE_COLOURS[0]
WITHOUT_COLOUR = '#5F6B78'
WITHOUT_STYLE = {'linewidth': 1.3, 'linestyle': (0, (4, 2))}
TARGET_COLOUR = drawing.GOAL_COLOUR
# Directions to the viewer, as azimuth and elevation [deg].
SIDE, ABOVE, OBLIQUE = (-90.0, 0.0), (-90.0, 90.0), (-60.0, 18.0)

TOOL = 'panda_hand_tcp'
# The tool straight down, far from every limit.
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
LEFT, RIGHT = 'left_gripper', 'right_gripper'
ARMS = [f'{side}_{joint}' for side in ('left', 'right')
        for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2')]
# Hands in front, 0.4 m apart.
ARMS_READY = (-0.19, -0.66, -0.89, 2.46, -0.27, -1.3, 0.1,
              0.19, -0.66, 0.89, 2.46, 0.27, -1.3, -0.1)

# Legs and arms of Talos.
TALOS = [f'{limb}_{side}_{number}_joint' for side in ('left', 'right')
         for limb, count in (('leg', 6), ('arm', 7)) for number in range(1, count + 1)]
# Knees bent, arms hanging with bent elbows.
TALOS_LEG = (0.0, 0.0, -0.4, 0.8, -0.4, 0.0)
TALOS_READY = (*TALOS_LEG, 0.3, 0.3, -0.4, -1.4, 0.2, 0.1, 0.1,
               *TALOS_LEG, -0.3, -0.3, 0.4, -1.4, 0.2, 0.1, 0.1)
SOLE = [[0.1, 0.06, 0], [-0.1, 0.06, 0], [-0.1, -0.06, 0], [0.1, -0.06, 0]]


# Runs -------------------------------------------------------------------------------------


def own(name, base='fixed'):
    """Return a robot of this repository."""
    return Robot.from_file(ROOT / 'config' / 'robots' / name, base=base)


def example(name, joints, base='fixed'):
    """Return a robot of example-robot-data."""
    path, = (file.locate() for file in files('example-robot-data') if file.name == name)
    return Robot.from_urdf(Path(path).resolve(), base, joints=joints)


ROBOTS = {
    'panda': partial(own, 'panda.yaml'),
    'panda with masses': partial(example, 'panda.urdf', [f'panda_joint{i}' for i in range(1, 8)]),
    'baxter': partial(example, 'baxter.urdf', ARMS),
    'talos': partial(example, 'talos_reduced.urdf', TALOS, 'floating'),
    'mobile arm': partial(own, 'mobile_arm.urdf', 'planar'),
    'underwater arm': partial(own, 'underwater_arm.urdf', 'underwater'),
}


class Run:
    """
    A closed loop of a scene.

    Attributes
    ----------
    robot : Robot
    stack : Stack
    task : Task
        The task of the picture.
    times : ndarray (T,)
        [s]
    states, velocities, reports : list
        One entry for each time; velocities (n,) [rad/s or m/s].

    """

    def __init__(self, scene, kind, without=False):
        robot = self.robot = ROBOTS[scene.robot]()
        self.stack = Stack.from_yaml(scene.stack, robot)
        self.task = next(task for task in self.stack.tasks.values() if task.type_name == kind)
        controller = Controller(robot, self.stack, Settings(period=PERIOD, command_delay=0))
        controller.enable(self.task.name, not without)
        self.times = PERIOD * np.arange(round(scene.seconds / PERIOD) + 1)
        self.states, self.velocities, self.reports = [], [], []
        q, goals = robot.configuration(scene.start), list(scene.goals)
        controller.update(q, 0.0)
        for now in self.times:
            while goals and goals[0][0] <= now:
                _, name, goal = goals.pop(0)
                if not (without and name == self.task.name):
                    controller.set_goal(name, goal, now)
            command = controller.update(q, now)
            self.states.append(robot.state(q))
            self.velocities.append(command.velocity)
            self.reports.append({report.name: report for report in command.report.tasks})
            q = robot.integrate(q, command.velocity, PERIOD)

    def of_states(self, function):
        """Return the values of a function of the state (T, …)."""
        return np.array([function(state) for state in self.states])

    def path(self, frame):
        """Return the positions of the origin of a frame (T, 3) [m]."""
        return self.of_states(lambda state: state.position(frame))

    def error(self, name, unit='m'):
        """Return the error of a task (T,), in mm or degrees."""
        scale = {'m': 1e3, 'rad': np.degrees(1.0)}[unit]
        return scale * np.array([next(error for error, kind, _ in reports[name].errors
                                      if kind == unit) for reports in self.reports])

    def speed(self, frame):
        """Return the speed of a frame (T,) [m/s]."""
        return np.array([np.linalg.norm((state.jacobian(frame) @ velocity)[:3])
                         for state, velocity in zip(self.states, self.velocities)])

    @cached_property
    def chain(self):
        """Return (parent, child) of the links up to frames of tasks, and the driven children."""
        joints = parse(self.robot.urdf).findall('joint')
        links = [tuple(next(joint.iter(side)).attrib['link'] for side in ('parent', 'child'))
                 for joint in joints]
        driven = [child for joint, (_, child) in zip(joints, links)
                  if joint.get('name') in self.robot.joint_names]
        parents = {child: parent for parent, child in links}
        needed = {*driven, *(frame for task in self.stack.tasks.values() for frame in (
            getattr(task, 'frame', None), getattr(task, 'reference', None)))}
        carrying = set()
        for frame in needed:
            while frame in parents and frame not in carrying:
                carrying.add(frame)
                frame = parents[frame]
        return [link for link in links if link[1] in carrying], driven


# Drawing in space -------------------------------------------------------------------------


class Canvas:
    """
    An axis with an orthographic projection of space.

    Points are (k, 3) in the root [m].

    Parameters
    ----------
    axis : matplotlib.axes.Axes
    view : tuple of float
        Azimuth and elevation of the viewer [deg].

    """

    def __init__(self, axis, view):
        azimuth, elevation = np.radians(view)
        self.axis = axis
        self._rows = np.array([
            [-np.sin(azimuth), np.cos(azimuth), 0.0],
            [-np.sin(elevation) * np.cos(azimuth), -np.sin(elevation) * np.sin(azimuth),
             np.cos(elevation)]])
        axis.set_aspect('equal', adjustable='datalim')
        drawing.tidy(axis)
        if np.isclose(np.abs(self._rows).max(axis=1), 1.0).all():
            right, up = ('xyz'[row.argmax()] for row in np.abs(self._rows))
            axis.set(xlabel=f'{right} [m]', ylabel=f'{up} [m]')
            axis.locator_params(nbins=5)
        else:
            axis.set_axis_off()
            self._draw_floor(0.2 * np.arange(-1, 4), 0.2 * np.arange(-2, 3))

    def flat(self, points):
        """Return projected points (2, k)."""
        return self._rows @ np.atleast_2d(points).T

    def line(self, points, colour, **style):
        """Draw a line through points."""
        self.axis.plot(*self.flat(points), color=colour, **{
            'linewidth': 1.8, 'solid_capstyle': 'round', **style})

    def dots(self, points, marker, colour, **style):
        """Draw markers at points."""
        self.axis.plot(*self.flat(points), marker, color=colour, **{'zorder': 7, **style})

    def goal(self, point, label='goal'):
        """Mark a goal."""
        self.dots(point, 'x', TARGET_COLOUR, markersize=10, markeredgewidth=2.5, label=label)

    def arrow(self, start, vector, colour):
        """Draw an arrow."""
        (x, u), (y, v) = np.column_stack((self.flat(start), self.flat(vector)))
        # An arrow whose tip is outside is not drawn.
        self.axis.update_datalim([(x + u, y + v)])
        self.axis.annotate('', (x + u, y + v), (x, y), zorder=8, arrowprops={
            'arrowstyle': '-|>', 'color': colour, 'linewidth': 2, 'shrinkA': 0, 'shrinkB': 0,
            'mutation_scale': 13})

    def text(self, point, text, colour, offset=(8, 0), **style):
        """Write beside a point, at an offset in points (1/72 inch)."""
        self.axis.annotate(text, self.flat(point)[:, 0], offset, textcoords='offset points',
                           color=colour, zorder=9, va='center', **style)

    def body(self, points, colour, opacity=0.12, **style):
        """Draw the outline of the convex hull of points."""
        projected = self.flat(points).T
        outline = projected[ConvexHull(projected).vertices]
        self.axis.fill(*outline.T, color=colour, alpha=opacity, linewidth=0, zorder=1)
        self.axis.fill(*outline.T, fill=False, edgecolor=colour, **{
            'linewidth': 1.0, 'zorder': 2, **style})

    def fit(self):
        """Set a margin around the drawing; call this last."""
        (low, high), axis = self.axis.dataLim.get_points(), self.axis
        margin = 0.06 * (high - low).max()
        axis.update_datalim([low - margin, high + margin])
        axis.margins(0.0)
        axis.autoscale_view()

    def _draw_floor(self, x, y):
        """Draw a floor with lines at some x (k,) and y (m,)."""
        for ends in (*([[at, y[0], 0.0], [at, y[-1], 0.0]] for at in x),
                     *([[x[0], at, 0.0], [x[-1], at, 0.0]] for at in y)):
            self.line(ends, '#E1E4E8', linewidth=0.8, zorder=0)

    def robot(self, run, state, colour, label, **style):
        """Draw a robot: lines between the origins of its links, and its shapes."""
        (links, driven), dashed = run.chain, 'linestyle' in style
        if not dashed:
            carrying = {link for pair in links for link in pair}
            for link, points in bodies(run.robot, state):
                if link in carrying:
                    self.body(points, colour, opacity=0.16, linewidth=0.0)
        elif len(base := outline(run.robot, state)):
            self.body(base, colour, opacity=0.0, **style)
        gap = np.full(3, np.nan)
        ends = [point for parent, child in links
                for point in (state.position(parent), state.position(child), gap)]
        style = {'linewidth': 4, 'zorder': 4, **style}
        self.line(ends, colour, label=label, **style)
        if not dashed:
            self.dots([state.position(child) for child in driven], 'o', 'white', markersize=5,
                      markeredgecolor=colour, markeredgewidth=1.6, zorder=style['zorder'])


def corners(shape, count=48):
    """Return points (k, 3) whose convex hull is a box, a cylinder or a sphere about its origin."""
    turn = np.linspace(0.0, 2.0 * np.pi, count)
    circle = np.column_stack((np.cos(turn), np.sin(turn)))
    if isinstance(shape, Box):
        return shape.half * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    if isinstance(shape, Cylinder):
        radius, half = shape.half
        return np.array([[radius * x, radius * y, z] for x, y in circle for z in (-half, half)])
    return shape.radius * np.array([[x * np.cos(up), y * np.cos(up), np.sin(up)]
                                    for x, y in circle for up in turn])


def moved(points, T):
    """Return points (k, 3) transformed by T (4, 4)."""
    return points @ T[:3, :3].T + T[:3, 3]


def bodies(robot, state):
    """Yield (link, corners (k, 3)) for each simple visual shape of the robot."""
    kinds = {'box': lambda of: Box(*floats(of, 'size')),
             'cylinder': lambda of: Cylinder(*floats(of, 'radius'), *floats(of, 'length')),
             'sphere': lambda of: Sphere(*floats(of, 'radius'))}
    for link in ElementTree.fromstring(robot.urdf.encode()).findall('link'):
        name = link.get('name')
        for visual in link.findall('visual'):
            shape, origin = next(iter(visual.find('geometry'))), visual.find('origin')
            if shape.tag not in kinds:
                continue
            T = np.eye(4)
            if origin is not None:
                T[:3, 3] = floats(origin, 'xyz')
                T[:3, :3] = Rotation.from_euler('xyz', floats(origin, 'rpy')).as_matrix()
            yield name, moved(corners(kinds[shape.tag](shape)), state.pose(name) @ T)


def floats(element, attribute):
    """Return the numbers of an XML attribute, by default three zeros."""
    return [float(word) for word in element.get(attribute, '0 0 0').split()]


def outline(robot, state):
    """Return the corners (k, 3) of all simple shapes of a base that moves."""
    return np.vstack([np.empty((0, 3)), *(points for link, points in bodies(robot, state)
                                          if robot.moves and link == robot.base_frame)])


# Drawing over time ------------------------------------------------------------------------


@dataclass(frozen=True)
class Plot:
    """
    One axis over time.

    Attributes
    ----------
    label : str
        Quantity and unit.
    values : callable
        Function of a `Run` that returns (T,), or {name: (T,)} for curves with a legend.
    lower, upper : float
        Bounds, infinite if there is none.
    log : bool
        Logarithmic axis.
    names : str
        Title of the legend.

    """

    label: str
    values: Callable
    lower: float = -np.inf
    upper: float = np.inf
    log: bool = False
    names: str = ''

    def numbers(self, run):
        """Return smallest, largest and last value of each curve, as text."""
        curves = self.values(run)
        curves = curves if isinstance(curves, dict) else {'': curves}
        return f'{self.label}: ' + ', '.join(
            f'{name} {curve.min():.3g} … {curve.max():.3g}, at the end {curve[-1]:.3g}'.strip()
            for name, curve in curves.items())

    def draw(self, axis, run, without):
        """Draw the curves with the task, and those without it if there is such a run."""
        for other, style in ((without, {'color': WITHOUT_COLOUR, **WITHOUT_STYLE}),
                             (run, {'linewidth': 2.0})):
            if other is None:
                continue
            values = self.values(other)
            if not isinstance(values, dict):
                values = {None: values}
            for colour, (name, curve) in zip(drawing.LINE_COLOURS, values.items()):
                axis.plot(run.times, curve, label=name, **{'color': colour, **style})
            if None not in values:
                axis.legend(frameon=False, fontsize=9, labelspacing=0.2, handlelength=1.2,
                            title=self.names,
                            **({'loc': 'best'} if len(values) < 4 else
                               {'loc': 'center left', 'bbox_to_anchor': (1.0, 0.5)}))
        if self.log:
            axis.set_yscale('log')
        axis.margins(y=0.08)
        low, high = axis.get_ylim()
        margin = 0.12 * (high - low)
        for bound, outward in ((self.lower, -1.0), (self.upper, 1.0)):
            if np.isfinite(bound):
                low, high = min(low, bound - margin), max(high, bound + margin)
                drawing.mark_bound(axis, bound, outward * 1e3 * (high - low))
        axis.set_ylim(low, high)
        axis.set_xlim(run.times[0], run.times[-1])
        axis.set_title(self.label, loc='left', fontsize=10)
        if not self.log:
            axis.locator_params(axis='y', nbins=4)
        drawing.tidy(axis)


# Scenes -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """
    The content of a picture.

    Attributes
    ----------
    robot : str
        One of `ROBOTS`.
    start : sequence of float
        Positions of the joints [rad or m]; a base starts at the origin.
    stack : str
        YAML.
    plots : tuple of Plot
        From top to bottom.
    frames : tuple of str
        Frames whose paths are drawn.
    view : tuple of float
        Azimuth and elevation of the viewer [deg].
    goals : tuple of (float, str, array_like)
        Time [s], task and goal.
    seconds : float
    draw : callable
        Function of a `Canvas` and both runs that adds details of the task to the scene.
    compare : bool
        Draw a run without the task too.

    """

    robot: str
    start: tuple
    stack: str
    plots: tuple
    frames: tuple = ()
    view: tuple = SIDE
    goals: tuple = ()
    seconds: float = 6.0
    draw: Callable = lambda canvas, run, without: None
    compare: bool = False


def make_figure():
    """Return a figure of the size that all have."""
    figure = Figure(figsize=(8.2, 3.45), dpi=drawing.PLOT_DPI, layout='constrained')
    figure.get_layout_engine().set(w_pad=0.08, h_pad=0.06)
    FigureCanvasAgg(figure)
    return figure


def draw(kind, folder=FOLDER):
    """Draw the picture of a task type; return its path, and the numbers of its curves as lines."""
    scene = SCENES[kind]
    run = Run(scene, kind)
    without = Run(scene, kind, without=True) if scene.compare else None
    figure = make_figure()
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    canvas = Canvas(left.add_subplot(), scene.view)
    draw_scene(canvas, scene, kind, run, without)
    axes = right.subplots(len(scene.plots), 1, sharex=True, squeeze=False)[:, 0]
    for axis, plot in zip(axes, scene.plots):
        plot.draw(axis, run, without)
    axes[-1].set_xlabel('time [s]')
    entries = dict(zip(*reversed(canvas.axis.get_legend_handles_labels())))
    figure.legend(entries.values(), entries.keys(), loc='outside lower center', ncols=len(entries),
                  frameon=False, fontsize=9.5, columnspacing=1.6)
    # The width of labels is known only after a first drawing.
    figure.canvas.draw()
    lines = [f'{which} {plot.numbers(one)}' for plot in scene.plots
             for which, one in (('with   ', run), ('without', without)) if one]
    return drawing.save(figure, Path(folder) / f'{kind}.png'), lines


def draw_scene(canvas, scene, kind, run, without):
    """Draw the robot, the paths and the goals."""
    canvas.robot(run, run.states[0], START_COLOUR, 'start', zorder=3)
    canvas.robot(run, run.states[-1], END_COLOUR, 'end', zorder=5)
    for frame in scene.frames:
        canvas.line(run.path(frame), END_COLOUR, linewidth=1.4, zorder=6, label='path')
    if without:
        canvas.robot(run, without.states[-1], WITHOUT_COLOUR, f'without {kind}', **WITHOUT_STYLE)
        for frame in scene.frames:
            canvas.line(without.path(frame), WITHOUT_COLOUR, **WITHOUT_STYLE)
    for _, name, goal in scene.goals:
        task = run.stack.tasks[name]
        if task.goal_type in ('point', 'pose') and task.reference == run.robot.root:
            canvas.goal(goal[:3])
    scene.draw(canvas, run, without)
    canvas.fit()


# Curves of the plots, as functions of a run.


def value(run, row=0):
    """Return one row of the value of a run's task (T,)."""
    return run.of_states(run.task.value)[:, row]


def nearest(run):
    """Return the distance of the nearest pair or edge of a run's task (T,) [m]."""
    return run.of_states(lambda state: run.task.value(state).min())


def angle(run):
    """Return the angle of an axis that stays in a cone (T,) [deg]."""
    return np.degrees(run.of_states(run.task.angle))


def turn_about_z(run):
    """Return the angle of the tool about the vertical (T,) [deg]."""
    angles = run.of_states(lambda state: np.arctan2(*state.rotation(TOOL)[1::-1, 0]))
    return np.degrees(np.unwrap(angles - angles[0]))


def turn_in_range(run):
    """Return the turn about z from the middle of a range (T,) [deg]."""
    return np.degrees(value(run, row=2))


def mobility(run):
    """Return √det(J Jᵀ) of the tool (T,)."""
    measure = Mobility(run.robot, TOOL, list(range(6))).measure
    return run.of_states(lambda state: measure(state)[0])


def sight_errors(run):
    """Return the errors of direction and of upright of a camera (T,) [deg]."""
    errors = np.degrees(run.of_states(run.task.error))
    return {'direction': np.linalg.norm(errors[:, :2], axis=1), 'upright': np.abs(errors[:, 2])}


def between(state):
    """Return T_right_left (4, 4) of the hands of two arms."""
    return np.linalg.inv(state.pose(RIGHT)) @ state.pose(LEFT)


def slip(run):
    """Return the displacement of one hand in the other (T,) [mm]."""
    grips = run.of_states(between)[:, :3, 3]
    return 1e3 * np.linalg.norm(grips - grips[0], axis=1)


def turn_of_grip(run):
    """Return the rotation of one hand in the other (T,) [deg]."""
    grips = Rotation.from_matrix(run.of_states(between)[:, :3, :3])
    return np.degrees((grips * grips[0].inv()).magnitude())


def components(run):
    """Return the errors of a relative position along the axes of its reference (T,) [mm]."""
    return dict(zip('xyz', 1e3 * run.of_states(run.task.error).T))


def shift_of_mass(run):
    """Return the horizontal displacement of the centre of mass (T,) [mm]."""
    centres = run.of_states(lambda state: state.center_of_mass()[0])[:, :2]
    return 1e3 * np.linalg.norm(centres - centres[0], axis=1)


def yaw(run):
    """Return the heading of the base (T,) [deg]."""
    return run.of_states(lambda state: np.degrees(np.arctan2(
        *state.rotation(run.robot.base_frame)[1::-1, 0])))


def base_to_go(run):
    """Return the error of a base, in two units (T,)."""
    name = run.task.name
    return {'position [cm]': run.error(name) / 10.0, 'heading [°]': run.error(name, 'rad')}


def shares(run):
    """Return the positions of the joints in their ranges, -1 to 1 (T,)."""
    lower, upper = run.robot.lower, run.robot.upper
    positions = (2.0 * run.of_states(lambda state: state.q) - lower - upper) / (upper - lower)
    return {str(joint): positions[:, joint - 1] for joint in range(1, run.robot.n + 1)}


def error(name, unit='m'):
    """Return a `Plot` of the error of a task."""
    return Plot(f'{name} error [{"mm" if unit == "m" else "°"}]',
                lambda run: run.error(name, unit))


# Details that are drawn besides the robot.


def region(canvas, run, without):
    """Draw the region that a frame stays in: everything outside is shaded."""
    canvas.axis.set_facecolor((drawing.LIMIT_COLOUR, 0.06))
    outline = moved(corners(run.task.shape), run.task.goal)
    canvas.body(outline, 'white', opacity=1.0, linewidth=0.0)
    canvas.body(outline, drawing.LIMIT_COLOUR, opacity=0.0, linewidth=1.5)


def pillar(canvas, run, without):
    """Draw the cylinder that a frame stays out of, and the least distance from it."""
    task, (radius, half) = run.task, run.task.shape.half
    for shape, style in ((task.shape, {}), (Cylinder(radius + task.radius, 2.0 * half),
                                            {'linestyle': '--', 'opacity': 0.06})):
        canvas.body(moved(corners(shape), task.goal), drawing.LIMIT_COLOUR, linewidth=1.3, **style)


def obstacles(canvas, run, without):
    """Draw the obstacles of a task."""
    for obstacle in run.task.obstacles.values():
        canvas.body(moved(corners(obstacle.shape), obstacle.pose), drawing.LIMIT_COLOUR,
                    linewidth=1.3)


def axes_of_tool(canvas, run, without):
    """Draw the z axis of the tool at both ends of the run."""
    for state, colour in ((run.states[0], START_COLOUR), (run.states[-1], TARGET_COLOUR)):
        canvas.arrow(state.position(TOOL), 0.18 * state.rotation(TOOL)[:, 2], colour)


def sights(canvas, run, without):
    """Draw the target of a camera, and the lines of sight at some times."""
    middle = len(run.states) // 2
    for state, colour in zip(run.states[::middle], (START_COLOUR, *2 * [TARGET_COLOUR])):
        camera = state.position(run.task.frame)
        canvas.line([camera, run.task.goal], colour, linewidth=1.2, linestyle=':')
        canvas.arrow(camera, 0.2 * state.rotation(run.task.frame) @ run.task.axis, colour)
    canvas.dots(run.task.goal, '*', TARGET_COLOUR, markersize=13, label='target')


def cones(canvas, run, without):
    """Draw the field of view at the end, with the task and without it, and the target."""
    task = run.task
    for state, colour in ((without.states[-1], WITHOUT_COLOUR), (run.states[-1], END_COLOUR)):
        depth = np.linalg.norm(state.position(task.frame) - task.goal)
        rim = depth * np.tan(task.upper) * corners(Cylinder(1.0, 1.0)) + [0.0, 0.0, depth]
        cone = np.vstack((np.zeros(3), rim * [1.0, 1.0, 0.0] + [0.0, 0.0, depth]))
        canvas.body(moved(cone, state.pose(task.frame)), colour)
    canvas.dots(task.goal, '*', TARGET_COLOUR, markersize=13, label='target')


def cup(canvas, run, without):
    """Draw the cone that an axis stays in, and the axis at the end, with and without the task."""
    task = run.task
    rim = np.tan(task.half_angle) * corners(Cylinder(1.0, 1.0)) * [1.0, 1.0, 0.0]
    place = run.states[-1].position(task.frame)
    canvas.body(np.vstack((np.zeros(3), 0.25 * (rim + task.goal))) + place, END_COLOUR)
    for each, colour in ((without, WITHOUT_COLOUR), (run, TARGET_COLOUR)):
        state = each.states[-1]
        canvas.arrow(state.position(task.frame),
                     0.2 * state.rotation(task.frame) @ task.axis, colour)


def spheres(canvas, run, without):
    """Draw the bounds of a distance at the end."""
    task, state = run.task, run.states[-1]
    place = state.position(task.reference)
    for radius, style in ((task.lower, {}), (task.upper, {'opacity': 0.0, 'linestyle': '--'})):
        canvas.body(place + corners(Sphere(radius)), drawing.LIMIT_COLOUR, linewidth=1.3, **style)
    canvas.line([place, state.position(task.frame)], TARGET_COLOUR, linewidth=1.2, linestyle=':')


def bar(canvas, run, without):
    """Draw the object that two hands have grasped."""
    for state, colour, label in ((run.states[0], START_COLOUR, None),
                                 (run.states[-1], TARGET_COLOUR, 'object')):
        canvas.line([state.position(LEFT), state.position(RIGHT)], colour, linewidth=6, zorder=6,
                    label=label)


def point_in_reference(canvas, run, without):
    """Draw the goal of a relative task, at the end."""
    T = run.states[-1].pose(run.task.reference)
    canvas.goal(moved(run.task.goal, T))
    canvas.line([T[:3, 3], moved(run.task.goal, T)], TARGET_COLOUR, linewidth=1,
                linestyle=':')


def mass(canvas, run, without):
    """Draw the centre of mass and the plumb line below it."""
    for state, colour, label in ((without.states[-1], WITHOUT_COLOUR, None),
                                 (run.states[-1], TARGET_COLOUR, 'centre of mass')):
        centre = state.center_of_mass()[0]
        canvas.line([centre, [*centre[:2], 0.0]], colour, linewidth=1.2, linestyle=':')
        canvas.dots(centre, 'o', colour, markersize=9, label=label)


def balance(canvas, run, without):
    """Draw the support polygon, and the centre of mass with its plumb line."""
    soles = np.concatenate([moved(np.array(points), run.states[-1].pose(frame))
                            for frame, points in run.task.contacts.items()])
    canvas.body(soles, TARGET_COLOUR, linewidth=3.0)
    for each, colour, label in ((without, WITHOUT_COLOUR, None),
                                (run, TARGET_COLOUR, 'centre of mass')):
        centre = each.states[-1].center_of_mass()[0]
        canvas.line([centre, [*centre[:2], soles[0, 2]]], colour, linewidth=1.2, linestyle=':')
        canvas.dots(centre, 'o', colour, markersize=9, label=label)


def parking(canvas, run, without):
    """Draw the goal of the base."""
    state = run.states[0]
    T = run.task.goal @ np.linalg.inv(state.pose(run.robot.base_frame))
    canvas.body(moved(outline(run.robot, state), T), TARGET_COLOUR, opacity=0.0, linewidth=1.5,
                zorder=6)
    canvas.text(state.position('tool'), 'tool', drawing.ARM_COLOUR, offset=(10, 10))


def turned(canvas, run, without):
    """Draw an axis of the frame at the start, and at the end with and without the task."""
    for state, colour in ((run.states[0], START_COLOUR), (without.states[-1], WITHOUT_COLOUR),
                          (run.states[-1], END_COLOUR)):
        canvas.arrow(state.position(TOOL), 0.18 * state.rotation(TOOL)[:, 0], colour)


def steps(canvas, run, without):
    """Mark the positions of the frame every quarter of a second."""
    canvas.dots(run.path(run.task.frame)[::round(0.25 / PERIOD)], 'o', END_COLOUR, markersize=5,
                label='every 0.25 s')


def down(x, y, z, turn=0.0):
    """Return the pose of a tool that points down, turned about the vertical [deg]."""
    half = np.radians(turn) / 2.0
    return [x, y, z, np.cos(half), np.sin(half), 0.0, 0.0]


SCENES = {
    'pointing': Scene(
        'panda', (0.0, -0.5, 0.0, -2.0, 0.0, 2.6, 0.785), f"""
- [tip: {{type: position, frame: {TOOL}, gain: 2.0}},
   drill: {{type: pointing, frame: {TOOL}, axis: z, target: [0, 0, -1], gain: 2.0}}]
- posture: {{type: posture, gain: 1.0}}
""",
        goals=((0.0, 'tip', [0.5, 0.1, 0.3]), (4.0, 'posture', {'panda_joint7': -0.8})),
        seconds=8.0, frames=(TOOL,), draw=axes_of_tool,
        plots=(error('drill', 'rad'), Plot('turn of the hand about z [°]', turn_about_z))),
    'look_at': Scene(
        'panda', READY, """
- camera: {type: look_at, frame: panda_link7, axis: z, up: -y, target: [0.6, 0.2, 0.0], gain: 2.0}
- carry: {type: position, frame: panda_link7}
""",
        goals=((0.0, 'carry', [0.35, -0.35, 0.6]), (4.0, 'carry', [0.3, 0.4, 0.5])),
        seconds=8.0, frames=('panda_link7',), view=OBLIQUE, draw=sights,
        plots=(Plot('camera error [°]', sight_errors), error('carry'))),
    'relative_pose': Scene(
        'baxter', ARMS_READY, f"""
- grip: {{type: relative_pose, frame: {LEFT}, reference: {RIGHT}, gain: 5.0}}
- carry: {{type: position, frame: {LEFT}, gain: 1.0}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'carry', [0.6, 0.4, 0.25]),),
        frames=(LEFT, RIGHT), view=ABOVE, draw=bar, compare=True,
        plots=(Plot('slip of the hands [mm]', slip), error('carry'))),
    'relative_position': Scene(
        'baxter', ARMS_READY, f"""
- apart: {{type: relative_position, frame: {LEFT}, reference: {RIGHT}}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'apart', [0.0, 0.2, 0.0]),),
        frames=(LEFT, RIGHT), view=ABOVE, draw=point_in_reference,
        plots=(Plot("error in the other hand's axes [mm]", components),
               Plot('turn of the hand in the other [°]', turn_of_grip))),
    'center_of_mass': Scene(
        'panda with masses', READY, f"""
- balance: {{type: center_of_mass, axes: xy, gain: 1.0}}
- tool: {{type: position, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', [0.45, 0.0, 0.7]),), seconds=8.0,
        frames=(TOOL,), draw=mass, compare=True,
        plots=(Plot('horizontal shift of the centre of mass [mm]', shift_of_mass), error('tool'))),
    'base_pose': Scene(
        'mobile arm', (0.15, 0.0, 0.5, 0.0, 1.2, 0.0, 0.0, 0.0), """
- tool: {type: position, frame: tool, gain: 2.0}
- park: {type: base_pose, gain: 0.5}
""",
        goals=((0.0, 'park', [0.2, -0.5, 0.0, 0.0, 0.0, 0.5, 0.866]),), seconds=10.0,
        frames=('base_link',), view=ABOVE, draw=parking,
        plots=(Plot('park error', base_to_go), error('tool'))),
    'base_orientation': Scene(
        'underwater arm', (0.0, 0.3, 0.5, 0.0), """
- heading: {type: base_orientation, gain: 0.5}
- tool: {type: position, frame: tool}
""",
        goals=((0.0, 'tool', [1.4, 1.2, -0.5]),), seconds=10.0,
        frames=('tool', 'vehicle'), view=ABOVE, compare=True,
        plots=(Plot('heading of the vehicle [°]', yaw), error('tool'))),
    'joint_limits': Scene(
        'panda', READY, f"""
- tool: {{type: pose, frame: {TOOL}}}
- joints: {{type: joint_limits, margin: 0.2}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'tool', down(0.45, -0.3, 0.4, turn=-160.0)),), seconds=8.0,
        frames=(TOOL,), view=OBLIQUE, compare=True,
        plots=(Plot('position of joint 7 [rad]', partial(value, row=6), upper=2.8973 - 0.2),
               Plot('tool error [mm]', lambda run: run.error('tool'), log=True))),
    'keep_in': Scene(
        'panda', READY, f"""
- cell: {{type: keep_in, frame: {TOOL}, shape: {{box: [1.0, 0.8, 0.6]}}, at: [0.4, 0, 0.4]}}
- tool: {{type: position, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', [0.2, 0.6, 0.4]), (4.0, 'tool', [0.6, 0.5, 0.4])), seconds=8.0,
        frames=(TOOL,), view=ABOVE, draw=region, compare=True,
        plots=(Plot('y of the tool in the box [m]', partial(value, row=1), lower=-0.4, upper=0.4),
               error('tool'))),
    'keep_out': Scene(
        'panda', (0.3, -0.3, 0.0, -2.0, 0.0, 1.7, 0.785), f"""
- pillar: {{type: keep_out, frame: {TOOL}, radius: 0.06, shape: {{cylinder: [0.1, 1.2]}},
           at: [0.4, -0.3, 0.6]}}
- tool: {{type: position, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', [0.28, -0.6, 0.4]),),
        frames=(TOOL,), view=ABOVE, draw=pillar, compare=True,
        plots=(Plot('distance from the pillar [m]', value, lower=0.06), error('tool'))),
    'self_collision': Scene(
        'panda', READY, f"""
- apart: {{type: self_collision, within: 1.5,
          capsules: package://tp_controller/config/panda_capsules.yaml}}
- tool: {{type: position, frame: {TOOL}}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'tool', [0.1, 0.0, 0.2]),), frames=(TOOL,), view=SIDE, compare=True,
        plots=(Plot('nearest pair of links [m]', nearest, lower=0.02), error('tool'))),
    'obstacles': Scene(
        'panda', (0.7, 0.0, 0.0, -2.0, 0.0, 2.0, 0.785), f"""
- clear: {{type: obstacles, within: 1.5,
          capsules: package://tp_controller/config/panda_capsules.yaml,
          links: [panda_link5, panda_link6, panda_link7, panda_hand],
          obstacles: {{pole: {{shape: {{cylinder: [0.05, 1.0]}}, at: [0.55, 0.08, 0.3]}}}}}}
- tool: {{type: position, frame: {TOOL}}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'tool', [0.35, -0.45, 0.45]),), frames=(TOOL,), view=ABOVE, draw=obstacles,
        compare=True,
        plots=(Plot('nearest link to the pole [m]', nearest, lower=0.02), error('tool'))),
    'field_of_view': Scene(
        'panda', READY, f"""
- view: {{type: field_of_view, frame: panda_link7, half_angle: 0.4, target: [0.5, 0.0, 0.0]}}
- tool: {{type: position, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', [0.7, 0.0, 0.6]),), frames=(TOOL,), draw=cones, compare=True,
        plots=(Plot('angle of the target from the axis [°]', angle, upper=np.degrees(0.4)),
               error('tool'))),
    'tilt': Scene(
        'panda', READY, f"""
- upright: {{type: tilt, frame: {TOOL}, axis: -z, within: 0.15}}
- tool: {{type: position, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', [0.7, 0.0, 0.3]),), frames=(TOOL,), draw=cup, compare=True,
        plots=(Plot('angle between the cup and the vertical [°]', angle, upper=np.degrees(0.15)),
               error('tool'))),
    'distance': Scene(
        'baxter', ARMS_READY, f"""
- span: {{type: distance, frame: {LEFT}, reference: {RIGHT}, minimum: 0.3, maximum: 0.5}}
- carry: {{type: position, frame: {LEFT}, gain: 1.0}}
- posture: {{type: posture, gain: 0.5}}
""",
        goals=((0.0, 'carry', [0.65, 0.5, 0.25]), (5.0, 'carry', [0.65, -0.2, 0.25])),
        seconds=10.0, frames=(LEFT, RIGHT), view=ABOVE, draw=spheres, compare=True,
        plots=(Plot('distance of the hands [m]', value, lower=0.3, upper=0.5), error('carry'))),
    'orientation_range': Scene(
        'panda', READY, f"""
- range: {{type: orientation_range, frame: {TOOL}, maximum: [0.1, 0.1, 0.5]}}
- tool: {{type: pose, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', down(0.5, 0.25, 0.3, turn=70.0)),), seconds=8.0, frames=(TOOL,),
        view=ABOVE, draw=turned, compare=True,
        plots=(Plot('turn of the tool about z [°]', turn_in_range, lower=np.degrees(-0.5),
                    upper=np.degrees(0.5)), error('tool', 'rad'))),
    'com_polygon': Scene(
        'talos', TALOS_READY, f"""
- [left_foot: {{type: pose, frame: left_sole_link}},
   right_foot: {{type: pose, frame: right_sole_link}}]
- balance:
    type: com_polygon
    contacts: {{left_sole_link: {SOLE}, right_sole_link: {SOLE}}}
    margin: 0.03
- joints: {{type: joint_limits}}
- hand: {{type: position, frame: gripper_left_base_link}}
- posture: {{type: posture, gain: 0.2}}
""",
        goals=((0.0, 'hand', [1.2, 0.2, 0.1]),), seconds=10.0,
        frames=('gripper_left_base_link',), draw=balance, compare=True,
        plots=(Plot('distance of the centre of mass from the edges [m]', nearest, lower=0.03),
               error('hand'))),
    'manipulability_above': Scene(
        'panda', READY, f"""
- mobile: {{type: manipulability_above, frame: {TOOL}, minimum: 0.05}}
- tool: {{type: pose, frame: {TOOL}}}
""",
        goals=((0.0, 'tool', down(0.85, 0.0, 0.4)),), frames=(TOOL,), compare=True,
        plots=(Plot('√det(J Jᵀ)', mobility, lower=0.05), error('tool'))),
    'speed_limit': Scene(
        'panda', READY, f"""
- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.25, angular: 1.0}}
- tool: {{type: pose, frame: {TOOL}, gain: 3.0}}
""",
        goals=((0.0, 'tool', down(0.65, 0.0, 0.05)),), seconds=2.0, frames=(TOOL,), compare=True,
        draw=steps,
        plots=(Plot('speed of the tool [m/s]', lambda run: run.speed(TOOL), upper=0.25),
               error('tool'))),
    'manipulability': Scene(
        'panda', (0.0, 0.9, 0.0, -0.6, 0.0, 1.2, 0.785), f"""
- tool: {{type: position, frame: {TOOL}}}
- mobile: {{type: manipulability, frame: {TOOL}}}
""",
        seconds=8.0,
        plots=(Plot('√det(J Jᵀ)', mobility), error('tool'))),
    'joint_limit_distance': Scene(
        'panda', (0.31, 1.31, -2.42, -1.01, 1.59, 0.46, -2.17), f"""
- tool: {{type: pose, frame: {TOOL}}}
- relax: {{type: joint_limit_distance, gain: 0.3}}
""",
        seconds=8.0, view=OBLIQUE,
        plots=(Plot('position between the limits', shares, lower=-1.0, upper=1.0, names='joint'),
               Plot('h(q)', value))),
}


# The method -------------------------------------------------------------------------------

# Two levels for two joints, J q̇ = v, and the limits of both joints [rad/s].
UPPER_LEVEL = (np.array([[0.316, 0.949]]), np.array([1.043]))
LOWER_LEVEL = (np.array([[1.0, -0.4]]), np.array([1.26]))
LIMIT = 1.0


def method_damping():
    """Draw what a direction gets of its demand over its singular value, undamped and damped."""
    figure = make_figure()
    speed, share = figure.subplots(1, 2)
    s = np.geomspace(1.0, 3e-3, 400)
    laws = {'undamped': Damping(), 'everywhere, λ = 0.1': Damping(0.1),
            'below ε, λ = ε = 0.1': Damping(0.1, 0.1),
            'first level, λ = ε = 0.02': Damping(0.1, 0.1).first}
    for (name, law), colour in zip(laws.items(), (WITHOUT_COLOUR, *drawing.LINE_COLOURS)):
        gains = law.gains(s, 0.0)
        style = WITHOUT_STYLE if law.off else {'linewidth': 2.0}
        speed.plot(s, gains, label=name, color=colour, **style)
        share.plot(s, s * gains, color=colour, **style)
    speed.set_yscale('log')
    speed.set_ylim(0.7, 100.0)
    for axis, title in ((speed, 'joint speed per demand'), (share, 'share of the demand')):
        axis.set_title(title, loc='left', fontsize=10)
        axis.set(xscale='log', xlabel='singular value s', xlim=(s[-1], s[0]))
        drawing.tidy(axis)
    figure.legend(loc='outside lower center', ncols=4, frameon=False, fontsize=9.5,
                  columnspacing=1.6)
    return figure


def method_levels():
    """Draw two levels in the plane of two joint velocities, without limits and with them."""
    figure = make_figure()
    free, limited = figure.subplots(1, 2, sharex=True, sharey=True)
    levels, box = [UPPER_LEVEL, LOWER_LEVEL], LIMIT * np.ones(2)
    first, both = (solve(levels[:count]).velocity for count in (1, 2))
    for axis in (free, limited):
        for (J, v), name, colour in zip(levels, ('level 1', 'level 2'), drawing.LINE_COLOURS):
            # Where a level is met is a line.
            along = np.outer([-3.0, 3.0], [-J[0, 1], J[0, 0]])
            axis.plot(*(np.linalg.pinv(J) @ v + along).T, color=colour, linewidth=2.0,
                      label=f'{name} is met')
        axis.set(aspect='equal', xlabel='velocity of joint 1 [rad/s]', xlim=(-0.1, 1.8),
                 ylim=(-0.1, 1.35))
        drawing.tidy(axis)
    free.set_ylabel('velocity of joint 2 [rad/s]')
    for start, end in ((np.zeros(2), first), (first, both)):
        free.annotate('', end, start, zorder=6, arrowprops={
            'arrowstyle': '-|>', 'color': drawing.ARM_COLOUR, 'linewidth': 1.8, 'shrinkA': 0,
            'shrinkB': 0, 'mutation_scale': 13})
    free.set_title('without limits: one step for each level', loc='left', fontsize=10)
    limited.set_title('with limits: which velocity is taken', loc='left', fontsize=10)
    drawing.mark_bound(limited, LIMIT, 3.0)
    limited.axvline(LIMIT, color=drawing.LIMIT_COLOUR, linewidth=1.2, linestyle='--', zorder=1)
    limited.axvspan(LIMIT, 3.0, color=drawing.LIMIT_COLOUR, alpha=0.06, linewidth=0.0)
    limited.plot(*np.column_stack((np.zeros(2), both)), color=WITHOUT_COLOUR, zorder=3,
                 **WITHOUT_STYLE)
    answers = {'redistributed': solve(levels, -box, box, scaling='redistribute').velocity,
               'clipped': both.clip(-box, box), 'uniform': solve(levels, -box, box).velocity}
    for (name, velocity), marker in zip(answers.items(), 'osD'):
        limited.plot(*velocity, marker, color=drawing.ARM_COLOUR, markersize=8, zorder=7)
        limited.annotate(name, velocity, (-10, -4), textcoords='offset points', ha='right',
                         va='center', zorder=8, bbox={'color': 'white', 'pad': 0.5})
    for axis in (free, limited):
        axis.plot(*both, '*', color=TARGET_COLOUR, markersize=13, zorder=6,
                  label='both are met')
    entries = dict(zip(*reversed(free.get_legend_handles_labels())))
    figure.legend(entries.values(), entries.keys(), loc='outside lower center', ncols=3,
                  frameon=False, fontsize=9.5, columnspacing=1.6)
    return figure


METHOD = {'method_damping': method_damping, 'method_levels': method_levels}


def main():
    """Draw the pictures of all task types, or of those named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('names', nargs='*', metavar='name', help=', '.join((*SCENES, *METHOD)))
    for name in parser.parse_args().names or (*SCENES, *METHOD):
        if name in METHOD:
            path, lines = drawing.save(METHOD[name](), FOLDER.parent / f'{name}.png'), ()
        else:
            path, lines = draw(name)
        print(path.relative_to(ROOT), *lines, sep='\n  ')


if __name__ == '__main__':
    main()

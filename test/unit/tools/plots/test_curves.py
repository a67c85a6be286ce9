# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures are written, show what they should, and leave the rest of matplotlib alone."""

import os
import subprocess
import sys
from threading import Thread

from matplotlib.colors import to_hex, to_rgb
import numpy as np
from PIL import Image
import pytest
from robots import panda, planar
from tp_controller.tools.plots import curves as plots
from tp_controller.tools.plots import drawing

TIMES = np.linspace(0.0, 10.0, 300)
ERRORS = [('tool', 'm', np.exp(-TIMES)), ('tool', 'rad', 2.0 * np.exp(-TIMES)),
          ('elbow', 'm', np.full(300, 0.3))]


def swing(robot, amplitude=0.4):
    """Return positions (300, n) of a slow swing."""
    rates = np.linspace(0.4, 1.0, robot.n)
    return robot.neutral() + amplitude * np.sin(TIMES[:, None] * rates)


def pixels(path):
    """Return the picture (h, w, 3) in 0 to 1."""
    with Image.open(path) as picture:
        return np.asarray(picture.convert('RGB')) / 255.0


def count(picture, colour, tolerance=0.06):
    """Return how many pixels have a colour."""
    return int((np.abs(picture - np.array(to_rgb(colour))).max(axis=2) < tolerance).sum())


def assert_shows_something(path):
    picture = pixels(path)
    assert picture.std() > 0.04
    # The margin is white, and nothing is cut off at the edge.
    for edge in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
        assert edge.min() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize('log', [False, True])
def test_errors_are_drawn_in_the_colour_of_their_task(tmp_path, log):
    path = plots.plot_errors(tmp_path / 'new' / 'errors.png', TIMES, ERRORS, changes=[4.0],
                             log=log)
    assert path == tmp_path / 'new' / 'errors.png'
    assert_shows_something(path)
    picture = pixels(path)
    assert count(picture, drawing.LINE_COLOURS[0]) > 500
    assert count(picture, drawing.LINE_COLOURS[1]) > 300


@pytest.mark.slow
def test_what_limits_a_task_is_a_band_as_long_as_it_lasts(tmp_path):
    def drawn(**causes):
        return pixels(plots.plot_errors(
            tmp_path / 'errors.png', TIMES, [('tool', 'm', np.zeros(len(TIMES)))],
            causes=causes))

    none, half, whole = ([('joint 4 at its limit',) if time < share * TIMES[-1] else ()
                          for time in TIMES] for share in (0.0, 0.5, 1.0))
    picture = drawn(tool=half, elbow=none)
    # The line of the error and the legend are as they are without a band.
    bare = count(drawn(tool=none, elbow=none), drawing.LINE_COLOURS[0])
    legend = count(drawn(tool=half[:1] + none[1:]), drawing.LINE_COLOURS[0]) - bare
    short = count(drawn(tool=half), drawing.LINE_COLOURS[0]) - bare - legend
    long = count(drawn(tool=whole), drawing.LINE_COLOURS[0]) - bare - legend
    assert long == pytest.approx(2.0 * short, rel=0.1)
    assert len(picture) == len(drawn(tool=half)) > len(drawn(tool=none))


@pytest.mark.parametrize('colours', [1, 2, 3])
@pytest.mark.slow
def test_causes_at_once_share_the_row_of_their_task(tmp_path, colours):
    def drawn(causes):
        picture = pixels(plots.plot_errors(
            tmp_path / 'errors.png', TIMES, [('tool', 'm', np.zeros(len(TIMES)))],
            causes={'elbow': [causes] * len(TIMES)}))
        # The last colour is that of text, too.
        return np.array([count(picture, colour) for colour in drawing.LINE_COLOURS[:-1]])

    bands = drawn(('blocked by tool', 'slowed by damping', 'joint 4 at its limit')[:colours])
    # The line of the error has the first colour.
    bands[0] -= drawn(())[0]
    assert (bands[:colours] > 1000).all() and not (bands[colours:] > 200).any()
    assert bands[:colours].max() < 1.2 * bands[:colours].min()


@pytest.fixture
def figures(monkeypatch):
    """Return the figures that are drawn from now on, none of which is written."""
    found = []
    monkeypatch.setattr(plots, 'save', lambda figure, path: found.append(figure))
    return found


def bands(axis):
    """Return (colour, row, upper edge in it, start, end) of all bands of an axis."""
    found = set()
    for collection in axis.collections:
        colour, = {to_hex(each).upper() for each in collection.get_facecolor()}
        for path in collection.get_paths():
            (start, top), (end, bottom) = path.vertices.min(axis=0), path.vertices.max(axis=0)
            row = round(0.5 * (top + bottom))
            found.add((colour, row, *(round(float(value), 3) for value in
                                      (top - row, start, end))))
    return found


def legend_of(axis):
    """Return {label: colour} of the legend of an axis."""
    legend = axis.get_legend()
    labels = [text.get_text() for text in legend.get_texts()]
    assert len(set(labels)) == len(labels)
    return {label: to_hex(line.get_color()).upper()
            for label, line in zip(labels, legend.get_lines())}


def test_a_cause_has_one_colour_in_all_rows_and_in_the_legend(figures, tmp_path):
    one, two, three = drawing.LINE_COLOURS[:3]
    causes = {'tool': [('a',), ('a',), (), ()],
              'elbow': [('b', 'a'), ('a', 'b'), ('b',), ('b',)],
              'rest': [(), ('c',), (), ()], 'free': [()] * 4}
    plots.plot_errors(tmp_path / 'errors.png', [0.0, 1.0, 2.0, 5.0], [('tool', 'm', np.ones(4))],
                      causes=causes, changes=[1.0, 4.0])
    axis = figures[0].axes[-1]
    # b is seen longer than a, and is above it wherever both are.
    assert bands(axis) - {(one, 1, -0.4, 5.0, 5.0)} == {
        (two, 0, -0.4, 0.0, 1.0), (two, 0, -0.4, 1.0, 2.0), (one, 1, -0.4, 0.0, 1.0),
        (two, 1, 0.0, 0.0, 1.0), (one, 1, -0.4, 1.0, 2.0), (two, 1, 0.0, 1.0, 2.0),
        (one, 1, -0.4, 2.0, 5.0), (three, 2, -0.4, 1.0, 2.0)}
    shown = legend_of(axis)
    assert list(shown) == ['b', 'a', 'c', 'new goal']
    assert [shown[cause] for cause in 'bac'] == [one, two, three]
    assert [label.get_text() for label in axis.get_yticklabels()] == ['tool', 'elbow', 'rest']
    low, high = axis.get_ylim()
    assert low > 2.0 and high < 0.0, 'the first task is above'


def test_causes_that_are_seen_longest_have_a_colour_and_the_rest_shares_one(figures, tmp_path):
    # The first is named most often, and is seen for the shortest time.
    names = ['often'] * 20 + [f'cause {number}' for number in range(8)]
    times = np.concatenate((np.linspace(0.8, 0.9, 20), 1.0 + np.arange(9.0)))
    for known in (8, 7):
        sets = [(name,) for name in names[20 - 20 * (known == 8):20 + known]] + [()]
        plots.plot_errors(tmp_path / 'errors.png', times[-len(sets):],
                          [('tool', 'm', np.ones(len(sets)))], causes={'tool': sets})
    many, few = (legend_of(figure.axes[-1]) for figure in figures)
    assert len(many) == 8 and many.pop('other') == drawing.GUIDE_COLOUR.upper()
    assert set(many) < {f'cause {number}' for number in range(8)}
    assert list(few) == [f'cause {number}' for number in range(7)]
    assert list(few.values()) == list(map(str.upper, drawing.LINE_COLOURS))


def test_a_name_has_one_colour_on_the_axes_of_all_units(figures, tmp_path):
    plots.plot_errors(tmp_path / 'errors.png', TIMES, [
        ('tool', 'm', -np.ones(300)), ('elbow', 'rad', np.ones(300)),
        ('tool', 'rad', np.ones(300))], changes=[2.0, 3.0])
    upper, lower = (legend_of(axis) for axis in figures[0].axes)
    assert list(upper) == ['tool', 'new goal'] and list(lower) == ['elbow', 'tool', 'new goal']
    assert upper['tool'] == lower['tool'] == drawing.LINE_COLOURS[0]
    assert figures[0].axes[0].lines[0].get_ydata().min() == 1.0


def test_time_axis_ends_where_the_recording_does(figures, tmp_path):
    plots.plot_errors(tmp_path / 'errors.png', [2.0, 3.0], [('tool', 'm', np.ones(2))],
                      causes={'tool': [('a',), ('a',)]}, changes=[2.5, 9.0])
    for axis in figures[0].axes:
        assert axis.get_xlim() == (2.0, 3.0)


def test_errors_near_zero_do_not_stretch_a_logarithmic_axis_and_zeros_leave_a_gap(
        figures, tmp_path):
    plots.plot_errors(tmp_path / 'errors.png', np.arange(4.0),
                      [('tool', 'm', np.array([1.0, 1e-14, 0.0, 0.5]))], log=True)
    axis = figures[0].axes[0]
    assert 1e-8 < axis.get_ylim()[0] < 1e-6
    assert np.isnan(axis.lines[0].get_ydata()[2])


def test_velocity_limits_are_marked_on_both_sides(figures, tmp_path):
    plots.plot_velocities(tmp_path / 'velocities.png', TIMES, np.zeros((300, 2)), [2.0, 2.0],
                          ['a', 'b'])
    axis, = figures[0].axes
    marked = [line.get_ydata()[0] for line in axis.lines
              if to_hex(line.get_color()).upper() == drawing.LIMIT_COLOUR]
    assert marked == [2.0, -2.0] and list(legend_of(axis)).count('limit') == 1


@pytest.mark.slow
def test_figure_is_as_high_as_the_legend_of_long_causes_needs(tmp_path):
    def drawn(name):
        sets = [(f'{name} {int(time)}',) for time in TIMES]
        path = plots.plot_errors(tmp_path / 'errors.png', TIMES, ERRORS, causes={'tool': sets})
        assert_shows_something(path)
        return pixels(path)

    short, long = drawn('cause'), drawn('cause with a name so long that it needs another line')
    assert len(long) > len(short) + 100
    # The time axis is at the bottom, not pushed up by the legend.
    for picture in (short, long):
        axis = np.flatnonzero((picture < 0.1).all(axis=2).mean(axis=1) > 0.4)
        assert len(picture) - axis[-1] < 70


@pytest.mark.slow
def test_more_causes_than_colours_share_one(tmp_path):
    sets = [(f'cause {int(time)}',) for time in TIMES]
    picture = pixels(plots.plot_errors(tmp_path / 'errors.png', TIMES, ERRORS,
                                       causes={'tool': sets}))
    assert all(count(picture, colour) > 100
               for colour in (*drawing.LINE_COLOURS, drawing.GUIDE_COLOUR))


@pytest.mark.slow
@pytest.mark.parametrize('values', [np.zeros(300), np.full(300, np.nan),
                                    np.where(TIMES < 5.0, np.nan, 1e-12)])
@pytest.mark.parametrize('log', [False, True])
def test_errors_that_are_zero_or_missing_can_be_drawn(tmp_path, values, log):
    assert_shows_something(plots.plot_errors(tmp_path / 'errors.png', TIMES,
                                             [('tool', 'm', values)], log=log))


@pytest.mark.slow
@pytest.mark.parametrize('limits, marked', [
    ([1.0, 1.0, 1.0], True), ([1.0, 2.0, 0.5], True), ([1.0, 2.0, np.inf], True),
    ([0.0, 1.0, 1.0], True), ([np.inf, np.inf, np.inf], False)])
def test_velocity_limits_are_marked_where_there_are_any(tmp_path, limits, marked):
    velocities = 0.4 * np.cos(TIMES[:, None] * [0.5, 1.0, 1.5])
    path = plots.plot_velocities(tmp_path / 'velocities.png', TIMES, velocities, limits,
                                 planar().joint_names, units=['rad', 'm', 'rad'], changes=[2.0])
    assert_shows_something(path)
    assert (count(pixels(path), drawing.LIMIT_COLOUR, 0.2) > 500) is marked


@pytest.mark.slow
def test_every_joint_has_its_line(tmp_path):
    robot = panda()
    velocities = np.cos(TIMES[:, None] * np.linspace(0.5, 1.5, robot.n))
    path = plots.plot_velocities(tmp_path / 'velocities.png', TIMES, velocities, robot.velocity,
                                 robot.joint_names)
    for joint in range(robot.n):
        assert count(pixels(path), drawing.LINE_COLOURS[joint]) > 200


def test_no_two_joints_of_a_humanoid_have_the_same_line():
    lines = [(line['color'], line['linestyle']) for line in map(plots._line, range(50))]
    assert len(set(lines)) == len(lines)


def test_positions_are_drawn_in_the_colour_of_their_joint(tmp_path):
    robot = planar()
    path = plots.plot_positions(tmp_path / 'q.png', TIMES, swing(robot), robot.joint_names,
                                changes=[1.0])
    assert_shows_something(path)
    for joint in range(robot.n):
        assert count(pixels(path), drawing.LINE_COLOURS[joint]) > 200


@pytest.mark.slow
@pytest.mark.parametrize('height', [0.0, 0.3])
def test_tool_path_and_goals_are_drawn_flat_and_in_space(tmp_path, height):
    points = np.column_stack((np.cos(TIMES), np.sin(TIMES), height * TIMES))
    goals = np.array([[0.5, 0.5, 0.0], [np.nan, 0.0, 0.0]])
    with_goals = plots.plot_tool_path(tmp_path / 'goals.png', points, goals, times=TIMES)
    without = plots.plot_tool_path(tmp_path / 'path.png', points)
    for path in (with_goals, without):
        assert_shows_something(path)
    shown, hidden = (count(pixels(path), drawing.GOAL_COLOUR) for path in (with_goals, without))
    assert shown > hidden + 50


@pytest.mark.slow
@pytest.mark.parametrize('size', [(0.4, 0.4, 1.0), (1.0, 1.0, 1.0), (0.2, 1.0, 1.0),
                                  (1.0, 0.2, 0.2)])
def test_legend_of_a_path_in_space_covers_no_name_of_an_axis(figures, tmp_path, size):
    points = np.outer(TIMES / TIMES[-1], size)
    plots.plot_tool_path(tmp_path / 'path.png', points, points[:1], times=TIMES)
    figure, = figures
    figure.canvas.draw()
    legend, axis = figure.legends[0].get_window_extent(), figure.axes[0]
    for side in (axis.xaxis, axis.yaxis):
        assert not legend.overlaps(side.label.get_window_extent())
        for label in side.get_ticklabels():
            assert not legend.overlaps(label.get_window_extent())


@pytest.mark.slow
def test_legend_of_many_joints_is_not_cut_off(tmp_path):
    names = [f'joint{index}' for index in range(18)]
    path = plots.plot_velocities(tmp_path / 'velocities.png', TIMES,
                                 np.zeros((300, 18)), np.arange(1.0, 19.0), names, changes=[1.0])
    assert_shows_something(path)


@pytest.mark.slow
@pytest.mark.parametrize('samples', [1, 2])
def test_the_shortest_recordings_can_be_drawn(tmp_path, samples):
    robot, times = planar(), TIMES[:samples]
    q = swing(robot)[:samples]
    points = np.column_stack((q[:, 0], q[:, 1], np.zeros(samples)))
    plots.plot_errors(tmp_path / 'a.png', times, [('tool', 'm', times)])
    plots.plot_velocities(tmp_path / 'b.png', times, q, robot.velocity, robot.joint_names)
    plots.plot_positions(tmp_path / 'c.png', times, q, robot.joint_names)
    plots.plot_tool_path(tmp_path / 'd.png', points)


def test_a_figure_can_be_drawn_in_another_thread(tmp_path):
    thread = Thread(target=plots.plot_errors, args=(tmp_path / 'errors.png', TIMES, ERRORS))
    thread.start()
    thread.join()
    assert_shows_something(tmp_path / 'errors.png')


@pytest.mark.slow
def test_neither_pyplot_nor_the_global_settings_are_touched(tmp_path):
    # In a process of its own: other tests may have loaded pyplot.
    code = """
import sys
import matplotlib
before = matplotlib.rcParams.copy()
from tp_controller.tools.plots import curves as plots
plots.plot_errors(sys.argv[1], [0.0, 1.0], [('tool', 'm', [1.0, 0.5])])
assert 'matplotlib.pyplot' not in sys.modules
raw = dict.__getitem__  # rcParams['backend'] would choose one
assert all(raw(matplotlib.rcParams, key) == raw(before, key) for key in before)
"""
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, '-c', code, str(tmp_path / 'errors.png')], check=True,
                   env=environment, timeout=60)

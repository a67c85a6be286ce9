# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Time control cycles against the number of levels and of joints, in microseconds.

Run as ``python benchmarks/sizes.py``. The robots are arms of equal links in a plane. Each level is
the position of a link: the first that of the tip, the others follow at equal distances towards the
foot. One sweep has 1 to 12 levels on 30 joints, the other 3 levels on 6 to 60 joints. States and
limits are those of solver.py: the same 64 states without an active limit, and with speed limits so
low that the demand is 6 times too fast in the median, so that joints are at their limits in at
least 95 % of them. Everything takes turns in one process; figures are processor time, the median
over the rounds.

For each column, the straight line that fits the levels best is printed, and how far the figures
are from it. ``--figure docs/images/sizes.png`` draws what is printed.
"""

import argparse

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from solver import Case, load_case, time_cycles
from tp_controller.tools.plots import drawing

JOINTS, LEVELS = 30, range(1, 13)
FEW_LEVELS, MORE_JOINTS = 3, range(6, 61, 6)
# Angle between the first link and the last in the working posture [rad].
BEND = 3.0
# So slow that no limit is active, and so many times too fast in the median.
GAIN, TOO_FAST = 0.2, 6.0
ROUNDING = 1e-6
# {shown: (which of the cases of `load_case`, what is run)}
COLUMNS = {
    'solve, idle': ('free', Case.solve),
    'solve, limits active': ('limited', Case.solve),
    'update, idle': ('free', Case.update),
    'update, limits active': ('limited', Case.update),
}


def stack_text(joints, levels):
    """Return a stack of positions of links, the tip first, in YAML."""
    links = [-(-joints * (levels - number) // levels) for number in range(levels)]
    return '\n'.join(f'- level{number}: {{type: position, frame: link{link}, axes: xy, '
                     f'gain: {GAIN}}}' for number, link in enumerate(links, 1))


def load(joints, levels):
    """Return what `load_case` returns, with joints at their limits where they should be."""
    kinds = load_case(f'planar {joints}R', np.full(joints, BEND / joints),
                      stack_text(joints, levels), TOO_FAST)
    for kind, least, most in (('free', 0.0, 0.0), ('limited', 0.95, 1.0)):
        case = kinds[kind]
        fastest = [np.max(np.abs(case.solution(*given).velocity)) for given in case.prepared]
        share = np.mean(np.array(fastest) > (1.0 - ROUNDING) * case.robot.velocity[0])
        assert least <= share <= most, (joints, levels, kind, share)
    return kinds


def measure(sizes, rounds):
    """Return the median of microseconds per cycle, {(joints, levels): {column: µs}}."""
    cases = {size: load(*size) for size in sizes}
    times = {size: {column: [] for column in COLUMNS} for size in sizes}
    for _ in range(rounds):
        for size, kinds in cases.items():
            for column, (kind, cycle) in COLUMNS.items():
                times[size][column].append(time_cycles(kinds[kind], cycle, 0.0))
    return {size: {column: float(np.median(row)) for column, row in columns.items()}
            for size, columns in times.items()}


def print_sweep(times, sizes):
    """Print the table of a sweep."""
    print('| joints | levels | ' + ' | '.join(COLUMNS) + ' |\n| --- | --- |'
          + ' --- |' * len(COLUMNS))
    for size in sizes:
        cells = [f'{size[0]}', f'{size[1]}',
                 *(f'{times[size][column]:.1f}' for column in COLUMNS)]
        print(f'| {" | ".join(cells)} |')
    print()


def print_lines(times, sizes):
    """Print how well straight lines fit a sweep over levels."""
    levels = np.array([number for _, number in sizes])
    for column in COLUMNS:
        figures = np.array([times[size][column] for size in sizes])
        slope, start = np.polyfit(levels, figures, 1)
        off = np.max(np.abs(start + slope * levels - figures) / figures)
        print(f'- {column}: {start:.1f} + {slope:.2f} µs a level, off by at most {off:.0%}')
    print()


def draw(times, sweeps, path):
    """Draw both sweeps."""
    figure = Figure(figsize=(8.2, 3.45), dpi=drawing.PLOT_DPI, layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2)
    for axis, (title, place, sizes) in zip(axes, sweeps):
        for number, column in enumerate(COLUMNS):
            axis.plot([size[place] for size in sizes], [times[size][column] for size in sizes],
                      color=drawing.LINE_COLOURS[number // 2], marker='o', markersize=3.5,
                      linestyle=('--', '-')[number % 2], label=column)
        axis.set(title=title, xlabel=('joints', 'levels')[place], ylabel='µs per cycle')
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(left=0.0)
        drawing.tidy(axis)
    axes[1].legend(frameon=False)
    print(drawing.save(figure, path))


def main():
    """Measure, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=15)
    parser.add_argument('--figure', help='file to draw into')
    options = parser.parse_args()
    by_levels = [(JOINTS, levels) for levels in LEVELS]
    by_joints = [(joints, FEW_LEVELS) for joints in MORE_JOINTS]
    times = measure(dict.fromkeys(by_levels + by_joints), options.rounds)
    print_sweep(times, by_levels)
    print_lines(times, by_levels)
    print_sweep(times, by_joints)
    if options.figure:
        draw(times, ((f'{JOINTS} joints', 1, by_levels), (f'{FEW_LEVELS} levels', 0, by_joints)),
             options.figure)


if __name__ == '__main__':
    main()

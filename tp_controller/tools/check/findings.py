# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Findings from the numbers of a check: sentences with suggested changes."""

from collections.abc import Collection, Iterator, Sequence
import math

import numpy as np
from tp_controller.control.causes import ACCELERATING, JOINTS
from tp_controller.control.cycle import TRANSITION
from tp_controller.control.gains import decay_step, gain_faults, gain_remark, OVERSHOOT_STEP
from tp_controller.control.joint_limits import VelocityLimit
from tp_controller.control.units import with_unit
from tp_controller.model.limits import velocity_table
from tp_controller.tasks.joint import Joint
from tp_controller.tasks.task import Task
from tp_controller.tasks.task_errors import out_of_reach
from tp_controller.tools.check.contradictions import Contradiction
from tp_controller.tools.check.results import (
    CauseCount,
    COMBINED,
    DOUBTFUL,
    Finding,
    FINE,
    JUMP,
    LevelResult,
    PairResult,
    POSITION,
    STILL_MOVING,
    TaskResult,
    Timing,
    WorstResult,
    WRONG,
)
from tp_controller.tools.check.setup import Setup

# Shares of the samples, or of the time [1].
MAJORITY, NEARLY_ALL, HARDLY_ANY = 0.5, 0.9, 0.01
# Possible runs required for the findings 'never reached' and 'seldom reached'.
ENOUGH_RUNS, ENOUGH_NEAR_RUNS = 5, 4
# Change of a command in one cycle that counts as a jump, as a share of the velocity limit [1].
JUMP_SHARE = 0.2
# Rounding errors of shares of a limit [1], and of positions [rad or m].
LIMIT_ROUNDING, POSITION_ROUNDING = 1e-6, 1e-9
# Share of the period that the 99th percentile of the cycle time may reach [1].
BUSY_SHARE = 0.5
# Largest number of causes or tasks that a finding names.
NAMES_PER_FINDING = 3
# Gain times the time in which an error shrinks to a thousandth, about ln 1000 [1].
DECAY_TIME_CONSTANTS = 7.0
# Values that look like degrees or millimetres: velocity limits [rad/s or m/s], positions of joints
# [rad], and tolerances.
IMPLAUSIBLE_SPEED, IMPLAUSIBLE_ANGLE = 40.0, 4.0 * math.pi
IMPLAUSIBLE_TOLERANCE = {'m': 0.5, 'rad': 1.0}
# Gain of a task from which errors of measured positions make up most of the command [1/s].
IMPLAUSIBLE_GAIN = 100.0
# Ratio of a weight to the median beyond which a joint might as well not be driven [1].
IMPLAUSIBLE_WEIGHT = 1e4
# Kinds of causes by which other tasks limit a task.
BY_OTHERS = ('task', 'bounds', COMBINED)
# Causes of a task that gets nearer to its goal.
ON_ITS_WAY = (STILL_MOVING, ACCELERATING, TRANSITION, VelocityLimit.name)


def about_parameters(ignored: Sequence[str]) -> Iterator[Finding]:
    """Yield a finding for each parameter that a node would not know."""
    for name in ignored:
        yield Finding(DOUBTFUL, 'parameter', name, 'no parameter of a controller, nor of a task '
                      'of this stack: a node ignores it', 'correct its name, or leave it out')


def about_robot(setup: Setup) -> Iterator[Finding]:
    """Yield the findings about velocity limits, and the remarks of the robot."""
    robot = setup.robot
    for limit, what, change in (
            (math.inf, 'no velocity limit', 'give it, with the values of the data sheet, by'),
            (0.0, 'the velocity limit is zero, so it does not move',
             'leave the joint out of the driven ones, or raise it by')):
        names = [name for name, given in zip(robot.velocity_names, robot.velocity)
                 if given == limit]
        if names:
            yield Finding(DOUBTFUL, 'velocity limit', ', '.join(names), what,
                          f'{change} {velocity_table(names)}')
    for remark in robot.remarks:
        yield Finding(DOUBTFUL, 'remark', robot.name, remark,
                      'replace them by limits, or correct the description')


def about_values(setup: Setup) -> Iterator[Finding]:
    """Yield the findings about numbers that look wrong, and the remarks of tasks."""
    robot = setup.robot
    fast = [f'{name} ({limit:g})' for name, limit in zip(robot.velocity_names, robot.velocity)
            if IMPLAUSIBLE_SPEED < limit < math.inf]
    if fast:
        yield Finding(DOUBTFUL, 'units', ', '.join(fast),
                      f'a velocity limit above {IMPLAUSIBLE_SPEED:g} rad/s or m/s looks like '
                      'degrees or millimetres', 'give it in rad/s or m/s')
    weights = np.array(setup.settings.weights or np.ones(robot.n))
    ratio = np.maximum(weights / np.median(weights), np.median(weights) / weights)
    far = [name for name, each in zip(robot.velocity_names, ratio) if each > IMPLAUSIBLE_WEIGHT]
    if far:
        yield Finding(DOUBTFUL, 'weights', ', '.join(far),
                      f'its weight differs from the median by a factor of {ratio.max():.0e}',
                      'weights of 0.01 to 100 are enough; to hold a joint still leave it out of '
                      'the driven ones')
    for task in setup.stack.tasks.values():
        yield from _about_values_of(task)


def _about_values_of(task: Task) -> Iterator[Finding]:
    """Yield the findings about numbers of a task that look wrong, and its remarks."""
    for _, unit, tolerance in task.groups:
        if tolerance > IMPLAUSIBLE_TOLERANCE.get(unit, math.inf):
            yield Finding(DOUBTFUL, 'units', task.name,
                          f'a tolerance of {with_unit(f"{tolerance:g}", unit)} is reached nearly '
                          'everywhere', 'give it in metres and radians')
    if isinstance(task, Joint) and task.goal is not None:
        angles = np.abs(task.goal)[np.array(task.units) == 'rad']
        if angles.max(initial=0.0) > IMPLAUSIBLE_ANGLE:
            yield Finding(DOUBTFUL, 'units', task.name,
                          f'a goal of {angles.max():g} rad is beyond two turns, and looks like '
                          'degrees', 'give it in radians')
    for remark in task.remarks:
        yield Finding(FINE, 'remark', task.name, remark, '')


def about_levels(setup: Setup, levels: Sequence[LevelResult], filling: frozenset[str]
                 ) -> Iterator[Finding]:
    """Yield the findings about the rank left to levels; `filling` tasks demand every joint."""
    for level in levels:
        above = _names(_demanding(setup, level.number))
        bounded = all(setup.stack.tasks[name].bounded for name in level.tasks)
        if bounded and (level.never < 1.0 or not above):
            continue
        if not level.rank and level.most_of_all:
            # None of its joints moves it, which is a finding of its own.
            continue
        where = f'level {level.number} ({_names(level.tasks)})'
        fills = not filling.isdisjoint(level.tasks)
        change = 'put it above them, or leave out axes of theirs'
        if level.most_left < level.most_of_all:
            change = f'let it use more joints, or {change}'
        if level.never == 1.0 and fills and above:
            yield Finding(
                FINE, 'never acts', where,
                f'all directions are taken by {above}: it acts only where some of them are '
                'relaxed near a singularity, or disabled', '')
        elif level.never == 1.0:
            yield Finding(
                WRONG, 'never acts', where,
                'it can never act: ' + (f'in none of the samples is a direction left by {above}'
                                        if above else 'the robot can move none of its rows'),
                change if above else 'name another frame, other axes or other joints')
        elif level.never >= MAJORITY:
            yield Finding(
                DOUBTFUL, 'seldom acts', where,
                f'in {level.never:.0%} of the samples no direction is left by {above}', change)
        elif level.median_left < level.rank and not fills:
            yield Finding(
                DOUBTFUL, 'acts in part', where,
                f'{level.median_left:g} of its {level.rank} directions are left by {above}, in '
                'the median', 'leave out axes of one of them')


def about_pairs(pairs: Sequence[PairResult], levels: dict[str, int]) -> Iterator[Finding]:
    """Yield a finding for each pair of tasks that share directions; levels are {task: level}."""
    for pair in pairs:
        if pair.shared < MAJORITY:
            continue
        one_level = levels[pair.first] == levels[pair.second]
        loser = 'neither of them follows its goal' if one_level else \
            f'{pair.second}, which stands below, does not follow its goal'
        yield Finding(
            DOUBTFUL, 'fight', f'{pair.first}, {pair.second}',
            f'in {pair.shared:.0%} of the samples they share {_count(pair.directions)} (the '
            f'smallest angle between their rows is {math.degrees(pair.median_angle):.0f}° in '
            f'the median): {loser} there unless the goals agree',
            'leave out the axes that they share of one of them, or send goals that agree')


def about_gains(setup: Setup) -> Iterator[Finding]:
    """Yield a finding for each gain too high for the rate, unless a controller refuses it."""
    for task in setup.stack.tasks.values():
        found = gain_remark(task, task.gain, setup.period)
        if found and not gain_faults(task, task.gain, setup.settings.period):
            yield Finding(WRONG if found.step >= OVERSHOOT_STEP else DOUBTFUL, 'gain', task.name,
                          found.message, found.change)
        elif not found and decay_step(task, task.gain, setup.period) is not None \
                and np.max(task.gain, initial=0.0) > IMPLAUSIBLE_GAIN:
            gain = np.max(task.gain)
            yield Finding(DOUBTFUL, 'gain', task.name,
                          f'a gain of {gain:g}/s turns an error of a milliradian in the measured '
                          f'positions into {1e-3 * gain:g} rad/s',
                          'lower it: 1 to 10/s is usual, and reaches a goal in 1 to 5 s')


def about_singularities(setup: Setup, tasks: Sequence[TaskResult], explained: Collection[str]
                        ) -> Iterator[Finding]:
    """Yield a finding for each other task that is near a singularity in most samples."""
    for task in tasks:
        if task.singular is None or task.smallest is None or task.singular < MAJORITY \
                or task.name in explained:
            continue
        never = task.singular == 1.0 and task.smallest < POSITION_ROUNDING
        if never and not task.fixed:
            # A frame that moves on a sphere can go along any axis somewhere.
            continue
        if never:
            yield Finding(
                DOUBTFUL, 'impossible', task.name,
                'in no sample can the robot move in all of its directions',
                'leave out the axes that the robot does not have')
        else:
            yield Finding(
                DOUBTFUL, 'singular', task.name,
                f'in {task.singular:.0%} of the samples it is near a singularity, where it is '
                f'damped (smallest singular value {task.smallest:.2g} in the median)',
                'keep away from there: narrower limits, a posture, manipulability_above; for a '
                'small robot lower singular_region and damping')


def about_bounds(setup: Setup, tasks: Sequence[TaskResult], runs: int,
                 contradictions: Sequence[Contradiction]) -> Iterator[Finding]:
    """Yield the findings about bounds that contradict each other, never act, or dominate."""
    explained = {name for each in contradictions for name in (each.task, each.other)}
    for each in contradictions:
        yield _about_contradiction(each)
    for task in tasks:
        if task.outside is None or task.name in explained:
            continue
        others = bool(_demanding(setup, task.level))
        if runs and not task.possible:
            # Below others bounds may never be satisfied by priority.
            yield Finding(
                DOUBTFUL if others else WRONG, 'bounds', task.name,
                'no configuration was found that satisfies it: the robot did not come '
                f'to within its bounds in any of {runs} runs',
                'widen its bounds' + (', or put it higher' if others else ''))
        elif runs and 0 < task.possible < MAJORITY * runs:
            yield Finding(
                DOUBTFUL, 'bounds', task.name,
                f'in {runs - task.possible} of {runs} runs the robot did not come to within its '
                'bounds before it started', 'widen its bounds, or those of others that contradict '
                'them' + ('; or put it higher' if others else ''))
        if task.within_reach == 0.0 and not task.active_in_loops:
            yield Finding(
                DOUBTFUL, 'never active', task.name,
                'in none of the samples could joints at their velocity limits bring it to its '
                'bounds', 'narrow its bounds, if they are meant to matter, or leave it out; '
                'lengths are in metres, angles in radians')
        elif task.outside > 1.0 - HARDLY_ANY and (task.rows_outside or 0.0) > MAJORITY:
            yield Finding(
                DOUBTFUL, 'bounds dominate', task.name,
                f'{task.outside:.1%} of the samples are outside its bounds', 'widen its bounds')
        elif (task.active_in_loops or 0.0) >= NEARLY_ALL:
            yield Finding(
                DOUBTFUL, 'bounds dominate', task.name,
                f'its bounds are active for {task.active_in_loops:.0%} of the time of the closed '
                'loops', 'widen its bounds')


def _about_contradiction(found: Contradiction) -> Finding:
    """Return the finding about bounds that no configuration satisfies."""
    best = f'at best {found.missing} are missing'
    if not found.other:
        return Finding(WRONG, 'bounds', found.task,
                       'no configuration was found that satisfies it, not even without all other '
                       f'tasks: {best}', 'widen its bounds')
    return Finding(WRONG, 'contradiction', f'{found.other}, {found.task}',
                   f'no configuration was found that satisfies both: with {found.other}, {best} '
                   f'of {found.task}', f'widen the bounds of {found.other} or {found.task}')


def about_goals(setup: Setup, tasks: Sequence[TaskResult], runs: int,
                filling: frozenset[str]) -> Iterator[Finding]:
    """Yield a finding on the reached goals of each task; `filling` tasks demand every joint."""
    for task in tasks:
        own = setup.stack.tasks[task.name]
        unreachable = out_of_reach(own)
        if unreachable:
            yield Finding(WRONG, 'out of reach', task.name, unreachable,
                          'choose another goal; lengths are in metres')
        elif task.possible:
            yield _about_goal(setup, task, filling)
        elif task.outside is None and own.goal is not None and task.causes \
                and not _demanding(setup, task.level):
            moving = task.causes[0].kind == STILL_MOVING
            yield Finding(DOUBTFUL if moving else WRONG, 'never reached', task.name,
                          f'no configuration was found at its goal, in any of {runs} runs'
                          + _causes_text(task.causes),
                          'raise the time of a run' if moving else
                          task.hint or 'choose another goal')


def _about_goal(setup: Setup, task: TaskResult, filling: frozenset[str]) -> Finding:
    """Return the finding about the reached goals of a task that can be at them."""
    found = f'at its goal in {task.reached} of {task.possible} runs' if task.outside is None \
        else f'satisfied in the end of {task.reached} of {task.possible} runs'
    if task.reached < task.possible:
        found += f', {task.reached_near} of {task.possible_near} with near goals'
    if task.median_seconds is not None and task.outside is None:
        found += f', after {task.median_seconds:.1f} s in the median'
    missed = bool(task.possible_near >= ENOUGH_NEAR_RUNS
                  and task.reached_near < MAJORITY * task.possible_near)
    main = task.causes[0].kind if task.causes else ''
    slow = _slow_text(setup, task) if main in ON_ITS_WAY and (missed or not task.reached) else ''
    if slow:
        return Finding(DOUBTFUL, 'slow', task.name, f'{found}; {slow}',
                       'raise its gain, or the time of a run')
    if task.name in filling and main in BY_OTHERS:
        # It takes what the others leave it.
        severity, kind = FINE, 'reached'
    elif not task.reached:
        # A task below others may never be reached by priority, and few runs prove nothing.
        sure = task.possible >= ENOUGH_RUNS and task.name not in filling \
            and main not in (*BY_OTHERS, STILL_MOVING, ACCELERATING, TRANSITION)
        severity, kind = WRONG if sure else DOUBTFUL, 'never reached'
    elif missed:
        severity, kind = DOUBTFUL, 'seldom reached'
    else:
        severity, kind = FINE, 'reached'
    return Finding(severity, kind, task.name, found + _causes_text(task.causes),
                   '' if severity == FINE else _remedy(setup, task))


def _demanding(setup: Setup, level: int) -> list[str]:
    """Return the tasks above a level that demand a velocity."""
    return [task.name for group in setup.stack.active[:max(level - 1, 0)] for task in group
            if not task.bounded]


def _slow_text(setup: Setup, task: TaskResult) -> str:
    """Return the end of a sentence about a gain too low for the time of a run; mostly empty."""
    if task.gain_period is None:
        return ''
    gain = float(np.min(setup.stack.tasks[task.name].gain))
    if gain * setup.seconds >= DECAY_TIME_CONSTANTS:
        return ''
    return f'still on its way: a gain of {gain:g}/s needs ' \
           f'{DECAY_TIME_CONSTANTS / gain:.3g} s for a thousandth of an error, and a run has ' \
           f'{setup.seconds:g} s'


def about_limits(worst: Sequence[WorstResult], setup: Setup) -> Iterator[Finding]:
    """Yield the findings about exceeded limits and jumps of the command."""
    exceeded = False
    for each in worst:
        if each.value is None:
            continue
        most = {POSITION: POSITION_ROUNDING, JUMP: math.inf}.get(each.kind, 1.0 + LIMIT_ROUNDING)
        if each.value > most:
            exceeded = True
            share = 'passed by {:.2g}' if each.kind == POSITION else 'exceeded {:.3g} times'
            yield Finding(
                WRONG, 'violation', each.name,
                f'its {each.kind} limit was {share.format(each.value)} in run {each.run}',
                'this is a fault of the program: please report it with the stack and the seed')
        row = setup.robot.velocity_names.index(each.name) if each.kind == JUMP else 0
        if each.kind == JUMP and each.value > JUMP_SHARE \
                and not np.isfinite(setup.robot.acceleration[row]):
            # Without a velocity limit the value is that for a limit of one.
            change = f'{each.value:.0%} of its velocity limit' \
                if np.isfinite(setup.robot.velocity[row]) \
                else f'{each.value:.3g} {setup.robot.velocity_units[row]}/s'
            yield Finding(
                DOUBTFUL, 'jump', each.name,
                f'its command changes by {change} in one cycle (run {each.run})',
                'give it an acceleration limit, or raise regularisation')
    if worst and not exceeded:
        yield Finding(FINE, 'limits', '', 'no command exceeded a limit', '')


def about_time(timing: Timing, setup: Setup) -> Iterator[Finding]:
    """Yield the finding about the cycle time on this machine."""
    period = setup.period
    text = f'a cycle takes {1e3 * timing.median:.2g} ms in the median, 99 of 100 at most ' \
           f'{1e3 * timing.percentile_99:.2g} ms, of {1e3 * period:g} ms that there are ' \
           '(processor time of this machine)'
    if timing.median > period:
        severity = WRONG
    elif timing.percentile_99 > BUSY_SHARE * period:
        severity = DOUBTFUL
    else:
        severity = FINE
    yield Finding(severity, 'cycle time', '', text, '' if severity == FINE else
                  'lower the rate, name fewer links in self_collision and obstacles, or use a '
                  'faster machine')


def _causes_text(causes: Sequence[CauseCount]) -> str:
    """Return the most frequent causes as the end of a sentence."""
    named = [f'{cause.text} ({cause.runs})' for cause in causes[:NAMES_PER_FINDING]]
    return f'; otherwise: {", ".join(named)}' if named else ''


def _remedy(setup: Setup, task: TaskResult) -> str:
    """Return the suggested change for the most frequent cause."""
    own = setup.stack.tasks[task.name]
    doubt = gain_remark(own, own.gain, setup.period)
    if doubt:
        return doubt.change
    first = task.causes[0]
    if setup.settings.blend > MAJORITY * setup.seconds:
        return f'lower the setting blend, {setup.settings.blend:g} s, or raise the time of a run'
    if first.kind == STILL_MOVING:
        return 'raise its tolerance, or the time of a run'
    if first.kind == ACCELERATING:
        return 'raise the limits of acceleration and jerk, or the time of a run'
    if task.hint:
        return task.hint
    if first.kind == JOINTS:
        return 'let it use more joints'
    if first.kind in BY_OTHERS:
        return f'see what {first.name or "the others"} leaves it, and send goals that agree'
    if 'position limit' in first.kind:
        return 'a posture in the middle of the ranges, or joint_limit_distance, leaves more ' \
               'joints free'
    return 'raise its tolerance, or the time of a run'


def _count(directions: int) -> str:
    """Return a number of directions in words."""
    return 'a direction' if directions == 1 else f'up to {directions} directions'


def _names(names: Sequence[str]) -> str:
    """Return names as text."""
    return ', '.join(names)

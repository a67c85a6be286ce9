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

"""Findings from the numbers of a check: sentences with suggested changes."""

from collections.abc import Iterator, Sequence
import math

import numpy as np
from tp_controller.control.gains import gain_faults, gain_remark, OVERSHOOT_STEP
from tp_controller.control.reasons import SENTENCES
from tp_controller.tools.check.results import (
    CauseCount,
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


def about_parameters(ignored: Sequence[str]) -> Iterator[Finding]:
    """Yield a finding for each parameter that a node would not know."""
    for name in ignored:
        yield Finding(DOUBTFUL, 'parameter', name, 'no parameter of a controller, nor of a task '
                      'of this stack: a node ignores it', 'correct its name, or leave it out')


def about_robot(setup: Setup) -> Iterator[Finding]:
    """Yield the findings about missing velocity limits, and the remarks of robot and tasks."""
    robot = setup.robot
    for limit, what, change in (
            (math.inf, 'no velocity limit', 'give it one in the description, or by the parameter '
                                            'limits.<joint>.velocity'),
            (0.0, 'the velocity limit is zero, so it does not move',
             'raise it, or leave the joint out of the driven ones')):
        names = [name for name, given in zip(robot.velocity_names, robot.velocity)
                 if given == limit]
        if names:
            yield Finding(DOUBTFUL, 'velocity limit', ', '.join(names), what, change)
    for remark in robot.remarks:
        yield Finding(DOUBTFUL, 'remark', robot.name, remark,
                      'replace them by limits, or correct the description')
    for task in setup.stack.tasks.values():
        for remark in task.remarks:
            yield Finding(DOUBTFUL, 'remark', task.name, remark,
                          'say in the stack that it is meant so, if it is')


def about_levels(levels: Sequence[LevelResult], filling: frozenset[str]) -> Iterator[Finding]:
    """Yield the findings about the rank left to levels; `filling` tasks demand every joint."""
    for level in levels:
        above = _names([task for each in levels if each.number < level.number
                        for task in each.tasks])
        where = f'level {level.number} ({_names(level.tasks)})'
        fills = not filling.isdisjoint(level.tasks)
        if level.never == 1.0 and fills and above:
            yield Finding(
                DOUBTFUL, 'never acts', where,
                f'all directions are taken by {above}: it acts only where some of them are '
                'relaxed near a singularity, or disabled',
                'leave it out, or leave out axes of a task above that need not be exact')
        elif level.never == 1.0:
            yield Finding(
                WRONG, 'never acts', where,
                'it can never act: ' + (f'in none of the samples is a direction left by {above}'
                                        if above else 'the robot can move none of its rows'),
                'put it above them, or leave out axes of theirs' if above
                else 'name another frame, other axes or other joints')
        elif level.never >= MAJORITY:
            yield Finding(
                DOUBTFUL, 'seldom acts', where,
                f'in {level.never:.0%} of the samples no direction is left by {above}',
                'put it above them, or leave out axes of theirs')
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


def about_singularities(setup: Setup, tasks: Sequence[TaskResult]) -> Iterator[Finding]:
    """Yield a finding for each task that is near a singularity in most samples."""
    for task in tasks:
        if task.singular is None or task.smallest is None or task.singular < MAJORITY:
            continue
        if task.singular == 1.0 and task.smallest < POSITION_ROUNDING:
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


def about_bounds(tasks: Sequence[TaskResult], runs: int) -> Iterator[Finding]:
    """Yield the findings about inequality tasks that cannot be satisfied or that dominate."""
    for task in tasks:
        if task.outside is None:
            continue
        if runs and not task.possible:
            yield Finding(
                WRONG, 'bounds', task.name,
                'no configuration was found that satisfies it: the robot did not come '
                f'to within its bounds in any of {runs} runs',
                'widen its bounds, or put it higher')
        elif runs and task.possible < MAJORITY * runs:
            yield Finding(
                DOUBTFUL, 'bounds', task.name,
                f'in {runs - task.possible} of {runs} runs the robot did not come to within its '
                'bounds before it started', 'widen its bounds, or those of others that contradict '
                'them; or put it higher')
        if task.outside > 1.0 - HARDLY_ANY and (task.rows_outside or 0.0) > MAJORITY:
            yield Finding(
                DOUBTFUL, 'bounds dominate', task.name,
                f'{task.outside:.1%} of the samples are outside its bounds', 'widen its bounds')
        elif (task.active_in_loops or 0.0) >= NEARLY_ALL:
            yield Finding(
                DOUBTFUL, 'bounds dominate', task.name,
                f'its bounds are active for {task.active_in_loops:.0%} of the time of the closed '
                'loops', 'widen its bounds')


def about_goals(tasks: Sequence[TaskResult], filling: frozenset[str],
                setup: Setup) -> Iterator[Finding]:
    """Yield a finding on the reached goals of each task; `filling` tasks demand every joint."""
    for task in tasks:
        if not task.possible:
            continue
        found = f'at its goal in {task.reached} of {task.possible} runs' if task.outside is None \
            else f'satisfied in the end of {task.reached} of {task.possible} runs'
        near = f', {task.reached_near} of {task.possible_near} with near goals' \
            if task.reached < task.possible else ''
        if task.median_seconds is not None and task.outside is None:
            near += f', after {task.median_seconds:.1f} s in the median'
        below = bool(task.causes) and task.causes[0].kind in ('task', 'bounds')
        slow = '' if below or task.reached == task.possible else _slow_text(task, setup)
        if not task.reached:
            # A task below others may never be reached by priority, and few runs prove nothing.
            sure = task.possible >= ENOUGH_RUNS and not below and not slow \
                and task.name not in filling
            severity, kind = WRONG if sure else DOUBTFUL, 'never reached'
        elif task.possible_near >= ENOUGH_NEAR_RUNS \
                and task.reached_near < MAJORITY * task.possible_near:
            severity, kind = DOUBTFUL, 'seldom reached'
        else:
            severity, kind = FINE, 'reached'
        change = '' if severity == FINE else \
            'raise its gain, or the time of a run' if slow else _remedy(task, setup)
        yield Finding(severity, kind, task.name,
                      found + near + (slow or _causes_text(task.causes)), change)


def _slow_text(task: TaskResult, setup: Setup) -> str:
    """Return the end of a sentence about a gain too low for the time of a run; mostly empty."""
    if task.gain_period is None:
        return ''
    gain = float(np.min(setup.stack.tasks[task.name].gain))
    if gain * setup.seconds >= DECAY_TIME_CONSTANTS:
        return ''
    return f'; with a gain of {gain:g}/s an error shrinks to a thousandth in ' \
           f'{DECAY_TIME_CONSTANTS / gain:.3g} s, and a run has {setup.seconds:g} s'


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
            yield Finding(
                DOUBTFUL, 'jump', each.name,
                f'its command changes by {each.value:.0%} of its velocity limit in one cycle '
                f'(run {each.run})', 'give it an acceleration limit, or raise regularisation')
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
    named = [f'{_cause(cause)} ({cause.runs})' for cause in causes[:NAMES_PER_FINDING]]
    return f'; otherwise: {", ".join(named)}' if named else ''


def _cause(cause: CauseCount) -> str:
    """Return a cause in words."""
    if cause.kind == STILL_MOVING:
        return 'still on its way'
    return SENTENCES[cause.kind].format(cause.name) if cause.kind else 'several causes together'


def _remedy(task: TaskResult, setup: Setup) -> str:
    """Return the suggested change for the most frequent cause."""
    first = task.causes[0] if task.causes else CauseCount('', '', 0)
    if first.kind in ('task', 'bounds'):
        return f'see what {first.name} leaves it, or put it higher'
    if 'position limit' in first.kind:
        return 'a posture in the middle of the ranges, or joint_limit_distance, leaves more ' \
               'joints free'
    own = setup.stack.tasks[task.name]
    doubt = gain_remark(own, own.gain, setup.period)
    return doubt.change if doubt else 'raise its gain, or the time of a run'


def _count(directions: int) -> str:
    """Return a number of directions in words."""
    return 'a direction' if directions == 1 else f'up to {directions} directions'


def _names(names: Sequence[str]) -> str:
    """Return names as text."""
    return ', '.join(names)

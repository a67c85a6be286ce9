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

"""Hints: changes that bring back a part of what a task misses, tried before they are given."""

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np
from tp_controller.control.causes import (
    ACCELERATING,
    BOUNDS,
    Cause,
    Causes,
    DAMPING,
    IMPOSSIBLE,
    missing,
    NEAR_SINGULAR,
    SINGULARITY,
    TASK,
)
from tp_controller.control.cycle import TRANSITION
from tp_controller.control.error_minimum import SIGNIFICANT_SHARE
from tp_controller.control.gains import gain_remark
from tp_controller.control.joint_limits import LIMITS, VelocityLimit
from tp_controller.control.reasons import CHOOSE_ANOTHER, Combined, is_out_of_reach, listed
from tp_controller.control.variants import Removable
from tp_controller.control.velocity_limits import RESERVE
from tp_controller.model.spatial import Array
from tp_controller.tasks.joint import Joint
from tp_controller.tasks.task import Evaluation, norm

# Share of what is missing that a change has to bring back.
HELPFUL_SHARE = 0.2
# Share of its demand that a task misses at least where advice is of use.
NOTABLE_LOSS = 0.1
# Advice for a posture at which the tasks that block it are at their goals, too.
ANOTHER_WAY = 'the goals are compatible: go there by way of another posture'
# Advice where one joint at a limit stops all.
REDISTRIBUTE = 'set scaling to redistribute'
# Share of a demand below which a task makes no progress that is worth waiting for.
SLOW_SHARE = 0.05
# {kind: suggested change, if there is one}, with placeholders for joints or a task, the plural of
# limits, and the time until the joints have accelerated.
HINTS = {
    **{limit.name: limit.hint for limit in LIMITS},
    RESERVE: 'lower the setting reserve',
    BOUNDS: 'choose a goal that the bounds of {name} allow',
    SINGULARITY: 'move the robot away from the singularity',
    IMPOSSIBLE: 'leave out the axes that the robot cannot move here',
    DAMPING: 'lower the setting damping',
    TRANSITION: 'wait, or lower the setting blend',
    ACCELERATING: 'wait {time} s',
}
# Kinds of causes that disappear by themselves.
PASSING = frozenset((TRANSITION, ACCELERATING))
# Kinds of causes that are limits of a joint and last.
LASTING_LIMITS = frozenset(limit.name for limit in LIMITS if not limit.transient)
# Kinds of causes that a gain too high for the period leads to.
OVERSHOOT_KINDS = frozenset((RESERVE, ACCELERATING, *(
    limit.name for limit in LIMITS if limit.caused_by_gain)))


def hint_of(evaluation: Evaluation, found: Sequence[Cause], combined: Combined,
            causes: Causes) -> str:
    """Return the suggested change for a limited task; see `statements`. Empty if none helps."""
    if is_out_of_reach(evaluation, found, causes):
        return CHOOSE_ANOTHER
    if found and found[0].kind in OVERSHOOT_KINDS and causes.overshoots(evaluation):
        # Higher limits would only increase the overshoot.
        doubt = gain_remark(evaluation.task, evaluation.task.gain, causes.period)
        if doubt:
            return doubt.change
    if causes.loss(evaluation) < NOTABLE_LOSS:
        return ''
    if _redistribution_helps(evaluation, causes):
        return REDISTRIBUTE
    names = combined()
    if len(names) > 1:
        return _for_all(evaluation, names, causes)
    # Where more than the joints' acceleration limits the task, waiting is not enough.
    for cause in sorted(found, key=lambda each: each.kind in PASSING):
        hint = _hint(evaluation, cause, causes)
        if hint:
            return hint
    blocking = [cause.name for cause in found
                if cause.kind == TASK and cause.share >= HELPFUL_SHARE]
    return _for_goals(evaluation, blocking, causes) if blocking else ''


def _for_goals(evaluation: Evaluation, blocking: Sequence[str], causes: Causes) -> str:
    """Return the change of the goals of a task and of others that block it."""
    task = evaluation.task
    if isinstance(task, Joint) and task.every_joint and all(
            causes.is_reached_after(name, evaluation.error) for name in blocking):
        speed = _speed_to_goal(evaluation, causes.variants.lasting.velocity)
        return '' if speed > SLOW_SHARE * norm(evaluation.level.v) else ANOTHER_WAY
    return f'choose goals of {listed([*blocking, task.name])} that are compatible'


def _hint(evaluation: Evaluation, cause: Cause, causes: Causes) -> str:
    """Return the change that a cause suggests; empty if it does not help enough."""
    if cause.kind in LASTING_LIMITS:
        return _for_limits(evaluation, cause.kind, causes)
    if cause.share < HELPFUL_SHARE:
        return ''
    if cause.kind == TASK:
        return _for_task(evaluation, cause.name, causes)
    if cause.kind == IMPOSSIBLE and not _moves_otherwise(evaluation, causes):
        return ''
    time = _one_digit(causes.acceleration_time)
    return HINTS.get(cause.kind, '').format(name=cause.name, s='', time=time)


def _redistribution_helps(evaluation: Evaluation, causes: Causes) -> bool:
    """Return whether a limit that hardly lets the robot move would leave a task more otherwise."""
    variants = causes.variants
    return variants.lasting.slowed <= SLOW_SHARE and variants.redistributed is not None \
        and _helps(evaluation, variants.redistributed, causes)


def _helps(evaluation: Evaluation, velocity: Array, causes: Causes) -> bool:
    """Return whether velocities (n,) bring back enough of what a task misses in the end."""
    now = missing(evaluation.level, causes.variants.lasting.velocity)
    return now - missing(evaluation.level, velocity) >= HELPFUL_SHARE * now


def _for_limits(evaluation: Evaluation, kind: str, causes: Causes) -> str:
    """Return the change of all limits of a kind that matter; empty if it does not help enough."""
    variants, level = causes.variants, evaluation.level
    active: list[Removable] = [
        each for each in causes.active_limits(variants.level_index(evaluation))
        if each.limits[0] == kind]
    free = variants.without(active)
    if not _helps(evaluation, free, causes):
        return ''
    most = missing(level, free) + SIGNIFICANT_SHARE * missing(level, variants.lasting.velocity)
    names = [causes.kind_and_name(each)[1] for each in causes.fewest(level, active, most)]
    change = HINTS[kind].format(name=listed(names), s='s' * (len(names) > 1))
    time = _time_to_goal(evaluation, variants.lasting.velocity)
    if time > min(causes.time_to_position_limit(name) for name in names):
        return change
    return f'wait {_one_digit(time)} s, or {change}' \
        if kind == VelocityLimit.name and math.isfinite(time) else change


def _one_digit(time: float) -> str:
    """Return a time with one digit that counts, as text."""
    return f'{float(f"{time:.0e}"):g}'


def _time_to_goal(evaluation: Evaluation, velocity: Array) -> float:
    """Return the time that a task takes to its goal at this speed [s]; infinite if it stands."""
    level, error = evaluation.level, evaluation.error
    if level.v is None or not error.any():
        return math.inf
    speed = _speed_to_goal(evaluation, velocity)
    return norm(error) / speed if speed > SLOW_SHARE * norm(level.v) else math.inf


def _speed_to_goal(evaluation: Evaluation, velocity: Array) -> float:
    """Return the part along its demand of the velocity of a task that has one [unit/s]."""
    level = evaluation.level
    return float(level.v.dot(level.J.dot(velocity))) / norm(level.v)


def _for_task(evaluation: Evaluation, name: str, causes: Causes) -> str:
    """Return the change of a task that blocks another one; empty if it does not help enough."""
    own = evaluation.task.name
    if causes.shares_level(evaluation, name):
        return f'give {name} and {own} levels of their own'
    if _exchange_helps(evaluation, name, causes):
        return f'exchange {name} and {own} in the stack, or choose goals that are compatible'
    return ''


def _moves_otherwise(evaluation: Evaluation, causes: Causes) -> bool:
    """Return whether a task that lacks much moves well along the axes that it can move along."""
    level, lasting = evaluation.level, causes.variants.lasting
    its = lasting.directions_alone(level, NEAR_SINGULAR)
    if its is None or level.v is None \
            or missing(level, lasting.velocity) < HELPFUL_SHARE * norm(level.v):
        return False
    kept = its.U.dot(its.U.T)
    reduced = replace(level, J=kept.dot(level.J), v=kept.dot(level.v))
    velocity = causes.variants.with_level(evaluation, reduced)
    return missing(reduced, velocity) <= (1.0 - HELPFUL_SHARE) * norm(reduced.v)


def _exchange_helps(evaluation: Evaluation, name: str, causes: Causes) -> bool:
    """Return whether a task gains enough by an exchange, and leaves a motion to the other one."""
    variants = causes.variants
    after = variants.exchanged(evaluation, variants.evaluation(name))
    return after is not None and _leaves_joints(evaluation) \
        and _helps(evaluation, after, causes)


def _leaves_joints(evaluation: Evaluation) -> bool:
    """Return whether a task would leave a motion of the joints to tasks below it."""
    return bool(np.linalg.matrix_rank(evaluation.level.J) < evaluation.level.J.shape[1])


def _for_all(evaluation: Evaluation, blocking: Sequence[tuple[str, str]], causes: Causes) -> str:
    """Return the changes of all that blocks a task together."""
    own, changes = evaluation.task.name, []
    tasks = [name for kind, name in blocking if kind == TASK]
    if tasks:
        changes.append(f'put {own} above {listed(tasks)}' if _leaves_joints(evaluation) else
                       _for_goals(evaluation, tasks, causes))
    for kind in dict.fromkeys(kind for kind, _ in blocking if kind != TASK):
        names = [name for each, name in blocking if each == kind]
        changes.append(HINTS[kind].format(name=listed(names), s='s' * (len(names) > 1)))
    return ', and '.join(filter(None, changes))

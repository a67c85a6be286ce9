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

"""Causes in words: the sentences that the report has for a task."""

from collections.abc import Sequence

import numpy as np
from tp_controller.control.causes import (
    BOUNDS,
    Cause,
    Causes,
    DAMPING,
    IMPOSSIBLE,
    RESERVE,
    SINGULARITY,
    TASK,
    TRANSITION,
)
from tp_controller.control.gains import gain_remark
from tp_controller.control.units import with_unit
from tp_controller.control.velocity_limits import ACCELERATION, LOWER, UPPER, VELOCITY
from tp_controller.tasks.bounded import out_of_reach, STILL
from tp_controller.tasks.task import Evaluation

# How many causes a sentence names.
NAMED = 3
# {kind: what it says, with the name of the joint or task}
SENTENCES = {
    VELOCITY: '{} at its velocity limit',
    LOWER: '{} at its lower position limit',
    UPPER: '{} at its upper position limit',
    ACCELERATION: '{} at its acceleration limit',
    RESERVE: '{} at its velocity limit minus the reserve for the first level',
    TASK: 'blocked by {}',
    BOUNDS: 'blocked by the bounds of {}',
    SINGULARITY: 'near a singularity',
    IMPOSSIBLE: 'the robot cannot move in this direction here',
    DAMPING: 'slowed by damping',
    TRANSITION: 'a change is still being blended in',
}
# {kind: what helps}; {own} is the task that is limited.
HINTS = {
    VELOCITY: 'raise the velocity limit of {name}, or give {own} a smaller gain',
    LOWER: 'choose a goal, or an arm posture, farther from the lower position limit of {name}',
    UPPER: 'choose a goal, or an arm posture, farther from the upper position limit of {name}',
    ACCELERATION: 'wait, or raise the acceleration limit of {name}',
    RESERVE: 'lower the setting reserve',
    TASK: 'exchange {name} and {own} in the stack, or choose goals that are compatible',
    BOUNDS: 'choose a goal that the bounds of {name} allow',
    SINGULARITY: 'move the robot away from the singularity',
    IMPOSSIBLE: 'leave out the axes that the robot cannot move here',
    DAMPING: 'lower the setting damping',
    TRANSITION: 'wait, or lower the setting blend',
}
OUT_OF_REACH = 'out of reach'
CHOOSE_ANOTHER = 'the goal is out of reach: choose another one'
# What a gain that is too high for the period runs into.
OVERSHOT = frozenset((VELOCITY, ACCELERATION, RESERVE))
ELSEWHERE = frozenset((SINGULARITY, IMPOSSIBLE, DAMPING))


def reason_of(evaluation: Evaluation, errors: Sequence[tuple[float, str, float]],
              found: Sequence[Cause], causes: Causes) -> str:
    """
    Return what limits a task, in a sentence; empty where nothing does.

    Parameters
    ----------
    evaluation : Evaluation
        Of the task.
    errors : sequence of (float, str, float)
        Norm of the error, its unit and the tolerance, for each unit.
    found : sequence of Cause
        The largest share first.
    causes : Causes
        What found them.

    """
    sentences = [_stuck(evaluation)]
    if causes.is_limited(evaluation):
        if is_out_of_reach(evaluation, found, causes):
            distance = ', '.join(with_unit(f'{value:.2g}', unit)
                                 for value, unit, tolerance in errors if value > tolerance)
            sentences.append(f'{OUT_OF_REACH} by {distance}')
        else:
            sentences.extend(_sentence(cause, evaluation, causes) for cause in found[:NAMED])
            if not found:
                names = causes.together(evaluation)
                sentences.append(_together(names) if names or causes.instead != TRANSITION
                                 else SENTENCES[TRANSITION])
        if causes.instead != TRANSITION:
            sentences.append(causes.instead)
    return '; '.join(filter(None, sentences))


def hint_of(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> str:
    """Return what would help a task that is limited; see `reason_of`."""
    if is_out_of_reach(evaluation, found, causes):
        return CHOOSE_ANOTHER
    task = evaluation.task
    if not found or found[0].kind in OVERSHOT:
        # Higher limits would only make it worse.
        doubt = gain_remark(task, task.gain, causes.period)
        if doubt:
            return doubt.change
    if not found:
        return ''
    first = found[0]
    if first.kind == TASK and causes.share_a_level(evaluation, first.name):
        return f'give {first.name} and {task.name} levels of their own'
    return HINTS[first.kind].format(name=first.name, own=task.name)


def limit_text(kind: str, joint: str) -> str:
    """Return which limit a joint is at."""
    return SENTENCES[kind].format(joint)


def is_out_of_reach(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> bool:
    """
    Say whether nothing but the goal itself limits a task.

    Then its error does not shrink any more, and no limit, task or transition is the reason.
    """
    return all(cause.kind in ELSEWHERE for cause in found) and causes.is_out_of_reach(evaluation)


def _sentence(cause: Cause, evaluation: Evaluation, causes: Causes) -> str:
    """Return one cause in words, with the rows of a task that has several."""
    rows = causes.rows_in_the_way(evaluation, cause.name) if cause.kind == BOUNDS else []
    return SENTENCES[cause.kind].format(cause.name) + (f' ({", ".join(rows[:NAMED])})' if rows
                                                       else '')


def _together(causes: Sequence[tuple[str, str]]) -> str:
    """Return the sentence for causes that each suffice, so that none of them is one alone."""
    names = [name if kind in (TASK, BOUNDS) else f'the {kind} of {name}' for kind, name in causes]
    if not names:
        return 'blocked by several causes together'
    if len(names) == 1:
        return f'blocked by {names[0]}'
    return f'blocked by {", ".join(names[:-1])} and {names[-1]} together'


def _stuck(evaluation: Evaluation) -> str:
    """Return what no joint can bring back to within its bounds, as text; mostly nothing."""
    error, J, names = evaluation.error, evaluation.level.J, evaluation.row_names
    if not evaluation.task.bounded or not error.any():
        return ''
    moved = np.sqrt((J * J).sum(axis=1))
    still = np.flatnonzero((moved < STILL) & (out_of_reach(error, moved) > 0.0)).tolist()
    if not still:
        return ''
    which = list(dict.fromkeys(names[row] for row in still))[:NAMED] if names else ['it']
    return f'no joint can move {", ".join(which)} back within bounds'

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

"""Texts of causes: the sentences of a report about a task."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tp_controller.control.causes import (
    BOUNDS,
    Cause,
    Causes,
    DAMPING,
    IMPOSSIBLE,
    SINGULARITY,
    TASK,
)
from tp_controller.control.cycle import TRANSITION
from tp_controller.control.gains import gain_remark
from tp_controller.control.joint_limits import LIMITS
from tp_controller.control.units import with_unit
from tp_controller.control.velocity_limits import RESERVE
from tp_controller.tasks.bounded import out_of_reach, STILL
from tp_controller.tasks.task import Evaluation

# Largest number of causes or rows that a reason names.
NAMES_PER_REASON = 3
# Share from which a cause alone is a reason.
NOTABLE_SHARE = 0.1
# Kinds of causes that are limits of a joint.
LIMIT_KINDS = frozenset(limit.name for limit in LIMITS)
# {kind: sentence, with a placeholder for the joint or task}
SENTENCES = {
    **{limit.name: limit.sentence for limit in LIMITS},
    RESERVE: '{} at its velocity limit minus the reserve for the first level',
    TASK: 'blocked by {}',
    BOUNDS: 'blocked by the bounds of {}',
    SINGULARITY: 'near a singularity',
    IMPOSSIBLE: 'the robot cannot move in this direction here',
    DAMPING: 'slowed by damping',
    TRANSITION: 'a change is still being blended in',
}
# {kind: suggested change}; {own} is the limited task.
HINTS = {
    **{limit.name: limit.hint for limit in LIMITS},
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
# Kinds of causes that a gain too high for the period leads to.
OVERSHOOT_KINDS = frozenset((RESERVE, *(limit.name for limit in LIMITS if limit.caused_by_gain)))
# Kinds of causes that a goal out of reach leads to.
UNREACHABLE_KINDS = frozenset((SINGULARITY, IMPOSSIBLE, DAMPING))


class Statement(NamedTuple):
    """Part of a reason: a sentence, and a phrase without numbers for each cause that it names."""

    sentence: str
    phrases: tuple[str, ...]


def statements(evaluation: Evaluation, errors: Sequence[tuple[float, str, float]],
               found: Sequence[Cause], causes: Causes) -> Iterator[Statement]:
    """
    Yield the parts of the reason why a task is limited; none if it is not.

    Causes beyond the largest `NAMES_PER_REASON`, and those below `NOTABLE_SHARE`, have a phrase,
    but no sentence, unless there are no others.

    Parameters
    ----------
    evaluation : Evaluation
        Evaluation of the task.
    errors : sequence of (float, str, float)
        Norm of the error, its unit and the tolerance, for each unit.
    found : sequence of Cause
        Causes, the largest share first.
    causes : Causes
        The search that found them.

    """
    immovable = _immovable_rows(evaluation)
    if immovable:
        yield Statement(immovable, (immovable,))
    if not causes.is_limited(evaluation):
        return
    if is_out_of_reach(evaluation, found, causes):
        distance = ', '.join(with_unit(f'{value:.2g}', unit)
                             for value, unit, tolerance in errors if value > tolerance)
        yield Statement(f'{OUT_OF_REACH} by {distance}', (OUT_OF_REACH,))
    elif found:
        sentences = _sentences(evaluation, found, causes)
        for index, cause in enumerate(found):
            yield Statement(sentences[index] if index < len(sentences) else '',
                            (phrase(cause.kind, cause.name),))
    else:
        names = causes.combined_causes(evaluation)
        sentence = _combined(names) if names or causes.override != TRANSITION \
            else SENTENCES[TRANSITION]
        yield Statement(sentence, tuple(phrase(*each) for each in names) or (sentence,))
    if causes.override not in ('', TRANSITION):
        yield Statement(causes.override, (causes.override,))


def hint_of(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> str:
    """Return the suggested change for a limited task; see `statements`."""
    if is_out_of_reach(evaluation, found, causes):
        return CHOOSE_ANOTHER
    task = evaluation.task
    if not found or found[0].kind in OVERSHOOT_KINDS:
        # Higher limits would only increase the overshoot.
        doubt = gain_remark(task, task.gain, causes.period)
        if doubt:
            return doubt.change
    if not found:
        return ''
    first = found[0]
    if first.kind == TASK and causes.shares_level(evaluation, first.name):
        return f'give {first.name} and {task.name} levels of their own'
    return HINTS[first.kind].format(name=first.name, own=task.name)


def phrase(kind: str, name: str) -> str:
    """Return the phrase for a cause alone, such as the active limit of a joint."""
    return SENTENCES[kind].format(name)


def is_out_of_reach(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> bool:
    """
    Return whether only the goal itself limits a task.

    In this case its error has stopped decreasing, and no limit, task or transition is a cause.
    """
    return all(cause.kind in UNREACHABLE_KINDS for cause in found) \
        and causes.is_out_of_reach(evaluation)


def _sentences(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> list[str]:
    """Return the sentences for the largest causes; one for limits of a kind that are all small."""
    largest = found[0]
    alike = [cause.name for cause in found if cause.kind == largest.kind]
    if largest.share < NOTABLE_SHARE and largest.kind in LIMIT_KINDS and len(alike) > 1:
        return [_at_limits(largest.kind, alike)]
    least = min(NOTABLE_SHARE, largest.share)
    return [_sentence(cause, evaluation, causes) for cause in found[:NAMES_PER_REASON]
            if cause.share >= least]


def _sentence(cause: Cause, evaluation: Evaluation, causes: Causes) -> str:
    """Return the sentence for a cause, with the blocking rows of a task that has several."""
    rows = causes.blocking_rows(evaluation, cause.name) if cause.kind == BOUNDS else []
    named = f' ({", ".join(rows[:NAMES_PER_REASON])})' if rows else ''
    return phrase(cause.kind, cause.name) + named


def _combined(causes: Sequence[tuple[str, str]]) -> str:
    """Return the sentence for causes that each suffice to block a task."""
    names = [name if kind in (TASK, BOUNDS) else f'the {kind} of {name}' for kind, name in causes]
    if not names:
        return 'blocked by several causes together'
    if len(names) == 1:
        return f'blocked by {names[0]}'
    kinds = Counter([kind for kind, _ in causes[NAMES_PER_REASON:]])
    more = [f'{count} more {kind if count == 1 or kind == BOUNDS else kind + "s"}'
            for kind, count in kinds.items()]
    return f'blocked by {_enumerated([*names[:NAMES_PER_REASON], *more])} together'


def _at_limits(kind: str, joints: Sequence[str]) -> str:
    """Return the sentence for joints at limits of a kind."""
    # Their shares are much alike: in the order of the largest they would change places.
    names, more = sorted(joints), len(joints) - NAMES_PER_REASON
    text = _enumerated([*names[:NAMES_PER_REASON], *([f'{more} more'] if more > 0 else [])])
    return f'{text} at their {kind}s'


def _enumerated(names: Sequence[str]) -> str:
    """Return names as text, with commas and "and"."""
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'


def _immovable_rows(evaluation: Evaluation) -> str:
    """Return a text about violated rows that no joint can move back; mostly empty."""
    error, J, names = evaluation.error, evaluation.level.J, evaluation.row_names
    if not evaluation.task.bounded or not error.any():
        return ''
    moved = np.sqrt((J * J).sum(axis=1))
    still = np.flatnonzero((moved < STILL) & (out_of_reach(error, moved) > 0.0)).tolist()
    if not still:
        return ''
    rows = list(dict.fromkeys(names[row] for row in still)) if names else ['it']
    return f'no joint can move {", ".join(rows[:NAMES_PER_REASON])} back within bounds'

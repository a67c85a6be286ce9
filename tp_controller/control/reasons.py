# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Texts of causes: the sentences of a report about a task."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from tp_controller.control.causes import (
    ACCELERATING,
    BOUNDS,
    Cause,
    Causes,
    CURVED,
    DAMPING,
    IMPOSSIBLE,
    JOINTS,
    LOCK,
    NOTABLE_SHARE,
    SINGULARITY,
    TASK,
)
from tp_controller.control.cycle import TRANSITION
from tp_controller.control.units import with_unit
from tp_controller.control.velocity_limits import LIMITS, RESERVE
from tp_controller.model.robot import Robot
from tp_controller.solver.level import Mask
from tp_controller.tasks.bounded import out_of_reach, STILL
from tp_controller.tasks.task import Evaluation

# Largest number of causes or rows that a reason names.
NAMES_PER_REASON = 3
# Sum of the shares of such causes from which no others are looked for.
SUFFICIENT_SHARE = 0.5
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
    LOCK: '{} is locked',
    DAMPING: 'slowed by damping',
    CURVED: 'damped so that it does not oscillate',
    ACCELERATING: 'accelerating',
    JOINTS: '{} uses some joints only',
    TRANSITION: 'a change is still being blended in',
}
SEVERAL = 'blocked by several causes together'
OUT_OF_REACH = 'out of reach'
CHOOSE_ANOTHER = 'the goal is out of reach: choose another one'
# Kinds of causes that a goal out of reach leads to.
UNREACHABLE_KINDS = frozenset((SINGULARITY, IMPOSSIBLE, DAMPING, CURVED))


# Returns (kind, name) of what limits a task together; empty if a cause alone is a reason.
Combined: TypeAlias = Callable[[], Sequence[tuple[str, str]]]


class Statement(NamedTuple):
    """Part of a reason: a sentence, and a phrase without numbers for each cause that it names."""

    sentence: str
    phrases: tuple[str, ...]


def statements(evaluation: Evaluation, errors: Sequence[tuple[float, str, float]],
               found: Sequence[Cause], combined: Combined, causes: Causes) -> Iterator[Statement]:
    """
    Yield the parts of the reason why a task is limited; none if it is not.

    Causes beyond the largest `NAMES_PER_REASON`, and those below `NOTABLE_SHARE`, have a phrase,
    but no sentence, unless there are no others and nothing limits the task together.

    Parameters
    ----------
    evaluation : Evaluation
        Evaluation of the task.
    errors : sequence of (float, str, float)
        Norm of the error, its unit and the tolerance, for each unit.
    found : sequence of Cause
        Causes, the largest share first.
    combined : callable
        See `Combined`.
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
    else:
        yield from _limiting(evaluation, found, combined(), causes)
    if causes.override not in ('', TRANSITION):
        yield Statement(causes.override, (causes.override,))


def phrase(kind: str, name: str) -> str:
    """Return the phrase for a cause alone, such as the active limit of a joint."""
    return SENTENCES[kind].format(name).strip()


def suffice(found: Sequence[Cause]) -> bool:
    """Return whether causes are the reason even if others limit the task more together."""
    # Joints that are fast enough for a singularity are no remedy.
    return any(cause.kind == SINGULARITY for cause in found) or sum(
        cause.share for cause in found if cause.share >= NOTABLE_SHARE) >= SUFFICIENT_SHARE


def is_out_of_reach(evaluation: Evaluation, found: Sequence[Cause], causes: Causes) -> bool:
    """
    Return whether only the goal itself limits a task.

    In this case its error has stopped decreasing, and no limit, task or transition is a cause.
    """
    return all(cause.kind in UNREACHABLE_KINDS for cause in found) \
        and causes.is_out_of_reach(evaluation)


def _limiting(evaluation: Evaluation, found: Sequence[Cause],
              together: Sequence[tuple[str, str]], causes: Causes) -> Iterator[Statement]:
    """Yield the statements about causes that limit a task, together and alone."""
    # Limits and bounds that act only once the others are gone limit nothing now.
    together = [each for each in together if causes.acts(evaluation, *each)] or together
    if together:
        yield Statement(_combined(together, causes), tuple([phrase(*each) for each in together]))
    alone = [cause for cause in found if (cause.kind, cause.name) not in together]
    least = min(NOTABLE_SHARE, found[0].share) if found and not together else NOTABLE_SHARE
    named = [cause for cause in alone[:NAMES_PER_REASON] if cause.share >= least]
    known = {*together, *[(cause.kind, cause.name) for cause in named]}
    # The limit that slows all has hardly a share if the next one is almost as low.
    named += [Cause(*each, 0.0) for each in causes.slowing_limits[:1] if each not in known]
    for cause in named:
        yield Statement(_sentence(cause, evaluation, causes), (phrase(cause.kind, cause.name),))
    for cause in alone:
        if cause not in named:
            yield Statement('', (phrase(cause.kind, cause.name),))
    if not together and not named:
        sentence = SENTENCES[TRANSITION] if causes.override == TRANSITION else SEVERAL
        yield Statement(sentence, (sentence,))


def _sentence(cause: Cause, evaluation: Evaluation, causes: Causes) -> str:
    """Return the sentence for a cause, with what it does not say by itself."""
    rows = causes.blocking_rows(evaluation, cause.name) if cause.kind == BOUNDS else []
    remark = f' ({", ".join(rows[:NAMES_PER_REASON])})' if rows else ''
    joints = evaluation.level.joints
    if cause.kind == JOINTS and not cause.name and joints is not None:
        return _joints_of(evaluation.task.robot, joints)
    if cause.kind in LIMIT_KINDS and causes.slows_all:
        remark = ', which slows all tasks'
    return _alone(cause.kind, cause.name, causes) + remark


def _joints_of(robot: Robot, joints: Mask) -> str:
    """Return the sentence for the joints (n,) that a task may move."""
    used = [robot.velocity_names[joint] for joint in np.flatnonzero(joints)]
    others = [name for name in robot.velocity_names if name not in used]
    chosen, verb, end = (used, 'uses', ' only') if len(used) <= len(others) \
        else (others, 'does not use', '')
    group = next((name for name, names in robot.groups.items() if set(names) == set(chosen)), '')
    return f'{verb} {group or listed(chosen)}{end}'


def _alone(kind: str, name: str, causes: Causes) -> str:
    """Return the sentence for one cause."""
    if kind in LIMIT_KINDS and not any(causes.reaches(kind, name)):
        # It limits a level, and the levels below lead the joint away from it.
        return f'limited by the {kind} of {name}'
    return phrase(kind, name + _soon([(kind, name)], causes))


def _soon(limits: Sequence[tuple[str, str]], causes: Causes) -> str:
    """Return a word for limits that the joints are about to reach; mostly empty."""
    return ' soon' * any(kind in LIMIT_KINDS and causes.reaches(kind, name) == (False, True)
                         for kind, name in limits)


def _combined(found: Sequence[tuple[str, str]], causes: Causes) -> str:
    """Return the sentence for causes that limit a task together."""
    if len(found) == 1:
        return _alone(*found[0], causes)
    kind = found[0][0]
    if kind in LIMIT_KINDS and all(other == kind for other, _ in found):
        # Their shares are much alike: in the order of the largest they would change places.
        several = listed(sorted(name for _, name in found))
        return f'{several}{_soon(found, causes)} at their {kind}s'
    names = [name if kind == TASK else f'the {kind} of {name}' for kind, name in found]
    named = {kind for kind, _ in found[:NAMES_PER_REASON]}
    kinds = Counter([kind for kind, _ in found[NAMES_PER_REASON:]])
    more = [f'{count} {"more " if kind in named else ""}'
            f'{kind if count == 1 or kind == BOUNDS else kind + "s"}'
            for kind, count in kinds.items()]
    return f'blocked by {_enumerated([*names[:NAMES_PER_REASON], *more])} together'


def listed(names: Sequence[str]) -> str:
    """Return names as text, the first `NAMES_PER_REASON` of many and the number of others."""
    more = len(names) - NAMES_PER_REASON
    if more <= 1:
        return _enumerated(names)
    return _enumerated([*names[:NAMES_PER_REASON], f'{more} more'])


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

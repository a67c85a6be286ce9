# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Hints: changes that help a task later, each tried by a roll-out before it is given."""

from collections.abc import Iterator, Sequence
import math
from typing import NamedTuple

import numpy as np
from tp_controller.control.causes import (
    ACCELERATING,
    BOUNDS,
    Cause,
    Causes,
    CURVED,
    DAMPING,
    IMMOVABLE,
    IMPOSSIBLE,
    JOINTS,
    LOCK,
    missing,
    NOTABLE_SHARE,
    SINGULARITY,
    TASK,
)
from tp_controller.control.gains import DELAY_SAFE_STEP, gain_remark
from tp_controller.control.joint_limits import JointLimit, VelocityLimit
from tp_controller.control.reasons import CHOOSE_ANOTHER, Combined, is_out_of_reach, listed
from tp_controller.control.roll_out import Course, RollOuts
from tp_controller.control.trial_setup import Setup
from tp_controller.control.variants import Removable
from tp_controller.control.velocity_limits import LIMITS, RESERVE
from tp_controller.tasks.task import Evaluation

# Share of the error, or of the time until a task arrives, that a change has to take away.
HELPFUL_SHARE = 0.2
# Share of its demand that a task misses at least where advice is of use.
NOTABLE_LOSS = 0.1
# End of the hint to wait where most of the error goes by itself.
LESSENS = 'until most of its error is gone'
# Factor of settings that are lowered.
LOWERED = 0.1
REDISTRIBUTE = 'set scaling to redistribute'
# {kind: suggested change, if there is one}, with placeholders for joints or a task, and the plural
# of limits.
HINTS = {
    **{limit.name: limit.hint for limit in LIMITS},
    RESERVE: 'lower the setting reserve',
    BOUNDS: 'choose a goal that the bounds of {name} allow',
    SINGULARITY: 'begin at another arm posture, away from the singularity',
    LOCK: 'unlock {name}',
    DAMPING: 'lower the setting damping',
}
# {kind: limit}, of those that last.
LASTING_LIMITS = {limit.name: limit for limit in LIMITS if not limit.transient}
# Kinds of causes that a gain too high for the period leads to.
OVERSHOOT_KINDS = frozenset((RESERVE, ACCELERATING, *(
    limit.name for limit in LIMITS if limit.caused_by_gain)))


class Proposal(NamedTuple):
    """
    Change that may help a task.

    Attributes
    ----------
    text : str
        The change, as a sentence.
    setup : Setup
        Setup with the change.
    named : sequence of str
        Tasks at whose cost it may help.
    alternative : str
        Another change in its place, as the end of the sentence; mostly empty.

    """

    text: str
    setup: Setup
    named: Sequence[str] = ()
    alternative: str = ''


def hint_of(evaluation: Evaluation, found: Sequence[Cause], combined: Combined,
            causes: Causes, roll_outs: RollOuts) -> str:
    """Return the suggested change for a limited task; see `statements`. Empty if none helps."""
    if found and found[0].kind in OVERSHOOT_KINDS and causes.overshoots(evaluation):
        # Higher limits would only increase the overshoot.
        doubt = gain_remark(evaluation.task, evaluation.task.gain, causes.period)
        if doubt:
            return doubt.change
    if causes.loss(evaluation) < NOTABLE_LOSS or roll_outs.unchanged is None:
        return ''
    return _Adviser(evaluation, found, combined, causes, roll_outs, roll_outs.unchanged).hint()


class _Adviser:
    """Search for a change that helps a task; see `hint_of`."""

    def __init__(self, evaluation: Evaluation, found: Sequence[Cause], combined: Combined,
                 causes: Causes, roll_outs: RollOuts, usual: Course) -> None:
        self._evaluation, self._found, self._combined = evaluation, found, combined
        self._causes, self._roll_outs, self._setup = causes, roll_outs, roll_outs.setup
        self._own, self._usual = evaluation.task.name, usual
        # With their setups, so that the identities of these stay theirs.
        self._courses: dict[int, tuple[Setup, Course | None]] = {}

    def hint(self) -> str:
        """Return the time until the task arrives by itself, and the first change that helps."""
        wait = self._wait()
        if not wait and is_out_of_reach(self._evaluation, self._found, self._causes):
            return CHOOSE_ANOTHER
        proposals = self._limits(VelocityLimit) if wait else self._proposals()
        change = next((self._with_cost(each) for each in proposals if self._helps(each)), '')
        return ', or '.join(filter(None, (wait, change)))

    def _wait(self) -> str:
        """Return the time until the task arrives by itself, or misses little; else empty."""
        usual, task = self._usual, self._evaluation.task
        time = usual.arrivals.get(self._own, math.inf)
        if math.isfinite(time):
            return f'wait {_seconds(time)}' \
                + ' until it arrives' * (task.has_position and not task.bounded)
        time = usual.time_to(self._own, HELPFUL_SHARE)
        return f'wait {_seconds(time)} {LESSENS}' if math.isfinite(time) else ''

    def _with_cost(self, proposal: Proposal) -> str:
        """Return the text of a proposal, and which tasks miss their goals all the same."""
        costs = ', '.join(self._costs(proposal))
        return proposal.text + f' ({costs})' * bool(costs) + proposal.alternative

    def _costs(self, proposal: Proposal) -> list[str]:
        """Return clauses about tasks that miss their goals all the same; [] where goals change."""
        course, named, tasks = self._course(proposal.setup), proposal.named, proposal.setup.tasks
        if course is None or any(tasks.get(name) is not self._setup.tasks[name]
                                 for name in named):
            return []
        worse = [name for name in named if name not in course.arrivals
                 and self._usual.gains(name, course, HELPFUL_SHARE)]
        later = [] if worse else [name for name in named if self._usual.arrives([name])
                                  and not course.arrives([name])]
        costs = []
        if self._own not in course.arrivals:
            its = 'bounds' if self._evaluation.task.bounded else 'goal'
            costs.append(f'{self._own} then misses its {its} by less')
        if worse or later:
            one, then = len(worse or later) == 1, '' if costs else 'then '
            verb = ('misses its goal' if one else 'miss their goals') if worse \
                else 'arrives later' if one else 'arrive later'
            costs.append(f'{listed(worse or later)} {then}{verb}')
        return costs

    def _course(self, setup: Setup) -> Course | None:
        """Return the course of the robot with a setup; see `RollOuts.course`."""
        if id(setup) not in self._courses:
            self._courses[id(setup)] = setup, self._roll_outs.course(setup)
        return self._courses[id(setup)][1]

    def _helps(self, proposal: Proposal) -> bool:
        """Return whether a change helps enough, and makes no other task above worse."""
        usual, course = self._usual, self._course(proposal.setup)
        if course is None:
            return False
        names = list(self._setup.tasks)
        above = [name for name in names[:names.index(self._own)] if name not in proposal.named]
        return course.gains(self._own, usual, HELPFUL_SHARE) and not any(
            usual.gains(name, course, HELPFUL_SHARE) for name in above
            if name not in course.arrivals)

    def _proposals(self) -> Iterator[Proposal]:
        """Yield changes that may help, the most promising ones first."""
        if self._causes.slows_all:
            yield Proposal(REDISTRIBUTE, self._setup.with_settings(scaling='redistribute'))
        together = self._combined()
        if len(together) > 1:
            tasks = [each for each in together if each[0] == TASK]
            if len(tasks) < len(together):
                yield from self._together(tasks)
            yield from self._together(together)
        for cause in self._found:
            if cause.share >= min(NOTABLE_SHARE, self._found[0].share):
                yield from self._for_cause(cause)
        blocking = [name for kind, name in (*together, *[each[:2] for each in self._found])
                    if kind == TASK]
        if blocking:
            yield from self._by_goals(list(dict.fromkeys(blocking)))

    def _for_cause(self, cause: Cause) -> Iterator[Proposal]:
        """Yield changes that a cause suggests."""
        kind, setup = cause.kind, self._setup
        text = HINTS.get(kind, '').format(name=cause.name, s='')
        if kind in LASTING_LIMITS:
            yield from self._limits(LASTING_LIMITS[kind])
        elif kind == TASK and self._leaves_joints:
            yield self._exchange(cause.name)
        elif kind == BOUNDS:
            yield Proposal(text, setup.without(cause.name), (cause.name,))
        elif kind in (DAMPING, RESERVE):
            yield Proposal(text, setup.with_settings(
                **{kind: LOWERED * getattr(setup.settings, kind)}))
        elif kind == LOCK:
            yield Proposal(text, setup.unlocked([cause.name]))
        elif kind == SINGULARITY:
            yield Proposal(text, setup.in_middle(setup.robot.joint_names))
        elif kind == IMPOSSIBLE:
            yield from self._without_axes()
        elif kind == JOINTS:
            name = cause.name or self._own
            yield Proposal(f'let {name} use all joints', setup.with_all_joints(name))
        elif kind == CURVED:
            yield from self._lower_gain()

    def _limits(self, limit: type[JointLimit]) -> Iterator[Proposal]:
        """Yield changes of all active limits of a kind that matter."""
        causes, variants = self._causes, self._causes.variants
        level = self._evaluation.level
        active: list[Removable] = [
            each for each in causes.active_limits(variants.level_index(self._evaluation))
            if each.limits[0] == limit.name]
        most = missing(level, variants.without(active)) \
            + NOTABLE_SHARE * missing(level, variants.lasting.velocity)
        names = [causes.kind_and_name(each)[1] for each in causes.fewest(level, active, most)]
        if not names:
            return
        text = _text(limit.name, names)
        if limit is not VelocityLimit:
            yield Proposal(text.replace('choose a goal', 'begin at an arm posture'),
                           self._setup.in_middle(names))
        yield Proposal(text, self._setup.without_limits(limit.key, names))

    def _exchange(self, name: str) -> Proposal:
        """Return the exchange with a task that blocks this one, or goals that fit together."""
        own, setup = self._own, self._setup
        if self._causes.shares_level(self._evaluation, name):
            return Proposal(f'give {name} and {own} levels of their own, {own} first',
                            setup.above(own, [name]), (name,))
        proposal = Proposal(f'exchange {name} and {own} in the stack', setup.exchanged(own, name),
                            (name,))
        course = self._course(proposal.setup)
        if course is not None and not course.arrives((own, name)) and self._helps(proposal) \
                and self._helps(self._fitting_goals(course, [name])):
            return proposal._replace(alternative=', or choose goals that are compatible')
        return proposal

    def _by_goals(self, blocking: Sequence[str]) -> Iterator[Proposal]:
        """Yield changes of the goals of tasks that block this one."""
        own, setup = self._own, self._setup
        first = setup.above(own, blocking)
        course = self._course(first)
        if course is None:
            return
        before, after = list(setup.tasks), list(first.tasks)
        passed = [name for name in before[:before.index(own)] if name not in blocking
                  and after.index(name) > after.index(own) and not setup.tasks[name].bounded]
        if course.arrives((own, *blocking, *passed)):
            yield Proposal(f'put {own} above {listed(blocking)} until all are there: their '
                           'goals are compatible', first, blocking)
        else:
            left = [name for name in passed if not course.arrives([name])]
            yield self._fitting_goals(course, [*blocking, *left])

    def _fitting_goals(self, course: Course, blocking: Sequence[str]) -> Proposal:
        """Return the proposal to set the goals of tasks where they end up in a course."""
        return Proposal(
            f'choose goals of {listed([*blocking, self._own])} that are compatible',
            self._setup.with_goals_at(course.q, self._roll_outs.passive, blocking), blocking)

    def _together(self, causes: Sequence[tuple[str, str]]) -> Iterator[Proposal]:
        """Yield the change of all that blocks the task together, if it can be changed."""
        own, setup, texts = self._own, self._setup, []
        tasks = [name for kind, name in causes if kind == TASK]
        if tasks and self._leaves_joints:
            texts.append(f'put {own} above {listed(tasks)}')
            setup = setup.above(own, tasks)
        for kind in dict.fromkeys(kind for kind, _ in causes if kind != TASK):
            names = [name for each, name in causes if each == kind]
            texts.append(_text(kind, names))
            if kind in LASTING_LIMITS:
                setup = setup.without_limits(LASTING_LIMITS[kind].key, names)
            elif kind == LOCK:
                setup = setup.unlocked(names)
            elif kind == BOUNDS:
                for name in names:
                    setup = setup.without(name)
            else:
                setup = setup.with_settings(reserve=LOWERED * setup.settings.reserve)
        if texts:
            yield Proposal(', and '.join(texts), setup, tasks)

    def _lower_gain(self) -> Iterator[Proposal]:
        """Yield a lower gain of the task, if its gain is doubtful."""
        task, period = self._evaluation.task, self._causes.period
        doubt = gain_remark(task, task.gain, period)
        if doubt:
            yield Proposal(doubt.change, self._setup.with_gain(
                self._own, DELAY_SAFE_STEP / period))

    def _without_axes(self) -> Iterator[Proposal]:
        """Yield the task without its axes that the robot cannot move, if these are all."""
        task, its = self._evaluation.task, self._causes.movable(self._evaluation.level)
        names = getattr(task, 'axes', ())
        if its is None or len(names) != task.rows:
            return
        shares = (its.U ** 2).sum(axis=1)
        left_out = [name for name, share in zip(names, shares) if share <= IMMOVABLE]
        if len(left_out) == task.rows - its.U.shape[1]:
            them = 'it' if len(left_out) == 1 else 'them'
            yield Proposal(
                f'leave out {listed(left_out)}: the robot cannot move along or about {them} here',
                self._setup.with_part(self._own, its.U))

    @property
    def _leaves_joints(self) -> bool:
        """Return whether the task would leave a motion of the joints to tasks below it."""
        J = self._evaluation.level.J
        return bool(np.linalg.matrix_rank(J) < J.shape[1])


def _seconds(time: float) -> str:
    """Return a time [s] as text, with one digit below 10 s."""
    return f'{time:.0f} s' if time > 10.0 else f'{float(f"{time:.0e}"):g} s'


def _text(kind: str, names: Sequence[str]) -> str:
    """Return the change for causes of a kind."""
    return HINTS[kind].format(name=listed(names), s='s' * (len(names) > 1))

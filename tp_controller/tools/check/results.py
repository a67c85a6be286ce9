# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of a check: numbers, and findings from them as sentences."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import chain
import json
import math
import re
from types import UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

from tp_controller.errors import SettingsError, unknown

# Severities of a finding.
WRONG, DOUBTFUL, ACCEPTED, FINE = 'wrong', 'doubtful', 'accepted', 'fine'
SEVERITIES = (WRONG, DOUBTFUL, ACCEPTED, FINE)
# Kinds of findings that can be accepted: all but faults of the stack or the program.
KINDS = ('acts in part', 'bounds', 'bounds dominate', 'contradiction', 'cycle time', 'fight',
         'gain', 'impossible', 'joints', 'jump', 'never active', 'never acts', 'never reached',
         'out of reach', 'parameter', 'remark', 'seldom acts', 'seldom reached', 'singular',
         'slow', 'units', 'unwatched', 'velocity limit', 'weights')
# Kinds of causes besides those of a cycle: nothing limited the task when the time of the run was
# up, several causes did together, or the goal is out of reach.
STILL_MOVING, COMBINED, UNREACHABLE = 'moving', 'together', 'out of reach'
# Kinds of extremes of the commands, besides the limits of absolute values.
POSITION, JUMP = 'position', 'jump'


def _spec(description: str, unit: str = '') -> Any:
    """Return a dataclass field with its description and unit."""
    return field(metadata={'description': description, 'unit': unit})


@dataclass(frozen=True)
class Finding:
    """One sentence about a stack, with a suggested change."""

    severity: str = _spec('`wrong`, `doubtful`, `accepted` or `fine`')
    kind: str = _spec('subject, as one constant word')
    where: str = _spec('task, level, joint or line; empty for all')
    message: str = _spec('observation')
    change: str = _spec('suggested change; empty if none is needed')


@dataclass(frozen=True)
class LevelResult:
    """Rank left to a level by the levels above, over the samples in which it has one."""

    number: int = _spec('from 1, the highest priority')
    tasks: tuple[str, ...] = _spec('its tasks')
    rank: int = _spec('largest rank of the level alone')
    least_left: int = _spec('smallest rank that the levels above left')
    median_left: float = _spec('median of that')
    most_left: int = _spec('largest of that')
    most_of_all: int = _spec('largest of that if the level could move all joints')
    never: float = _spec('share of samples in which no rank was left')


@dataclass(frozen=True)
class PairResult:
    """Angles between two tasks and directions that they share, over all samples."""

    first: str = _spec('task')
    second: str = _spec('task of the same or a lower level')
    median_angle: float = _spec('median of the smallest angle between their rows', 'rad')
    shared: float = _spec('share of samples in which they share a direction: an angle below 5°')
    directions: int = _spec('largest number of directions that they share in a sample')


@dataclass(frozen=True)
class CauseCount:
    """Number of runs in which a cause limited a task that did not reach its goal."""

    kind: str = _spec('as in the report of a cycle, `together`, `out of reach`, `moving` (nothing '
                      'limited it when the run ended), or empty')
    name: str = _spec('joint or task')
    text: str = _spec('as in the report of a cycle, without numbers')
    runs: int = _spec('runs in which it was the largest one')


@dataclass(frozen=True)
class TaskResult:
    """One task; null where a number does not apply to its type."""

    name: str = _spec('task')
    # Name of the field in the JSON file.
    type: str = _spec('its type')  # noqa: A003
    level: int = _spec('from 1; 0 where it is disabled')
    gain_period: float | None = _spec('gain times period')
    singular: float | None = _spec('share of samples below the singular region of its level')
    fixed: bool = _spec('the direction of its smallest singular value is the same in all')
    smallest: float | None = _spec('median of its smallest singular value')
    outside: float | None = _spec('share of samples outside its bounds')
    rows_outside: float | None = _spec('mean share of its rows that are outside')
    active: float | None = _spec('share of samples with active bounds')
    within_reach: float | None = _spec('share of samples in which velocities within the limits '
                                       'could make them active')
    active_in_loops: float | None = _spec('share of the time of the closed loops')
    possible: int = _spec('runs in which it can be at its goal, with the others at theirs')
    reached: int = _spec('of these, runs in which it was')
    possible_near: int = _spec('possible runs with near goals')
    reached_near: int = _spec('of these, runs in which it was')
    median_seconds: float | None = _spec('median of the time to get there', 's')
    longest_seconds: float | None = _spec('longest time to get there', 's')
    causes: tuple[CauseCount, ...] = _spec('causes of misses, the most frequent one first')
    hint: str = _spec('most frequent hint of misses; mostly empty')


@dataclass(frozen=True)
class WorstResult:
    """Extreme of the commands, over all closed loops."""

    kind: str = _spec('`velocity`, `acceleration` and `jerk`: largest share of the limit; '
                      '`position`: farthest past a limit [rad or m]; `jump`: largest change '
                      'between two cycles, as a share of the velocity limit')
    value: float | None = _spec('null without a limit of that kind')
    name: str = _spec('the joint, or velocity of the base')
    run: int = _spec('number of the run, from 0; -1 without one')


@dataclass(frozen=True)
class Timing:
    """Processor time of a cycle on this machine."""

    cycles: int = _spec('number of measured cycles')
    median: float = _spec('median', 's')
    percentile_99: float = _spec('99th percentile', 's')
    longest: float = _spec('longest', 's')


@dataclass(frozen=True)
class CheckReport:
    """
    Report of a check.

    The fields are those of the JSON file; ``docs/check.md`` lists them with units.
    """

    version: int = _spec('version of this format: 1')
    robot: str = _spec('name of the robot')
    rate: float = _spec('cycles per second', 'Hz')
    seed: int = _spec('seed of the random configurations')
    samples: int = _spec('sampled configurations')
    runs: int = _spec('closed loops')
    ended: dict[str, int] = _spec('closed loops that ended as `reached`, `at rest`, `time is up`, '
                                  '`failed`')
    findings: tuple[Finding, ...] = _spec('findings, the worst first')
    levels: tuple[LevelResult, ...] = _spec('levels')
    tasks: tuple[TaskResult, ...] = _spec('tasks, in order of priority')
    pairs: tuple[PairResult, ...] = _spec('pairs of tasks with a demand')
    worst: tuple[WorstResult, ...] = _spec('extremes of the commands')
    timing: Timing | None = _spec('processor time of a cycle; null if not measured')

    def of(self, *severities: str) -> tuple[Finding, ...]:
        """Return the findings with one of these severities."""
        return tuple(finding for finding in self.findings if finding.severity in severities)

    def passes(self, strict: bool = False) -> bool:
        """Return whether no finding is wrong nor, if `strict`, doubtful."""
        return not self.of(*((WRONG, DOUBTFUL) if strict else (WRONG,)))

    def adding(self, findings: Iterable[Finding]) -> 'CheckReport':
        """Return the report with more findings."""
        return replace(self, findings=by_severity((*self.findings, *findings)))

    def accepting(self, kinds: Collection[str] = (),
                  tasks: Mapping[str, Collection[str]] | None = None) -> 'CheckReport':
        """
        Return the report with some wrong or doubtful findings as accepted ones.

        Parameters
        ----------
        kinds : collection of str
            Kinds of findings, as a report prints them in brackets.
        tasks : mapping, optional
            {task: kinds to accept where it is about this task}.

        Raises
        ------
        SettingsError
            There is no such kind.

        """
        per_task = tasks or {}
        check_kinds(chain(kinds, *per_task.values()))

        def accepted(finding: Finding) -> bool:
            own = (per_task.get(name, ()) for name in re.split('[(), ]+', finding.where))
            return finding.severity in (WRONG, DOUBTFUL) \
                and finding.kind in {*kinds, *chain.from_iterable(own)}

        return replace(self, findings=by_severity(
            replace(each, severity=ACCEPTED) if accepted(each) else each
            for each in self.findings))

    def to_json(self) -> str:
        """Return the report as JSON text."""
        return json.dumps(_plain(self), indent=1, ensure_ascii=False, allow_nan=False) + '\n'

    @classmethod
    def from_json(cls, text: str) -> 'CheckReport':
        """Return the report from a text made by `to_json`."""
        return cast(CheckReport, _from_plain(cls, json.loads(text)))


def check_kinds(kinds: Iterable[str]) -> None:
    """Raise `SettingsError` for kinds of findings that do not exist."""
    faults = [unknown('kind of findings', kind, KINDS) for kind in kinds if kind not in KINDS]
    if faults:
        raise SettingsError(faults)


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings sorted by severity, the worst first."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def _plain(value: Any) -> Any:
    """Return a value in JSON types; numbers that are not finite become None."""
    if is_dataclass(value):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _from_plain(kind: Any, value: Any) -> Any:
    """Return a value of a type from its JSON types."""
    if get_origin(kind) is UnionType:
        return None if value is None else _from_plain(get_args(kind)[0], value)
    if get_origin(kind) is tuple:
        return tuple(_from_plain(get_args(kind)[0], each) for each in value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        values = {name: _from_plain(hints[name], each) for name, each in value.items()}
        return kind(**values)  # type: ignore[operator]  # it is a class
    return value


def schema() -> Iterator[tuple[type, list[tuple[str, str, str]]]]:
    """Yield each part of the report with its fields: name, unit, description."""
    for kind in (CheckReport, Finding, LevelResult, TaskResult, CauseCount, PairResult,
                 WorstResult, Timing):
        yield kind, [(each.name, each.metadata['unit'], each.metadata['description'])
                     for each in fields(kind)]

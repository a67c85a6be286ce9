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

"""What a check found: numbers first, then what follows from them in words."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
import json
import math
from types import UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

# How bad a finding is.
WRONG, DOUBTFUL, FINE = 'wrong', 'doubtful', 'fine'
SEVERITIES = (WRONG, DOUBTFUL, FINE)
# Kind of a cause: nothing limited the task when the time of the run was over.
STILL_MOVING = 'moving'


def _said(description: str, unit: str = '') -> Any:
    """Return a field with its description and unit."""
    return field(metadata={'description': description, 'unit': unit})


@dataclass(frozen=True)
class Finding:
    """One sentence about a stack, and what can be done."""

    severity: str = _said('`wrong`, `doubtful` or `fine`')
    kind: str = _said('what it is about, in a word that does not change')
    where: str = _said('task, level, joint or line; empty for all')
    message: str = _said('what is the case')
    change: str = _said('what can be changed; empty where nothing has to be')


@dataclass(frozen=True)
class LevelResult:
    """What the levels above leave to a level with a demand, over all samples."""

    number: int = _said('from 1, the highest priority')
    tasks: tuple[str, ...] = _said('its tasks')
    rank: int = _said('largest rank of the level alone')
    least_left: int = _said('smallest rank that the levels above left')
    median_left: float = _said('median of that')
    most_left: int = _said('largest of that')
    never: float = _said('share of samples in which nothing was left')


@dataclass(frozen=True)
class PairResult:
    """How the directions of two tasks lie to each other, over all samples."""

    first: str = _said('task')
    second: str = _said('task of the same or a lower level')
    median_angle: float = _said('median of the smallest angle between their rows', 'rad')
    shared: float = _said('share of samples in which they share a direction: an angle below 5°')
    directions: int = _said('largest number of directions that they share in a sample')


@dataclass(frozen=True)
class CauseCount:
    """How often something limited a task that did not reach its goal."""

    kind: str = _said('as in the report of a cycle; empty: several causes together; `moving`: '
                      'nothing limited it when the run ended')
    name: str = _said('joint or task')
    runs: int = _said('in how many runs it was the largest cause')


@dataclass(frozen=True)
class TaskResult:
    """One task, in samples and in closed loops; null where a number is about other types."""

    name: str = _said('task')
    # The name that it has in the JSON file.
    type: str = _said('its type')  # noqa: A003
    level: int = _said('from 1; 0 where it is disabled')
    gain_period: float | None = _said('gain times period')
    singular: float | None = _said('share of samples in which its smallest singular value is '
                                   'below the singular region of its level')
    smallest: float | None = _said('median of its smallest singular value')
    outside: float | None = _said('share of samples in which an inequality task is outside its '
                                  'bounds')
    rows_outside: float | None = _said('mean share of its rows that are outside')
    active: float | None = _said('share of samples in which its bounds are active')
    active_in_loops: float | None = _said('share of the time of the closed loops in which they '
                                          'are')
    possible: int = _said('runs in which it can be at its goal, or within its bounds, with those '
                          'of the others')
    reached: int = _said('runs of these in which it was in the end')
    possible_near: int = _said('runs with goals in the nearer half, of the possible ones')
    reached_near: int = _said('runs of these in which it was in the end')
    median_seconds: float | None = _said('median of the time to get there', 's')
    longest_seconds: float | None = _said('longest time to get there', 's')
    causes: tuple[CauseCount, ...] = _said('why it was not, the most frequent cause first')


@dataclass(frozen=True)
class WorstResult:
    """The worst that commands did, over all closed loops."""

    kind: str = _said('`velocity` and `acceleration`: largest share of the limit; `position`: '
                      'farthest past a limit [rad or m]; `jump`: largest change between two '
                      'cycles, as a share of the velocity limit')
    value: float | None = _said('null without a limit of that kind')
    name: str = _said('the joint, or velocity of the base')
    run: int = _said('number of the run, from 0; -1 without one')


@dataclass(frozen=True)
class Timing:
    """Processor time of a cycle on this machine, which no seed repeats."""

    cycles: int = _said('how many were measured')
    median: float = _said('median', 's')
    percentile_99: float = _said('99 of 100 are not longer', 's')
    longest: float = _said('longest', 's')


@dataclass(frozen=True)
class CheckReport:
    """
    What a check found.

    The fields are those of the JSON file; ``docs/check.md`` lists them with units.
    """

    version: int = _said('of this format: 1')
    robot: str = _said('name of the robot')
    rate: float = _said('cycles per second', 'Hz')
    seed: int = _said('that the random configurations follow from')
    samples: int = _said('configurations looked at')
    runs: int = _said('closed loops')
    ended: dict[str, int] = _said('how many closed loops ended by `reached`, `at rest`, '
                                  '`time is up` and `failed`')
    findings: tuple[Finding, ...] = _said('what follows from the numbers, the worst first')
    levels: tuple[LevelResult, ...] = _said('levels with a demand')
    tasks: tuple[TaskResult, ...] = _said('tasks, in order of priority')
    pairs: tuple[PairResult, ...] = _said('pairs of tasks that demand something of frames or '
                                          'some joints')
    worst: tuple[WorstResult, ...] = _said('the worst that commands did')
    timing: Timing | None = _said('time of a cycle; null where it was not measured')

    def of(self, *severities: str) -> tuple[Finding, ...]:
        """Return the findings that are as bad as one of these words says."""
        return tuple(finding for finding in self.findings if finding.severity in severities)

    def passes(self, strict: bool = False) -> bool:
        """Say whether nothing is wrong, nor, if `strict`, doubtful."""
        return not self.of(*((WRONG, DOUBTFUL) if strict else (WRONG,)))

    def adding(self, findings: Iterable[Finding]) -> 'CheckReport':
        """Return the report with more findings."""
        return replace(self, findings=by_severity((*self.findings, *findings)))

    def to_json(self) -> str:
        """Return the report as JSON text."""
        return json.dumps(_plain(self), indent=1, ensure_ascii=False, allow_nan=False) + '\n'

    @classmethod
    def from_json(cls, text: str) -> 'CheckReport':
        """Return the report of a text that `to_json` has made."""
        return cast(CheckReport, _made(cls, json.loads(text)))


def by_severity(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings, the worst first."""
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def _plain(value: Any) -> Any:
    """Return a value as JSON can have it; what is not finite is none."""
    if is_dataclass(value):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _made(kind: Any, value: Any) -> Any:
    """Return a value of a type from what JSON has of it."""
    if get_origin(kind) is UnionType:
        return None if value is None else _made(get_args(kind)[0], value)
    if get_origin(kind) is tuple:
        return tuple(_made(get_args(kind)[0], each) for each in value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: _made(hints[name], each)  # type: ignore[operator]  # it is a class
                       for name, each in value.items()})
    return value


def schema() -> Iterator[tuple[type, list[tuple[str, str, str]]]]:
    """Yield each part of the report with its fields: name, unit, description."""
    for kind in (CheckReport, Finding, LevelResult, TaskResult, CauseCount, PairResult,
                 WorstResult, Timing):
        yield kind, [(each.name, each.metadata['unit'], each.metadata['description'])
                     for each in fields(kind)]

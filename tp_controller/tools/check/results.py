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

"""Results of a check: numbers, and findings from them as sentences."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
import json
import math
from types import UnionType
from typing import Any, cast, get_args, get_origin, get_type_hints

# Severities of a finding.
WRONG, DOUBTFUL, FINE = 'wrong', 'doubtful', 'fine'
SEVERITIES = (WRONG, DOUBTFUL, FINE)
# Kind of a cause: nothing limited the task when the time of the run was up.
STILL_MOVING = 'moving'
# Kinds of extremes of the commands, besides the limits of absolute values.
POSITION, JUMP = 'position', 'jump'


def _spec(description: str, unit: str = '') -> Any:
    """Return a dataclass field with its description and unit."""
    return field(metadata={'description': description, 'unit': unit})


@dataclass(frozen=True)
class Finding:
    """One sentence about a stack, with a suggested change."""

    severity: str = _spec('`wrong`, `doubtful` or `fine`')
    kind: str = _spec('subject, as one constant word')
    where: str = _spec('task, level, joint or line; empty for all')
    message: str = _spec('observation')
    change: str = _spec('suggested change; empty if none is needed')


@dataclass(frozen=True)
class LevelResult:
    """Rank left to a level with a demand by the levels above, over all samples."""

    number: int = _spec('from 1, the highest priority')
    tasks: tuple[str, ...] = _spec('its tasks')
    rank: int = _spec('largest rank of the level alone')
    least_left: int = _spec('smallest rank that the levels above left')
    median_left: float = _spec('median of that')
    most_left: int = _spec('largest of that')
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

    kind: str = _spec('as in the report of a cycle; empty: several causes together; `moving`: '
                      'nothing limited it when the run ended')
    name: str = _spec('joint or task')
    runs: int = _spec('number of runs in which it was the largest cause')


@dataclass(frozen=True)
class TaskResult:
    """One task, in samples and in closed loops; null if a number does not apply to its type."""

    name: str = _spec('task')
    # Name of the field in the JSON file.
    type: str = _spec('its type')  # noqa: A003
    level: int = _spec('from 1; 0 where it is disabled')
    gain_period: float | None = _spec('gain times period')
    singular: float | None = _spec('share of samples in which its smallest singular value is '
                                   'below the singular region of its level')
    smallest: float | None = _spec('median of its smallest singular value')
    outside: float | None = _spec('share of samples in which an inequality task is outside its '
                                  'bounds')
    rows_outside: float | None = _spec('mean share of its rows that are outside')
    active: float | None = _spec('share of samples in which its bounds are active')
    active_in_loops: float | None = _spec('share of the time of the closed loops in which they '
                                          'are')
    possible: int = _spec('runs in which it can be at its goal, or within its bounds, with those '
                          'of the others')
    reached: int = _spec('runs of these in which it was in the end')
    possible_near: int = _spec('runs with goals in the nearer half, of the possible ones')
    reached_near: int = _spec('runs of these in which it was in the end')
    median_seconds: float | None = _spec('median of the time to get there', 's')
    longest_seconds: float | None = _spec('longest time to get there', 's')
    causes: tuple[CauseCount, ...] = _spec('causes of misses, the most frequent one first')


@dataclass(frozen=True)
class WorstResult:
    """Extreme of the commands, over all closed loops."""

    kind: str = _spec('`velocity` and `acceleration`: largest share of the limit; `position`: '
                      'farthest past a limit [rad or m]; `jump`: largest change between two '
                      'cycles, as a share of the velocity limit')
    value: float | None = _spec('null without a limit of that kind')
    name: str = _spec('the joint, or velocity of the base')
    run: int = _spec('number of the run, from 0; -1 without one')


@dataclass(frozen=True)
class Timing:
    """Processor time of a cycle on this machine; not reproducible by the seed."""

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
    samples: int = _spec('number of sampled configurations')
    runs: int = _spec('number of closed loops')
    ended: dict[str, int] = _spec('number of closed loops with the outcome `reached`, `at rest`, '
                                  '`time is up` and `failed`')
    findings: tuple[Finding, ...] = _spec('findings from the numbers, the worst first')
    levels: tuple[LevelResult, ...] = _spec('levels with a demand')
    tasks: tuple[TaskResult, ...] = _spec('tasks, in order of priority')
    pairs: tuple[PairResult, ...] = _spec('pairs of tasks that demand something of frames or '
                                          'some joints')
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

    def to_json(self) -> str:
        """Return the report as JSON text."""
        return json.dumps(_plain(self), indent=1, ensure_ascii=False, allow_nan=False) + '\n'

    @classmethod
    def from_json(cls, text: str) -> 'CheckReport':
        """Return the report from a text made by `to_json`."""
        return cast(CheckReport, _from_plain(cls, json.loads(text)))


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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
How good a check is: what it says of stacks whose verdict is known.

A fault counts as found if a wrong or doubtful finding of an expected kind names it and says what
to change. A sound stack counts as doubted if it has any such finding.

The tests take each mistake on one of its robots, and every third sound stack, in about a minute;
with ``TP_CONTROLLER_ALL_STACKS=1`` in the environment, all of them on all robots.
"""

from collections import Counter
from collections.abc import Iterator
import os
import re

from check_stacks import Case, Fault, FAULTS, SOUND
import pytest
from robots import CONFIG
from tp_controller import TpControllerError
from tp_controller.tools.check.results import DOUBTFUL, Finding, WRONG

pytestmark = pytest.mark.slow
# Shares of the faults that have to be found, and of the sound stacks that may be doubted [1].
LEAST_FOUND, MOST_DOUBTED = 0.95, 0.03
# Kind of a finding about the machine, which other programs may slow down.
OF_MACHINE = 'cycle time'
# One case of so many is taken, or all; of mistakes, one of their three robots.
EVERY = 1 if os.environ.get('TP_CONTROLLER_ALL_STACKS') else 3
# Name of a mistake on some robot: the text before the colon.
SEPARATOR = ':'


def said(case: Case) -> tuple[Finding, ...]:
    """Return the wrong and doubtful findings of a case; one about an error, if there is one."""
    try:
        return case.check().of(WRONG, DOUBTFUL)
    except (TpControllerError, ArithmeticError, ValueError) as error:
        return (Finding(WRONG, 'error', '', f'{type(error).__name__}: {error}', ''),)


def names(fault: Fault, finding: Finding) -> bool:
    """Return whether a finding names a fault, its place and what to change."""
    return finding.kind in fault.kinds \
        and bool(re.search(fault.where, finding.where or finding.message)) \
        and bool(re.search(fault.advice, f'{finding.message} {finding.change}', re.IGNORECASE))


def rows(found: dict[Case, tuple[Finding, ...]]) -> str:
    """Return cases and what was said of them as a table."""
    return '\n'.join(['', *_rows(found)])


def _rows(found: dict[Case, tuple[Finding, ...]]) -> Iterator[str]:
    """Yield the lines of `rows`."""
    for case, findings in found.items():
        expected = f' (expected: {", ".join(case.kinds)})' if isinstance(case, Fault) else ''
        yield f'{case.name}{expected}'
        for each in findings or [Finding('nothing', '', '', '', '')]:
            yield f'    {each.severity:8}  {each.kind:16}  {each.where:24}  {each.message}' \
                  f' → {each.change}'


@pytest.fixture(scope='module')
def of_sound():
    """Return {sound case: what was said of it, not of this machine}."""
    return {case: tuple(each for each in said(case) if each.kind != OF_MACHINE)
            for case in SOUND[::EVERY]}


@pytest.fixture(scope='module')
def of_faults():
    """Return {case with a mistake: what was said}."""
    return {case: said(case) for number, case in enumerate(FAULTS)
            if (number + number // 3) % EVERY == 0}


def test_most_faults_are_found_where_they_are_with_advice(of_faults):
    missed = {case: findings for case, findings in of_faults.items()
              if not any(names(case, each) for each in findings)}
    share = 1.0 - len(missed) / len(of_faults)
    assert share >= LEAST_FOUND, f'{share:.1%} found, missed:{rows(missed)}'


def test_hardly_any_sound_stack_is_doubted(of_sound):
    doubted = {case: findings for case, findings in of_sound.items() if findings}
    share = len(doubted) / len(of_sound)
    assert share <= MOST_DOUBTED, f'{share:.1%} doubted:{rows(doubted)}'


def test_no_sound_stack_is_called_wrong(of_sound):
    wrong = {case: tuple(each for each in findings if each.severity == WRONG)
             for case, findings in of_sound.items()}
    wrong = {case: findings for case, findings in wrong.items() if findings}
    assert not wrong, rows(wrong)


# The cases themselves --------------------------------------------------------------------


def test_every_mistake_is_made_on_three_robots():
    counts = Counter(case.name.partition(SEPARATOR)[0] for case in FAULTS)
    assert len(counts) >= 25 and set(counts.values()) == {3}
    assert len(SOUND) >= 64


def test_no_case_is_there_twice():
    for cases in (SOUND, FAULTS):
        setups = [(case.robot, case.stack, str(case.settings)) for case in cases]
        assert len(set(setups)) == len(setups)
        assert len({case.name for case in cases}) == len(cases)


def test_every_shipped_stack_is_among_the_sound_ones():
    text = '\n'.join(f'{case.name} {case.stack}\n{case.settings}' for case in SOUND)
    parameters = '\n'.join(path.read_text(encoding='utf-8') for path in CONFIG.rglob('*.yaml'))
    for path in (*CONFIG.rglob('*_stack.yaml'), *CONFIG.rglob('*_home.yaml'),
                 *CONFIG.glob('lab*.yaml')):
        name = path.relative_to(CONFIG).with_suffix('').as_posix()
        owner = path.name.removesuffix('_stack.yaml')
        assert name in text or f'{name}.yaml' in parameters and owner in text, name


@pytest.mark.parametrize(('kind', 'where', 'change', 'expected'), [
    ('gain', 'tool', 'lower the gain', True), ('slow', 'tool', 'lower the gain', False),
    ('gain', 'posture', 'lower the gain', False), ('gain', 'tool', 'raise the rate', False)])
def test_a_finding_names_a_fault_by_kind_place_and_advice(kind, where, change, expected):
    fault = Fault('case', 'planar', '', {}, ('gain',), 'lower', 'tool')
    assert names(fault, Finding(WRONG, kind, where, 'too high', change)) == expected

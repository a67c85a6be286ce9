# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The command ``tp_controller check``: what it prints, writes and returns."""

from html.parser import HTMLParser
import re

import pytest
from robots import CONFIG, PLANAR_DH
from tp_controller.tools.check import CheckReport
from tp_controller.tools.check.page import page_of
from tp_controller.tools.check.results import Finding, WRONG
from tp_controller.tools.check.tables import text_of
from tp_controller.tools.cli.main import main

GOOD = '- tip: {type: position, frame: link3, axes: x, gain: 3.0}\n'
DEAD = '- posture: {type: posture}\n' + GOOD
FAST = GOOD.replace('3.0', '60.0')
FEW = ['--samples', '5', '--runs', '1', '--seconds', '0.5']


def run(capsys, *arguments, robot=str(PLANAR_DH)):
    """Return the exit status, and what was printed, of a check."""
    status = main(['check', *arguments, '--robot', robot, *FEW])
    printed = capsys.readouterr()
    return status, printed.out, printed.err


@pytest.mark.parametrize(('stack', 'options', 'status'), [
    (GOOD, [], 0), (GOOD.replace('3.0', '60.0'), [], 0), (FAST, ['--strict'], 1), (DEAD, [], 1)])
def test_exit_status_says_what_was_found(capsys, stack, options, status):
    assert run(capsys, stack, *options)[0] == status


def test_what_is_wrong_comes_first(capsys):
    _, out, err = run(capsys, DEAD)
    assert out.index('wrong:') < out.index('it can never act') < out.index('fine:')
    assert 'put it above them' in out and not err


def test_faults_of_a_stack_are_listed_with_their_lines(capsys, tmp_path):
    path = tmp_path / 'check.json'
    status, out, _ = run(capsys, '- a: {type: pos}\n- b: {type: position}\n', '--json', str(path))
    assert status == 1 and 'line 1, a: unknown type' in out and 'line 2, b: needs the key' in out
    report = CheckReport.from_json(path.read_text())
    assert [each.kind for each in report.findings] == ['fault', 'fault'] and not report.samples


@pytest.mark.parametrize('arguments', [
    ['none.yaml'], [GOOD, '--params-file', 'none.yaml'], [GOOD, '--base', 'boat'],
    [GOOD, '--json', 'none/check.json'], [GOOD, '--html', '.']])
def test_arguments_that_are_not_valid_are_told_from_faults(capsys, arguments, tmp_path,
                                                           monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, _, err = run(capsys, *arguments)
    assert status == 2 and err.startswith('tp_controller: ')


@pytest.mark.slow
def test_a_robot_that_is_missing_is_told_from_one_that_is_wrong(capsys, tmp_path):
    assert run(capsys, GOOD, robot='none.urdf')[0] == 2
    (tmp_path / 'wrong.urdf').write_text('<robot name="r"/>')
    status, out, _ = run(capsys, GOOD, robot=str(tmp_path / 'wrong.urdf'))
    assert status == 1 and 'wrong:' in out


@pytest.mark.parametrize('arguments', [
    ['--samples', '0'], ['--runs', '-1'], ['--seed', '1.5'], ['--jobs', '0'], ['--jobs', 'all'],
    ['--rate', '0']])
def test_numbers_out_of_range_are_refused(capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        main(['check', GOOD, '--robot', str(PLANAR_DH), *arguments])
    assert ended.value.code == 2 and arguments[0] in capsys.readouterr().err


class Page(HTMLParser):
    """Collects what a page refers to and whether its tags are closed."""

    def __init__(self):
        super().__init__()
        self.open, self.references, self.text = [], [], ''

    def handle_starttag(self, tag, attrs):
        self.references += [value for name, value in attrs if name in ('src', 'href')]
        if tag not in ('meta', 'br'):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_the_page_says_what_the_text_says_and_needs_nothing_else(capsys, tmp_path):
    path = tmp_path / 'check.html'
    _, out, _ = run(capsys, DEAD, '--html', str(path))
    page = Page()
    page.feed(path.read_text())
    assert not page.open and not page.references and 'url(' not in path.read_text()
    for word in set(re.findall(r'\w{4,}', out)) - {'wrong', 'fine', 'doubtful'}:
        assert word.lower() in page.text.lower()


@pytest.mark.parametrize('option', ['--html', '--json'])
def test_what_a_link_leads_to_is_not_written(capsys, tmp_path, option):
    (tmp_path / 'mine').write_text('mine')
    (tmp_path / 'link').symlink_to(tmp_path / 'mine')
    status, _, err = run(capsys, DEAD, option, str(tmp_path / 'link'))
    assert status == 2 and 'is a link' in err and (tmp_path / 'mine').read_text() == 'mine'


def test_the_page_shows_text_and_no_code():
    report = CheckReport(1, '<b>', 1.0, 0, 0, 0, {}, (
        Finding(WRONG, 'fault', '<script>', 'a & b', ''),), (), (), (), (), None)
    assert '<script>' not in page_of(report) and 'a &amp; b' in page_of(report)
    assert 'nothing was tried' in text_of(report)


@pytest.mark.slow
def test_a_second_parameter_file_goes_before_the_first(capsys, tmp_path):
    path = tmp_path / 'check.json'
    (tmp_path / 'slow.yaml').write_text('/**: {ros__parameters: {rate: 20.0}}')
    main(['check', '--params-file', str(CONFIG / 'demo.yaml'), '--params-file',
          str(tmp_path / 'slow.yaml'), '--samples', '2', '--runs', '0', '--json', str(path)])
    capsys.readouterr()
    assert CheckReport.from_json(path.read_text()).rate == 20.0


@pytest.mark.slow
@pytest.mark.parametrize('name', ['demo', 'mobile', 'underwater', 'two_arms'])
def test_nothing_is_wrong_with_the_demos(capsys, name):
    status = main(['check', '--params-file', str(CONFIG / f'{name}.yaml'), '--samples', '25',
                   '--runs', '0', '--strict'])
    out = capsys.readouterr().out
    assert status == 0 and '→' not in out, out


def test_what_is_accepted_is_neither_wrong_nor_doubtful(capsys):
    # In a run this short no task arrives.
    status, out, _ = run(capsys, DEAD, '--strict', '--accept', 'never acts', '--accept',
                         'never reached')
    assert status == 0 and 'accepted:\n  - [never acts] level 2 (tip): ' in out
    # For one task, in the stack.
    stack = DEAD.replace('}\n- tip', ', accept: gain}\n- tip').replace('3.0', '60.0')
    assert 'doubtful:\n  - [gain] tip' in run(capsys, stack)[1]
    stack = DEAD.replace('3.0}', '60.0, accept: [gain, never acts, never reached]}')
    status, out, _ = run(capsys, stack, '--strict', '--accept', 'slow')
    assert status == 0 and {'[gain] tip', '[never acts] level 2 (tip)'} <= set(
        re.findall(r'- (\[.*?):', out.partition('accepted:')[2]))


@pytest.mark.parametrize('arguments', [
    [GOOD, '--accept', 'gian'], [GOOD.replace('3.0}', '3.0, accept: gian}')]])
def test_a_kind_that_does_not_exist_is_not_accepted(capsys, arguments):
    status, _, err = run(capsys, *arguments)
    assert status == 2 and "'gian'" in err and 'did you mean' in err and 'gain' in err


@pytest.mark.slow
def test_the_time_is_estimated_before_it_is_taken(monkeypatch, capsys):
    told = []
    monkeypatch.setattr('tp_controller.tools.check.checker.closed_loop',
                        lambda *_: told.append(capsys.readouterr().err) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(['check', GOOD, '--robot', str(PLANAR_DH), '--runs', '100000'])
    assert re.search(r'this takes about \d+ min: fewer --runs', told[0])


def test_joints_that_are_driven_can_be_named(capsys, tmp_path):
    path = tmp_path / 'check.json'
    status, out, _ = run(capsys, GOOD, '--joints', 'joint1', 'joint2', '--json', str(path))
    assert status == 0
    assert CheckReport.from_json(path.read_text()).levels[0].rank == 1
    status, out, _ = run(capsys, GOOD, '--joints', 'joint9')
    assert status == 1 and "'joint9'" in out


@pytest.mark.slow
def test_a_xacro_is_checked_with_its_arguments(capsys, tmp_path):
    pytest.importorskip('xacro')
    path = tmp_path / 'robot.urdf.xacro'
    path.write_text('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
                    '<xacro:arg name="length" default="0"/><link name="a"/><link name="tip"/>'
                    '<joint name="$(arg name)" type="continuous"><parent link="a"/>'
                    '<child link="tip"/><origin xyz="$(arg length) 0 0"/></joint></robot>')
    stack = '- rest: {type: posture}'
    status, out, _ = run(capsys, stack, '--xacro-arg', 'name:=elbow', '--xacro-arg', 'length:=2',
                         robot=str(path))
    assert status == 0 and 'elbow: no velocity limit' in out
    assert 'limits: {elbow: {velocity: 0.5}}' in out
    status, out, _ = run(capsys, stack, '--xacro-arg', 'nam:=elbow', robot=str(path))
    # Lines are as long as the path of the file leaves them.
    assert status == 1
    assert "argument 'name' has no value; give it one, as name:=value" in ' '.join(out.split())

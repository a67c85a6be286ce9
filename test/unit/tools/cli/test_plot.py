# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""``tp_controller plot``: from a recording to pictures and a report, without ROS."""

from html.parser import HTMLParser
import math
import os
import re
import subprocess
import sys
import warnings

import pytest
import recordings
from robots import REPOSITORY
from tp_controller.tools.cli.main import main
from tp_controller.tools.extras import install_command
from tp_controller.untrusted.texts import plain

pytest.importorskip('matplotlib')


class Page(HTMLParser):
    """
    What a page shows.

    Attributes
    ----------
    tables : dict
        {title above it: rows of cells}
    addresses : list of str
        Of what the page loads, or leads to.
    text : str

    """

    def __init__(self, path):
        super().__init__()
        self.tables, self.addresses, self.text = {}, [], ''
        self._title = self._tag = ''
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag, attributes):
        """Take the start of an element."""
        self._tag = tag
        self.addresses += [value for name, value in attributes if name in ('src', 'href')]
        if tag == 'tr':
            self.tables.setdefault(self._title, []).append([])
        if tag in ('td', 'th'):
            self.tables[self._title][-1].append('')

    def handle_data(self, data):
        """Take text."""
        self.text += data
        if self._tag == 'h2':
            self._title = data
        if self._tag in ('td', 'th'):
            self.tables[self._title][-1][-1] += data

    def handle_endtag(self, tag):
        """Take the end of an element."""
        self._tag = ''


@pytest.fixture
def plot(tmp_path, capsys, monkeypatch):
    """Return what plots a recording: it returns exit status, output, complaints and page."""
    monkeypatch.chdir(tmp_path)

    def plot(path, *arguments, output='plots'):
        code = main(['plot', str(path), '--output', output, *arguments])
        said = capsys.readouterr()
        report = tmp_path / output / 'report.html'
        return code, said.out, said.err, Page(report) if report.is_file() else None

    return plot


@pytest.mark.slow
def test_the_report_has_the_numbers_that_were_recorded(plot, tmp_path):
    code, out, _, page = plot(recordings.write(tmp_path / 'run', recordings.run()))
    assert code == 0
    tool, posture = page.tables['Tasks'][1:]
    assert tool == ['tool', 'position', '1', 'reached', '0 m', '1 m', '49 % of 3.9 s', '']
    assert posture[3:] == ['limited', '0.25 rad', '0.25 rad', '0 % of 3.9 s',
                           'blocked by tool (3.7 s)']
    assert page.tables['Goals'][1:] == [
        ['0.5 s', 'tool', 'xyz 0.4 0.2 0', '', 'reached after 1.5 s'],
        ['3.0 s', 'tool', 'xyz nan 0 0', '', 'refused: not finite']]
    assert page.tables['Stops'][1:] == [['1.0 s', '0.2 s', 'stopped by ~/stop']]
    first, _, third = page.tables['Joints'][1:]
    assert first[0] == 'joint1' and first[1] == '0.000 … 0.200 rad'
    assert first[3:] == ['0.100 rad/s', '50 %'] and third[3] == '0.050 rad/s'
    assert ['/joint_states', '200'] in page.tables['Recording']
    for name in ('errors.png', 'velocities.png', 'tool_path.png'):
        assert (tmp_path / 'plots' / name).read_bytes().startswith(b'\x89PNG') and name in out
    assert out.splitlines()[1].split()[:4] == ['tool', '1', 'reached', '0']


@pytest.mark.slow
def test_the_report_is_one_file_that_loads_nothing(plot, tmp_path):
    page = plot(recordings.write(tmp_path / 'run', recordings.run()))[3]
    assert len(page.addresses) >= 3
    assert all(address.startswith('data:image/png;base64,') for address in page.addresses)


@pytest.mark.slow
def test_names_that_look_like_html_are_shown_as_they_are(plot, tmp_path):
    rows = [(time, topic, message) for time, topic, message in recordings.run()]
    rows.append((3.5, '/tp_controller/status', recordings.status(
        'tp_controller', tool=recordings.task(reason='<script>alert(1)</script> & more'))))
    page = plot(recordings.write(tmp_path / 'run', rows))[3]
    assert any('<script>alert(1)</script> & more' in cell for row in page.tables['Tasks']
               for cell in row)


@pytest.mark.parametrize('name', [
    r'$\frac{', '$x$', r'\$', '$$', 'a$', '\x1b]0;title\x07', '\u202eback', '_hidden', '%s{}',
    '\t', 'x' * 5000])
@pytest.mark.slow
def test_names_are_drawn_and_printed_as_they_are(plot, tmp_path, name):
    def named():
        for time, topic, message in recordings.run():
            if topic.endswith('status'):
                for each in message.status[1:]:
                    each.name = f'tp_controller: {name}'
                message.status[0].message = name
            yield time, topic, message
        yield 4.0, '/parameter_events', recordings.parameters(
            'tp_controller', command_joints=[name, name + '2', '3'])

    code, out, err, page = plot(recordings.write(tmp_path / 'run', named()))
    assert code == 0 and 'no plot' not in err and 'errors.png' in out and 'velocities.png' in out
    assert (out + err).replace('\n', '').isprintable()
    assert page.tables['Tasks'][1][0][:200] == plain(name)[:200]


@pytest.mark.parametrize('value', [math.nan, math.inf, 1e308, -1e308, 1e-320])
@pytest.mark.slow
def test_numbers_that_make_no_sense_end_no_plot(plot, tmp_path, value):
    rows = [*recordings.run(),
            (3.95, '/tp_controller/status', recordings.status(
                'tp_controller', tool=recordings.task(value))),
            (3.95, '/velocity_controller/commands', recordings.numbers([value] * 3)),
            (3.95, '/joint_states', recordings.joint_state([value] * 3)),
            (3.95, '/tp_controller/tool/goal', recordings.point(value, value, value))]
    with warnings.catch_warnings():
        # Of numbers that overflow.
        warnings.simplefilter('ignore')
        code, _, _, page = plot(recordings.write(tmp_path / 'run', rows))
    assert code == 0 and page.tables['Tasks'][1][0] == 'tool'


@pytest.mark.slow
def test_a_plot_that_cannot_be_drawn_leaves_the_rest(plot, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OverflowError('of the test')

    monkeypatch.setattr('tp_controller.tools.recording.pictures.plot_errors', fail)
    code, out, err, page = plot(recordings.write(tmp_path / 'run', recordings.run()))
    assert code == 0 and 'velocities.png' in out and 'errors.png' not in out
    assert 'no plot of errors: OverflowError: of the test' in err
    assert 'no plot of errors' in page.text


@pytest.mark.slow
@pytest.mark.parametrize('name', ['report.html', 'errors.png'])
def test_what_a_link_leads_to_is_not_written(plot, tmp_path, name):
    (tmp_path / 'plots').mkdir()
    (tmp_path / 'mine').write_text('mine')
    (tmp_path / 'plots' / name).symlink_to(tmp_path / 'mine')
    code, _, err, _ = plot(recordings.write(tmp_path / 'run', recordings.run()))
    assert code == 1 and 'is a link' in err
    assert (tmp_path / 'mine').read_text() == 'mine'


@pytest.mark.slow
def test_a_recording_that_was_cut_off_is_drawn_as_far_as_it_goes(plot, tmp_path):
    path = recordings.write(tmp_path / 'run', recordings.run(seconds=400.0))
    file = path / 'run.mcap'
    file.write_bytes(file.read_bytes()[:file.stat().st_size // 2])
    (path / 'metadata.yaml').unlink()
    code, _, err, page = plot(path)
    assert code == 0 and page.tables['Tasks'][1][0] == 'tool'
    for remark in ('was not ended', 'run.mcap is cut off, or damaged, after'):
        assert remark in err and remark in page.text


@pytest.mark.parametrize(('left_out', 'missing', 'there'), [
    ('status', 'Tasks', 'velocities.png'), ('commands', 'Path', 'errors.png'),
    ('robot_description', 'position limits', 'errors.png'),
    ('parameter_events', 'Path of', 'velocities.png'),
    ('joint_states', 'Path of', 'errors.png')])
@pytest.mark.slow
def test_what_can_be_drawn_without_a_topic_is_drawn(plot, tmp_path, left_out, missing, there):
    path = recordings.write(tmp_path / 'run', [
        row for row in recordings.run() if not row[1].endswith(left_out)])
    code, out, err, page = plot(path)
    assert code == 0 and there in out
    if left_out == 'status':
        assert missing not in page.tables and 'no status of a controller' in err
    if left_out == 'robot_description':
        assert 'no description of the robot' in err and 'no description' in page.text
    if left_out in ('parameter_events', 'joint_states'):
        assert missing not in page.text


@pytest.mark.parametrize(('messages', 'fault'), [
    ([], 'has no messages'),
    ([(0.0, '/chatter', recordings.text('hello'))], r'nothing of a controller.*/chatter')])
def test_a_recording_of_something_else_is_refused(plot, tmp_path, messages, fault):
    code, _, err, page = plot(recordings.write(tmp_path / 'run', messages))
    assert code == 1 and page is None and re.search(fault, err)


@pytest.mark.slow
def test_a_robot_that_cannot_be_read_leaves_the_rest(plot, tmp_path):
    rows = [row for row in recordings.run() if not row[1].endswith('robot_description')]
    rows.append((0.0, '/robot_description', recordings.text('<robot/>')))
    code, out, err, _ = plot(recordings.write(tmp_path / 'run', rows))
    assert code == 0 and 'the robot is not known' in err and 'errors.png' in out


@pytest.mark.slow
def test_plots_go_to_a_folder_named_after_the_recording(tmp_path, capsys, monkeypatch):
    recordings.write(tmp_path / 'run', recordings.run())
    monkeypatch.chdir(tmp_path)
    assert main(['plot', 'run/run.mcap', '--node', '/tp_controller']) == 0
    assert (tmp_path / 'tp_plots' / 'run' / 'report.html').is_file() or \
        (tmp_path / 'tp_plots' / 'run.mcap' / 'report.html').is_file()
    (tmp_path / 'file').touch()
    assert main(['plot', 'run', '--output', 'file']) == 2
    assert '--output' in capsys.readouterr().err


@pytest.mark.slow
def test_no_ros_is_needed(tmp_path):
    path = recordings.write(tmp_path / 'run', recordings.run())
    program = ('import sys\n'
               'for name in ("rclpy", "std_msgs", "visualization_msgs", "geometry_msgs"):\n'
               '    sys.modules[name] = None\n'
               'from tp_controller.tools.cli.main import main\n'
               f'sys.exit(main(["plot", {str(path)!r}]))')
    done = subprocess.run([sys.executable, '-c', program], cwd=tmp_path, capture_output=True,
                          text=True, timeout=120, check=False,
                          env={**os.environ, 'PYTHONPATH': os.pathsep.join((
                              str(REPOSITORY), *filter(None, sys.path)))})
    assert done.returncode == 0, done.stderr
    page = Page(tmp_path / 'tp_plots' / 'run' / 'report.html')
    assert 'Tasks' in page.tables


@pytest.mark.slow
def test_what_is_not_installed_is_named(tmp_path, capsys, monkeypatch):
    path = recordings.write(tmp_path / 'run', recordings.run())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, 'viser', None)
    monkeypatch.delitem(sys.modules, 'tp_controller.tools.view.replay', raising=False)
    monkeypatch.delitem(sys.modules, 'tp_controller.tools.view.scene', raising=False)
    monkeypatch.delitem(sys.modules, 'tp_controller.tools.view.parts', raising=False)
    assert main(['plot', str(path)]) == 0
    assert f"no replay: viser is missing; {install_command('view')}" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, 'rosbags', None)
    monkeypatch.setitem(sys.modules, 'rosbags.typesys', None)
    monkeypatch.delitem(sys.modules, 'tp_controller.tools.recording.reader')
    monkeypatch.delitem(sys.modules, 'tp_controller.tools.recording.history')
    assert main(['plot', str(path)]) == 1
    assert install_command('record') in capsys.readouterr().err

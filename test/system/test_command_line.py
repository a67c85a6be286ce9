# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The command line against running nodes, and every example that it shows."""

import fcntl
import importlib
from importlib.metadata import version
from importlib.util import find_spec
import math
import os
from pathlib import Path
import pty
import re
import select
import shlex
import signal
import struct
import subprocess
import sys
import termios

from monitor import promise_of
import numpy as np
from PIL import Image
from processes_harness import command_line, DEADLINE, hear_ctrl_c, Listener
import pytest
from robots import CONFIG, panda, PANDA_TOOL
from tp_controller.ros.client.status import ControllerStatus, TaskStatus
from tp_controller.solver.compiled import running
from tp_controller.tools.cli.goal import _reach
from tp_controller.tools.cli.main import (
    COMMANDS,
    controller_node,
    EXAMPLES,
    main,
    make_parser,
    simulator_node,
    teleop_node,
    watchdog_node,
)
from tp_controller.tools.cli.status import table
import yaml

DOWN = ('--rpy', '3.1416', '0', '0')
# Beside the tasks of the demo one that only takes velocities.
STACK = (CONFIG / 'demo_stack.yaml').read_text().replace(
    '- elbow', '- swing: {type: joint_velocity, joints: panda_joint7}\n- elbow')


@pytest.fixture(scope='module')
def robot(domain, tmp_path_factory):
    """Return a listener to the robot of the demo, which runs for all tests of this file."""
    from tp_controller.tools.demos.processes import NodeProcess
    folder = tmp_path_factory.mktemp('robot')
    (folder / 'stack.yaml').write_text(STACK)
    arguments = ['--params-file', str(CONFIG / 'demo.yaml')]
    with NodeProcess('simulator_node', arguments, domain, folder / 'simulator.log') as simulator, \
            NodeProcess('controller_node', [*arguments, '-p', f'stack:={folder / "stack.yaml"}'],
                        domain, folder / 'controller.log') as controller:
        listener = Listener()
        listener.wait(
            lambda: listener.client.status and not listener.client.stop_reason(), 'motion',
            [simulator, controller])
        # While a command runs nobody listens, and not all joint states can wait.
        listener.promise = promise_of(panda(), 0.1, math.inf)
        yield listener
        listener.client.close()
        listener.check()


@pytest.fixture
def goal(robot, domain):
    """Return what runs ``tp_controller goal``."""
    return lambda *arguments: command_line(domain, 'goal', *arguments)


def tool(listener):
    """Return where the tool is by now."""
    listener.catch_up()
    return panda().state(listener.states[-1][0]).position(PANDA_TOOL)


# Goals ----------------------------------------------------------------------------------------

def test_a_pose_goal_moves_the_robot_there(robot, goal):
    status, said, _ = goal('tool', '--xyz', '0.45', '0.2', '0.5', *DOWN, '--reach', '15')
    assert status == 0
    assert said.startswith('goal sent to task tool\nreached: error ')
    np.testing.assert_allclose(tool(robot), (0.45, 0.2, 0.5), atol=2e-3)


def test_a_goal_in_the_frame_of_the_tool_is_meant_from_there(robot, goal):
    before = tool(robot)
    status, _, _ = goal('tool', '--xyz', '0', '0', '-5e-2', '--quat', '0', '0', '0', '1',
                        '--frame', PANDA_TOOL, '--reach', '15')
    assert status == 0
    # The tool looks down.
    np.testing.assert_allclose(tool(robot), before + (0.0, 0.0, 0.05), atol=5e-3)


def test_a_goal_without_reach_is_only_sent(robot, goal):
    assert goal('posture', '--joint', 'panda_joint4=-2.0', '--joint', 'panda_joint6=1.8') == (
        0, 'goal sent to task posture\n', '')


def test_a_velocity_is_repeated_for_as_long_as_asked(robot, goal):
    before = len(robot.commands)
    status, _, _ = goal('swing', '--velocity', 'panda_joint7=-0.1', '--for', '0.5')
    assert status == 0
    # All that was commanded meanwhile is still on its way to this process.
    robot.wait(lambda: len(robot.commands) > before + 20, 'commands')
    robot.wait(lambda: robot.client.task_status('swing').accepted >= 5, 'repetition')


def test_a_way_leads_through_its_points_at_its_speed(robot, goal):
    goal('tool', '--xyz', '0.45', '0', '0.5', *DOWN, '--reach', '15')
    before = len(robot.states)
    status, said, _ = goal('tool', '--via', '0.45', '0.1', '0.5', '--xyz', '0.45', '0.1', '0.4',
                           *DOWN, '--speed', '0.2', '--reach', '15')
    assert (status, said.partition('\n')[0]) == (0, 'goal sent to task tool')
    np.testing.assert_allclose(tool(robot), (0.45, 0.1, 0.4), atol=2e-3)
    places = np.array([panda().state(q).position(PANDA_TOOL) for q, *_ in robot.states[before:]])
    assert np.linalg.norm(places - (0.45, 0.1, 0.5), axis=1).min() < 5e-3


def test_a_goal_out_of_reach_returns_1_and_says_why(goal):
    status, said, _ = goal('elbow', '--xyz', '0', '2', '0', '--reach', '1.5')
    assert status == 1
    # At whatever joint and task it comes to rest.
    assert re.search(r'^not reached: error [\d.]+ m \(the goal is 2 m from panda_link0, and out '
                     r'of reach: .+\)\nwhat would help: the goal is out of reach', said,
                     re.MULTILINE)
    assert goal('elbow', '--xyz', '0', '0', '0')[0] == 0


@pytest.mark.parametrize('arguments, told', [
    (('posture', '--joint', 'panda_joint4=1.0'),
     'refused: .*panda_joint4 = 1 is outside its limits'),
    (('posture', '--joint', 'joint4=1.0'), "refused: .*unknown joint 'joint4'"),
    (('tool', '--xyz', '0.4', '0', '0.5', '--quat', '0', '0', '0', '0'),
     'refused: .*has norm 1, this one has 0'),
    (('tool', '--xyz', '0.4', '0', '0.5', *DOWN, '--frame', 'camera'),
     "refused: frame 'camera' is not on the robot"),
    (('tool', '--xyz', '0.4', '0', '0.5'),
     r"task 'tool' needs --xyz and --rpy/--quat \(PoseStamped\), got --xyz"),
    (('tol', '--xyz', '0.4', '0', '0.5'),
     r"unknown task 'tol' \(did you mean 'tool'\?\); valid: tool, swing, elbow, posture"),
    (('posture', '--linear', '0.1', '0', '0', '--wait', '2'),
     "task 'posture' takes no --linear; its topics: goal"),
    (('tool', '--xyz', '0.4', '0', '0.5', '--node', 'arm', '--wait', '0.5'),
     'no node /arm with tasks is running'),
    (('tool', '--xyz', '0.4', '0', '0.5', '--node', 'my arm'),
     "'my arm' cannot be the name of a node"),
])
def test_a_goal_that_cannot_be_sent_or_is_refused_returns_1_with_the_reason(
        robot, capsys, arguments, told):
    # In this process, which saves the time to start another one.
    assert main(['goal', *arguments]) == 1
    said, complaint = capsys.readouterr()
    assert said == ''
    assert re.fullmatch(f'tp_controller: {told}.*\n', complaint), complaint


def test_angles_in_degrees_are_sent_in_radians(robot, goal, capsys):
    assert main(['goal', 'tool', '--xyz', '0.45', '0.2', '0.5', '--rpy', '180', '0', '0', '--deg',
                 '--reach', '15']) == 0
    assert main(['goal', 'posture', '--joint', 'panda_joint4=-115', '--deg']) == 0
    assert main(['goal', 'posture', '--joint', 'panda_joint4=-115']) == 1
    assert 'goals are in radians, not in degrees' in capsys.readouterr().err
    assert main(['goal', 'swing', '--velocity', 'panda_joint7=-10', '--deg', '--for', '0.2']) == 0
    before = len(robot.commands)
    robot.wait(lambda: len(robot.commands) > before + 20, 'commands')
    assert max(abs(command[6]) for command in robot.commands[-100:]) < 1.0
    assert main(['goal', 'posture', '--joint', 'joint4=-115', '--deg']) == 1
    assert 'cannot tell which joints turn: the controller has not all of joint4' \
        in capsys.readouterr().err


@pytest.mark.parametrize('arguments, told', [
    (('tool', '--xyz', '400', '200', '500', *DOWN),
     'the goal is 671 m from panda_link0, and out of reach: all links in a line are 1.42 m long; '
     'goals are in metres, not in millimetres'),
    (('elbow', '--xyz', '0.1', '0', '0.6'),
     'not counted: x = 0.1, z = 0.6; the axes of the task are y')])
def test_a_goal_that_is_probably_a_mistake_comes_with_a_warning(robot, capsys, arguments, told):
    assert main(['goal', *arguments]) == 0
    assert capsys.readouterr().err == f'warning: {told}\n'
    assert main(['goal', 'tool', '--xyz', '0.45', '0.2', '0.5', *DOWN]) == 0
    assert main(['goal', 'elbow', '--xyz', '0', '0', '0']) == 0
    assert capsys.readouterr().err == ''


# Status ---------------------------------------------------------------------------------------

def test_the_status_is_a_table_of_all_controllers(robot, capsys):
    assert main(['status', '--once']) == 0
    said = capsys.readouterr().out.splitlines()
    # On a busy machine it may not run at this moment.
    assert said[0].startswith('/tp_controller: ')
    assert said[1].split() == ['task', 'level', 'error', 'status', 'reason']
    assert [line.split()[:2] for line in said[2:]] == [
        ['tool', '1'], ['swing', '2'], ['elbow', '3'], ['posture', '4']]
    assert main(['status', '--once', '--node', '/tp_controller']) == 0
    assert capsys.readouterr().out.startswith('/tp_controller: ')


def test_controllers_that_are_not_there_are_named(robot, capsys):
    assert main(['status', '--once', '--wait', '0.3', '--node', 'left/arm', '--node',
                 'tp_controller']) == 1
    assert re.search('no node .*/left/arm.* with tasks is running', capsys.readouterr().err)


def test_the_status_is_drawn_in_place_on_a_terminal(robot, domain):
    shown, told = read_terminal(domain, 'status', '--period', '0.1')
    assert shown[0].startswith('\x1b[2J')
    screens = ''.join(shown).split('\x1b[H\x1b[J')[1:]
    assert len(screens) >= 3
    # A screen of 40 columns and 4 lines shows no more, and leaves the last line alone.
    assert all(len(screen.splitlines()) == 3 for screen in screens[:-1])
    assert all(len(line) <= 40 for screen in screens[:-1] for line in screen.splitlines())
    assert told == 0 and ''.join(shown).endswith('\x1b[?25h')


def read_terminal(environment, *arguments):
    """Run a command on a terminal of 40 × 4, until Ctrl-C; return what it showed, its status."""
    controller, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack('HHHH', 4, 40, 0, 0))
    process = subprocess.Popen(
        [sys.executable, '-m', 'tp_controller', *arguments], stdin=terminal, stdout=terminal,
        stderr=terminal, preexec_fn=hear_ctrl_c,
        env={key: value for key, value in environment.items() if key not in ('COLUMNS', 'LINES')})
    os.close(terminal)
    shown = []
    try:
        while ''.join(shown).count('\x1b[H') < 4:
            assert select.select([controller], [], [], DEADLINE)[0], ''.join(shown)
            shown.append(os.read(controller, 4096).decode())
        process.send_signal(signal.SIGINT)
        while True:
            assert select.select([controller], [], [], DEADLINE)[0], ''.join(shown)
            try:
                shown.append(os.read(controller, 4096).decode())
            except OSError:  # the other end is closed
                break
        return shown, process.wait(DEADLINE)
    finally:
        process.kill()
        process.wait()
        os.close(controller)


def test_the_status_is_printed_line_by_line_into_a_pipe(robot, domain):
    with subprocess.Popen([sys.executable, '-m', 'tp_controller', 'status', '--period', '0.1'],
                          env=domain, stdout=subprocess.PIPE, text=True,
                          preexec_fn=hear_ctrl_c) as process:
        tables = [process.stdout.readline() for _ in range(14)]
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE) == 130
    assert sum(line.startswith('/tp_controller: ') for line in tables) == 2
    assert '\x1b' not in ''.join(tables)


# Without nodes --------------------------------------------------------------------------------

@pytest.mark.parametrize('arguments, told', [
    (['goal', 'tool'], 'nothing to send; give --xyz, --rpy'),
    (['goal', 'tool', '--xyz', '1', '2'], 'argument --xyz: expected 3 arguments'),
    (['goal', 'tool', '--xyz', '1', '2', '-inf'], "'-inf' is not a finite number"),
    (['goal', 'tool', '--xyz', '1', '2', 'x'], "'x' is not a finite number"),
    (['goal', 'tool', '--reach', '-1'], "'-1' must be positive"),
    (['goal', 'tool', '--joint', '=1'], "'=1' is not of the form NAME=VALUE"),
    (['goal', 'tool', '--joint', 'a=nan'], "'nan' is not a finite number"),
    (['goal', 'tool', '--rpy', '0', '0', '0', '--quat', '0', '0', '0', '1'], 'not allowed with'),
    (['demo', 'lab3'], "invalid choice: 'lab3'"),
    (['demo', 'conflict'], 'tp_controller view --demo conflict'),
    (['view', '--demo', 'drill'], 'tp_controller demo drill'),
    (['view', '--demo', 'lab1'], 'tp_controller demo lab1'),
    (['demo', '--output', '/dev/null/figures'], '--output: '),
    ([], 'required: command'),
])
def test_a_command_that_makes_no_sense_returns_2_and_says_what_is_wrong(capsys, arguments, told):
    try:
        status = main(arguments)
    except SystemExit as leave:
        status = leave.code
    assert status == 2
    assert told in capsys.readouterr().err


def test_angles_of_more_than_a_turn_are_taken_for_degrees_that_were_not_meant(capsys):
    assert main(['goal', 'tool', '--rpy', '180', '0', '0']) == 2
    assert capsys.readouterr().err == (
        'tp_controller goal: --rpy 180 0 0 is in radians, and more than a turn; for degrees add '
        '--deg\n')


def test_a_table_shows_silence_errors_and_reasons():
    tasks = (TaskStatus('tool', level='1', errors={'m': 0.25, 'rad': 0.5}, status='limited',
                        reason='near a singularity', goal_warning='out of reach'),
             TaskStatus('hand', level='1', errors={'m': 0.0}, status='limited', progress=0.416,
                        reason='blocked by x'),
             TaskStatus('mobile', level='2', errors={'1': 0.01}, status='satisfied'),
             TaskStatus('elbow', level='3', errors={'m': math.nan}, status='stopped'))
    heard = {'left/arm': (ControllerStatus('left/arm', 'running', {},
                                           {task.name: task for task in tasks}), 0.1),
             'arm': (ControllerStatus('arm', 'running'), 61.4)}
    assert table(heard) == """\
/left/arm: running
  task           level    error                    status     reason
  tool           1        0.2500 m, 0.5000 rad     limited    near a singularity; out of reach
  hand           1        0.0000 m                 limited    42% of its trajectory; blocked by x
  mobile         2        0.0100                   satisfied
  elbow          3        -                        stopped

/arm: no status for 61 s
  task           level    error                    status     reason"""
    assert max(map(len, table(heard, 30).splitlines())) == 30


def test_a_table_shows_what_others_wrote_without_acting_on_it():
    """Whatever a node of the domain writes into its status."""
    task = TaskStatus('tool\x1b[2J', level='1\r', errors={'m': math.nan}, status='x\ny',
                      reason='\u202eback')
    status = ControllerStatus('arm', '\x1b]52;c;aGk=\x07', {}, {task.name: task})
    text = table({'arm\x07': (status, 0.1)})
    assert text.replace('\n', '').isprintable() and len(text.splitlines()) == 3
    assert 'tool\ufffd[2J' in text and 'nan' not in text


class Answering:
    """In place of a client: the controller says this status of a task at once."""

    def __init__(self, **status):
        self.status = TaskStatus('mobile', **status)

    def wait(self, condition, seconds):
        """Return whether the condition holds."""
        return condition()

    def task_status(self, task):
        """Return the status."""
        return self.status

    def task_names(self):
        """Return the one task."""
        return [self.status.name]

    def stop_reason(self):
        """Return that it runs."""
        return ''


@pytest.mark.parametrize('unit, shown', [('m', '0.088 m'), ('rad', '0.088 rad'), ('1', '0.088')])
def test_an_error_is_shown_with_its_unit_and_a_ratio_without(capsys, unit, shown):
    status = {'status': 'limited', 'errors': {unit: 0.088}, 'reason': 'blocked by tool'}
    options = make_parser().parse_args(['goal', 'mobile', '--reach', '1'])
    assert not _reach(Answering(**status), options)
    assert capsys.readouterr().out == f'not reached: error {shown} (blocked by tool)\n'


def test_a_status_that_makes_no_sense_does_not_end_the_command(capsys):
    options = make_parser().parse_args(['goal', 'mobile', '--reach', '1'])
    assert not _reach(Answering(status='limited', errors={'m': math.nan}), options)
    assert capsys.readouterr().out == 'not reached: error nan m\n'


@pytest.mark.parametrize('numbers', [('-1', '-2.5', '-.5'), ('-1e-3', '-2E+1', '-0.5e2')])
def test_negative_numbers_are_numbers_however_they_are_written(monkeypatch, numbers):
    taken = []
    monkeypatch.setitem(COMMANDS, 'goal', COMMANDS['goal']._replace(
        run=lambda options: taken.append(options.xyz) or 0))
    assert main(['goal', 'tool', '--xyz', *numbers, '--frame', 'base']) == 0
    assert taken == [[float(number) for number in numbers]]


@pytest.mark.parametrize('node', [controller_node, simulator_node, watchdog_node, teleop_node])
def test_the_help_of_a_node_lists_its_parameters_and_starts_nothing(monkeypatch, capsys, node):
    part = 'tools.teleop' if node is teleop_node else 'ros'
    module = importlib.import_module(f'tp_controller.{part}.{node.__name__}')
    monkeypatch.setattr(sys, 'argv', [node.__name__, '--help'])
    assert node() == 0
    said = capsys.readouterr().out
    assert said.startswith(f'usage: {node.__name__} ')
    assert re.findall(r'^  (\w+)$', said, re.MULTILINE) \
        == [spec.name for spec in module.PARAMETERS]
    assert max(map(len, said.splitlines())) < 100


@pytest.mark.parametrize('module', ['ros.controller_node', 'ros.simulator_node',
                                    'ros.watchdog_node', 'tools.teleop.teleop_node'])
def test_the_help_of_a_module_starts_nothing_either(domain, module):
    status, said, _ = command_line(domain, '--help', module=f'tp_controller.{module}')
    name = module.rpartition('.')[2]
    assert status == 0 and said.startswith(f'usage: {name} ') and '\nparameters:\n' in said


def test_the_package_is_the_command(tmp_path):
    found = subprocess.run([sys.executable, '-m', 'tp_controller', '--version'], cwd=tmp_path,
                           capture_output=True, text=True, timeout=DEADLINE)
    assert (found.returncode, found.stdout.strip()) == (
        0, f'{version("tp_controller")}, solver: {running()}')


@pytest.mark.parametrize(('line', 'completed'), [
    ('tp_controller de', {'demo'}), ('tp_controller demo under', {'underwater'}),
    ('tp_controller goal --re', {'--reach'})])
def test_a_shell_completes_commands(tmp_path, line, completed):
    answer = tmp_path / 'completions'
    environment = {**os.environ, '_ARGCOMPLETE': '1', '_ARGCOMPLETE_STDOUT_FILENAME': str(answer),
                   '_ARGCOMPLETE_IFS': ':', 'COMP_LINE': line, 'COMP_POINT': str(len(line))}
    subprocess.run([sys.executable, '-c', 'from tp_controller.tools.cli.main import main; main()'],
                   env=environment, timeout=DEADLINE)
    assert {text.strip() for text in answer.read_text().split(':')} == completed


@pytest.mark.parametrize('command', [(), ('demo',), ('goal',), ('status',)])
def test_help_is_shown(capsys, command):
    with pytest.raises(SystemExit) as leave:
        main([*command, '--help'])
    assert leave.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(' '.join(('usage: tp_controller', *command)))
    assert 'examples:\n' in said


def examples():
    """Return every example line of the help texts."""
    texts = [EXAMPLES, *[command.examples for command in COMMANDS.values()]]
    lines = [line.strip() for text in texts for line in text.splitlines()]
    # What stands after two spaces tells what the command is for.
    return [re.split(r'\s{2,}', line)[0] for line in lines if line.startswith('tp_controller ')]


@pytest.mark.parametrize('line', examples())
def test_every_example_of_the_help_is_a_valid_command(capsys, line):
    arguments = shlex.split(line)[1:]
    if arguments[-1] == '--help':
        with pytest.raises(SystemExit):
            make_parser().parse_args(arguments)
    else:
        assert callable(make_parser().parse_args(arguments).run)


def test_the_ros2_example_of_the_help_names_a_message_and_its_fields(domain):
    from geometry_msgs.msg import PointStamped
    text = re.search(r'PointStamped \\\n\s*"(.*)"', COMMANDS['goal'].examples)[1]
    (field, values), = yaml.safe_load(text).items()
    point = getattr(PointStamped(), field)
    for axis, value in values.items():
        setattr(point, axis, value)
    assert (point.x, point.y, point.z) == (0.0, 0.0, 0.6)


# Demos ----------------------------------------------------------------------------------------

def check_images(folder, names):
    """Check that images can be read and show something."""
    for name in names:
        with Image.open(folder / name) as image:
            assert min(image.size) >= 200
            assert np.ptp(np.asarray(image.convert('L'))) > 100


def test_the_lab_demo_runs_from_the_command_line(environment, tmp_path):
    folder = tmp_path / 'figures'
    status, said, _ = command_line(environment, 'demo', 'lab1', '--output', str(folder))
    assert status == 0
    written = [path.name for path in (folder / 'lab1').iterdir()]
    assert written and all(f'lab1/{name}' in said for name in written)
    check_images(folder / 'lab1', written)


def test_a_demo_without_a_chromium_writes_all_but_the_film(environment, tmp_path):
    given = {key: text for key, text in environment.items() if key != 'TP_CONTROLLER_FILM'}
    status, said, complaint = command_line({**given, 'PATH': str(tmp_path)}, 'demo', 'lab1',
                                           '--output', str(tmp_path))
    assert status == 0 and 'apt install chromium' in complaint
    assert sorted(path.name for path in (tmp_path / 'lab1').iterdir()) == [
        'lab1_error.png', 'lab1_positions.png']
    assert 'end-effector error, largest' in said and 'lab1_error.png' in said


@pytest.mark.skipif(find_spec('rclpy') is None, reason='needs ROS 2')
@pytest.mark.parametrize('name, output, asked', [
    ('panda', 'velocity', ['tool', 'tool', 'elbow', 'elbow', 'tool']),
    ('mobile', 'position', ['tray', 'tray', 'lift']),
    ('underwater', 'velocity', ['tool', 'station', 'tool', 'heading']),
    ('two_arms', 'trajectory', ['carry', 'carry', 'elbow'])])
def test_the_demo_of_a_robot_reaches_its_goals_within_limits(environment, tmp_path, name, output,
                                                             asked):
    status, said, complaint = command_line(environment, 'demo', name, '--output', str(tmp_path),
                                           '--commands', output, seconds=120.0)
    assert status == 0, said + complaint
    outcomes = re.findall(r'> (\w+) .*?(\S.*)$', said, re.MULTILINE)
    outcomes = [(task, text) for task, text in outcomes if task != 'marks']
    assert [task for task, _ in outcomes] == asked
    assert all(text.endswith('reached') and 'not reached' not in text for _, text in outcomes)
    folder = tmp_path / name
    check_images(folder, ['errors.png', 'velocities.png', 'tool_path.png'])
    for node in ('controller_node.log', 'simulator_node.log'):
        assert 'ERROR' not in (folder / node).read_text()


def test_a_demo_that_is_ended_takes_its_nodes_with_it(domain, tmp_path):
    demo = subprocess.Popen([sys.executable, '-m', 'tp_controller', 'demo', '--output',
                             str(tmp_path)], env=domain, stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE)
    listed = Path(f'/proc/{demo.pid}/task/{demo.pid}/children')
    waiting = Listener()
    nodes = set()

    def started():
        nodes.update(int(number) for number in listed.read_text().split())
        return len(nodes) == 2

    def alive():
        return [number for number in nodes if Path(f'/proc/{number}').exists()]

    try:
        waiting.wait(started, 'the nodes')
        demo.terminate()
        assert demo.wait(2.0 * DEADLINE) == 143
        assert b'Traceback' not in demo.stderr.read()
        assert not alive()
    finally:
        demo.kill()
        for number in alive():
            os.kill(number, signal.SIGKILL)
        demo.stderr.close()
        waiting.client.close()

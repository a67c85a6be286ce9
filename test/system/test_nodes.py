# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The nodes as processes: how they start, how they end, and what happens when one is gone."""

from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

from monitor import promise_of
from processes_harness import DEADLINE
import pytest
import rclpy
from robots import panda, PANDA_DH, PLANAR_DH, REPOSITORY
from tp_controller.tools.demos.processes import NodeProcess

ALL_MISSING = 'no joint states of joint1, joint2, joint3'


def lines_of(node, word):
    """Return the lines of a node's output that contain a word."""
    return [line for line in node.output().splitlines() if word in line]


# Ends -----------------------------------------------------------------------------------------

@pytest.mark.parametrize('number', [
    signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_ends_the_nodes_with_a_last_zero_and_status_0(cell, listener, number):
    controller, simulator = cell
    controller.process.send_signal(number)
    assert controller.process.wait(DEADLINE) == 0
    listener.wait(lambda: not listener.moving(), 'a last zero')
    assert not lines_of(controller, 'Traceback')
    simulator.process.send_signal(number)
    assert simulator.process.wait(DEADLINE) == 0
    assert not lines_of(simulator, 'Traceback')


@pytest.mark.parametrize('number', [
    signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
@pytest.mark.parametrize('executable, name', [
    ('watchdog_node', 'tp_watchdog'), ('viewer_node', 'tp_viewer'),
    ('teleop_node', 'tp_teleop')])
def test_a_signal_ends_the_nodes_beside_the_controller_with_status_0(
        start, listener, executable, name, number):
    if executable == 'viewer_node':
        pytest.importorskip('viser')
    given = ['-p', 'x:=axis 1'] if executable == 'teleop_node' else []
    node = start(executable, *given, robot=None)
    listener.wait(lambda: name in listener.client.node.get_node_names(), 'the node', [node])
    if executable == 'viewer_node':
        # A start that takes longer than a signal waits for is ended by force.
        listener.wait(lambda: lines_of(node, 'the page is at'), 'the page', [node])
    node.process.send_signal(number)
    assert node.process.wait(DEADLINE) == 0, node.output()
    assert not lines_of(node, 'Traceback')
    assert listener.commands == []


def test_two_signals_at_once_end_the_controller_just_as_well(cell, listener):
    controller, _ = cell
    # A launch file's shell sends both.
    controller.process.send_signal(signal.SIGINT)
    controller.process.send_signal(signal.SIGINT)
    controller.process.send_signal(signal.SIGTERM)
    assert controller.process.wait(DEADLINE) == 0
    listener.wait(lambda: not listener.moving(), 'a last zero')
    assert not lines_of(controller, 'Traceback')


def test_a_killed_controller_leaves_a_robot_that_stops_by_itself(cell, listener):
    controller, simulator = cell
    listener.wait(lambda: listener.states and listener.states[-1][1].any(), 'motion', [simulator])
    controller.process.kill()
    listener.wait(lambda: not listener.states[-1][1].any(), 'standstill', [simulator])
    stopped = listener.states[-1][0]
    listener.wait_for_more(listener.states)
    assert (listener.states[-1][0] == stopped).all()
    assert (stopped < 1.0).all()


def test_a_killed_simulator_leaves_a_controller_that_commands_zeros(cell, listener, start):
    controller, simulator = cell
    simulator.process.kill()
    listener.wait(lambda: listener.client.stop_reason() == ALL_MISSING, 'the reason', [controller])
    listener.wait(lambda: not listener.moving(), 'zeros', [controller])
    listener.wait_for_more(listener.commands, 5)
    assert not any(command.any() for command in listener.commands[-5:])
    # It goes on by itself with a new one.
    listener.expect_another_simulator()
    simulator = start('simulator_node')
    listener.wait(listener.moving, 'motion', [controller, simulator])
    # Before, nobody knows here what the controller has heard of it.
    listener.catch_up()


def test_a_signal_ends_a_node_that_still_waits_for_its_robot(start, listener):
    controller = start('controller_node', robot=None)
    listener.wait(lambda: listener.client.stop_reason() == 'no robot description yet', 'status',
                  [controller])
    controller.process.send_signal(signal.SIGTERM)
    assert controller.process.wait(DEADLINE) == 0
    assert listener.commands == []


# Faults at the start --------------------------------------------------------------------------

FAULTS = [
    ('controller_node', ['-p', 'rate:=true'],
     'parameter rate must be a number, such as 1.0, not True'),
    ('controller_node', ['-p', 'rate:=-1.0', '-p', 'state_timeout:=a'],
     'parameter rate must be from 0 to 2000, not -1.0; parameter state_timeout must be a number'),
    ('controller_node', ['-p', 'limits.joint9.velocity:=1.0'],
     'unknown parameter limits.joint9.velocity'),
    ('controller_node', ['-p', 'command_joints:=[joint1, joint9]'], 'parameter command_joints'),
    ('controller_node', ['-p', 'robot:=/nowhere/arm.urdf'], 'no file /nowhere/arm.urdf'),
    ('controller_node', ['--params-file', '/nowhere/parameters.yaml'],
     '/nowhere/parameters.yaml'),
    ('controller_node', ['--params-file', '{folder}/list.yaml'], '{folder}/list.yaml'),
    ('controller_node', ['--nonsense'], '--nonsense'),
    ('simulator_node', ['-p', 'robot:={folder}/broken.urdf'],
     'robot description: not valid XML'),
    ('simulator_node', ['-p', 'robot:={folder}/broken.yaml'], 'joints, row 1'),
    ('simulator_node', ['-p', 'speed:=0.0'], 'parameter speed must be from 0.01 to 1000'),
]


@pytest.mark.parametrize('executable, arguments, told', FAULTS)
def test_a_fault_at_the_start_ends_a_node_with_one_plain_line(start, tmp_path, executable,
                                                              arguments, told):
    (tmp_path / 'list.yaml').write_text('tp_controller: [1, 2\n')
    (tmp_path / 'broken.urdf').write_text('<robot name="arm">')
    (tmp_path / 'broken.yaml').write_text('joints: [{a: one}]')
    told = told.replace('{folder}', str(tmp_path))
    node = start(executable, *(text.replace('{folder}', str(tmp_path)) for text in arguments))
    assert node.process.wait(DEADLINE) == 1
    line, = lines_of(node, 'FATAL')
    assert told in line
    assert not lines_of(node, 'Traceback')


@pytest.mark.skipif(rclpy.get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp',
                    reason='is about Fast DDS')
@pytest.mark.parametrize('asked, shared', [({}, False),
                                           ({'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}, True)])
def test_nodes_share_no_memory_that_a_suspended_process_may_lock(domain, tmp_path, asked, shared):
    environment = {**domain, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', **asked}
    with NodeProcess('simulator_node', ['-p', f'robot:={PLANAR_DH}'], environment,
                     tmp_path / 'simulator.log') as node:
        end = time.monotonic() + DEADLINE
        while not lines_of(node, 'simulating'):
            assert node.running() and time.monotonic() < end, node.output()
            time.sleep(0.02)
        threads = [path.read_text() for path in Path('/proc').glob(
            f'{node.process.pid}/task/*/comm')]
    assert any(name.startswith('dds.udp') for name in threads)
    assert any(name.startswith('dds.shm') for name in threads) == shared


def test_a_faulty_stack_leaves_the_node_alive_with_zeros_and_every_fault_said(
        start, listener, tmp_path):
    path = tmp_path / 'stack.yaml'
    path.write_text('- swing: {type: joint, joints: joint9}\n- tip: {type: pose}\n- a b: {}\n')
    nodes = start('controller_node', '-p', f'stack:={path}'), start('simulator_node')
    listener.wait(lambda: listener.client.stop_reason().startswith('no valid stack'), 'status',
                  nodes)
    for fault in ("line 1: swing, joints: unknown driven joint or group 'joint9'",
                  "line 2: tip: needs the key 'frame'", 'line 3: '):
        assert fault in listener.client.stop_reason()
        assert fault in nodes[0].output()
    listener.wait_for_more(listener.commands, 10)
    assert not any(command.any() for command in listener.commands)


def test_the_description_can_come_from_the_simulator(start, listener):
    stack = '"[{rest: {type: posture}}]"'
    listener.promise = promise_of(panda(), 0.01, 0.1)
    nodes = (start('controller_node', '-p', f'stack:={stack}', robot=None),
             start('simulator_node', robot=PANDA_DH))
    listener.wait(lambda: listener.client.task_status('rest').status == 'reached',
                  'the posture', nodes)
    # Status and commands are topics of their own, and the other one may be found first.
    listener.wait(lambda: listener.commands, 'a command', nodes)
    assert len(listener.commands[-1]) == 7


def test_a_node_that_outlives_its_owner_keeps_its_domain(environment, tmp_path):
    from tp_controller.tools.demos.processes import NodeProcess, own_domain
    with own_domain() as first:
        node = NodeProcess('controller_node', [], {**environment, **first},
                           tmp_path / 'node.log')
    try:
        with own_domain() as second:
            assert second['ROS_DOMAIN_ID'] != first['ROS_DOMAIN_ID']
    finally:
        node.process.kill()
        node.process.wait()


OWNER = """
import os, sys
from tp_controller.tools.demos.processes import NodeProcess
node = NodeProcess('simulator_node', ['-p', 'robot:=' + sys.argv[1]], os.environ, sys.argv[2])
print(node.process.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(shutil.which('setpriv') is None, reason='needs setpriv (util-linux)')
def test_nodes_end_with_their_owner_even_if_it_is_killed(domain, tmp_path):
    log = tmp_path / 'simulator.log'
    with subprocess.Popen([sys.executable, '-c', OWNER, str(PLANAR_DH), str(log)], env=domain,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        node = Path('/proc', owner.stdout.readline().strip(), 'stat')
        end = time.monotonic() + DEADLINE
        while 'simulating' not in log.read_text():
            assert owner.poll() is None and time.monotonic() < end, log.read_text()
            time.sleep(0.02)
        owner.kill()
    # What has ended may wait for its new parent to notice.
    while node.exists() and node.read_text().rpartition(')')[2].split()[0] != 'Z':
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.02)


def test_two_domains_of_their_own_are_never_the_same(domain):
    from tp_controller.tools.demos.processes import own_domain
    with own_domain() as first, own_domain() as second:
        assert len({environment['ROS_DOMAIN_ID'] for environment in (domain, first, second)}) == 3
        assert first['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


# Watched from within --------------------------------------------------------------------------

def test_benchmark_of_the_gaps_prints_a_table():
    done = subprocess.run([sys.executable, str(REPOSITORY / 'benchmarks' / 'gaps.py'),
                           '--seconds', '0.5', '--only', 'none', 'refused goals'],
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [line.split('|') for line in done.stdout.splitlines()]
    assert [row[1].strip() for row in rows[2:]] == ['none', 'refused goals, 5000/s']
    assert all(float(cell) > 0.0 for row in rows[2:] for cell in row[2:6])


def test_a_few_seconds_of_the_endurance_run_break_no_promise():
    done = subprocess.run([sys.executable, str(REPOSITORY / 'benchmarks' / 'endurance.py'),
                           '--hours', '0.003', '--rate', '100'],
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    minutes, *_, crashes, broken = done.stdout.splitlines()[2].split('|')[1:-1]
    assert float(minutes) > 0.0 and (int(crashes), int(broken)) == (0, 0)


def test_benchmark_of_the_markers_prints_a_table():
    done = subprocess.run([sys.executable, str(REPOSITORY / 'benchmarks' / 'markers.py'),
                           '--times', '5'], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [line.split('|')[1:-1] for line in done.stdout.splitlines()[2:]]
    assert len(rows) == 4 and all(int(row[2]) >= 4 for row in rows)


def test_benchmark_of_goals_prints_a_table():
    done = subprocess.run([sys.executable, str(REPOSITORY / 'benchmarks' / 'goals.py'),
                           '--rounds', '1'], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [line.split('|')[1:-1] for line in done.stdout.splitlines()[2:]]
    assert len(rows) == 3 and all(float(row[1]) > 0.0 for row in rows)


def test_benchmark_of_the_node_prints_a_table():
    done = subprocess.run([sys.executable, str(REPOSITORY / 'benchmarks' / 'node.py'),
                           '--seconds', '0.5'], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = [line.split('|') for line in done.stdout.splitlines()]
    assert len(rows[2:]) == 9
    assert all(float(row[3]) > 0.0 for row in rows[2:])

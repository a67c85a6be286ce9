# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the command line imports before it knows which command is meant."""

import os
import subprocess
import sys

import pytest
from robots import PLANAR_DH, REPOSITORY
from tp_controller.tools.cli.main import OUTPUT_CLOSED

# Each takes a fifth of a second and more.
SLOW = ('numpy', 'scipy', 'pinocchio', 'rclpy', 'matplotlib', 'viser')


def test_what_takes_long_to_import_is_left_to_the_commands_that_need_it():
    """As `tp_controller goal`, which answers in less than a second, and completion in a shell."""
    program = ('import sys, tp_controller.tools.cli.main\n'
               f'print(*sorted({set(SLOW)} & set(sys.modules)))')
    done = subprocess.run([sys.executable, '-c', program], cwd=REPOSITORY, capture_output=True,
                          text=True, timeout=60, check=True)
    assert done.stdout.split() == []


GOAL_AND_STATUS = """
import argparse, sys
from tp_controller.tools.cli import goal
from tp_controller.tools.cli import status
from tp_controller.ros.client import client
from tp_controller.ros.client import status_monitor as watch
from tp_controller.ros.client.status import TaskStatus

class Client:
    def wait(self, done, seconds):
        return done()

    def task_status(self, task):
        return TaskStatus(task, status='moving', errors={'m': 0.25}, reason='far', hint='wait')

    def task_names(self):
        return ['tool']

    def stop_reason(self):
        return ''

goal._reach(Client(), argparse.Namespace(task='tool', reach=1.0))
print(*sorted({'pinocchio', 'tp_controller.tasks', 'scipy'} & set(sys.modules)))
"""


@pytest.mark.slow
def test_a_goal_is_sent_and_waited_for_without_the_kinematics():
    """To import Pinocchio takes longer than to send a goal."""
    pytest.importorskip('rclpy')
    done = subprocess.run([sys.executable, '-c', GOAL_AND_STATUS], cwd=REPOSITORY,
                          capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines() == [
        'not reached: error 0.25 m (far)', 'what would help: wait', '']


# What there is without a compiler.
WITHOUT_CORE = """
import sys
sys.modules['tp_controller.core.extension'] = None
from tp_controller.tools.cli import main
sys.exit(eval(sys.argv[1]))
"""


@pytest.mark.parametrize('call', [
    "main.main(['--version'])", "main.main(['demo', 'lab1', '--out', '/nowhere'])",
    "main.main(['check', '- tip: {type: posture}', '--robot', 'config/robots/planar_3r.yaml'])",
    'main.controller_node()', 'main.simulator_node()'])
@pytest.mark.slow
def test_core_that_is_wanted_and_missing_ends_a_command_in_one_line(call):
    if 'node' in call:
        pytest.importorskip('rclpy')
    done = subprocess.run(
        [sys.executable, '-c', WITHOUT_CORE, call], cwd=REPOSITORY, capture_output=True, text=True,
        timeout=60, env={**os.environ, 'TP_CONTROLLER_SOLVER': 'compiled'})
    line, = done.stderr.splitlines()
    assert line.startswith(
        'tp_controller: TP_CONTROLLER_SOLVER is compiled, but the compiled core is missing')
    assert done.returncode == 2 and done.stdout == ''


def test_output_that_nobody_reads_to_the_end_leaves_no_traceback():
    """As of `tp_controller ik … | head`, with a buffer and without."""
    for unbuffered in ('', '1'):
        read, write = os.pipe()
        os.close(read)
        with os.fdopen(write) as output:
            done = subprocess.run(
                [sys.executable, '-m', 'tp_controller', 'ik',
                 '- p: {type: joint, joints: joint1, target: [0.5]}', '--robot',
                 str(PLANAR_DH)], cwd=REPOSITORY, text=True, stdout=output,
                stderr=subprocess.PIPE, timeout=60,
                env={**os.environ, 'PYTHONUNBUFFERED': unbuffered})
        assert not done.stderr
        assert done.returncode == OUTPUT_CLOSED

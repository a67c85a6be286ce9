# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The keys of a terminal move a robot, and the end of the command stops it."""

import os
import signal
import subprocess
import sys
import termios

from processes_harness import DEADLINE, hear_ctrl_c
import pytest

STACK = '[carry: {type: twist, frame: link3, axes: xy}]'


@pytest.fixture
def terminal():
    """Return both ends of a terminal: that of the keyboard, and that of the program."""
    ends = os.openpty()
    yield ends
    for end in ends:
        os.close(end)


@pytest.mark.parametrize('end', ['q', signal.SIGTERM, signal.SIGINT])
def test_a_key_moves_the_robot_until_the_command_ends(domain, start, listener, terminal, end):
    nodes = (start('controller_node', '-p', f"stack:='{STACK}'"),
             start('simulator_node', '-p', "initial_positions:='{joint2: 0.8, joint3: 0.5}'"))
    listener.wait(lambda: not listener.client.stop_reason(), 'the controller', nodes)
    outer, inner = terminal
    before = termios.tcgetattr(inner)
    program = subprocess.Popen(
        [sys.executable, '-m', 'tp_controller', 'teleop', 'carry'], env=domain, stdin=inner,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, preexec_fn=hear_ctrl_c)

    def pressed():
        # Keys of before the first answer wait in the terminal.
        os.write(outer, b'w')
        return listener.moving()

    listener.wait(pressed, 'motion', nodes)
    if end == 'q':
        os.write(outer, b'q')
    else:
        program.send_signal(end)
    said, _ = program.communicate(timeout=DEADLINE)
    assert program.returncode == 0, said
    assert b'space stop' in said and b'driving' in said
    assert termios.tcgetattr(inner) == before
    listener.wait(lambda: not listener.moving(), 'standstill', nodes)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Time `tp_controller goal`, from the shell's point of view, beside commands that do less.

Run as ``python benchmarks/goals.py`` (or ``make bench``). A simulated Panda and its controller run
as processes of their own and stand at a goal of theirs, and the commands come one after the other,
in turns: an interpreter that does nothing, a ROS node that starts and ends, and a goal, which is
found, sent and answered. Times of the whole command, by the clock.
"""

import argparse
from contextlib import ExitStack
from pathlib import Path
import subprocess
import sys
import tempfile
import time

import numpy as np
from tp_controller.resources import package_share
from tp_controller.tools.demos.processes import NodeProcess, own_domain

TASK = 'elbow'
COMMANDS = {
    'python, nothing': ['-c', ''],
    'a ROS node that ends': ['-c', 'import rclpy; rclpy.init(); rclpy.create_node("node")'],
    'tp_controller goal': ['-m', 'tp_controller', 'goal', TASK, '--xyz', '0', '0.1', '0'],
}


def measure(rounds, environment):
    """Return how long each command took (rounds,) [s]."""
    seconds = {name: [] for name in COMMANDS}
    # In the first round the nodes are still starting.
    for measured in [False] + rounds * [True]:
        for name, arguments in COMMANDS.items():
            begin = time.monotonic()
            subprocess.run([sys.executable, *arguments], env=environment, check=True,
                           stdout=subprocess.DEVNULL)
            if measured:
                seconds[name].append(time.monotonic() - begin)
    return seconds


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=30, help='how often each command runs')
    options = parser.parse_args()
    arguments = ['--params-file', str(package_share() / 'config' / 'demo.yaml')]
    with own_domain() as environment, ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        # Discovery as users have it by default.
        environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
        for node in ('simulator_node', 'controller_node'):
            stack.enter_context(NodeProcess(node, arguments, environment, folder / f'{node}.log'))
        print('| command | median [s] | fastest | slowest |')
        print('| --- | --- | --- | --- |')
        for name, seconds in measure(options.rounds, environment).items():
            print(f'| {name} | ' + ' | '.join(
                f'{value:.2f}' for value in np.percentile(seconds, [50, 0, 100])) + ' |')


if __name__ == '__main__':
    main()

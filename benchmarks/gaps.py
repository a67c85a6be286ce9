# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Gaps between the commands of the controller node while much else is asked of it.

Run as ``python benchmarks/gaps.py`` (or ``make bench``). For each load a controller and a
simulator of the Panda run as processes; a third process makes the load, and this one hears the
commands. The gap is the time between the sending of two commands, by the clock of the sender.
With a full disk the log directory is a file system of 16 KiB, where mounting is permitted.
"""

import argparse
from collections.abc import Callable
import itertools
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from geometry_msgs.msg import PoseStamped
import numpy as np
from rclpy import init, try_shutdown
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tp_controller.tools.demos.processes import NodeProcess, own_domain

ROBOT = 'package://tp_controller/config/robots/panda.yaml'
START = '{panda_joint2: -0.785, panda_joint4: -2.356, panda_joint6: 1.571, panda_joint7: 0.785}'
CAPSULES = 'package://tp_controller/config/panda_capsules.yaml'
STACK = f"""- clear: {{type: self_collision, capsules: {CAPSULES}}}
- tool: {{type: pose, frame: panda_hand_tcp}}
- posture: {{type: posture, gain: 0.5}}
"""
TOPIC = '/velocity_controller/commands'
PATIENCE_SECONDS = 20.0


# Loads ------------------------------------------------------------------------------------

def goals(node: Node, good: bool) -> Callable[[int], None]:
    """Return what sends goals that are taken, or refused."""
    publisher = node.create_publisher(PoseStamped, '/tp_controller/tool/goal', 10)
    message = PoseStamped()
    message.pose.position.x, message.pose.position.z = 0.4, 0.5
    message.pose.orientation.w = 0.0
    message.pose.orientation.x = 1.0 if good else float('nan')
    return lambda count: publisher.publish(message)


def parameters(node: Node) -> Callable[[int], None]:
    """Return what sets a parameter."""
    client = AsyncParameterClient(node, 'tp_controller')
    return lambda count: client.set_parameters(
        [Parameter('damping', value=0.1 + 0.01 * (count % 2))])


def switch(node: Node) -> Callable[[int], None]:
    """Return what enables and disables a task."""
    client = node.create_client(SetBool, '/tp_controller/posture/enable')
    return lambda count: client.call_async(SetBool.Request(data=bool(count % 2)))


def reload(node: Node) -> Callable[[int], None]:
    """Return what has the stack file read again."""
    client = node.create_client(Trigger, '/tp_controller/reload')
    return lambda count: client.call_async(Trigger.Request())


# Name: how many each second, and what makes it.
LOADS = {
    'none': (0.0, lambda node: lambda count: None),
    'goals': (5000.0, lambda node: goals(node, True)),
    'refused goals': (5000.0, lambda node: goals(node, False)),
    'parameters': (100.0, parameters),
    'enable': (100.0, switch),
    'reload, self_collision': (50.0, reload),
    'refused goals, disk full': (5000.0, lambda node: goals(node, False)),
}


def make_load(name: str) -> None:
    """Make a load until somebody ends this process."""
    rate, make = LOADS[name]
    init(args=[])
    node = Node('load')
    act, executor = make(node), SingleThreadedExecutor()
    executor.add_node(node)
    due = time.monotonic()
    for count in itertools.count():
        act(count)
        due = max(due + 1.0 / rate, time.monotonic() - 0.1)
        if count % 10 == 0:
            # Answers are dropped.
            executor.spin_once(timeout_sec=0.0)
        time.sleep(max(0.0, due - time.monotonic()))


# Measurement ------------------------------------------------------------------------------

class Ear(Node):
    """Notes when commands were sent."""

    def __init__(self) -> None:
        super().__init__('ear')
        self.sent: list[float] = []
        self.create_subscription(Float64MultiArray, TOPIC, self._on_command,
                                 QoSProfile(depth=5000))

    def _on_command(self, message, info):
        self.sent.append(1e-9 * info['source_timestamp'])


class FullDisk(NodeProcess):
    """A controller whose log directory is on a file system that is full at once."""

    def __init__(self, arguments, environment, folder):
        self.log = folder / 'controller.log'
        mounted = folder / 'full'
        mounted.mkdir()
        script = ('mount -t tmpfs -o size=16k none "$1" && '
                  '(dd if=/dev/zero of="$1/full" 2> /dev/null; true) && shift && exec "$@"')
        with open(self.log, 'w') as output:
            self.process = subprocess.Popen(
                ['unshare', '--user', '--map-root-user', '--mount', 'sh', '-c', script, 'sh',
                 str(mounted), sys.executable, '-m', 'tp_controller.ros.controller_node',
                 '--ros-args', *arguments], env={**environment, 'ROS_LOG_DIR': str(mounted)},
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT)


def measure(name, rate, seconds, environment, folder):
    """Return when commands were sent under a load [s], and how much was logged [bytes]."""
    folder.mkdir()
    (folder / 'stack.yaml').write_text(STACK)
    arguments = ['-p', f'robot:={ROBOT}', '-p', f'rate:={rate}', '-p',
                 f'stack:={folder / "stack.yaml"}']
    simulated = ['-p', f'robot:={ROBOT}', '-p', f"initial_positions:='{START}'"]
    controller = FullDisk(arguments, environment, folder) if 'disk' in name else \
        NodeProcess('controller_node', arguments, environment, folder / 'controller.log')
    ear, executor = Ear(), SingleThreadedExecutor()
    executor.add_node(ear)
    load = None

    def listen(until):
        end = time.monotonic() + PATIENCE_SECONDS
        while not until():
            assert time.monotonic() < end, 'no commands'
            assert controller.running(), controller.output()
            executor.spin_once(timeout_sec=0.01)

    try:
        with controller, NodeProcess('simulator_node', simulated, environment,
                                     folder / 'simulator.log'):
            listen(lambda: len(ear.sent) > rate and 'running' in controller.output())
            if LOADS[name][0]:
                load = subprocess.Popen([sys.executable, __file__, '--load', name],
                                        env=environment)
            # Until it is heard.
            begin = time.monotonic() + 2.0
            listen(lambda: time.monotonic() > begin)
            ear.sent.clear()
            end, before = begin + seconds, controller.log.stat().st_size
            listen(lambda: time.monotonic() > end)
            return np.array(ear.sent), controller.log.stat().st_size - before
    finally:
        if load is not None:
            load.kill()
            load.wait()
        executor.shutdown()
        ear.destroy_node()


def may_mount():
    """Return whether a file system can be mounted by anybody."""
    try:
        return subprocess.run(['unshare', '--user', '--map-root-user', '--mount', 'mount', '-t',
                               'tmpfs', '-o', 'size=16k', 'none', '/mnt'],
                              capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=10.0, help='length of each run')
    parser.add_argument('--rate', type=float, default=100.0, help='of the controller [Hz]')
    parser.add_argument('--only', choices=LOADS, nargs='+', default=[*LOADS], help='some loads')
    parser.add_argument('--load', choices=LOADS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.load:
        make_load(options.load)
    print('| load | commands per second | gap [ms]: median | 99 % | longest | '
          'above two cycles | log [kB/s] |')
    print('| --- | --- | --- | --- | --- | --- | --- |')
    with own_domain() as environment, tempfile.TemporaryDirectory() as folder:
        # Over UDP as by default; where nodes are only looked for on this machine, DDS always uses
        # shared memory, and now and then it takes a third of a second to publish.
        environment.update(ROS_AUTOMATIC_DISCOVERY_RANGE='SUBNET',
                           FASTDDS_BUILTIN_TRANSPORTS='UDPv4')
        os.environ.update(environment)
        init(args=[])
        for number, name in enumerate(options.only):
            if 'disk' in name and not may_mount():
                print(f'| {name} | mounting is not permitted here | | | | | |', flush=True)
                continue
            sent, logged = measure(name, options.rate, options.seconds, environment,
                                   Path(folder) / str(number))
            gaps = np.diff(sent)
            much = 100.0 * np.mean(gaps > 2.0 / options.rate)
            often = f', {LOADS[name][0]:.0f}/s' if LOADS[name][0] else ''
            print(f'| {name}{often} | {len(sent) / options.seconds:.1f} | '
                  f'{1e3 * np.median(gaps):.2f} | {1e3 * np.percentile(gaps, 99):.2f} | '
                  f'{1e3 * gaps.max():.1f} | {much:.2g} % | '
                  f'{1e-3 * logged / options.seconds:.2g} |', flush=True)
        try_shutdown()


if __name__ == '__main__':
    main()

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Run the controller node for hours, with a fault every second.

Run as ``python benchmarks/endurance.py --hours 1``; by default it is a minute. A controller and a
simulator of the Panda run as processes at 1 kHz. Every second one of them is stopped for a
while, or killed, or something wrong is sent, or an unusual service is called; afterwards the
controller is started again if it has stopped. A monitor hears every command.
"""

import argparse
from contextlib import suppress
import importlib
import itertools
import math
import os
from pathlib import Path
import signal
import sys
import tempfile
import time

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
from rclpy import init, try_shutdown
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tp_controller import Robot
from tp_controller.tools.demos.processes import NodeProcess, own_domain

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
monitor = importlib.import_module('monitor')

ROBOT = 'package://tp_controller/config/robots/panda.yaml'
START = '{panda_joint2: -0.785, panda_joint4: -2.356, panda_joint6: 1.571, panda_joint7: 0.785}'
CAPSULES = 'package://tp_controller/config/panda_capsules.yaml'
STACK = f"""- clear: {{type: self_collision, capsules: {CAPSULES}}}
- tool: {{type: pose, frame: panda_hand_tcp}}
- posture: {{type: posture, gain: 0.5}}
"""
ACCELERATIONS = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
TIMEOUT = 0.1
# By how much a message may be late on a machine that has something else to do [s].
LATE = 0.4
PAGE = os.sysconf('SC_PAGE_SIZE')
NAMES = tuple(f'panda_joint{number}' for number in range(1, 8))


class Tester(Node):
    """Hears commands and joint states, and does what nobody should."""

    def __init__(self, seed):
        super().__init__('tester')
        self.random = np.random.default_rng(seed)
        self.monitor, self._number, self.q = monitor.Monitor(), 0, None
        self.create_subscription(Float64MultiArray, '/velocity_controller/commands',
                                 self._on_command, QoSProfile(depth=5000))
        self.create_subscription(JointState, '/joint_states', self._on_state,
                                 QoSProfile(depth=5000))
        self.states = self.create_publisher(JointState, '/joint_states', 10)
        self.goals = self.create_publisher(PoseStamped, '/tp_controller/tool/goal', 10)
        self.buttons = {name: self.create_client(Trigger, f'/tp_controller/{name}')
                        for name in ('stop', 'start', 'reload')}
        self.switch = self.create_client(SetBool, '/tp_controller/posture/enable')
        self.change = self.create_client(ChangeState, '/tp_controller/change_state')
        self.knobs = AsyncParameterClient(self, 'tp_controller')

    def _on_command(self, message, info):
        number = info['publication_sequence_number']
        self.monitor.command(1e-9 * info['source_timestamp'], message.data,
                             max(number - self._number, 1))
        self._number = number

    def _on_state(self, message, info):
        # What this node makes up comes with a frame.
        if not message.header.frame_id:
            self.q = np.array(message.position)
            self.monitor.position(1e-9 * info['source_timestamp'], self.q)

    def lie(self, q, shift=0.0, names=NAMES):
        """Publish joint states of one's own."""
        message = JointState(name=list(names), position=list(q))
        message.header.frame_id = 'made_up'
        message.header.stamp = Time(nanoseconds=round(1e9 * (time.time() + shift))).to_msg()
        self.states.publish(message)

    def goal(self, w=0.0):
        """Send a goal that is within reach, or wrong."""
        message = PoseStamped()
        position, x = message.pose.position, self.random.uniform(0.35, 0.55)
        position.x, position.y, position.z = x, self.random.uniform(-0.3, 0.3), 0.45
        message.pose.orientation.x, message.pose.orientation.w = 1.0, w
        self.goals.publish(message)

    def transition(self, number):
        """Ask for a transition."""
        return self.change.call_async(ChangeState.Request(transition=Transition(id=number)))


class Endurance:
    """The processes, and what was seen of them."""

    def __init__(self, rate, seed, environment, folder):
        self.environment, self.folder, self.count = environment, folder, itertools.count()
        (folder / 'stack.yaml').write_text(STACK)
        self.tester, self.executor = Tester(seed), SingleThreadedExecutor()
        self.executor.add_node(self.tester)
        limits = {name: {'acceleration': limit} for name, limit in zip(NAMES, ACCELERATIONS)}
        self.promise = monitor.promise_of(
            Robot.from_file(ROBOT, limits=limits), 1.0 / rate, math.inf, beyond=0.05)
        self.rate = rate
        self.arguments = ['-p', f'robot:={ROBOT}', '-p', f'rate:={rate}', '-p',
                          f'stack:={folder / "stack.yaml"}', *itertools.chain.from_iterable(
                              ('-p', f'limits.{name}.acceleration:={limit}')
                              for name, limit in zip(NAMES, ACCELERATIONS))]
        self.crashes, self.broken, self.gap, self.commands = 0, [], 0.0, 0
        self.samples = []
        # From when to when there were no joint states.
        self.silence = 0.0, 0.0
        self.controller = self.start('controller_node', self.arguments)
        self.simulator = self.simulate()

    def start(self, executable, arguments):
        """Start a node."""
        return NodeProcess(executable, arguments, self.environment,
                           self.folder / f'{executable}{next(self.count)}.log')

    def simulate(self):
        """Start a simulator where the last one ended."""
        q = self.tester.q
        positions = START if q is None else '{' + ', '.join(
            f'{name}: {value:.5f}' for name, value in zip(NAMES, q)) + '}'
        return self.start('simulator_node', [
            '-p', f'robot:={ROBOT}', '-p', f'rate:={self.rate}', '-p',
            f"initial_positions:='{positions}'"])

    def listen(self, seconds):
        """Hear what comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.01)

    # Faults -------------------------------------------------------------------------------

    def pause_controller(self):
        """Stop the controller's process for a while."""
        self.pause(self.controller, 0.3)

    def pause_simulator(self):
        """Stop the simulator's process for a while."""
        begin = time.time()
        self.pause(self.simulator, 1.0)
        self.silence = begin, time.time()

    def pause(self, node, seconds):
        """Stop a process for a while."""
        node.process.send_signal(signal.SIGSTOP)
        self.listen(seconds)
        node.process.send_signal(signal.SIGCONT)

    def kill_simulator(self):
        """Kill the simulator, and start another."""
        self.simulator.process.kill()
        begin = time.time()
        self.listen(0.8)
        self.silence = begin, time.time()
        self.simulator = self.simulate()

    def not_a_number(self):
        """Send positions that are no numbers."""
        for _ in range(100):
            self.tester.lie(np.full(7, np.nan))

    def jump(self):
        """Send positions that are far off."""
        if self.tester.q is not None:
            self.tester.lie(self.tester.q + 1.0)

    def old(self):
        """Send positions that are old."""
        for _ in range(100):
            self.tester.lie(np.zeros(7), -10.0)

    def twice(self):
        """Name joints twice."""
        for _ in range(100):
            self.tester.lie(np.zeros(14), 0.0, NAMES * 2)

    def bad_goals(self):
        """Send goals that are refused."""
        for _ in range(1000):
            self.tester.goal(w=5.0)

    def good_goals(self):
        """Send many goals."""
        for _ in range(1000):
            self.tester.goal()

    def reload(self):
        """Read the stack again, ten times."""
        for _ in range(10):
            self.tester.buttons['reload'].call_async(Trigger.Request())

    def set_parameters(self):
        """Set a parameter, and refuse a stack."""
        for count in range(20):
            self.tester.knobs.set_parameters(
                [Parameter('damping', value=0.1 + 0.001 * count)])
        self.tester.knobs.set_parameters([Parameter('stack', value='[' * 300)])

    def toggle(self):
        """Enable and disable a task."""
        for count in range(20):
            self.tester.switch.call_async(SetBool.Request(data=bool(count % 2)))

    def stop(self):
        """Stop the robot."""
        self.tester.buttons['stop'].call_async(Trigger.Request())

    def cycle(self):
        """Deactivate and activate."""
        for number in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
            answer = self.tester.transition(number)
            for _ in range(50):
                self.listen(0.1)
                if answer.done():
                    break

    FAULTS = (pause_controller, pause_simulator, kill_simulator, not_a_number, jump, old, twice,
              bad_goals, good_goals, reload, set_parameters, toggle, stop, cycle)

    # Seconds ------------------------------------------------------------------------------

    def second(self, fault):
        """Inject a fault, let a second pass, and judge it."""
        begin = time.monotonic()
        fault(self)
        self.tester.goal()
        self.tester.buttons['start'].call_async(Trigger.Request())
        self.listen(max(0.1, begin + 1.0 - time.monotonic()))
        for client in (*self.tester.buttons.values(), self.tester.switch, self.tester.change):
            for waiting in list(client._pending_requests.values()):
                client.remove_pending_request(waiting)
        self.judge(fault not in (Endurance.pause_controller, Endurance.cycle))
        if not self.controller.running():
            self.crashes += 1
            print(self.controller.output()[-2000:], file=sys.stderr)
            self.controller = self.start('controller_node', self.arguments)

    def judge(self, gapless):
        """Check what was heard, and keep only its end."""
        heard = self.tester.monitor
        begin, end = self.silence
        self.broken += [*heard.faults(self.promise), *(
            f'{sent:.3f} s: motion without joint states' for sent, velocity, _ in heard.commands
            if velocity.any() and begin + TIMEOUT + LATE < sent < end)]
        times = [sent for sent, *_ in heard.commands]
        self.commands += max(len(times) - 1, 0)
        if gapless and len(times) > 1:
            self.gap = max(self.gap, float(np.diff(times).max()))
        heard.commands, heard.positions = heard.commands[-1:], heard.positions[-1:]

    def sample(self):
        """Note size, threads and open files of the controller."""
        process = Path(f'/proc/{self.controller.process.pid}')
        with suppress(OSError):
            self.samples.append((
                PAGE * int((process / 'statm').read_text().split()[1]),
                len(list((process / 'task').iterdir())), len(list((process / 'fd').iterdir()))))

    def row(self, elapsed):
        """Return a row of the table."""
        size, threads, files = self.samples[-1]
        return (f'| {elapsed / 60.0:.1f} | {1e-6 * size:.1f} | {threads} | {files} | '
                f'{self.commands} | {1e3 * self.gap:.1f} | {self.crashes} | {len(self.broken)} |')

    def growth(self):
        """Return by how much the controller grows [MB/h], after the first fifth."""
        sizes = np.array([size for size, *_ in self.samples])[len(self.samples) // 5:]
        if len(sizes) < 3:
            return 0.0
        seconds = np.arange(len(sizes), dtype=float)
        return 1e-6 * 3600.0 * float(np.polyfit(seconds, sizes, 1)[0])

    def close(self):
        """End everything."""
        for node in (self.controller, self.simulator):
            node.process.send_signal(signal.SIGCONT)
            node.stop()
        self.executor.shutdown()
        self.tester.destroy_node()


def main():
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--hours', type=float, default=1.0 / 60.0, help='how long')
    parser.add_argument('--rate', type=float, default=1000.0, help='of controller and robot [Hz]')
    parser.add_argument('--seed', type=int, default=0, help='of the order of the faults')
    options = parser.parse_args()
    print('| minutes | size [MB] | threads | open files | commands | longest gap [ms] | crashes | '
          'promises broken |')
    print('| --- | --- | --- | --- | --- | --- | --- | --- |')
    with own_domain() as environment, tempfile.TemporaryDirectory() as folder:
        # Fast DDS always uses shared memory with LOCALHOST, and processes are stopped here; see
        # docs/safety.md.
        environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SUBNET'
        os.environ.update(environment)
        init(args=[])
        run = Endurance(options.rate, options.seed, environment, Path(folder))
        try:
            run.listen(5.0)
            run.judge(False)
            begin = told = time.monotonic()
            while (elapsed := time.monotonic() - begin) < 3600.0 * options.hours:
                run.second(Endurance.FAULTS[run.tester.random.integers(len(Endurance.FAULTS))])
                run.sample()
                if time.monotonic() - told > max(30.0, 120.0 * options.hours):
                    told = time.monotonic()
                    print(run.row(elapsed), flush=True)
            print(run.row(elapsed))
            print(f'\ngrowth: {run.growth():.1f} MB/h')
            for sentence in run.broken[:20]:
                print(sentence)
            return int(bool(run.crashes or run.broken or not run.commands))
        finally:
            run.close()
            try_shutdown()


if __name__ == '__main__':
    sys.exit(main())

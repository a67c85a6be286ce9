# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Controllers of positions as processes that end, are killed, stopped, or run tasks that hang."""

import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from processes_harness import DEADLINE
import pytest
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from test_processes import (
    begin_reading,
    BUSY,
    buttons,
    call_reload,
    CYCLE,
    heads,
    LIMITED,
    look_at_markers,
    look_at_the_status,
    PARAMETERS,
    PARSING,
    READING,
    replaced,
    send_goal,
    set_a_parameter,
    SKETCH,
    SLEEP,
    STACK,
    STATUS,
    TASK,
)
from trajectory_msgs.msg import JointTrajectory

__all__ = ['heads', 'replaced']
# [rad/s²], as `LIMITED` has it, and the velocity limit of the planar arm [rad/s].
ACCELERATION, VELOCITY = 2.0, 1.0
# Between two commands of a stop, by far, unless a busy machine delays the controller [s]:
# `outputs.LONGEST_SILENCE`, after which joints stop at once, less the time to send a command.
LATE = 0.02


class Positions:
    """Commanded positions of either output, with the times at which they were sent."""

    def __init__(self, listener):
        self.sent, self._listener = [], listener
        # When the controller last said something about itself.
        self._told = 0.0
        node = listener.client.node
        node.create_subscription(DiagnosticArray, '/tp_controller/status', self._tell, 1000)
        node.create_subscription(Float64MultiArray, '/position_controller/commands',
                                 lambda message, info: self._take(message.data, info), 5000)
        node.create_subscription(
            JointTrajectory, '/joint_trajectory_controller/joint_trajectory',
            lambda message, info: self._take(message.points[0].positions, info), 5000)

    def _take(self, positions, info):
        """Take commanded positions."""
        self.sent.append((1e-9 * info['source_timestamp'], np.array(positions)))

    def _tell(self, message, info):
        """Take the time of a status."""
        self._told = 1e-9 * info['source_timestamp']

    def late(self, begin):
        """Return whether the controller was delayed between a time and its last status."""
        times = [sent for sent, _ in self.sent if sent > begin]
        return np.diff([*times, self._told]).max() > LATE

    def since(self, begin):
        """Return the positions that were sent after a time."""
        return [positions for sent, positions in self.sent if sent > begin]

    def moving(self):
        """Return whether the robot is commanded to move, not slowly any more."""
        return len(self.sent) > 10 and np.abs(self.sent[-1][1] - self.sent[0][1]).max() > 0.3

    def stand(self):
        """Return whether the last positions are the same."""
        return len(self.sent) > 5 and np.ptp([each for _, each in self.sent[-5:]], axis=0).max() \
            < 1e-9

    def arrives(self):
        """Wait until the robot stands at the last position, or one that it heard before."""
        self._listener.wait(lambda: self._listener.states and np.allclose(
            self._listener.states[-1][0], self.sent[-1][1], atol=0.05)
            and not self._listener.states[-1][1].any(), 'a robot at rest')

    def check(self):
        """Check that no position is farther from the one before than the time between allows."""
        times, positions = (np.array(each) for each in zip(*self.sent))
        # Positions are computed at the beginning of a cycle, and sent at its end.
        allowed = VELOCITY * (np.diff(times) + 0.02)[:, None]
        assert (np.abs(np.diff(positions, axis=0)) <= allowed).all()


@pytest.fixture
def positions(listener):
    """Return the positions that are commanded."""
    return Positions(listener)


@pytest.fixture(params=['position', 'trajectory'])
def output(request):
    """Return the output of a controller."""
    return request.param


@pytest.fixture
def moving(listener, start, positions, output):
    """Return controller and simulator of a moving planar arm."""
    nodes = (start('controller_node', '-p', f"stack:='{STACK}'", '-p', f'output:={output}',
                   *LIMITED), start('simulator_node'))
    listener.wait(positions.moving, 'motion', nodes)
    return nodes


@pytest.fixture
def changed(replaced, listener, positions, output, monkeypatch):
    """Return what starts a moving planar arm whose controller has a part replaced."""
    # Its fixture waits for velocities.
    monkeypatch.setattr(listener, 'moving', positions.moving)
    return lambda part, act, *arguments: replaced(
        part, act, '-p', f'output:={output}', *LIMITED, *arguments)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_answered_by_braking_and_told(moving, listener, positions, heads, number):
    controller, _ = moving
    begin = time.time()
    controller.process.send_signal(number)
    assert controller.process.wait(DEADLINE) == 0
    listener.wait(lambda: heads and heads[-1] == f'ended by {number.name}', 'the last status')
    listener.catch_up()
    last = np.array(positions.since(begin)[-3:])
    # From 1 rad/s it takes 0.5 s and 0.25 rad, but for cycles that a busy machine has lost.
    assert np.ptp(last, axis=0).max() < 1e-3 or positions.late(begin)
    assert np.abs(last[-1] - positions.since(begin - 0.05)[0]).max() < 0.5
    positions.arrives()
    positions.check()


def test_a_robot_whose_controller_is_killed_stands_still_at_the_last_position(
        moving, listener, positions):
    controller, _ = moving
    controller.process.kill()
    controller.process.wait(DEADLINE)
    listener.catch_up()
    positions.arrives()
    positions.check()


def test_a_controller_that_was_stopped_goes_on_from_the_last_position(moving, listener,
                                                                      positions):
    controller, simulator = moving
    controller.process.send_signal(signal.SIGSTOP)
    end = time.time() + 1.5
    listener.wait(lambda: time.time() > end, 'the end', [simulator])
    positions.arrives()
    still, count = positions.sent[-1][1], len(positions.sent)
    controller.process.send_signal(signal.SIGCONT)
    listener.wait(lambda: len(positions.sent) > count
                  and np.abs(positions.sent[-1][1] - still).max() > 0.05, 'motion', [controller])
    positions.check()


def test_a_fault_of_the_loop_ends_the_node_and_is_told_and_the_robot_stands(
        changed, listener, positions, heads, tmp_path):
    controller = changed(CYCLE, "raise RuntimeError('broken')")
    (tmp_path / 'switch').touch()
    assert controller.process.wait(DEADLINE) != 0
    listener.wait(lambda: heads and heads[-1] == 'ended: RuntimeError: broken', 'the last status')
    listener.catch_up()
    positions.arrives()
    positions.check()


@pytest.mark.parametrize('part, trigger, act, number', [
    (READING, call_reload, BUSY, signal.SIGTERM), (SKETCH, look_at_markers, SLEEP, signal.SIGQUIT),
    (PARSING, send_goal, SLEEP, signal.SIGINT), (STATUS, look_at_the_status, SLEEP, signal.SIGINT),
    (PARAMETERS, set_a_parameter, SLEEP, signal.SIGHUP)],
    ids=['stack', 'sketch', 'goal', 'status', 'parameter'])
def test_a_signal_stops_the_robot_whatever_hangs(changed, listener, positions, heads, tmp_path,
                                                 part, trigger, act, number):
    controller = changed(part, f'switch.rename(f"{{switch}}ed"); {act}')
    (tmp_path / 'switch').touch()
    triggered = trigger(listener)
    listener.wait((tmp_path / 'switched').exists, 'the fault', [controller])
    assert not positions.stand()
    begin = time.time()
    controller.process.send_signal(number)
    listener.wait(lambda: heads and heads[-1] == f'ended by {number.name}', 'the last status')
    assert controller.process.wait(DEADLINE) == 1
    listener.catch_up()
    last = np.array(positions.since(begin)[-3:])
    assert np.ptp(last, axis=0).max() < 1e-3 or positions.late(begin)
    positions.arrives()
    positions.check()
    del triggered


def test_positions_stay_while_a_task_never_returns_and_ctrl_c_ends_the_node(
        changed, listener, positions, heads, tmp_path):
    controller = changed(TASK, 'while True: pass')
    (tmp_path / 'switch').touch()
    listener.wait(lambda: 'no cycle was completed within watchdog_timeout' in heads, 'the reason',
                  [controller])
    listener.wait(positions.stand, 'rest', [controller])
    # Once the robot has not been seen for a while, nothing is sent.
    still = positions.sent[-1][1]
    controller.process.send_signal(signal.SIGINT)
    controller.process.wait(DEADLINE)
    listener.wait(lambda: heads[-1] == 'ended by SIGINT', 'the last status')
    listener.catch_up()
    assert np.abs(positions.sent[-1][1] - still).max() < 1e-9
    positions.check()


def test_positions_go_on_while_a_stack_is_read_and_a_stop_does_not_wait(changed, listener,
                                                                        positions, tmp_path):
    controller = changed(READING, 'switch.unlink(); time.sleep(3.0); Path(f"{switch}ed").touch()',
                         '-p', 'state_timeout:=5.0', '-p', 'watchdog_timeout:=5.0')
    reload, stop = buttons(listener, 'reload', 'stop', nodes=[controller])
    begin_reading(listener, reload, tmp_path / 'switch', [controller])
    listener.wait_for_more(positions.sent, 20)
    assert not positions.stand() and not (tmp_path / 'switched').exists()
    answer = stop.call_async(Trigger.Request())
    listener.wait(answer.done, 'the answer', [controller])
    assert answer.result().success and not (tmp_path / 'switched').exists()
    listener.wait(positions.stand, 'rest', [controller])
    positions.check()


def test_the_watchdog_sends_the_last_position_while_a_task_takes_a_second(
        changed, listener, positions, heads, tmp_path):
    controller = changed(TASK, 'switch.unlink(); time.sleep(1.0)', '-p', 'status_rate:=50.0')
    (tmp_path / 'switch').touch()
    told = 'no cycle was completed within watchdog_timeout'
    listener.wait(lambda: any(told in head for head in heads), 'the reason', [controller])
    count = len(positions.sent)
    listener.wait(lambda: len(positions.sent) > count + 3, 'more positions', [controller])
    still = np.array([each for _, each in positions.sent[count:count + 3]])
    assert np.ptp(still, axis=0).max() < 1e-9
    listener.wait(lambda: np.abs(positions.sent[-1][1] - still[-1]).max() > 0.05, 'motion',
                  [controller])
    positions.check()

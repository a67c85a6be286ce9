# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The loop: joint states and odometry in, velocities out, and nothing else."""

from collections.abc import Callable
import math
import re
import time
import traceback
from typing import Any

from nav_msgs.msg import Odometry
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from tp_controller.control.report import Report
from tp_controller.errors import EvaluationError, in_words, RobotError, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.nodes.base_topics import FixedBase, MovingBase, waiting
from tp_controller.nodes.commands import Commands, LAST_ZEROS
from tp_controller.nodes.deadlines import promise, state_events, state_qos
from tp_controller.nodes.figures import Figures
from tp_controller.nodes.gaps import Gaps
from tp_controller.nodes.joint_states import JointStateBuffer
from tp_controller.nodes.log import Log
from tp_controller.nodes.parameters import names_in
from tp_controller.nodes.shared_controller import SharedController
from tp_controller.nodes.state_checks import Following, MotionCheck
from tp_controller.nodes.stops import Stops
from tp_controller.nodes.wire import JointStateReader

# A shorter silence of the loop is not told from the jitter of a busy machine [s].
SHORTEST_STALL = 0.05
# Of joint states that may have waited for longer only the newest is used [s]. On a busy machine
# (load 5) with 2 ms in its place 1 to 8 % of the states at 1 kHz, and 2 to 4 % at 2 kHz, get no
# answer; with 10 ms at most 0.1 and 0.3 %.
LONGEST_WAIT = 10e-3
# A shorter time between two cycles is none in which nothing waited [s].
SHORTEST_PAUSE = 1e-4
LATE_CYCLE = 'no cycle was completed within watchdog_timeout'
INACTIVE = 'inactive; activate the node to go on'
# Ages and the like in a reason: they change all the time while its cause is the same.
SECONDS = re.compile(r'[\d.e+]+ s\b')


def boot_time() -> float:
    """
    Return the time since the machine was booted [s].

    Nobody can set this clock, and it goes on while the machine is suspended.
    """
    return time.clock_gettime(CLOCK)


CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


class ControlLoop:
    """
    Runs a controller, by a timer or once per joint state.

    Whenever something is missing it commands zeros, and `stop_reason` says what. It runs on the
    thread that spins its node. Everything else may happen on other threads meanwhile: they leave
    what they want in `hold`, in `stops` and in the controller.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics and timers belong to.
    topic : callable
        Returns the full name of a topic.
    controller : SharedController
    values : dict
        Parameters of the controller node.
    log : Log

    Attributes
    ----------
    hold : str
        What somebody has to change before the robot moves; empty where nothing has to.
    active : bool
        Anything is commanded at all.
    stop_reason : str
        Why zeros are commanded; empty while the tasks are carried out.
    report : Report or None
        Of the last cycle that carried the tasks out.
    reported : float
        When that began [s].
    figures : Figures
        Of the cycles.
    gaps : Gaps
        Between the cycles.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], controller: SharedController,
                 values: dict[str, Any], log: Log) -> None:
        self._node, self._controller, self._log = node, controller, log
        self._rate, self._timeout = values['rate'], values['state_timeout']
        self._period = 1.0 / self._rate if self._rate > 0.0 else self._timeout
        robot = controller.robot
        names = _ordered(robot, names_in(values['command_joints']))
        self._watch_over(robot, values)
        qos, deadline = promise(values['command_deadline']), values['state_deadline']
        self._base = MovingBase(node, topic, robot, qos) if robot.moves else FixedBase()
        self.commands = Commands(node, topic, robot, names, self._base, qos)
        self.stops = Stops(values['settle_time'])
        self.hold, self.active = INACTIVE, False
        self.stop_reason = INACTIVE
        self.report: Report | None = None
        self.reported = -math.inf
        self.figures = Figures(1.0 / self._rate if self._rate > 0.0 else math.inf)
        self.gaps = Gaps()
        self._resting, self._noted = False, 0
        self._heard = self.completed = self._received = self._last_cycle = boot_time()
        # When the loop had nothing to do last.
        self._busy_since = self._heard
        self._simulated = node.get_parameter('use_sim_time').value
        self._last_robot_time = self._robot_time(self._heard)
        self._stall = max(self._timeout, SHORTEST_STALL)
        # Everything else has to be there: the thread of the node may call at once. Before
        # `activate` it is told to wait.
        self._states = node.create_subscription(
            JointState, topic('joint_states'), self._on_joint_state, state_qos(deadline),
            event_callbacks=state_events(deadline, self.figures, log), raw=True)
        self._base.listen(self._on_odometry)
        self._timers = self._start_timers(values['watchdog_timeout'])

    def _watch_over(self, robot: Robot, values: dict[str, Any]) -> None:
        """Make what takes joint states, and what tells whether they can be true."""
        rows = robot.joint_columns
        lower, upper = robot.lower[rows], robot.upper[rows]
        endless = np.isinf(upper - lower) & np.array(
            [unit == 'rad' for unit in robot.velocity_units[rows]], dtype=bool)
        self._buffer = JointStateBuffer(
            robot.joint_names, robot.passive_names, robot.passive_neutral, robot.velocity[rows],
            endless, self._timeout if values['check_stamps'] else math.inf,
            values['jump_tolerance'])
        self._reader = JointStateReader()
        self._motion = MotionCheck(robot.joint_names, lower, upper, endless,
                                   Following(values['follow_window']), values['limit_tolerance'])

    def _start_timers(self, watchdog_timeout: float) -> list[Timer]:
        """Start the cycle, and what watches over it on the steady clock."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        # Neither a joint state nor simulated time may come any more: then nothing else would
        # command zeros.
        timers = [self._node.create_timer(min(self._timeout, watchdog_timeout) / 2.0, self._watch,
                                          clock=steady)]
        if self._rate > 0.0:
            timers.append(self._node.create_timer(
                1.0 / self._rate, self._on_timer, clock=None if self._simulated else steady))
        return timers

    def close(self) -> None:
        """Give topics and timers up."""
        self.active = False
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._node.destroy_subscription(self._states)
        self.commands.close()

    # What others may call -----------------------------------------------------------------

    def silence(self) -> float:
        """Return for how long nothing has been completed [s]."""
        return boot_time() - self.completed if self.active else 0.0

    def bark(self) -> None:
        """Command zeros in place of the loop, which does not answer."""
        self.stops.interrupt(LATE_CYCLE, boot_time())
        self.commands.interrupt()
        self._tell(LATE_CYCLE)

    def activate(self) -> None:
        """Command something from now on."""
        self._heard = self.completed = boot_time()
        self.active = True

    def deactivate(self, reason: str) -> None:
        """Command zeros for the last time, and say why."""
        self.active, self.stop_reason = False, reason
        self.commands.interrupt(LAST_ZEROS)

    def place(self) -> tuple[Array, Array] | None:
        """Return where the robot is by what was heard last, as `Controller.configuration`."""
        joints = self._buffer.q.copy()
        if not np.isfinite(joints).all():
            return None
        return self._base.configuration(joints), self._buffer.passive.copy()

    def lasting(self) -> str:
        """Return what speaks against starting the robot now, if anything."""
        now = boot_time()
        # Where something is missing the robot would move once it is back, whenever that is.
        return self._buffer.lasting(now) or self._missing(now)

    def restart(self) -> None:
        """Forget the faults that are over, and let tasks without a goal stay where they are."""
        self._controller.restart()
        self._buffer.forget()
        self._motion.forget()
        self.stops.latched = ''

    # What comes in ------------------------------------------------------------------------

    def _robot_time(self, now: float) -> float:
        """Return the time that passes for the robot [s]: a simulation may have its own."""
        return self._node.get_clock().now().nanoseconds * 1e-9 if self._simulated else now

    def _on_joint_state(self, raw: bytes) -> None:
        """Take joint positions, all that wait; without a timer they start the cycle."""
        if not self.active or self._stood_still():
            return
        self._put(raw)
        if self._is_behind():
            for each in waiting(self._states):
                self._put(each)
        if self._rate == 0.0 and self._buffer.take_complete():
            self._cycle()

    def _is_behind(self) -> bool:
        """Say whether joint states may have waited for longer than they should."""
        now = self._received
        pause = now - self.completed
        if pause >= SHORTEST_PAUSE:
            self._busy_since = now
        return max(pause, now - self._busy_since) > LONGEST_WAIT

    def _put(self, raw: bytes) -> None:
        """Take joint positions, or say why not."""
        self._received = now = boot_time()
        try:
            names, positions, stamp = self._reader.read(raw)
        except Exception as error:  # of rclpy, and not always of the same type
            self._log.warning(f'joint state ignored: {in_words(error)}', 'joint state')
            return
        fault = self._buffer.put(names, positions, now, stamp, self._robot_time(now))
        if self._buffer.contradiction and self.stops.moved:
            self.stops.latch(self._buffer.contradiction)
        elif self._buffer.contradiction:
            # As of a driver that publishes zeros before it has read any position.
            self._buffer.forget()
        if fault:
            self._log.warning(f'joint state ignored: {fault}', 'joint state')

    def _on_odometry(self, message: Odometry) -> None:
        """Take odometry; it starts the cycle without a timer and without driven joints."""
        if not self.active or self._stood_still():
            return
        fault = self._base.put(message, boot_time())
        if fault:
            self._log.warning(f'odometry ignored: {fault}', 'odometry')
        elif self._rate == 0.0 and not self._controller.robot.joint_names:
            self._received = boot_time()
            self._cycle()

    def _on_timer(self) -> None:
        """Run a cycle."""
        if self.active and not self._stood_still():
            self._cycle()

    def _stood_still(self) -> bool:
        """
        Return whether this is the first to run after everything stood still for too long.

        Then what waits in queues is old, the robot has stopped by itself or has gone on as it
        was told last, and everything begins anew from where it is.
        """
        now = boot_time()
        silence, self._heard = now - self._heard, now
        if silence <= self._stall:
            return False
        for _ in waiting(self._states):
            pass
        self._buffer.discard()
        self._base.discard()
        self.figures.stalls += 1
        self.stops.interrupt(f'the node stood still for {silence:.2g} s', now)
        self._zeros()
        self._tell(self._find_stop_reason(now))
        self.completed = now
        return True

    # The cycle ----------------------------------------------------------------------------

    def _cycle(self) -> None:
        """Command velocities, or zeros where something is missing."""
        now = boot_time()
        robot_time = self._robot_time(now)
        elapsed = robot_time - self._last_robot_time
        self._last_cycle, self._last_robot_time = now, robot_time
        noted = self.commands.interruptions
        if noted != self._noted:
            # Others have commanded zeros since: the motion begins from rest.
            self._noted = noted
            self._rest()
        reason = self._find_stop_reason(now) or self._command(now, robot_time, elapsed, noted)
        if reason:
            self._zeros()
        self._tell(reason)
        self.completed = boot_time()
        self.figures.add(now, self.completed, self._received)
        self.gaps.begin(self.completed)

    def _command(self, now: float, robot_time: float, elapsed: float, noted: int) -> str:
        """Command velocities; return why not, else nothing."""
        try:
            command = self._controller.update(self._base.configuration(self._buffer.q), now,
                                              self._buffer.passive, elapsed)
        except EvaluationError as error:
            self.stops.latch(str(error))
            return self._find_stop_reason(now)
        except TpControllerError as error:
            return str(error)
        except Exception as error:  # of a task that somebody else wrote
            self.stops.latch(in_words(error))
            self._log.error(traceback.format_exc(), in_words(error))
            return self._find_stop_reason(now)
        took = boot_time() - now
        if took > self._stall:
            self.stops.interrupt(f'a cycle took {took:.2g} s', now + took)
        elif self.commands.publish(command.velocity, noted):
            self.report, self.reported, self._resting = command.report, now, False
            self._check_motion(command.velocity, robot_time)
            return ''
        return self._find_stop_reason(now + took) or 'interrupted'

    def _check_motion(self, velocity: Array, now: float) -> None:
        """Stop, until ~/start, if the robot does not follow or passes a limit."""
        q, joints = self._buffer.q, velocity[self._controller.robot.joint_columns]
        fault = self._motion.passed(q) or self._motion.check(q, joints, now)
        if fault:
            self.stops.latch(fault)

    def _zeros(self) -> None:
        """Command no motion."""
        self._rest()
        self.commands.zeros()

    def _rest(self) -> None:
        """Let the next motion begin from rest."""
        if not self._resting:
            # Nothing is to be followed meanwhile.
            self._motion.forget()
            self._resting = True
        self._controller.halt(boot_time())

    def _tell(self, reason: str) -> None:
        """Log why the robot is stopped, or that it moves again, where that has changed."""
        if reason == self.stop_reason:
            return
        self.stop_reason = reason
        if reason:
            self._log.warning(f'commanding zeros: {reason}', SECONDS.sub('', reason))
            return
        self._log.info('running')
        unheard = self._buffer.unheard()
        if unheard:
            self._log.warning(
                'no joint states of passive joints: until then they count as at zero, or at '
                f'the limit nearest to zero: {", ".join(unheard)}')

    def _find_stop_reason(self, now: float) -> str:
        """Return why zeros are commanded; empty if nothing speaks against motion."""
        return self.hold or self.stops.reason(self._missing(now), now)

    def _missing(self, now: float) -> str:
        """Return what has not arrived for too long; empty if nothing is missing."""
        missing = self._buffer.missing(now, self._timeout)
        if missing:
            ignored = self._buffer.ignored(now, self._timeout)
            return f'no joint states of {", ".join(missing)}' \
                   + (f' (ignored: {ignored})' if ignored else '')
        return self._base.stop_reason(now, self._timeout)

    def _watch(self) -> None:
        """Command zeros if the cycle has not done anything for too long."""
        if not self.active or self._stood_still():
            return
        now = boot_time()
        silence = now - self._last_cycle
        if silence > self._timeout:
            reason = self._find_stop_reason(now)
            # A cycle may well be longer than the joint states may be old.
            if not reason and silence > 2.0 * self._period:
                if not self._simulated:
                    # The timer is only late, as on a machine that has too much to do.
                    self._cycle()
                    return
                reason = 'simulated time (/clock) stands still'
            if reason:
                self._zeros()
                self._tell(reason)
        self.completed = now


def _ordered(robot: Robot, names: list[str] | None) -> list[str]:
    """Return the driven joints in the order of the commands, and check that all are named."""
    names = names or list(robot.joint_names)
    if sorted(names) != sorted(robot.joint_names):
        raise RobotError('parameter command_joints must be the driven joints in some order '
                         f'({", ".join(robot.joint_names)}), not {", ".join(names)}')
    return names

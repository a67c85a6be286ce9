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

"""The control loop: joint states and odometry in, velocities out."""

from collections.abc import Callable
import math
import time
import traceback
from typing import Any

from nav_msgs.msg import Odometry
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from tp_controller.control.report import Report
from tp_controller.errors import EvaluationError, in_words, RobotError, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.log import Log
from tp_controller.ros.loop.base_topics import FixedBase, LONGEST_QUEUE_TIME, MovingBase, waiting
from tp_controller.ros.loop.commands import Commands, LAST_ZEROS
from tp_controller.ros.loop.cycle_scheduling import Gaps
from tp_controller.ros.loop.deadlines import promise, state_events, state_qos
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer
from tp_controller.ros.loop.joint_state_cdr import JointStateReader
from tp_controller.ros.loop.loop_statistics import Figures
from tp_controller.ros.loop.odometry_check import OdometryCheck
from tp_controller.ros.loop.permits import Permits
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.loop.state_checks import FollowCheck, Following, LimitCheck
from tp_controller.ros.loop.stop_reasons import Stops
from tp_controller.ros.parameters import names_in

# Shortest silence of the loop that counts as a stall [s]: less is jitter of a busy machine.
SHORTEST_STALL = 0.05
# Idle time after which the queue counts as empty [s].
SHORTEST_PAUSE = 1e-4
# Longest duration of a ramped stop [s].
LONGEST_RAMP = 2.0
# Smallest commanded motion of a base that is checked, relative to the tolerated jump of its
# odometry [1]: a correction by the whole tolerance must not hide that the base follows.
FOLLOW_RATIO = 1.5
LATE_CYCLE = 'no cycle was completed within watchdog_timeout'
INACTIVE = 'inactive; activate the node to go on'


def boot_time() -> float:
    """
    Return the time since the machine was booted [s].

    This clock cannot be set, and it goes on while the machine is suspended.
    """
    return time.clock_gettime(CLOCK)


CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


class ControlLoop:
    """
    Runs a controller, by a timer or once per joint state.

    It commands zeros whenever an input is missing, and gives the reason in `stop_reason`. It runs
    on the thread that spins its node. Other threads act on it through `hold`, `stops` and the
    controller.

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
        Condition that has to be resolved by the user before the robot moves, or empty.
    unmet : str
        Requirement that is not met, or empty.
    permits : Permits
        Inputs that allow motion.
    deceleration : float
        Deceleration of a ramped stop [rad/s² or m/s²]; 0: zeros at once.
    active : bool
        Commands are published at all.
    stop_reason : str
        Reason for which zeros are commanded; empty while the tasks are executed.
    report : Report or None
        Report of the last cycle that executed the tasks.
    reported : float
        Start of that cycle [s].
    figures : Figures
        Statistics of the cycles.
    gaps : Gaps
        Idle times between the cycles.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], controller: SharedController,
                 values: dict[str, Any], log: Log) -> None:
        self._node, self._controller, self._log = node, controller, log
        self._rate, self._timeout = values['rate'], values['state_timeout']
        self._period = 1.0 / self._rate if self._rate > 0.0 else self._timeout
        robot = controller.robot
        names = _ordered(robot, names_in(values['command_joints']))
        self._make_checks(robot, values)
        qos, deadline = promise(values['command_deadline']), values['state_deadline']
        self._base = self._make_base(topic, qos, values) if robot.moves else FixedBase()
        self.commands = Commands(node, topic, robot, names, self._base, qos)
        self.stops = Stops(values['settle_time'])
        self.permits = Permits(node, topic, values, self.stops, boot_time)
        self.deceleration = values['stop_deceleration']
        self.hold, self.unmet, self.active = INACTIVE, '', False
        self._ending, self._ramp = '', 0.0
        self.stop_reason = INACTIVE
        self.report: Report | None = None
        self.reported = -math.inf
        self.figures = Figures(1.0 / self._rate if self._rate > 0.0 else math.inf)
        self.gaps = Gaps()
        self._resting, self._noted = True, 0
        self._last_callback = self.completed = self._received = self._last_cycle = boot_time()
        # Last time at which the loop was idle.
        self._busy_since = self._last_callback
        self._simulated = node.get_parameter('use_sim_time').value
        self._last_robot_time = self._robot_time(self._last_callback)
        self._stall = max(self._timeout, SHORTEST_STALL)
        # Created last: the thread of the node may call back at once. The callbacks return
        # until `activate`.
        self._states = node.create_subscription(
            JointState, topic('joint_states'), self._on_joint_state, state_qos(deadline),
            event_callbacks=state_events(deadline, self.figures, log), raw=True)
        self._base.listen(self._on_odometry)
        self._timers = self._start_timers(values['watchdog_timeout'])

    def _make_checks(self, robot: Robot, values: dict[str, Any]) -> None:
        """Create the buffer of joint states and the checks of plausibility."""
        rows = robot.joint_columns
        lower, upper = robot.lower[rows], robot.upper[rows]
        endless = np.isinf(upper - lower) & np.array(
            [unit == 'rad' for unit in robot.velocity_units[rows]], dtype=bool)
        self._buffer = JointStateBuffer(
            robot.joint_names, robot.passive_names, robot.passive_neutral, robot.velocity[rows],
            endless, self._timeout if values['check_stamps'] else math.inf,
            values['jump_tolerance'])
        self._reader = JointStateReader()
        self._limits = LimitCheck(robot.joint_names, lower, upper, values['limit_tolerance'])
        self._follow = FollowCheck(robot.joint_names, endless, Following(
            values['follow_window'], excess=values['jump_tolerance']))

    def _make_base(self, topic: Callable[[str], str], qos: QoSProfile,
                   values: dict[str, Any]) -> MovingBase:
        """Return the topics of a base that moves, with the checks of its odometry."""
        robot, tolerance = self._controller.robot, values['odometry_jump_tolerance']
        names = robot.velocity_names[:robot.joint_columns.start]
        late = self._timeout if values['check_stamps'] else math.inf
        follow = FollowCheck(names, np.zeros(len(names), dtype=bool), Following(
            values['follow_window'], distance=max(0.05, FOLLOW_RATIO * tolerance),
            excess=tolerance))
        return MovingBase(self._node, topic, robot, qos, OdometryCheck(robot, late, tolerance),
                          follow)

    def _start_timers(self, watchdog_timeout: float) -> list[Timer]:
        """Start the timers of the cycle, and of its supervision on the steady clock."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        # If neither joint states nor simulated time arrive, only this timer commands zeros.
        timers = [self._node.create_timer(min(self._timeout, watchdog_timeout) / 2.0, self._watch,
                                          clock=steady)]
        if self._rate > 0.0:
            timers.append(self._node.create_timer(
                1.0 / self._rate, self._on_timer, clock=None if self._simulated else steady))
        return timers

    def close(self) -> None:
        """Destroy topics and timers."""
        if self.active:
            # During a ramped stop, for example.
            self.deactivate(INACTIVE)
        self.permits.close()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._node.destroy_subscription(self._states)
        self.commands.close()

    @property
    def limit_tolerance(self) -> float:
        """Return the tolerated distance of a joint beyond a position limit [rad or m]."""
        return self._limits.tolerance

    @limit_tolerance.setter
    def limit_tolerance(self, tolerance: float) -> None:
        self._limits.tolerance = tolerance

    # Interface for other threads -----------------------------------------------------------

    def silence(self) -> float:
        """Return the time since the last progress of the loop [s]; 0 while inactive."""
        return boot_time() - self.completed if self.active else 0.0

    def on_timeout(self) -> None:
        """Command zeros in place of the loop, which does not respond."""
        self.stops.interrupt(LATE_CYCLE, boot_time())
        self.commands.interrupt()
        self._set_stop_reason(LATE_CYCLE)

    def activate(self) -> None:
        """Activate the loop, which uses messages received from now on."""
        self._buffer.discard()
        self._base.discard()
        self._last_callback = self.completed = boot_time()
        self.active, self._ending = True, ''

    def deactivate(self, reason: str) -> None:
        """Command zeros for the last time, at once, and set the reason."""
        self.active, self.stop_reason, self._ending = False, reason, ''
        self.commands.interrupt(LAST_ZEROS)

    def come_to_rest(self, reason: str) -> None:
        """Deactivate the loop after a ramped stop, or at once at rest."""
        if self.deceleration and self.active and not self._resting:
            self.hold, self._ending = reason, reason
        else:
            self.deactivate(reason)

    def place(self) -> tuple[Array, Array] | None:
        """Return the last received configuration, as `Controller.configuration` does."""
        joints = self._buffer.q.copy()
        if not np.isfinite(joints).all():
            return None
        return self._base.configuration(joints), self._buffer.passive.copy()

    def lasting(self) -> str:
        """Return the reason for which the robot must not start now, or an empty string."""
        now = boot_time()
        # Without an input the robot would move as soon as the input returns, at any later time.
        return self._buffer.lasting(now) or self._base.lasting(now) or self._unknown(now) \
            or self.unmet or self.permits.refusal() or self._limits.outside(self._buffer.q)

    def restart(self) -> None:
        """Clear the faults that are over; tasks without a goal keep their current values."""
        self._controller.restart()
        self._buffer.forget()
        self._base.forget()
        self._forget_motion()
        self.stops.latched = ''

    # Inputs -------------------------------------------------------------------------------

    def _robot_time(self, now: float) -> float:
        """Return the time on the clock of the robot [s]: a simulation may have its own."""
        return self._node.get_clock().now().nanoseconds * 1e-9 if self._simulated else now

    def _on_joint_state(self, raw: bytes) -> None:
        """Store all queued joint positions; without a timer they start the cycle."""
        if not self.active or self._stood_still():
            return
        self._put(raw)
        if self._is_behind():
            for each in waiting(self._states):
                self._put(each)
        if self._rate == 0.0 and self._buffer.take_complete():
            self._cycle()

    def _is_behind(self) -> bool:
        """Return whether joint states may have been queued for too long."""
        now = self._received
        pause = now - self.completed
        if pause >= SHORTEST_PAUSE:
            self._busy_since = now
        return max(pause, now - self._busy_since, self._buffer.delay) > LONGEST_QUEUE_TIME

    def _put(self, raw: bytes) -> None:
        """Store the positions of a serialized joint state, or log why it is ignored."""
        self._received = now = boot_time()
        try:
            names, positions, stamp = self._reader.read(raw)
        except Exception as error:  # of rclpy, and not always of the same type
            self._log.warning(f'joint state ignored: {in_words(error)}', 'joint state')
            return
        fault = self._buffer.put(names, positions, now, stamp, self._robot_time(now))
        self._contradict(self._buffer)
        if fault:
            self._log.warning(f'joint state ignored: {fault}', 'joint state')

    def _contradict(self, source: JointStateBuffer | MovingBase | FixedBase) -> None:
        """Stop until ~/start if positions have jumped while the robot moved."""
        if source.contradiction and self.stops.moved:
            self.stops.latch(source.contradiction)
        elif source.contradiction:
            # A driver may publish zeros before it has read any position, for example.
            source.forget()

    def _on_odometry(self, message: Odometry) -> None:
        """Store odometry; it starts the cycle without a timer and without driven joints."""
        if not self.active or self._stood_still():
            return
        received = boot_time()
        good = self._put_odometry(message)
        for each in self._base.waiting():
            good = self._put_odometry(each) or good
        if good and self._rate == 0.0 and not self._controller.robot.joint_names:
            self._received = received
            self._cycle()

    def _put_odometry(self, message: Odometry) -> bool:
        """Store odometry and return True, or log why it is ignored."""
        now = boot_time()
        fault = self._base.put(message, now, self._robot_time(now))
        self._contradict(self._base)
        if fault:
            self._log.warning(f'odometry ignored: {fault}', 'odometry')
        return not fault

    def _on_timer(self) -> None:
        """Run a cycle."""
        if self.active and not self._stood_still():
            self._cycle()

    def _stood_still(self) -> bool:
        """
        Return whether this is the first callback after the node stood still for too long.

        Queued messages are then old, and the robot has stopped by itself or has followed its last
        command. The loop discards its inputs and starts again from the current configuration.
        """
        now = boot_time()
        silence, self._last_callback = now - self._last_callback, now
        if silence <= self._stall:
            return False
        for _ in waiting(self._states):
            pass
        self._buffer.discard()
        self._base.discard()
        self.figures.stalls += 1
        self._log.warning(f'the node stood still for {silence:.2g} s', 'stall')
        self.stops.interrupt(f'the node stood still for longer than {self._stall:g} s', now)
        self._zeros()
        self._set_stop_reason(self._find_stop_reason(now))
        self.completed = now
        return True

    # The cycle ----------------------------------------------------------------------------

    def _cycle(self) -> None:
        """Run a cycle: command velocities, or zeros if an input is missing."""
        now = boot_time()
        robot_time = self._robot_time(now)
        elapsed = robot_time - self._last_robot_time
        self._last_cycle, self._last_robot_time = now, robot_time
        noted = self.commands.interruptions
        if not self.active:
            # The loop was deactivated, with its last zeros, after this callback began.
            return
        if noted != self._noted:
            # Another thread has commanded zeros since: the motion begins from rest.
            self._noted = noted
            self._rest()
        reason = self._find_stop_reason(now)
        if self._resting and not reason:
            self._check_start()
            reason = self._find_stop_reason(now)
        reason = reason or self._command(now, robot_time, elapsed, noted)
        if reason and not self._slow_down(now, robot_time, elapsed, noted):
            self._zeros()
        self._set_stop_reason(reason)
        if self._ending and self._resting:
            self.deactivate(self._ending)
        self.completed = boot_time()
        self.figures.add(now, self.completed, self._received)
        self.gaps.begin(self.completed)

    def _command(self, now: float, robot_time: float, elapsed: float, noted: int) -> str:
        """Command velocities; return the reason if that fails, else an empty string."""
        try:
            command = self._controller.update(self._base.configuration(self._buffer.q), now,
                                              self._buffer.passive, elapsed)
        except EvaluationError as error:
            self.stops.latch(str(error), abrupt=False)
            return self._find_stop_reason(now)
        except TpControllerError as error:
            return str(error)
        except Exception as error:  # raised by a user-defined task
            self.stops.latch(in_words(error), abrupt=False)
            self._log.error(traceback.format_exc(), in_words(error))
            return self._find_stop_reason(now)
        took = boot_time() - now
        if took > self._stall:
            self.stops.interrupt(f'a cycle took longer than {self._stall:g} s', now + took)
        elif self.commands.publish(command.velocity, noted):
            self.report, self.reported, self._resting = command.report, now, False
            self._ramp = 0.0
            self._check_motion(command.velocity, robot_time)
            return ''
        return self._find_stop_reason(now + took) or 'interrupted'

    def _slow_down(self, now: float, robot_time: float, elapsed: float, noted: int) -> bool:
        """Command the next velocity of a ramped stop; return False once it is over."""
        if self._resting or not self.deceleration or self.stops.abrupt or self._unknown(now):
            return False
        # No ramp lasts longer than LONGEST_RAMP, at any deceleration.
        fastest = float(np.abs(self._controller.velocity).max(initial=0.0))
        self._ramp = max(self._ramp, self.deceleration, fastest / LONGEST_RAMP)
        velocity = self._controller.slow_down(self._base.configuration(self._buffer.q), now,
                                              self._ramp, elapsed)
        if not velocity.any() or not self.commands.publish(velocity, noted):
            return False
        self._check_motion(velocity, robot_time)
        return True

    def _check_start(self) -> None:
        """Stop until ~/start if a joint is outside its limits before it moves."""
        fault = self._limits.outside(self._buffer.q)
        if fault:
            self.stops.latch(fault)

    def _check_motion(self, velocity: Array, now: float) -> None:
        """Stop until ~/start if the robot does not follow or passes a limit."""
        q, joints = self._buffer.q, velocity[self._controller.robot.joint_columns]
        share = self.permits.speed
        fault = self._limits.passed(q) or self._follow.check(q, share * joints, now) \
            or self._base.follows(velocity, now)
        if fault:
            self.stops.latch(fault)

    def _zeros(self) -> None:
        """Command zeros."""
        self._rest()
        self.commands.zeros()

    def _rest(self) -> None:
        """Reset the state of motion: the next motion begins from rest."""
        self._ramp = 0.0
        if not self._resting:
            # There is no command to follow meanwhile.
            self._forget_motion()
            self._resting = True
        self._controller.halt(boot_time())

    def _forget_motion(self) -> None:
        """Restart the checks of motion."""
        self._limits.forget()
        self._follow.forget()
        self._base.rest()

    def _set_stop_reason(self, reason: str) -> None:
        """Set the stop reason; log a change of it, or that the robot moves again."""
        if reason == self.stop_reason:
            return
        self.stop_reason = reason
        if reason:
            what = 'nothing' if self.commands.silent else 'zeros'
            self._log.warning(f'commanding {what}: {reason}')
            return
        self._log.info('running')
        unheard = self._buffer.unheard()
        if unheard:
            self._log.warning(
                'no joint states of passive joints: until then they count as at zero, or at '
                f'the limit nearest to zero: {", ".join(unheard)}')

    def _find_stop_reason(self, now: float) -> str:
        """Return the reason for zero commands, or an empty string if motion is possible."""
        return self.hold or self.stops.reason(self._missing(now), now)

    def _missing(self, now: float) -> str:
        """Return the input that is late, or the permit that is missing, or an empty string."""
        return self._unknown(now) or self.unmet or self.permits.reason(now)

    def _unknown(self, now: float) -> str:
        """Return the positions that are late, or an empty string if all are known."""
        missing = self._buffer.missing(now, self._timeout)
        if missing:
            return f'no joint states of {", ".join(missing)}' \
                   + self._buffer.dropped.remark(now, self._timeout)
        return self._base.stop_reason(now, self._timeout)

    def _watch(self) -> None:
        """Command zeros if no cycle has run for too long."""
        if not self.active or self._stood_still():
            return
        now = boot_time()
        silence = now - self._last_cycle
        if silence > self._timeout:
            reason = self._find_stop_reason(now)
            # A cycle may be longer than `state_timeout`.
            if not reason and silence > 2.0 * self._period:
                if not self._simulated:
                    # Only the timer is late, as on an overloaded machine.
                    self._cycle()
                    return
                reason = 'simulated time (/clock) stands still'
            if reason:
                self._zeros()
                self._set_stop_reason(reason)
        self.completed = now


def _ordered(robot: Robot, names: list[str] | None) -> list[str]:
    """Return the driven joints in the order of the commands; raise unless all are named."""
    names = names or list(robot.joint_names)
    if sorted(names) != sorted(robot.joint_names):
        raise RobotError('parameter command_joints must be the driven joints in some order '
                         f'({", ".join(robot.joint_names)}), not {", ".join(names)}')
    return names

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
from tp_controller.ros.loop.base_topics import FixedBase, LONGEST_WAIT, MovingBase, waiting
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

# A shorter silence of the loop is not told from the jitter of a busy machine [s].
SHORTEST_STALL = 0.05
# A shorter time between two cycles is none in which nothing waited [s].
SHORTEST_PAUSE = 1e-4
# Longest time that a ramped stop takes [s].
LONGEST_RAMP = 2.0
# Commanded motion of a base, per tolerated jump of its odometry, from which it has to follow: a
# correction by the whole tolerance must not hide that it does.
CORRECTED = 1.5
LATE_CYCLE = 'no cycle was completed within watchdog_timeout'
INACTIVE = 'inactive; activate the node to go on'


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
    unmet : str
        A requirement that is not met; empty where none is.
    permits : Permits
        Inputs that allow motion.
    deceleration : float
        Of a ramped stop [rad/s² or m/s²]; 0: zeros at once.
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
            values['follow_window'], distance=max(0.05, CORRECTED * tolerance), excess=tolerance))
        return MovingBase(self._node, topic, robot, qos, OdometryCheck(robot, late, tolerance),
                          follow)

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
        if self.active:
            # As in a ramped stop that is under way.
            self.deactivate(INACTIVE)
        self.permits.close()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._node.destroy_subscription(self._states)
        self.commands.close()

    @property
    def limit_tolerance(self) -> float:
        """Return by how much a joint may be beyond a position limit [rad or m]."""
        return self._limits.tolerance

    @limit_tolerance.setter
    def limit_tolerance(self, tolerance: float) -> None:
        self._limits.tolerance = tolerance

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
        """Command something from now on, by what is received from now on."""
        self._buffer.discard()
        self._base.discard()
        self._heard = self.completed = boot_time()
        self.active, self._ending = True, ''

    def deactivate(self, reason: str) -> None:
        """Command zeros for the last time, at once, and say why."""
        self.active, self.stop_reason, self._ending = False, reason, ''
        self.commands.interrupt(LAST_ZEROS)

    def come_to_rest(self, reason: str) -> None:
        """Deactivate the loop after a ramped stop, at once where there is nothing to ramp."""
        if self.deceleration and self.active and not self._resting:
            self.hold, self._ending = reason, reason
        else:
            self.deactivate(reason)

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
        return self._buffer.lasting(now) or self._base.lasting(now) or self._unknown(now) \
            or self.unmet or self.permits.refusal() or self._limits.outside(self._buffer.q)

    def restart(self) -> None:
        """Forget the faults that are over, and let tasks without a goal stay where they are."""
        self._controller.restart()
        self._buffer.forget()
        self._base.forget()
        self._forget_motion()
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
        return max(pause, now - self._busy_since, self._buffer.delay) > LONGEST_WAIT

    def _put(self, raw: bytes) -> None:
        """Take joint positions, or say why not."""
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
        """Stop, until ~/start, if positions have jumped while the robot moved."""
        if source.contradiction and self.stops.moved:
            self.stops.latch(source.contradiction)
        elif source.contradiction:
            # As of a driver that publishes zeros before it has read any position.
            source.forget()

    def _on_odometry(self, message: Odometry) -> None:
        """Take odometry; it starts the cycle without a timer and without driven joints."""
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
        """Take odometry and return True, or log why not."""
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
        self._log.warning(f'the node stood still for {silence:.2g} s', 'stall')
        self.stops.interrupt(f'the node stood still for longer than {self._stall:g} s', now)
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
        if not self.active:
            # The last zeros have been commanded since this cycle was called.
            return
        if noted != self._noted:
            # Others have commanded zeros since: the motion begins from rest.
            self._noted = noted
            self._rest()
        reason = self._find_stop_reason(now)
        if self._resting and not reason:
            self._check_start()
            reason = self._find_stop_reason(now)
        reason = reason or self._command(now, robot_time, elapsed, noted)
        if reason and not self._slow_down(now, robot_time, elapsed, noted):
            self._zeros()
        self._tell(reason)
        if self._ending and self._resting:
            self.deactivate(self._ending)
        self.completed = boot_time()
        self.figures.add(now, self.completed, self._received)
        self.gaps.begin(self.completed)

    def _command(self, now: float, robot_time: float, elapsed: float, noted: int) -> str:
        """Command velocities; return why not, else nothing."""
        try:
            command = self._controller.update(self._base.configuration(self._buffer.q), now,
                                              self._buffer.passive, elapsed)
        except EvaluationError as error:
            self.stops.latch(str(error), abrupt=False)
            return self._find_stop_reason(now)
        except TpControllerError as error:
            return str(error)
        except Exception as error:  # of a task that somebody else wrote
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
        """Command the next velocity of a ramped stop; return whether there is one."""
        if self._resting or not self.deceleration or self.stops.abrupt or self._unknown(now):
            return False
        # No ramp lasts longer, however small its deceleration was chosen.
        fastest = float(np.abs(self._controller.velocity).max(initial=0.0))
        self._ramp = max(self._ramp, self.deceleration, fastest / LONGEST_RAMP)
        velocity = self._controller.slow_down(self._base.configuration(self._buffer.q), now,
                                              self._ramp, elapsed)
        if not velocity.any() or not self.commands.publish(velocity, noted):
            return False
        self._check_motion(velocity, robot_time)
        return True

    def _check_start(self) -> None:
        """Stop, until ~/start, if a joint is outside of its limits before it is moved."""
        fault = self._limits.outside(self._buffer.q)
        if fault:
            self.stops.latch(fault)

    def _check_motion(self, velocity: Array, now: float) -> None:
        """Stop, until ~/start, if the robot does not follow or passes a limit."""
        q, joints = self._buffer.q, velocity[self._controller.robot.joint_columns]
        share = self.permits.speed
        fault = self._limits.passed(q) or self._follow.check(q, share * joints, now) \
            or self._base.follows(velocity, now)
        if fault:
            self.stops.latch(fault)

    def _zeros(self) -> None:
        """Command no motion."""
        self._rest()
        self.commands.zeros()

    def _rest(self) -> None:
        """Let the next motion begin from rest."""
        self._ramp = 0.0
        if not self._resting:
            # Nothing is to be followed meanwhile.
            self._forget_motion()
            self._resting = True
        self._controller.halt(boot_time())

    def _forget_motion(self) -> None:
        """Let the checks of motion begin anew."""
        self._limits.forget()
        self._follow.forget()
        self._base.rest()

    def _tell(self, reason: str) -> None:
        """Log why the robot is stopped, or that it moves again, where that has changed."""
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
        """Return why zeros are commanded; empty if nothing speaks against motion."""
        return self.hold or self.stops.reason(self._missing(now), now)

    def _missing(self, now: float) -> str:
        """Return what has not arrived for too long, or is not allowed now; empty if nothing."""
        return self._unknown(now) or self.unmet or self.permits.reason(now)

    def _unknown(self, now: float) -> str:
        """Return which positions have not arrived for too long; empty if all are known."""
        missing = self._buffer.missing(now, self._timeout)
        if missing:
            return f'no joint states of {", ".join(missing)}' \
                   + self._buffer.dropped.remark(now, self._timeout)
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

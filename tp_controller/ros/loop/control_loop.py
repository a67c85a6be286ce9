# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The control loop: joint states and odometry in, commands out."""

from collections.abc import Callable
import math
import traceback
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer
from tp_controller.control.report import Report
from tp_controller.errors import EvaluationError, in_words, RobotError, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.ros.log import Log
from tp_controller.ros.loop.base_topics import make_base
from tp_controller.ros.loop.clocks import boot_time, RobotClock
from tp_controller.ros.loop.commanded_motion import Beginning, CommandedMotion
from tp_controller.ros.loop.commands import Commands, LAST_ZEROS
from tp_controller.ros.loop.cycle_scheduling import Gaps
from tp_controller.ros.loop.deadlines import promise
from tp_controller.ros.loop.loop_statistics import Figures
from tp_controller.ros.loop.measurements import Measurements
from tp_controller.ros.loop.motion_checks import MotionChecks
from tp_controller.ros.loop.permits import Permits
from tp_controller.ros.loop.ramped_stop import RampedStop
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.loop.stop_reasons import Stops
from tp_controller.ros.parameters import names_in

# Shortest silence of the loop that counts as a stall [s]: less is jitter of a busy machine.
SHORTEST_STALL = 0.05
LATE_CYCLE = 'no cycle was completed within watchdog_timeout'
INACTIVE = 'inactive; activate the node to go on'
BRAKING = 'coming to rest after a stop'


class ControlLoop:
    """
    Cycles of a controller, run by a timer or once per joint state.

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
    active : bool
        Commands are published at all.
    stop_reason : str
        Reason for which zeros are commanded; empty while the tasks are executed.
    report : Report or None
        Report of the last cycle that executed the tasks.
    reported : float
        Start of that cycle [s].
    measurements, checks, permits, stops, ramp, commands, figures, gaps
        Parts of the loop, in the order of a cycle; see their classes.

    """

    def __init__(self, node: Node, topic: Callable[[str], str], controller: SharedController,
                 values: dict[str, Any], log: Log) -> None:
        self._node, self._controller, self._log = node, controller, log
        self._rate, self._timeout = values['rate'], values['state_timeout']
        self._period = 1.0 / self._rate if self._rate > 0.0 else self._timeout
        robot = controller.robot
        names = _ordered(robot, names_in(values['command_joints']))
        qos = promise(values['command_deadline'])
        base = make_base(node, topic, robot, qos, values)
        self._clock = clock = RobotClock(node)
        self.commands = Commands(node, topic, robot, names, base, qos, values,
                                 lambda: clock.time(boot_time()))
        self.stops = Stops(values['settle_time'])
        self.measurements = Measurements(robot, base, values, self.stops, log, boot_time,
                                         clock)
        self.checks = MotionChecks(robot, base, values, self._lock)
        self.permits = Permits(node, topic, values, self.stops, boot_time)
        self.ramp = RampedStop(controller, values['stop_deceleration'])
        self._motion = CommandedMotion(controller, self.measurements, self.commands, self.ramp,
                                       self.checks, self.permits, self.stops)
        self.hold = self.stop_reason = INACTIVE
        self.unmet = self._ending = ''
        self.active, self._noted = False, 0
        self.report: Report | None = None
        self.reported = -math.inf
        self.figures = Figures(1.0 / self._rate if self._rate > 0.0 else math.inf)
        self.gaps = Gaps()
        self._last_callback = self.completed = self._last_cycle = boot_time()
        self._last_robot_time = self._clock.time(self._last_callback)
        self._stall = max(self._timeout, SHORTEST_STALL)
        # Created last: the thread of the node may call back at once. The callbacks return
        # until `activate`.
        self.measurements.listen(node, topic, self.figures, self._on_joint_state,
                                 self._on_odometry)
        self._timers = self._start_timers(values['watchdog_timeout'])

    def _start_timers(self, watchdog_timeout: float) -> list[Timer]:
        """Start the timers of the cycle, and of its supervision on the steady clock."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        # If neither joint states nor simulated time arrive, only this timer commands zeros.
        timers = [self._node.create_timer(min(self._timeout, watchdog_timeout) / 2.0, self._watch,
                                          clock=steady)]
        if self._rate > 0.0:
            timers.append(self._node.create_timer(
                1.0 / self._rate, self._on_timer, clock=None if self._clock.simulated else steady))
        return timers

    def close(self) -> None:
        """Destroy topics and timers."""
        if self.active:
            # During a ramped stop, for example.
            self.deactivate(INACTIVE)
        self.permits.close()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self.measurements.close(self._node)
        self.commands.close()

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
        self.measurements.discard()
        self.commands.output.resume()
        self._last_callback = self.completed = boot_time()
        self.active, self._ending = True, ''

    def deactivate(self, reason: str) -> None:
        """Command zeros for the last time, at once, and set the reason."""
        self.active, self.stop_reason, self._ending = False, reason, ''
        self.commands.interrupt(LAST_ZEROS)

    def come_to_rest(self, reason: str) -> None:
        """Deactivate the loop after a ramped stop, or at once at rest."""
        if self.active and self._motion.ends_slowly:
            self.hold, self._ending = reason, reason
        else:
            self.deactivate(reason)

    def lasting(self) -> str:
        """Return the reason for which the robot must not start now, or an empty string."""
        return self.measurements.lasting(boot_time()) or self.unmet or self.permits.refusal() \
            or self.checks.limits.outside(self.measurements.joints.q)

    def restart(self) -> None:
        """Clear the faults that are over; tasks without a goal keep their current values."""
        self._controller.restart()
        self.measurements.forget()
        self.checks.forget()
        self.stops.clear()

    # Inputs -------------------------------------------------------------------------------

    def _on_joint_state(self, raw: bytes) -> None:
        """Store all queued joint positions; without a timer they start the cycle."""
        now, measurements = boot_time(), self.measurements
        if not self.active or self._stood_still(now):
            return
        measurements.take_joint_states(raw, now, self.completed)
        if self._rate == 0.0 and measurements.joints.take_complete():
            self._cycle()

    def _on_odometry(self, message: Odometry) -> None:
        """Store odometry; it starts the cycle without a timer and without driven joints."""
        received = boot_time()
        if not self.active or self._stood_still(received):
            return
        good = self.measurements.take_odometry(message)
        if good and self._rate == 0.0 and not self._controller.robot.joint_names:
            self.measurements.received = received
            self._cycle()

    def _on_timer(self) -> None:
        """Run a cycle."""
        if self.active and not self._stood_still(boot_time()):
            self._cycle()

    def _stood_still(self, now: float) -> bool:
        """
        Return whether this callback is the first after the node stood still for too long.

        Queued messages are then old, and the robot has stopped by itself or has followed its last
        command. The loop discards its inputs and starts again from the current configuration.
        """
        silence, self._last_callback = now - self._last_callback, now
        if silence <= self._stall:
            return False
        self.measurements.drop_queued()
        self.measurements.discard()
        self.figures.stalls += 1
        self._log.warning(f'the node stood still for {silence:.2g} s', 'stall')
        self.stops.interrupt(f'the node stood still for longer than {self._stall:g} s', now)
        self._motion.zeros(now)
        self._set_stop_reason(self._find_stop_reason(now))
        self.completed = now
        return True

    # The cycle ----------------------------------------------------------------------------

    def _cycle(self) -> None:
        """Run a cycle: command velocities, or zeros if an input is missing."""
        now = boot_time()
        robot_time = self._clock.time(now) if self._clock.simulated else now
        elapsed = robot_time - self._last_robot_time
        self._last_cycle, self._last_robot_time = now, robot_time
        self.checks.ignore(self._controller.locked)
        motion, noted = self._motion, self.commands.interruptions
        cycle = Beginning(now, robot_time, elapsed, noted, now + self._stall)
        if not self.active:
            # The loop was deactivated, with its last zeros, after this callback began.
            return
        if noted != self._noted:
            # Another thread has commanded zeros since: the motion begins from rest.
            self._noted = noted
            motion.rest(now)
        reason = self._find_stop_reason(now)
        if motion.resting and not reason:
            # A joint may be outside its limits before it moves.
            self.stops.latch(self.checks.limits.outside(self.measurements.joints.q))
            reason = self._find_stop_reason(now)
            reason = reason or ('' if motion.is_over else BRAKING)
        reason = reason or self._command(cycle)
        if reason and not motion.slow_down(cycle):
            motion.zeros(boot_time())
        self._set_stop_reason(reason)
        self._end_at_rest()
        self.completed = boot_time()
        self.figures.add(now, self.completed, self.measurements.received)
        self.gaps.begin(self.completed)

    def _command(self, cycle: Beginning) -> str:
        """Command velocities; return the reason if that fails, else an empty string."""
        now = cycle.now
        try:
            command = self._controller.update(self._motion.configuration(cycle), now,
                                              self.measurements.passive, cycle.elapsed)
        except EvaluationError as error:
            self.stops.latch(str(error), abrupt=False)
            return self._find_stop_reason(now)
        except TpControllerError as error:
            return str(error)
        except Exception as error:  # raised by a user-defined task
            self.stops.latch(in_words(error), abrupt=False)
            self._log.error(traceback.format_exc(), in_words(error))
            return self._find_stop_reason(now)
        if self._motion.publish(command.velocity, cycle):
            self.report, self.reported = command.report, now
            self._motion.begin()
            return ''
        took = boot_time() - now
        if took > self._stall:
            self.stops.interrupt(f'a cycle took longer than {self._stall:g} s', now + took)
        return self._find_stop_reason(now + took) or 'interrupted'

    def _lock(self, joint: str, fault: str) -> None:
        """Lock a joint in place of a stop."""
        self._controller.lock([joint], boot_time())
        self._log.warning(f'locked {joint}, the others go on: {fault}')

    def _end_at_rest(self) -> None:
        """Deactivate the loop after a ramped stop."""
        if self._ending and self._motion.is_over:
            self.deactivate(self._ending)

    def _set_stop_reason(self, reason: str) -> None:
        """Set the stop reason; log a change of it, or that the robot moves again."""
        changed, self.stop_reason = reason != self.stop_reason, reason
        if changed and reason:
            what = self.commands.stopped
            self._log.warning(f'commanding {what}: {reason}')
        elif changed:
            self._log.info('running')
            self.measurements.warn_of_passive()

    def _find_stop_reason(self, now: float) -> str:
        """Return the reason for zero commands, or an empty string if motion is possible."""
        return self.hold or self.stops.reason(
            self.measurements.missing(now) or self.unmet or self.permits.reason(now), now)

    def _watch(self) -> None:
        """Command zeros if no cycle has run for too long, or none will as an input is missing."""
        now = boot_time()
        if not self.active or self._stood_still(now):
            return
        silence = now - self._last_cycle
        if silence > self._timeout or self.measurements.missing(now):
            reason = self._find_stop_reason(now)
            # A cycle may be longer than `state_timeout`.
            if not reason and silence > 2.0 * self._period:
                if not self._clock.simulated:
                    # Only the timer is late, as on an overloaded machine.
                    self._cycle()
                    return
                reason = 'simulated time (/clock) stands still'
            if reason:
                self._motion.zeros(now)
                self._set_stop_reason(reason)
                self._end_at_rest()
        self.completed = now


def _ordered(robot: Robot, names: list[str] | None) -> list[str]:
    """Return the driven joints in the order of the commands; raise unless all are named."""
    names = names or list(robot.joint_names)
    if sorted(names) != sorted(robot.joint_names):
        raise RobotError('parameter command_joints must be the driven joints in some order '
                         f'({", ".join(robot.joint_names)}), not {", ".join(names)}')
    return names

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Commanded motion: velocities of a cycle, ramped stops and zeros, and checks that they act."""

from typing import NamedTuple

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.ros.loop.commands import Commands
from tp_controller.ros.loop.measurements import Measurements
from tp_controller.ros.loop.motion_checks import MotionChecks
from tp_controller.ros.loop.outputs import Moment
from tp_controller.ros.loop.permits import Permits
from tp_controller.ros.loop.ramped_stop import RampedStop
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.loop.stop_reasons import Stops


class Beginning(NamedTuple):
    """
    Beginning of a cycle.

    Attributes
    ----------
    now, robot_time : float
        Time on the clock of timeouts, and on the clock of the robot [s].
    elapsed : float
        Time since the last cycle on the clock of the robot [s].
    noted : int
        `Commands.interruptions` then.
    latest : float
        Time after which its command is too late [s].

    """

    now: float
    robot_time: float
    elapsed: float
    noted: int
    latest: float


class CommandedMotion:
    """
    Motion that the robot is commanded to, in motion and in stops.

    Parameters
    ----------
    controller : SharedController
    measurements : Measurements
    commands : Commands
    ramp : RampedStop
    checks : MotionChecks
    permits : Permits
    stops : Stops

    Attributes
    ----------
    resting : bool
        The robot is stopped, not in a ramped stop.

    """

    def __init__(self, controller: SharedController, measurements: Measurements,
                 commands: Commands, ramp: RampedStop, checks: MotionChecks, permits: Permits,
                 stops: Stops) -> None:
        self._controller, self._measurements, self._commands = controller, measurements, commands
        self._ramp, self._checks, self._permits, self._stops = ramp, checks, permits, stops
        self.resting = True

    @property
    def is_over(self) -> bool:
        """Return whether the robot is stopped, and the output is at rest."""
        return self.resting and self._commands.output.at_rest

    @property
    def ends_slowly(self) -> bool:
        """Return whether the robot moves, and a stop takes several cycles."""
        return not self.is_over and (self._ramp.deceleration > 0.0 or self._commands.output.holds)

    def configuration(self, cycle: Beginning) -> Array:
        """Return the configuration that the next command starts from, (nq,)."""
        measured = self._measurements.joints.q
        joints = self._commands.output.positions(measured, cycle.robot_time)
        if self._checks.ignores:
            # They are where they are, whatever is commanded.
            joints = np.where(self._checks.ignored, measured, joints)
        return self._measurements.base.configuration(joints)

    def publish(self, velocity: Array, cycle: Beginning) -> bool:
        """Publish velocities (n,), and stop until ~/start if the robot does not follow."""
        q, commands = self._measurements.joints.q, self._commands
        if not commands.publish(velocity, cycle.noted, cycle.latest,
                                Moment(cycle.robot_time, q, self._permits.speed)):
            return False
        fault = self._checks.fault(q, velocity, commands.output, cycle.robot_time)
        self._stops.latch(fault, joint=self._checks.failing)
        return True

    def begin(self) -> None:
        """Record that velocities of the tasks were published."""
        self.resting = False
        self._ramp.reset()

    def slow_down(self, cycle: Beginning) -> bool:
        """Command the next velocity of a ramped stop; return False once it is over."""
        if self.resting or not self._ramp.deceleration or self._stops.abrupt \
                or self._measurements.missing(cycle.now):
            return False
        velocity = self._ramp.velocity(self.configuration(cycle), cycle.now, cycle.elapsed)
        return bool(velocity.any()) and self.publish(velocity, cycle)

    def zeros(self, now: float) -> None:
        """Command zeros at a time [s]."""
        self.rest(now)
        self._commands.zeros(None if self._measurements.missing(now)
                             else self._measurements.joints.q)

    def rest(self, now: float) -> None:
        """Reset the state of motion: the next motion begins from rest."""
        self._ramp.reset()
        if not self.resting:
            # There is no command to follow meanwhile.
            self._checks.forget()
            self.resting = True
        self._controller.halt(now)

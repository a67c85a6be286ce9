# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""A world in which time is computed: the loop of the node, a robot, and who reports about it."""

from collections import deque
import itertools
from types import SimpleNamespace

from geometry_msgs.msg import TwistStamped
from monitor import Monitor, PositionMonitor
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller import Stack
from tp_controller.control.settings import Settings
from tp_controller.ros.declarations.controller import PARAMETERS
from tp_controller.ros.log import Log
from tp_controller.ros.loop import commands
from tp_controller.ros.loop import control_loop as loop_module
from tp_controller.ros.loop.base_topics import fill_odometry, twist_of
from tp_controller.ros.loop.control_loop import ControlLoop
from tp_controller.ros.loop.shared_controller import SharedController
from trajectory_msgs.msg import JointTrajectory

# Step of the world, and between two joint states [s].
STEP, STATE_PERIOD = 0.001, 0.005
# The clock of the robot's computer is another one.
CLOCK_OFFSET = 1.7e9
# Longest time in which a drive goes to a position, and its time constant [s].
LONGEST_WAY, DRIVE_SECONDS = 0.05, 0.02
# Time in which the robots of these tests brake, and come to the last positions [s].
BRAKING_SECONDS = 0.6
DEFAULTS = {spec.name: spec.default for spec in PARAMETERS}


def ideal(velocity):
    """Return the velocities of a robot that does as it is told."""
    return velocity


class Queue:
    """The queue of a subscription: what came last, as many messages as its depth."""

    def __init__(self, kind, raw, callback, depth):
        self.msg_type, self.raw = kind, raw
        self.callback, self._messages = callback, deque(maxlen=depth)
        self.handle = self

    def put(self, message):
        """Take a message that arrives."""
        self._messages.append(message)

    def take_message(self, kind, raw):
        """Return the oldest message, as the handle of a real one does."""
        return (self._messages.popleft(), None) if self._messages else None

    def run(self):
        """Call back with all messages, the oldest first."""
        while self._messages:
            self.callback(self._messages.popleft())

    def __enter__(self):
        """Return the queue, as a handle does."""
        return self

    def __exit__(self, *_):
        """Leave it."""


class WorldNode:
    """What the loop needs of a node."""

    def __init__(self, world):
        self._world, self.queues, self.timers = world, [], []

    def create_subscription(self, kind, topic, callback, qos, raw=False, **_):
        """Return a queue."""
        self.queues.append(Queue(kind, raw, callback, qos.depth))
        return self.queues[-1]

    def create_timer(self, period, callback, clock=None):
        """Return a timer: when it is due, how long it takes, and what it calls."""
        self.timers.append(SimpleNamespace(due=self._world.now + period, period=period,
                                           callback=callback))
        return self.timers[-1]

    def create_publisher(self, kind, topic, qos, **_):
        """Return what hands commands to the world."""
        world = self._world
        hear = {'velocity_controller/commands': world.hear, 'cmd_vel': world.hear_base}.get(
            topic, world.hear_positions)
        return SimpleNamespace(publish=hear)

    def get_parameter(self, name):
        """Return that time is not simulated for those who ask."""
        return SimpleNamespace(value=False)

    def get_clock(self):
        """Return a clock that nobody simulates."""
        return SimpleNamespace(ros_time_is_active=False,
                               now=lambda: Time(nanoseconds=round(1e9 * self._world.now)))


class World:
    """
    A robot that goes on as it was told last, its joint states, and the loop that controls it.

    Where it is told positions, it goes to each on a line, within the time between the last two.

    Parameters
    ----------
    patch : pytest.MonkeyPatch
        Replaces the clock of the loop and of its commands.
    robot : Robot
    stack : str
        YAML.
    q : array_like (n,)
        Where the robot is.
    values : dict
        Parameters of the node that differ from their defaults.

    Attributes
    ----------
    report : callable
        Called every `STATE_PERIOD` with the world; returns the joint states that arrive then.
    frozen : bool
        The process of the controller is stopped.
    plant : callable
        Called with the command, or the velocities to the commanded positions; returns the
        velocities that the robot has. If it is `ideal`, a robot that is away from commanded
        positions comes to them.
    monitor : Monitor
    told : list of str
        Why the robot was stopped, one after another.
    sent : sequence of float
        Positions of the last joint state.
    locate : callable
        As `report`, of the odometry of a base that moves.
    slip : callable
        Called with the velocities of the base; returns those that it has.

    """

    def __init__(self, patch, robot, stack, q, **values):
        self.now, self.robot = 100.0, robot
        for module in (loop_module, commands):
            patch.setattr(module, 'boot_time', lambda: self.now)
        values = {**DEFAULTS, **values}
        self.values = values
        self.period = 1.0 / values['rate'] if values['rate'] else values['state_timeout']
        self.q = np.array(q, dtype=float)
        self.velocity = np.zeros(len(robot.joint_names))
        # Where positions are commanded: the last ones, and where the drives are on their way.
        self.target, self.setpoint, self.arrives = None, self.q, self.now
        # Where base and joints truly are, and how the base was commanded to move.
        self.base = robot.configuration(self.q)[:robot.nq - len(self.q)]
        self.twist = np.zeros(robot.n - len(self.q))
        self.locate, self.slip = (lambda world: [world.odometry()]), (lambda velocity: velocity)
        self.heard_at = self.now
        self.holds = values['output'] != 'velocity'
        self.monitor = PositionMonitor() if self.holds else Monitor()
        self.told, self.located = [], []
        self.report, self.plant = (lambda world: [world.state()]), ideal
        self.frozen, self.receiver_timeout = False, np.inf
        self.controller = SharedController(robot, Stack.from_yaml(stack, robot),
                                           Settings(period=self.period))
        self.node = WorldNode(self)
        self.loop = ControlLoop(self.node, str, self.controller, values,
                                Log(SimpleNamespace(warning=None, info=None, error=None)))
        self.loop.hold = ''
        self.loop.activate()
        self._steps = itertools.count()

    def state(self, q=None, stamp=None, names=None):
        """Return a joint state: true by default."""
        if q is None and stamp is None:
            self.monitor.heard.append(self.now)
        stamp = self.now if stamp is None else stamp
        message = JointState(name=list(names or self.robot.joint_names),
                             position=list(self.q if q is None else q))
        message.header.stamp = Time(nanoseconds=round(1e9 * (CLOCK_OFFSET + stamp))).to_msg()
        return message

    def odometry(self, base=None, stamp=None):
        """Return odometry: true by default."""
        if base is None and stamp is None:
            self.located.append(self.now)
        stamp = self.now if stamp is None else stamp
        message = Odometry()
        fill_odometry(message, self.robot.base_placement(
            np.concatenate((self.base if base is None else base, self.q))), np.zeros(6))
        message.header.stamp = Time(nanoseconds=round(1e9 * (CLOCK_OFFSET + stamp))).to_msg()
        return message

    def hear_base(self, raw):
        """Take a command for the base."""
        self.twist = self.robot.base_velocities(twist_of(
            deserialize_message(raw, TwistStamped).twist))

    def hear(self, raw):
        """Take a command."""
        velocity = deserialize_message(raw, Float64MultiArray).data
        self.velocity, self.heard_at = np.array(velocity), self.now
        self.monitor.command(self.now, velocity)

    def hear_positions(self, raw):
        """Take commanded positions, alone or as a trajectory of one point."""
        trajectory = self.values['output'] == 'trajectory'
        message = deserialize_message(raw, JointTrajectory if trajectory else Float64MultiArray)
        if trajectory:
            point, = message.points
            assert message.joint_names == list(self.robot.joint_names)
            assert message.header.stamp.sec == message.header.stamp.nanosec == 0
            assert not point.velocities and not point.time_from_start.sec
            assert 2e7 <= point.time_from_start.nanosec <= max(2.0e9 * self.period, 2e7)
        target = np.array(point.positions if trajectory else message.data)
        interval, self.heard_at = self.now - self.heard_at, self.now
        if self.target is None or interval > LONGEST_WAY:
            # The first command, or a start: the robot may have been moved meanwhile.
            self.setpoint = target if self.target is None else self.setpoint
            interval = LONGEST_WAY
        elif interval == 0.0:
            interval = STEP
        self.monitor.positions_command(self.now, target, self.q)
        self.target, self.arrives = target, self.now + interval
        velocity = (target - self.setpoint) / interval
        # But for rounding errors.
        self.velocity = np.where(np.abs(velocity) < 1e-9, 0.0, velocity)

    def run(self, seconds, until=None):
        """Let time go by, or until something has happened; return whether it has."""
        for _ in range(round(seconds / STEP)):
            self._step()
            if until is not None and until():
                return True
        return until is None

    def stopped(self):
        """Return why the robot is stopped."""
        return self.loop.stop_reason

    def settle(self):
        """Let a robot whose positions are commanded brake; check that it is at rest."""
        if self.holds:
            self.run(BRAKING_SECONDS)
        assert not self.velocity.any()

    def is_at(self, q):
        """Return whether the robot is where it was, or comes there, if it is told positions."""
        return np.allclose(self.q, q, rtol=0.0, atol=1e-6 if self.holds else 0.0)

    def moving(self):
        """Return whether the robot is commanded to move, by more than a little."""
        return bool(np.abs(self.velocity).max() > 0.2)

    def _step(self):
        """Make one step of the robot, of its joint states and of the loop."""
        self.now += STEP
        if self.now - self.heard_at > self.receiver_timeout:
            self.velocity = np.zeros(len(self.q))
        self.q = self.q + STEP * (self._driven() if self.holds else self.plant(self.velocity))
        if self.robot.moves:
            whole = np.concatenate((self.base, self.q))
            moved = self.robot.integrate(whole, np.concatenate((
                self.slip(self.twist), np.zeros(len(self.q)))), STEP)
            self.base = moved[:len(self.base)]
        self.monitor.position(self.now, self.q)
        if next(self._steps) % round(STATE_PERIOD / STEP) == 0:
            for message in self.report(self):
                self.node.queues[0].put(serialize_message(message))
                self.sent = message.position
            for message in self.locate(self) if self.robot.moves else ():
                self.node.queues[1].put(message)
        if not self.frozen:
            self._run_loop()

    def _driven(self):
        """Return the velocities of a robot that goes to commanded positions."""
        if self.now > self.arrives + 1e-9:
            self.velocity = np.zeros(len(self.q))
        self.setpoint = self.setpoint + STEP * self.velocity
        if self.plant is not ideal or self.target is None:
            return self.plant(self.velocity)
        limit = self.robot.velocity[self.robot.joint_columns]
        return np.clip(self.velocity + (self.setpoint - self.q) / DRIVE_SECONDS, -limit, limit)

    def _run_loop(self):
        """Do what an executor does."""
        for queue in self.node.queues:
            queue.run()
        for timer in self.node.timers:
            if self.now >= timer.due - 1e-9:
                timer.callback()
                # Calls that were missed are not made up for.
                missed = np.floor((self.now - timer.due + 1e-9) / timer.period)
                timer.due += (missed + 1.0) * timer.period
        if not self.loop.stop_reason:
            return
        if not self.told or self.told[-1] != self.loop.stop_reason:
            self.told.append(self.loop.stop_reason)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulator node: a kinematic robot with the topics of a real one."""

from array import array
from collections.abc import Sequence
from functools import partial
import math
import sys
import time
from typing import Any

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from tp_controller.errors import RobotError
from tp_controller.model.simulator import initial_positions, KinematicSimulator, SimulatorNoise
from tp_controller.ros.adaptive_subscription import AdaptiveSubscription
from tp_controller.ros.declarations.simulator import PARAMETERS
from tp_controller.ros.interface.limit_parameters import LimitParameters, robot_from
from tp_controller.ros.interface.tf_frames import TfBroadcast
from tp_controller.ros.loop.base_topics import fill_odometry, twist_of
from tp_controller.ros.loop.deadlines import promise
from tp_controller.ros.loop.state_checks import LimitCheck
from tp_controller.ros.parameters import (
    accept_numbers,
    declare,
    keep_fixed,
    names_in,
    warn_unknown,
)
from tp_controller.ros.runner import ClosableNode, run
from tp_controller.ros.twist_topic import TwistSubscription
from trajectory_msgs.msg import JointTrajectory

NAME = 'tp_simulator'
# Delay of the simulation beyond which it stops catching up [s].
LARGEST_DELAY = 0.2


class SimulatorNode(ClosableNode):
    """Node that integrates commands and publishes joint states, on its own timer."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        values = declare(self, PARAMETERS)
        robot = robot_from(LimitParameters(self), values)
        if robot is None:
            raise RobotError('parameter robot (a file) or robot_description (URDF text) is needed')
        self._robot = robot
        self._speed, self._dt = values['speed'], 1.0 / values['rate']
        self._simulator = KinematicSimulator(
            self._robot,
            initial_positions(values['initial_positions'] or '{}', self._robot),
            # The timeout protects against a dead controller, so it runs on the wall clock at
            # any speed of the simulation.
            values['command_timeout'] * self._speed,
            SimulatorNoise(values['noise'], values['delay'], values['lag'], values['drop'],
                           values['seed']))
        names = self._check_names(names_in(values['command_joints']) or self._robot.joint_names)
        self._warn_outside()
        self._commanded = np.array([self._robot.joint_index(name) for name in names],
                                   dtype=int)
        self._velocity = np.zeros(self._robot.n)
        self._publish_clock = values['publish_clock']
        self._state_qos = promise(values['state_deadline'])
        self._tf = TfBroadcast(self) if values['publish_tf'] and robot.moves else None
        self._connect()
        keep_fixed(self)
        accept_numbers(self)
        warn_unknown(self)
        self.get_logger().info(
            f'simulating {self._robot.name} ({len(self._robot.joint_names)} joints, base '
            f'{self._robot.base}) at {self._speed:g} × real '
            f'time, commands for {", ".join(names)}')

    def close(self, reason: str) -> None:
        """Do nothing: the robot stops by itself."""

    def _check_names(self, names: Sequence[str]) -> Sequence[str]:
        """Return the names of the commanded joints; raise unless they are joints, each once."""
        if not set(names) <= set(self._robot.joint_names) or len(set(names)) < len(names):
            raise RobotError('parameter command_joints must be some of the joints, each once '
                             f'({", ".join(self._robot.joint_names)}), not {", ".join(names)}')
        return names

    def _warn_outside(self) -> None:
        """Warn of a start outside the position limits, where no controller moves a robot."""
        robot, rows = self._robot, self._robot.joint_columns
        fault = LimitCheck(robot.joint_names, robot.lower[rows], robot.upper[rows], 0.0).outside(
            self._simulator.q[robot.joint_rows])
        if fault:
            self.get_logger().warning(f'initial_positions: {fault}')

    def _connect(self) -> None:
        """Create publishers, the subscription, the service and the timer."""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._description = self.create_publisher(String, 'robot_description', latched)
        self._description.publish(String(data=self._robot.urdf))
        self._states = self.create_publisher(JointState, 'joint_states', self._state_qos)
        self._message = JointState(name=list(self._robot.joint_names))
        self._message.position = array('d', bytes(8 * len(self._message.name)))
        self._message.velocity = array('d', bytes(8 * len(self._message.name)))
        self._position_view = np.frombuffer(self._message.position)
        self._velocity_view = np.frombuffer(self._message.velocity)
        self._clock_publisher = None
        if self._publish_clock:
            self._clock_publisher = self.create_publisher(ClockMessage, '/clock', 10)
        AdaptiveSubscription(self, Float64MultiArray, 'velocity_controller/commands',
                             self._on_command)
        AdaptiveSubscription(self, Float64MultiArray, 'position_controller/commands',
                             self._on_positions)
        AdaptiveSubscription(self, JointTrajectory, 'joint_trajectory_controller/joint_trajectory',
                             self._on_trajectory)
        self._odometry_publisher = None
        if self._robot.moves:
            self._odometry = Odometry(child_frame_id=self._robot.base_frame)
            self._odometry.header.frame_id = self._robot.root
            self._odometry_publisher = self.create_publisher(Odometry, 'odom', 10)
            TwistSubscription(self, 'cmd_vel', self._on_base_command)
        self.create_service(Trigger, '~/reset', self._on_reset)
        self._start_time = time.monotonic()
        self._steps_since_start = 0
        self.create_timer(self._dt / self._speed, self._on_timer,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_command(self, message: Float64MultiArray) -> None:
        """Apply a command to the joints."""
        if self._fits(message, 'velocities'):
            self._velocity[self._commanded] = message.data
            self._apply(self._robot.joint_columns, 'command')

    def _on_positions(self, message: Float64MultiArray) -> None:
        """Apply positions of the joints."""
        if self._fits(message, 'positions'):
            self._follow(self._commanded, message.data, 0.0)

    def _fits(self, message: Float64MultiArray, kind: str) -> bool:
        """Return whether there is one number for each commanded joint; log where there is not."""
        joints = len(self._commanded)
        if len(message.data) == joints:
            return True
        self._refuse(f'{len(message.data)} {kind} for {joints} joints; the parameter '
                     'command_joints names them')
        return False

    def _on_trajectory(self, message: JointTrajectory) -> None:
        """Apply the last point of a trajectory, in joints of any order."""
        unknown = set(message.joint_names) - set(self._robot.joint_names)
        if unknown or not message.points:
            self._refuse(f'a trajectory without points, or of unknown joints: {sorted(unknown)}')
            return
        point = message.points[-1]
        self._follow([self._robot.joint_index(name) for name in message.joint_names],
                     point.positions, point.time_from_start.sec
                     + 1e-9 * point.time_from_start.nanosec)

    def _follow(self, joints: Sequence[int] | np.ndarray, positions: Sequence[float],
                duration: float) -> None:
        """Pass the positions of some joints to the simulator; others hold theirs."""
        if len(positions) != len(joints):
            self._refuse(f'{len(positions)} positions for {len(joints)} joints')
            return
        target = self._robot.positions(self._simulator.q).copy()
        target[joints] = positions
        if not np.isfinite(target).all():
            self._refuse('a position is not a finite number')
            return
        self._simulator.command_positions(target, duration)

    def _refuse(self, fault: str) -> None:
        """Log the fault of an ignored command."""
        self.get_logger().error(f'command ignored: {fault}', throttle_duration_sec=1.0)

    def _on_base_command(self, message: Twist) -> None:
        """Apply a command to the base; ignore components that it cannot move in."""
        base = slice(0, self._robot.joint_columns.start)
        self._velocity[base] = self._robot.base_velocities(twist_of(message))
        self._apply(base, 'cmd_vel')

    def _apply(self, columns: slice, what: str) -> None:
        """Pass the received velocities to the simulator."""
        if not np.isfinite(self._velocity[columns]).all():
            self.get_logger().error(f'{what} ignored: a velocity is not a finite number',
                                    throttle_duration_sec=1.0)
            return
        self._simulator.command(self._velocity, columns)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset the robot to its initial positions."""
        # Time goes on: it must be monotonic for its subscribers.
        self._simulator.reset(self._simulator.now)
        response.success = True
        return response

    def _on_timer(self) -> None:
        """Simulate all steps that are due, and publish each."""
        now = time.monotonic()
        due = (now - self._start_time) * self._speed / self._dt
        behind = due - self._steps_since_start
        if behind * self._dt / self._speed > LARGEST_DELAY:
            self.get_logger().warning('the simulation cannot keep up with its speed',
                                      throttle_duration_sec=5.0)
            self._steps_since_start = math.floor(due) - 1
        # Bounded in time: commands, services and signals wait meanwhile.
        while self._steps_since_start + 1 <= due and time.monotonic() - now < LARGEST_DELAY:
            self._steps_since_start += 1
            self._simulator.step(self._dt)
            self._publish()

    def _publish(self) -> None:
        """Publish time and joint states."""
        now = self._simulator.now
        if self._clock_publisher is not None:
            stamp = Time(nanoseconds=round(now * 1e9)).to_msg()
            self._clock_publisher.publish(ClockMessage(clock=stamp))
        else:
            stamp = self.get_clock().now().to_msg()
        measured = self._simulator.measure()
        if measured is None:
            return
        q, velocity = measured
        self._position_view[:] = q[self._robot.joint_rows]
        self._velocity_view[:] = velocity[self._robot.joint_columns]
        self._message.header.stamp = stamp
        self._states.publish(self._message)
        if self._odometry_publisher is not None:
            self._odometry.header.stamp = stamp
            fill_odometry(self._odometry, self._robot.base_placement(q),
                          self._robot.base_twist(velocity))
            self._odometry_publisher.publish(self._odometry)
            if self._tf is not None:
                self._tf.send(self._odometry)


main = partial(run, SimulatorNode, NAME)

if __name__ == '__main__':
    sys.exit(main())

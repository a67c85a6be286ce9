# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recorder of a running controller: configurations, commands, errors of the tasks."""

from collections import deque
from collections.abc import Sequence
import time
from typing import Any, cast

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.ros.client.client import Client
from tp_controller.ros.client.configuration import base_velocities, ConfigurationBuffer
from tp_controller.ros.client.received_status import subscribe_status
from tp_controller.ros.client.status import ControllerStatus
from tp_controller.tools.recording.task_curves import TaskCurves
from trajectory_msgs.msg import JointTrajectory

# Units of the recorded errors.
ERROR_UNITS = ('m', 'rad')


class PositionDifferences:
    """
    Velocities of commanded positions that are sent at irregular times.

    Attributes
    ----------
    DURATION : float
        Time over which they are the mean [s].

    """

    DURATION = 0.1

    def __init__(self) -> None:
        self._received: deque[tuple[float, Array]] = deque()

    def velocities(self, positions: Sequence[float] | Array, now: float) -> Array | None:
        """Return velocities [rad/s or m/s] at a time [s]; None with too few positions."""
        received = self._received
        if received and not 0.0 <= now - received[-1][0] <= self.DURATION:
            received.clear()
        received.append((now, np.array(positions)))
        while len(received) > 2 and now - received[1][0] >= self.DURATION:
            received.popleft()
        since, before = received[0]
        if now - since < self.DURATION:
            return None
        return (received[-1][1] - before) / (now - since)


class Recorder:
    """
    Recorder of configurations, commands and task errors of a running controller.

    Parameters
    ----------
    client : Client
        Node of the subscriptions.
    robot : Robot
        Robot with the driven joints in the order of the commands.

    Attributes
    ----------
    states : list of (float, ndarray (nq,))
        Time [s] and configuration.
    commands : list of (float, ndarray (n,))
        Time [s] and commanded velocities, including those of the base.
    curves : TaskCurves
        Errors of the tasks in `ERROR_UNITS`, and their limiting causes.

    """

    def __init__(self, client: Client, robot: Robot) -> None:
        self._robot = robot
        self._configuration = ConfigurationBuffer(robot)
        self._velocity = np.full(robot.n, np.nan)
        self.restart()
        node = client.node
        node.create_subscription(JointState, '/joint_states', self._on_state, 50)
        node.create_subscription(Float64MultiArray, '/velocity_controller/commands',
                                 self._on_command, 50)
        # One of the three comes, as the parameter `output` of the controller says.
        self._positions = PositionDifferences()
        node.create_subscription(Float64MultiArray, '/position_controller/commands',
                                 cast(Any, self._on_positions), 50)
        node.create_subscription(JointTrajectory, '/joint_trajectory_controller/joint_trajectory',
                                 cast(Any, self._on_trajectory), 50)
        subscribe_status(node, client.controller, self._on_status, 50)
        if robot.moves:
            node.create_subscription(Odometry, '/odom', self._on_odometry,
                                     ConfigurationBuffer.odometry_qos)
            node.create_subscription(TwistStamped, '/cmd_vel', self._on_base_command, 50)

    def restart(self, ahead: float = 0.0) -> None:
        """Drop all data; time counts from a moment ahead [s]."""
        self._start = time.monotonic() + ahead
        self.states: list[tuple[float, Array]] = []
        self.commands: list[tuple[float, Array]] = []
        self.curves = TaskCurves()

    def now(self) -> float:
        """Return the time of the recording [s]."""
        return time.monotonic() - self._start

    def _on_state(self, message: JointState) -> None:
        """Record the configuration once it is complete."""
        now = self.now()
        if self._configuration.put_joint_state(message, now):
            q = self._configuration.configuration(now)
            if q is not None:
                self.states.append((now, q))

    def _on_odometry(self, message: Odometry) -> None:
        """Store the pose of the base."""
        self._configuration.put_odometry(message, self.now())

    def _on_command(self, message: Float64MultiArray) -> None:
        """Record a command of the joints; a mobile base follows with its own."""
        self._take_velocities(message.data)

    def _on_positions(self, message: Float64MultiArray, info: dict[str, int]) -> None:
        """Record the velocities of commanded positions."""
        self._take_positions(message.data, info)

    def _on_trajectory(self, message: JointTrajectory, info: dict[str, int]) -> None:
        """Record the velocities of trajectories of one point."""
        self._take_positions(message.points[0].positions, info)

    def _take_positions(self, positions: Sequence[float], info: dict[str, int]) -> None:
        """Record the velocities of positions; a busy machine receives them late."""
        velocities = self._positions.velocities(positions, 1e-9 * info['source_timestamp'])
        if velocities is not None:
            self._take_velocities(velocities)

    def _take_velocities(self, velocities: Sequence[float] | Array) -> None:
        """Record velocities of the joints."""
        self._velocity[self._robot.joint_columns] = velocities
        if not self._robot.moves:
            self._record_command()

    def _on_base_command(self, message: TwistStamped) -> None:
        """Record a command of the base."""
        base = slice(0, self._robot.joint_columns.start)
        self._velocity[base] = base_velocities(self._robot, message.twist)
        self._record_command()

    def _record_command(self) -> None:
        """Record the velocities once they are complete."""
        if not np.isnan(self._velocity).any():
            self.commands.append((self.now(), self._velocity.copy()))

    def _on_status(self, status: ControllerStatus) -> None:
        """Record the errors and the limiting causes of every task."""
        self.curves.add(self.now(), {name: (
            {unit: error for unit, error in task.errors.items() if unit in ERROR_UNITS},
            task.causes)
            for name, task in status.tasks.items()})

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

"""The other side of the controller's topics: sends goals, listens to the status."""

import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    QuaternionStamped,
    Twist,
    TwistStamped,
    Vector3Stamped,
)
from nav_msgs.msg import Odometry
import numpy as np
from rclpy import init, try_shutdown
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller.errors import GoalError, TpControllerError, unknown
from tp_controller.nodes.base_topics import (
    ODOMETRY_QOS,
    OdometryBuffer,
    placement_of,
    twist_of,
)
from tp_controller.nodes.joint_states import JointStateBuffer

# How long to wait, on leaving, for goals to arrive [s].
LEAVE_SECONDS = 5.0
# Anything that was heard at all was heard within this [s].
EVER = sys.float_info.max
# What of a goal each message can carry, and must.
FIELDS = {
    PointStamped: ('xyz',),
    Vector3Stamped: ('xyz',),
    QuaternionStamped: ('quat_xyzw',),
    PoseStamped: ('xyz', 'quat_xyzw'),
    JointState: ('joints', 'velocities'),
    TwistStamped: ('linear', 'angular'),
}
TYPES = {f'geometry_msgs/msg/{kind.__name__}' if kind is not JointState
         else 'sensor_msgs/msg/JointState': kind for kind in FIELDS}


class Client:
    """
    A node that talks to a running controller.

    Parameters
    ----------
    controller : str
        Name of the controller node.
    context : rclpy.context.Context, optional
        Context that is initialised already; one of its own by default.

    Raises
    ------
    TpControllerError
        ROS cannot start here, or `controller` cannot be the name of a node.

    """

    def __init__(self, controller='tp_controller', context=None):
        self._own = context is None
        self._context = context or Context()
        if self._own:
            try:
                init(context=self._context, args=[])
            except (RuntimeError, ValueError) as error:
                raise TpControllerError(f'ROS 2 cannot start: {error}') from error
        self.controller = controller.strip('/')
        self.node = Node('tp_client', context=self._context, use_global_arguments=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers = {}
        self._last = None
        self.status = None
        try:
            self.node.create_subscription(DiagnosticArray, f'/{self.controller}/status',
                                          self._on_status, 10)
        except NameValidationException as error:
            self.close()
            raise TpControllerError(f'{controller!r} is no name of a node') from error

    def close(self):
        """Leave, once everything that was sent has arrived."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=LEAVE_SECONDS))
        self._executor.shutdown()
        self.node.destroy_node()
        if self._own:
            try_shutdown(context=self._context)

    def __enter__(self):
        """Return the client."""
        return self

    def __exit__(self, *_):
        """Leave."""
        self.close()

    def spin(self, seconds):
        """Take what arrives, for at most `seconds`."""
        self._executor.spin_once(timeout_sec=seconds)

    def wait(self, condition, seconds):
        """
        Spin until a condition holds.

        Parameters
        ----------
        condition : callable
            Asked after everything that arrives, and at least ten times a second.
        seconds : float
            How long to wait at most.

        Returns
        -------
        bool
            Whether it came to hold.

        """
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.spin(min(left, 0.1))
        return True

    def tasks(self):
        """Return {task: {topic: message type}} of the goal topics that the graph shows."""
        prefix = f'/{self.controller}/'
        found = {}
        for topic, types in self.node.get_topic_names_and_types():
            name, _, last = topic.removeprefix(prefix).partition('/')
            if topic.startswith(prefix) and last in ('goal', 'twist') and types[0] in TYPES \
                    and self.node.count_subscribers(topic):
                found.setdefault(name, {})[last] = TYPES[types[0]]
        return found

    def task_names(self):
        """Return the names of all tasks by priority, as the status has them."""
        return [status.name.partition(': ')[2] for status in self.status.status[1:]] \
            if self.status else []

    def send(self, task, frame='', wait=10.0, **fields):
        """
        Publish a goal, or a velocity, for a task.

        Parameters
        ----------
        task : str
            Its name.
        frame : str
            Frame that the goal is expressed in; the task's reference by default.
        wait : float
            How long to look for the controller [s].
        **fields
            ``xyz`` [m, or a direction], ``quat_xyzw``, ``joints`` {name: position}, ``velocities``
            {name: velocity}, ``linear`` [m/s], ``angular`` [rad/s].

        Raises
        ------
        GoalError
            The controller or task is not there, the task takes something else, or the
            controller refused the goal.

        """
        topic = 'twist' if {'linear', 'angular'} & set(fields) else 'goal'

        def found():
            return topic in self.tasks().get(task, {})

        self.wait(lambda: found() or task not in (self.task_names() or [task]), wait)
        if not found():
            raise GoalError(self._absence(task, topic))
        message = make_message(task, self.tasks()[task][topic], fields)
        if frame and isinstance(message, JointState):
            raise GoalError(f'a goal of task {task!r} is in no frame')
        message.header.frame_id = frame
        publisher = self._publisher(task, topic, type(message))
        if not self.wait(lambda: publisher.get_subscription_count() > 0, wait):
            raise GoalError(f'the controller does not answer on {publisher.topic_name}')
        if not self.wait(lambda: self.task_status(task), wait):
            raise GoalError(f'the controller sends no status of task {task!r}')
        before = self._answers(task)
        self._last = publisher, message
        publisher.publish(message)
        if not self.wait(lambda: self._answers(task) not in (None, before), wait):
            raise GoalError(f'the controller did not answer to the goal for task {task!r}')
        if self._answers(task)[1] != before[1]:
            raise GoalError(f'refused: {self.task_status(task)["last refusal"]}')

    def repeat(self):
        """Publish once more what was sent last; no answer is waited for."""
        self._last[0].publish(self._last[1])

    def task_status(self, task):
        """Return {key: value} of the latest status of a task; empty before the first."""
        for status in self.status.status if self.status else ():
            if status.name == f'{self.controller}: {task}':
                return {value.key: value.value for value in status.values}
        return {}

    def _answers(self, task):
        """Return how many goals of a task were accepted and refused; None if it is not there."""
        status = self.task_status(task)
        return (status['goals accepted'], status['goals refused']) if status else None

    def hold(self):
        """Return why the controller commands zeros; empty while it runs."""
        head = self.status.status[0].message if self.status else 'no status yet'
        return '' if head == 'running' else head

    def _publisher(self, task, topic, kind):
        """Return the publisher of a topic, made at the first use."""
        if (task, topic) not in self._publishers:
            self._publishers[task, topic] = self.node.create_publisher(
                kind, f'/{self.controller}/{task}/{topic}', 10)
        return self._publishers[task, topic]

    def _absence(self, task, topic):
        """Return what is missing where a topic of a task was not found."""
        tasks = self.tasks()
        names = self.task_names() or sorted(tasks)
        if not names:
            return (f'no node /{self.controller} with tasks is running (ROS_DOMAIN_ID and '
                    "ROS_AUTOMATIC_DISCOVERY_RANGE must be the same as the controller's)")
        if task not in names:
            return unknown('task', task, names)
        return (f'task {task!r} takes no {topic}; valid: '
                f'{", ".join(sorted(tasks.get(task, []))) or "none"}')

    def _on_status(self, message):
        """Keep the latest status."""
        self.status = message


class Recorder:
    """
    Records configurations, commands and task errors of a running controller.

    Parameters
    ----------
    client : Client
        Node that listens.
    robot : Robot
        Its driven joints are in the order of the commands.

    Attributes
    ----------
    states : list of (float, ndarray (nq,))
        Time [s] and configuration.
    commands : list of (float, ndarray (n,))
        Time [s] and commanded velocities, those of the base included.
    errors : list of (float, dict)
        Time [s] and {(task, unit): error}.

    """

    def __init__(self, client, robot):
        self._robot = robot
        self._buffer = JointStateBuffer(robot.joint_names, (), ())
        self._velocity = np.full(robot.n, np.nan)
        self._start = time.monotonic()
        self.states, self.commands, self.errors = [], [], []
        node = client.node
        node.create_subscription(JointState, '/joint_states', self._on_state, 50)
        node.create_subscription(Float64MultiArray, '/velocity_controller/commands',
                                 self._on_command, 50)
        node.create_subscription(DiagnosticArray, f'/{client.controller}/status',
                                 self._on_status, 50)
        if robot.moves:
            self._odometry = OdometryBuffer(robot)
            node.create_subscription(Odometry, '/odom', self._on_odometry, ODOMETRY_QOS)
            node.create_subscription(Twist, '/cmd_vel', self._on_base_command, 50)

    def now(self):
        """Return the time since the recording began [s]."""
        return time.monotonic() - self._start

    def hears(self):
        """Say whether something came in from everyone who is listened to."""
        return bool(self.states and self.commands and self.errors)

    def cut(self, first, zero):
        """Forget what was before `first`, and count time from `zero` [s]."""
        for rows in (self.states, self.commands, self.errors):
            rows[:] = [(moment - zero, value) for moment, value in rows if moment >= first]

    def _on_state(self, message):
        """Record the configuration, once all of it is known."""
        fault = self._buffer.put(message.name, message.position, self.now())
        if fault or self._buffer.missing(self.now(), EVER):
            return
        joints = self._buffer.q.copy()
        if not self._robot.moves:
            self.states.append((self.now(), joints))
        elif not self._odometry.missing(self.now(), EVER):
            self.states.append((self.now(), self._odometry.configuration(joints)))

    def _on_odometry(self, message):
        """Take the pose of the base."""
        self._odometry.put(message.header.frame_id, message.child_frame_id,
                           placement_of(message), self.now())

    def _on_command(self, message):
        """Record a command of the joints; that of a base follows it."""
        self._velocity[self._robot.joint_columns] = message.data
        if not self._robot.moves:
            self._record_command()

    def _on_base_command(self, message):
        """Record a command of the base."""
        base = slice(0, self._robot.joint_columns.start)
        self._velocity[base] = self._robot.base_velocities(twist_of(message))
        self._record_command()

    def _record_command(self):
        """Record the velocities, once all of them are known."""
        if not np.isnan(self._velocity).any():
            self.commands.append((self.now(), self._velocity.copy()))

    def _on_status(self, message):
        """Record the error of every task: {(task, unit): error}."""
        errors = {}
        for status in message.status[1:]:
            task = status.name.partition(': ')[2]
            for value in status.values:
                if value.key.startswith('error ['):
                    errors[task, value.key[7:-1]] = float(value.value)
        self.errors.append((self.now(), errors))


def make_message(task, kind, fields):
    """
    Return a goal message.

    Parameters
    ----------
    task : str
        For what is said of a fault.
    kind : type
        Message type.
    fields : dict
        See `Client.send`.

    Raises
    ------
    GoalError
        `fields` is not what the message carries.

    """
    allowed = FIELDS[kind]
    extra = [name for name in fields if name not in allowed]
    missing = [name for name in allowed if name not in fields]
    if kind in (JointState, TwistStamped) and len(missing) < len(allowed):
        missing = []
    if extra or missing:
        raise GoalError(f'task {task!r} takes {" and ".join(allowed)} ({kind.__name__}), '
                        f'not {" and ".join(fields) or "nothing"}')
    return _FILL[kind](fields)


def _vector(target, values):
    """Set x, y, z of a message."""
    target.x, target.y, target.z = map(float, values)


def _quaternion(target, values):
    """Set x, y, z, w of a message."""
    target.x, target.y, target.z, target.w = map(float, values)


def _point(fields):
    """Return a PointStamped."""
    message = PointStamped()
    _vector(message.point, fields['xyz'])
    return message


def _direction(fields):
    """Return a Vector3Stamped."""
    message = Vector3Stamped()
    _vector(message.vector, fields['xyz'])
    return message


def _attitude(fields):
    """Return a QuaternionStamped."""
    message = QuaternionStamped()
    _quaternion(message.quaternion, fields['quat_xyzw'])
    return message


def _pose(fields):
    """Return a PoseStamped."""
    message = PoseStamped()
    _vector(message.pose.position, fields['xyz'])
    _quaternion(message.pose.orientation, fields['quat_xyzw'])
    return message


def _joints(fields):
    """Return a JointState with positions or velocities, or both for the same joints."""
    positions, velocities = fields.get('joints', {}), fields.get('velocities', {})
    if positions and velocities and list(positions) != list(velocities):
        raise GoalError('positions and velocities must be for the same joints')
    return JointState(name=list(positions or velocities),
                      position=[float(value) for value in positions.values()],
                      velocity=[float(value) for value in velocities.values()])


def _twist(fields):
    """Return a TwistStamped."""
    message = TwistStamped()
    _vector(message.twist.linear, fields.get('linear', (0.0, 0.0, 0.0)))
    _vector(message.twist.angular, fields.get('angular', (0.0, 0.0, 0.0)))
    return message


_FILL = {PointStamped: _point, Vector3Stamped: _direction, QuaternionStamped: _attitude,
         PoseStamped: _pose, JointState: _joints, TwistStamped: _twist}

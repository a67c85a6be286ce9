# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Connection of the page to a running controller: topics, parameters and services."""

from collections.abc import Callable, Mapping, Sequence
import math
import time
from typing import Any

from nav_msgs.msg import Odometry
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from tp_controller.errors import in_words, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.resources import MOST_XML_CHARACTERS
from tp_controller.ros.bounded_subscription import LARGEST_MESSAGE, subscribe
from tp_controller.ros.client.client import Client
from tp_controller.ros.client.configuration import ConfigurationBuffer
from tp_controller.ros.client.goal_fields import type_name
from tp_controller.ros.client.status import ControllerStatus, RUNNING, TaskStatus
from tp_controller.ros.parameters import LIMITS, names_in, ROBOT, TASKS
from tp_controller.tools.view.markers import drawable
from tp_controller.untrusted.texts import plain
from visualization_msgs.msg import Marker, MarkerArray

# Only the newest message matters, and a lost one is not resent.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Polling period of the parameters, and timeout of service calls [s].
PARAMETER_PERIOD, SERVICE_ANSWER_SECONDS = 1.0, 3.0
# Age of the last status from which the controller counts as gone [s].
STATUS_TIMEOUT = 2.0
# Larger joint velocities are ignored [rad/s or m/s].
MOST_VELOCITY = 1e6
# Suffix of the name of the node that runs the loop of a controller.
LOOP = '_loop'
# Parameters of the controller that define its robot.
ROBOT_PARAMETERS = (*(spec.name for spec in ROBOT), 'joints')

OnAnswer = Callable[[bool, str], None]


class Link:
    """
    Client of a controller: state that the page shows, and requests of its users.

    Parameters
    ----------
    client : Client
        Node of the page.
    clock : callable
        Returns a time [s].

    Attributes
    ----------
    robot : Robot or None
        Robot of the controller; None until its description is known.
    fault : str
        Error in the description of the robot; else empty.
    rows : list of TaskStatus
        Tasks by priority in the last status.
    q : ndarray (nq,) or None
        Configuration; None until it is complete.
    velocity : ndarray (n,)
        Velocity of the driven joints; not a number if the joint states have none
        [rad/s or m/s].
    markers : list of visualization_msgs.msg.Marker
        Markers of the tasks.
    values : dict
        Parameters of the controller: `stack` and those of the tasks.

    """

    def __init__(self, client: Client, clock: Callable[[], float] = time.monotonic) -> None:
        self.client, self._clock = client, clock
        self.robot: Robot | None = None
        self.fault = ''
        self.rows: list[TaskStatus] = []
        self.q: Array | None = None
        self.velocity: Array = np.empty(0)
        self.markers: list[Marker] = []
        self.values: dict[str, Any] = {}
        self._status: ControllerStatus | None = None
        self._status_time = self._request_time = -math.inf
        self._description = ''
        self._robot_source: object = None
        self._watched = False
        self._pending: list[tuple[Future, float, Callable[[Any], None], OnAnswer]] = []
        self._motion_subscriptions: list[Subscription] = []
        self._descriptions: Subscription | None = None

    @property
    def head(self) -> str | None:
        """Return ``running`` or the reason of zero commands; None before the first status."""
        return None if self._status is None else self.client.stop_reason() or RUNNING

    @property
    def running(self) -> bool:
        """Return whether the controller moves its robot."""
        return self.present and self.head == RUNNING

    @property
    def present(self) -> bool:
        """Return whether the last status is recent."""
        return self._clock() - self._status_time <= STATUS_TIMEOUT

    def watch(self, wanted: bool) -> None:
        """Subscribe to joint states and markers, or unsubscribe while no browser is open."""
        self._watched = wanted
        if wanted and not self._motion_subscriptions and self.robot is not None:
            self._motion_subscriptions = [
                self._listen(JointState, 'joint_states', self._on_joints, NEWEST),
                subscribe(self.client.node, MarkerArray,
                          f'/{self.client.controller}/markers', self._on_markers, 1)]
            if self.robot.moves:
                self._motion_subscriptions.append(
                    self._listen(Odometry, 'odom', self._on_odometry, NEWEST))
        elif not wanted and self._motion_subscriptions:
            for subscription in self._motion_subscriptions:
                self.client.node.destroy_subscription(subscription)
            self._motion_subscriptions = []

    def update(self) -> None:
        """Process the received messages and send due requests, without blocking."""
        self.client.catch_up()
        now = self._clock()
        if self.client.status is not self._status and self.client.status is not None:
            self._status, self._status_time = self.client.status, now
            self.rows = list(self._status.tasks.values())
        self._take_answers(now)
        if now - self._request_time > PARAMETER_PERIOD and self.present and (
                self._watched or self.robot is None):
            self._request_time = now
            self._ask()

    @property
    def reachable(self) -> bool:
        """Return whether the stop service of the controller is available."""
        return self.client.service(Trigger, 'stop').service_is_ready()

    def status_value(self, key: str) -> str:
        """Return a value of the controller in a recent status; empty without one."""
        return self._status.values.get(key, '') if self._status and self.present else ''

    # Requests of the page -------------------------------------------------------------------

    def stop(self, told: OnAnswer) -> None:
        """Stop the robot; `told` receives success and the message of the controller."""
        self._request(Trigger, 'stop', Trigger.Request(), told)

    def start(self, told: OnAnswer) -> None:
        """Start the robot."""
        self._request(Trigger, 'start', Trigger.Request(), told)

    def lock(self, locked: bool, told: OnAnswer) -> None:
        """Lock the joint that has stopped the robot and go on, or unlock all joints."""
        self._request(SetBool, 'lock', SetBool.Request(data=locked), told)

    def enable(self, task: str, enabled: bool, told: OnAnswer) -> None:
        """Enable or disable a task of the stack."""
        self._request(SetBool, f'{task}/enable', SetBool.Request(data=enabled), told)

    def set_parameters(self, values: Mapping[str, Any], told: OnAnswer) -> None:
        """Set parameters of the controller, all or none; `told` receives reasons of a refusal."""
        parameters: list[ParameterMessage] = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]

        def finish(answer: SetParameters.Response) -> None:
            refusals = [result.reason for result in answer.results
                        if not result.successful]
            if not refusals:
                self.values.update(values)
            # The controller may have other parameters now: poll them at once.
            self._request_time = -math.inf
            told(not refusals, '; '.join(refusals))

        self._call(SetParameters, 'set_parameters', SetParameters.Request(parameters=parameters),
                   finish, told)

    def gains(self) -> dict[str, float | list[float]]:
        """Return {task: gain} of the tasks with a gain."""
        found = {row.name: self.values.get(_gain(row.name)) for row in self.rows}
        return {name: gain if isinstance(gain, float) else list(gain)
                for name, gain in found.items() if gain is not None}

    def _request(self, kind: type, name: str, request: object, told: OnAnswer) -> None:
        """Call a service whose response contains success and message."""
        self._call(kind, name, request, lambda answer: told(answer.success, answer.message), told)

    def _call(self, kind: type, name: str, request: object, finish: Callable[[Any], None],
              told: OnAnswer) -> None:
        """Call a service; `finish` receives the response, `told` a failure."""
        future = self.client.call(kind, name, request)
        if future is None:
            told(False, f'/{self.client.controller}/{name} does not answer')
        else:
            self._pending.append((future, self._clock() + SERVICE_ANSWER_SECONDS, finish, told))

    def _take_answers(self, now: float) -> None:
        """Process the received responses, and drop calls after their timeout."""
        waiting, self._pending = self._pending, []
        for future, until, finish, told in waiting:
            if future.done():
                self._take_answer(future, finish, told)
            elif now > until:
                future.cancel()
                told(False, f'/{self.client.controller} does not answer')
            else:
                self._pending.append((future, until, finish, told))

    def _take_answer(self, future: Future, finish: Callable[[Any], None], told: OnAnswer) -> None:
        """Process a response; report an invalid one as a failure."""
        try:
            finish(future.result())
        except Exception as error:
            told(False, f'/{self.client.controller} returned an invalid response: '
                 f'{plain(in_words(error))}')

    # Data for the page ----------------------------------------------------------------------

    def _listen(self, kind: type, name: str, callback: Callable[[Any], None],
                qos: QoSProfile, ending: str = LOOP,
                longest: int = LARGEST_MESSAGE) -> Subscription:
        """Subscribe to the topic of a node of the controller, whose name has the given ending."""
        return subscribe(self.client.node, kind, self._topic(name, kind, ending), callback, qos,
                         longest)

    def _topic(self, name: str, kind: type, ending: str) -> str:
        """
        Return the topic to which a node of the controller remaps a name.

        The graph lists the topics of a type that a node subscribes to, but not the names they
        were remapped from: unless there is exactly one topic, the result is the name itself.
        """
        namespace, _, node = self.client.controller.rpartition('/')
        own = f'/{self.client.controller}/'
        usual = f'/{namespace}/{name}' if namespace else f'/{name}'
        try:
            heard = self.client.node.get_subscriber_names_and_types_by_node(
                node + ending, f'/{namespace}')
        except NodeNameNonExistentError:
            return usual
        found = [str(topic) for topic, types in heard
                 if types == [type_name(kind)] and not topic.startswith(own)]
        return found[0] if len(found) == 1 else usual

    def _ask(self) -> None:
        """Request the displayed parameters."""
        if self._descriptions is None:
            self._descriptions = self._listen(String, 'robot_description', self._on_description,
                                              LATCHED, ending='', longest=MOST_XML_CHARACTERS)
        prefixes = [TASKS.rstrip('.'), LIMITS.rstrip('.')]
        self._call(ListParameters, 'list_parameters', ListParameters.Request(prefixes=prefixes),
                   self._take_names, _ignore)

    def _take_names(self, answer: ListParameters.Response) -> None:
        """Request the values of parameters; one unknown name would empty the response."""
        names = [*ROBOT_PARAMETERS, 'stack', *answer.result.names]
        self._call(GetParameters, 'get_parameters', GetParameters.Request(names=names),
                   lambda values: self._take_values(names, values), _ignore)

    def _take_values(self, names: Sequence[str], answer: GetParameters.Response) -> None:
        """Store the values of parameters, and update the robot."""
        if len(answer.values) == len(names):
            self.values = {name: parameter_value_to_python(value)
                           for name, value in zip(names, answer.values)}
            self._make_robot()

    def _make_robot(self) -> None:
        """Create the robot of the controller if its description has changed."""
        values = self.values
        if not values:
            return
        limits = {name: value for name, value in values.items() if name.startswith(LIMITS)}
        source = self._description, [values[name] for name in ROBOT_PARAMETERS], limits
        text = values['robot_description'] or self._description
        if source == self._robot_source or not (values['robot'] or text):
            return
        self._robot_source = source
        options: dict[str, Any] = {
            'base': values['base'], 'world_frame': values['world_frame'],
            'joints': names_in(values['joints']), 'limits': _limits(limits),
            'groups': values['groups']}
        try:
            # The file may be on another machine; the published description is available here.
            robot = Robot.from_urdf(text, **options) if text \
                else Robot.from_file(values['robot'], **options,
                                     xacro_arguments=values['xacro_arguments'])
        except TpControllerError as error:
            self.robot, self.fault = None, plain(in_words(error))
            return
        self.watch(False)
        self._configuration = ConfigurationBuffer(robot)
        self.robot, self.fault, self.q = robot, '', None
        self.velocity = np.full(robot.n, math.nan)

    @property
    def passive(self) -> Array:
        """Return the positions of the passive joints [rad or m]."""
        return self._configuration.passive

    def _on_description(self, message: String) -> None:
        """Store the robot description."""
        self._description = message.data
        self._make_robot()

    def _on_joints(self, message: JointState) -> None:
        """Store positions and velocities of joints."""
        robot, now = self.robot, self._clock()
        if robot is None or not self._configuration.put_joint_state(message, now):
            return
        if len(message.velocity) == len(message.name):
            for name, value in zip(message.name, message.velocity):
                if name in robot.joint_names:
                    self.velocity[robot.joint_index(name)] = \
                        value if abs(value) <= MOST_VELOCITY else math.nan
        self._configure()

    def _on_odometry(self, message: Odometry) -> None:
        """Store the pose of the base."""
        self._configuration.put_odometry(message, self._clock())
        self._configure()

    def _configure(self) -> None:
        """Update the configuration once it is complete."""
        q = self._configuration.configuration(self._clock())
        if q is not None:
            self.q = q

    def _on_markers(self, message: MarkerArray) -> None:
        """Store the markers of the tasks."""
        self.markers = drawable(message.markers)


def _gain(task: str) -> str:
    """Return the name of the gain parameter of a task."""
    return f'{TASKS}{task}.gain'


def _limits(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return {velocity: {key: value}} of the finite limits in parameters."""
    found: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        joint, _, key = name.removeprefix(LIMITS).rpartition('.')
        if math.isfinite(value):
            found.setdefault(joint, {})[key] = value
    return found


def _ignore(worked: bool, text: str) -> None:
    """Ignore the outcome of a call."""

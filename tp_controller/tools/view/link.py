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

"""A running controller as the page sees it: through topics, parameters and services only."""

from collections.abc import Callable, Mapping, Sequence
import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
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
from tp_controller.ros.client.client import Client, type_name
from tp_controller.ros.client.configuration import ConfigurationBuffer
from tp_controller.ros.parameters import LIMITS, names_in, ROBOT, TASKS
from tp_controller.tools.view.condition import RUNNING
from tp_controller.tools.view.markers import drawable
from tp_controller.tools.view.rows import Row, rows_of
from tp_controller.untrusted import plain
from visualization_msgs.msg import Marker, MarkerArray

# Of everything only the newest is of interest, and what is lost is not missed.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# How often parameters are polled [s], and for how long an answer is waited for.
ASK_SECONDS, ANSWER_SECONDS = 1.0, 3.0
# Without a status for so long the controller counts as gone [s].
SILENT_SECONDS = 2.0
# Faster joints are not believed [rad/s or m/s].
FASTEST = 1e6
# Ending of the name of the node that the loop of a controller runs on.
LOOP = '_loop'
# What of the controller says which robot it has.
OF_ROBOT = (*(spec.name for spec in ROBOT), 'joints')

Told = Callable[[bool, str], None]


class Link:
    """
    Listens to a controller, and tells it what somebody does on the page.

    Parameters
    ----------
    client : Client
        Node of the page.
    clock : callable
        Returns a time [s].

    Attributes
    ----------
    robot : Robot or None
        None until its description is known.
    fault : str
        Why there is no robot, if something is wrong.
    rows : list of Row
        The tasks by priority, as of the last status.
    q : ndarray (nq,) or None
        Configuration, once all of it is known.
    velocity : ndarray (n,)
        Of the driven joints, where the joint states have it; else not a number [rad/s or m/s].
    markers : list of visualization_msgs.msg.Marker
        What is drawn of the tasks.
    values : dict
        Parameters of the controller: `stack` and those of the tasks.

    """

    def __init__(self, client: Client, clock: Callable[[], float] = time.monotonic) -> None:
        self.client, self._clock = client, clock
        self.robot: Robot | None = None
        self.fault = ''
        self.rows: list[Row] = []
        self.q: Array | None = None
        self.velocity: Array = np.empty(0)
        self.markers: list[Marker] = []
        self.values: dict[str, Any] = {}
        self._status: DiagnosticArray | None = None
        self._heard = self._asked = -math.inf
        self._description = ''
        self._made_of: object = None
        self._watched = False
        self._pending: list[tuple[Future, float, Callable[[Any], None], Told]] = []
        self._eyes: list[Subscription] = []
        self._descriptions: Subscription | None = None

    @property
    def head(self) -> str | None:
        """Return ``running``, or why zeros are commanded; None before the first status."""
        return None if self._status is None else self.client.stop_reason() or RUNNING

    @property
    def running(self) -> bool:
        """Return whether the controller moves its robot."""
        return self.present and self.head == RUNNING

    @property
    def present(self) -> bool:
        """Return whether the controller is there."""
        return self._clock() - self._heard <= SILENT_SECONDS

    def look(self, wanted: bool) -> None:
        """Listen to what moves, or leave it alone while nobody looks at it: it costs time."""
        self._watched = wanted
        if wanted and not self._eyes and self.robot is not None:
            self._eyes = [
                self._listen(JointState, 'joint_states', self._on_joints, NEWEST),
                subscribe(self.client.node, MarkerArray,
                          f'/{self.client.controller}/markers', self._on_markers, 1)]
            if self.robot.moves:
                self._eyes.append(self._listen(Odometry, 'odom', self._on_odometry, NEWEST))
        elif not wanted and self._eyes:
            for subscription in self._eyes:
                self.client.node.destroy_subscription(subscription)
            self._eyes = []

    def update(self) -> None:
        """Take what has arrived, and ask for what is due; waits for nothing."""
        self.client.catch_up()
        now = self._clock()
        if self.client.status is not self._status and self.client.status is not None:
            self._status, self._heard = self.client.status, now
            self.rows = rows_of(self._status)
        self._take_answers(now)
        if now - self._asked > ASK_SECONDS and self.present and (
                self._watched or self.robot is None):
            self._asked = now
            self._ask()

    @property
    def reachable(self) -> bool:
        """Return whether the controller can be stopped: its service is there."""
        return self.client.service(Trigger, 'stop').service_is_ready()

    # What the page tells --------------------------------------------------------------------

    def stop(self, told: Told) -> None:
        """Stop the robot; `told` gets whether it worked, and what the controller says."""
        self._request(Trigger, 'stop', Trigger.Request(), told)

    def start(self, told: Told) -> None:
        """Let the robot go on."""
        self._request(Trigger, 'start', Trigger.Request(), told)

    def enable(self, task: str, enabled: bool, told: Told) -> None:
        """Take a task into the stack, or leave it out."""
        self._request(SetBool, f'{task}/enable', SetBool.Request(data=enabled), told)

    def set_parameters(self, values: Mapping[str, Any], told: Told) -> None:
        """Set parameters of the controller, all or none, each with its reason if refused."""
        parameters: list[ParameterMessage] = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]

        def tell(answer: SetParameters.Response) -> None:
            refusals = [result.reason for result in answer.results
                        if not result.successful]
            if not refusals:
                self.values.update(values)
            # The controller may have others now: ask at once.
            self._asked = -math.inf
            told(not refusals, '; '.join(refusals))

        self._call(SetParameters, 'set_parameters', SetParameters.Request(parameters=parameters),
                   tell, told)

    def gains(self) -> dict[str, float | list[float]]:
        """Return {task: gain} of the tasks that have one."""
        found = {row.name: self.values.get(_gain(row.name)) for row in self.rows}
        return {name: gain if isinstance(gain, float) else list(gain)
                for name, gain in found.items() if gain is not None}

    def _request(self, kind: type, name: str, request: object, told: Told) -> None:
        """Call a service whose answer says whether it worked."""
        self._call(kind, name, request, lambda answer: told(answer.success, answer.message), told)

    def _call(self, kind: type, name: str, request: object, finish: Callable[[Any], None],
              told: Told) -> None:
        """Call a service; `finish` gets the answer, `told` that there is none."""
        future = self.client.call(kind, name, request)
        if future is None:
            told(False, f'/{self.client.controller}/{name} does not answer')
        else:
            self._pending.append((future, self._clock() + ANSWER_SECONDS, finish, told))

    def _take_answers(self, now: float) -> None:
        """Hand on the answers that have come, and drop those that do not."""
        waiting, self._pending = self._pending, []
        for future, until, finish, told in waiting:
            if future.done():
                self._take_answer(future, finish, told)
            elif now > until:
                future.cancel()
                told(False, f'/{self.client.controller} does not answer')
            else:
                self._pending.append((future, until, finish, told))

    def _take_answer(self, future: Future, finish: Callable[[Any], None], told: Told) -> None:
        """Hand on an answer; one that makes no sense is none."""
        try:
            finish(future.result())
        except Exception as error:
            told(False, f'/{self.client.controller} answers what makes no sense: '
                 f'{plain(in_words(error))}')

    # What the page is told ------------------------------------------------------------------

    def _listen(self, kind: type, name: str, callback: Callable[[Any], None],
                qos: QoSProfile, ending: str = LOOP,
                longest: int = LARGEST_MESSAGE) -> Subscription:
        """Listen to what a node of the controller, by the end of its name, listens to, too."""
        return subscribe(self.client.node, kind, self._topic(name, kind, ending), callback, qos,
                         longest)

    def _topic(self, name: str, kind: type, ending: str) -> str:
        """
        Return the topic that a node of the controller has in place of a name, which is remapped.

        The graph says which topics of a type a node listens to, and not what they are to it: the
        name itself is taken where it is among them, or they are several.
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
        """Ask for the parameters that say what is shown."""
        if self._descriptions is None:
            self._descriptions = self._listen(String, 'robot_description', self._on_description,
                                              LATCHED, ending='', longest=MOST_XML_CHARACTERS)
        prefixes = [TASKS.rstrip('.'), LIMITS.rstrip('.')]
        self._call(ListParameters, 'list_parameters', ListParameters.Request(prefixes=prefixes),
                   self._take_names, _nobody)

    def _take_names(self, answer: ListParameters.Response) -> None:
        """Ask for the values of parameters; those that are not there answer for none at all."""
        names = [*OF_ROBOT, 'stack', *answer.result.names]
        self._call(GetParameters, 'get_parameters', GetParameters.Request(names=names),
                   lambda values: self._take_values(names, values), _nobody)

    def _take_values(self, names: Sequence[str], answer: GetParameters.Response) -> None:
        """Take the values of parameters, and make the robot if it is another one."""
        if len(answer.values) == len(names):
            self.values = {name: parameter_value_to_python(value)
                           for name, value in zip(names, answer.values)}
            self._make_robot()

    def _make_robot(self) -> None:
        """Make the robot that the controller has."""
        values = self.values
        if not values:
            return
        limits = {name: value for name, value in values.items() if name.startswith(LIMITS)}
        made_of = self._description, [values[name] for name in OF_ROBOT], limits
        text = values['robot_description'] or self._description
        if made_of == self._made_of or not (values['robot'] or text):
            return
        self._made_of = made_of
        options: dict[str, Any] = {
            'base': values['base'], 'world_frame': values['world_frame'],
            'joints': names_in(values['joints']), 'limits': _limits(limits)}
        try:
            # A file may be on another machine; what its driver publishes is here.
            robot = Robot.from_urdf(text, **options) if text \
                else Robot.from_file(values['robot'], **options)
        except TpControllerError as error:
            self.robot, self.fault = None, plain(in_words(error))
            return
        self.look(False)
        self._configuration = ConfigurationBuffer(robot)
        self.robot, self.fault, self.q = robot, '', None
        self.velocity = np.full(robot.n, math.nan)

    @property
    def passive(self) -> Array:
        """Return the positions of the passive joints [rad or m]."""
        return self._configuration.passive

    def _on_description(self, message: String) -> None:
        """Take a description."""
        self._description = message.data
        self._make_robot()

    def _on_joints(self, message: JointState) -> None:
        """Take positions and velocities of joints."""
        robot, now = self.robot, self._clock()
        if robot is None or not self._configuration.put_joint_state(message, now):
            return
        if len(message.velocity) == len(message.name):
            for name, value in zip(message.name, message.velocity):
                if name in robot.joint_names:
                    self.velocity[robot.joint_index(name)] = \
                        value if abs(value) <= FASTEST else math.nan
        self._configure()

    def _on_odometry(self, message: Odometry) -> None:
        """Take the pose of the base."""
        self._configuration.put_odometry(message, self._clock())
        self._configure()

    def _configure(self) -> None:
        """Update the configuration, once all of it is known."""
        q = self._configuration.configuration(self._clock())
        if q is not None:
            self.q = q

    def _on_markers(self, message: MarkerArray) -> None:
        """Take what is drawn of the tasks."""
        self.markers = drawable(message.markers)


def _gain(task: str) -> str:
    """Return the parameter of the gain of a task."""
    return f'{TASKS}{task}.gain'


def _limits(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Return {velocity: {key: value}} of parameters of limits, without those that are none."""
    found: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        joint, _, key = name.removeprefix(LIMITS).rpartition('.')
        if math.isfinite(value):
            found.setdefault(joint, {})[key] = value
    return found


def _nobody(worked: bool, text: str) -> None:
    """Tell nobody."""

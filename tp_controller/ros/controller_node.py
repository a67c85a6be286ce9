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

"""The controller node: joint states, odometry and goals in, velocities and status out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
import math
import sys
from typing import Any

import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tp_controller.control.settings import Settings
from tp_controller.errors import EvaluationError, in_words, RobotError, SettingsError
from tp_controller.model.robot import Robot
from tp_controller.ros.interface.limit_parameters import LimitParameters, robot_from
from tp_controller.ros.interface.reporter import Reporter
from tp_controller.ros.interface.settings_parameters import SETTINGS, settings_from
from tp_controller.ros.interface.task_parameters import TaskParameters
from tp_controller.ros.interface.task_topics import TaskTopics
from tp_controller.ros.log import Log
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.control_loop import ControlLoop, INACTIVE
from tp_controller.ros.loop.other_publishers import Competitors
from tp_controller.ros.loop.permits import PARAMETERS as PERMITS
from tp_controller.ros.loop.permits import read_inputs
from tp_controller.ros.loop.realtime import prepare
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.loop.watchdog import Watchdog
from tp_controller.ros.parameters import (
    accept_numbers,
    declare,
    fixed_faults,
    names_in,
    ROBOT,
    Spec,
    TASKS,
    warn_unknown,
)
from tp_controller.ros.rclpy_internals import refuse_invalid_transitions
from tp_controller.ros.runner import ClosableNode, run, spinning
from tp_controller.solver.compiled import fallback_reason, running
from tp_controller.tasks.stack import Stack

NAME = 'tp_controller'
# Largest number of processors that Linux can be configured for.
MOST_PROCESSORS = 8192
PARAMETERS = (
    *ROBOT,
    Spec('joints', [''], 'driven joints, in the order of `weights` (an empty name: all that can '
         'be driven); the others stay where joint_states says', fixed=True),
    Spec('command_joints', [''], 'the driven joints in the order of the commands (an empty name: '
         'as `joints`)', fixed=True),
    Spec('stack', '', 'the tasks, the highest priority first: YAML text, a path, or '
         'package://<package>/<path>'),
    Spec('rate', 100.0, 'cycles per second; 0: one cycle for each complete joint state', 'Hz',
         0.0, 2000.0, True),
    Spec('state_timeout', 0.1, 'age of the joint states, and of the odometry of a base that '
         'moves, since their receipt, from which zeros are commanded', 's', 1e-3, 10.0, True),
    Spec('check_stamps', True, 'leave out joint states that are older than `state_timeout` by '
         'their stamps, or ahead of time; a stamp of 0 is none', fixed=True),
    Spec('jump_tolerance', 0.1, 'distance that a joint may move beyond its velocity limit, '
         'between two joint states or within `state_timeout`, or beyond twice its command within '
         '`follow_window`, before the robot is stopped, until ~/start (inf: any distance)',
         'rad or m', 0.0, math.inf, True),
    Spec('odometry_jump_tolerance', 0.25, 'the same for the base and its odometry; at least the '
         'corrections of the localisation', 'm or rad', 0.0, math.inf, True),
    Spec('limit_tolerance', 0.05, 'distance of a joint beyond a position limit, before it moves '
         'or in motion, at which the robot is stopped, until ~/start (inf: never)', 'rad or m',
         0.0, math.inf),
    Spec('follow_window', 1.0, 'time after which a joint, or a base, that does not follow its '
         'command stops the robot, until ~/start (0: never)', 's', 0.0, 60.0, True),
    Spec('settle_time', 0.3, 'for how long everything has to be in order after joint states or '
         'odometry were late, before the robot moves again', 's', 0.0, 60.0, True),
    Spec('exclusive', True, 'stop until ~/start, and publish nothing beside another node, if that '
         'publishes the same commands when this one starts, or as soon as its commands are '
         'received', fixed=True),
    Spec('require_listener', False, 'stop while no node other than watchdogs listens to the '
         'commands', fixed=True),
    Spec('require_watchdog', False, 'stop while no node whose name ends in watchdog listens to '
         'the commands', fixed=True),
    Spec('stop_deceleration', 0.0, 'deceleration of a stop while positions are known; at most the '
         'one the drives can follow; no stop takes longer than 2 s (0: zeros at once)',
         'rad/s² or m/s²', 0.0, 1e6),
    Spec('keep_goals', False, 'after a deactivation go on to the goals of before; else the tasks '
         'stay where they are when the node is activated again'),
    *PERMITS,
    Spec('watchdog_timeout', 0.2, 'time without a completed cycle after which zeros are commanded '
         'from outside the loop', 's', 0.01, 10.0, True),
    Spec('command_deadline', 0.0, 'longest time between two commands that is promised to those '
         'who request a deadline (QoS); it costs time in every cycle (0: none is promised)', 's',
         0.0, 60.0, True),
    Spec('state_deadline', 0.0, 'longest time between two joint states that is requested of their '
         'publishers (QoS): those that do not promise it are not heard, and what comes later is '
         'counted and logged (0: none)', 's', 0.0, 60.0, True),
    Spec('autostart', True, 'configure and activate the node at once; else its lifecycle services '
         'do', fixed=True),
    Spec('realtime_priority', 0, 'priority of the thread of the loop, from 1 to 99 (SCHED_FIFO); '
         '0: as other threads', '', 0, 99, True),
    Spec('processor', -1, 'the only processor that this thread runs on; -1: any', '', -1,
         MOST_PROCESSORS - 1, True),
    Spec('lock_memory', False, 'lock the memory of the process', fixed=True),
    # A collection of the objects that the imports leave takes 50 ms without a command: once in
    # 10 s while a stack is read 50 times a second.
    Spec('freeze_garbage', True, 'let the garbage collector leave alone what is there at the '
         'start', fixed=True),
    Spec('status_rate', 10.0, 'status and marker messages per second', 'Hz', 0.1, 1000.0, True),
    *SETTINGS,
)
# Polling periods of the node graph: other publishers of commands, nodes of the same name [s].
GRAPH_SECONDS, NAMESAKE_SECONDS = 0.1, 0.5
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STOPPED = 'stopped; call ~/start to go on'
IGNORED_DESCRIPTION = ('another description has arrived; deactivate, clean up and configure the '
                       'node to take it')
NO_ROBOT = 'no robot description yet'
NOT_CONFIGURED = 'not configured; configure and activate the node'


class ControllerNode(LifecycleNodeMixin, ClosableNode):
    """
    Node around the loop: parameters, goals, services, stacks, descriptions and status.

    Long operations run here, and their results are passed to the loop between two of its cycles.
    The loop has a node and a thread of its own; see `beside`.

    Attributes
    ----------
    loop_node : rclpy.node.Node
        Node that the loop runs on; it has to be spun, too.

    """

    def __init__(self, **options: Any) -> None:
        ClosableNode.__init__(self, NAME, **options)
        LifecycleNodeMixin.__init__(self)
        self._values = declare(self, PARAMETERS)
        self._log = Log(self.get_logger())
        self._limits = LimitParameters(self, adjustable=True)
        self.loop_node = Node(
            f'{self.get_name()}_loop', context=self.context, namespace=self.get_namespace(),
            # Names of topics are resolved, and remapped, by this node.
            use_global_arguments=False, start_parameter_services=False, enable_rosout=False,
            parameter_overrides=[Parameter('use_sim_time',
                                           value=self.get_parameter('use_sim_time').value)])
        # Created together, once there is a robot.
        self._loop: ControlLoop | None = None
        self._controller: SharedController | None = None
        self._topics: TaskTopics | None = None
        self._task_parameters: TaskParameters | None = None
        self._descriptions: Subscription | None = None
        self._checked_stack: Stack | None = None
        self._stack_fault, self._taken, self._ending = '', '', ''
        self._configured = self._active = self._stopped = False
        self._fault: Exception | None = None
        self._competitors: Competitors | None = None
        self._namesakes = 0
        self._reporter = Reporter(self, self._values['status_rate'], self._log)
        # A stop must not wait until a stack has been read.
        self.loop_node.create_service(Trigger, self.resolve_service_name('~/stop'), self._on_stop)
        for name, callback in (('start', self._on_start), ('reload', self._on_reload)):
            self.create_service(Trigger, f'~/{name}', callback)
        accept_numbers(self)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(GRAPH_SECONDS, self._check_other_nodes, clock=steady)
        self.create_timer(NAMESAKE_SECONDS, self._check_namesakes, clock=steady)
        refuse_invalid_transitions(self)
        self._reporter.leave(NOT_CONFIGURED)
        if self._values['autostart']:
            self._begin()
        warn_unknown(self)
        self._log.flush()

    def _begin(self) -> None:
        """Configure and activate the node, or raise the error."""
        self.trigger_configure()
        if self._fault is not None:
            raise self._fault
        self.trigger_activate()

    @contextmanager
    def beside(self, failed: Callable[[BaseException], None]) -> Iterator[None]:
        """Run the loop and its watchdog on threads of their own."""
        watchdog = Watchdog(self._values['watchdog_timeout'], self._silence, self._on_timeout)
        with spinning(self.loop_node, failed, self._prepare), watchdog.watching():
            yield

    def _prepare(self) -> None:
        """Prepare the thread of the loop, and log refused settings."""
        values = self._values
        for fault in prepare(values['realtime_priority'], values['processor'],
                             values['lock_memory'], values['freeze_garbage']):
            self._log.warning(fault)

    def halt(self, reason: str) -> None:
        """Command zeros for the last time and report the reason, even if other threads hang."""
        # A loop that is created or activated from now on is stopped.
        self._ending = reason
        self._update_hold()
        if self.context.ok():
            if self._loop is not None:
                self._loop.deactivate(reason)
            self._reporter.publish_reason(reason)

    def close(self, reason: str) -> None:
        """Command zeros for the last time and report the reason, unless ROS has shut down."""
        if self._loop is not None and self.context.ok():
            self._loop.deactivate(reason)
            self._reporter.publish()
            # Messages that have not arrived when the process ends may be lost.
            self._loop.commands.wait()
        self._log.flush()

    def destroy_node(self) -> None:
        """Destroy the node and the node of the loop."""
        self._reporter.close()
        self.loop_node.destroy_node()
        super().destroy_node()

    def _silence(self) -> float:
        """Return the time since the last progress of the loop [s]; 0 without a loop."""
        return self._loop.silence() if self._loop is not None else 0.0

    def _on_timeout(self) -> None:
        """Command zeros in place of the loop."""
        if self._loop is not None:
            self._loop.on_timeout()

    # Lifecycle ----------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read robot and stack; without a description wait for one."""
        self._fault = None
        try:
            self._settings = self._settings_of(self._values)
            # Faults of the parameters are reported at once, with or without a robot.
            read_inputs(self._values, self.resolve_topic_name)
            self._reporter.leave(NO_ROBOT)
            robot = self._make_robot()
            if robot is not None:
                self._set_robot(robot)
            else:
                self._taken = ''
                self._descriptions = self.create_subscription(
                    String, 'robot_description', self._on_description, LATCHED)
        except Exception as error:
            self._fault = error
            self._log.error(in_words(error))
            self._clean_up()
            return TransitionCallbackReturn.FAILURE
        self._configured = True
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command velocities from now on."""
        self._active = True
        self._activate()
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros for the last time."""
        self._deactivate()
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Discard robot and stack, so that others can be configured."""
        self._clean_up()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Command zeros for the last time, and discard robot and stack."""
        self._deactivate()
        self._clean_up()
        return TransitionCallbackReturn.SUCCESS

    def _activate(self) -> None:
        """Activate the loop, if it exists."""
        if self._loop is not None and self._competitors is not None and self._active:
            self._competitors.activate()
            self._loop.activate()
            self._update_hold()

    def _deactivate(self) -> None:
        """Stop the robot, and deactivate the loop."""
        self._active = False
        if self._loop is not None and self._controller is not None:
            self._loop.come_to_rest(INACTIVE)
            if not self._values['keep_goals']:
                with suppress(EvaluationError):  # reported when the task is evaluated
                    self._controller.forget_goals()
        self._update_hold()

    def _clean_up(self) -> None:
        """Close everything that depends on the robot."""
        if self._topics is not None:
            self._topics.close()
        if self._task_parameters is not None:
            self._task_parameters.close()
        if self._competitors is not None:
            self._competitors.close()
        if self._loop is not None:
            self._loop.close()
        if self._descriptions is not None:
            self.destroy_subscription(self._descriptions)
        self._loop = self._controller = self._topics = self._descriptions = None
        self._task_parameters = self._competitors = None
        self._configured, self._stack_fault = False, ''
        self._reporter.leave(NOT_CONFIGURED)

    def _update_hold(self) -> None:
        """Pass to the loop the condition that has to be resolved before the robot moves."""
        if self._loop is not None:
            self._loop.hold = self._ending or (
                INACTIVE if not self._active else STOPPED if self._stopped else self._stack_fault)

    # Robot --------------------------------------------------------------------------------

    def _settings_of(self, values: Mapping[str, Any]) -> Settings:
        """Return the settings of parameter values."""
        rate = self._values['rate']
        return settings_from(values, 1.0 / rate if rate > 0.0 else self._values['state_timeout'],
                             '1/rate' if rate > 0.0 else 'state_timeout, because rate is 0')

    def _make_robot(self, description: str | None = None) -> Robot | None:
        """Return the robot, or None without a description."""
        return robot_from(self._limits, self._values, description,
                          names_in(self._values['joints']))

    def _on_description(self, message: String) -> None:
        """Use the first valid description on the topic."""
        if self._loop is not None:
            ignored = IGNORED_DESCRIPTION if message.data != self._taken else ''
            self._loop.figures.ignored_description = ignored
            if ignored:
                self._log.warning(f'topic robot_description: {IGNORED_DESCRIPTION}')
            return
        try:
            robot = self._make_robot(message.data)
            if robot is not None:
                self._set_robot(robot)
                self._taken = message.data
                self._activate()
        except Exception as error:
            self._log.error(f'topic robot_description: {in_words(error)}')

    def _set_robot(self, robot: Robot) -> None:
        """Create the objects that depend on the robot."""
        for limit, what in ((np.inf, 'no velocity limit for'),
                            (0.0, 'the velocity limit is zero, so nothing moves, for')):
            names = [name for name, given in zip(robot.velocity_names, robot.velocity)
                     if given == limit]
            if names:
                self._log.warning(f'{what} {", ".join(names)}')
        for remark in robot.remarks:
            self._log.warning(remark)
        controller = SharedController(robot, Stack([]), self._settings)
        self._loop = ControlLoop(self.loop_node, self.resolve_topic_name, controller,
                                 self._values, self._log)
        self._competitors = Competitors(self, self.loop_node, self._loop, self._values, self._log)
        self._controller = controller
        self._topics = TaskTopics(self, controller, boot_time, self._log)
        self._task_parameters = TaskParameters(self, controller, self._log)
        self._reporter.follow(controller, self._loop, self._topics)
        self._load_stack()
        self._log.info(f'controlling {robot.name}, base {robot.base}, '
                       f'joints {", ".join(robot.joint_names)}, solver: {running()}')
        if fallback_reason():
            self._log.warning(fallback_reason())

    # Stack and parameters -----------------------------------------------------------------

    def _load_stack(self) -> None:
        """Read the stack of the parameter, or log its fault."""
        try:
            self._use_stack(self._read_stack(self._values['stack']))
        except Exception as error:
            self._stack_fault = f'no valid stack: {in_words(error)}'
            self._log.error(self._stack_fault)
        self._update_hold()

    def _read_stack(self, source: str) -> Stack:
        """Return the stack of a parameter's value."""
        if self._controller is None or self._task_parameters is None:
            raise RobotError(NO_ROBOT if self._configured else NOT_CONFIGURED)
        if not source:
            raise SettingsError(['parameter stack is empty: give it YAML text or a file'])
        stack = Stack.from_yaml(source, self._controller.robot)
        self._task_parameters.start_with(stack)
        return stack

    def _use_stack(self, stack: Stack) -> None:
        """Put a stack into force."""
        if self._controller is None or self._topics is None or self._task_parameters is None:
            return
        self._controller.replace_stack(stack, self._settings)
        self._stack_fault = ''
        self._topics.follow_stack()
        self._task_parameters.follow_stack()
        self._reporter.follow_stack()
        self._update_hold()
        names = ' > '.join(', '.join(task.name for task in group) for group in stack.groups)
        self._log.info(f'stack: {names or "empty"}', 'stack')
        for task in stack.tasks.values():
            for remark in task.remarks:
                self._log.warning(f'task {task.name}: {remark}')
            # At rate 0 the period is only an upper bound.
            if self._values['rate'] > 0.0:
                self._task_parameters.warn(task.name)

    def _check_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse values that the method refuses; ignore parameters of others."""
        given = {parameter.name: parameter.value for parameter in parameters}
        values = {**self._values, **given}
        faults = fixed_faults(self, given) if self._configured else []
        if faults:
            return SetParametersResult(successful=False, reason='; '.join(faults))
        try:
            settings = self._settings_of(values)
            if self._controller is not None and self._task_parameters is not None:
                stack = self._controller.stack
                if 'stack' in given:
                    # Kept, since the file may change until it is read again.
                    self._checked_stack = stack = self._read_stack(values['stack'])
                    if stack.text != self._controller.stack.text:
                        _refuse_with_stack(given)
                self._task_parameters.check(given)
                self._limits.check(given, self._controller)
                self._controller.check_settings(settings, stack)
        except Exception as error:
            return SetParametersResult(successful=False, reason=in_words(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Act on parameters that were accepted."""
        changed = {parameter.name: parameter.value for parameter in parameters}
        self._values.update(changed)
        self._settings = self._settings_of(self._values)
        if self._controller is None or self._task_parameters is None:
            return
        if self._loop is not None:
            self._loop.checks.limits.tolerance = self._values['limit_tolerance']
            self._loop.ramp.deceleration = self._values['stop_deceleration']
        stack = self._checked_stack if 'stack' in changed else None
        self._limits.apply(changed, self._controller)
        try:
            # An unchanged text keeps the goals sent since; ~/reload reads the targets again.
            if stack is not None and stack.text != self._controller.stack.text:
                self._use_stack(stack)
            else:
                with self._controller.lock:
                    self._controller.settings = self._settings
                    self._task_parameters.apply(changed)
        except Exception as error:
            # Raised by a task; a value that it has accepted may still fail.
            self._log.error(f'parameters {", ".join(changed)}: {in_words(error)}')

    # Others, services ---------------------------------------------------------------------

    def _check_other_nodes(self) -> None:
        """Check for nodes that publish or receive commands, or allow motion."""
        if self._loop is not None and self._competitors is not None and self._active:
            self._loop.permits.look(self, self._log)
            self._competitors.look()

    def _check_namesakes(self) -> None:
        """Report nodes of the same name."""
        own = self.get_name(), self.get_namespace()
        count = self.get_node_names_and_namespaces().count(own) - 1
        if count > self._namesakes:
            self._log.warning(f'another node has the name {self.get_fully_qualified_name()}')
        self._namesakes = count

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop the robot until ~/start."""
        self._stopped = True
        self._update_hold()
        if self._loop is not None and self._active and not self._loop.ramp.deceleration:
            self._loop.commands.interrupt()
        response.success, response.message = True, 'stopped'
        return response

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """
        Resume after ~/stop, or after a fault that is over.

        Tasks without a goal keep the values they have now.
        """
        loop = self._loop
        lasting = self._lasting()
        if lasting:
            response.success, response.message = False, f'not started: {lasting}'
            return response
        if loop is not None and (self._stopped or loop.stops.latched):
            try:
                loop.restart()
            except EvaluationError as error:
                response.success, response.message = False, f'not started: {error}'
                return response
        if self._competitors is not None:
            self._competitors.restart()
        self._stopped = False
        self._update_hold()
        response.success, response.message = True, 'started'
        return response

    def _lasting(self) -> str:
        """Return the fault that stopped the robot and lasts, if any."""
        if self._loop is None or self._competitors is None or not self._active:
            return ''
        return self._competitors.fault() or self._loop.lasting()

    def _on_reload(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Read the stack file again; a file with faults leaves the stack unchanged."""
        try:
            self._use_stack(self._read_stack(self._values['stack']))
            response.success, response.message = True, 'stack reloaded'
        except Exception as error:
            response.success, response.message = False, in_words(error)
        return response


def _refuse_with_stack(given: Mapping[str, object]) -> None:
    """Refuse task parameters together with another stack, which may lack these tasks."""
    names = [name for name in given if name.startswith(TASKS)]
    if names:
        raise SettingsError([f'set the stack first, and then {", ".join(names)}'])


main = partial(run, ControllerNode, NAME)

if __name__ == '__main__':
    sys.exit(main())

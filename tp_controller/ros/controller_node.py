# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The controller node: joint states, odometry and goals in, velocities and status out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
import sys
from typing import Any

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
from tp_controller.errors import EvaluationError, in_words
from tp_controller.model.robot import Robot
from tp_controller.ros.declarations.controller import PARAMETERS
from tp_controller.ros.interface.controlled_robot import ControlledRobot, log_remarks
from tp_controller.ros.interface.limit_parameters import LimitParameters, robot_from
from tp_controller.ros.interface.lock_service import LockService
from tp_controller.ros.interface.namesakes import Namesakes
from tp_controller.ros.interface.reporter import Reporter
from tp_controller.ros.interface.settings_parameters import settings_from
from tp_controller.ros.log import Log
from tp_controller.ros.loop.control_loop import INACTIVE
from tp_controller.ros.loop.permits import read_inputs
from tp_controller.ros.loop.realtime import prepare
from tp_controller.ros.loop.watchdog import Watchdog
from tp_controller.ros.parameters import (
    accept_numbers,
    declare,
    fixed_faults,
    names_in,
    warn_unknown,
)
from tp_controller.ros.rclpy_internals import refuse_invalid_transitions
from tp_controller.ros.runner import ClosableNode, run, spinning

NAME = 'tp_controller'
# Polling period of the node graph for other publishers of commands [s].
GRAPH_SECONDS = 0.1
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STOPPED_TEXT = 'stopped; call ~/start to go on'
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
        self._robot: ControlledRobot | None = None
        self._descriptions: Subscription | None = None
        self._taken = self._ending = ''
        self._configured = self._active = self._stopped = False
        self._fault: Exception | None = None
        self._reporter = Reporter(self, self._values['status_rate'], self._log)
        # A stop must not wait until a stack has been read.
        self.loop_node.create_service(Trigger, self.resolve_service_name('~/stop'), self._on_stop)
        for name, callback in (('start', self._on_start), ('reload', self._on_reload)):
            self.create_service(Trigger, f'~/{name}', callback)
        LockService(self, lambda: self._robot, lambda: self._reporter.reason)
        accept_numbers(self)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self.create_timer(GRAPH_SECONDS, self._check_other_nodes,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        Namesakes(self, self._log)
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
        for fault in prepare(*[self._values[key] for key in (
                'realtime_priority', 'processor', 'lock_memory', 'freeze_garbage')]):
            self._log.warning(fault)

    def halt(self, reason: str) -> None:
        """Command zeros for the last time and report the reason, even if other threads hang."""
        self._ending = reason  # also of a loop that is created or activated from now on
        self._update_hold()
        if self.context.ok():
            if self._robot is not None:
                self._robot.loop.deactivate(reason)
            self._reporter.publish_reason(reason)
            if self._robot is not None:
                self._robot.loop.commands.come_to_rest()

    def close(self, reason: str) -> None:
        """Command zeros for the last time and report the reason, unless ROS has shut down."""
        if self._robot is not None and self.context.ok():
            self._robot.loop.deactivate(reason)
            self._reporter.publish()
            # Messages that have not arrived when the process ends may be lost.
            self._robot.loop.commands.wait()
        self._log.flush()

    def destroy_node(self) -> None:
        """Destroy the node and the node of the loop."""
        self._reporter.close()
        self.loop_node.destroy_node()
        super().destroy_node()

    def _silence(self) -> float:
        """Return the time since the last progress of the loop [s]; 0 without a loop."""
        return self._robot.loop.silence() if self._robot is not None else 0.0

    def _on_timeout(self) -> None:
        """Command zeros in place of the loop."""
        if self._robot is not None:
            self._robot.loop.on_timeout()

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
                self._log.info(f'waiting for the robot on {self._descriptions.topic_name}')
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
        if self._robot is not None and self._active:
            self._robot.activate()
            self._update_hold()

    def _deactivate(self) -> None:
        """Stop the robot, and deactivate the loop."""
        self._active = False
        if self._robot is not None:
            self._robot.come_to_rest()
        self._update_hold()

    def _clean_up(self) -> None:
        """Close everything that depends on the robot."""
        if self._robot is not None:
            self._robot.close()
        if self._descriptions is not None:
            self.destroy_subscription(self._descriptions)
        self._robot = self._descriptions = None
        self._configured = False
        self._reporter.leave(NOT_CONFIGURED)

    def _update_hold(self) -> None:
        """Pass to the loop the condition that has to be resolved before the robot moves."""
        robot = self._robot
        if robot is not None:
            robot.loop.hold = self._ending or (
                INACTIVE if not self._active else STOPPED_TEXT if self._stopped
                else robot.stack_fault)

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
        if self._robot is not None:
            ignored = IGNORED_DESCRIPTION if message.data != self._taken else ''
            self._robot.loop.figures.ignored_description = ignored
            if ignored:
                self._log.warning(f'topic robot_description: {IGNORED_DESCRIPTION}')
            return
        try:
            if (robot := self._make_robot(message.data)) is not None:
                self._set_robot(robot)
                self._taken = message.data
                self._activate()
        except Exception as error:
            self._reporter.leave(NO_ROBOT)
            self._log.error(f'topic robot_description: {in_words(error)}')

    def _set_robot(self, robot: Robot) -> None:
        """Create the objects that depend on the robot."""
        log_remarks(robot, self._log)
        self._robot = ControlledRobot(self, self.loop_node, robot, self._settings, self._values,
                                      self._reporter, self._log)
        self._robot.load_stack(self._settings)
        self._update_hold()
        self._robot.log_robot()

    # Parameters ---------------------------------------------------------------------------

    def _check_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse values that the method refuses; ignore parameters of others."""
        given = {parameter.name: parameter.value for parameter in parameters}
        faults = fixed_faults(self, given) if self._configured else []
        if faults:
            return SetParametersResult(successful=False, reason='; '.join(faults))
        try:
            settings = self._settings_of({**self._values, **given})
            if self._robot is not None:
                self._robot.check(given, settings, self._limits)
        except Exception as error:
            return SetParametersResult(successful=False, reason=in_words(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Act on parameters that were accepted."""
        changed = {parameter.name: parameter.value for parameter in parameters}
        self._values.update(changed)
        self._settings = self._settings_of(self._values)
        if self._robot is not None:
            self._robot.apply(changed, self._settings, self._limits)
            self._update_hold()

    # Others, services ---------------------------------------------------------------------

    def _check_other_nodes(self) -> None:
        """Check for nodes that publish or receive commands, or allow motion."""
        if self._robot is not None and self._active:
            self._robot.look()

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop the robot until ~/start."""
        self._stopped = True
        self._update_hold()
        robot = self._robot
        if robot is not None and self._active and not robot.loop.ramp.deceleration:
            robot.loop.commands.interrupt()
        response.success, response.message = True, 'stopped'
        return response

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """
        Resume after ~/stop, or after a fault that is over.

        Tasks without a goal keep the values they have now.
        """
        robot = self._robot
        lasting = robot.lasting() if robot is not None and self._active else ''
        if lasting:
            response.success, response.message = False, f'not started: {lasting}'
            return response
        if robot is not None:
            try:
                robot.restart(self._stopped)
            except EvaluationError as error:
                response.success, response.message = False, f'not started: {error}'
                return response
        self._stopped = False
        self._update_hold()
        response.success, response.message = True, 'started'
        return response

    def _on_reload(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Read the stack file again; a file with faults leaves the stack unchanged."""
        robot = self._robot
        if robot is None:
            response.success, response.message = False, self._reporter.reason
            return response
        try:
            robot.use_stack(robot.read_stack(self._values['stack']), self._settings)
            self._update_hold()
            response.success, response.message = True, 'stack reloaded'
        except Exception as error:
            response.success, response.message = False, in_words(error)
        return response


main = partial(run, ControllerNode, NAME)

if __name__ == '__main__':
    sys.exit(main())

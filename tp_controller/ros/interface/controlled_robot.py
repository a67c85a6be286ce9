# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot under control: loop, controller, topics and parameters, from first to last."""

from collections.abc import Mapping
from contextlib import ExitStack, suppress
from typing import Any

import numpy as np
from rclpy.node import Node
from tp_controller.control.settings import Settings
from tp_controller.errors import EvaluationError, in_words, SettingsError
from tp_controller.model.limits import velocity_table
from tp_controller.model.robot import Robot
from tp_controller.ros.declarations.spec import TASKS
from tp_controller.ros.interface.limit_parameters import LimitParameters
from tp_controller.ros.interface.lock_parameter import LockParameter
from tp_controller.ros.interface.position_service import PositionService
from tp_controller.ros.interface.reporter import Reporter
from tp_controller.ros.interface.task_parameters import TaskParameters
from tp_controller.ros.interface.task_topics import TaskTopics
from tp_controller.ros.log import Log
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.control_loop import ControlLoop, INACTIVE
from tp_controller.ros.loop.other_publishers import Competitors
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.solver.compiled import fallback_reason, running
from tp_controller.tasks.stack import Stack


class ControlledRobot:
    """
    Objects of the controller node that exist while it has a robot.

    Parameters
    ----------
    node, loop_node : rclpy.node.Node
        Node of the interface, and node of the loop.
    robot : Robot
    settings : Settings
    values : dict
        Parameters of the controller node, updated when they change.
    reporter : Reporter
    log : Log

    Attributes
    ----------
    loop : ControlLoop
    controller : SharedController
    topics : TaskTopics
    stack_fault : str
        Fault of the stack that the node was started with, or empty.

    """

    def __init__(self, node: Node, loop_node: Node, robot: Robot, settings: Settings,
                 values: dict[str, Any], reporter: Reporter, log: Log) -> None:
        self._node, self._values, self._reporter, self._log = node, values, reporter, log
        self.stack_fault = ''
        self._checked_stack: Stack | None = None
        with ExitStack() as closing:
            self.controller = SharedController(robot, Stack([]), settings)
            topic = node.resolve_topic_name
            self.loop = ControlLoop(loop_node, topic, self.controller, values, log)
            closing.callback(self.loop.close)
            self._competitors = Competitors(node, loop_node, self.loop, values, log)
            closing.callback(self._competitors.close)
            self._locks = LockParameter(node, self.controller, values, log)
            self._task_parameters = TaskParameters(node, self.controller, log)
            closing.callback(self._task_parameters.close)
            self.topics = TaskTopics(node, self.controller, boot_time, log)
            closing.callback(self.topics.close)
            closing.callback(PositionService(node, self.controller).close)
            reporter.follow(self.controller, self.loop, self.topics)
            self._closing = closing.pop_all()

    def close(self) -> None:
        """Close topics, parameters and the loop."""
        self._closing.close()

    def log_robot(self) -> None:
        """Log the robot under control, and the solver."""
        robot = self.controller.robot
        self._log.info(f'controlling {robot.name}, base {robot.base}, '
                       f'joints {", ".join(robot.joint_names)}, solver: {running()}')
        if fallback_reason():
            self._log.warning(fallback_reason())

    # Motion -------------------------------------------------------------------------------

    def activate(self) -> None:
        """Activate the loop."""
        self._competitors.activate()
        self.loop.activate()

    def come_to_rest(self) -> None:
        """Stop the robot, and deactivate the loop."""
        self.loop.come_to_rest(INACTIVE)
        if not self._values['keep_goals']:
            with suppress(EvaluationError):  # reported when the task is evaluated
                self.controller.forget_goals()

    def lasting(self) -> str:
        """Return the fault that stopped the robot and lasts, if any."""
        return self._competitors.fault() or self.loop.lasting()

    def restart(self, stopped: bool) -> None:
        """
        Resume after a stop, or after a fault that is over.

        Parameters
        ----------
        stopped : bool
            The robot was stopped by the user.

        Raises
        ------
        EvaluationError
            A task cannot be evaluated.

        """
        if stopped or self.loop.stops.latched:
            self.loop.restart()
        self._competitors.restart()

    def go_on(self) -> str:
        """
        Resume after a stop for a joint that is locked now.

        Returns
        -------
        str
            Reason for which the robot does not move all the same, or empty.

        """
        loop, stops = self.loop, self.loop.stops
        # As in the next cycle: a locked joint may be outside its position limits.
        loop.checks.ignore(self.controller.locked)
        lasting = self.lasting() if loop.active else ''
        if not lasting and stops.further:
            stops.clear_first()
            lasting = stops.latched
        if lasting:
            return f'{lasting}; call ~/start to go on'
        try:
            self.restart(True)
        except EvaluationError as error:
            return str(error)
        return loop.hold

    def note_locks(self) -> None:
        """Add the locks of the loop to the parameter."""
        self._locks.look()

    def look(self) -> None:
        """Check for nodes that publish or receive commands, or allow motion, and for locks."""
        # A query of the graph takes a quarter of a cycle at 1 kHz.
        self.loop.gaps.wait()
        self.note_locks()
        self.loop.permits.look(self._node, self._log)
        self._competitors.look()

    # Stack and parameters -----------------------------------------------------------------

    def load_stack(self, settings: Settings) -> None:
        """Use the stack of the parameter, or log its fault."""
        try:
            self.use_stack(self.read_stack(self._values['stack']), settings)
        except Exception as error:
            self.stack_fault = f'no valid stack: {in_words(error)}'
            self._log.error(self.stack_fault)

    def read_stack(self, source: str) -> Stack:
        """Return the stack of a parameter's value."""
        if not source:
            raise SettingsError(['parameter stack is empty: give it YAML text or a file'])
        stack = Stack.from_yaml(source, self.controller.robot)
        self._task_parameters.start_with(stack)
        return stack

    def use_stack(self, stack: Stack, settings: Settings) -> None:
        """Put a stack into force."""
        self.controller.replace_stack(stack, settings)
        self.stack_fault = ''
        self.topics.follow_stack()
        self._task_parameters.follow_stack()
        self._reporter.follow_stack()
        names = ' > '.join(', '.join(task.name for task in group) for group in stack.groups)
        self._log.info(f'stack: {names or "empty"}', 'stack')
        for task in stack.tasks.values():
            for remark in task.remarks:
                self._log.warning(f'task {task.name}: {remark}')
            # At rate 0 the period is only an upper bound.
            if self._values['rate'] > 0.0:
                self._task_parameters.warn(task.name)

    def check(self, given: Mapping[str, Any], settings: Settings,
              limits: LimitParameters) -> None:
        """Raise the error for which some of {parameter: value} are refused, if any."""
        stack = self.controller.stack
        if 'stack' in given:
            # Kept, since the file may change until it is read again.
            self._checked_stack = stack = self.read_stack(given['stack'])
            if stack.text != self.controller.stack.text:
                _refuse_with_stack(given)
        self._task_parameters.check(given)
        limits.check(given, self.controller)
        self._locks.check(given)
        self.controller.check_settings(settings, stack)

    def apply(self, changed: Mapping[str, Any], settings: Settings,
              limits: LimitParameters) -> None:
        """Apply {parameter: value} that were checked; log a fault of a task."""
        self.loop.checks.limits.tolerance = self._values['limit_tolerance']
        self.loop.checks.on_not_following = self._values['on_not_following']
        self.loop.ramp.deceleration = self._values['stop_deceleration']
        stack = self._checked_stack if 'stack' in changed else None
        limits.apply(changed, self.controller)
        self._locks.apply(changed)
        try:
            # An unchanged text keeps the goals sent since; ~/reload reads the targets again.
            if stack is not None and stack.text != self.controller.stack.text:
                self.use_stack(stack, settings)
            else:
                with self.controller.mutex:
                    self.controller.settings = settings
                    self._task_parameters.apply(changed)
        except Exception as error:
            # Raised by a task; a value that it has accepted may still fail.
            self._log.error(f'parameters {", ".join(changed)}: {in_words(error)}')


def log_remarks(robot: Robot, log: Log) -> None:
    """Log unusual limits of a robot, and remarks about its description."""
    for limit, what, cure in (
            (np.inf, 'no velocity limit for', 'give it, with the values of the data sheet, by '),
            (0.0, 'the velocity limit is zero, so nothing moves, for', 'raise it by ')):
        names = [name for name, given in zip(robot.velocity_names, robot.velocity)
                 if given == limit]
        if names:
            log.warning(f'{what} {", ".join(names)}; {cure}{velocity_table(names)}')
    for remark in robot.remarks:
        log.warning(remark)


def _refuse_with_stack(given: Mapping[str, object]) -> None:
    """Refuse task parameters together with another stack, which may lack these tasks."""
    names = [name for name in given if name.startswith(TASKS)]
    if names:
        raise SettingsError([f'set the stack first, and then {", ".join(names)}'])

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

from array import array
from collections.abc import Mapping, Sequence
from functools import partial
import math
import sys
import time
import traceback
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import Trigger
from tp_controller.control.controller import Controller
from tp_controller.control.report import Report
from tp_controller.control.settings import Settings
from tp_controller.errors import in_words, RobotError, SettingsError, TpControllerError
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.nodes.base_topics import FixedBase, MovingBase
from tp_controller.nodes.joint_states import JointStateBuffer
from tp_controller.nodes.parameters import (
    declare,
    ROBOT,
    robot_from,
    SETTINGS,
    settings_from,
    Spec,
    STRINGS,
    warn_unknown,
)
from tp_controller.nodes.runner import ClosableNode, run
from tp_controller.nodes.state_checks import Following, MotionCheck
from tp_controller.nodes.status import diagnostics, markers
from tp_controller.nodes.stops import Stops
from tp_controller.nodes.task_topics import TaskTopics
from tp_controller.tasks.stack import Stack
from visualization_msgs.msg import MarkerArray

NAME = 'tp_controller'
PARAMETERS = (
    *ROBOT,
    Spec('joints', STRINGS, 'driven joints, in the order of `weights` (default: all that can be '
         'driven); the others stay where joint_states says', read_only=True),
    Spec('command_joints', STRINGS, 'the driven joints in the order of the commands (default: '
         'as `joints`)', read_only=True),
    Spec('stack', '', 'the tasks, the highest priority first: YAML text, a path, or '
         'package://<package>/<path>'),
    Spec('rate', 100.0, 'cycles per second; 0: one cycle for each complete joint state', 'Hz',
         0.0, 2000.0, True),
    Spec('state_timeout', 0.1, 'age of the joint states, and of the odometry of a base that '
         'moves, since their receipt, from which zeros are commanded', 's', 1e-3, 10.0, True),
    Spec('check_stamps', True, 'leave out joint states that are older than `state_timeout` by '
         'their stamps, or ahead of time; a stamp of 0 is none', read_only=True),
    Spec('jump_tolerance', 0.1, 'what a joint may move beyond its velocity limit between two '
         'joint states before the robot is stopped, until ~/start (inf: any distance)', 'rad or m',
         0.0, math.inf, True),
    Spec('limit_tolerance', 0.05, 'how far a joint may pass a position limit before the robot is '
         'stopped, until ~/start (inf: never)', 'rad or m', 0.0, math.inf, True),
    Spec('follow_window', 1.0, 'time after which a joint that does not follow its command stops '
         'the robot, until ~/start (0: never)', 's', 0.0, 60.0, True),
    Spec('settle_time', 0.3, 'for how long everything has to be in order after joint states or '
         'odometry were late, before the robot moves again', 's', 0.0, 60.0, True),
    Spec('exclusive', True, 'stop, until ~/start, if another node publishes the same commands '
         'when this one starts; later ones are only reported', read_only=True),
    Spec('status_rate', 10.0, 'status and marker messages per second', 'Hz', 0.1, 1000.0, True),
    *SETTINGS,
)
# Joint states need no repetition, and there may be several publishers in one cycle.
STATE_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
# How long the last zero may take to arrive when the node ends [s].
LAST_ZERO_SECONDS = 0.5
LAST_ZEROS = 3
# How often other publishers are looked for, and until when this node counts as the newcomer [s].
LOOK_SECONDS, NEW_SECONDS = 0.5, 2.0
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ControllerNode(ClosableNode):
    """
    Runs the controller, by a timer or once per joint state.

    Whenever something is missing zeros are commanded, and the status says what.
    """

    # Made once there is a robot, all of them at once; `_ready` says whether there is.
    _controller: Controller
    _topics: TaskTopics
    _buffer: JointStateBuffer
    _base: MovingBase | FixedBase

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        # Safety times are measured between receipt and use, on a clock nobody can set.
        self._now = time.monotonic
        self._values = declare(self, PARAMETERS)
        self._settings = self._settings_of(self._values)
        self._ready = False
        self._report: Report | None = None
        self._checked_stack: Stack | None = None
        self._stack_fault = ''
        self._stopped = self._status_due = False
        self._stops = Stops(self._values['settle_time'])
        self._stop_reason = 'no robot description yet'
        self._last_cycle = self._now()
        self._last_robot_time = self._robot_time()
        robot = self._make_robot()
        if robot is not None:
            self._set_robot(robot)
        else:
            self.create_subscription(String, 'robot_description', self._on_description, LATCHED)
        self._status = self.create_publisher(DiagnosticArray, '~/status', 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._markers = self.create_publisher(MarkerArray, '~/markers', 10)
        for name, callback in (('stop', self._on_stop), ('start', self._on_start),
                               ('reload', self._on_reload)):
            self.create_service(Trigger, f'~/{name}', callback)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._apply_parameters)
        self._start_timers()
        warn_unknown(self)

    def close(self, reason: str) -> None:
        """Command zeros for the last time, and say why, unless ROS has ended already."""
        if self._ready and self.context.ok():
            # A message may get lost.
            for _ in range(LAST_ZEROS):
                self._publish_zeros()
            self._stop_reason = reason
            self._publish_status()
            # What has not arrived when the process ends may never do so.
            for publisher in (self._commands, self._base):
                publisher.wait_for_all_acked(Duration(seconds=LAST_ZERO_SECONDS))

    # Setting up ---------------------------------------------------------------------------

    def _period(self) -> float:
        """Return the longest time between two commands [s]."""
        rate = self._values['rate']
        return 1.0 / rate if rate > 0.0 else self._values['state_timeout']

    def _robot_time(self) -> float:
        """Return the time that passes for the robot [s]: a simulation may have its own."""
        # Declared as a clock of any kind; that of a node follows use_sim_time.
        clock = cast(ROSClock, self.get_clock())
        return clock.now().nanoseconds * 1e-9 if clock.ros_time_is_active else self._now()

    def _settings_of(self, values: Mapping[str, Any]) -> Settings:
        """Return the settings that parameter values make."""
        return settings_from(values, self._period(), '1/rate' if self._values['rate'] > 0.0
                             else 'state_timeout, because rate is 0')

    def _start_timers(self) -> None:
        """Start the cycle, and what watches over it on the steady clock."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        if self._values['rate'] > 0.0:
            self.create_timer(1.0 / self._values['rate'], self._cycle)
        # Neither a joint state nor simulated time may come any more: then nothing else would
        # command zeros.
        self.create_timer(self._values['state_timeout'] / 2.0, self._watch, clock=steady)
        self.create_timer(1.0 / self._values['status_rate'], self._on_status_timer,
                          clock=steady)
        self.create_timer(LOOK_SECONDS, self._look_for_others, clock=steady)

    def _make_robot(self, description: str | None = None) -> Robot | None:
        """Return the robot, None without a description."""
        return robot_from(self, self._values, description, self._values['joints'])

    def _on_description(self, message: String) -> None:
        """Take the first usable description from the topic."""
        if self._ready:
            return
        try:
            robot = self._make_robot(message.data)
            if robot is not None:
                self._set_robot(robot)
        except Exception as error:
            self.get_logger().error(f'topic robot_description: {in_words(error)}')

    def _set_robot(self, robot: Robot) -> None:
        """Make everything that depends on the robot."""
        names = self._values['command_joints'] or list(robot.joint_names)
        if sorted(names) != sorted(robot.joint_names):
            raise RobotError('parameter command_joints must be the driven joints in some order '
                             f'({", ".join(robot.joint_names)}), not {", ".join(names)}')
        for limit, what in ((np.inf, 'no velocity limit for'),
                            (0.0, 'the velocity limit is zero, so nothing moves, for')):
            names_of = [name for name, given in zip(robot.velocity_names, robot.velocity)
                        if given == limit]
            if names_of:
                self.get_logger().warning(f'{what} {", ".join(names_of)}')
        self._controller = Controller(robot, Stack([]), self._settings)
        self._topics = TaskTopics(self, self._controller, self._now)
        self._order = np.array([robot.joint_index(name) for name in names], dtype=int)
        self._command = Float64MultiArray(data=array('d', bytes(8 * len(names))))
        self._command_view = np.frombuffer(self._command.data)
        self._commands = self.create_publisher(Float64MultiArray,
                                               'velocity_controller/commands', 10)
        self._zeros = np.zeros(robot.n)
        self._base = MovingBase(self, robot, self._now, self._on_odometry) if robot.moves \
            else FixedBase()
        self._watch_over(robot)
        self._ready, self._started, self._others = True, self._now(), 0
        self._load_stack()
        self.create_subscription(JointState, 'joint_states', self._on_joint_state, STATE_QOS)
        self.get_logger().info(f'controlling {robot.name}, base {robot.base}, '
                               f'joints {", ".join(names)}')

    def _watch_over(self, robot: Robot) -> None:
        """Make what takes joint states, and what tells whether they can be true."""
        rows = robot.joint_columns
        lower, upper = robot.lower[rows], robot.upper[rows]
        values = self._values
        endless = np.isinf(upper - lower) & np.array(
            [unit == 'rad' for unit in robot.velocity_units[rows]], dtype=bool)
        self._buffer = JointStateBuffer(
            robot.joint_names, robot.passive_names, robot.passive_neutral, robot.velocity[rows],
            endless, values['state_timeout'] if values['check_stamps'] else math.inf,
            values['jump_tolerance'])
        self._motion = MotionCheck(robot.joint_names, lower, upper, endless,
                                   Following(values['follow_window']), values['limit_tolerance'])

    # Stack and parameters -----------------------------------------------------------------

    def _load_stack(self) -> bool:
        """Read the stack of the parameter; return whether it is valid."""
        try:
            self._use_stack(self._read_stack(self._values['stack']))
        except Exception as error:
            self._stack_fault = f'no valid stack: {in_words(error)}'
            self.get_logger().error(self._stack_fault)
            return False
        return True

    def _read_stack(self, source: str) -> Stack:
        """Return the stack of a parameter's value."""
        if not source:
            raise SettingsError(['parameter stack is empty: give it YAML text or a file'])
        return Stack.from_yaml(source, self._controller.robot)

    def _use_stack(self, stack: Stack) -> None:
        """Carry out a stack."""
        self._controller.replace_stack(stack, self._settings)
        self._stack_fault = ''
        self._topics.follow_stack()
        names = ' > '.join(', '.join(task.name for task in group) for group in stack.groups)
        self.get_logger().info(f'stack: {names or "empty"}')
        for task in stack.tasks.values():
            for remark in task.remarks:
                self.get_logger().warning(f'task {task.name}: {remark}')

    def _check_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Refuse what the method would refuse; what it knows nothing of is not its business."""
        values = {**self._values, **{parameter.name: parameter.value
                                     for parameter in parameters}}
        try:
            settings = self._settings_of(values)
            if self._ready:
                stack = self._controller.stack
                if any(parameter.name == 'stack' for parameter in parameters):
                    # Kept, since a file may be another one the next time it is read.
                    self._checked_stack = stack = self._read_stack(values['stack'])
                self._controller.check_settings(settings, stack)
        except Exception as error:
            return SetParametersResult(successful=False, reason=in_words(error))
        return SetParametersResult(successful=True)

    def _apply_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Act on parameters that were accepted."""
        changed = {parameter.name: parameter.value for parameter in parameters}
        self._values.update(changed)
        self._settings = self._settings_of(self._values)
        if self._ready:
            if 'stack' in changed and self._checked_stack is not None:
                self._use_stack(self._checked_stack)
            else:
                self._controller.settings = self._settings

    # The cycle ----------------------------------------------------------------------------

    def _on_joint_state(self, message: JointState) -> None:
        """Take joint positions; in the mode without a timer they start the cycle."""
        stamp = message.header.stamp
        fault = self._buffer.put(message.name, message.position, self._now(),
                                 stamp.sec + 1e-9 * stamp.nanosec, self._robot_time())
        if self._buffer.contradiction and self._stops.moved:
            self._stops.latch(self._buffer.contradiction)
        elif self._buffer.contradiction:
            # As of a driver that publishes zeros before it has read any position.
            self._buffer.forget()
        if fault:
            self.get_logger().warning(f'joint state ignored: {fault}', throttle_duration_sec=1.0)
        elif self._values['rate'] == 0.0 and self._buffer.take_complete():
            self._cycle()

    def _on_odometry(self) -> None:
        """Start the cycle where nothing else does: without a timer and without driven joints."""
        if self._values['rate'] == 0.0 and not self._controller.robot.joint_names:
            self._cycle()

    def _cycle(self) -> None:
        """Command velocities, or zeros where something is missing."""
        now, robot_time = self._now(), self._robot_time()
        elapsed = robot_time - self._last_robot_time
        self._last_cycle, self._last_robot_time = now, robot_time
        if not self._ready:
            return
        reason = self._find_stop_reason(now)
        if not reason:
            try:
                command = self._controller.update(self._base.configuration(self._buffer.q), now,
                                                  self._buffer.passive, elapsed)
                self._report = command.report
                self._topics.changed = False
                self._publish_velocity(command.velocity)
                self._check_motion(command.velocity, robot_time)
            except TpControllerError as error:
                reason = str(error)
            except Exception as error:  # of a task that somebody else wrote
                self._stops.latch(in_words(error))
                self.get_logger().error(traceback.format_exc())
                reason = self._find_stop_reason(now)
        if reason:
            self._publish_zeros()
        self._log_stop_reason(reason)
        if self._status_due:
            self._publish_status()

    def _check_motion(self, velocity: Array, now: float) -> None:
        """Stop, until ~/start, if the robot does not follow or passes a limit."""
        q, joints = self._buffer.q, velocity[self._controller.robot.joint_columns]
        fault = self._motion.passed(q) or self._motion.check(q, joints, now)
        if fault:
            self._stops.latch(fault)

    def _log_stop_reason(self, reason: str) -> None:
        """Log why the robot is stopped, or that it moves again, where that has changed."""
        if reason == self._stop_reason:
            return
        self._stop_reason = reason
        if reason:
            self.get_logger().warning(f'commanding zeros: {reason}')
        else:
            self.get_logger().info('running')
            unheard = self._buffer.unheard()
            if unheard:
                self.get_logger().warning(
                    'no joint states of passive joints: until then they count as at zero, or at '
                    f'the limit nearest to zero: {", ".join(unheard)}')

    def _find_stop_reason(self, now: float) -> str:
        """Return why zeros are commanded; empty if nothing speaks against motion."""
        if self._stopped:
            return 'stopped; call ~/start to go on'
        if self._stack_fault:
            return self._stack_fault
        return self._stops.reason(self._missing(now), now)

    def _missing(self, now: float) -> str:
        """Return what has not arrived for too long; empty if nothing is missing."""
        timeout = self._values['state_timeout']
        missing = self._buffer.missing(now, timeout)
        if missing:
            ignored = self._buffer.ignored(now, timeout)
            return f'no joint states of {", ".join(missing)}' \
                   + (f' (ignored: {ignored})' if ignored else '')
        return self._base.stop_reason(now, timeout)

    def _watch(self) -> None:
        """Command zeros if the cycle has not done anything for too long."""
        now = self._now()
        silence = now - self._last_cycle
        if not self._ready or silence <= self._values['state_timeout']:
            return
        reason = self._find_stop_reason(now)
        # A cycle may well be longer than the joint states may be old.
        if not reason and silence > 2.0 * self._period():
            if not self.get_parameter('use_sim_time').value:
                # The timer is only late, as on a machine that has too much to do.
                self._cycle()
                return
            reason = 'simulated time (/clock) stands still'
        if reason:
            self._publish_zeros()
            self._log_stop_reason(reason)

    def _look_for_others(self) -> None:
        """Notice other publishers of the same commands."""
        if not self._ready:
            return
        topic = self._commands.topic_name
        others, before = self.count_publishers(topic) - 1, self._others
        self._others = others
        if others <= before:
            return
        self.get_logger().warning(f'another node publishes on {topic}')
        if self._values['exclusive'] and self._now() - self._started < NEW_SECONDS:
            self._stops.latch(f'another node publishes on {topic}')

    def _publish_zeros(self) -> None:
        """Command no motion."""
        # Nothing is to be followed meanwhile.
        self._motion.forget()
        self._controller.halt(self._now())
        self._publish_velocity(self._zeros)

    def _publish_velocity(self, velocity: Array) -> None:
        """Command velocities (n,), to the joints and to the base."""
        self._command_view[:] = velocity[self._order]
        self._commands.publish(self._command)
        self._base.publish(velocity)

    # Services and status ------------------------------------------------------------------

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Stop, until ~/start."""
        self._stopped = True
        if self._ready:
            self._publish_zeros()
        response.success, response.message = True, 'stopped'
        return response

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """
        Go on after ~/stop, or after a fault that is over.

        Tasks without a goal keep the values they have now.
        """
        lasting = self._buffer.lasting(self._now()) if self._ready else ''
        if lasting:
            response.success, response.message = False, f'not started: {lasting}'
            return response
        if self._ready and (self._stopped or self._stops.latched):
            self._controller.restart()
            self._buffer.forget()
            self._motion.forget()
        self._stopped, self._stops.latched = False, ''
        response.success, response.message = True, 'started'
        return response

    def _on_reload(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Read the stack file again; one with faults leaves the stack as it is."""
        try:
            if not self._ready:
                raise RobotError('no robot description yet')
            self._use_stack(self._read_stack(self._values['stack']))
            response.success, response.message = True, 'stack reloaded'
        except Exception as error:
            response.success, response.message = False, in_words(error)
        return response

    def _on_status_timer(self) -> None:
        """Publish the status; with a new goal after the next cycle, which reports about it."""
        self._status_due = True
        if self._stop_reason or not self._topics.changed:
            self._publish_status()

    def _publish_status(self) -> None:
        """Publish the status, and markers where somebody looks at them."""
        self._status_due = False
        stamp = self.get_clock().now().to_msg()
        message = diagnostics(stamp, self.get_fully_qualified_name().strip('/'), self._stop_reason,
                              self._report, self._topics.records if self._ready else {})
        self._status.publish(message)
        self._diagnostics.publish(message)
        if self._ready and self._markers.get_subscription_count():
            self._markers.publish(markers(stamp, self._controller.robot.root, self._controller))


main = partial(run, ControllerNode, NAME)

if __name__ == '__main__':
    sys.exit(main())

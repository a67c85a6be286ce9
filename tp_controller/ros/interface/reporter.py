# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reporting of tasks and loop: status, diagnostics and markers."""

from collections.abc import Collection, Mapping, Sequence
import math

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from tp_controller.control.report import Report
from tp_controller.control.sketcher import Configuration, FramePose, Sketcher
from tp_controller.control.task_report import TaskReport
from tp_controller.errors import RobotError
from tp_controller.ros.interface.interactive_goals import InteractiveGoals
from tp_controller.ros.interface.markers import Markers
from tp_controller.ros.interface.recent_hints import RecentHints
from tp_controller.ros.interface.status import diagnostics, task_reports
from tp_controller.ros.interface.task_numbers import TaskNumbers
from tp_controller.ros.interface.task_topics import GoalRecord, TaskTopics
from tp_controller.ros.interface.task_transforms import TaskTransforms
from tp_controller.ros.log import Log
from tp_controller.ros.loop.clocks import boot_time
from tp_controller.ros.loop.control_loop import ControlLoop
from tp_controller.ros.loop.loop_statistics import Figures
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.tasks.sketch import Sketch
from visualization_msgs.msg import MarkerArray

# Longest delay of a log message [s].
LOG_DELAY = 0.05
# Longest time that a status waits for a cycle with all goals [s]: they may arrive all the time.
LONGEST_STATUS_WAIT = 0.2
DIAGNOSTICS_SECONDS = 1.0


class Reporter:
    """
    Publisher of status, diagnostics and markers, beside the loop.

    Parameters
    ----------
    node : rclpy.node.Node
        Node that the topics belong to.
    rate : float
        Status and marker messages per second.
    log : Log
        Log that this flushes.

    Attributes
    ----------
    reason : str
        Reason for zero commands while there is no loop.

    """

    def __init__(self, node: Node, rate: float, log: Log) -> None:
        self._node, self._log = node, log
        self._name = node.get_fully_qualified_name().strip('/')
        self._controller: SharedController | None = None
        self._loop: ControlLoop | None = None
        self._topics: TaskTopics | None = None
        self.reason = ''
        self._waits_since = math.inf
        self._status = node.create_publisher(DiagnosticArray, '~/status', 10)
        self._diagnostics = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._numbers, self._transforms = TaskNumbers(node), TaskTransforms(node)
        self._drawn = node.create_publisher(MarkerArray, '~/markers', 10)
        self._markers = Markers(1.0 / rate, self._log_undrawn)
        self._sketcher: Sketcher | None = None
        # {task: reason for which it cannot be drawn}, of those in the log.
        self._faults: dict[str, str] = {}
        self._hints = RecentHints()
        self._goals = InteractiveGoals(node, log.warning)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in ((1.0 / rate, self._on_status), (LOG_DELAY, self._on_flush),
                                 (DIAGNOSTICS_SECONDS, self._on_diagnostics)):
            node.create_timer(period, callback, clock=steady)

    def follow(self, controller: SharedController, loop: ControlLoop,
               topics: TaskTopics) -> None:
        """Set the loop to report on."""
        self._controller, self._loop, self._topics = controller, loop, topics
        # Created now, since it may take as long as many cycles.
        self._sketcher = Sketcher(controller.robot, self._log_undrawn)
        self._goals.follow(topics.take)

    def follow_stack(self) -> None:
        """Update the tasks to those of another stack."""
        self._faults = {}
        self._hints.forget()
        if self._controller is not None:
            self._numbers.follow(self._controller.stack.tasks)
            self._transforms.follow(self._controller.stack.tasks)

    def leave(self, reason: str) -> None:
        """Report that there is no loop, for a reason."""
        self._numbers.follow(())
        self._transforms.follow({})
        self._controller = self._loop = self._topics = self._sketcher = None
        self._goals.follow(None)
        self.reason = reason

    def publish(self) -> None:
        """Publish status, numbers, poses and markers, each if it has subscribers."""
        self._waits_since = math.inf
        self._publish_status(self._status)
        self._numbers.publish(self._reports)
        self._transforms.publish(self._poses)
        self._draw()

    def publish_reason(self, reason: str) -> None:
        """Publish the reason for zero commands, without the tasks, which may hang."""
        self._status.publish(self._make_status(reason, None, None, {}))

    def close(self) -> None:
        """Remove the interactive markers."""
        self._goals.close()

    def _draw(self) -> None:
        """Publish markers, and deletions of outdated ones, if they have subscribers."""
        watched, dragged = self._drawn.get_subscription_count() > 0, self._goals.watched
        if not (watched or dragged):
            return
        controller, sketcher = self._controller, self._sketcher
        root, tasks = (controller.robot.root, controller.stack.tasks) if controller else ('', {})
        sketches = self._sketches(sketcher, controller) if sketcher and controller else {}
        if watched:
            self._drawn.publish(self._markers.message(self._node.get_clock().now().to_msg(), root,
                                                      sketches))
        if dragged:
            self._goals.show(root, tasks, sketches)

    def _poses(self, names: Collection[str]) -> Mapping[str, FramePose]:
        """Return the poses of the frames of some tasks."""
        if self._sketcher is None or self._controller is None:
            return {}
        try:
            return self._sketcher.poses(self._controller, names, self._place())
        except RobotError:
            return {}

    def _sketches(self, sketcher: Sketcher, controller: SharedController
                  ) -> Mapping[str, list[Sketch]]:
        """Return the sketches."""
        try:
            return sketcher.sketch(controller, self._place())
        except RobotError:
            # Invalid joint states, for example; the status has the reason.
            return {}

    def _place(self) -> Configuration | None:
        """Return the configuration of a stopped robot, which may be moved by other means."""
        loop = self._loop
        return loop.measurements.place() if loop and loop.stop_reason else None

    def _log_undrawn(self, task: str, reason: str) -> None:
        """Log the reason for which a task cannot be drawn, once."""
        if self._faults.get(task) != reason:
            self._faults[task] = reason
            self._log.warning(f'task {task} is not drawn: {reason}')

    def _publish_status(self, publisher: Publisher) -> None:
        """Publish the status, which takes as long as some cycles, if it has subscribers."""
        if publisher.get_subscription_count():
            message = self._message()
            self._wait()
            publisher.publish(message)

    def _wait(self) -> None:
        """Wait for a gap between two cycles."""
        if self._loop is not None:
            self._loop.gaps.wait()

    def _message(self) -> DiagnosticArray:
        """Return the status, built in parts between the cycles."""
        self._wait()
        loop, records = self._loop, self._records()
        self._wait()
        return self._make_status(loop.stop_reason if loop else self.reason,
                                 loop.report if loop else None, self._controller, records)

    def _make_status(self, reason: str, report: Report | None, controller: SharedController | None,
                     records: Mapping[str, GoalRecord]) -> DiagnosticArray:
        """Return the status with a reason for zeros, and reports of the tasks."""
        loop = self._loop
        if loop is not None:
            loop.figures.lead = loop.commands.output.lead
            loop.figures.not_following = loop.stops.joint
        figures = (loop.figures if loop else Figures(math.inf)).as_text()
        self._wait()
        return diagnostics(self._node.get_clock().now().to_msg(), self._name, reason, report,
                           controller, records, figures, self._wait, self._hints.of)

    def _reports(self) -> Sequence[TaskReport]:
        """Return the reports of all tasks."""
        loop = self._loop
        return task_reports(loop.stop_reason if loop else self.reason,
                            loop.report if loop else None, self._controller)

    def _records(self) -> Mapping[str, GoalRecord]:
        """Return the goal records of all tasks, with the numbers of subscribers."""
        if self._topics is None:
            return {}
        self._topics.count_listeners()
        return self._topics.records

    def _on_status(self) -> None:
        """Publish the status; after a new goal wait for the next cycle, which reports on it."""
        now = boot_time()
        self._waits_since = min(self._waits_since, now)
        if self._is_current() or now - self._waits_since > LONGEST_STATUS_WAIT:
            self.publish()

    def _is_current(self) -> bool:
        """Return whether the last report includes all received goals."""
        loop, topics = self._loop, self._topics
        return loop is None or topics is None or bool(loop.stop_reason) \
            or loop.reported > topics.changed

    def _on_flush(self) -> None:
        """Write the log, and a status that has waited for a cycle."""
        self._log.flush()
        if math.isfinite(self._waits_since):
            self._on_status()

    def _on_diagnostics(self) -> None:
        """Publish the status on /diagnostics."""
        self._publish_status(self._diagnostics)

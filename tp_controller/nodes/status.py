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

"""The report of a cycle as messages: diagnostics and markers."""

from collections.abc import Mapping, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point
import numpy as np
from numpy.typing import ArrayLike
from tp_controller.control.controller import Controller
from tp_controller.control.report import Report, stopped_reports, TaskReport
from tp_controller.nodes.task_topics import GoalRecord
from visualization_msgs.msg import Marker, MarkerArray

ARROW = (0.08, 0.008)
LEVELS = {**dict.fromkeys(('reached', 'satisfied', 'moving', 'disabled'), DiagnosticStatus.OK),
          'limited': DiagnosticStatus.WARN, 'stopped': DiagnosticStatus.WARN,
          'failed': DiagnosticStatus.ERROR}
COLOURS = ((0.9, 0.1, 0.1), (0.1, 0.7, 0.1), (0.2, 0.3, 0.95))


def diagnostics(stamp: Time, node_name: str, stop_reason: str, report: Report | None,
                controller: Controller | None, records: Mapping[str, GoalRecord],
                figures: Mapping[str, str]) -> DiagnosticArray:
    """
    Return the status of the node and of every task, with the same keys at all times.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Time of the message.
    node_name : str
        Start of the name of each entry.
    stop_reason : str
        Why zeros are commanded; empty while the tasks are carried out.
    report : Report or None
        Of the last cycle.
    controller : Controller or None
        Whose tasks are told where no report is about them.
    records : dict
        {task: GoalRecord}
    figures : dict
        {key: value} of the loop.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray

    """
    running = report is not None and not stop_reason
    head = DiagnosticStatus(
        name=node_name, hardware_id=node_name,
        level=DiagnosticStatus.WARN if stop_reason else DiagnosticStatus.OK,
        message=stop_reason or 'running',
        values=[_value('scale', f'{report.scale:.4f}' if report and running else 'nan'),
                _value('limiting', report.limiting if report and running else ''),
                *(_value(key, value) for key, value in figures.items())])
    array = DiagnosticArray(status=[head])
    array.header.stamp = stamp
    array.status.extend(_task_status(node_name, task, records[task.name])
                        for task in task_reports(stop_reason, report, controller)
                        if task.name in records)
    return array


def task_reports(stop_reason: str, report: Report | None,
                 controller: Controller | None) -> Sequence[TaskReport]:
    """Return what is known about every task; see `diagnostics`."""
    if report is not None and not stop_reason:
        return report.tasks
    return stopped_reports(controller.stack) if controller else ()


def _goal_values(record: GoalRecord) -> list[KeyValue]:
    """Return what came in for a task."""
    return [_value('goals accepted', record.accepted), _value('goals refused', record.refused),
            _value('last refusal', record.refusal), _value('goal warning', record.warning)]


def _task_status(node_name: str, task: TaskReport, record: GoalRecord) -> DiagnosticStatus:
    """Return the status of one task."""
    values = [_value('type', task.type_name), _value('level', task.level or 'disabled'),
              _value('status', task.status)]
    for error, unit, tolerance in task.errors:
        values.append(_value(f'error [{unit}]', f'{error:.6g}'))
        values.append(_value(f'tolerance [{unit}]', f'{tolerance:.6g}'))
    values.append(_value('wanted speed', f'{task.wanted_speed:.6g}'))
    values.append(_value('achieved speed', f'{task.achieved_speed:.6g}'))
    values.append(_value('reason', task.reason))
    values.append(_value('hint', task.hint))
    values.extend(_goal_values(record))
    message = task.status if not task.reason else f'{task.status}: {task.reason}'
    return DiagnosticStatus(name=f'{node_name}: {task.name}', hardware_id=node_name,
                            level=LEVELS[task.status], message=message, values=values)


def _value(key: str, value: object) -> KeyValue:
    """Return one entry of a diagnostic status."""
    return KeyValue(key=key, value=str(value))


def markers(stamp: Time, root: str, controller: Controller) -> MarkerArray:
    """
    Return the goals of the tasks that are about a frame, and lines to them.

    Parameters
    ----------
    stamp : builtin_interfaces.msg.Time
        Time of the message.
    root : str
        Root frame of the robot.
    controller : Controller
        Whose goals are shown.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
        Positions as a line to the goal, orientations as three axes (x red, y green, z blue).

    """
    array = MarkerArray()
    for name, T_goal, T_frame in controller.goal_poses():
        line = _marker(stamp, root, name, 0, Marker.LINE_LIST)
        line.scale.x = ARROW[1] / 2.0
        line.color.a = line.color.r = line.color.g = 1.0
        line.points = [_to_point(T_frame[:3, 3]), _to_point(T_goal[:3, 3])]
        array.markers.append(line)
        for axis, colour in enumerate(COLOURS):
            arrow = _marker(stamp, root, name, axis + 1, Marker.LINE_LIST)
            arrow.scale.x = ARROW[1]
            arrow.color.a = 1.0
            arrow.color.r, arrow.color.g, arrow.color.b = colour
            tip = T_goal[:3, 3] + ARROW[0] * T_goal[:3, axis]
            arrow.points = [_to_point(T_goal[:3, 3]), _to_point(tip)]
            array.markers.append(arrow)
    return array


def _marker(stamp: Time, root: str, name: str, number: int, kind: int) -> Marker:
    """Return a marker in the root frame that disappears when it is not renewed."""
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD)
    marker.header.frame_id = root
    marker.header.stamp = stamp
    marker.pose.orientation.w = 1.0
    marker.lifetime.sec = 1
    return marker


def _to_point(vector: ArrayLike) -> Point:
    """Return a point message."""
    x, y, z = np.asarray(vector, float).tolist()
    return Point(x=x, y=y, z=z)

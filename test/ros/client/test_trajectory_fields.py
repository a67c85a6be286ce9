# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Trajectories that a client sends are those that a controller reads."""

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped
import pytest
from robots import panda, PANDA_TOOL
from sensor_msgs.msg import JointState
from tp_controller import GoalError, Stack
from tp_controller.ros.client.trajectory_fields import make_trajectory
from tp_controller.ros.interface.trajectory_messages import trajectories_of
from trajectory_msgs.msg import JointTrajectory, MultiDOFJointTrajectory

STACK = f"""
- tool: {{type: pose, frame: {PANDA_TOOL}}}
- place: {{type: position, frame: {PANDA_TOOL}}}
- turn: {{type: orientation, frame: {PANDA_TOOL}}}
- posture: {{type: posture}}
"""
POINT, TURN = [0.1, 0.2, 0.3], [0.0, 0.6, 0.0, 0.8]
# {task: type of its goals, fields, goal, and a speed of 0.25 as it arrives}
SENT = {
    'tool': (PoseStamped, {'xyz': POINT, 'quat_xyzw': TURN}, (*POINT, *TURN), 0.25),
    'place': (PointStamped, {'xyz': POINT}, tuple(POINT), 0.25),
    'turn': (QuaternionStamped, {'quat_xyzw': TURN}, tuple(TURN), 0.25),
    'posture': (JointState, {'joints': {'panda_joint1': 0.5}}, {'panda_joint1': 0.5}, 0.25)}


def made(name, values, times=None, speed=0.0):
    """Return the message of a task."""
    trajectory = JointTrajectory if name == 'posture' else MultiDOFJointTrajectory
    return make_trajectory(name, {'goal': SENT[name][0], 'trajectory': trajectory}, values, times,
                           speed)


@pytest.mark.parametrize('name', SENT)
def test_what_is_sent_is_what_is_read(name):
    _, fields, goal, speed = SENT[name]
    task = Stack.from_yaml(STACK, panda()).tasks[name]

    def read(message):
        entry, = (each for each in trajectories_of(task) if each.kind is type(message))
        return entry.timed(message, task.goal_type)

    found = read(made(name, [fields, fields], [0.5, 1.75]))
    assert found.values == [goal, goal]
    assert (found.times, found.speed) == ([0.5, 1.75], None)
    found = read(made(name, [fields, fields], speed=0.25))
    assert (found.values, found.times, found.speed) == ([goal, goal], None, speed)


@pytest.mark.parametrize('name, values, told', [
    ('place', [{'xyz': POINT, 'quat_xyzw': TURN}], 'needs xyz'),
    ('tool', [{'xyz': POINT}], 'needs xyz and quat_xyzw'),
    ('posture', [{'joints': {'a': 1.0}}, {'joints': {'b': 1.0}}], 'the same joints'),
    ('posture', [{'velocities': {'a': 1.0}}], 'positions alone')])
def test_goals_of_another_kind_are_refused(name, values, told):
    with pytest.raises(GoalError, match=told):
        made(name, values, speed=1.0)

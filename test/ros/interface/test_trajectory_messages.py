# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Trajectories arrive as they are meant, over each message, and bad ones change nothing."""

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, Twist, Vector3
from harness import Arm, Status
from nav_msgs.msg import Path
import numpy as np
import pytest
from robots import panda, PANDA_DH, PANDA_READY, PANDA_TOOL
from std_srvs.srv import Trigger
from tp_controller import GoalError, Stack
from tp_controller.ros.interface.trajectory_messages import trajectories_of
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

STACK = f"""
- tool: {{type: pose, frame: {PANDA_TOOL}}}
- place: {{type: position, frame: {PANDA_TOOL}}}
- turn: {{type: orientation, frame: {PANDA_TOOL}}}
- carry: {{type: twist, frame: {PANDA_TOOL}}}
- posture: {{type: posture}}
"""
POSES = ((0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0), (0.4, 0.2, 0.5, 0.6, 0.8, 0.0, 0.0))


def stamp(seconds, kind=Time):
    """Return a time or duration."""
    return kind(sec=int(seconds), nanosec=round(1e9 * (seconds % 1.0)))


def frames(times=(1.5, 2.0), start=0.0, twists=((), ())):
    """Return the poses as a MultiDOFJointTrajectory."""
    message = MultiDOFJointTrajectory()
    message.header.stamp = stamp(start)
    for pose, time, twist in zip(POSES, times, twists):
        point = MultiDOFJointTrajectoryPoint(time_from_start=stamp(time, Duration))
        point.transforms = [Transform(
            translation=Vector3(**dict(zip('xyz', pose[:3]))),
            rotation=Quaternion(**dict(zip('xyzw', pose[3:]))))]
        point.velocities = [Twist(linear=Vector3(x=linear), angular=Vector3(z=angular))
                            for linear, angular in twist]
        message.points.append(point)
    return message


def path(times=(1.5, 2.0), start=0.0):
    """Return the poses as a Path."""
    message = Path()
    message.header.stamp = stamp(start)
    for pose, time in zip(POSES, times):
        stamped = PoseStamped()
        stamped.header.stamp = stamp(time)
        for part, names, values in ((stamped.pose.position, 'xyz', pose[:3]),
                                    (stamped.pose.orientation, 'xyzw', pose[3:])):
            for name, value in zip(names, values):
                setattr(part, name, value)
        message.poses.append(stamped)
    return message


def joints(times=(1.5,), velocities=(), names=('panda_joint4',), positions=(-2.0,)):
    """Return a JointTrajectory."""
    return JointTrajectory(joint_names=list(names), points=[
        JointTrajectoryPoint(positions=list(positions), velocities=list(velocities),
                             time_from_start=stamp(time, Duration)) for time in times])


def timed(message, task='tool'):
    """Return the content of a message for a task."""
    stack = Stack.from_yaml(STACK, panda())
    entry, = (entry for entry in trajectories_of(stack.tasks[task])
              if entry.kind is type(message))
    return entry.timed(message, stack.tasks[task].goal_type)


def test_tasks_take_the_messages_of_their_goals():
    stack = Stack.from_yaml(STACK, panda())
    topics = {name: {entry.topic: entry.kind for entry in trajectories_of(task)}
              for name, task in stack.tasks.items()}
    framed = {'trajectory': MultiDOFJointTrajectory, 'path': Path}
    assert topics == {'tool': framed, 'place': framed, 'turn': framed, 'carry': {},
                      'posture': {'trajectory': JointTrajectory}}


@pytest.mark.parametrize('message', [frames, path])
def test_poses_have_values_and_times_from_the_start(message):
    found = timed(message())
    assert found.values == list(POSES)
    assert found.due(100.0, 5000.0) == pytest.approx([101.5, 102.0])
    assert timed(message(), 'place').values == [pose[:3] for pose in POSES]
    assert timed(message(), 'turn').values == [pose[3:] for pose in POSES]


def test_stamps_are_of_the_clock_of_the_node():
    assert timed(frames(start=5000.5)).due(100.0, 5000.0) == pytest.approx([102.0, 102.5])
    found = timed(path(times=(5000.5, 5001.0), start=4000.0))
    assert found.due(100.0, 5000.0) == pytest.approx([100.5, 101.0])
    with pytest.raises(GoalError, match='stamps are of another clock'):
        timed(frames(start=1.7e9)).due(100.0, 50.0)


def test_joints_have_names_and_times():
    found = timed(joints(), 'posture')
    assert (found.values, found.times, found.speed) == ([{'panda_joint4': -2.0}], [1.5], None)
    assert timed(joints(names=(), positions=PANDA_READY), 'posture').values == [
        list(PANDA_READY)]


def test_velocities_are_speeds_only_without_times():
    twists = (((0.1, 0.0),), ((0.2, 0.5),))
    assert timed(frames(twists=twists)).speed is None
    found = timed(frames((0.0, 0.0), twists=twists))
    assert (found.times, found.speed) == (None, {'m': 0.2, 'rad': 0.5})
    assert timed(frames((0.0, 0.0), twists=(((0.1, 0.0),), ()))).speed == 0.1
    assert timed(joints((0.0,), (-0.3,)), 'posture').speed == 0.3


@pytest.mark.parametrize('message, task, told', [
    (path(times=(0.0, 0.0)), 'tool', 'need stamps'),
    (frames((0.0, 0.0)), 'tool', 'the points need times from the start, or velocities'),
    (MultiDOFJointTrajectory(points=[MultiDOFJointTrajectoryPoint()]), 'tool',
     'point 1 needs one transform'),
    (joints(positions=(1.0, 2.0)), 'posture', 'point 1 has 2 positions for 1 joints'),
    (joints(names=('a', 'a'), positions=(1.0, 2.0)), 'posture', 'named twice: a, a')])
def test_faulty_messages_are_refused(message, task, told):
    with pytest.raises(GoalError, match=told):
        timed(message, task)


def test_path_in_two_frames_is_refused():
    message = path()
    message.poses[1].header.frame_id = 'panda_link4'
    with pytest.raises(GoalError, match='not in panda_link4'):
        timed(message)


class Rig:
    """A controller of an arm that stays where it is."""

    def __init__(self, harness):
        self.harness = harness
        self.controller = harness.controller(robot=str(PANDA_DH), stack=STACK, follow_window=0.0,
                                             state_timeout=5.0, watchdog_timeout=5.0)
        self.status = Status(harness)
        self.arm = Arm(harness, PANDA_READY, panda().joint_names)
        self.spin_until(lambda: self.status.head == 'running')

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def send(self, task, topic, message):
        """Send a message, and return the reason for which it was refused."""
        def count(which):
            return int(self.status.task(task)[f'goals {which}'] or -1)

        publisher = self.harness.publisher(type(message), f'/tp_controller/{task}/{topic}')
        self.spin_until(lambda: count('accepted') >= 0)
        before = count('accepted'), count('refused')
        publisher.publish(message)
        self.spin_until(lambda: (count('accepted'), count('refused')) != before)
        return '' if count('refused') == before[1] else self.status.task(task)['last refusal']


def test_trajectories_run_in_the_node_until_they_are_cancelled(harness):
    rig = Rig(harness)
    for task, topic, message in (('tool', 'trajectory', frames((50.0, 60.0))),
                                 ('place', 'path', path((50.0, 60.0))),
                                 ('turn', 'trajectory', frames((0.0, 0.0), twists=(
                                     ((0.0, 0.01),), ()))),
                                 ('posture', 'trajectory', joints((50.0,)))):
        assert rig.send(task, topic, message) == ''
        rig.spin_until(lambda task=task: float(rig.status.task(task)['progress'] or 0.0) > 0.0)
        assert float(rig.status.task(task)['progress']) < 1.0
        assert rig.status.task(task)['status'] != 'reached'
        reply = harness.call(Trigger, f'/tp_controller/{task}/trajectory/cancel',
                             meanwhile=rig.arm.publish)
        assert reply.success
        rig.spin_until(lambda task=task: rig.status.task(task)['progress'] == '')
        assert not harness.call(Trigger, f'/tp_controller/{task}/trajectory/cancel',
                                meanwhile=rig.arm.publish).success


def test_refused_trajectory_leaves_the_goal(harness):
    rig = Rig(harness)
    task = rig.controller._robot.controller.stack.tasks['tool']
    goal = np.array(task.goal)
    assert 'times must increase' in rig.send('tool', 'trajectory', frames((2.0, 1.0)))
    assert 'is empty' in rig.send('tool', 'path', Path())
    assert 'ended' in rig.send('tool', 'trajectory', frames(
        start=rig.controller.get_clock().now().nanoseconds * 1e-9 - 10.0))
    np.testing.assert_array_equal(task.goal, goal)

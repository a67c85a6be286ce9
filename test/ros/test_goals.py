# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals of every kind arrive as they are meant, and bad ones change nothing."""

import math
import sys
from types import ModuleType, SimpleNamespace

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped, TwistStamped
from harness import Arm, JOINTS, Status
import numpy as np
import pytest
from rclpy.parameter import Parameter
from robots import panda, PANDA_DH, PANDA_READY, PANDA_TOOL
from sensor_msgs.msg import JointState
from tp_controller.model.spatial import quaternion_from_rotation, rotation_from_rpy
from tp_controller.ros.client.goal_fields import make_message

STACK = f"""
- place: {{type: position, frame: {PANDA_TOOL}, gain: 2.0}}
- orientation: {{type: orientation, frame: {PANDA_TOOL}, gain: 3.0}}
- tool: {{type: pose, frame: {PANDA_TOOL}, gain: [1, 2, 3, 4, 5, 6]}}
- seen: {{type: position, frame: {PANDA_TOOL}, reference: panda_link4}}
- folded: {{type: pose, frame: {PANDA_TOOL}, approach: posture}}
- joints: {{type: joint, joints: [panda_joint6, panda_joint2], timeout: 0.05}}
- swing: {{type: joint_velocity, joints: [panda_joint7, panda_joint1], timeout: 0.05}}
- carry: {{type: twist, frame: {PANDA_TOOL}, timeout: 0.05}}
"""
TASKS = ('place', 'orientation', 'tool', 'seen', 'folded', 'joints', 'swing', 'carry')
ROTATION = rotation_from_rpy(0.3, -0.2, 0.5)
QUAT_XYZW = quaternion_from_rotation(ROTATION).tolist()


class Rig:
    """A controller of the Panda at rest, of whose tasks only one is enabled."""

    def __init__(self, harness, task, frame_of_goals=''):
        self.harness, self.task, self.frame = harness, task, frame_of_goals
        self.controller = harness.controller(robot=str(PANDA_DH), stack=STACK)
        self.commands, self.status = harness.commands(), Status(harness)
        self.arm = Arm(harness, PANDA_READY, panda().joint_names)
        for other in TASKS:
            if other != task:
                assert harness.enable(other, False).success
        self.spin_until(lambda: self.status.head == 'running')
        self.state = panda().state(PANDA_READY)

    def spin_until(self, condition):
        """Spin, while the arm says where it is."""
        self.harness.spin_until(condition, meanwhile=self.arm.publish)

    def count(self, what):
        """Return how many goals were accepted or refused."""
        return int(self.status.task(self.task).get(f'goals {what}', -1))

    def send(self, message, frame='', topic='goal'):
        """Send a message and wait for the answer; return why it was refused, or None."""
        if hasattr(message.header, 'frame_id'):
            message.header.frame_id = frame
        publisher = self.harness.publisher(type(message),
                                           f'/tp_controller/{self.task}/{topic}')
        self.spin_until(lambda: self.count('accepted') >= 0)
        before = self.count('accepted'), self.count('refused')
        publisher.publish(message)
        self.spin_until(lambda: (self.count('accepted'), self.count('refused')) != before)
        if self.count('refused') == before[1]:
            return None
        assert self.count('accepted') == before[0]
        return self.status.task(self.task)['last refusal']

    def error(self):
        """Return the error that the controller has worked out."""
        return self.controller._robot.controller.stack.tasks[self.task].error(self.state)


# Every kind -----------------------------------------------------------------------------------

def test_a_point_goes_to_the_position_task(any_harness):
    rig = Rig(any_harness, 'place')
    goal = rig.state.position(PANDA_TOOL) + (0.01, -0.02, 0.03)
    assert rig.send(make_message('', PointStamped, {'xyz': goal})) is None
    np.testing.assert_allclose(rig.error(), (0.01, -0.02, 0.03), atol=1e-12)
    rig.spin_until(lambda: rig.status.knows('place', 'error [m]'))
    assert float(rig.status.task('place')['error [m]']) == pytest.approx(0.0374166, abs=1e-6)


def test_a_quaternion_goes_to_the_orientation_task(harness):
    rig = Rig(harness, 'orientation')
    quat_xyzw = quaternion_from_rotation(
        rotation_from_rpy(0.0, 0.0, 0.1).dot(rig.state.rotation(PANDA_TOOL)))
    assert rig.send(make_message('', QuaternionStamped, {'quat_xyzw': quat_xyzw})) is None
    np.testing.assert_allclose(rig.error(), (0.0, 0.0, 0.1), atol=1e-9)


def test_a_pose_goes_to_the_pose_task(harness):
    rig = Rig(harness, 'tool')
    xyz = rig.state.position(PANDA_TOOL) + (0.01, -0.02, 0.03)
    quat_xyzw = quaternion_from_rotation(
        rotation_from_rpy(0.1, 0.0, 0.0).dot(rig.state.rotation(PANDA_TOOL)))
    assert rig.send(make_message('', PoseStamped, {'xyz': xyz, 'quat_xyzw': quat_xyzw})) is None
    np.testing.assert_allclose(rig.error(), (0.01, -0.02, 0.03, 0.1, 0.0, 0.0), atol=1e-9)


def test_posture_leads_to_a_goal_where_the_task_says_so(harness):
    rig = Rig(harness, 'folded')
    posture = np.array(PANDA_READY) + (0.3, 0.2, -0.4, 0.5, 0.2, -0.3, 0.4)
    T = panda().state(posture).pose(PANDA_TOOL)
    assert rig.send(make_message('', PoseStamped, {
        'xyz': T[:3, 3], 'quat_xyzw': quaternion_from_rotation(T[:3, :3])})) is None
    lead = rig.controller._robot.controller._tasks._leads
    found = next(iter(lead.values())).posture
    np.testing.assert_allclose(panda().state(found).pose(PANDA_TOOL), T, atol=1e-6)
    # All joints move there together.
    way, commands = found - PANDA_READY, rig.commands
    rig.spin_until(lambda: np.linalg.norm(commands[-1]) > 0.05)
    velocity = np.array(commands[-1])
    assert velocity @ way == pytest.approx(np.linalg.norm(velocity) * np.linalg.norm(way))


def test_joint_positions_go_to_the_joint_task_by_name(harness):
    rig = Rig(harness, 'joints')
    message = JointState(name=['panda_joint2', 'panda_joint6'], position=[-0.7, 1.6])
    assert rig.send(message) is None
    np.testing.assert_allclose(rig.error(), (1.6 - 1.571, -0.7 + 0.785), atol=1e-12)
    # One alone leaves the other its goal; without names the order is the task's.
    assert rig.send(JointState(name=['panda_joint6'], position=[1.5])) is None
    np.testing.assert_allclose(rig.error(), (1.5 - 1.571, -0.7 + 0.785), atol=1e-12)
    assert rig.send(JointState(position=[1.571, -0.785])) is None
    np.testing.assert_allclose(rig.error(), (0.0, 0.0), atol=1e-12)


def test_joint_velocities_go_to_the_joint_velocity_task_and_time_out(any_harness):
    rig = Rig(any_harness, 'swing')
    message = JointState(name=['panda_joint1', 'panda_joint7'], velocity=[0.25, -0.5])
    publisher = any_harness.publisher(JointState, '/tp_controller/swing/goal')
    rig.spin_until(lambda: publisher.publish(message) or any(rig.commands[-1]))
    np.testing.assert_allclose(rig.commands[-1], (0.25, 0, 0, 0, 0, 0, -0.5), atol=1e-12)
    rig.spin_until(lambda: not any(rig.commands[-1]))
    rig.spin_until(lambda: rig.status.head == 'running')


def test_a_twist_moves_the_frame_and_times_out(any_harness):
    rig = Rig(any_harness, 'carry')
    message = make_message('', TwistStamped, {'linear': (0.01, 0.02, -0.03),
                                              'angular': (0.04, -0.05, 0.06)})
    publisher = any_harness.publisher(TwistStamped, '/tp_controller/carry/twist')
    rig.spin_until(lambda: publisher.publish(message) or any(rig.commands[-1]))
    np.testing.assert_allclose(rig.state.jacobian(PANDA_TOOL).dot(rig.commands[-1]),
                               (0.01, 0.02, -0.03, 0.04, -0.05, 0.06), atol=1e-9)
    rig.spin_until(lambda: not any(rig.commands[-1]))


def test_a_feed_forward_twist_adds_to_the_goal_until_it_times_out(harness):
    rig = Rig(harness, 'place')
    message = make_message('', TwistStamped, {'linear': (0.0, 0.1, 0.0),
                                              'angular': (5.0, 5.0, 5.0)})
    publisher = harness.publisher(TwistStamped, '/tp_controller/place/twist')
    rig.spin_until(lambda: publisher.publish(message) or any(rig.commands[-1]))
    np.testing.assert_allclose(rig.state.jacobian(PANDA_TOOL)[:3].dot(rig.commands[-1]),
                               (0.0, 0.1, 0.0), atol=1e-9)
    rig.spin_until(lambda: not any(rig.commands[-1]))


def test_old_and_future_stamps_do_not_count_for_the_timeout(harness):
    rig = Rig(harness, 'swing')
    publisher = harness.publisher(JointState, '/tp_controller/swing/goal')
    for seconds in (1, 2**31 - 1):
        message = JointState(name=['panda_joint1'], velocity=[0.25])
        message.header.stamp.sec = seconds
        rig.spin_until(lambda message=message: publisher.publish(message) or any(
            rig.commands[-1]))
        rig.spin_until(lambda: not any(rig.commands[-1]))


def test_joint_goals_may_carry_a_feed_forward_velocity(harness):
    rig = Rig(harness, 'joints')
    message = JointState(name=['panda_joint2'], position=[-0.785], velocity=[0.125])
    publisher = harness.publisher(JointState, '/tp_controller/joints/goal')
    rig.spin_until(lambda: publisher.publish(message) or any(rig.commands[-1]))
    np.testing.assert_allclose(rig.commands[-1], (0, 0.125, 0, 0, 0, 0, 0), atol=1e-12)
    rig.spin_until(lambda: not any(rig.commands[-1]))


# Frames ---------------------------------------------------------------------------------------

@pytest.mark.parametrize('frame', ['', 'panda_link0'])
def test_a_goal_without_a_frame_or_in_the_root_is_in_the_root(harness, frame):
    rig = Rig(harness, 'place')
    assert rig.send(make_message('', PointStamped, {'xyz': (0.5, 0.1, 0.4)}), frame) is None
    np.testing.assert_allclose(rig.error(), (0.5, 0.1, 0.4) - rig.state.position(PANDA_TOOL),
                               atol=1e-12)


def test_a_goal_without_a_frame_is_in_the_reference_of_the_task(harness):
    rig = Rig(harness, 'seen')
    R, p = rig.state.rotation('panda_link4'), rig.state.position('panda_link4')
    wanted = R.T.dot(rig.state.position(PANDA_TOOL) - p) + (0.01, 0.02, 0.03)
    for frame in ('', 'panda_link4'):
        assert rig.send(make_message('', PointStamped, {'xyz': wanted}), frame) is None
        np.testing.assert_allclose(rig.error(), (0.01, 0.02, 0.03), atol=1e-9)
    assert rig.send(make_message('', PointStamped, {'xyz': R.dot(wanted) + p}),
                    'panda_link0') is None
    np.testing.assert_allclose(rig.error(), (0.01, 0.02, 0.03), atol=1e-9)


def test_a_pose_in_a_frame_of_the_robot_is_where_that_frame_is_now(harness):
    rig = Rig(harness, 'tool')
    message = make_message('', PoseStamped, {'xyz': (0.0, 0.0, 0.05),
                                             'quat_xyzw': (0.0, 0.0, 0.0, 1.0)})
    assert rig.send(message, PANDA_TOOL) is None
    np.testing.assert_allclose(
        rig.error(), (*rig.state.rotation(PANDA_TOOL).dot((0.0, 0.0, 0.05)), 0.0, 0.0, 0.0),
        atol=1e-9)


def test_an_orientation_in_a_frame_of_the_robot_is_turned_with_it(harness):
    rig = Rig(harness, 'orientation')
    assert rig.send(make_message('', QuaternionStamped, {'quat_xyzw': (0.0, 0.0, 0.6, 0.8)}),
                    PANDA_TOOL) is None
    axis, angle = rig.state.rotation(PANDA_TOOL)[:, 2], 2.0 * np.arctan2(0.6, 0.8)
    np.testing.assert_allclose(rig.error(), angle * axis, atol=1e-9)


def test_a_twist_in_a_frame_of_the_robot_is_along_its_axes(harness):
    rig = Rig(harness, 'carry')
    message = make_message('', TwistStamped, {'linear': (0.0, 0.0, 0.02)})
    message.header.frame_id = 'panda_link4'
    publisher = harness.publisher(TwistStamped, '/tp_controller/carry/twist')
    rig.spin_until(lambda: publisher.publish(message) or any(rig.commands[-1]))
    np.testing.assert_allclose(rig.state.jacobian(PANDA_TOOL)[:3].dot(rig.commands[-1]),
                               0.02 * rig.state.rotation('panda_link4')[:, 2], atol=1e-9)


def test_a_goal_that_is_probably_a_mistake_is_taken_and_told_once(harness, log, monkeypatch):
    monkeypatch.setattr('tp_controller.ros.log.MESSAGE_REPEAT_SECONDS', 1000.0)
    rig = Rig(harness, 'place')
    far = make_message('', PointStamped, {'xyz': (400.0, 200.0, 500.0)})
    log()
    for _ in range(3):
        assert rig.send(far) is None
    told = 'the goal is 671 m from panda_link0, and out of reach'
    assert rig.status.task('place')['goal warning'].startswith(told)
    assert log().count(told) == 1
    assert rig.send(make_message('', PointStamped, {'xyz': (0.4, 0.1, 0.5)})) is None
    assert rig.status.task('place')['goal warning'] == ''


def test_a_goal_beyond_a_limit_that_is_set_meanwhile_is_refused(harness):
    rig = Rig(harness, 'place')
    near, far = (make_message('', PointStamped, {'xyz': (0.4, 0.1, height)})
                 for height in (0.5, 0.05))
    assert rig.send(far) is None
    limits = Parameter('workspace', value=[-1.0, 1.0, -1.0, 1.0, 0.1, math.inf])
    assert rig.controller.set_parameters([limits])[0].successful
    assert rig.send(far).startswith('the goal is outside the workspace: z = 0.05 m')
    assert rig.send(near) is None
    bad, = rig.controller.set_parameters([Parameter('workspace', value=[1.0, -1.0])])
    assert 'workspace must be six numbers' in bad.reason


def test_a_foreign_frame_is_refused_where_there_is_no_tf2(harness, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    rig = Rig(harness, 'place')
    told = rig.send(make_message('', PointStamped, {'xyz': (0.5, 0.1, 0.4)}), 'camera')
    assert told == ("frame 'camera' is not on the robot, and tf2_ros is not installed: use a "
                    "frame of the robot or its root 'panda_link0'")
    rig.spin_until(lambda: rig.status.head == 'running')


class FakeTf2:
    """Stands for the module tf2_ros, with one transform, from the root to the camera."""

    def __init__(self, monkeypatch, xyz=(0.1, 0.2, 0.3), quat_xyzw=QUAT_XYZW):
        self.listeners = []
        module = ModuleType('tf2_ros')
        module.TransformException = type('TransformException', (Exception,), {})
        module.TransformListener = lambda buffer, node: self.listeners.append(node)
        vector, turn = dict(zip('xyz', xyz)), dict(zip('xyzw', quat_xyzw))

        class Buffer:

            def __init__(self, node=None):
                assert node is not None

            def lookup_transform(self, target, source, time):
                if source != 'camera':
                    raise module.TransformException(f'"{source}" passed to lookupTransform '
                                                    'does not exist')
                # The latest that is known.
                assert target == 'panda_link0' and time.nanoseconds == 0
                return SimpleNamespace(transform=SimpleNamespace(
                    translation=SimpleNamespace(**vector), rotation=SimpleNamespace(**turn)))

        module.Buffer = Buffer
        monkeypatch.setitem(sys.modules, 'tf2_ros', module)


def test_a_foreign_frame_is_looked_up_in_tf2_where_there_is_one(harness, monkeypatch):
    tf2 = FakeTf2(monkeypatch)
    rig = Rig(harness, 'place')
    # Nobody pays for tf as long as nobody needs it.
    assert tf2.listeners == []
    for _ in range(2):
        assert rig.send(make_message('', PointStamped, {'xyz': (0.3, 0.0, 0.1)}),
                        'camera') is None
    assert tf2.listeners == [rig.controller]
    goal = ROTATION.dot((0.3, 0.0, 0.1)) + (0.1, 0.2, 0.3)
    np.testing.assert_allclose(rig.error(), goal - rig.state.position(PANDA_TOOL), atol=1e-9)


def test_a_frame_that_tf2_does_not_know_is_refused_with_its_reason(harness, monkeypatch):
    FakeTf2(monkeypatch)
    rig = Rig(harness, 'place')
    message = make_message('', PointStamped, {'xyz': (0.3, 0.0, 0.1)})
    assert rig.send(message, 'moon') == (
        "frame 'moon': \"moon\" passed to lookupTransform does not exist (listening to tf only "
        'from now on: send the goal again)')
    assert rig.send(message, 'moon') == (
        "frame 'moon': \"moon\" passed to lookupTransform does not exist")


@pytest.mark.parametrize('transform', [
    {'quat_xyzw': (0.0, 0.0, 0.0, 0.0)}, {'quat_xyzw': (0.0, 0.0, 0.0, float('nan'))},
    {'xyz': (0.0, float('nan'), 0.0)}, {'xyz': (1e300, 0.0, 0.0)}])
def test_a_transform_that_makes_no_sense_is_refused(harness, monkeypatch, transform):
    FakeTf2(monkeypatch, **transform)
    rig = Rig(harness, 'place')
    told = rig.send(make_message('', PointStamped, {'xyz': (0.3, 0.0, 0.1)}), 'camera')
    assert told.startswith("frame 'camera': ")
    assert np.isfinite(rig.commands).all()


def test_a_goal_in_another_frame_needs_joint_states_and_says_so(harness, log):
    harness.controller(robot=str(PANDA_DH), stack=STACK)
    message = make_message('', PointStamped, {'xyz': (0.0, 0.0, 0.1)})
    message.header.frame_id = PANDA_TOOL
    harness.publisher(PointStamped, '/tp_controller/place/goal').publish(message)
    harness.spin_until(lambda: 'goal for task place refused: a goal in another frame needs '
                       'joint positions' in log())


def test_a_goal_before_the_first_joint_state_counts(harness):
    harness.controller()
    commands, status = harness.commands(), Status(harness)
    harness.publisher(JointState, '/tp_controller/swing/goal').publish(
        JointState(name=['joint1'], position=[-0.5]))
    harness.spin_until(lambda: status.task('swing').get('goals accepted') == '1')
    arm = Arm(harness)
    harness.spin_until(lambda: commands and any(commands[-1]), meanwhile=arm.publish)
    np.testing.assert_allclose(commands[-1], (-0.5, -0.1, -0.55), atol=1e-12)


# Bad goals ------------------------------------------------------------------------------------

NAN, INF = float('nan'), float('inf')
BAD = [
    ('place', PointStamped, {'xyz': (0.4, NAN, 0.4)}, 'must be finite'),
    ('place', PointStamped, {'xyz': (INF, 0.0, 0.4)}, 'must be finite'),
    ('place', PointStamped, {'xyz': (1e300, 0.0, 0.4)}, 'at most 1e+06'),
    ('orientation', QuaternionStamped, {'quat_xyzw': (0.0, 0.0, 0.0, 0.0)}, 'has norm 1'),
    ('orientation', QuaternionStamped, {'quat_xyzw': (NAN, 0.0, 0.0, 1.0)}, 'must be finite'),
    ('tool', PoseStamped, {'xyz': (0.4, 0.0, 0.4), 'quat_xyzw': (0.0, 0.0, 0.0, 0.0)},
     'has norm 1'),
    ('tool', PoseStamped, {'xyz': (0.4, NAN, 0.4), 'quat_xyzw': (0.0, 0.0, 0.0, 1.0)},
     'must be finite'),
    ('carry', TwistStamped, {'linear': (0.1, NAN, 0.0)}, 'must be finite'),
    ('place', TwistStamped, {'angular': (0.1, INF, 0.0)}, 'must be finite'),
    ('joints', JointState, {'joints': {'panda_joint1': 0.1}}, "unknown joint 'panda_joint1'"),
    ('joints', JointState, {'joints': {'panda_joint6': NAN}}, 'must be finite'),
    ('joints', JointState, {'joints': {'panda_joint6': 9.0}}, 'outside its limits'),
    ('joints', JointState, {'joints': {'panda_joint6': 1.5}, 'velocities': {'panda_joint6': NAN}},
     'must be finite'),
    ('joints', JointState, {'velocities': {'joint': 1.0}}, "unknown joint 'joint'"),
    ('swing', JointState, {'velocities': {'panda_joint2': 1.0}}, "unknown joint 'panda_joint2'"),
    ('swing', JointState, {'joints': {'panda_joint1': 1.0}}, 'no goal or velocity for this task'),
]


@pytest.mark.parametrize('task, kind, fields, told', BAD)
def test_a_bad_goal_is_refused_and_the_old_one_kept(harness, log, task, kind, fields, told):
    rig = Rig(harness, task)
    goal = rig.controller._robot.controller.stack.tasks[task].goal.copy()
    topic = 'twist' if kind is TwistStamped else 'goal'
    refusal = rig.send(make_message(task, kind, fields), topic=topic)
    assert told in refusal
    harness.spin_until_logged(log, f'goal for task {task} refused: ', rig.arm.publish)
    np.testing.assert_array_equal(rig.controller._robot.controller.stack.tasks[task].goal, goal)
    rig.harness.spin_for_more(rig.commands, 3, rig.arm.publish)
    np.testing.assert_allclose(rig.commands[-1], 0.0, atol=1e-12)
    rig.spin_until(lambda: rig.status.head == 'running')


@pytest.mark.parametrize('message', [
    JointState(name=['panda_joint6', 'panda_joint2'], position=[1.5]),
    JointState(name=['panda_joint6', 'panda_joint6'], position=[1.5, 1.6]),
    JointState(position=[1.5]), JointState(),
    JointState(name=['panda_joint6'], position=[1.5], velocity=[1.0, 2.0])])
def test_a_joint_goal_of_the_wrong_size_is_refused(harness, message):
    rig = Rig(harness, 'joints')
    assert rig.send(message)
    np.testing.assert_allclose(rig.error(), (0.0, 0.0), atol=1e-12)


def test_a_stream_of_bad_goals_leaves_the_robot_on_its_way(any_harness):
    rig = Rig(any_harness, 'place')
    goal = rig.state.position(PANDA_TOOL) + (0.0, 0.05, 0.0)
    assert rig.send(make_message('', PointStamped, {'xyz': goal})) is None
    publisher = any_harness.publisher(PointStamped, '/tp_controller/place/goal')
    bad = make_message('', PointStamped, {'xyz': (NAN, 0.0, 0.0)})

    def both():
        rig.arm.publish()
        publisher.publish(bad)

    any_harness.spin_until(lambda: rig.count('refused') >= 5, meanwhile=both)
    assert rig.count('accepted') == 1
    # A machine without time for the node stops the robot for a moment.
    rig.spin_until(lambda: any(rig.commands[-1]))
    np.testing.assert_allclose(rig.state.jacobian(PANDA_TOOL)[:3].dot(rig.commands[-1]),
                               (0.0, 0.1, 0.0), atol=1e-9)


def test_a_goal_that_is_no_message_at_all_is_survived(any_harness):
    any_harness.controller()
    publisher = any_harness.publisher(JointState, '/tp_controller/swing/goal')
    for data in (b'', b'\x00\x01\x00\x00\xff', bytes(range(256))):
        publisher.publish(data)
    status = Status(any_harness)
    publisher.publish(JointState(name=list(JOINTS), position=[0.0, 0.0, 0.0]))
    any_harness.spin_until(lambda: status.task('swing').get('goals accepted') == '1')


def test_the_answer_to_a_goal_never_reports_about_the_one_before(any_harness):
    """Who waits for "reached" must not get what was true of the goal before."""
    any_harness.controller(stack='- swing: {type: joint, joints: joint1, target: [0.0]}',
                           rate=20.0, braking_gain=10.0, status_rate=1000.0)
    status, arm = Status(any_harness), Arm(any_harness)
    any_harness.spin_until(lambda: status.task('swing').get('status') == 'reached',
                           meanwhile=arm.publish)
    publisher = any_harness.publisher(JointState, '/tp_controller/swing/goal')
    for count in range(1, 11):
        publisher.publish(JointState(name=['joint1'], position=[count / 10.0]))
        any_harness.spin_until(
            lambda count=count: (status.task('swing')['goals accepted'] == str(count)
                                 and status.knows('swing', 'error [rad]')),
            meanwhile=arm.publish)
        assert float(status.task('swing')['error [rad]']) == pytest.approx(count / 10.0)
        assert status.task('swing')['status'] == 'moving'

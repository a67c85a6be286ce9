# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Mobile bases: odometry in, cmd_vel out, checked and limited in the same way as joints."""

from copy import deepcopy
import math
import sys
from types import ModuleType, SimpleNamespace

from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from harness import Arm, Status
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.time import Time
from robots import CONFIG
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tp_controller import Robot
from tp_controller.errors import RobotError, SettingsError
from tp_controller.model.spatial import inverse_pose
from tp_controller.ros.client.goal_fields import make_message
from tp_controller.ros.loop.base_topics import OdometryBuffer
from tp_controller.ros.simulator_node import SimulatorNode
from tp_controller.ros.watchdog_node import WatchdogNode

FILE = CONFIG / 'robots' / 'mobile_arm.urdf'
ROBOT = {'robot': str(FILE), 'base': 'differential'}
JOINTS = ('torso_lift', *(f'arm_{number}' for number in range(1, 8)))
START = '{torso_lift: 0.15, arm_1: 0.3, arm_2: 0.5, arm_4: 1.2, arm_6: -0.6, base_x: 2.0, ' \
    'base_yaw: 2.0}'
TOOL = '- tool: {type: pose, frame: tool, gain: 2.0}'
# Both parts move from the first cycle on, the base by its own axes whatever its orientation.
MOVING = """
- drive: {type: base_pose}
- swing: {type: joint, joints: arm_1, target: [1.0]}
"""
BOAT = '<robot name="boat"><link name="hull"/></robot>'


def twist(message):
    """Return a Twist as six numbers."""
    return [message.linear.x, message.linear.y, message.linear.z,
            message.angular.x, message.angular.y, message.angular.z]


def odometry(x=0.0, y=0.0, yaw=0.0, frame='odom', child='base_link', quat_xyzw=None):
    """Return odometry of a base on the ground."""
    message = Odometry(child_frame_id=child)
    message.header.frame_id = frame
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y = x, y
    turn.x, turn.y, turn.z, turn.w = quat_xyzw or (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    return message


class Standing:
    """A robot at rest; the test says when joint states and odometry are published."""

    def __init__(self, harness, **place):
        self.arm = Arm(harness, [0.0] * 8, JOINTS)
        self.odometry = odometry(**place)
        self._publisher = harness.publisher(Odometry, '/odom')

    def publish(self):
        """Publish where base and joints are."""
        self.publish_base()
        self.arm.publish()

    def publish_base(self):
        """Publish where the base is."""
        self._publisher.publish(self.odometry)


class Commands:
    """What was commanded, to the joints and to the base."""

    def __init__(self, harness, kind=TwistStamped):
        self.joints, self.messages = harness.commands(), harness.record(kind, '/cmd_vel')

    @property
    def base(self):
        """Return all twists so far."""
        return [twist(getattr(message, 'twist', message)) for message in self.messages]

    def moving(self):
        """Say whether both parts were told to move last."""
        return bool(self.joints and self.messages and any(self.joints[-1])
                    and any(self.base[-1]))

    def zero(self):
        """Say whether both parts were told to stand last."""
        return not any(self.joints[-1]) and not any(self.base[-1])


def start_moving(harness, place=None, goal=(1.0, 0.0), **parameters):
    """Return a controller that moves base and arm, its commands, its status and its robot."""
    node = harness.controller(**{**ROBOT, 'stack': MOVING, **parameters})
    commands, status = Commands(harness), Status(harness)
    standing = Standing(harness, **(place or {}))
    send = harness.publisher(PoseStamped, '/tp_controller/drive/goal')
    send.publish(make_message('drive', PoseStamped, {
        'xyz': (*goal, 0.0), 'quat_xyzw': (0.0, 0.0, 0.0, 1.0)}))
    harness.spin_until(commands.moving, 'motion', meanwhile=standing.publish)
    return node, commands, status, standing


# Closed loops

@pytest.mark.parametrize('base, rate', [('differential', 50.0), ('planar', 0.0)])
def test_tool_reaches_a_goal_that_the_base_has_to_drive_to(any_harness, base, rate):
    harness, robot = any_harness, Robot.from_file(FILE, base=base)
    options = {'robot': str(FILE), 'base': base}
    # Simulated time is faster than a busy machine, so joint states would be old by their stamps.
    # At rate 0 the timeout counts as the period, which bounds the gains.
    harness.controller(**options, stack=TOOL, use_sim_time=True, rate=rate, status_rate=100.0,
                       check_stamps=False, state_timeout=0.3 if rate else 0.1)
    # Faster, on a busy machine it would swing around its goal.
    harness.simulator(**options, speed=2.0, publish_clock=True, rate=50.0,
                      initial_positions=START)
    commands, status = Commands(harness), Status(harness)
    states, places = harness.record(JointState, '/joint_states'), harness.record(Odometry, '/odom')
    goals = harness.publisher(PoseStamped, '/tp_controller/tool/goal')
    harness.spin_until(lambda: status.head == 'running' and states and places)

    def pose(frame):
        buffer = OdometryBuffer(robot)
        point, turn = places[-1].pose.pose.position, places[-1].pose.pose.orientation
        buffer.put('', '', (point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w), 0.0)
        return robot.state(buffer.configuration(states[-1].position)).pose(frame)

    start = pose('tool')
    # As the base stands at first, 1.5 m forward and a little to the left.
    goal = start[:3, 3] + Rotation.from_euler('z', 2.0).apply([1.5, 0.2, 0.05])
    goals.publish(make_message('tool', PoseStamped, {
        'xyz': goal.tolist(),
        'quat_xyzw': Rotation.from_matrix(start[:3, :3]).as_quat().tolist()}))
    harness.spin_until(lambda: status.task('tool')['goals accepted'] == '1')
    harness.spin_until(lambda: status.task('tool')['status'] == 'reached')
    harness.spin_until(lambda: np.allclose(pose('tool')[:3, 3], goal, atol=3e-3))
    travelled = pose('base_link')[:2, 3] - [2.0, 0.0]
    assert np.linalg.norm(travelled) > 0.7
    twists = np.array(commands.base)
    assert np.abs(twists).max() <= 0.5 and np.abs(twists[:, 0]).max() > 0.3
    assert not np.delete(twists, [0, 5] if base == 'differential' else [0, 1, 5], axis=1).any()
    assert (np.abs(commands.joints) <= robot.velocity[robot.joint_columns]).all()


# Odometry

@pytest.fixture
def transforms(monkeypatch):
    """Return a list that grows by what is published as tf: the wheels have no tf2."""
    sent, module = [], ModuleType('tf2_ros')
    # A copy: the simulator fills the same message again.
    module.TransformBroadcaster = lambda node: SimpleNamespace(
        sendTransform=lambda transform: sent.append(deepcopy(transform)))
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    return sent


def test_the_simulator_publishes_its_odometry_as_tf_where_told(harness, transforms):
    harness.simulator(**ROBOT, publish_tf=True, initial_positions=START)
    places = harness.record(Odometry, '/odom')
    harness.spin_for_more(places)
    first, = (each for each in transforms if each.header.stamp == places[0].header.stamp)
    assert (first.header.frame_id, first.child_frame_id) == ('odom', 'base_link')
    shift, turn = first.transform.translation, first.transform.rotation
    assert (shift.x, shift.y, shift.z) == pytest.approx((2.0, 0.0, 0.0))
    assert (turn.x, turn.y, turn.z, turn.w) == pytest.approx((0.0, 0.0, math.sin(1), math.cos(1)))


@pytest.mark.parametrize('options', [{**ROBOT, 'publish_tf': False}, {'publish_tf': True}])
def test_the_simulator_publishes_no_tf_unless_told_and_about_a_base(harness, transforms, options):
    harness.simulator(**options)
    harness.spin_for_more(harness.record(JointState, '/joint_states'))
    assert not transforms


def test_tf_without_tf2_is_refused(harness, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    with pytest.raises(SettingsError, match='publish_tf needs tf2_ros'):
        harness.simulator(**ROBOT, publish_tf=True)


def test_odometry_becomes_velocities_in_the_axes_of_the_base(any_harness):
    # The base looks along y of the world, the goal is ahead of it.
    _, commands, *_ = start_moving(any_harness, {'x': 1.0, 'yaw': math.pi / 2}, (1.0, 0.2),
                                   base='planar', stack="""
- drive: {type: base_pose, axes: x y}
- swing: {type: joint, joints: arm_1, target: [1.0]}
""")
    np.testing.assert_allclose(commands.base[-1], [0.2, 0, 0, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(commands.joints[-1], [0, 1.0, 0, 0, 0, 0, 0, 0], atol=1e-9)


@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_stale_odometry_holds_base_and_joints(any_harness, rate):
    harness = any_harness
    _, commands, status, standing = start_moving(harness, rate=rate)
    harness.spin_until(lambda: status.head == 'no odometry' and commands.zero(),
                       meanwhile=standing.arm.publish)
    before = len(commands.base)
    harness.spin_until(lambda: len(commands.base) > before + 5, meanwhile=standing.arm.publish)
    assert not np.any(commands.base[before:])
    harness.spin_until(commands.moving, meanwhile=standing.publish)


def test_stale_joint_states_hold_the_base_too(harness):
    _, commands, status, standing = start_moving(harness)
    harness.spin_until(lambda: status.head.startswith('no joint states') and commands.zero(),
                       meanwhile=standing.publish_base)


def test_nothing_moves_before_the_first_odometry(harness):
    harness.controller(**ROBOT, stack=MOVING)
    commands, status, arm = Commands(harness), Status(harness), Arm(harness, [0.0] * 8, JOINTS)
    harness.spin_until(lambda: status.head == 'no odometry', meanwhile=arm.publish)
    harness.spin_for_more(commands.joints, 5, meanwhile=arm.publish)
    assert not np.any(commands.joints) and not np.any(commands.base)


@pytest.mark.parametrize('changes, told', [
    ({'frame': 'map'}, "its frame is 'map'; valid: odom (parameter world_frame)"),
    ({'child': 'hand'}, "its child frame is 'hand'; valid are frames fixed to the base: "
                        'base_link, laser'),
    ({'child': 'wheel'}, "its child frame is 'wheel'; valid are"),
    ({'x': math.nan}, 'its pose (a pose x, y, z, qx, qy, qz, qw) must be finite'),
    ({'y': 1e7}, 'its pose (a pose x, y, z, qx, qy, qz, qw) must be finite'),
    ({'quat_xyzw': (0.0, 0.0, 0.0, 0.0)}, 'its pose: a quaternion (x, y, z, w) has norm 1'),
    ({'quat_xyzw': (0.0, 0.0, math.inf, 1.0)}, 'its pose (a pose x, y, z, qx, qy, qz, qw) must'),
])
def test_odometry_that_makes_no_sense_is_ignored_with_a_warning(harness, log, changes, told):
    harness.controller(**ROBOT, stack=MOVING)
    commands, status, bad = Commands(harness), Status(harness), Standing(harness, **changes)
    harness.spin_until(lambda: status.head.startswith('no odometry (ignored: '),
                       meanwhile=bad.publish)
    harness.spin_for_more(commands.joints, 5, meanwhile=bad.publish)
    assert not np.any(commands.joints) and not np.any(commands.base)
    lines = [line for line in log().splitlines() if 'odometry ignored' in line]
    assert lines and told in lines[0]


def test_odometry_of_a_world_of_another_name_and_of_a_sensor_is_taken(harness):
    _, commands, status, standing = start_moving(
        harness, {'frame': 'map', 'child': 'laser', 'x': 0.26}, world_frame='map')
    # The laser is 0.26 m ahead, so the base is at the origin.
    harness.spin_until(lambda: status.task('drive')['error [m]'] == '1',
                       meanwhile=standing.publish)
    np.testing.assert_allclose(commands.base[-1], [0.5, 0, 0, 0, 0, 0], atol=1e-9)


def test_empty_frames_of_odometry_mean_the_root_and_the_base(harness):
    _, commands, *_ = start_moving(harness, {'frame': '', 'child': ''})
    assert commands.base[-1][0] == pytest.approx(0.5)


# The buffer

def test_buffer_finds_the_base_from_a_frame_that_is_fixed_to_it():
    robot = Robot.from_urdf("""
<robot name="rover"><link name="base"/><link name="mast"/><joint name="fix" type="fixed">
<parent link="base"/><child link="mast"/><origin xyz="0.3 0.1 0.5" rpy="0.2 -0.3 1.2"/></joint>
</robot>""", base='floating')
    buffer, T_base_mast = OdometryBuffer(robot), robot.fixed_to_base('mast')
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -0.7, 1.9]).as_matrix()
    T[:3, 3] = [1.0, -2.0, 3.0]
    mast = T @ T_base_mast
    placement = [*mast[:3, 3], *Rotation.from_matrix(mast[:3, :3]).as_quat()]
    assert buffer.put('odom', 'mast', placement, 0.0) == ''
    np.testing.assert_allclose(robot.state(buffer.configuration([])).pose('base'), T, atol=1e-12)
    # Its velocities are those of the mast: the way it moves in a short time, seen from itself.
    velocity, h = np.array([0.3, -0.2, 0.1, 0.4, 0.5, -0.6]), 1e-6
    moved = robot.state(robot.integrate(buffer.configuration([]), velocity, h)).pose('mast')
    D = inverse_pose(mast) @ moved
    expected = np.concatenate((D[:3, 3], Rotation.from_matrix(D[:3, :3]).as_rotvec())) / h
    np.testing.assert_allclose(buffer.twist(velocity), expected, atol=1e-5)


def test_faulty_odometry_leaves_what_was_heard_before_and_does_not_make_it_younger():
    buffer = OdometryBuffer(Robot.from_urdf(BOAT, base='planar'))
    assert buffer.missing(0.0, 10.0)
    assert buffer.put('odom', 'hull', [1.0, 2.0, 0.3, 0.0, 0.0, 0.0, 1.0], 5.0) == ''
    for frame, child, x in (('map', 'hull', 0.0), ('odom', 'keel', 0.0), ('', '', math.nan)):
        assert buffer.put(frame, child, [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 9.0)
    assert buffer.configuration([]).tolist() == [1.0, 2.0, 0.0]
    assert not buffer.missing(5.1, 0.1 + 1e-9) and buffer.missing(5.2, 0.1)


# Commands

def test_stop_commands_zeros_on_both_topics_until_start(harness):
    _, commands, status, standing = start_moving(harness)
    harness.trigger('stop')
    harness.spin_until(lambda: status.head.startswith('stopped') and commands.zero(),
                       meanwhile=standing.publish)
    before = len(commands.base)
    harness.spin_until(lambda: len(commands.base) > before + 10, meanwhile=standing.publish)
    assert not np.any(commands.base[before:])
    harness.start(standing.publish)
    harness.spin_until(commands.moving, meanwhile=standing.publish)


def test_last_command_of_a_node_that_ends_is_zero_on_both_topics(harness):
    node, commands, _, _ = start_moving(harness)
    before = len(commands.base)
    node.close('ended')
    harness.spin_until(lambda: len(commands.base) > before and commands.zero())


@pytest.mark.parametrize('stamped', [True, False])
def test_velocities_of_the_base_have_a_stamp_unless_told_otherwise(harness, stamped):
    kind = TwistStamped if stamped else Twist
    given = {} if stamped else {'cmd_vel_stamped': False}
    harness.controller(**ROBOT, stack=MOVING, **given)
    commands, standing = Commands(harness, kind), Standing(harness)
    send = harness.publisher(PoseStamped, '/tp_controller/drive/goal')
    send.publish(make_message('drive', PoseStamped, {
        'xyz': (1.0, 0.0, 0.0), 'quat_xyzw': (0.0, 0.0, 0.0, 1.0)}))
    before = harness.node.get_clock().now()
    harness.spin_until(commands.moving, meanwhile=standing.publish)
    after = harness.node.get_clock().now()
    np.testing.assert_allclose(commands.base[-1][1:5], 0.0)
    if stamped:
        stamps = [Time.from_msg(message.header.stamp) for message in commands.messages]
        assert before < stamps[-1] < after and stamps == sorted(stamps)


def test_a_listener_of_another_type_does_not_count(harness):
    controller = harness.controller(**ROBOT, stack=MOVING, require_listener=True)
    commands, status, standing = Commands(harness), Status(harness), Standing(harness)
    harness.spin_until(lambda: status.head == 'running', meanwhile=standing.publish)
    assert commands.messages
    # As if the controller published another type: a process has one type on a topic.
    controller._robot.loop.commands.publishers[-1].type_name = 'geometry_msgs/msg/Twist'
    harness.spin_until(lambda: status.head == 'no node listens to /cmd_vel',
                       meanwhile=standing.publish)


def test_fixed_base_has_no_topics_of_a_base(harness):
    harness.controller()
    harness.simulator()
    assert harness.node.count_publishers('/cmd_vel') == 0
    assert harness.node.count_publishers('/odom') == 0
    assert harness.node.count_subscribers('/odom') == 0
    assert harness.node.count_subscribers('/cmd_vel') == 0


@pytest.mark.parametrize('rate', [50.0, 0.0])
def test_robot_without_joints_goes_where_it_is_sent(harness, rate):
    boat = {'robot_description': BOAT, 'base': 'planar'}
    harness.controller(**boat, stack='- stay: {type: base_pose, gain: 2.0}', rate=rate)
    harness.simulator(**boat, initial_positions='{base_yaw: 2.5}', rate=100.0, speed=2.0)
    status = Status(harness)
    goals = harness.publisher(PoseStamped, '/tp_controller/stay/goal')
    harness.spin_until(lambda: status.head == 'running')
    goals.publish(make_message('stay', PoseStamped, {
        'xyz': (0.3, -0.4, 0.0), 'quat_xyzw': (0.0, 0.0, math.sin(1.0), math.cos(1.0))}))
    harness.spin_until(lambda: status.task('stay')['goals accepted'] == '1')
    harness.spin_until(lambda: status.task('stay')['status'] == 'reached')


@pytest.mark.parametrize('parameters', [
    {'rate': 100.0},
    # Without odometry that starts them there would be a cycle every two seconds.
    {'rate': 0.0, 'state_timeout': 1.0, 'braking_gain': 1.0}])
def test_robot_without_joints_needs_no_joint_states(harness, parameters):
    harness.controller(robot_description=BOAT, base='planar', stack='- stay: {type: base_pose}',
                       **parameters)
    commands = Commands(harness)
    place = harness.publisher(Odometry, '/odom')
    message = odometry(child='hull')
    goals = harness.publisher(PoseStamped, '/tp_controller/stay/goal')
    goals.publish(make_message('stay', PoseStamped, {
        'xyz': (0.0, 0.2, 0.0), 'quat_xyzw': (0.0, 0.0, 0.0, 1.0)}))
    harness.spin_until(lambda: commands.base and commands.base[-1][1] != 0.0,
                       meanwhile=lambda: place.publish(message))
    before = len(commands.base)
    harness.spin_until(lambda: len(commands.base) > before + 20,
                       meanwhile=lambda: place.publish(message))
    np.testing.assert_allclose(commands.base[-1], [0, 0.2, 0, 0, 0, 0], atol=1e-12)


# Parameters

def test_limits_of_the_base_are_parameters(harness):
    _, commands, *_ = start_moving(harness, limits__base_x__velocity=0.2)
    assert commands.base[-1][0] == pytest.approx(0.2)


@pytest.mark.parametrize('parameters, error, message', [
    ({'base': 'rolling'}, RobotError, "unknown base 'rolling'; valid: fixed, planar"),
    ({'world_frame': 'tool'}, RobotError, "cannot be named like a link: 'tool'"),
    ({'limits__base_x__lower': -1.0}, SettingsError,
     r'unknown parameter limits.base_x.lower; valid: .*limits.<axis>.velocity\|acceleration\|jerk '
     'with base_x, base_yaw'),
    ({'limits__base_y__velocity': 1.0}, SettingsError, 'unknown parameter limits.base_y.velocity'),
])
@pytest.mark.parametrize('node', ['controller', 'simulator'])
def test_parameters_of_a_base_that_make_no_sense_are_refused(harness, node, parameters, error,
                                                             message):
    with pytest.raises(error, match=message):
        getattr(harness, node)(**{**ROBOT, **parameters})


# The simulator

def commander(harness, *values, kind=TwistStamped):
    """Return what publishes the same command for the base once more."""
    message = kind()
    body = message.twist if kind is TwistStamped else message
    linear, angular = body.linear, body.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = values
    publisher = harness.publisher(kind, '/cmd_vel')
    return lambda: publisher.publish(message)


def test_simulator_publishes_where_its_base_is_and_how_it_moves(any_harness):
    harness = any_harness
    harness.simulator(**ROBOT, initial_positions='{base_x: 1.0, base_y: 2.0, base_yaw: 0.5}')
    places, states = harness.record(Odometry, '/odom'), harness.record(JointState, '/joint_states')
    harness.spin_until(lambda: places and states)
    first = places[0]
    assert (first.header.frame_id, first.child_frame_id) == ('odom', 'base_link')
    place, turn = first.pose.pose.position, first.pose.pose.orientation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 0.0)
    assert (turn.x, turn.y) == (0.0, 0.0)
    np.testing.assert_allclose([turn.z, turn.w], [math.sin(0.25), math.cos(0.25)])
    assert first.header.stamp.sec > 0 and list(states[0].name) == list(JOINTS)
    # A differential base does not move sideways, whatever it is told.
    command = commander(harness, 0.3, 0.2, 0.1, 0.1, 0.1, 0.0)
    harness.spin_until(lambda: places[-1].twist.twist.linear.x > 0.0, meanwhile=command)
    assert twist(places[-1].twist.twist) == [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
    place = places[-1].pose.pose.position
    assert place.x > 1.0
    assert (place.y - 2.0) / (place.x - 1.0) == pytest.approx(math.tan(0.5))
    assert states[-1].position == states[0].position and not any(states[-1].velocity)


@pytest.mark.parametrize('kind', [TwistStamped, Twist])
def test_simulator_takes_both_types_of_velocities_of_a_base(harness, log, kind):
    # Before the simulator: a process has one type on a topic.
    drive = harness.node.create_publisher(kind, '/cmd_vel', 10)
    message = kind()
    (message.twist if kind is TwistStamped else message).linear.x = 0.3
    harness.simulator(**ROBOT)
    places = harness.record(Odometry, '/odom')
    harness.spin_until(lambda: places and places[-1].twist.twist.linear.x == 0.3,
                       meanwhile=lambda: drive.publish(message))


def test_watchdog_and_simulator_follow_a_change_of_the_type(harness, capfd):
    other = Node('base_driver', context=harness.context)
    harness.simulator(**ROBOT)
    harness.make(WatchdogNode, base='differential', timeout=0.1)
    places = harness.record(Odometry, '/odom')

    def types():
        return {info.topic_type.rpartition('/')[2] for info in (
            *other.get_publishers_info_by_topic('/cmd_vel'),
            *other.get_subscriptions_info_by_topic('/cmd_vel'))}

    harness.spin_until(lambda: types() == {'TwistStamped'})
    published = [SimpleNamespace(topic_type='geometry_msgs/msg/Twist', node_name='planner')]
    with pytest.MonkeyPatch.context() as patch:
        # The planner is in another process.
        for node in harness.nodes_of(SimulatorNode, WatchdogNode):
            patch.setattr(node, 'get_publishers_info_by_topic', lambda topic: published)
        harness.spin_until(lambda: types() == {'Twist'})
    # The middleware complains about a second type.
    assert 'incompatible type' not in capfd.readouterr().err
    drive, commands = other.create_publisher(Twist, '/cmd_vel', 10), harness.record(
        Twist, '/cmd_vel')
    # Simulator, watchdog and test.
    harness.spin_until(lambda: drive.get_subscription_count() == 3)
    message = Twist()
    message.linear.x = 0.3
    harness.spin_until(lambda: places and places[-1].twist.twist.linear.x == 0.3,
                       meanwhile=lambda: drive.publish(message))
    harness.spin_until(lambda: commands and not any(twist(commands[-1])))
    other.destroy_node()


def test_base_and_joints_of_the_simulator_time_out_apart(harness):
    harness.simulator(**ROBOT, command_timeout=0.05)
    places, states = harness.record(Odometry, '/odom'), harness.record(JointState, '/joint_states')
    drive = commander(harness, 0.1, 0.0, 0.0, 0.0, 0.0, 0.1)
    joints = harness.publisher(Float64MultiArray, '/velocity_controller/commands')

    def swing():
        # So slow that no joint gets to a limit.
        joints.publish(Float64MultiArray(data=[0.0] + [0.02] * 7))

    def both():
        drive()
        swing()

    def moving():
        return places[-1].twist.twist.linear.x != 0.0, states[-1].velocity[1] != 0.0

    harness.spin_until(lambda: places and states and moving() == (True, True), meanwhile=both)
    harness.spin_until(lambda: moving() == (False, True), meanwhile=swing)
    harness.spin_until(lambda: moving() == (True, False), meanwhile=drive)
    harness.spin_until(lambda: moving() == (False, False))


def test_command_for_the_base_that_is_not_finite_is_ignored(harness, log):
    harness.simulator(**ROBOT)
    places = harness.record(Odometry, '/odom')
    commander(harness, math.nan, 0.0, 0.0, 0.0, 0.0, 0.1)()
    harness.spin_until(lambda: 'cmd_vel ignored: a velocity is not a finite number' in log())
    harness.spin_for_more(places, 3)
    assert not any(twist(places[-1].twist.twist))
    # Joints are commanded all the same.
    states = harness.record(JointState, '/joint_states')
    joints = harness.publisher(Float64MultiArray, '/velocity_controller/commands')
    harness.spin_until(lambda: states and states[-1].velocity[1] > 0.0, meanwhile=lambda:
                       joints.publish(Float64MultiArray(data=[0.0] + [0.2] * 7)))


def test_noise_of_the_odometry_is_that_of_the_positions(harness):
    harness.simulator(**ROBOT, noise=0.01, seed=7)
    places = harness.record(Odometry, '/odom')
    harness.spin_for_more(places, 20)
    x = [message.pose.pose.position.x for message in places]
    assert 0.001 < np.std(x) < 0.1
    for message in places:
        turn = message.pose.pose.orientation
        assert turn.z ** 2 + turn.w ** 2 == pytest.approx(1.0)

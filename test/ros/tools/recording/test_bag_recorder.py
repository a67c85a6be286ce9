# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What the nodes say is what is in the recording: every message of every topic."""

from collections import Counter

from geometry_msgs.msg import PointStamped
from harness import JOINTS, MOVING_STACK
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile
from rosbags.rosbag2 import Reader
from rosbags.typesys import get_typestore, Stores
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from tp_controller.tools.recording.bag_recorder import BagRecorder
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.reader import Bag
from tp_controller.tools.recording.robots import robot_of
from tp_controller.tools.recording.writer import BagWriter

STACK = f'{MOVING_STACK}\n- tool: {{type: position, frame: link3}}'
STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture
def bag(tmp_path):
    """Return a new recording."""
    return BagWriter(tmp_path / 'run')


@pytest.fixture
def recorder(harness):
    """Return a recorder that looks for new topics all the time."""
    with pytest.MonkeyPatch.context() as patch, BagRecorder(context=harness.context) as found:
        patch.setattr('tp_controller.tools.recording.bag_recorder.LOOK_SECONDS', 0.0)
        yield found


def messages(path):
    """Return {topic: messages} of a recording, as another library reads them."""
    found = {}
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(
                STORE.deserialize_cdr(data, connection.msgtype))
    return found


def told(message):
    """Return what tells joint states from others."""
    return message.header.stamp.sec, message.header.stamp.nanosec, tuple(message.position)


def listening(harness, recorder, bag, *topics):
    """Spin until the recorder listens to topics."""
    def heard():
        recorder.record(bag)
        return recorder.find() and all(
            topic in recorder._topics and harness.node.count_subscribers(topic)
            for topic in topics)

    harness.spin_until(heard, f'a recorder that listens to {topics}')


def test_every_message_of_a_run_is_recorded(harness, recorder, bag):
    harness.controller(stack=STACK)
    harness.simulator()
    states = harness.record(JointState, '/joint_states', 5000)
    commands = harness.commands()
    goal = harness.publisher(PointStamped, '/tp_controller/tool/goal')
    listening(harness, recorder, bag, '/joint_states', '/velocity_controller/commands',
              '/tp_controller/tool/goal', '/tp_controller/status', '/tp_controller/markers')
    harness.spin_until(lambda: goal.get_subscription_count() == 2, 'both subscribers of the goal')
    point = PointStamped()
    point.point.x, point.point.y = 0.5, 0.25
    goal.publish(point)
    first_state, first_command = len(states), len(commands)
    harness.spin_until(lambda: len(states) > first_state + 200, '200 joint states',
                       lambda: recorder.record(bag))
    harness.spin_until(lambda: bag.counts.get('/parameter_events') and bag.counts.get(
        '/tp_controller/markers'), 'parameters and markers', lambda: recorder.record(bag))
    recorder.record(bag)
    bag.close()
    found = messages(bag.path)
    wanted = [told(message) for message in states[first_state:]]
    recorded = [told(message) for message in found['/joint_states']]
    start = recorded.index(wanted[0])
    # The test and the recorder do not look at the same time.
    count = min(len(wanted), len(recorded) - start)
    assert count >= 200 and recorded[start:start + count] == wanted[:count]
    sent = [tuple(message.data) for message in found['/velocity_controller/commands']]
    assert all(tuple(command) in sent for command in commands[first_command:][:-2])
    assert found['/tp_controller/tool/goal'][0].point.x == 0.5
    assert found['/tp_controller/status'][0].status[0].name == 'tp_controller'
    assert {'/tp_controller/swing/numbers', '/robot_description', '/rosout'} <= set(found)
    assert recorder.lost() == 0 and not recorder.skipped
    assert Counter({topic: len(rows) for topic, rows in found.items()}) == Counter(bag.counts)


def test_what_is_recorded_tells_all_about_the_robot(harness, recorder, bag):
    controller = harness.controller(stack=STACK, limits__joint1__velocity=0.5)
    harness.simulator()
    harness.spin_until(lambda: bag.counts.get('/tp_controller/robot_description'),
                       'the description', lambda: (recorder.find(), recorder.record(bag)))
    harness.spin_until(lambda: bag.counts.get('/joint_states', 0) > 20
                       and bag.counts.get('/tp_controller/status', 0) > 5, 'messages',
                       lambda: recorder.record(bag))
    bag.close()
    history = History(Bag(bag.path), '', lambda size: None)
    robot = robot_of(history)
    assert robot.joint_names == JOINTS and robot.velocity[0] == 0.5
    assert history.parameters['stack'] == STACK
    assert history.parameters['status_rate'] == 50.0
    assert history.parameters['joints'] == ['']
    np.testing.assert_array_equal(history.parameters['weights'], [1.0])
    assert list(history.tasks) == ['swing', 'tool']
    assert {name for name in history.parameters if not name.startswith('qos_')} == {
        name for name in controller._parameters if not name.startswith('qos_')}


def test_topics_of_a_task_that_is_added_are_recorded_too(harness, recorder, bag):
    harness.controller()
    harness.simulator()
    listening(harness, recorder, bag, '/tp_controller/swing/goal')
    assert '/tp_controller/tool/goal' not in recorder._topics
    assert harness.set_parameters({'stack': STACK}) == ''
    listening(harness, recorder, bag, '/tp_controller/tool/goal')
    bag.close()


def test_a_topic_whose_type_changes_is_recorded_with_both(harness, recorder, bag):
    harness.controller(stack='- tool: {type: position, frame: link3}')
    harness.simulator()
    listening(harness, recorder, bag, '/tp_controller/tool/goal')
    harness.set_parameters({'stack': '- tool: {type: pose, frame: link3}'})

    def changed():
        recorder.record(bag)
        topic = recorder._topics.get('/tp_controller/tool/goal')
        return topic is not None and topic.kind == 'geometry_msgs/msg/PoseStamped'

    harness.spin_until(changed, 'the other type')
    bag.close()


def test_remapped_and_namespaced_names_are_recorded(harness, recorder, bag):
    harness.controller(arguments=['--ros-args', '-r', '__ns:=/left', '-r', '__node:=arm', '-r',
                                  'velocity_controller/commands:=/drives/velocities'])
    recorder._names = ['/left/arm'.strip('/')]
    harness.spin_until(lambda: bag.counts.get('/left/arm/status'), 'a status',
                       lambda: (recorder.find(), recorder.record(bag)))
    assert recorder.controllers == ['left/arm']
    assert {'/drives/velocities', '/left/joint_states', '/left/arm/swing/goal'} <= set(
        recorder._topics)
    bag.close()


def test_publishers_that_are_not_reliable_are_heard(harness, recorder, bag):
    harness.controller()
    publisher = harness.publisher(JointState, '/joint_states', qos_profile_sensor_data)
    listening(harness, recorder, bag, '/joint_states')
    harness.spin_until(lambda: publisher.get_subscription_count() == 2, 'both subscribers')
    harness.spin_until(lambda: bag.counts.get('/joint_states', 0) > 3, 'joint states', lambda: (
        publisher.publish(JointState(name=list(JOINTS), position=[0.1, 0.2, 0.3])),
        recorder.record(bag)))
    bag.close()
    with Reader(bag.path) as reader:
        offered = next(connection.ext.offered_qos_profiles for connection in reader.connections
                       if connection.topic == '/joint_states')
    assert offered[0].reliability.name == 'BEST_EFFORT'


def test_what_was_published_before_is_recorded_where_it_is_kept(harness, recorder, bag):
    harness.controller()
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    harness.publisher(String, '/robot_description', kept, connected=False).publish(
        String(data='<robot/>'))
    harness.spin_until(lambda: bag.counts.get('/robot_description'), 'the description',
                       lambda: (recorder.find(), recorder.record(bag)))
    bag.close()
    assert messages(bag.path)['/robot_description'][0].data == '<robot/>'


def test_messages_that_did_not_arrive_are_counted(harness, recorder, bag, monkeypatch):
    # With a queue of two, the rest of what is sent between two looks is lost.
    monkeypatch.setattr('tp_controller.tools.recording.bag_recorder.DEPTH', 2)
    harness.controller()
    publisher = harness.publisher(JointState, '/joint_states')
    listening(harness, recorder, bag, '/joint_states')
    harness.spin_until(lambda: publisher.get_subscription_count() == 2, 'both subscribers')
    state = JointState(name=list(JOINTS), position=[0.1, 0.2, 0.3])

    def send(count):
        before = bag.counts.get('/joint_states', 0)
        for _ in range(count):
            publisher.publish(state)
        harness.spin_until(lambda: recorder.record(bag) and bag.counts['/joint_states'] > before,
                           'a joint state')

    send(1)
    assert recorder.lost() == 0
    send(12)
    assert recorder.lost() == 12 - (bag.counts['/joint_states'] - 1)
    bag.close()


def test_a_node_that_is_none_of_ours_is_no_controller(harness, recorder):
    harness.publisher(Float64MultiArray, '/tester/status', connected=False)
    harness.spin_until(lambda: harness.node.count_publishers('/tester/status'), 'the topic')
    assert not recorder.find()
    recorder._names = ['nobody']
    assert not recorder.find() and recorder.missing() == ['nobody']

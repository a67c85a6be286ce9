# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Obstacles from topics: a MarkerArray adds obstacles before an arm, and removes them."""

import math

from harness import Arm, Status
import pytest
from robots import CONFIG, PANDA_DH, PANDA_READY
from tp_controller.errors import GoalError
from tp_controller.ros.interface.goal_messages import GOALS
from visualization_msgs.msg import Marker, MarkerArray

CAPSULES = CONFIG / 'panda_capsules.yaml'
STACK = f"""
- clear: {{type: obstacles, capsules: {CAPSULES}, links: [panda_hand],
          obstacles: {{pole: {{shape: {{cylinder: [0.05, 2.0]}}, at: [0.0, 0.6, 0.0]}}}}}}
- rest: {{type: joint_velocity}}
"""
NAMES = [f'panda_joint{number}' for number in range(1, 8)]
TOPIC = '/tp_controller/clear/obstacles'


def marker(ns='box', number=0, kind=Marker.CUBE, size=(0.4, 0.4, 0.2), at=(0.45, 0.0, 0.2),
           frame='panda_link0', action=Marker.ADD, seconds=0.0):
    """Return a marker."""
    made = Marker(ns=ns, id=number, type=kind, action=action)
    made.header.frame_id = frame
    made.scale.x, made.scale.y, made.scale.z = size
    made.pose.position.x, made.pose.position.y, made.pose.position.z = at
    made.lifetime.sec, made.lifetime.nanosec = int(seconds), int(1e9 * (seconds % 1.0))
    return made


def read(*markers):
    """Return what a message says, {frame: {name: obstacle}}."""
    return [(frame, goal) for frame, goal in GOALS['obstacles'].parts(
        MarkerArray(markers=list(markers)))]


def test_markers_become_plain_obstacles():
    at = (0.45, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0)
    assert read(marker(), marker('ball', 3, Marker.SPHERE, (0.2, 0.2, 0.2), frame='cup'),
                marker('', 4, Marker.CYLINDER, (0.2, 0.2, 0.5), seconds=1.5),
                marker('old', action=Marker.DELETE)) == [
        ('panda_link0', {'box': {'shape': {'box': [0.4, 0.4, 0.2]}, 'at': at},
                         '4': {'shape': {'cylinder': [0.1, 0.5]}, 'at': at, 'lifetime': 1.5}}),
        ('cup', {'ball/3': {'shape': {'sphere': 0.1}, 'at': at}}),
        ('', {'old': None})]


def test_what_comes_before_delete_all_counts_no_more():
    parts = read(marker('a'), marker(action=Marker.DELETEALL), marker('b'))
    assert [(frame, list(goal)) for frame, goal in parts] == [('', ['*']), ('panda_link0', ['b'])]


@pytest.mark.parametrize('bad, told', [
    ({'kind': Marker.ARROW}, 'obstacle box: unknown type 0; valid: 1 (cube), 2 (sphere)'),
    ({'kind': Marker.SPHERE}, 'must be round, got the scale 0.4, 0.4, 0.2'),
    ({'kind': Marker.CYLINDER, 'size': (0.1, 0.2, 0.3)}, 'must be round'),
    ({'kind': Marker.SPHERE, 'size': (math.nan,) * 3}, 'must be round'),
    ({'action': 7}, 'unknown action 7'),
])
def test_marker_that_is_no_obstacle_is_refused(bad, told):
    with pytest.raises(GoalError) as error:
        read(marker('good'), marker(**bad))
    assert told in str(error.value)


class Scene:
    """The Panda, standing still, which nothing but obstacles moves."""

    def __init__(self, harness):
        self._harness = harness
        harness.controller(robot=str(PANDA_DH), stack=STACK)
        self.arm = Arm(harness, PANDA_READY, NAMES)
        self.status, self.commands = Status(harness), harness.commands()
        self._obstacles = harness.publisher(MarkerArray, TOPIC)
        self._taken = 0

    def spin_until(self, condition, what):
        """Spin while joint states come in."""
        self._harness.spin_until(condition, what, self.arm.publish)

    def send(self, *markers, refused=False):
        """Publish markers and wait for the controller to have taken or refused them."""
        key = 'goals refused' if refused else 'goals accepted'

        def count():
            return int(self.status.task('clear')[key] or 0)

        self.spin_until(lambda: self.status.messages, 'a status')
        before = count()
        self._obstacles.publish(MarkerArray(markers=list(markers)))
        self.spin_until(lambda: count() > before, key)

    def error(self):
        """Return how far the hand is too near [m]."""
        return float(self.status.task('clear')['error [m]'] or -1.0)

    def moving(self):
        """Say whether the latest command moves a joint."""
        return bool(self.commands) and max(map(abs, self.commands[-1])) > 1e-3


@pytest.fixture
def scene(harness):
    """Return a scene in which nothing is near."""
    scene = Scene(harness)
    scene.spin_until(lambda: scene.error() == 0.0, 'a free hand')
    assert not scene.moving()
    return scene


def test_box_in_the_way_drives_the_hand_out_and_deleting_it_frees_it(scene):
    # The hand stands 0.1 m deep in the box.
    scene.send(marker(at=(0.3, 0.0, 0.55), size=(0.3, 0.3, 0.2)))
    scene.spin_until(lambda: scene.error() > 0.05 and scene.moving(), 'a hand in the box')
    scene.send(marker(at=(0.3, 0.0, 0.0), size=(0.3, 0.3, 0.2)))
    scene.spin_until(lambda: scene.error() == 0.0 and not scene.moving(), 'a moved box')
    scene.send(marker(at=(0.3, 0.0, 0.55), size=(0.3, 0.3, 0.2)))
    scene.spin_until(lambda: scene.error() > 0.05, 'the box again')
    scene.send(marker(action=Marker.DELETE))
    scene.spin_until(lambda: scene.error() == 0.0 and not scene.moving(), 'no box')


def test_obstacle_may_be_given_in_a_frame_of_the_robot(scene):
    ball = {'kind': Marker.SPHERE, 'size': (0.2, 0.2, 0.2), 'at': (0.0, 0.0, 0.05)}
    scene.send(marker('ball', frame='panda_hand', **ball))
    scene.spin_until(lambda: scene.error() > 0.05, 'a ball in the hand')
    scene.send(marker(action=Marker.DELETEALL),
               marker('other', frame='panda_hand', **{**ball, 'at': (0.0, 0.0, 2.0)}))
    scene.spin_until(lambda: scene.error() == 0.0, 'another ball, far away')


def test_obstacle_of_the_stack_is_deleted_by_its_name(scene):
    scene.send(marker('pole', kind=Marker.CYLINDER, size=(0.1, 0.1, 2.0), at=(0.3, 0.0, 0.0)))
    scene.spin_until(lambda: scene.error() > 0.02, 'the pole in the hand')
    scene.send(marker('pole', action=Marker.DELETE))
    scene.spin_until(lambda: scene.error() == 0.0, 'no pole')


def test_obstacle_is_gone_after_its_lifetime(scene):
    scene.send(marker(at=(0.3, 0.0, 0.55), size=(0.3, 0.3, 0.2), seconds=0.4))
    scene.spin_until(lambda: scene.error() > 0.05, 'a hand in the box')
    scene.spin_until(lambda: scene.error() == 0.0, 'the end of the box')


@pytest.mark.parametrize('bad, told', [
    ({'size': (0.0, 0.1, 0.1)}, 'bad: box needs x, y, z, positive numbers'),
    ({'size': (math.inf, 0.1, 0.1)}, 'bad: box needs x, y, z, positive numbers'),
    ({'at': (math.nan, 0.0, 0.0)}, 'bad: a place (a pose x, y, z, qx, qy, qz, qw) must be finite'),
    ({'kind': Marker.TEXT_VIEW_FACING}, 'unknown type 9'),
    ({'frame': 'cup'}, "frame 'cup'"),
    ({'seconds': -1.0}, 'bad: lifetime must be positive, got -1'),
])
def test_message_with_a_bad_marker_is_refused_as_a_whole(scene, bad, told):
    scene.send(marker('good', frame='panda_hand', at=(0.0, 0.0, 0.05)), marker('bad', **bad),
               refused=True)
    assert told in scene.status.task('clear')['last refusal']
    scene.spin_until(lambda: len(scene.commands) > 5, 'commands')
    scene.spin_until(lambda: scene.error() == 0.0, 'no distance to keep')


def test_message_without_markers_holds_nothing(scene):
    scene.send(refused=True)
    assert 'no goal or velocity' in scene.status.task('clear')['last refusal']


def test_parts_of_a_message_in_several_frames_are_all_taken(scene):
    ball = {'kind': Marker.SPHERE, 'size': (0.2, 0.2, 0.2)}
    scene.send(marker(action=Marker.DELETEALL),
               marker('near', frame='panda_hand', at=(0.0, 0.0, 0.05), **ball),
               marker('far', at=(0.0, 0.0, 9.0), **ball),
               marker('farther', frame='panda_link4', at=(0.0, 0.0, 9.0), **ball))
    scene.spin_until(lambda: scene.error() > 0.05, 'a ball in the hand')


def test_message_that_needs_joint_positions_is_refused_as_a_whole_without(harness):
    scene = Scene(harness)
    publish, scene.arm.publish = scene.arm.publish, lambda: None
    scene.send(marker('near', at=(0.3, 0.0, 0.55)), marker('other', frame='panda_link4'),
               refused=True)
    assert 'needs joint positions' in scene.status.task('clear')['last refusal']
    scene.arm.publish = publish
    scene.spin_until(lambda: scene.error() == 0.0, 'a free hand')

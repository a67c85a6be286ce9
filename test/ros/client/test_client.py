# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Whoever sends a goal waits for all that listen to it, as recorders do."""

from geometry_msgs.msg import PointStamped
from harness import Arm, Status
import pytest
from tp_controller.errors import GoalError
from tp_controller.ros.client.client import Client, OTHERS_SECONDS

STACK = '[{tip: {type: position, frame: link3, axes: xy}}]'
TOPIC = '/tp_controller/tip/goal'
GOAL = (0.8, 0.6, 0.0)


class Sender:
    """
    A client that sends a goal, and finds others late.

    Attributes
    ----------
    found : int
        Subscriptions that its publisher has found.
    asked : list of int
        What it has heard whenever it asked how many there are.
    sent_to : list of int
        How many it had found when it published.
    waited : list of float
        For how long it would have waited, on leaving, until everything has arrived [s].

    """

    def __init__(self, harness, monkeypatch, found):
        self.asked, self.sent_to, self.waited, self.found = [], [], [], found
        self.client = client = Client(context=harness.context)
        # Another process would go on meanwhile.
        spin = client.spin
        monkeypatch.setattr(client, 'spin', lambda seconds: (
            harness.executor.spin_once(timeout_sec=0.005), spin(0.001)))
        publisher = client._publisher('tip', 'goal', PointStamped)
        publish = publisher.publish
        # It does not know either that there is somebody to be found.
        monkeypatch.setattr(client.node, 'count_subscribers', lambda topic: self.found)
        monkeypatch.setattr(publisher, 'get_subscription_count', self._count)
        monkeypatch.setattr(publisher, 'publish', lambda message: (
            self.sent_to.append(self.found), publish(message)))
        monkeypatch.setattr(publisher, 'wait_for_all_acked', lambda duration: self.waited.append(
            duration.nanoseconds * 1e-9))

    def _count(self):
        """Return how many subscriptions it has found."""
        self.asked.append(self.found)
        if len(self.asked) == 20:
            self.found += 1
        return self.found


@pytest.fixture
def status(harness):
    """Return the status of a controller whose goals somebody else hears, too."""
    controller, arm = harness.controller(stack=STACK, state_timeout=10.0), Arm(harness)
    found = Status(harness)
    harness.spin_until(lambda: controller._robot is not None, 'the loop', arm.publish)
    return found


def test_status_counts_who_listens_to_a_goal(harness, status):
    harness.spin_until(lambda: status.task('tip')['goal listeners'] == '1')
    heard = harness.record(PointStamped, TOPIC)
    harness.spin_until(lambda: status.task('tip')['goal listeners'] == '2')
    assert not heard


def test_goal_is_sent_once_everybody_is_found_of_whom_the_controller_knows(
        harness, status, monkeypatch):
    heard = harness.record(PointStamped, TOPIC)
    harness.spin_until(lambda: status.task('tip')['goal listeners'] == '2')
    sender = Sender(harness, monkeypatch, found=1)
    sender.client.send('tip', xyz=GOAL)
    assert sender.sent_to == [2] and sender.asked[:20] == [1] * 20
    harness.spin_until(lambda: heard, 'the goal')
    sender.client.close()
    # The controller has it; the other one may have not found this sender yet.
    assert sender.waited == [OTHERS_SECONDS]


def test_goal_for_a_controller_without_a_stack_is_refused_with_its_reason(harness, monkeypatch):
    harness.controller(stack='[{tip: {type: position, frame: nowhere}}]', state_timeout=10.0)
    client = Client(context=harness.context)
    spin = client.spin
    monkeypatch.setattr(client, 'spin', lambda seconds: (
        harness.executor.spin_once(timeout_sec=0.005), spin(0.001)))
    assert client.wait(lambda: client.stop_reason().startswith('no valid stack'), 10.0)
    with pytest.raises(GoalError, match='/tp_controller has no tasks: no valid stack: .*nowhere'):
        client.send('tip', wait=0.1, xyz=GOAL)
    client.close()

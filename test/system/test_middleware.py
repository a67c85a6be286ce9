# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of Fast DDS, unless the user has some."""

import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from processes_harness import DEADLINE
import pytest
from tp_controller.ros.middleware import FILES, set_up_fast_dds, VARIABLES
from tp_controller.tools.demos.processes import own_domain

# Nodes of two processes, one of which hears what the other one sends.
COMMON = """
import time
from geometry_msgs.msg import PointStamped
from rclpy.duration import Duration
from rclpy.node import Node
from tp_controller.ros.client.context import new_context
node = Node('node', context=new_context())
"""
HEARING = """
node.create_subscription(PointStamped, '/goal', print, 10)
time.sleep(60.0)
"""
# Without the profile the answer takes up to 3 s.
SENDING = """
publisher = node.create_publisher(PointStamped, '/goal', 10)
while not publisher.get_subscription_count():
    time.sleep(0.01)
time.sleep(0.2)
publisher.publish(PointStamped())
print(publisher.wait_for_all_acked(Duration(seconds=2.0)))
"""


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch, tmp_path):
    """Take away what is set, and undo what is set then."""
    for name in VARIABLES:
        monkeypatch.setenv(name, '')
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)


def time_of(tag):
    """Return the time [s] that the profile has under some tag."""
    set_up_fast_dds()
    path, = (os.environ[name] for name in VARIABLES if name in os.environ)
    found, = (element for element in ElementTree.parse(path).getroot().iter()
              if element.tag.endswith(tag))
    seconds, nanoseconds = (int(part.text) for part in found)
    return seconds + 1e-9 * nanoseconds


def test_the_profile_announces_ten_times_a_second():
    assert time_of('leaseAnnouncement') == 0.1


def test_what_gets_lost_is_sent_again_at_the_next_request():
    assert 0.0 < time_of('nackSupressionDuration') < 0.2 * time_of('heartbeatPeriod')


def test_a_goal_that_another_process_hears_is_soon_known_to_be_there():
    set_up_fast_dds()
    with own_domain() as environment:
        hearing = subprocess.Popen([sys.executable, '-c', COMMON + HEARING], env=environment)
        try:
            told = subprocess.run([sys.executable, '-c', COMMON + SENDING], env=environment,
                                  text=True, capture_output=True, timeout=2.0 * DEADLINE)
        finally:
            hearing.kill()
            hearing.wait()
    assert told.stdout.split() == ['True'], told.stderr


@pytest.mark.parametrize('name', VARIABLES)
def test_a_profile_of_the_user_stays(monkeypatch, name):
    monkeypatch.setenv(name, 'mine.xml')
    set_up_fast_dds()
    assert {key: os.environ[key] for key in VARIABLES if key in os.environ} == {name: 'mine.xml'}


@pytest.mark.parametrize('name', FILES)
def test_a_file_that_fast_dds_takes_by_itself_stays_alone(name):
    Path(name).touch()
    set_up_fast_dds()
    assert not set(VARIABLES) & set(os.environ)

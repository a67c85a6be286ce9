# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The replay of a recording has all that it is to show, in the page itself."""

import base64
import re

import msgspec
import numpy as np
import pytest
import recordings
from tp_controller.tools.recording.history import History
from tp_controller.tools.recording.reader import Bag
from tp_controller.tools.recording.robots import robot_of
import zstandard

MARKER = 'visualization_msgs/msg/Marker'


def marker(name, point):
    """Return the marker of a small sphere."""
    make = recordings.make
    length = make('builtin_interfaces/msg/Duration', 0, 0)
    return make(
        MARKER, recordings.header('base_link'), name, 0, 2, 0,
        make('geometry_msgs/msg/Pose', make('geometry_msgs/msg/Point', *point),
             make('geometry_msgs/msg/Quaternion', 0.0, 0.0, 0.0, 1.0)),
        make('geometry_msgs/msg/Vector3', 0.1, 0.1, 0.1),
        make('std_msgs/msg/ColorRGBA', 1.0, 0.0, 0.0, 1.0), length, False, [], [], '',
        make('sensor_msgs/msg/CompressedImage', recordings.header(), '', np.empty(0, np.uint8)),
        [], '', '', make('visualization_msgs/msg/MeshFile', '', np.empty(0, np.uint8)), False)


@pytest.fixture(scope='module')
def history(tmp_path_factory):
    """Return what happened in a run with a marker that comes after one second."""
    shown = recordings.make('visualization_msgs/msg/MarkerArray',
                            [marker('tool/goal', (0.4, 0.2, 0.0))])
    rows = [*recordings.run(), (1.0, '/tp_controller/markers', shown)]
    path = tmp_path_factory.mktemp('bags') / 'run'
    return History(Bag(recordings.write(path, sorted(rows, key=lambda row: row[0]))), '',
                   lambda size: None)


def content(page):
    """Return what a page replays: seconds, and (time, message) of the scene."""
    data = base64.b64decode(re.search(r'VISER_EMBED_DATA__="([^"]*)"', page)[1])
    inner = zstandard.ZstdDecompressor().decompress(data[8:])
    length = int.from_bytes(inner[:8], 'little')
    told = msgspec.msgpack.decode(inner[8:8 + length])
    return told['durationSeconds'], told['messages']


@pytest.mark.slow
def test_the_replay_lasts_as_long_as_the_run_and_moves_the_links(history, capsys):
    from tp_controller.tools.view.replay import replay_page
    robot = robot_of(history)
    seconds, told = content(replay_page(history, robot))
    moments = history.motion.moments
    assert seconds == pytest.approx(moments[-1].time - moments[0].time)
    assert capsys.readouterr().out == ''
    moves = [time for time, message in told if message['type'] == 'SetPositionMessage'
             and message['name'].startswith('/robot/')]
    # The robot stands from 2 s on.
    assert len(moves) > 50 and 1.9 < max(moves) < 2.1
    goal = [time for time, message in told if message.get('name', '').startswith(
        '/tasks/tool%2Fgoal') and message['type'].endswith('Message')]
    assert goal and min(goal) == pytest.approx(1.0, abs=0.1)


def test_markers_that_stay_are_decoded_once(history, monkeypatch):
    from tp_controller.tools.view.replay import replay_page
    decoded = []
    before = History.markers
    monkeypatch.setattr(History, 'markers', lambda self, moment: decoded.append(moment) or before(
        self, moment))
    assert replay_page(history, robot_of(history))
    # A message may be of megabytes, and may be shown at thousands of moments.
    assert len(decoded) == 1 and len(history.motion.moments) > 50


def test_the_robot_of_the_replay_stands_on_the_ground(history):
    from tp_controller.tools.view.replay import replay_page
    from tp_controller.tools.view.skeleton import JOINT_COLOUR
    from tp_controller.tools.view.visuals import visuals_of
    robot = robot_of(history)
    # Its joints turn about drums, half of each of which is below the root.
    drum = next(part for parts in visuals_of(robot).parts.values() for part in parts
                if part.colour == JOINT_COLOUR)
    _, told = content(replay_page(history, robot))
    height, = (message['position'][2] for _, message in told
               if message['type'] == 'SetPositionMessage' and message['name'] == '/ground')
    assert height == pytest.approx(-drum.mesh.vertices[:, 2].max())


def test_kinds_of_primitives_are_those_of_ros():
    messages = pytest.importorskip('visualization_msgs.msg')
    from tp_controller.tasks.primitives import Kind
    assert Kind
    for kind in Kind:
        assert kind == getattr(messages.Marker, kind.name)

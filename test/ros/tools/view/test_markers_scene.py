# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Markers in the scene of the page."""

import pytest
from tp_controller.tools.view import markers
from tp_controller.tools.view.markers import MarkerScene
from tp_controller.tools.view.server import open_server
from visualization_msgs.msg import Marker


@pytest.fixture(scope='module')
def scene():
    """Return a scene that nobody sees."""
    server = open_server()
    yield server.scene
    server.stop()


def marker(ns, number, kind=Marker.SPHERE, size=0.1):
    """Return a marker."""
    found = Marker(ns=ns, id=number, type=kind)
    found.scale.x = found.scale.y = found.scale.z = size
    found.pose.orientation.w = found.color.a = 1.0
    return found


def nodes(scene):
    """Return the handles of all that is drawn."""
    return [handle for name, handle in scene._handle_from_node_name.items()
            if name.startswith('/tasks/')]


def test_namespace_that_reads_like_a_branch_of_another_stays_without_it(scene):
    scene.reset()
    shown = MarkerScene(scene)
    shown.draw([marker('tool', 0), marker('tool/0', 1)])
    assert len(nodes(scene)) == 2
    shown.draw([marker('tool/0', 1)])
    assert len(nodes(scene)) == 1
    # A warning is an error in tests.
    shown.draw([])
    assert not nodes(scene)


def test_marker_that_could_not_be_changed_is_drawn_when_it_can_be(scene, monkeypatch):
    scene.reset()
    shown = MarkerScene(scene)
    shown.draw([marker('tool', 0)])
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setitem(markers.ADD, Marker.SPHERE, lambda *_: 1 / 0)
        shown.draw([marker('tool', 0, size=0.2)])
    shown.draw([marker('tool', 0, size=0.2)])
    assert [each.scale[0] for each in nodes(scene)] == [pytest.approx(0.2 / 2.0)]

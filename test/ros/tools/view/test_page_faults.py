# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page goes on, and its Stop works, whatever comes from browsers and from the network."""

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, PoseStamped
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

viser = pytest.importorskip('viser', reason="needs pip install '.[view]'")

from pages import MadeUpController  # noqa: E402, I100
from tp_controller.ros.client.status import MOST_RECEIVED_TASKS  # noqa: E402
from tp_controller.tools.view.markers import MOST_MARKERS, MOST_POINTS  # noqa: E402
from tp_controller.tools.view.page import MOST_WAITING  # noqa: E402
from tp_controller.tools.view.server import LOCAL, open_server, unused_port  # noqa: E402

STATUS, MARKERS, JOINTS = '/tp_controller/status', '/tp_controller/markers', '/joint_states'
TASK = {'type': 'position', 'level': '1', 'status': 'moving', 'error [m]': '0.1'}


@pytest.fixture(scope='module')
def server():
    """Return a server whose page nobody opens."""
    found = open_server(LOCAL, unused_port())
    yield found
    found.stop()


@pytest.fixture
def made_up(server):
    """Return a page with a robot that is known, and a goal to be dragged."""
    found = MadeUpController(server)
    found.tell(tip=TASK)
    found.hear(JOINTS, JointState(name=['joint1', 'joint2', 'joint3'], position=[0.1, 0.2, 0.3]))
    found.client.topics = {'tip': {'goal': PoseStamped}}
    found.update()
    found.hear(MARKERS, MarkerArray(markers=[marker()]))
    found.update()
    assert found.page._robot is not None and found.page.gizmos.gizmos
    return found


def marker(ns='tip/goal', number=0, **fields):
    """Return the marker of a goal."""
    found = Marker(ns=ns, id=number, **{'type': Marker.SPHERE, **fields})
    found.scale.x = found.scale.y = found.scale.z = 0.1
    found.color.a = 1.0
    return found


def stop_works(made_up):
    """Return whether a click on Stop stops the robot."""
    made_up.client.calls.clear()
    made_up.client.answers['stop'] = Trigger.Response(success=True)
    assert made_up.set_value(made_up.page.stop_button)
    # Callbacks of viser run on threads of their own.
    for _ in range(30_000):
        if made_up.page._waiting:
            break
        time.sleep(1e-3)
    made_up.update()
    return made_up.client.calls == ['stop']


def drag(**changes):
    """Return what a browser sends while somebody drags."""
    return {'type': 'TransformControlsUpdateMessage', 'name': '/handles/tip/goal', 'owner': '',
            'wxyz': [1.0, 0.0, 0.0, 0.0], 'position': [0.1, 0.2, 0.3], **changes}


def test_a_drag_arrives(made_up):
    assert made_up.do(drag())
    made_up.update()
    (task, topic, goal), = made_up.client.sent
    assert (task, topic) == ('tip', 'goal') and goal.pose.position.y == 0.2


@pytest.mark.parametrize('changes', [
    {'wxyz': [np.nan, 0.0, 0.0, 0.0]}, {'wxyz': [0.0] * 4}, {'wxyz': [1.0, 0.0, 0.0]},
    {'wxyz': []}, {'wxyz': None}, {'wxyz': 'abcd'}, {'wxyz': [2.0, 0.0, 0.0, 0.0]},
    {'wxyz': {}}, {'position': []}, {'position': [np.inf, 0.0, 0.0]},
    {'position': [0.0, 1e300, 0.0]}, {'position': [[0.0], [0.0], [0.0]]}, {'name': 3},
    {'name': 'x' * 2000}, {'owner': 'other'}, {'extra': 1}, {'type': 'RunJavascriptMessage'},
    {'type': None}])
def test_a_drag_that_makes_no_sense_is_dropped_and_the_page_goes_on(made_up, capfd, changes):
    assert not made_up.do(drag(**changes))
    made_up.update()
    assert not made_up.client.sent and not made_up.page._errors
    assert stop_works(made_up)
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('updates', [
    {'disabled': True}, {'visible': False}, {'value': True, 'disabled': True}, {'label': 'Start'},
    {'__class__': 1}, {}, {'value': 'yes'}, {'value': 1}, {'value': None}, {'value': [True]}])
def test_a_browser_sets_the_value_of_a_widget_and_nothing_else(made_up, updates):
    button = made_up.page.stop_button
    assert not made_up.do({'type': 'GuiUpdateMessage', 'uuid': button._impl.uuid,
                           'updates': updates})
    assert not button.disabled and button.visible and button.label == 'Stop'
    assert stop_works(made_up)


def test_values_that_a_widget_does_not_have_are_dropped(made_up):
    page = made_up.page
    slider = page.joints.sliders['joint1']
    for widget, value, taken in (
            (page.frame, 'link2', True), (page.frame, 'nowhere', False), (page.frame, 1, False),
            (slider, 0.5, True), (slider, slider.max + 1.0, False), (slider, np.nan, False),
            (slider, 'nan', False), (page.trail, False, True), (page.trail, 'no', False),
            (page.start_button, True, False), (page.stack.rows['tip'].enabled, 0.0, False),
            (page.stack.rows['tip'].order, '▲ up', True),
            (page.stack.rows['tip'].order, 'left', False)):
        assert made_up.set_value(widget, value) is taken, (widget, value)
    made_up.update()
    assert not page._errors


@pytest.mark.parametrize('kind', [
    'FileTransferStartUpload', 'FileTransferPart', 'GuiFormDirtyMessage', 'ShareUrlRequest',
    'CommandTriggerMessage', 'GuiButtonHoldMessage', 'SceneNodeClickMessage',
    'GetRenderResponseMessage', 'LocalStorageGetItemResponseMessage', 'GuiRemoveMessage'])
def test_messages_that_the_page_has_no_use_for_are_dropped(made_up, kind):
    message = getattr(viser._messages, kind)
    fields = {name: 0 if 'count' in name or 'bytes' in name else 'x'
              for name in message.__dataclass_fields__}
    assert not made_up.do({'type': kind, **fields})


@pytest.mark.parametrize('task', [
    {'error [m]': 'abc'}, {'error [m]': ''}, {'error [m]': 'inf'}, {'error [m]': '-1e308'},
    {'error [m]': '1e308'}, {'error [m]': '1e400'}, {'error [': '1'},
    {'wanted speed': 'x', 'achieved speed': '\x00'}, {'goals refused': 'many'},
    {'goals refused': '9' * 5000}, {'level': '\u202e'}, {}])
def test_a_status_that_makes_no_sense_does_not_end_the_page(made_up, task):
    for number in range(3):
        made_up.tell(**{'tip': {**TASK, **task}, f'task{number}': task})
        # Samples are taken now and then.
        made_up.page.plots._due = 0.0
        made_up.update()
    assert not made_up.page._errors and 'running' in made_up.page.state_text.content
    assert stop_works(made_up)


@pytest.mark.parametrize('message', [
    DiagnosticArray(), DiagnosticArray(status=[DiagnosticStatus(name='other', message='x')])])
def test_what_is_no_status_of_a_controller_is_dropped(made_up, message):
    before = made_up.client.status
    made_up.hear(STATUS, message)
    made_up.update()
    assert made_up.client.status is before and not made_up.page._errors and stop_works(made_up)


@pytest.mark.parametrize('data', [b'', b'\x00', b'\x00\x01\x00\x00' + b'\xff' * 40,
                                  bytes(5_000_000)])
def test_bytes_that_are_no_message_are_dropped(made_up, data):
    before = made_up.client.status
    for topic in (STATUS, MARKERS, JOINTS):
        made_up.hear(topic, data)
    made_up.update()
    assert made_up.client.status is before and not made_up.page._errors


def test_what_is_shown_of_a_status_is_bounded(made_up):
    made_up.tell('x' * 500_000)
    made_up.update()
    assert len(made_up.page.state_text.content) < 10_000
    made_up.tell(**{f'task{number}': {'type': 'x'} for number in range(3000)})
    made_up.update()
    assert len(made_up.page.stack.rows) == MOST_RECEIVED_TASKS
    made_up.tell(**{'a' * 50_000: {'b' * 5000: 'c' * 5000, **TASK, 'reason': 'd' * 50_000}})
    made_up.update()
    (name, row), = made_up.page.stack.rows.items()
    assert len(name) < 300 and len(row.text.content) < 5000


def test_texts_of_the_network_show_what_they_say(made_up):
    made_up.tell('stopped\x1b]0;title\x07\u202edetrats', **{
        'a\x1b[2J': {**TASK, 'reason': 'x\u2066y\n'}})
    made_up.update()
    assert made_up.client.stop_reason() == 'stopped\ufffd]0;title\ufffd\ufffddetrats'
    (name, row), = made_up.page.stack.rows.items()
    assert name == 'a\ufffd[2J' and 'x\ufffdy\ufffd' in row.text.content


@pytest.mark.parametrize('spoil', [
    lambda found: setattr(found.pose.orientation, 'w', np.nan),
    lambda found: setattr(found.pose.orientation, 'w', 0.0),
    lambda found: setattr(found.pose.position, 'x', np.inf),
    lambda found: setattr(found.scale, 'x', -1.0), lambda found: setattr(found.color, 'r', np.nan),
    lambda found: setattr(found.color, 'g', 7.0), lambda found: setattr(found, 'ns', 'tip/\x1b'),
    lambda found: setattr(found, 'ns', 'x' * 100_000),
    lambda found: found.points.append(Point(x=np.nan)),
    lambda found: found.points.extend([Point()] * (MOST_POINTS + 1))])
def test_a_marker_that_makes_no_sense_is_not_drawn_and_others_are(made_up, spoil):
    spoilt = marker('other/goal')
    spoil(spoilt)
    made_up.hear(MARKERS, MarkerArray(markers=[spoilt, marker('good/goal')]))
    made_up.update()
    assert set(made_up.page._markers._drawn) == {('good/goal', 0)} and not made_up.page._errors


@pytest.mark.parametrize('kind', [Marker.LINE_STRIP, Marker.LINE_LIST, Marker.TRIANGLE_LIST,
                                  Marker.ARROW])
def test_markers_with_any_number_of_points_are_drawn(made_up, kind):
    # A marker stays what it is while its number of points changes.
    for count in (0, 1, 2, 0, 3, 4, 1, 0):
        made_up.hear(MARKERS, MarkerArray(markers=[
            marker(type=kind, points=[Point(x=0.1 * each) for each in range(count)]),
            marker('good/goal')]))
        made_up.update()
        assert not made_up.page._errors
        assert ('good/goal', 0) in made_up.page._markers._drawn


def test_the_number_of_markers_is_bounded(made_up):
    made_up.hear(MARKERS, MarkerArray(markers=[
        marker(number=number) for number in range(MOST_MARKERS + 500)]))
    made_up.update()
    assert len(made_up.page._markers._drawn) == MOST_MARKERS


def test_an_internal_error_is_told_once_and_stop_and_start_work(made_up, capfd, monkeypatch):
    def fail(*_):
        raise RuntimeError('\x1b[2J of the test')

    for owner, name in ((made_up.link, 'update'), (made_up.link, 'watch'),
                        (made_up.page._changes, 'update'), (made_up.page, '_send_goals'),
                        (made_up.page, '_show_robot'), (made_up.page, '_show_tasks')):
        monkeypatch.setattr(owner, name, fail)
    for _ in range(3):
        made_up.update()
    notice = made_up.page.notice.content
    assert 'internal error' in notice and '\ufffd[2J of the test' in notice
    said = capfd.readouterr().err
    assert said.count('Traceback') == 6 and '\x1b' not in said
    assert stop_works(made_up)
    made_up.page.start_button.disabled = False
    made_up.client.calls.clear()
    made_up.page._later(lambda: made_up.link.start(made_up.page._show_answer))
    made_up.update()
    assert made_up.client.calls == ['start']


def test_an_answer_that_makes_no_sense_does_not_take_others_along(made_up):
    told = []
    made_up.client.answers.update(set_parameters=None, stop=Trigger.Response(success=True))
    made_up.link.set_parameters({'a': 1.0}, lambda *answer: told.append(answer))
    made_up.link.stop(lambda *answer: told.append(answer))
    made_up.update()
    assert [worked for worked, _ in told] == [False, True] and 'invalid' in told[0][1]


def test_a_stop_drops_what_was_done_before_it_and_waits(made_up):
    page = made_up.page
    for _ in range(10 * MOST_WAITING):
        page._later(lambda: made_up.link.start(page._show_answer))
    assert len(page._waiting) == MOST_WAITING
    page._stop()
    page._later(lambda: made_up.link.enable('tip', False, page._show_answer))
    made_up.client.calls.clear()
    made_up.update()
    assert made_up.client.calls == ['stop', 'tip/enable']


def test_a_stop_in_the_middle_of_an_update_does_not_end_the_page(made_up):
    page = made_up.page
    # Stop comes on a thread of the server, also while an action before it is done.
    page._later(page._stop)
    for _ in range(3):
        page._later(lambda: made_up.link.start(page._show_answer))
    made_up.client.calls.clear()
    made_up.update()
    made_up.update()
    assert made_up.client.calls == ['stop'] and not page._errors


@pytest.mark.parametrize('error', [BrokenPipeError, ValueError])
def test_an_internal_error_that_cannot_be_printed_does_not_end_the_page(
        made_up, monkeypatch, error):
    class Gone:

        def write(self, *_):
            raise error

        flush = write

    def fail():
        raise RuntimeError('of the test')

    made_up.page._later(fail)
    with monkeypatch.context() as patch:
        patch.setattr('sys.stderr', Gone())
        made_up.update()
    assert 'internal error' in made_up.page.notice.content
    assert stop_works(made_up)

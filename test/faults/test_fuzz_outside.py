# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Whatever browsers, the network and recordings say, the page goes on and its Stop works.

Hypothesis makes messages of two kinds: what nobody would send, and what is nearly right. Tried are
10,000 examples in all, always the same ones; more rounds of as many, others every time, with

    TP_FUZZ=1000000 python -m pytest test/faults/test_fuzz_outside.py
"""

import gc
import math
import os
from pathlib import Path
import time

from hypothesis import given, HealthCheck, Phase, settings
from hypothesis import strategies as st
import msgspec
import numpy as np
import pytest
import recordings
from robots import planar

viser = pytest.importorskip('viser', reason="needs pip install '.[view]'")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402, I100
from geometry_msgs.msg import Point, PoseStamped  # noqa: E402
from pages import CONTROLLER, MadeUpController, status  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import ColorRGBA  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402
from tp_controller.errors import TpControllerError  # noqa: E402
from tp_controller.tools.cli.status import table  # noqa: E402
from tp_controller.tools.recording import robots as recorded_robots  # noqa: E402
from tp_controller.tools.recording.history import History  # noqa: E402
from tp_controller.tools.recording.reader import Bag  # noqa: E402
from tp_controller.tools.recording.report import summary, write_report  # noqa: E402
from tp_controller.tools.view.incoming import checked, MESSAGES  # noqa: E402
from tp_controller.tools.view.server import LOCAL, open_server, unused_port  # noqa: E402
from viser import _messages  # noqa: E402
from visualization_msgs.msg import Marker, MarkerArray  # noqa: E402

DEFAULT = 10_000
# Hypothesis remembers the examples of a round: a million in one would be most of the memory.
ROUNDS = max(1, int(os.environ.get('TP_FUZZ', DEFAULT)) // DEFAULT)
# How many of them each test gets [%]: what is drawn or written takes longer.
SHARES = {'bytes': 50, 'browser': 25, 'network': 15, 'recording': 10}
# Memory that the tests may take [bytes], and time of an example, of the processor alone [s].
MOST_MEMORY, SOON = 250_000_000, 2.0
PAGE = os.sysconf('SC_PAGE_SIZE')
WAIT_SECONDS = 60.0


pytestmark = pytest.mark.parametrize('number', range(ROUNDS))


def tried(which):
    """Return the settings of a test."""
    return settings(
        max_examples=DEFAULT * SHARES[which] // 100, derandomize=ROUNDS == 1,
        deadline=None, database=None, phases=[Phase.explicit, Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck))


def memory():
    """Return the memory of this process [bytes]."""
    gc.collect()
    return int(Path('/proc/self/statm').read_text().split()[1]) * PAGE


@pytest.fixture(scope='module', autouse=True)
def bounded():
    """Check that the tests take little memory."""
    before = memory()
    yield
    assert memory() - before < MOST_MEMORY


@pytest.fixture(scope='module')
def made_up():
    """Return a page with a robot that is known."""
    server = open_server(LOCAL, unused_port())
    found = MadeUpController(server)
    found.client.topics = {'tip': {'goal': PoseStamped}}
    found.client.answers['stop'] = Trigger.Response(success=True)
    found.tell(tip=TASK)
    found.hear('/joint_states', JointState(name=JOINTS, position=[0.1, 0.2, 0.3]))
    found.update()
    found.hear(f'/{CONTROLLER}/markers', MarkerArray(markers=[goal()]))
    found.update()
    assert found.page.gizmos.gizmos
    yield found
    server.stop()


def stop_works(made_up):
    """Return whether a click on Stop stops the robot, and nothing went wrong before."""
    page = made_up.page
    made_up.client.calls.clear()
    assert made_up.set_value(page.stop_button)
    end = time.monotonic() + WAIT_SECONDS
    # Callbacks of viser run on threads of their own, after those of the messages before.
    while 'stop' not in made_up.client.calls and time.monotonic() < end:
        made_up.update()
    return 'stop' in made_up.client.calls and not page._errors


JOINTS = ['joint1', 'joint2', 'joint3']
TASK = {'type': 'position', 'level': '1', 'status': 'moving', 'error [m]': '0.1',
        'tolerance [m]': '0.001', 'wanted speed': '1', 'achieved speed': '0.5', 'reason': '',
        'causes': '', 'hint': '', 'goals accepted': '0', 'goals refused': '0', 'last refusal': ''}
numbers = st.one_of(st.floats(-1.0, 1.0), st.floats(), st.sampled_from([0.0, 1.0, 1e308, -1e308]))
words = st.sampled_from([
    *TASK, *JOINTS, 'tip', 'tip/goal', '/handles/tip/goal', 'tip/frame', 'a/obstacle/b', 'running',
    'value', 'disabled', '▲ up', 'link3', '', '\x1b[2J', '\u202e', '$x{', 'abc', 'nan',
    '1e999', '-1', 'reached', 'a: b'])
texts = st.one_of(words, words, st.text(max_size=8), numbers.map(str),
                  st.sampled_from('x9').map(lambda character: 5000 * character))
values = st.recursive(
    st.one_of(texts, numbers, st.integers(-2**63, 2**64 - 1), st.booleans(), st.none(),
              st.binary(max_size=8)),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8)

# From browsers


def fields(**strategies):
    """Return a strategy for a message of which one field may be anything, or be missing."""
    right = st.fixed_dictionaries(strategies)
    wrong = st.builds(lambda message, name, value: {**message, name: value}, right,
                      st.one_of(st.sampled_from([*strategies, 'owner']), texts), values)
    missing = st.builds(lambda message, name: {key: value for key, value in message.items()
                                               if key != name}, right,
                        st.sampled_from([*strategies]))
    return st.one_of(right, right, wrong, missing)


def vectors(count):
    """Return a strategy for numbers, mostly so many."""
    return st.one_of(st.lists(st.floats(-2.0, 2.0), min_size=count, max_size=count),
                     st.lists(numbers, min_size=count, max_size=count),
                     st.lists(numbers, max_size=6))


quaternions = st.one_of(st.sampled_from([[1.0, 0.0, 0.0, 0.0], [0.6, 0.0, 0.8, 0.0]]), vectors(4))
gizmos = st.sampled_from(['/handles/tip/goal', '/handles/tip/goal', '/handles/x', '/tasks'])
KINDS = sorted(kind.__name__ for kind in _messages.Message.get_subclasses())
sent = st.one_of(
    fields(type=st.just('TransformControlsUpdateMessage'), name=gizmos, owner=st.just(''),
           wxyz=quaternions, position=vectors(3)),
    fields(type=st.sampled_from(['TransformControlsDragStartMessage',
                                 'TransformControlsDragEndMessage']), name=gizmos,
           owner=st.just('')),
    fields(type=st.just('ViewerCameraMessage'), wxyz=quaternions, position=vectors(3),
           fov=numbers, near=numbers, far=numbers, image_height=st.integers(-1, 3000),
           image_width=st.integers(-1, 3000), look_at=vectors(3), up_direction=vectors(3)),
    st.builds(lambda kind, content: {**content, 'type': kind}, st.sampled_from(KINDS),
              st.dictionaries(texts, values, max_size=4)))
inputs = st.tuples(st.integers(0, 60), st.one_of(
    st.fixed_dictionaries({'value': st.one_of(st.booleans(), numbers, texts)}),
    st.dictionaries(st.sampled_from(['value', 'disabled', 'visible', 'label', 'removed', 'gui_api',
                                     'update_cb', '__class__']), values, max_size=2)))


@tried('bytes')
@given(given=st.one_of(st.binary(max_size=60), st.tuples(
    sent, st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=4)), max_size=3)), values))
def test_any_bytes_are_a_message_or_dropped(number, given):
    if isinstance(given, tuple):
        message, changes = given
        raw = bytearray(msgspec.msgpack.encode(message))
        for place, piece in changes:
            start = int(place * len(raw))
            raw[start:start + len(piece)] = piece
        given = bytes(raw)
    taken = checked(given, MESSAGES, lambda identifier: None)
    if taken is not None:
        # What is taken is taken by viser, too, and says the same again.
        message = _messages.Message.deserialize(taken)
        assert checked(taken, MESSAGES, lambda identifier: None) == taken
        for part in vars(message).values():
            assert np.isfinite([each for each in part if isinstance(each, float)]).all() \
                if isinstance(part, tuple) else not isinstance(part, float) or math.isfinite(part)


@tried('browser')
@given(messages=st.lists(st.one_of(sent, inputs), min_size=1, max_size=4))
def test_the_page_goes_on_whatever_browsers_send(made_up, number, messages):
    made_up.page._errors.clear()
    widgets = list(made_up.server.gui._gui_input_handle_from_uuid)
    for message in messages:
        if isinstance(message, tuple):
            number, updates = message
            message = {'type': 'GuiUpdateMessage', 'uuid': widgets[number % len(widgets)],
                       'updates': updates}
        made_up.do(message)
    made_up.update()
    assert stop_works(made_up)
    button = made_up.page.stop_button
    assert not button.disabled and button.visible and button.label == 'Stop'
    for _, _, goal in made_up.client.sent:
        if isinstance(goal, PoseStamped):
            point, turn = goal.pose.position, goal.pose.orientation
            assert np.isfinite((point.x, point.y, point.z)).all()
            assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0)
        else:
            assert np.isfinite(goal.position).all()
    made_up.client.sent.clear()
    for gizmo in made_up.page.gizmos.gizmos.values():
        gizmo.end_drag()


# From the network


def goal(ns='tip/goal', size=0.1):
    """Return the marker of a goal."""
    found = Marker(ns=ns, type=Marker.SPHERE)
    found.scale.x = found.scale.y = found.scale.z = size
    found.color.a = 1.0
    return found


def spoilt(ns, number, kind, sizes, position, turn, colour, points, text):
    """Return a marker of any numbers."""
    found = Marker(ns=ns, id=number, type=kind, text=text)
    found.scale.x, found.scale.y, found.scale.z = sizes
    point, orientation = found.pose.position, found.pose.orientation
    point.x, point.y, point.z = position
    orientation.w, orientation.x, orientation.y, orientation.z = turn
    found.color = ColorRGBA(**dict(zip('rgba', colour)))
    found.points = [Point(x=x, y=y, z=z) for x, y, z in points]
    return found


plain_texts = texts.filter(lambda text: not any('\ud800' <= each <= '\udfff' or each == '\0'
                                                for each in text))
small = st.one_of(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(width=32))
triples = st.one_of(st.tuples(small, small, small), st.tuples(numbers, numbers, numbers))
markers = st.one_of(
    st.builds(goal, plain_texts, small),
    st.builds(spoilt, plain_texts, st.integers(0, 2), st.integers(-1, 12), triples, triples,
              st.one_of(st.just((1.0, 0.0, 0.0, 0.0)), st.tuples(*[numbers] * 4)),
              st.tuples(*[st.one_of(st.floats(0.0, 1.0, width=32), st.floats(width=32))] * 4),
              st.lists(triples, max_size=4), plain_texts))
tasks = st.dictionaries(st.one_of(st.sampled_from(['tip', 'b']), plain_texts), st.one_of(
    st.builds(lambda changes: {**TASK, **changes},
              st.dictionaries(st.one_of(st.sampled_from(list(TASK)), plain_texts), plain_texts,
                              max_size=3)),
    st.dictionaries(plain_texts, plain_texts, max_size=3)), max_size=3)
heard = st.one_of(
    st.tuples(st.just('/tp_controller/status'), st.builds(
        lambda head, tasks: status(head, **tasks), plain_texts, tasks)),
    st.tuples(st.just('/tp_controller/status'), st.just(DiagnosticArray())),
    st.tuples(st.just('/tp_controller/markers'), st.builds(
        lambda markers: MarkerArray(markers=markers), st.lists(markers, max_size=3))),
    st.tuples(st.just('/joint_states'), st.builds(
        lambda name, position, velocity: JointState(name=name, position=position,
                                                    velocity=velocity),
        st.one_of(st.just(JOINTS), st.lists(plain_texts, max_size=4)),
        st.lists(numbers, max_size=4), st.lists(numbers, max_size=4))))
damages = st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(max_size=4)), max_size=2)


def damaged(data, changes):
    """Return bytes of which pieces are replaced."""
    found = bytearray(data)
    for place, piece in changes:
        start = int(place * len(found))
        found[start:start + len(piece)] = piece
    return bytes(found)


@tried('network')
@given(messages=st.lists(
    st.tuples(heard, st.one_of(st.just([]), damages)), min_size=1, max_size=3))
def test_the_page_goes_on_whatever_the_network_says(made_up, number, messages):
    made_up.page._errors.clear()
    for (topic, message), changes in messages:
        made_up.hear(topic, damaged(serialize_message(message), changes))
        made_up.update()
    assert stop_works(made_up)
    shown = table({CONTROLLER: (made_up.client.status, 0.0)})
    assert shown.replace('\n', '').isprintable()
    drawn = made_up.page._robot.state.q
    assert np.isfinite(drawn).all()
    made_up.tell(tip=TASK)
    made_up.update()
    assert list(made_up.page.stack.rows) == ['tip'] and not made_up.page._errors


# Recordings


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Return the bytes of recordings, and where to write others."""
    folder = tmp_path_factory.mktemp('fuzz')
    path = recordings.write(folder / 'run', recordings.run(seconds=0.3))
    return (path / 'run.mcap').read_bytes(), folder / 'other.mcap', folder / 'report.html'


told = st.lists(st.one_of(
    st.tuples(st.just('/tp_controller/status'), st.builds(
        lambda head, tasks: recordings.status('tp_controller', head, **tasks), texts, tasks)),
    st.tuples(st.just('/joint_states'), st.builds(
        recordings.joint_state, st.lists(numbers, max_size=4),
        st.lists(plain_texts, max_size=4))),
    st.tuples(st.just('/commands'), st.builds(recordings.numbers, st.lists(numbers, max_size=4))),
    st.tuples(st.just('/tp_controller/tip/goal'), st.builds(
        recordings.point, numbers, numbers, numbers, plain_texts)),
    st.tuples(st.just('/robot_description'), st.builds(
        recordings.text, st.one_of(plain_texts, st.just(planar().urdf)))),
    st.tuples(st.just('/parameter_events'), st.builds(
        lambda values: recordings.parameters('tp_controller', **values),
        st.dictionaries(st.sampled_from(['stack', 'joints', 'base', 'limits__joint1__velocity']),
                        st.one_of(plain_texts, numbers, st.lists(plain_texts, max_size=3)),
                        max_size=2)))), max_size=4)


@tried('recording')
@given(given=st.one_of(told, st.lists(
    st.tuples(st.floats(0.0, 1.0), st.binary(max_size=12)), max_size=3)))
def test_any_recording_is_reported_or_refused(recorded, number, given):
    content, path, page = recorded
    if given and not isinstance(given[0][0], float):
        content = messages_of(given, path.parent)
    else:
        content = damaged(content, given)
    path.write_bytes(content)
    began = time.thread_time()
    try:
        bag = Bag(path)
        history = History(bag, '', lambda size: None)
        robot = recorded_robots.robot_of(history)
        if robot is not None:
            recorded_robots.configurations(history, robot)
            recorded_robots.tool_frames(history, robot)
    except TpControllerError as error:
        assert str(error)
    else:
        assert summary(history).replace('\n', '').isprintable()
        write_report(page, history, robot, [], title='a', remarks=bag.remarks, replay='')
    assert time.thread_time() - began < SOON


def messages_of(rows, folder):
    """Return the bytes of a recording of (topic, message)."""
    for path in sorted((folder / 'made').glob('*')):
        path.unlink()
    if (folder / 'made').exists():
        (folder / 'made').rmdir()
    recordings.write(folder / 'made', [(0.1 * number, topic, message)
                                       for number, (topic, message) in enumerate(rows)])
    return (folder / 'made' / 'made.mcap').read_bytes()


def test_tests_share_all_examples(number):
    assert sum(SHARES.values()) == 100

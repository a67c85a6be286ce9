# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Any input works, or ends in the error that is documented, within a second.

Hypothesis makes input of two kinds: what nobody would write, and what is nearly right. Tried are
10,000 examples in all, always the same ones; more, and others every time, with

    TP_FUZZ=1000000 python -m pytest test/faults/test_fuzz.py
"""

from contextlib import contextmanager
import gc
import json
import math
import os
import time

from hypothesis import example, given, HealthCheck, note, Phase, settings
from hypothesis import strategies as st
import numpy as np
import robots
from tp_controller import (
    Controller,
    GoalError,
    Robot,
    RobotError,
    Settings,
    SettingsError,
    Stack,
    StackError,
    TimeError,
)
from tp_controller.model.simulator import initial_positions
from tp_controller.model.srdf import srdf_pairs
from tp_controller.model.urdf_solids import urdf_solids
from tp_controller.resources import load_yaml
from tp_controller.ros.loop.joint_state_buffer import JointStateBuffer
from tp_controller.tasks import task_types
import yaml

DEFAULT = 10_000
EXAMPLES = int(os.environ.get('TP_FUZZ', DEFAULT))
# How many tests share them.
TESTS = 11
tried = settings(
    max_examples=EXAMPLES // TESTS, derandomize=EXAMPLES == DEFAULT, deadline=None, database=None,
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck))
# What an input may take, of the processor alone [s].
SOON = 1.0
ARM = (robots.CONFIG / 'robots' / 'two_arms.urdf').read_text()
STACKS = [path.read_text() for path in sorted(robots.CONFIG.glob('*stack.yaml'))]
TABLES = [path.read_text() for path in (robots.PANDA_DH, robots.PLANAR_DH)]
SRDF = '<robot name="arm"><disable_collisions link1="base" link2="tip" reason="Never"/></robot>'
# Three links with shapes, a passive joint, one that mimics and one that turns without end.
SMALL = """
<robot name="small">
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
    iyz="0"/></inertial></link>
  <link name="lower"><collision><origin xyz="0 0 0.1" rpy="0 0.1 0"/><geometry><cylinder
    radius="0.05" length="0.2"/></geometry></collision></link>
  <link name="tip"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit effort="1" velocity="2"/></joint>
  <joint name="bend" type="revolute"><origin xyz="0 0 0.3" rpy="1 0 0"/><parent link="upper"/>
    <child link="lower"/><limit lower="-2" upper="1.5" effort="1" velocity="1"
    acceleration="5"/></joint>
  <joint name="slide" type="prismatic"><origin xyz="0 0 0.3"/><parent link="lower"/>
    <child link="tip"/><axis xyz="1 0 0"/><limit lower="0" upper="0.3" effort="1" velocity="0.5"/>
    <mimic joint="bend" multiplier="0.1" offset="0.1"/></joint>
  <link name="side"/>
  <joint name="idle" type="revolute"><origin xyz="0.3 0 0"/><parent link="base"/>
    <child link="side"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""
ROBOT = Robot.from_urdf(SMALL, joints=['turn', 'bend'])
BASES = [Robot.from_urdf(SMALL, base, ['turn', 'bend']) for base in ('planar', 'floating')]
TYPES = task_types()
KEYS = sorted({key for kind in TYPES.values() for key in kind.accepted_keys()})

numbers = st.one_of(
    st.sampled_from([0, 1, -1, 0.1, 0.5, 2.0, 1e-3, 1e-300, 1e300, 10 ** 400, -0.0, math.inf,
                     math.nan]),
    st.floats(-2.0, 2.0), st.floats(), st.integers())
words = st.sampled_from([
    *ROBOT.frame_names, *ROBOT.joint_names, *KEYS, *TYPES, 'x', 'y', 'z', 'xyz', 'm', 'rad', '1',
    'scale', 'least_squares', 'least', '*', '', 'world', 'package://tp_controller/config/x',
    'box', 'sphere', 'cylinder', 'half_space', 'shape', 'at', 'lifetime', 'from', 'to', 'radius'])
scalars = st.one_of(words, numbers, st.none(), st.booleans(), st.text(max_size=6))
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4)
    | st.dictionaries(st.one_of(words, st.text(max_size=4)), inner, max_size=4), max_leaves=6)
vectors = st.lists(st.one_of(st.floats(-1.0, 1.0), numbers), max_size=8)
shapes = st.dictionaries(st.sampled_from(['box', 'sphere', 'cylinder', 'half_space']),
                         st.one_of(vectors, numbers, values), min_size=1, max_size=2)
places = st.fixed_dictionaries({'shape': st.one_of(shapes, values)},
                               optional={'at': st.one_of(vectors, values), 'lifetime': numbers})
capsules = st.fixed_dictionaries({'from': vectors, 'radius': numbers}, optional={'to': vectors})
anything = st.one_of(
    values, vectors, vectors.map(np.array), places, shapes,
    st.dictionaries(words, st.one_of(places, capsules, numbers, st.none()), max_size=3),
    st.builds(lambda rows: np.array([[0.0] * rows] * rows), st.integers(0, 5)))


given_values = st.one_of(scalars, vectors, values, shapes, places,
                         st.dictionaries(words, st.one_of(places, capsules), max_size=2))


def accepts(task_type):
    """Return a strategy for the keys of a type, nearly right."""
    # Most need some frame or the like.
    likely = {key: st.one_of(st.sampled_from(ROBOT.frame_names), scalars)
              for key in ('frame', 'reference') if key in task_type.accepted_keys()}
    others = st.dictionaries(st.sampled_from(sorted(task_type.accepted_keys())), given_values,
                             max_size=3)
    return st.builds(lambda keys, more: {**more, **keys}, st.fixed_dictionaries(likely), others)


tasks = st.one_of([
    st.builds(lambda kind, keys: {'type': kind, **keys}, st.just(kind), accepts(TYPES[kind]))
    for kind in sorted(TYPES)])
entries = st.dictionaries(st.one_of(st.sampled_from(['a', 'b', 'c']), words), tasks, min_size=1,
                          max_size=1)
stacks = st.lists(st.one_of(entries, st.lists(entries, max_size=2), values), max_size=3)

SNIPPETS = ['[', ']', '{', '}', ':', ': ', '- ', '&a ', '*a', '!!', '!!binary ', '!!set ', '|',
            '<<: ', '>', '"', "'", '\\', '#', '%', '? ', '\n', '\n  ', '\t', '\r', '\0', '\u2028',
            '\ufeff', '"\\ud800"', '---', '...', 'null', '.nan', '.inf', '-1e999', '1:1', '0x',
            '2001-1-1', '1_0', '=', '~', '<', '>', '</', '/>', '<!--', '-->', '<![CDATA[', '&amp;',
            '&#0;', '&x;', '<!DOCTYPE a>', '<?xml?>', '" ', ' a="', '<mimic joint="turn"/>',
            '<link name="base"/>', 'nan', 'inf', '-1', '1e400', '0', ' ', 'é', '𝕏', 'x' * 2000]
edits = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 40),
                           st.one_of(st.sampled_from(SNIPPETS), words, st.text(max_size=3))),
                 max_size=3)
texts = st.lists(st.one_of(st.sampled_from(SNIPPETS), words, st.text(max_size=3)),
                 max_size=15).map(''.join)


def edited(text, changes):
    """Return a text of which parts are replaced."""
    for place, length, snippet in changes:
        start = int(place * len(text))
        text = text[:start] + snippet + text[start + length:]
    return text


def near(originals):
    """Return a strategy for texts that are nearly one of those given."""
    return st.builds(edited, st.sampled_from(originals), edits)


@contextmanager
def only(*errors):
    """Let nothing pass but these errors, with a message that can be shown, soon."""
    # Hypothesis remembers every example: to go through that takes seconds. This may be nested.
    collects = gc.isenabled()
    gc.disable()
    began = time.thread_time()
    try:
        yield
    except errors as error:
        message = str(error)
        note(message[:500])
        assert message and len(message) <= 12_000
        # ROS and JSON take nothing else.
        message.encode()
        json.dumps(message)
    finally:
        taken = time.thread_time() - began
        if collects:
            gc.enable()
    assert taken < SOON


def carry_out(stack, robot=ROBOT):
    """Carry out a stack for three cycles, which must give velocities within the limits."""
    with only(SettingsError):
        controller = Controller(robot, stack)
        for cycle in range(3):
            command = controller.update(robot.neutral(), 0.01 * cycle)
            assert (np.abs(command.velocity) <= robot.velocity * (1.0 + 1e-9)).all()
        for report in command.report.tasks:
            assert report.status != 'failed' and isinstance(report.reason + report.hint, str)


# Texts


@tried
@given(st.one_of(texts, near(STACKS + TABLES)))
@example('!!python/object/apply:os.system [x]')
def test_any_text_is_yaml_or_none(text):
    with only(ValueError):
        load_yaml(text)


@tried
@given(st.one_of(texts, near(STACKS)))
def test_any_text_is_a_stack_or_none(text):
    with only(StackError):
        carry_out(Stack.from_yaml(text, ROBOT))


@tried
@given(stacks)
def test_any_tasks_are_a_stack_or_none(document):
    text = yaml.safe_dump(document)
    note(text)
    with only(StackError):
        carry_out(Stack.from_yaml('---\n' + text, ROBOT))


@tried
@given(st.one_of(near([SMALL, SMALL, ARM]), texts.map('<robot name="a">{}</robot>'.format), texts))
def test_any_text_is_a_urdf_or_none(text):
    with only(RobotError):
        robot = Robot.from_urdf(text)
        state = robot.state(robot.neutral())
        for frame in robot.frame_names:
            assert np.isfinite(state.pose(frame)).all()
            assert np.isfinite(state.jacobian(frame)).all()
        assert (robot.lower < robot.upper).all() and (robot.velocity >= 0.0).all()
        urdf_solids(text, robot.frame_names)


@tried
@given(st.one_of(texts, near([SRDF])))
def test_any_text_is_an_srdf_or_none(text):
    with only(ValueError):
        srdf_pairs('<' + text)


rows = st.fixed_dictionaries({'name': st.one_of(words, values)}, optional={
    **dict.fromkeys(('a', 'alpha', 'd', 'theta', 'lower', 'upper', 'velocity', 'acceleration'),
                    st.one_of(numbers, values)),
    'type': st.one_of(st.sampled_from(['revolute', 'prismatic', 'continuous']), values),
    'link': st.one_of(words, values)})
frames = st.fixed_dictionaries({'name': st.one_of(words, values)}, optional={
    'parent': st.one_of(words, values), 'xyz': st.one_of(vectors, values),
    'rpy': st.one_of(vectors, values)})
tables = st.one_of(
    st.lists(rows, max_size=3), values,
    st.fixed_dictionaries({'joints': st.lists(st.one_of(rows, values), max_size=3)}, optional={
        'frames': st.one_of(st.lists(frames, max_size=2), values),
        'root': st.one_of(words, values),
        'convention': st.one_of(st.sampled_from(['standard', 'modified']), values),
        'name': values}))
limits = st.dictionaries(
    st.one_of(st.sampled_from([*ROBOT.joint_names, 'base_x']), words),
    st.one_of(st.dictionaries(st.sampled_from(['lower', 'upper', 'velocity', 'acceleration']),
                              st.one_of(numbers, values)), values), max_size=2)


@tried
@given(st.one_of(tables, tables.map(yaml.safe_dump), near(TABLES)))
def test_any_table_is_a_robot_or_none(table):
    with only(RobotError):
        robot = Robot.from_dh(table)
        state = robot.state(robot.neutral())
        assert np.isfinite(state.jacobian(robot.frame_names[-1])).all()


# Values


@tried
@given(limits, st.one_of(st.none(), st.lists(words, max_size=3), values),
       st.one_of(st.sampled_from(['fixed', 'planar', 'differential', 'floating']), values),
       st.one_of(words, values))
def test_any_options_make_a_robot_or_none(limits, joints, base, world):
    with only(RobotError):
        robot = Robot.from_urdf(SMALL, base, joints, limits, world)
        frame, *_ = robot.frame_names[::-1]
        carry_out(Stack.from_yaml(f'- a: {{type: position, frame: {frame}}}', robot), robot)


@tried
@given(st.dictionaries(st.sampled_from([
    'period', 'damping', 'singular_region', 'braking_gain', 'release_region', 'scaling',
    'regularisation', 'reserve', 'blend', 'task_faults', 'task_budget', 'weights']),
    st.one_of(numbers, values, vectors, st.sampled_from(['uniform', 'stop']))),
    st.one_of(texts, near(['{turn: 0.5, bend: 0.1}', 'bend: 1\n']), values.map(yaml.safe_dump)))
def test_any_settings_and_positions_are_used_or_refused(keys, positions):
    with only(SettingsError):
        used = Settings(**keys)
        controller = Controller(ROBOT, Stack.from_yaml(
            '- tip: {type: pose, frame: tip}\n- rest: {type: posture}', ROBOT), used)
        controller.update([0.2, 0.3], 0.0)
        controller.set_goal('rest', [0.0, 0.1], 0.0)
        for cycle in range(3):
            velocity = controller.update([0.2, 0.3], 0.01 + 0.01 * cycle).velocity
            assert (np.abs(velocity) <= ROBOT.velocity * (1.0 + 1e-9)).all()
    with only(RobotError):
        assert np.isfinite(initial_positions(positions, ROBOT)).all()


GOALS = [
    '{type: obstacles}', '{type: field_of_view, frame: lower, half_angle: 1.0}',
    '{type: keep_in, frame: tip, shape: {sphere: 3.0}, at: [0, 0, 0]}',
    '{type: pose, frame: tip}', '{type: pose, frame: tip, reference: upper}',
    '{type: position, frame: tip, axes: xz}', '{type: orientation, frame: tip}',
    '{type: look_at, frame: tip, axis: [0, 0, 1]}',
    '{type: pointing, frame: tip, axis: z}',
    '{type: relative_position, frame: tip, reference: side}',
    '{type: center_of_mass}', '{type: twist, frame: tip}',
    '{type: joint_velocity}', '{type: joint, joints: [bend]}',
    '{type: manipulability, frame: tip, axes: xy}', '{type: posture}']
calls = st.tuples(
    st.sampled_from(['set_goal', 'set_goal', 'set_feed_forward', 'enable']),
    st.sampled_from(['goal'] * 6 + ['none', 3]), anything,
    st.one_of(st.just(0.0), st.just(0.0), numbers, values),
    st.one_of(st.none(), st.none(), st.sampled_from([*ROBOT.frame_names, 'nowhere']), values,
              st.just(np.eye(4))))


@tried
@given(st.sampled_from(GOALS), st.lists(calls, min_size=1, max_size=3),
       st.sampled_from([ROBOT, *BASES]))
def test_any_goal_is_followed_or_refused(task, calls, robot):
    controller = Controller(robot, Stack.from_yaml(f'- goal: {task}', robot))
    controller.update(robot.neutral(), 0.0)
    for call, name, goal, now, frame in calls:
        with only(GoalError):
            if call == 'enable':
                controller.enable(name, goal)
            else:
                getattr(controller, call)(name, goal, now, frame)
    with only():
        command = controller.update(robot.neutral(), 0.01)
        assert (np.abs(command.velocity) <= robot.velocity * (1.0 + 1e-9)).all()
        assert all(task.status for task in command.report.tasks)


@tried
@given(st.lists(st.tuples(
    st.one_of(vectors, st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2), anything),
    st.one_of(st.floats(0.0, 10.0), numbers, values),
    st.one_of(st.none(), numbers, vectors, values),
    st.one_of(st.none(), numbers, values)), min_size=1, max_size=3),
    st.sampled_from([ROBOT, *BASES]))
def test_any_state_gives_a_velocity_within_the_limits_or_is_refused(cycles, robot):
    controller = Controller(robot, Stack.from_yaml(
        '- tip: {type: position, frame: tip}\n- rest: {type: posture}', robot))
    for q, now, passive, elapsed in cycles:
        with only(RobotError, TimeError):
            velocity = controller.update(q, now, passive, elapsed).velocity
            assert (np.abs(velocity) <= robot.velocity * (1.0 + 1e-9)).all()
    with only():
        controller.update(robot.neutral(), 1.0)


names = st.lists(st.one_of(st.sampled_from(['turn', 'bend', 'idle', 'other']),
                           st.text(max_size=3)), max_size=4)
stamps = st.one_of(st.just(0.0), st.floats(0.0, 2.0 ** 32), st.floats(0.0, 20.0))


@tried
@given(st.lists(st.tuples(
    names, st.lists(st.one_of(st.floats(-4.0, 4.0), st.floats()), max_size=4),
    st.floats(0.0, 1e9), stamps, st.one_of(st.none(), stamps)), max_size=4),
    st.sampled_from([0.1, math.inf]))
def test_any_joint_states_leave_finite_positions_or_none(messages, late):
    buffer = JointStateBuffer(['turn', 'bend'], ['idle'], [0.0], np.array([2.0, 1.0]),
                              np.array([True, False]), late, 0.1)
    for message in messages:
        with only():
            assert isinstance(buffer.put(*message), str)
        known = np.array([*buffer.q, *buffer.passive])
        assert (np.abs(known[~np.isnan(known)]) <= 1e6).all()
        assert not np.isnan(buffer.passive).any()


def test_tests_share_all_examples():
    assert TESTS == sum(hasattr(test, 'hypothesis') for test in globals().values())

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The YAML stack: what it makes of good lists, and what it says about bad ones."""

from importlib.metadata import EntryPoint
import re

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import robots
from tp_controller import Level, Robot, Stack, StackError, tasks, TpControllerError
from tp_controller.tasks import Position, Task, task_types
from tp_controller.tasks.stack import shared_levels
import yaml

GOOD = """\
# the most important first
- limits: {type: joint, joints: joint1}
- [left: {type: position, frame: link2, axes: xy},
   right: {type: joint_velocity, joints: [joint3, joint2]}]
- posture:
    type: posture
    target: {joint2: 0.4}
    gain: 0.5
"""


def read(text, robot=None):
    """Return the stack of a text."""
    return Stack.from_yaml(text, robot or robots.planar())


def faults(text):
    """Return the faults of a text as (line, where, message)."""
    with pytest.raises(StackError) as caught:
        read(text)
    return [(fault.line, fault.where, fault.message) for fault in caught.value.faults]


def fault(text):
    """Return the only fault of a text."""
    found = faults(text)
    assert len(found) == 1, found
    return found[0]


# Good stacks

def test_tasks_come_in_order_of_priority_with_their_keys():
    stack = read(GOOD)
    assert list(stack.tasks) == ['limits', 'left', 'right', 'posture']
    assert [[task.name for task in group] for group in stack.groups] == [
        ['limits'], ['left', 'right'], ['posture']]
    assert stack.tasks['posture'].gain == 0.5
    assert stack.tasks['left'].axes == ('x', 'y')
    assert stack.tasks['right'].joints == ('joint3', 'joint2')


def test_each_entry_is_a_level_and_an_inner_list_shares_one():
    robot = robots.planar()
    stack, state = read(GOOD), robot.state(robots.PLANAR_START)
    stack.start(state)
    levels = stack.levels(state, 0.0)
    assert [level.J.shape for level in levels] == [(1, 3), (4, 3), (3, 3)]
    J = state.jacobian('link2')
    np.testing.assert_array_equal(levels[1].J, [*J[:2], [0, 0, 1], [0, 1, 0]])
    stack.tasks['right'].set_goal(np.array([5.0, 7.0]), 0.0)
    assert stack.levels(state, 0.0)[1].v.tolist() == [0.0, 0.0, 5.0, 7.0]


@pytest.mark.parametrize('text', ['[]', '[]\n', '# nothing yet\n[]\n'])
def test_empty_stack_is_a_stack(text):
    stack = read(text)
    assert stack.tasks == {} and stack.groups == ()
    assert stack.levels(robots.planar().state(robots.PLANAR_START), 0.0) == []


@pytest.mark.slow
def test_stack_is_read_from_a_file_by_path_and_from_text(tmp_path):
    file = tmp_path / 'stack.yaml'
    file.write_text(GOOD, encoding='utf-8')
    for source in (file, str(file), GOOD):
        assert list(read(source).tasks) == ['limits', 'left', 'right', 'posture']


def test_flow_style_on_one_line_is_text_not_a_file_name():
    assert list(read('[a: {type: posture}]').tasks) == ['a']


def test_anchors_and_merge_free_yaml_work_as_yaml_says():
    stack = read('- a: {type: posture, target: &goal {joint1: 0.2}}\n'
                 '- b: {type: posture, target: *goal}\n')
    assert stack.tasks['b'].goal[0] == 0.2


# Enabling

def test_disabled_task_is_left_out_until_it_is_enabled_again():
    stack, state = read(GOOD), robots.planar().state(robots.PLANAR_START)
    stack.start(state)
    stack.enable('left', False)
    stack.enable('posture', False)
    assert [level.J.shape[0] for level in stack.levels(state, 0.0)] == [1, 2]
    stack.enable('right', False)
    assert [level.J.shape[0] for level in stack.levels(state, 0.0)] == [1]
    assert stack.disabled == {'left', 'right', 'posture'}
    for name in ('left', 'right', 'posture'):
        stack.enable(name, True)
    assert [level.J.shape[0] for level in stack.levels(state, 0.0)] == [1, 4, 3]


def test_whole_stack_can_be_disabled():
    stack, state = read(GOOD), robots.planar().state(robots.PLANAR_START)
    for name in stack.tasks:
        stack.enable(name, False)
    assert stack.levels(state, 0.0) == []


# Faults

def test_all_faults_are_told_at_once_in_order_of_their_lines():
    found = faults("""\
- tool: {type: pose, frame: link9}
- elbow: {type: positon, frame: link2}
- wrist:
    type: position
    frame: link3
    gian: 2.0
    axes: xw
- tool: {type: posture}
- base: {type: joint, joints: [joint1, joint7], gain: -1}
- none: {frame: link3}
- short: {type: orientation}
- 2nd: {type: posture}
- just words
- [in: {type: posture, gain: fast}, other: {type: nothing}]
""")
    assert [(line, where) for line, where, _ in found] == [
        (1, 'tool, frame'), (2, 'elbow'), (6, 'wrist'), (7, 'wrist, axes'), (8, 'tool'),
        (9, 'base, joints'), (9, 'base, gain'), (10, 'none'), (11, 'short'), (12, ''), (13, ''),
        (14, 'in, gain'), (14, 'other')]
    messages = [message for _, _, message in found]
    for pattern, message in zip((
            "unknown frame 'link9'.*valid: base_link",
            "unknown type 'positon' .did you mean 'position'.*valid: .*joint, ",
            "unknown key 'gian' .did you mean 'gain'.*valid: type, ",
            'needs some of x, y, z',
            'the name is used already, in line 1',
            "unknown driven joint or group 'joint7'.*valid: joint1, joint2, joint3",
            'must be positive, got -1',
            'needs a type; valid types: see line 2',
            "needs the key 'frame': frame of the robot",
            'letters, digits or _',
            'a stack must be a list of',
            "needs a number.*'fast'",
            "unknown type 'nothing' .did you mean 'pointing'.*valid types: see line 2"), messages):
        assert re.search(pattern, message), (pattern, message)


@pytest.mark.parametrize('text, line, where, pattern', [
    ('', 0, '', 'no file'),
    ('- limits: joint_limits', 1, 'limits', 'mapping'),
    ('no/such/stack.yaml', 0, '', 'no file no/such/stack.yaml'),
    ('~no_such_user_here/stack.yaml', 0, '', 'no file'),
    ('\n', 1, '', 'a stack must be a list'),
    ('{}', 1, '', 'a stack must be a list'),
    ('\n\ntool: {type: pose}\n', 3, '', 'a stack must be a list'),
    ('- a: {type: posture}\n- b: {type: posture\n', 3, '', 'not valid YAML'),
    ('- a: \t{type: [\n', 1, '', 'not valid YAML'),
    ('- \x00\n', 1, '', 'not valid YAML'),
    ('- []\n', 1, '', 'at least one task'),
    ('- a: {type: posture}\n  b: {type: posture}\n', 1, '', 'a stack must be a list'),
    ('- {}\n', 1, '', 'a stack must be a list'),
    ('- a:\n  type: posture\n', 1, '', 'indent the keys of a by more than its name'),
    ('- a: {type:posture}\n', 1, 'a', "'type:posture' needs a blank after the colon"),
    ('- [[a: {type: posture}]]\n', 1, '', 'a stack must be a list'),
    ('- a:\n', 1, 'a', 'needs a mapping such as'),
    ('- a: posture\n', 1, 'a', 'needs a mapping such as'),
    ('- a: [type, posture]\n', 1, 'a', 'needs a mapping such as'),
    ('- a:\n    type: posture\n    gain: 1\n    gain: 2\n', 4, 'a, gain', 'given twice'),
    ('- a: {type: posture, type: joint}\n', None, 'a, type', 'given twice'),
    ('- a: {type: [pose]}\n', 1, 'a', 'unknown type ..pose'),
    ('- a: {type: null}\n', 1, 'a', 'unknown type None'),
    ('- a b: {type: posture}\n', 1, '', "not 'a b'"),
    ('- ünder: {type: posture}\n', 1, '', 'letters, digits'),
    ('- ? [a]\n  : {type: posture}\n', 1, '', 'the name of a task must be'),
    ('- a: {type: posture, ? [gain] : 1}\n', 1, 'a', 'a key must be a word'),
    ('- a: {type: posture, gain: 2001-13-45}\n', 1, 'a, gain', 'month'),
    ('- a: {type: posture, gain: !!int abc}\n', 1, 'a, gain', 'abc'),
    ('- a: {type: posture, gain: !!float ""}\n', 1, 'a, gain', '.'),
    ('- a: {type: posture, gain: !!timestamp abc}\n', 1, 'a, gain', '.'),
    ('- a: {type: posture, gain: !!python/object:os.system 1}\n', 1, 'a, gain', 'constructor'),
    ('- a: {type: posture, gain: !unknown 1}\n', 1, 'a, gain', 'constructor'),
    ('- a: {type: posture, gain: *x}\n', 1, '', 'not valid YAML: found undefined alias'),
    ('- a: {type: posture, target: {joint1: .nan}}\n', 1, 'a, target', 'finite'),
    ('- a: {type: posture, target: {[1]: 2}}\n', 1, 'a, target', 'unhashable'),
    ('- a: {type: posture, target: [1, [2], 3]}\n', 1, 'a, target', 'needs 3 numbers'),
    ('- a: {type: position, frame: [link3]}\n', 1, 'a, frame', 'unknown frame'),
    ('- a: {type: position, frame: {}}\n', 1, 'a, frame', 'unknown frame'),
    ('- a: {type: position, frame: link3, robot: x}\n', 1, 'a', "unknown key 'robot'"),
    ('- a: {type: position, frame: link3, name: x}\n', 1, 'a', "unknown key 'name'"),
    ('- a: {type: joint, joints: [[joint1]]}\n', 1, 'a, joints', 'unknown driven joint'),
    ('- a: {type: twist, frame: link3, gain: 1}\n', 1, 'a', "unknown key 'gain'"),
])
def test_fault_is_told_with_its_line_and_task(text, line, where, pattern):
    found = faults(text)
    assert any(re.search(pattern, message) and found_where == where and line in (None, found_line)
               for found_line, found_where, message in found), found


def test_missing_key_does_not_hide_a_wrong_one():
    assert [where for _, where, _ in faults('- a: {type: position, axes: q, gain: 0}\n')] == [
        'a', 'a, axes', 'a, gain']


def test_message_of_the_error_holds_every_fault_as_a_line_number_and_a_task():
    with pytest.raises(StackError, match='line 1: a: unknown type.*; line 2: b, gain: must be'):
        read('- a: {type: x}\n- b: {type: posture, gain: -1}\n')


PIECES = st.sampled_from([
    'a', 'b', 'type', 'frame', 'joints', 'gain', 'axes', 'target', 'pose', 'position', 'posture',
    'link3', 'joint1', 'xy', '', 1, -2.5, True, None, 10 ** 400, '2001-13-45', '<<', '='])
DOCUMENTS = st.recursive(
    PIECES, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(PIECES, inner, max_size=4),
    max_leaves=12)


@pytest.mark.slow
@given(st.lists(st.dictionaries(PIECES, DOCUMENTS, max_size=2), max_size=4) | DOCUMENTS)
def test_any_yaml_gives_a_stack_or_a_stack_error(document):
    try:
        read('---\n' + yaml.safe_dump(document))
    except StackError as error:
        assert error.faults and all(fault.line >= 1 for fault in error.faults)


@given(st.text(alphabet='-[]{}:,?!&*#|>%@\'"\n\t ab1.', max_size=40))
def test_any_text_gives_a_stack_or_a_stack_error(text):
    try:
        read(text + '\n')
    except StackError as error:
        assert error.faults


# Types of other packages

@pytest.fixture
def registry():
    """Give back the registry of types as it was, and have entry points looked up anew."""
    before = dict(Task.types)
    tasks._load_entry_points.cache_clear()
    yield
    Task.types.clear()
    Task.types.update(before)
    tasks._load_entry_points.cache_clear()


def test_type_that_another_package_adds_is_a_type_like_any_other(registry, monkeypatch, tmp_path):
    (tmp_path / 'other_package.py').write_text('''
from tp_controller.tasks import Position


class Hover(Position):
    """Stay above a point."""

    type_name = 'hover'
    keys = {'height': 'height above the goal [m]'}

    def __init__(self, robot, name, *, height, **keys):
        super().__init__(robot, name, **keys)
        self.height = height

    def error(self, state):
        return super().error(state) + [0.0, 0.0, self.height]
''', encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)

    def entry_points(group):
        assert group == 'tp_controller.tasks'
        return [EntryPoint('hover', 'other_package:Hover', group)]
    monkeypatch.setattr(tasks, 'entry_points', entry_points)
    assert 'hover' in task_types()
    stack = read('- h: {type: hover, frame: link3, height: 0.3, gain: 2}\n')
    state = robots.planar().state(robots.PLANAR_START)
    stack.start(state)
    assert stack.levels(state, 0.0)[0].v == pytest.approx([0.0, 0.0, 0.6])
    assert "needs the key 'height'" in fault('- h: {type: hover, frame: link3}\n')[2]
    assert "unknown key 'hight'" in faults('- h: {type: hover, frame: link3, hight: 1}\n')[0][2]
    described = task_types()['hover'].described_keys()
    assert described['height'] == 'height above the goal [m]'
    assert set(described) == {'height', *Position.accepted_keys()}


def test_level_that_a_type_makes_itself_is_used(registry):
    class Halved(Position):
        """A position that is approached at half the gain."""

        type_name = 'halved'

        def level(self, state, now):
            level = super().level(state, now)
            return Level(level.J, 0.5 * level.v, level.mode)

    class Slow(Halved):
        """The same by another name."""

        type_name = 'slow'

    robot = robots.planar()
    state = robot.state(robots.PLANAR_START)
    for kind in ('halved', 'slow'):
        stack = read(f'- tip: {{type: {kind}, frame: link3, axes: xy, gain: 3.0}}\n')
        task = stack.tasks['tip']
        task.set_goal(state.position('link3') + [0.2, -0.1, 0.0], 0.0)
        (evaluation,), = stack.evaluate(state, 0.0)
        assert evaluation.task is task
        assert evaluation.error == pytest.approx([0.2, -0.1])
        assert evaluation.level.v == pytest.approx([0.3, -0.15])
        assert stack.levels(state, 0.0)[0].v == pytest.approx([0.3, -0.15])


def test_package_whose_type_cannot_be_loaded_is_named(registry, monkeypatch):
    monkeypatch.setattr(tasks, 'entry_points', lambda group: [
        EntryPoint('hover', 'no_such_package:Hover', group)])
    with pytest.raises(TpControllerError, match='no_such_package:Hover.*No module'):
        task_types()


# One stack after another

def test_new_stack_inherits_the_goals_of_compatible_tasks():
    robot = robots.planar()
    old, new = read(GOOD), read("""\
- posture: {type: posture, gain: 2.0}
- left: {type: position, frame: link3, reference: link1}
- limits: {type: joint, joints: joint2}
- fresh: {type: joint, joints: joint1}
""")
    start, later = robot.state(robots.PLANAR_START), robot.state([1.0, 0.2, 0.1])
    old.start(start)
    old.tasks['limits'].set_goal(np.array([0.7]), 0.0)
    old.enable('left', False)
    new.inherit_goals(old)
    new.start(later)
    # The goal of joint 2 was 0.4 in the old stack; for the others it was the first position.
    assert new.tasks['posture'].goal == pytest.approx([0.0, 0.4, 0.3])
    # Another reference frame, or other joints: not the same task any more.
    np.testing.assert_allclose(new.tasks['left'].error(later), 0.0, atol=1e-12)
    np.testing.assert_allclose(new.tasks['limits'].error(later), 0.0, atol=1e-12)
    np.testing.assert_allclose(new.tasks['fresh'].error(later), 0.0, atol=1e-12)
    assert new.disabled == {'left'}


SHARED = """\
- limits: {type: joint_limits, joints: joint1}
- [tip: {type: position, frame: link3, axes: xy, gain: [1, 2]},
   turn: {type: orientation, frame: link3, axes: z}]
- point: {type: pointing, frame: link2, axis: x, towards: point, target: [2.0, 1.0, 0.0]}
- posture: {type: posture}
"""


@pytest.mark.parametrize('old, new, levels', [
    ('', '', 4),
    # What is the default may be written down, and some keys have no effect.
    ('posture}', 'posture, gain: 1.0, mode: least_squares}', 4),
    ('posture}', 'posture, tolerance: 0.1, timeout: 2.0}', 4),
    # A task may be called otherwise, but then it has another goal.
    ('limits:', 'range:', 4),
    ('point:', 'aim:', 4),
    ('turn:', 'orientation:', 1),
    ('posture:', 'rest:', 3),
    ('posture}', 'posture, gain: 2.0}', 3),
    ('posture}', 'posture, target: {joint1: 0.5}}', 3),
    ('posture}', 'posture, joints: [joint1, joint2]}', 3),
    ('[2.0, 1.0, 0.0]', '[2.0, 1.1, 0.0]', 2),
    ('axis: x', 'axis: y', 2),
    ('[1, 2]', '[1, 3]', 1),
    (',\n   turn: {type: orientation, frame: link3, axes: z}]', ']', 1),
    ('axes: xy', 'axes: yz', 1),
    ('link3, axes: z', 'link2, axes: z', 1),
    ('link3, axes: z', 'link3, axes: z, reference: link1', 1),
    ('joints: joint1', 'joints: joint2', 0),
    ('joint1}', 'joint1, margin: 0.1}', 0),
    ('- limits: {type: joint_limits, joints: joint1}\n', '', 0),
])
def test_levels_are_shared_down_to_the_first_task_that_demands_something_else(old, new, levels):
    robot = robots.planar()
    limited = Robot.from_file(robots.PLANAR_DH, limits={
        name: {'lower': -3.0, 'upper': 3.0} for name in robot.joint_names})
    before, after = read(SHARED, limited), read(SHARED.replace(old, new, 1), limited)
    state = limited.state(robots.PLANAR_START)
    before.start(state)
    after.inherit_goals(before)
    assert shared_levels(before.active, after.active) == levels
    # And so it is with the levels themselves, at once and later on.
    after.start(state)
    for position in (robots.PLANAR_START, [0.3, -0.4, 0.9]):
        pairs = list(zip(before.levels(limited.state(position), 0.0),
                         after.levels(limited.state(position), 0.0)))[:levels]
        for one, other in pairs:
            for name in ('J', 'v', 'lower', 'upper'):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_level_with_another_goal_velocity_or_time_or_of_another_robot_is_not_shared():
    state = robots.planar().state(robots.PLANAR_START)

    text = SHARED.partition('\n')[2]
    before, after = read(text), read(text)
    before.start(state)
    after.inherit_goals(before)
    assert shared_levels(before.active, after.active) == 3
    after.tasks['posture'].set_goal(np.array([0.0, 0.6, 0.3]), 0.0)
    assert shared_levels(before.active, after.active) == 3
    after.tasks['posture'].set_goal(np.array([0.0, 0.6, 0.4]), 0.0)
    assert shared_levels(before.active, after.active) == 2
    after.enable('posture', False)
    assert shared_levels(before.active, after.active) == 2
    after.tasks['tip'].set_feed_forward(np.ones(6), 0.0)
    assert shared_levels(before.active, after.active) == 0
    before.tasks['tip'].set_feed_forward(np.ones(6), 0.0)
    assert shared_levels(before.active, after.active) == 2
    before.tasks['tip'].set_feed_forward(np.full(6, 2.0), 0.0)
    assert shared_levels(before.active, after.active) == 0
    before.tasks['tip'].set_feed_forward(np.ones(6), 0.1)
    assert shared_levels(before.active, after.active) == 0
    assert shared_levels(before.active, before.active) == 3
    other = read(text, Robot.from_file(robots.PLANAR_DH))
    other.inherit_goals(before)
    assert shared_levels(before.active, other.active) == 0


# {type: (keys, goal, velocity)}
VELOCITIES = {
    'twist': ('frame: link3', [0.1, 0.2, 0.0, 0.0, 0.0, 0.3], None),
    'joint_velocity': ('joints: [joint3, joint1]', [0.4, -0.2], None),
    'position': ('frame: link3, axes: xy', [0.8, 0.4, 0.0], [0.1, 0.2, 0.0, 0.0, 0.0, 0.3]),
    'orientation': ('frame: link3, axes: z', [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.3]),
    'joint': ('joints: joint2', [0.2], [0.3]),
    'posture': ('gain: 2.0', None, [0.3, 0.2, 0.1]),
    'pointing': ('frame: link3, axis: x', [0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.3]),
    'keep_out': ('frame: link3, shape: {sphere: 0.2}',
                 [0.5, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0], [0.1, 0.2, 0.0, 0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize('kind', VELOCITIES)
def test_velocity_in_force_is_kept_as_the_goal_is_and_times_out_when_it_would_have(kind):
    keys, goal, velocity = VELOCITIES[kind]
    text = f'- task: {{type: {kind}, {keys}, timeout: 0.5}}\n'
    before, after, fresh = read(text), read(text), read(text)
    state = robots.planar().state(robots.PLANAR_START)
    before.start(state)
    task = before.tasks['task']
    if goal is not None:
        task.set_goal(task.parse_goal(goal), 7.0)
    if velocity is not None:
        task.set_feed_forward(task.parse_feed_forward(velocity), 7.0)
    after.inherit_goals(before)
    assert shared_levels(before.active, after.active) == 1
    fresh.tasks['task'].goal = task.goal
    for now, moves in ((7.3, True), (7.49, True), (7.51, False), (7.2, False)):
        kept, still, expected = (stack.levels(state, now)[0] for stack in (after, fresh, before))
        name = 'lower' if kept.v is None else 'v'
        np.testing.assert_array_equal(getattr(kept, name), getattr(expected, name))
        assert np.array_equal(getattr(kept, name), getattr(still, name)) != moves


def test_velocity_is_not_kept_by_a_task_with_a_goal_or_joints_of_its_own():
    state = robots.planar().state(robots.PLANAR_START)
    before = read('- a: {type: joint, joints: [joint1, joint2]}\n'
                  '- b: {type: joint_velocity, joints: joint1}\n'
                  '- c: {type: joint, joints: joint3}\n')
    before.start(state)
    for name, size in (('a', 2), ('c', 1)):
        before.tasks[name].set_feed_forward(np.ones(size), 0.0)
    before.tasks['b'].set_goal(np.ones(1), 0.0)
    after = read('- a: {type: joint, joints: [joint1, joint2], target: {joint2: 0.5}}\n'
                 '- b: {type: joint_velocity, joints: joint2}\n'
                 '- c: {type: joint, joints: joint3, target: [0.3]}\n')
    after.inherit_goals(before)
    after.start(state)
    a, b, c = (level.v for level in after.levels(state, 0.1))
    assert a == pytest.approx([1.0, 0.5 - 0.6]) and b == [0.0] and c == [0.0]


def test_velocity_goes_on_in_the_rows_that_the_new_task_is_about():
    state = robots.planar().state(robots.PLANAR_START)
    before, after = read('- t: {type: twist, frame: link3}\n'), read(
        '- t: {type: twist, frame: link3, axes: [rz, x]}\n')
    before.start(state)
    before.tasks['t'].set_goal(np.arange(6.0), 0.0)
    after.inherit_goals(before)
    assert after.levels(state, 0.1)[0].v.tolist() == [0.0, 5.0]


def test_turn_goes_on_the_same_way_round_in_the_next_stack():
    robot = robots.planar()
    text = '- turn: {type: orientation, frame: link3, axes: z}\n'
    before, after = read(text), read(text)
    turn = before.tasks['turn']
    turn.set_goal(robot.state([0.0, 0.0, 0.0]).rotation('link3').copy(), 0.0)
    for angle in (3.1, 3.2):
        (evaluation,), = before.evaluate(robot.state([angle, 0.0, 0.0]), 0.0)
    assert evaluation.error == pytest.approx([-3.2])
    after.inherit_goals(before)
    (evaluation,), = after.evaluate(robot.state([3.2, 0.0, 0.0]), 0.0)
    assert evaluation.error == pytest.approx([-3.2])


# Found by trying to break it


def test_numbers_with_an_exponent_are_numbers():
    task = read('- j: {type: joint, joints: joint1, gain: 1e1, tolerance: 2e-3, timeout: 1.5E0}\n'
                ).tasks['j']
    assert (task.gain, task.timeout) == (10.0, 1.5)
    assert task.groups[0][2] == 2e-3


def test_types_are_listed_once_however_many_tasks_have_none():
    with pytest.raises(StackError) as error:
        Stack.from_yaml('- a: {}\n- b: {type: poze}\n- c: {type: 3}\n', robots.planar())
    first, second, third = map(str, error.value.faults)
    assert first.startswith('line 1: a: needs a type; valid: base_orientation, base_pose, ')
    assert second == ("line 2: b: unknown type 'poze' (did you mean 'pose'?); "
                      'valid types: see line 1')
    assert third == 'line 3: c: unknown type 3; valid types: see line 1'


@pytest.mark.parametrize('source, told', [
    ('no/such/stack.yaml', 'no file no/such/stack.yaml'), ('', 'no file: its name is empty'),
    ('package://tp_controler/config/demo_stack.yaml',
     "package 'tp_controler' (did you mean 'tp_controller'?) is not found: it is not installed, "
     'its workspace is not sourced, and it is in no folder of ROS_PACKAGE_PATH')])
def test_a_stack_without_a_text_has_no_lines(source, told):
    with pytest.raises(StackError) as error:
        Stack.from_yaml(source, robots.planar())
    assert str(error.value) == told


@pytest.mark.slow
def test_yaml_that_is_nested_without_end_is_a_fault():
    assert 'nested too deeply' in fault('- j: {type: joint, gain: ' + 3000 * '[')[2]


def test_name_that_is_too_long_for_a_topic_is_a_fault():
    assert 'at most 64' in fault(f'- {"x" * 65}: {{type: posture}}\n')[2]
    assert read(f'- {"x" * 64}: {{type: posture}}\n').tasks


def test_merge_keys_are_named_as_not_supported():
    found = faults('- a: &a {type: joint, joints: joint1}\n- b: {<<: *a, gain: 2}\n')
    assert any('<<' in message for _, _, message in found)


def test_tasks_that_share_a_level_need_the_same_mode():
    text = ('- [a: {type: position, frame: link3, mode: scale},\n'
            '   b: {type: joint, joints: joint1}]\n')
    assert 'need the same mode, not least_squares and scale' in fault(text)[2]
    assert read(text.replace('joint1', 'joint1, mode: scale')).groups[0][1].mode == 'scale'


HUGE = '0x' + 'f' * 5000


@pytest.mark.parametrize('keys', [
    'pointing, frame: link3, towards: []', 'pointing, frame: link3, towards: {}',
    'self_collision, srdf: true', 'self_collision, srdf: 1', 'position, frame: {[1]: 2}',
    'keep_out, frame: link3, shape: {[1]: 2}',
    'field_of_view, frame: link3, half_angle: {[1]: 2}', HUGE,
    f'position, frame: link3, gain: {HUGE}', 'look_at, frame: link3, target: link3'])
def test_odd_values_are_faults_of_the_stack_and_nothing_else(keys):
    with pytest.raises(StackError):
        Stack.from_yaml(f'- task: {{type: {keys}}}\n', robots.planar())

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What a recording says happened is what was written into it."""

import math

import numpy as np
import pytest
import recordings
from tp_controller import TpControllerError
from tp_controller.ros.client.status import TaskStatus
from tp_controller.tools.recording.goals import Goal, Goals, outcome
from tp_controller.tools.recording.history import History, nearest
from tp_controller.tools.recording.motion import MOST_FRAMES
from tp_controller.tools.recording.pictures import command_topic
from tp_controller.tools.recording.reader import Bag
from tp_controller.tools.recording.report import summary
from tp_controller.tools.recording.robots import configurations, path_of, robot_of, tool_frames
from tp_controller.tools.recording.task_curves import TaskCurves


def history_of(path, node=''):
    """Return what happened in a recording."""
    return History(Bag(path), node, lambda size: None)


@pytest.fixture(scope='module')
def run(tmp_path_factory):
    """Return what happened in the run of the planar arm."""
    return history_of(recordings.write(tmp_path_factory.mktemp('bags') / 'run',
                                       recordings.run()))


def test_errors_and_tasks_are_those_of_the_status(run):
    assert run.node == 'tp_controller' and run.end == pytest.approx(3.98)
    assert list(run.tasks) == ['tool', 'posture']
    tool, posture = run.tasks['tool'], run.tasks['posture']
    assert tool.status == 'reached' and tool.errors == {'m': (0.0, 0.001)}
    assert tool.largest == {'m': 1.0} and posture.largest == {'rad': 0.25}
    times, values = run.curves.errors.rows()
    column = values[:, run.curves.columns['tool', 'm']]
    np.testing.assert_allclose(column, np.maximum((2.0 - times) / 2.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(times, np.arange(0.0, 4.0, 0.1), atol=1e-9)


def test_a_stop_at_the_end_does_not_hide_what_was_reached(tmp_path):
    states = [('moving', 0.5)] * 10 + [('reached', 0.0004)] * 10 + [('stopped', math.nan)] * 5
    found = history_of(recordings.write(tmp_path / 'run', [
        (0.1 * number, '/tp_controller/status', recordings.status(
            'tp_controller', 'running' if state != 'stopped' else 'ended by SIGINT',
            tool=recordings.task(error, state)))
        for number, (state, error) in enumerate(states)]))
    tool = found.tasks['tool']
    assert (tool.status, tool.stopped, tool.errors) == ('reached', True, {'m': (0.0004, 0.001)})
    assert tool.reached == pytest.approx(1.0)
    assert 'reached, then stopped' in summary(found) and '0.0004 m' in summary(found)
    # Lines are interrupted all the same.
    assert np.isnan(found.curves.errors.rows()[1][-5:]).all()


def test_durations_are_those_between_messages(run):
    tool, posture = run.tasks['tool'], run.tasks['posture']
    assert tool.known == pytest.approx(3.9) and tool.reached == pytest.approx(1.9)
    # It was told that it is blocked at all times but two, when the robot was stopped.
    assert posture.causes == {'blocked by tool': pytest.approx(3.7)}


def test_lines_of_errors_are_interrupted_where_the_controller_was_stopped():
    curves = TaskCurves()
    curves.add(0.0, {'tool': ({'m': 0.5, 'rad': 0.0}, ('b', 'a'))})
    curves.add(1.0, {})
    curves.add(2.0, {'tool': ({'m': 0.25}, ())})
    times, ((name, unit, errors),), causes = curves.plotted()
    assert (name, unit, list(times)) == ('tool', 'm', [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(errors, [0.5, np.nan, 0.25])
    assert causes == {'tool': [('a', 'b'), (), ()]}


def test_goals_are_told_with_what_became_of_them(run):
    first, second = run.goals.goals
    assert (first.task, first.text, first.time) == ('tool', 'xyz 0.4 0.2 0', 0.5)
    assert first.accepted and first.reached == pytest.approx(2.0)
    assert outcome(first, None, run.end) == 'reached after 1.5 s'
    assert outcome(second, None, run.end) == 'refused: not finite'
    # The task is at its goal before.
    assert second.reached == math.inf


def test_stops_are_told_with_their_reasons(run):
    stop, = run.stops.stops
    assert stop.reason == 'stopped by ~/stop'
    assert (stop.start, stop.end) == (pytest.approx(1.0), pytest.approx(1.2))


def test_commands_and_positions_are_those_that_were_published(run):
    times, velocities = run.commands['/velocity_controller/commands'].rows()
    assert velocities.shape == (200, 3)
    np.testing.assert_allclose(velocities[:, 0], np.where(times < 2.0 - 1e-9, 0.1, 0.0))
    assert run.motion.ranges == {
        'joint1': (0.0, pytest.approx(0.2)), 'joint2': (0.6, 0.6), 'joint3': (0.3, 0.3)}


def test_robot_is_the_one_of_the_recording_with_its_limits(run):
    robot = robot_of(run)
    assert robot.joint_names == recordings.JOINTS
    assert robot.velocity[0] == 0.2 and robot.velocity[1] != 0.2
    times, q, passive, _ = configurations(run, robot)
    np.testing.assert_allclose(q[:, 0], 0.1 * np.minimum(times, 2.0), atol=1e-9)
    assert tool_frames(run, robot) == {'tool': 'link3'}
    path = path_of(robot, 'link3', q, passive)
    np.testing.assert_allclose(path[-1], robot.state([0.2, 0.6, 0.3]).position('link3'))
    assert np.linalg.norm(path[0] - path[-1]) > 0.1


def test_a_controller_in_a_namespace_is_found_among_several(tmp_path):
    both = sorted([*recordings.run('left/arm'), *recordings.run('right/arm', seconds=2.0)],
                  key=lambda row: row[0])
    path = recordings.write(tmp_path / 'run', both)
    with pytest.raises(TpControllerError, match='several controllers.*left/arm, right/arm'):
        history_of(path)
    with pytest.raises(TpControllerError, match="unknown controller 'arm'.*left/arm"):
        history_of(path, 'arm')
    found = history_of(path, '/right/arm')
    assert found.tasks['tool'].known == pytest.approx(1.9)
    assert robot_of(found).joint_names == recordings.JOINTS
    assert nearest(list(found.commands), ['velocity_controller/commands'],
                   found.namespace) == '/right/velocity_controller/commands'


def test_a_renamed_topic_is_found(tmp_path):
    path = recordings.write(tmp_path / 'run', (
        (time, topic.replace('velocity_controller/commands', 'arm/velocities'), message)
        for time, topic, message in recordings.run()))
    assert list(history_of(path).commands) == ['/arm/velocities']


def test_commanded_positions_are_no_velocities(tmp_path):
    path = recordings.write(tmp_path / 'run', (
        (time, topic.replace('velocity_controller', 'position_controller'), message)
        for time, topic, message in recordings.run()))
    assert command_topic(history_of(path)) == ''


def test_other_messages_of_the_same_types_are_left_alone(tmp_path):
    other = [(0.1, '/camera/status', recordings.status('camera')),
             (0.1, '/diagnostics', recordings.status('tp_controller', 'wrong')),
             (0.2, '/tp_controller/tool/numbers', recordings.numbers([1.0])),
             (0.2, '/tp_controller/posture/goal', recordings.joint_state((9.0, 9.0, 9.0)))]
    other[0][2].status[0].values = []
    found = history_of(recordings.write(tmp_path / 'run', [*other, *recordings.run()]))
    assert found.node == 'tp_controller' and len(found.stops.stops) == 1
    assert list(found.commands) == ['/velocity_controller/commands']
    assert max(high for _, high in found.motion.ranges.values()) < 1.0
    assert any(goal.task == 'posture' for goal in found.goals.goals)


def test_nonsense_is_counted_and_the_rest_is_told(tmp_path):
    word = recordings.status('tp_controller', tool=recordings.task('much'))
    wrong = recordings.parameters('tp_controller', base='fixed')
    wrong.new_parameters[0].value.type = 200
    bag = Bag(recordings.write(tmp_path / 'run', [
        *recordings.run(), (5.0, '/tp_controller/status', word),
        *[(5.0, '/parameter_events', wrong)] * 2]))
    found = History(bag, '', lambda size: None)
    times, errors = found.curves.errors.rows()
    assert found.tasks['tool'].status and len(times) == 41
    assert np.isnan(errors[-1]).all() and not np.isnan(errors[-2]).all()
    assert '2 messages of /parameter_events could not be read' in bag.remarks


@pytest.mark.slow
def test_a_long_recording_has_no_more_moments_than_a_short_one(tmp_path):
    path = recordings.write(tmp_path / 'run', (
        (step / 25.0, '/joint_states', recordings.joint_state((step, 0.0, 0.0)))
        for step in range(5 * MOST_FRAMES)))
    moments = history_of(path).motion.moments
    assert MOST_FRAMES <= len(moments) < 2 * MOST_FRAMES
    steps = np.diff([moment.time for moment in moments])
    assert steps.max() < 1.6 * steps.min() and moments[0].time == 0.0
    assert all(moment.joints['joint1'] == pytest.approx(25.0 * moment.time)
               for moment in moments)


def answer(goals, time, accepted=0, refused=0, state='moving', refusal=''):
    """Tell what the status of the task says."""
    goals.add_status(time, TaskStatus('tool', status=state, accepted=accepted, refused=refused,
                                      refusal=refusal))


def came(goals, time):
    """Tell that a goal came."""
    point = recordings.point(1.0, 2.0, 3.0)
    goals.add_message(time, 'tool', 'geometry_msgs/msg/PointStamped', point)


def test_a_goal_whose_message_is_missing_is_told_too():
    goals = Goals()
    answer(goals, 0.0, accepted=7)
    answer(goals, 1.0, accepted=8)
    goal, = goals.goals
    assert goal.accepted and goal.time == 1.0 and 'not recorded' in goal.text


def test_what_was_sent_before_the_recording_is_not_told():
    goals = Goals()
    answer(goals, 0.0, accepted=7, refused=3, state='reached')
    assert not goals.goals


def test_a_stream_of_goals_is_told_as_one():
    goals = Goals()
    answer(goals, 0.0)
    for step in range(100):
        came(goals, 1.0 + 0.02 * step)
        answer(goals, 1.01 + 0.02 * step, accepted=step + 1)
    came(goals, 9.0)
    stream, last = goals.goals
    assert (stream.count, stream.last) == (100, pytest.approx(2.98)) and stream.accepted
    assert outcome(stream, last, 20.0) == 'replaced after 6.0 s, before it was reached'
    assert outcome(last, None, 20.0) == 'no answer was recorded'


def test_a_task_that_was_at_its_last_goal_has_not_reached_the_next_one_yet():
    goals = Goals()
    answer(goals, 0.0, state='reached')
    came(goals, 1.0)
    answer(goals, 1.1, state='reached')
    assert goals.goals[0].reached == math.inf
    answer(goals, 1.2, accepted=1, state='moving')
    answer(goals, 2.0, accepted=1, state='reached')
    answer(goals, 3.0, accepted=1, state='reached')
    assert goals.goals[0].reached == 2.0


def test_a_controller_that_was_started_anew_counts_anew():
    goals = Goals()
    answer(goals, 0.0, accepted=9)
    came(goals, 1.0)
    answer(goals, 1.1, accepted=1)
    assert goals.goals[0].accepted


@pytest.mark.parametrize(('goal', 'text'), [
    (Goal(1.0, 1.0, 'tool', '', answer='accepted', reached=3.5), 'reached after 2.5 s'),
    (Goal(1.0, 1.0, 'tool', '', answer='accepted'), 'not reached within 9.0 s'),
    (Goal(1.0, 1.0, 'tool', '', answer='refused: no'), 'refused: no')])
def test_what_became_of_a_goal_is_told_in_words(goal, text):
    assert outcome(goal, None, 10.0) == text

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes of a lecture: their numbers beside formulas and geometry."""

import math

import numpy as np
from PIL import Image
import pytest
from robots import REPOSITORY
from scipy.spatial.transform import Rotation
from tp_controller.tools.demos import scene as scene_module
from tp_controller.tools.demos.motion import Playback
from tp_controller.tools.demos.scene import Check, play
from tp_controller.tools.demos.scenes import SCENES


@pytest.fixture(scope='module')
def played(tmp_path_factory):
    """Return a function of a name: {scene, runs, outcome, film} of the scene, each once."""
    done = {}

    def play_once(name):
        if name not in done:
            scene, films = SCENES[name](), []
            runs = scene.runs()
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(scene_module, 'films', lambda path, film: films.append(film) or ())
                patch.setattr(scene_module.Scene, 'runs', lambda self: runs)
                outcome = play(name, scene, tmp_path_factory.mktemp(name))
            done[name] = {'scene': scene, 'runs': runs, 'outcome': outcome, 'film': films[0]}
        return done[name]

    return play_once


def within(run, since, until=math.inf):
    """Return which samples of a run are between two times [s]."""
    return (run.times >= since) & (run.times < until)


@pytest.mark.slow
@pytest.mark.parametrize('name', SCENES)
def test_every_scene_comes_out_with_question_and_answer(played, name):
    scene, outcome = played(name)['scene'], played(name)['outcome']
    assert outcome.passed, str(outcome)
    text = ' '.join(str(outcome).split())
    assert f'Question: {scene.question}' in text and f'Answer: {scene.answer}' in text
    path, = outcome.paths
    with Image.open(path) as picture:
        assert np.asarray(picture.convert('L')).std() > 10.0
    assert {check.variant for check in scene.checks} == set(scene.variants)


@pytest.mark.slow
@pytest.mark.parametrize('name', SCENES)
def test_film_shows_the_first_run_with_its_goals(played, name):
    film, runs = played(name)['film'], played(name)['runs']
    assert film.q is next(iter(runs.values())).q
    playback = Playback(film)
    playback.seek(len(film.times) - 1)
    assert any(playback.sketches().values())
    assert film.caption(0)


@pytest.mark.slow
@pytest.mark.parametrize('name', SCENES)
def test_documented_figures_are_the_ones_printed(played, name):
    documented = (REPOSITORY / 'docs' / 'lab.md').read_text(encoding='utf-8').splitlines()
    lines = played(name)['outcome'].lines
    table = lines[1:lines.index('', 1)]
    assert len(table) > 2
    for line in table:
        assert line.rstrip() in documented, line


def test_five_joints_reach_places_and_keep_the_object_on_the_line_of_sight(played):
    run = played('camera')['runs']['direction']
    goals = ([0.2, -0.1, 0.2], [0.22, 0.0, 0.25], [0.19, 0.1, 0.2], [0.2, 0.0, 0.17])
    state = run.robot.state(run.q[0])
    for q, now in zip(run.q, run.times):
        state.update(q)
        way = np.array([0.27, 0.0, 0.0]) - state.position('camera')
        turn = Rotation.align_vectors(way[np.newaxis], state.rotation('camera')[:, 2:].T)[0]
        if now >= 3.0:
            assert turn.magnitude() < math.radians(0.1)
        if now % 4.0 > 3.8:
            assert np.linalg.norm(state.position('camera') - goals[int(now / 4.0)]) < 1e-3
    assert run.robot.n == 5


def test_an_upright_picture_costs_the_place_only_where_it_is_a_sixth_demand(played):
    run = played('camera')['runs']['upright']
    at_ends = [run.errors['place'][within(run, 4.0 * step + 3.9, 4.0 * step + 4.0)].max()
               for step in range(4)]
    # Aside of the plane of the arm, and in it.
    assert min(at_ends[0], at_ends[2]) > 0.09 and max(at_ends[1], at_ends[3]) < 1e-3
    up = run.values(lambda state: state.rotation('camera')[:, 1])
    sight = run.values(lambda state: state.rotation('camera')[:, 2])
    # The axis y stays in the vertical plane of the line of sight.
    normal = np.cross(sight, [0.0, 0.0, 1.0])
    assert np.abs((up * normal).sum(axis=1))[within(run, 3.0)].max() < 0.01


def test_bands_are_where_bounds_change_the_motion(played):
    found = played('bounds')
    run, scene = found['runs']['bounds'], found['scene']
    joints = np.array(run.active('joints'))
    # Joint 4 stands at its margin of 0.75 rad as long as it is in the way, and not before.
    margin = run.q[:, 3] - run.robot.lower[3] - 0.75
    assert margin.min() > -1e-6
    assert margin[joints & within(run, 6.0, 8.0)].max() < 1e-3
    assert margin[within(run, 0.0, 4.5)].min() > 0.1 and not joints[within(run, 0.0, 4.5)].any()
    clear = np.array(run.active('clear'))
    distance = scene.curves['distance from the ball'].values(run)
    assert distance.min() > 0.03 - 1e-6
    assert np.abs(distance[within(run, 14.0)] - 0.03).max() < 1e-3
    assert clear[within(run, 12.1)].all() and not clear[within(run, 1.0, 8.0)].any()
    # Where no band is the bounds might as well be missing: the tool obeys its demand.
    # A second after a new goal the acceleration limits are no longer in the way.
    free = ~joints & ~clear & (run.times % 4.0 > 1.0)
    for sample in np.flatnonzero(free)[::20]:
        tool = run.reports[sample].tasks[2]
        assert tool.achieved_speed == pytest.approx(tool.demanded_speed, rel=1e-3, abs=1e-4)


@pytest.mark.parametrize('variant, base, joint', [
    ('1 : 1', 1.0, 1.0), ('1 : 10', 1.0, 10.0)])
def test_weights_give_the_weighted_inverse_of_the_lecture(played, variant, base, joint):
    run = played('weights')['runs'][variant]
    goal = run.stack.tasks['tool'].goal
    upright = run.robot.state(run.q[0]).rotation('tool')
    W_inverse = np.diag([1.0 / base] * 2 + [1.0 / joint] * 8)
    # After the start, with all limits far away; with 100 : 1 the torso is at one of its own.
    for sample in (150, 300, 500):
        state = run.robot.state(run.q[sample])
        J = state.jacobian('tool')
        turn = Rotation.from_matrix(upright @ state.rotation('tool').T).as_rotvec()
        v = np.concatenate([goal - state.position('tool'), 2.0 * turn])
        expected = W_inverse @ J.T @ np.linalg.solve(J @ W_inverse @ J.T, v)
        np.testing.assert_allclose(run.velocities[sample], expected, atol=2e-4)


def test_weights_move_the_motion_between_vehicle_and_arm_and_not_the_tool(played):
    runs = played('weights')['runs']
    driven = {name: np.abs(run.q[-1, 0] - run.q[0, 0]) for name, run in runs.items()}
    assert driven['1 : 10'] > driven['1 : 1'] > 2.0 * driven['100 : 1'] > 0.2
    page = (REPOSITORY / 'docs' / 'robots.md').read_text(encoding='utf-8')
    assert 'of 1 : 10 the base moves {:.0f} cm for a goal 0.4 m ahead of the tool, with 1 : 1 ' \
        '{:.0f} cm, with 100 : 1 {:.0f} cm'.format(*(
            100.0 * driven[name] for name in ('1 : 10', '1 : 1', '100 : 1'))) in page
    errors = [run.errors['tool'] for run in runs.values()]
    np.testing.assert_allclose(errors[1:], [errors[0]] * 2, atol=1e-3)


def possible(run):
    """Return the least error of joint 1 with the end-effector at its goal (T,), by geometry."""
    turn = 2.0 * np.pi * run.times
    x, y = 0.8 + 0.2 * np.sin(turn / 5.0), 0.9
    distance = np.hypot(x, y)
    # Law of cosines for links of 0.75 m, and of 0.5 + 0.5 m stretched.
    reach = np.arccos((0.75 ** 2 + distance ** 2 - 1.0) / (2.0 * 0.75 * distance))
    desired = 0.1 - 0.55 * np.sin(turn / 10.0)
    return np.maximum(np.abs(desired - np.arctan2(y, x)) - reach, 0.0)


def test_forms_differ_at_the_edge_and_where_both_tasks_are_possible(played):
    runs = played('forms')['runs']
    damped, undamped, sequential = (runs[name] for name in (
        'recursive, damped', 'recursive, undamped', 'sequential'))
    least = possible(damped)
    contradicting = damped.times[least > 0.0]
    assert contradicting[0] == pytest.approx(0.62) and contradicting[-1] == pytest.approx(4.32)
    both = within(damped, 8.0)
    assert damped.errors['joint1'][both].max() < 1e-3
    assert undamped.errors['joint1'][within(undamped, 5.0)].max() < 1e-3
    assert sequential.errors['joint1'][both].max() > 0.3
    # While they contradict each other, the damped one is as near as geometry allows.
    middle = within(damped, 1.5, 4.0)
    np.testing.assert_allclose(damped.errors['joint1'][middle], least[middle], atol=0.02)
    assert undamped.top_speed > 5.0 * damped.top_speed > 20.0 * sequential.top_speed
    assert undamped.errors['end_effector'].max() > 0.1
    for run in (damped, sequential):
        assert run.errors['end_effector'].max() < 3e-3


def test_a_check_names_the_times_between_which_it_counts():
    assert Check('a', 'b', 1.0, since=3.5, until=4.0).window == ' from 3.5 s to 4 s'
    assert Check('a', 'b', 1.0).window == ''


def test_tool_arrives_at_each_pose_without_the_joint_and_misses_all_if_it_is_not_told(played):
    runs, goals = played('failed_joint')['runs'], played('failed_joint')['scene'].goals
    documented = '9.3, 77.2 and 26.8 mm'
    assert documented in (REPOSITORY / 'docs' / 'lab.md').read_text(encoding='utf-8')
    for end in (5.0, 10.0, 15.0):
        goal, sample = goals(end - 0.01)['tool'], round(100.0 * end) - 1
        away = {}
        for name, run in runs.items():
            pose = run.robot.state(run.q[sample]).pose('panda_hand_tcp')
            away[name] = 1e3 * np.linalg.norm(pose[:3, 3] - goal[:3, 3])
            turn = Rotation.from_matrix(pose[:3, :3].T @ goal[:3, :3]).magnitude()
            assert math.degrees(turn) < 0.01 or name == 'in vain'
        # As soon as with all joints.
        assert f'{away["in vain"]:.1f}' in documented
        assert away['locked'] < 0.05 and away['no failure'] < 0.05 and away['in vain'] > 5.0


def test_joint_fails_in_motion_and_stands_from_then_on(played):
    runs, third, fails = played('failed_joint')['runs'], 2, 80
    for name in ('locked', 'in vain'):
        run = runs[name]
        assert run.velocities[fails - 1, third] > 0.1
        assert np.ptp(run.q[fails:, third]) < 1e-12
    assert not runs['locked'].velocities[fails:, third].any()
    assert np.abs(runs['in vain'].velocities[fails:, third]).min() > 0.0
    # It would have gone on.
    assert np.ptp(runs['no failure'].q[fails:, third]) > 0.2

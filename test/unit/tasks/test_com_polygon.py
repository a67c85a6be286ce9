# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Support polygons of robots: distances by links' masses, contacts that move, and closed loops."""

import numpy as np
import pinocchio
import pytest
import robots
from scipy.spatial import ConvexHull
from tp_controller import Controller, Settings, solve_position, Stack
from tp_controller.tasks import ComPolygon

TOOL = robots.PANDA_TOOL
SQUARE = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]]


@pytest.fixture(scope='module')
def panda():
    """Return a Panda with masses."""
    return robots.robot_for(ComPolygon)


def center_of_mass(robot, state):
    """Return the centre of mass (3,) from the inertias of the description [m]."""
    model = pinocchio.buildModelFromXML(robot.urdf)
    data, q = model.createData(), pinocchio.neutral(model)
    q[:robot.n] = state.q
    pinocchio.forwardKinematics(model, data, q)
    places = [pose.act(inertia.lever) for pose, inertia in zip(data.oMi, model.inertias)]
    return np.average(places, axis=0, weights=[inertia.mass for inertia in model.inertias])


def test_distances_are_those_of_the_centre_of_mass_from_the_edges(panda):
    rng = np.random.default_rng(0)
    task = ComPolygon(panda, 'task', contacts={'panda_link0': SQUARE, TOOL: SQUARE[:2]})
    for _ in range(20):
        state = panda.state(rng.uniform(panda.lower, panda.upper))
        corners = np.array(SQUARE)[:, :2].tolist() + [
            (state.pose(TOOL) @ [*point, 1.0])[:2] for point in SQUARE[:2]]
        center = center_of_mass(panda, state)
        hull = ConvexHull(corners)
        expected = np.unique((-hull.equations @ [*center[:2], 1.0]).round(9))
        np.testing.assert_allclose(np.unique(task.value(state).round(9)), expected, atol=1e-8)
        outside = np.maximum(task.margin - task.value(state), 0.0)
        np.testing.assert_allclose(task.error(state), outside)


def test_jacobian_of_a_humanoid_is_the_derivative_with_its_floating_base():
    robot, rng, h = robots.named('walker'), np.random.default_rng(0), 1e-6
    task = ComPolygon(robot, 'task', contacts={'left_sole_link': SQUARE, 'right_sole_link': SQUARE,
                                               'gripper_left_base_link': SQUARE[:1]})
    zero = robot.configuration(np.zeros(len(robot.joint_names)))
    for _ in range(4):
        q = robot.integrate(zero, rng.uniform(-0.4, 0.4, robot.n), 1.0)
        seen = task.observe_rows(robot.state(q))
        for _ in range(5):
            direction = rng.normal(size=robot.n)
            after, before = (task.value(robot.state(robot.integrate(q, direction, step)))
                             for step in (h, -h))
            np.testing.assert_allclose(seen.J @ direction, (after - before) / (2 * h), atol=1e-6)


def test_direction_of_gravity_is_a_key(panda):
    state = panda.state(robots.PANDA_READY)
    for up, kept in (('z', [0, 1]), ('-x', [1, 2]), ([0.0, 3.0, 0.0], [0, 2])):
        corners = np.zeros((4, 3))
        corners[:, kept] = np.array(SQUARE)[:, :2]
        task = ComPolygon(panda, 'task', contacts={'panda_link0': corners.tolist()}, up=up)
        expected = 0.1 - np.abs(center_of_mass(panda, state)[kept])
        assert task.value(state).min() == pytest.approx(expected.min())


def test_rows_are_named_after_the_ends_of_their_edges(panda):
    state = panda.state(robots.PANDA_READY)
    # The tool is in front of the stand, so the front of the stand is no edge.
    task = ComPolygon(panda, 'task', contacts={'panda_link0': SQUARE, TOOL: [[0.0, 0.0, 0.0]]})
    assert set(task.observe_rows(state).names) == {
        f'panda_link0 4 – {TOOL}', f'{TOOL} – panda_link0 1', 'panda_link0 1 – panda_link0 2',
        'panda_link0 2 – panda_link0 3', 'panda_link0 3 – panda_link0 4'}


def loop(robot, stack, goal, seconds=6.0):
    """Return the last report, and the least distance from the edges over time."""
    q, controller = np.array(robots.PANDA_READY), Controller(
        robot, stack, Settings(period=0.01, command_delay=0))
    controller.update(q, 0.0)
    controller.set_goal('tool', goal, 0.0)
    least, task = [], stack.tasks['balance']
    for cycle in range(round(seconds / 0.01)):
        command = controller.update(q, 0.01 * cycle)
        q = q + 0.01 * command.velocity
        least.append(task.value(robot.state(q)).min())
    return command.report, np.array(least)


def test_goal_far_in_front_is_missed_at_the_margin(panda):
    """The centre of mass of the arm is 2 cm behind the edge, and not beyond it."""
    state = panda.state(robots.PANDA_READY)
    edge = float(center_of_mass(panda, state)[0]) + 0.05
    corners = [[edge, 0.3, 0.0], [-0.3, 0.3, 0.0], [-0.3, -0.3, 0.0], [edge, -0.3, 0.0]]
    stack = Stack.from_yaml(
        f'- balance: {{type: com_polygon, contacts: {{panda_link0: {corners}}}, margin: 0.02}}\n'
        f'- tool: {{type: position, frame: {TOOL}}}\n', panda)
    report, least = loop(panda, stack, [0.75, 0.0, 0.6])
    balance, tool = report.tasks
    assert least.min() > 0.02 - 1e-4 and least[-1] < 0.021
    assert balance.status == 'satisfied'
    assert tool.status == 'limited' and tool.reason.startswith('blocked by the bounds of balance')


@pytest.mark.parametrize('back, front, inside', [(-0.5, -0.1, -0.15), (0.3, 0.6, 0.35)])
def test_sketch_leads_from_the_plumb_line_to_the_nearest_place_inside(panda, back, front, inside):
    # One metre below the root, behind the centre of mass or in front of it.
    corners = [[front, 0.3, -1.0], [back, 0.3, -1.0], [back, -0.3, -1.0], [front, -0.3, -1.0]]
    task = ComPolygon(panda, 'task', contacts={'panda_link0': corners}, margin=0.05)
    state = panda.state(robots.PANDA_READY)
    parts = {part.part: part for part in task.sketch(state)}
    center = center_of_mass(panda, state)
    np.testing.assert_allclose(parts['frame'].p, center)
    np.testing.assert_allclose(parts['plumb'].points, [center, [*center[:2], -1.0]])
    assert {tuple(point) for point in parts['polygon'].points} == set(map(tuple, corners))
    np.testing.assert_array_equal(*parts['polygon'].points[[0, -1]])
    np.testing.assert_allclose(parts['error'].start, [*center[:2], -1.0])
    np.testing.assert_allclose(parts['error'].end, [inside, center[1], -1.0], atol=1e-12)


def test_inverse_kinematics_keeps_the_centre_of_mass_above_the_polygon(panda):
    corners = [[0.12, 0.3, 0.0], [-0.3, 0.3, 0.0], [-0.3, -0.3, 0.0], [0.12, -0.3, 0.0]]
    stack = Stack.from_yaml(
        f'- balance: {{type: com_polygon, contacts: {{panda_link0: {corners}}}}}\n'
        f'- tool: {{type: position, frame: {TOOL}}}\n', panda)
    for goal, reached in (([0.4, 0.1, 0.6], True), ([0.8, 0.0, 0.4], False)):
        found = solve_position(panda, stack, goals={'tool': goal}, start=robots.PANDA_READY)
        state = panda.state(found.q)
        assert found.reached == reached
        assert center_of_mass(panda, state)[0] <= 0.1 + 1e-4
        assert (np.linalg.norm(state.position(TOOL) - goal) < 1e-3) == reached


def test_contacts_on_one_line_are_told_and_approached(panda):
    """A polygon that frames span at run time may be none."""
    # All on the axis of the first joint.
    contacts = {'panda_link0': [[0.0, 0.0, 0.0]], 'panda_link1': [[0.0, 0.0, 0.0],
                                                                  [0.0, 0.0, 0.1]]}
    stack = Stack.from_yaml(f'- balance: {{type: com_polygon, contacts: {contacts}}}\n'
                            f'- tool: {{type: position, frame: {TOOL}}}\n', panda)
    state = panda.state(robots.PANDA_READY)
    seen = stack.tasks['balance'].observe_rows(state)
    assert seen.names == ['contacts on one line']
    away = np.linalg.norm(center_of_mass(panda, state)[:2])
    assert seen.value == pytest.approx([-away])
    report, least = loop(panda, stack, state.position(TOOL), seconds=4.0)
    assert least[-1] > -0.3 * away
    assert report.tasks[0].errors[0][0] >= 0.02 - least[-1] - 1e-6


def test_corner_that_becomes_part_of_an_edge_changes_no_other_row():
    """Rows are recognized by their ends, so the others keep their history."""
    robot = robots.robot_for(ComPolygon)
    task = ComPolygon(robot, 'task', contacts={'panda_link0': [
        [-0.6, -0.6, 0.0], [-0.6, 0.6, 0.0]], TOOL: [[0.0, 0.0, 0.0]], 'panda_link4': [
            [0.0, 0.0, 0.0]]})
    rng = np.random.default_rng(0)
    for _ in range(200):
        state = robot.state(rng.uniform(robot.lower, robot.upper))
        state.velocity = rng.normal(size=7)
        level = task.evaluate(state, rng.uniform()).level
        assert np.isfinite(level.J).all() and (level.lower <= level.upper).all()
        assert level.J.shape == (len(level.lower), 7)

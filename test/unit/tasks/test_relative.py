# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Two arms that carry one object, in a closed loop with an ideal robot."""

import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack, StackError

LEFT, RIGHT = 'left_gripper', 'right_gripper'
PERIOD = 0.01
ARMS = tuple(f'{side}_{joint}' for side in ('left', 'right')
             for joint in ('s0', 's1', 'e0', 'e1', 'w0', 'w1', 'w2'))
# Elbows out, hands in front.
READY = np.array([0.4, -0.5, -0.6, 1.3, 0.5, 0.8, 0.1, -0.4, -0.5, 0.6, 1.3, -0.5, 0.8, -0.1])


def between(state):
    """Return T_right_left (4, 4)."""
    return np.linalg.inv(state.pose(RIGHT)) @ state.pose(LEFT)


@pytest.mark.parametrize('kind, kept', [
    ('relative_pose', np.s_[:3, :]), ('relative_position', np.s_[:3, 3])])
def test_what_two_arms_hold_keeps_its_shape_while_one_of_them_is_moved(kind, kept):
    robot = robots.urdf_robot('baxter', ARMS)
    controller = Controller(robot, Stack.from_yaml(f"""
- grip: {{type: {kind}, frame: {LEFT}, reference: {RIGHT}, gain: 5.0}}
- carry: {{type: position, frame: {LEFT}, gain: 2.0}}
- posture: {{type: posture, gain: 0.5}}
""", robot), Settings(period=PERIOD))
    q, state = READY, robot.state(READY)
    before, goal = between(state)[kept], state.position(LEFT) + [0.08, 0.0, 0.12]
    other = state.position(RIGHT)
    controller.update(q, 0.0)
    controller.set_goal('carry', goal, 0.0)
    for cycle in range(1, 600):
        q = q + PERIOD * controller.update(q, cycle * PERIOD).velocity
        state.update(q)
        # What is left is of second order: a velocity stays for 10 ms.
        assert np.abs(between(state)[kept] - before).max() < 2e-4
    np.testing.assert_allclose(state.position(LEFT), goal, atol=1e-3)
    # The other arm has come along.
    assert np.linalg.norm(state.position(RIGHT) - other) > 0.02


@pytest.mark.parametrize('kind', ['relative_pose', 'relative_position'])
def test_relative_task_needs_a_frame_to_be_relative_to(kind):
    robot = robots.urdf_robot('baxter', ARMS)
    with pytest.raises(StackError, match="needs the key 'reference': frame of the robot that"):
        Stack.from_yaml(f'- grip: {{type: {kind}, frame: {LEFT}}}\n', robot)

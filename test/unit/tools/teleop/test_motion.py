# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A tool moves as a device does, from where both were at the press."""

import math

import numpy as np
import pytest
from tp_controller.model.spatial import pose, rotation_from_rpy, rotation_from_vector
from tp_controller.tools.teleop.motion import Following, FollowingMotion, Tool

# Anywhere: only the motion since the press counts.
DEVICE = pose(rotation_from_rpy(0.3, -0.8, 2.0), (5.0, -3.0, 1.0))
TOOL = Tool('base', 'hand', pose(rotation_from_rpy(3.0, 0.2, -0.5), (0.4, 0.1, 0.6)))
# WebXR and ARKit: x right, y up, z backward; in the base x is forward, y left, z up.
FROM_XR = (-0.5, 0.5, 0.5, -0.5)


def moved(device, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """Return the pose of a device that has moved along and turned about the axes of its world."""
    return pose(rotation_from_vector(turn) @ device[:3, :3], device[:3, 3] + shift)


def follow(*poses, following=Following(), device=DEVICE, tool=TOOL):
    """Return the goal after some poses of the device."""
    motion = FollowingMotion(following, device, tool)
    for each in poses:
        motion.follow(each)
    return motion.goal


def test_the_tool_is_at_rest_while_the_device_is():
    np.testing.assert_allclose(follow(), TOOL.T)
    np.testing.assert_allclose(follow(DEVICE, DEVICE), TOOL.T, atol=1e-12)


def test_the_tool_moves_and_turns_as_the_device_in_its_world():
    shift, turn = (0.1, -0.2, 0.3), (0.4, 0.5, -0.6)
    np.testing.assert_allclose(follow(moved(DEVICE, shift, turn)), moved(TOOL.T, shift, turn))


def test_the_scale_is_that_of_all_motion_since_the_press():
    goal = follow(moved(DEVICE, (0.1, 0, 0), (0, 0, 0.4)), moved(DEVICE, (0.3, 0, 0), (0, 0, 0.8)),
                  following=Following(linear=0.5, angular=0.25))
    np.testing.assert_allclose(goal, moved(TOOL.T, (0.15, 0, 0), (0, 0, 0.2)))


def test_a_scaled_rotation_leads_back_to_its_beginning():
    turns = [(0.9, 0, 0), (0.9, 0.9, 0), (0, 0.9, 0), (0, 0, 0)]
    goal = follow(*(moved(DEVICE, turn=turn) for turn in turns), following=Following(angular=0.3))
    np.testing.assert_allclose(goal, TOOL.T, atol=1e-12)


@pytest.mark.parametrize('angle', [3.0, 3.3, 6.2, 2.0 * math.pi, 7.0, -13.0])
def test_a_scaled_rotation_goes_on_beyond_half_a_turn(angle):
    steps = np.linspace(0.0, angle, 60)
    goal = follow(*(moved(DEVICE, turn=(0, step, 0)) for step in steps),
                  following=Following(angular=0.1))
    np.testing.assert_allclose(goal, moved(TOOL.T, turn=(0, 0.1 * angle, 0)), atol=1e-9)


# Deadband --------------------------------------------------------------------------------------


def test_motion_within_the_deadband_moves_nothing():
    following = Following(linear_deadband=0.01, angular_deadband=0.1)
    goal = follow(moved(DEVICE, (0.006, 0.006, 0), (0.05, 0, 0.05)),
                  moved(DEVICE, (-0.006, 0, 0.006), (-0.05, 0.05, 0)), following=following)
    np.testing.assert_allclose(goal, TOOL.T, atol=1e-12)


def test_motion_begins_without_a_jump_beyond_the_deadband_and_after_a_change_of_direction():
    following = Following(linear_deadband=0.01, angular_deadband=0.1)
    there = moved(DEVICE, (0.05, 0, 0), (0, 0, 0.5))
    goal = follow(there, following=following)
    np.testing.assert_allclose(goal, moved(TOOL.T, (0.04, 0, 0), (0, 0, 0.4)), atol=1e-12)
    back = moved(DEVICE, (0.035, 0, 0), (0, 0, 0.35))
    np.testing.assert_allclose(follow(there, back, following=following), goal, atol=1e-12)
    farther = moved(DEVICE, (0.02, 0, 0), (0, 0, 0.2))
    np.testing.assert_allclose(follow(there, back, farther, following=following),
                               moved(TOOL.T, (0.03, 0, 0), (0, 0, 0.3)), atol=1e-12)


# Axes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(('device', 'tool'), [
    ((1, 0, 0), (0, -1, 0)), ((0, 1, 0), (0, 0, 1)), ((0, 0, 1), (-1, 0, 0))])
def test_axes_of_another_convention_are_turned(device, tool):
    goal = follow(moved(DEVICE, 0.1 * np.array(device), 0.5 * np.array(device)),
                  following=Following(quat_xyzw=FROM_XR))
    np.testing.assert_allclose(goal, moved(TOOL.T, 0.1 * np.array(tool), 0.5 * np.array(tool)),
                               atol=1e-12)


@pytest.mark.parametrize('yaw', [-3.0, 0.0, 1.2])
def test_forward_of_the_device_is_x_whatever_the_heading_of_its_world(yaw):
    # A device whose -y is forward, with its nose down.
    heading = rotation_from_rpy(0.0, 0.0, yaw)
    device = pose(heading @ rotation_from_rpy(0.0, 0.6, math.pi / 2), (1.0, 2.0, 3.0))
    ahead, up = heading @ (0.1, 0, 0), (0, 0, 0.2)
    goal = follow(moved(device, ahead + up, ahead), device=device,
                  following=Following(forward='-y'))
    np.testing.assert_allclose(goal, moved(TOOL.T, (0.1, 0, 0.2), (0.1, 0, 0)), atol=1e-12)


def test_forward_is_measured_in_axes_that_have_been_turned():
    # A phone that lies flat with its top edge, y, along -z of its world: forward in WebXR.
    device = pose(rotation_from_rpy(-math.pi / 2, 0.0, 0.0), (0.0, 0.0, 0.0))
    following = Following(quat_xyzw=FROM_XR, forward='y')
    for angle in (0.0, 0.7):
        R = rotation_from_rpy(0.0, angle, 0.0)
        turned = pose(R @ device[:3, :3], (0.0, 0.0, 0.0))
        goal = follow(moved(turned, R @ (0, 0, -0.1)), following=following, device=turned)
        np.testing.assert_allclose(goal, moved(TOOL.T, (0.1, 0, 0)), atol=1e-12)


def test_an_upright_forward_axis_tells_no_heading():
    upright = pose(rotation_from_rpy(0.0, -1.4, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match='x of the device is upright'):
        FollowingMotion(Following(forward='x'), upright, TOOL)


def test_the_axes_of_the_tool_are_those_of_a_pilot():
    R = TOOL.T[:3, :3]
    goal = follow(moved(DEVICE, (0, 0, 0.1), (0, 0.3, 0)), following=Following(frame='hand'))
    np.testing.assert_allclose(goal, moved(TOOL.T, R @ (0, 0, 0.1), R @ (0, 0.3, 0)), atol=1e-12)
    goal = follow(moved(DEVICE, (0, 0, 0.1)), following=Following(frame='base'))
    np.testing.assert_allclose(goal, moved(TOOL.T, (0, 0, 0.1)), atol=1e-12)


def test_another_frame_is_refused():
    with pytest.raises(ValueError, match="'arm' is neither 'hand', .* nor its reference 'base'"):
        FollowingMotion(Following(frame='arm'), DEVICE, TOOL)

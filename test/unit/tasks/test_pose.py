# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Goals of pose tasks: many are parsed as each alone."""

import numpy as np
import pytest
import robots
from tp_controller import GoalError
from tp_controller.positions.random_postures import random_postures
from tp_controller.tasks.pose import Pose


class Shifted(Pose):
    """Pose with goals of its own."""

    def parse_goal(self, goal):
        """Return a goal 1 m above the given one."""
        return super().parse_goal(goal) + np.eye(4, k=1)


def poses():
    """Return matrices (count, 4, 4)."""
    robot = robots.panda()
    return np.array([robot.state(q).pose(robots.PANDA_TOOL) for q in random_postures(
        robot, robot.neutral(), np.random.default_rng(0), 5)])


def quaternions():
    """Return numbers of three poses: a position and a quaternion each."""
    return np.array([[0.1, 0.2, 0.3, 0.6, 0.0, 0.8, 0.0]] * 3)


@pytest.mark.parametrize('kind', [Pose, Shifted])
@pytest.mark.parametrize('goals', [poses(), list(poses()), poses().tolist(), quaternions(),
                                   [poses()[0], quaternions()[0]]])
def test_goals_are_those_parsed_alone(kind, goals):
    task = kind(robots.panda(), 'tool', frame=robots.PANDA_TOOL)
    found = task.parse_goals(goals)
    np.testing.assert_array_equal(found, [task.parse_goal(goal) for goal in goals])


@pytest.mark.parametrize('row, column, value', [
    (0, 3, np.nan), (1, 3, 1e7), (3, 0, 0.1), (3, 3, 2.0), (0, 0, 5.0)])
def test_one_invalid_matrix_is_refused(row, column, value):
    task = Pose(robots.panda(), 'tool', frame=robots.PANDA_TOOL)
    goals = poses()
    goals[3, row, column] = value
    with pytest.raises(GoalError) as alone:
        task.parse_goal(goals[3])
    with pytest.raises(GoalError) as together:
        task.parse_goals(goals)
    assert str(together.value) == str(alone.value)


def test_mirrors_are_refused():
    task = Pose(robots.panda(), 'tool', frame=robots.PANDA_TOOL)
    goals = poses()
    goals[1, :3, 0] *= -1.0
    with pytest.raises(GoalError, match='not a rotation matrix'):
        task.parse_goals(goals)

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""States of the present and the previous cycle."""

import robots
from tp_controller.control.state_buffer import StateBuffer


def test_no_cycle_makes_the_data_of_pinocchio():
    """It takes 4 ms for a robot of 50 joints."""
    robot = robots.panda()
    buffer = StateBuffer(robot)
    states = [buffer.spare, *[buffer.update(robot.neutral(), None, 0.0) for _ in range(2)]]
    assert len({id(state) for state in states}) == 3
    assert all('_data' in vars(state) for state in states)

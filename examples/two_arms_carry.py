# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Two arms carry one object: the grip is above the goal, so it is kept at any speed."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Stack
from tp_controller.model.simulator import initial_positions
from tp_controller.resources import find_file
import yaml

CONFIG = 'package://tp_controller/config/'
PERIOD = 0.01  # [s]
robot = Robot.from_file(CONFIG + 'robots/two_arms.urdf')
parameters = yaml.safe_load(find_file(CONFIG + 'two_arms.yaml').read_text(encoding='utf-8'))
start = parameters['/**/tp_simulator']['ros__parameters']['initial_positions']
controller = Controller(robot, Stack.from_yaml(CONFIG + 'two_arms_stack.yaml', robot))
simulator = KinematicSimulator(robot, initial_positions(start, robot))


def grip():
    """Return the pose of the right hand in the left one."""
    state = robot.state(simulator.q)
    return np.linalg.inv(state.pose('left_hand')) @ state.pose('right_hand')


grip_at_start, slip = grip(), 0.0
for index, goal in enumerate(([0.55, 0.18, 1.3], [0.48, 0.38, 1.12], [0.6, 0.1, 1.0])):
    controller.set_goal('carry', [*goal, 0.0, 0.0, 0.0, 1.0], now=8.0 * index)
    for now in 8.0 * index + PERIOD * np.arange(800):
        command = controller.update(simulator.q, now)
        simulator.command(command.velocity)
        simulator.step(PERIOD)
        slip = max(slip, np.linalg.norm((grip() - grip_at_start)[:3, 3]))
    carry, = (task for task in command.report.tasks if task.name == 'carry')
    print(f'goal {index + 1}: {1e3 * carry.errors[0][0]:.1f} mm to go, {carry.status}')
print(f'the hands moved by {1e3 * slip:.2f} mm at most relative to each other')

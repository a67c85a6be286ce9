# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""An arm on wheels: near goals are for the arm, far ones for the base as well."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Settings, Stack
from tp_controller.model.simulator import initial_positions

STACK = """
- reach: {type: keep_in, frame: tool, reference: base_link,
          shape: {box: [0.4, 0.6, 1.0]}, at: [0.75, 0.0, 0.9], gain: 1.5}
- level: {type: orientation, frame: tool, axes: xy, gain: 3.0}
- tool: {type: position, frame: tool, gain: 2.0}
"""
LIMITS = {'base_x': {'velocity': 0.6, 'acceleration': 0.6},
          'base_yaw': {'velocity': 0.8, 'acceleration': 1.0}}
PERIOD = 0.01  # [s]
robot = Robot.from_file('package://tp_controller/config/robots/mobile_arm.urdf',
                        base='differential', limits=LIMITS)
# The two velocities of the base cost twenty times as much as those of the joints.
controller = Controller(robot, Stack.from_yaml(STACK, robot),
                        Settings(weights=(20.0,) * 2 + (1.0,) * (robot.n - 2)))
simulator = KinematicSimulator(robot, initial_positions(
    '{torso_lift: 0.15, arm_2: -0.8, arm_4: 1.6, arm_6: -0.8}', robot))
start = robot.state(simulator.q).position('tool')
for index, (name, step) in enumerate((('near', [0.1, 0.1, 0.0]), ('far', [2.5, 0.8, 0.1]))):
    controller.set_goal('tool', start + step, now=15.0 * index)
    before = simulator.q[:2].copy()
    for now in 15.0 * index + PERIOD * np.arange(1500):
        command = controller.update(simulator.q, now)
        simulator.command(command.velocity)
        simulator.step(PERIOD)
    driven = np.linalg.norm(simulator.q[:2] - before)
    print(f'{name}: base moved {driven:.2f} m, tool {command.report.tasks[2].status}')

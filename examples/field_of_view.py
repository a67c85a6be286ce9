# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A camera keeps an object in view while the tool moves: with that task and without."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Stack

OBJECT, HALF_ANGLE = [0.6, 0.0, 0.0], 0.4  # [m] [rad]
VIEW = f"""
- view: {{type: field_of_view, frame: panda_hand, half_angle: {HALF_ANGLE}, target: {OBJECT}}}
"""
STACK = """
- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}
- posture: {type: posture, gain: 0.5}
"""
PERIOD = 0.01  # [s]
robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')


def angle(q):
    """Return the angle between the axis of the camera and the direction of the object [rad]."""
    T = robot.state(q).pose('panda_hand')
    sight = OBJECT - T[:3, 3]
    return np.arccos(T[:3, 2] @ sight / np.linalg.norm(sight))


for name, text in (('without', STACK), ('with', VIEW + STACK)):
    controller = Controller(robot, Stack.from_yaml(text, robot))
    simulator = KinematicSimulator(robot, [0.0, -0.4, 0.0, -2.0, 0.0, 2.1, 0.785])
    controller.set_goal('tool', [0.45, -0.4, 0.5], now=0.0)
    angles = [angle(simulator.q)]
    for now in PERIOD * np.arange(800):
        command = controller.update(simulator.q, now)
        simulator.command(command.velocity)
        simulator.step(PERIOD)
        angles.append(angle(simulator.q))
    tool, = (task for task in command.report.tasks if task.name == 'tool')
    print(f'{name} the task: object at most {np.degrees(max(angles)):.1f}° from the axis of '
          f'{np.degrees(HALF_ANGLE):.1f}° allowed, tool {tool.status}')

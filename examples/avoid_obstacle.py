# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""An elbow evades a ball that comes towards it, and the tool stays where it is."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Stack

DISTANCE, RADIUS, PERIOD = 0.05, 0.08, 0.01  # [m] [m] [s]
STACK = f"""
- clear:
    type: obstacles
    distance: {DISTANCE}
    gain: 20.0
    capsules: package://tp_controller/config/panda_capsules.yaml
    links: [panda_link3, panda_link4, panda_link5]
- tool: {{type: pose, frame: panda_hand_tcp, gain: 4.0}}
- posture: {{type: posture, gain: 0.5}}
"""
robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')
controller = Controller(robot, Stack.from_yaml(STACK, robot))
simulator = KinematicSimulator(robot, [0.0, -0.3, 0.0, -2.2, 0.0, 2.0, 0.785])
start = robot.state(simulator.q).position('panda_hand_tcp')
elbow = robot.state(simulator.q).position('panda_link4')
margin, moved, shift = np.inf, 0.0, 0.0
for now in PERIOD * np.arange(800):
    # The ball comes from the side, and goes back after four seconds.
    ball = elbow + [0.0, 0.14 + 0.05 * abs(now - 4.0), 0.0]
    controller.set_goal('clear', {'ball': {'shape': {'sphere': RADIUS}, 'at': ball}}, now)
    command = controller.update(simulator.q, now)
    simulator.command(command.velocity)
    simulator.step(PERIOD)
    state = robot.state(simulator.q)
    clear = command.report.tasks[0]
    margin = min(margin, DISTANCE - clear.errors[0][0])
    moved = max(moved, np.linalg.norm(state.position('panda_link4') - elbow))
    shift = max(shift, np.linalg.norm(state.position('panda_hand_tcp') - start))
print(f'nearest {1e3 * margin:.1f} mm ({1e3 * DISTANCE:.0f} mm demanded), '
      f'elbow moved {1e3 * moved:.0f} mm, tool {1e3 * shift:.1f} mm')

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A task type of your own: the cable between two frames never becomes taut."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Stack
from tp_controller.tasks import BoundedTask, frame_key, yaml_key
from tp_controller.tasks.keys import positive


class Cable(BoundedTask):
    """Keep two frames within the length of a cable between them [m]."""

    type_name = 'cable'
    units = ('m',)
    frame = frame_key('frame at one end')
    to = frame_key('frame at the other end')
    upper = yaml_key('length of the cable', positive, unit='m', name='length')

    def observe(self, state):
        line = state.position(self.frame) - state.position(self.to)
        J = state.jacobian(self.frame)[:3] - state.jacobian(self.to)[:3]
        return np.linalg.norm(line, keepdims=True), (line @ J / np.linalg.norm(line))[np.newaxis]


robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')
controller = Controller(robot, Stack.from_yaml("""
- cable: {type: cable, frame: panda_hand, to: panda_link2, length: 0.6}
- tool: {type: position, frame: panda_hand, gain: 2.0}
""", robot))
simulator = KinematicSimulator(robot, [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
controller.set_goal('tool', [0.5, 0.5, 0.6], now=0.0)
for now in 0.01 * np.arange(500):
    command = controller.update(simulator.q, now)
    simulator.command(command.velocity)
    simulator.step(0.01)
ends = [robot.state(simulator.q).position(frame) for frame in ('panda_hand', 'panda_link2')]
print(f'{1e3 * np.linalg.norm(ends[0] - ends[1]):.1f} mm of cable used, tool '
      f'{command.report.tasks[1].status}: {command.report.tasks[1].reason}')

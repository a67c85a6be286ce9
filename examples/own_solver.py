# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A solver of your own: lsq_linear of SciPy, with a large weight on the levels above."""

import numpy as np
from scipy.optimize import lsq_linear
from tp_controller import Controller, KinematicSimulator, LevelStep, Robot, Solution, Stack


class LeastSquares:
    def __init__(self, settings, n):
        self.n, self.undamped = n, self

    def solve(self, levels, bounds, memory=()):
        x, above, steps = np.zeros(self.n), np.zeros((0, self.n)), []
        for level in levels:
            demand = level.demanded(level.J @ x)
            found = lsq_linear(np.vstack([1e4 * above, level.J, 1e-4 * np.eye(self.n)]),
                               np.concatenate([1e4 * above @ x, demand, np.zeros(self.n)]),
                               (bounds.lower, np.maximum(bounds.upper, bounds.lower + 1e-9)))
            x = np.clip(found.x, bounds.lower, bounds.upper)
            above = np.vstack([above, level.J])
            active, force = found.active_mask != 0, (demand - level.J @ x) @ level.J
            steps.append(LevelStep(x, multipliers=active * force if active.any() else None))
        return Solution(x, levels, steps=steps)


robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')
stack = Stack.from_yaml('[tool: {type: position, frame: panda_hand_tcp, gain: 2.0},'
                        ' posture: {type: posture}]', robot)
controller = Controller(robot, stack, solver=LeastSquares)
simulator = KinematicSimulator(robot, [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
controller.set_goal('tool', [0.5, 0.2, 0.4], now=0.0)
for now in 0.01 * np.arange(500):
    command = controller.update(simulator.q, now)
    simulator.command(command.velocity)
    simulator.step(0.01)
tool, posture = command.report.tasks
print(f'tool {1e3 * tool.errors[0][0]:.1f} mm, posture {posture.status}: {posture.reason}')

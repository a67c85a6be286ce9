# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""A tool follows a circle: how far it lags behind, without and with a feed-forward velocity."""

import numpy as np
from tp_controller import Controller, KinematicSimulator, Robot, Stack

STACK = """
- tool: {type: pose, frame: panda_hand_tcp, gain: 3.0}
- posture: {type: posture, gain: 0.5}
"""
PERIOD, RADIUS, TURN = 0.01, 0.12, 2.0 * np.pi / 6.0  # [s] [m] [rad/s]
robot = Robot.from_file('package://tp_controller/config/robots/panda.yaml')


def circle(time):
    """Return position [m] and velocity [m/s] on the circle."""
    c, s = np.cos(TURN * time), np.sin(TURN * time)
    return (np.array([0.45 + RADIUS * c, RADIUS * s, 0.4]),
            RADIUS * TURN * np.array([-s, c, 0.0]))


for feed_forward in (False, True):
    controller = Controller(robot, Stack.from_yaml(STACK, robot))
    simulator = KinematicSimulator(robot, [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    errors = []
    for now in PERIOD * np.arange(1200):
        point, velocity = circle(now)
        controller.set_goal('tool', [*point, 1.0, 0.0, 0.0, 0.0], now)
        if feed_forward:
            controller.set_feed_forward('tool', [*velocity, 0.0, 0.0, 0.0], now)
        simulator.command(controller.update(simulator.q, now).velocity)
        simulator.step(PERIOD)
        tool = robot.state(simulator.q).position('panda_hand_tcp')
        errors.append(np.linalg.norm(tool - circle(now + PERIOD)[0]))
    print(f'{"with" if feed_forward else "without"} feed-forward: '
          f'{1e3 * max(errors[600:]):.1f} mm off at most in the second round')

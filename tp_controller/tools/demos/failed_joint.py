# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
``tp_controller demo failed_joint``: a joint of a 7-DoF arm fails in motion (lecture 1.1).

Question: does the tool still reach its poses, of six rows, if joint 3 stands still from 0.8 s on?
It does if the controller is told, by a lock: the other six joints are enough. The same motion is
computed with all joints, and with a controller that goes on to command the joint in vain.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from tp_controller import Controller, Robot, RobotState, Settings, Stack
from tp_controller.model.spatial import Array, rotation_from_rpy, rotation_vector
from tp_controller.resources import package_share
from tp_controller.tools.demos.motion import Look, Motion
from tp_controller.tools.demos.outcome import films, Measurement, Outcome
from tp_controller.tools.demos.simulation import Run, simulate
from tp_controller.tools.plots.curves import plot_errors

PERIOD = 0.01
START = (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.785)
TOOL, JOINT = 'panda_hand_tcp', 'panda_joint3'
# Time at which the joint fails, and time for each goal [s].
FAILS, TIME_OF_A_GOAL = 0.8, 5.0
STEPS_OF_A_GOAL = round(TIME_OF_A_GOAL / PERIOD)
# Shift [m] and turn (roll, pitch, yaw) [rad] of each goal, from the first pose of the tool.
TOOL_GOALS = (
    ((0.05, 0.35, 0.0), (0.2, 0.0, 0.4)), ((0.1, -0.1, -0.15), (0.0, -0.3, 0.0)),
    ((-0.05, 0.2, 0.1), (0.3, 0.2, 0.0)))
# Largest errors of the tool at the end of the time for a goal [mm, °].
MOST_TOOL_ERROR, MOST_TURN = 0.5, 0.1
# View of the film [deg].
VIEW = (-40.0, 25.0)
WORKING, ONE_LOCKED, UNTOLD = 'all joints work', 'joint 3 locked', 'joint 3 commanded in vain'


def record(case: str) -> Run:
    """Return the run of one of the three cases."""
    config = package_share() / 'config'
    robot = Robot.from_file(config / 'robots' / 'panda.yaml')
    stack = Stack.from_yaml(config / 'failed_joint_stack.yaml', robot)
    controller = Controller(robot, stack, Settings(period=PERIOD))
    goals, broken = goals_of(robot), robot.joint_index(JOINT)

    def set_goals(now: float) -> None:
        step = round(now / PERIOD)
        if step % STEPS_OF_A_GOAL == 0:
            controller.set_goal('tool', goals[step // STEPS_OF_A_GOAL], now)
        if case == ONE_LOCKED and step == round(FAILS / PERIOD):
            controller.lock([JOINT], now)

    def carried_out(now: float, velocity: Array) -> Array:
        return velocity if case == WORKING or now < FAILS else np.where(
            np.arange(robot.n) == broken, 0.0, velocity)

    return simulate(controller, START, len(goals) * STEPS_OF_A_GOAL, set_goals, carried_out)


def goals_of(robot: Robot) -> list[Array]:
    """Return the goals of the tool, poses (4, 4) in the root."""
    return [_goal(robot.state(START), shift, turn) for shift, turn in TOOL_GOALS]


def tool_errors(motion: Run) -> Array:
    """Return the errors (T, 2) of position [mm] and orientation [°]."""
    goals = iter(np.repeat(goals_of(motion.robot), STEPS_OF_A_GOAL, axis=0))
    return motion.values(lambda state: _errors(state, next(goals)))


def last_errors(motion: Run) -> Array:
    """Return the errors (goals, 2) at the end of the time for each goal [mm, °]."""
    return tool_errors(motion)[STEPS_OF_A_GOAL - 1::STEPS_OF_A_GOAL]


def _goal(state: RobotState, shift: Sequence[float], turn: Sequence[float]) -> Array:
    """Return the pose (4, 4) of the tool at a state, shifted and turned in the root."""
    goal = np.array(state.pose(TOOL))
    goal[:3, 3] += shift
    goal[:3, :3] = rotation_from_rpy(*turn).dot(goal[:3, :3])
    return goal


def _errors(state: RobotState, goal: Array) -> tuple[float, float]:
    """Return the errors of the tool [mm, °]."""
    turn = rotation_vector(goal[:3, :3].dot(state.rotation(TOOL).T))
    return (1e3 * float(np.linalg.norm(goal[:3, 3] - state.position(TOOL))),
            float(np.degrees(np.linalg.norm(turn))))


def failed_joint(folder: str | Path) -> Outcome:
    """Run the demonstration, and write its figures to a folder."""
    motions = {case: record(case) for case in (WORKING, ONE_LOCKED, UNTOLD)}
    locked, working = motions[ONE_LOCKED], motions[WORKING]
    stands = locked.times > FAILS
    measurements = [
        Measurement(f'{case}: tool at the goals, largest error', unit, value, most, 0.0, True)
        for case, motion in ((WORKING, working), (ONE_LOCKED, locked))
        for unit, value, most in zip(('mm', '°'), last_errors(motion).max(axis=0),
                                     (MOST_TOOL_ERROR, MOST_TURN))]
    share = 100.0 * np.abs(locked.velocities / locked.robot.velocity).max()
    measurements += [
        Measurement(f'{ONE_LOCKED}: its command from then on', 'rad/s', float(np.abs(
            locked.velocities[stands, locked.robot.joint_index(JOINT)]).max()), 0.0, 0.0, True),
        Measurement(f'{ONE_LOCKED}: joint speed, share of the limit', '%', share, 100.0, 0.0,
                    True)]
    lost = ', '.join(f'{error:.1f} mm' for error, _ in last_errors(motions[UNTOLD]))
    return Outcome(
        f'Joint 3 of 7 fails at {FAILS:g} s: the tool reaches its poses with the others',
        tuple(measurements), ('', f'{UNTOLD}: the tool misses the goals by {lost}', ''),
        tuple(_figures(Path(folder), motions)))


def _figures(folder: Path, motions: dict[str, Run]) -> Iterator[Path]:
    """Write the figures and yield their paths."""
    locked = motions[ONE_LOCKED]
    changes = [TIME_OF_A_GOAL * number for number in range(1, len(TOOL_GOALS))]
    yield plot_errors(
        folder / 'failed_joint.png', locked.times,
        [(case, 'mm', tool_errors(motion)[:, 0]) for case, motion in motions.items()],
        title=f'Joint 3 fails at {FAILS:g} s: error of the tool', changes=changes, log=True)
    goals = [(TIME_OF_A_GOAL * number, 'tool', goal) for number, goal
             in enumerate(goals_of(locked.robot))]
    yield from films(folder / 'failed_joint.webp', Motion(
        'Joint 3 fails, the tool arrives', locked.robot, locked.times, locked.q, locked.stack,
        Look((TOOL,), view=VIEW), goals,
        [(0.0, 'all joints work'), (FAILS, 'joint 3 has failed: locked, the others go on')]))

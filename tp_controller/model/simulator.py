# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A kinematic robot: velocity commands in, a configuration out, with the faults of a real one."""

from collections import deque
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import RobotError, SettingsError, unknown
from tp_controller.model.mobile_base import NAMES
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.resources import is_number, load_yaml, read_source

# A joint whose limits are nearer to zero than this does not start there, as a share of its range.
START_MARGIN = 0.05


@dataclass(frozen=True)
class SimulatorNoise:
    """
    What makes the simulated robot less than ideal; nothing does by default.

    Attributes
    ----------
    noise : float
        Standard deviation of measured positions [rad or m]; that of a base is moved by as much
        along and about each of its axes that it has a velocity for.
    delay : float
        Time from a command to its effect [s].
    lag : float
        Time constant of the drives, first order [s].
    drop : float
        Share of commands, and of measurements, that get lost, in [0, 1).
    seed : int
        Of the random numbers.

    Raises
    ------
    SettingsError
        All values that are out of range.

    """

    noise: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    drop: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the ranges."""
        faults = [f'{name} must be a finite number that is not negative, not {value!r}'
                  for name, value in (('noise', self.noise), ('delay', self.delay),
                                      ('lag', self.lag), ('drop', self.drop))
                  if not (is_number(value) and 0.0 <= value < math.inf)]
        if not faults and self.drop >= 1.0:
            faults.append(f'drop must be below 1, not {self.drop!r}')
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            faults.append(f'seed must be a whole number that is not negative, not {self.seed!r}')
        if faults:
            raise SettingsError(faults)


class KinematicSimulator:
    """
    Integrates velocity commands within the robot's limits.

    Commands are clipped at the velocity limits, positions stop at the position limits, and the
    robot stops by itself when no command took effect for `timeout` seconds. A base moves along
    the arcs that velocities in its own axes make.

    Parameters
    ----------
    robot : Robot
    q : array_like (nq,), optional
        Initial configuration [rad or m]; that of `start_configuration` by default.
    timeout : float
        [s]
    noise : SimulatorNoise, optional

    Attributes
    ----------
    q, velocity : ndarray (nq,), ndarray (n,)
        True configuration [rad or m] and velocities [rad/s or m/s].
    now : float
        Time that was reached [s].

    Raises
    ------
    RobotError
        `q` has the wrong shape, is not finite, or its quaternion is none.
    SettingsError
        `timeout` is not positive.

    """

    def __init__(self, robot: Robot, q: ArrayLike | None = None, timeout: float = 0.1,
                 noise: SimulatorNoise | None = None) -> None:
        if not 0.0 < timeout < math.inf:
            raise SettingsError([f'timeout must be positive and finite, not {timeout!r}'])
        self.robot = robot
        self.noise = noise or SimulatorNoise()
        self.timeout = timeout
        self._initial = robot.state(start_configuration(robot) if q is None else q).q.copy()
        self._random = np.random.default_rng(self.noise.seed)
        self.reset()

    def reset(self, now: float = 0.0) -> None:
        """Go back to the initial configuration, at rest, at time `now` [s]."""
        self.q = self._initial.copy()
        self.velocity = np.zeros(self.robot.n)
        self.now = now
        self._target = np.zeros(self.robot.n)
        self._expiry = np.full(self.robot.n, -math.inf)
        self._queue: deque[tuple[float, slice, Array]] = deque()

    def command(self, velocity: ArrayLike, columns: slice = slice(None)) -> bool:
        """
        Take a velocity command, now.

        Parameters
        ----------
        velocity : array_like (n,)
            [rad/s or m/s]
        columns : slice
            The entries that the command is for, all by default: base and joints may be commanded
            apart, and time out apart. The others are ignored.

        Returns
        -------
        bool
            False where the command was lost, see `SimulatorNoise`, or was not finite: a drive
            does not act on such a command.

        Raises
        ------
        RobotError
            Wrong shape.

        """
        target = np.array(velocity, dtype=float)
        if target.shape != (self.robot.n,):
            raise RobotError(f'a command needs {self.robot.n} velocities, '
                             f'got an array of shape {target.shape}')
        if self._lost() or not np.isfinite(target[columns]).all():
            return False
        clipped = np.clip(target, -self.robot.velocity, self.robot.velocity)
        self._queue.append((self.now + self.noise.delay, columns, clipped))
        return True

    def step(self, dt: float) -> None:
        """
        Let `dt` seconds pass.

        Commands take effect, and time out, at their own time within the step.
        """
        end = self.now + dt
        while self.now < end:
            while self._queue and self._queue[0][0] <= self.now:
                _, columns, target = self._queue.popleft()
                self._target[columns] = target[columns]
                self._expiry[columns] = self.now + self.timeout
            self._target[self.now >= self._expiry] = 0.0
            until = min([end, *(entry[0] for entry in list(self._queue)[:1]),
                         *self._expiry[self._expiry > self.now].tolist()])
            self._move(until - self.now)
            self.now = until

    def measure(self) -> tuple[Array, Array] | None:
        """
        Return what the robot's sensors say.

        Returns
        -------
        q, velocity : ndarray (nq,), ndarray (n,)
            Measured configuration, with noise, and velocities. None instead of both where the
            message was lost.

        """
        if self._lost():
            return None
        q = self.q.copy()
        if self.noise.noise > 0.0:
            # Along the path of a velocity, so that an orientation stays one.
            error = self.noise.noise * self._random.standard_normal(self.robot.n)
            q = self.robot.integrate(q, error, 1.0)
        return q, self.velocity.copy()

    def _lost(self) -> bool:
        """Draw whether a message gets lost."""
        return self.noise.drop > 0.0 and self._random.random() < self.noise.drop

    def _move(self, dt: float) -> None:
        """Move for `dt` seconds with the command in force."""
        lag = self.noise.lag
        if lag > 0.0:
            # Exact for a first-order drive: the mean velocity over dt, then the one at its end.
            decay = math.exp(-dt / lag)
            away = self.velocity - self._target
            mean = self._target + away * (lag / dt) * (1.0 - decay)
            self.velocity = self._target + away * decay
        else:
            mean = self.velocity = self._target
        robot = self.robot
        moved = robot.integrate(self.q, mean, dt)
        before, after = robot.positions(self.q), robot.positions(moved)
        # A robot that starts outside its limits does not jump back, but gets no further.
        lower, upper = np.minimum(robot.lower, before), np.maximum(robot.upper, before)
        stopped = (after < lower) | (after > upper)
        self.q = moved.copy()
        self.q[robot.joint_rows] = np.clip(after, lower, upper)[robot.joint_columns]
        self.velocity = np.where(stopped, 0.0, self.velocity)


def start_configuration(robot: Robot) -> Array:
    """
    Return a configuration (nq,) away from all position limits, the base at the root.

    A joint is at zero. Where zero is outside its range, or near a limit, it is in the middle of
    the range; with a limit on one side only it is as near to zero as that allows.
    """
    lower, upper = robot.lower[robot.joint_columns], robot.upper[robot.joint_columns]
    joints = np.clip(np.zeros(len(lower)), lower, upper)
    limited = np.isfinite(upper - lower)
    margin = START_MARGIN * (upper - lower)[limited]
    near = limited.copy()
    near[limited] = np.minimum(-lower[limited], upper[limited]) < margin
    joints[near] = 0.5 * (lower[near] + upper[near])
    return robot.configuration(joints)


def initial_positions(source: str | Path, robot: Robot) -> Array:
    """
    Return an initial configuration from a YAML mapping {joint: position}.

    Parameters
    ----------
    source : str or pathlib.Path
        YAML text, a file's path, or ``package://<package>/<path>``. Joints it leaves out start
        as in `start_configuration`. A base that moves starts at the root, unless some of its
        ``base_x``, ``base_y`` … ``base_yaw`` say where [m, rad].
    robot : Robot
        Whose joints they are.

    Returns
    -------
    ndarray (nq,)

    Raises
    ------
    RobotError
        No such file, an unknown joint, or no number.

    """
    try:
        text = read_source(source, lambda text: text.lstrip().startswith('{') or (
            ':' in text and '://' not in text and not text.endswith(('.yaml', '.yml'))))
        positions = load_yaml(text) or {}
    except (OSError, ValueError) as error:
        raise RobotError(f'initial positions: {error}') from error
    if not isinstance(positions, dict):
        raise RobotError('initial positions must be a mapping {joint: position}')
    q = start_configuration(robot)
    base = np.zeros(6)
    axes = {NAMES[row]: row for row in robot.base_reach}
    for name, position in positions.items():
        if not (is_number(position) and math.isfinite(position)):
            raise RobotError(f'initial positions: {name} must be a finite number, '
                             f'not {position!r}')
        if name in axes:
            base[axes[name]] = position
        elif name in robot.joint_names:
            q[robot.joint_rows][robot.joint_names.index(name)] = position
        else:
            valid = (*axes, *robot.joint_names)
            raise RobotError(f'initial positions: {unknown("joint", name, valid)}')
    return robot.configuration(q[robot.joint_rows],
                               pose(rotation_from_rpy(*base[3:]), base[:3]))

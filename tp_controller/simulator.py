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

"""A kinematic robot: velocity commands in, joint positions out, with the faults of a real one."""

from collections import deque
from dataclasses import dataclass
import math

import numpy as np
from tp_controller.errors import RobotError, SettingsError, unknown
from tp_controller.resources import load_yaml, read_source


@dataclass(frozen=True)
class Imperfections:
    """
    What makes the simulated robot less than ideal; nothing does by default.

    Attributes
    ----------
    noise : float
        Standard deviation of measured positions [rad or m].
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

    def __post_init__(self):
        """Check the ranges."""
        faults = [f'{name} must be a finite number that is not negative, not {value!r}'
                  for name, value in (('noise', self.noise), ('delay', self.delay),
                                      ('lag', self.lag), ('drop', self.drop))
                  if isinstance(value, bool) or not isinstance(value, (int, float))
                  or not 0.0 <= value < math.inf]
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
    robot stops by itself when no command took effect for `timeout` seconds.

    Parameters
    ----------
    robot : Robot
    q : array_like (n,), optional
        Initial positions [rad or m]; as near to zero as the limits allow by default.
    timeout : float
        [s]
    imperfections : Imperfections, optional

    Attributes
    ----------
    q, velocity : ndarray (n,)
        True positions [rad or m] and velocities [rad/s or m/s].
    now : float
        Time that was reached [s].

    Raises
    ------
    RobotError
        `q` has the wrong shape or is not finite.
    SettingsError
        `timeout` is not positive.

    """

    def __init__(self, robot, q=None, timeout=0.1, imperfections=None):
        if not 0.0 < timeout < math.inf:
            raise SettingsError([f'timeout must be positive and finite, not {timeout!r}'])
        self.robot = robot
        self.imperfections = imperfections or Imperfections()
        self.timeout = timeout
        self._initial = robot.state(robot.neutral() if q is None else q).q.copy()
        self._random = np.random.default_rng(self.imperfections.seed)
        self.reset()

    def reset(self, now=0.0):
        """Go back to the initial positions, at rest, at time `now` [s]."""
        self.q = self._initial.copy()
        self.velocity = np.zeros(self.robot.n)
        self.now = now
        self._wanted = np.zeros(self.robot.n)
        self._expiry = -math.inf
        self._on_the_way = deque()

    def command(self, velocity):
        """
        Take a velocity command, now.

        Parameters
        ----------
        velocity : array_like (n,)
            [rad/s or m/s]

        Returns
        -------
        bool
            False where the command was lost, see `Imperfections`, or was not finite: a drive
            does not act on such a command.

        Raises
        ------
        RobotError
            Wrong shape.

        """
        velocity = np.array(velocity, dtype=float)
        if velocity.shape != (self.robot.n,):
            raise RobotError(f'a command needs {self.robot.n} velocities, '
                             f'got an array of shape {velocity.shape}')
        if self._lost() or not np.isfinite(velocity).all():
            return False
        self._on_the_way.append((self.now + self.imperfections.delay,
                                 np.clip(velocity, -self.robot.velocity, self.robot.velocity)))
        return True

    def step(self, dt):
        """
        Let `dt` seconds pass.

        Commands take effect, and time out, at their own time within the step.
        """
        end = self.now + dt
        while self.now < end:
            while self._on_the_way and self._on_the_way[0][0] <= self.now:
                self._wanted = self._on_the_way.popleft()[1]
                self._expiry = self.now + self.timeout
            if self.now >= self._expiry:
                self._wanted = np.zeros(self.robot.n)
            until = min([end, *(time for time, _ in list(self._on_the_way)[:1]),
                         *([self._expiry] if self._expiry > self.now else [])])
            self._move(until - self.now)
            self.now = until

    def measure(self):
        """
        Return what the robot's sensors say.

        Returns
        -------
        q, velocity : ndarray (n,) or None
            Measured positions, with noise, and velocities; None where the message was lost.

        """
        if self._lost():
            return None
        q = self.q.copy()
        if self.imperfections.noise > 0.0:
            q += self.imperfections.noise * self._random.standard_normal(self.robot.n)
        return q, self.velocity.copy()

    def _lost(self):
        """Draw whether a message gets lost."""
        return self.imperfections.drop > 0.0 and self._random.random() < self.imperfections.drop

    def _move(self, dt):
        """Move for `dt` seconds with the command in force."""
        lag = self.imperfections.lag
        if lag > 0.0:
            # Exact for a first-order drive: the mean velocity over dt, then the one at its end.
            decay = math.exp(-dt / lag)
            away = self.velocity - self._wanted
            mean = self._wanted + away * (lag / dt) * (1.0 - decay)
            self.velocity = self._wanted + away * decay
        else:
            mean = self.velocity = self._wanted
        moved = self.robot.integrate(self.q, mean, dt)
        # A robot that starts outside its limits is not thrown back, it only gets no further.
        lower = np.minimum(self.robot.lower, self.q)
        upper = np.maximum(self.robot.upper, self.q)
        stopped = (moved < lower) | (moved > upper)
        self.q = np.clip(moved, lower, upper)
        self.velocity = np.where(stopped, 0.0, self.velocity)


def initial_positions(source, robot):
    """
    Return initial positions from a YAML mapping {joint: position}.

    Parameters
    ----------
    source : str or pathlib.Path
        YAML text, a file's path, or ``package://<package>/<path>``. Joints it leaves out start
        as near to zero as their limits allow.
    robot : Robot
        Whose joints they are.

    Returns
    -------
    ndarray (n,)

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
        raise RobotError('initial positions: needs a mapping {joint: position}')
    q = robot.neutral()
    for joint, position in positions.items():
        if isinstance(position, bool) or not isinstance(position, (int, float)) \
                or not math.isfinite(position):
            raise RobotError(f'initial positions: {joint} must be a finite number, '
                             f'not {position!r}')
        if joint not in robot.joint_names:
            raise RobotError(f'initial positions: {unknown("joint", joint, robot.joint_names)}')
        q[robot.joint_index(joint)] = position
    return q

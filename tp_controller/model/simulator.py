# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Kinematic simulator: commands in, configurations out, with imperfections."""

from collections import deque
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from tp_controller.errors import RobotError, SettingsError, TimeError, unknown
from tp_controller.model.mobile_base import TWIST_NAMES
from tp_controller.model.robot import check_robot, Robot
from tp_controller.model.spatial import Array, pose, rotation_from_rpy
from tp_controller.resources import is_number, load_yaml, read_source

# A joint does not start at zero if that is nearer to a limit than this share of its range.
START_MARGIN = 0.05


@dataclass(frozen=True)
class SimulatorNoise:
    """
    Imperfections of the simulated robot; none by default.

    Attributes
    ----------
    noise : float
        Standard deviation of measured positions [rad or m]; the same along and about each axis of
        a base that has a velocity.
    delay : float
        Time from a command to its effect [s].
    lag : float
        Time constant of the drives, first order [s].
    drop : float
        Share of commands, and of measurements, that get lost, in [0, 1).
    seed : int
        Seed of the random numbers.

    Raises
    ------
    SettingsError
        Values are out of range; the error lists all of them.

    """

    noise: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    drop: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate the ranges."""
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
    Simulated robot that integrates velocity commands, or follows positions, within its limits.

    Commands are clipped at the velocity limits, positions stop at the position limits, and the
    robot stops by itself if no velocity took effect for `timeout` seconds; it holds positions. A
    base moves along the arc of a constant twist in its own axes.

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
        Simulated time [s].

    Raises
    ------
    RobotError
        `q` has the wrong shape, is not finite, or its quaternion does not have norm 1.
    SettingsError
        `timeout` is not positive.

    """

    def __init__(self, robot: Robot, q: ArrayLike | None = None, timeout: float = 0.1,
                 noise: SimulatorNoise | None = None) -> None:
        if not 0.0 < timeout < math.inf:
            raise SettingsError([f'timeout must be positive and finite, not {timeout!r}'])
        self.robot = check_robot(robot)
        self.noise = noise or SimulatorNoise()
        self.timeout = timeout
        self._initial = robot.state(start_configuration(robot) if q is None else q).q.copy()
        self._random = np.random.default_rng(self.noise.seed)
        self.reset()

    def reset(self, now: float = 0.0) -> None:
        """Reset to the initial configuration, at rest, at time `now` [s]."""
        self.q = self._initial.copy()
        self.velocity = np.zeros(self.robot.n)
        self.now = now
        self._target = np.zeros(self.robot.n)
        # When the present command of each joint times out; infinite without one.
        self._expiry = np.full(self.robot.n, math.inf)
        self._queue: deque[tuple[float, slice, Array, float | None]] = deque()
        # Joints that follow positions: along a line from `_origin` at `_began` to `_target`.
        self._follows = np.zeros(self.robot.n, dtype=bool)
        self._origin, self._began, self._duration = np.zeros(self.robot.n), 0.0, 0.0

    def command(self, velocity: ArrayLike, columns: slice = slice(None)) -> bool:
        """
        Accept a velocity command at the current time.

        Parameters
        ----------
        velocity : array_like (n,)
            [rad/s or m/s]
        columns : slice
            Entries to command, all by default: base and joints may be commanded separately, and
            time out separately. The others are ignored.

        Returns
        -------
        bool
            False if the command was lost, see `SimulatorNoise`, or was not finite: a drive does
            not act on such a command.

        Raises
        ------
        RobotError
            The shape is wrong.

        """
        limit = self.robot.velocity
        return self._accept(velocity, 'velocities', columns, -limit, limit, None)

    def command_positions(self, positions: ArrayLike, duration: float = 0.0) -> bool:
        """
        Accept positions of the joints at the current time; they apply until the next command.

        Parameters
        ----------
        positions : array_like (n,)
            [rad or m]; those of the base are ignored.
        duration : float
            Time in which the drives move their setpoint there, along a line [s].

        Returns
        -------
        bool
            See `command`.

        Raises
        ------
        RobotError
            The shape is wrong.

        """
        return self._accept(positions, 'positions', self.robot.joint_columns, self.robot.lower,
                            self.robot.upper, max(duration, 0.0))

    def _accept(self, values: ArrayLike, what: str, columns: slice, lower: Array, upper: Array,
                duration: float | None) -> bool:
        """Queue a command within limits (n,); return False if it was lost or is not finite."""
        target = np.array(values, dtype=float)
        if target.shape != (self.robot.n,):
            raise RobotError(f'a command needs {self.robot.n} {what}, '
                             f'got an array of shape {target.shape}')
        if self._lost() or not np.isfinite(target[columns]).all():
            return False
        clipped = np.minimum(np.maximum(target, lower), upper)
        self._queue.append((self.now + self.noise.delay, columns, clipped, duration))
        return True

    def step(self, dt: float) -> None:
        """
        Advance the simulation by `dt` seconds.

        Commands take effect, and time out, at their own time within the step. A time that is
        negative or not finite raises `TimeError`.
        """
        if not is_number(dt) or not 0.0 <= dt < math.inf:
            raise TimeError(f'dt must be a finite number that is not negative [s], got {dt!r}')
        end = self.now + dt
        while self.now < end:
            while self._queue and self._queue[0][0] <= self.now:
                _, columns, target, duration = self._queue.popleft()
                self._target[columns] = target[columns]
                self._follows[columns] = duration is not None
                self._expiry[columns] = math.inf if duration is not None \
                    else self.now + self.timeout
                if duration is not None:
                    self._origin = self.robot.positions(self.q).copy()
                    self._began, self._duration = self.now, duration
            until = float(self._expiry.min(initial=end))
            if until <= self.now:
                expired = self._expiry <= self.now
                self._target[expired], self._expiry[expired] = 0.0, math.inf
                until = float(self._expiry.min(initial=end))
            if self._queue:
                until = min(until, self._queue[0][0])
            self._move(until - self.now)
            self.now = until

    def measure(self) -> tuple[Array, Array] | None:
        """
        Return the measured configuration and velocities.

        Returns
        -------
        q, velocity : ndarray (nq,), ndarray (n,)
            Measured configuration, with noise, and velocities. None instead of both if the
            message was lost.

        """
        if self._lost():
            return None
        q = self.q.copy()
        if self.noise.noise > 0.0:
            # Integrated like a velocity, so that an orientation stays valid.
            error = self.noise.noise * self._random.standard_normal(self.robot.n)
            q = self.robot.integrate(q, error, 1.0)
        return q, self.velocity.copy()

    def _lost(self) -> bool:
        """Return at random whether a message is lost."""
        return self.noise.drop > 0.0 and self._random.random() < self.noise.drop

    def _move(self, dt: float) -> None:
        """Move for `dt` seconds with the active command."""
        lag = self.noise.lag
        if lag > 0.0:
            # Exact for a first-order drive: the mean velocity over dt, then the one at its end.
            decay = math.exp(-dt / lag)
            away = self.velocity - self._target
            mean = self._target + away * (lag / dt) * (1.0 - decay)
            self.velocity = self._target + away * decay
        else:
            mean = self.velocity = self._target.copy()
        robot = self.robot
        if self._follows.any() and dt > 0.0:
            mean = np.where(self._follows, self._following(dt), mean)
            self.velocity = np.where(self._follows, mean, self.velocity)
        moved = robot.integrate(self.q, mean, dt)
        before, after = robot.positions(self.q), robot.positions(moved)
        if ((robot.lower <= after) & (after <= robot.upper)).all():
            self.q = moved
            return
        # A robot that starts outside its limits does not jump back, but moves no further out.
        lower, upper = np.minimum(robot.lower, before), np.maximum(robot.upper, before)
        stopped = (after < lower) | (after > upper)
        self.q = moved.copy()
        self.q[robot.joint_rows] = np.clip(after, lower, upper)[robot.joint_columns]
        self.velocity = np.where(stopped, 0.0, self.velocity)

    def _following(self, dt: float) -> Array:
        """Return the mean velocities (n,) over `dt` seconds of joints that follow positions."""
        passed = self.now + dt - self._began
        share = min(passed / self._duration, 1.0) if self._duration > 0.0 else 1.0
        setpoint = self._origin + share * (self._target - self._origin)
        lag, limit = self.noise.lag, self.robot.velocity
        reached = 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0
        velocity = (setpoint - self.robot.positions(self.q)) * (reached / dt)
        return np.minimum(np.maximum(velocity, -limit), limit)


def start_configuration(robot: Robot) -> Array:
    """
    Return a configuration (nq,) away from all position limits, the base at the root.

    A joint is at zero. If zero is outside its range, or near a limit, it is in the middle of the
    range; with a limit on one side only it is as near to zero as that allows.
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
        YAML text, a file's path, or ``package://<package>/<path>``. Missing joints start as in
        `start_configuration`. A base that moves starts at the root, unless its pose is given by
        ``base_x``, ``base_y`` … ``base_yaw`` [m, rad].
    robot : Robot
        Robot of the joints.

    Returns
    -------
    ndarray (nq,)

    Raises
    ------
    RobotError
        The file is missing, a joint is unknown, or a position is not a number.

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
    axes = {TWIST_NAMES[row]: row for row in robot.base_reach}
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

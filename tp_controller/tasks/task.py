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

"""What every task is: an error, a Jacobian, and the law that turns the error into a velocity."""

from abc import ABC, abstractmethod
import inspect
import math

import numpy as np
from tp_controller.errors import GoalError, RobotError, TaskError, unknown
from tp_controller.solver.level import Level, MODES

DEFAULT_GAIN = 1.0
DEFAULT_TIMEOUT = 0.5
DEFAULT_MODE = 'least_squares'
# '1' is the unit of ratios.
DEFAULT_TOLERANCE = {'m': 1e-3, 'rad': 5e-3, '1': 1e-3}
# Numbers beyond this are taken for a mistake; they would only overflow further on.
LARGEST = 1e6


class Task(ABC):
    """
    A task of the stack: a value σ(q) that is led to a goal, or a velocity that is wanted.

    Conventions, for all tasks: ``error = desired − actual``, ``J = ∂σ/∂q``, and the wanted
    velocity is ``v = v_feed_forward + K error`` with the gain K in 1/s (lecture 1.1), so that an
    error the robot can follow decays as exp(−K t).

    A subclass sets `type_name`, which registers it, and implements `value`, `error`, `jacobian`
    and `parse_goal`. Its constructor's keywords are the keys of the YAML stack; `keys` describes
    each, and a `Keys` collects what is wrong with them until the constructor's last line calls
    `Keys.raise_faults`.

    Attributes
    ----------
    name : str
    units : tuple of str
        Unit of each row of the error: ``'m'``, ``'rad'``, or ``'1'`` for a ratio.
    rows : int
        Number of rows.
    bounded : bool
        The task keeps bounds instead of wanting a velocity; see `BoundedTask`.
    row_names : tuple of str or None
        What each row is about, for the report, where a name of the task does not say it all.
    remarks : tuple of str
        What who reads the stack should know, which is no fault.
    goal : object or None
        Goal in force, as `parse_goal` returns it; None before the task has started.
    held : bool
        The goal is only the value that the task had when it started.
    mode : str
        See `tp_controller.solver.level.Level`.
    stretch : float
        What the rows of the level are multiplied by. A singular value is small or large in metres
        and radians per radian; rows that are short by nature are stretched to compare with those
        of a frame.
    last_error : ndarray (rows,)
        Error at the last `level`.
    reference : str or None
        Frame that goals are expressed in; None where they are in no frame.
    goal_type, feed_forward_type : str or None
        What the task accepts from outside: ``point``, ``direction``, ``quaternion``, ``pose``,
        ``joints``, ``joint_velocities`` and ``twist``.
    goal_types : tuple of str
        The kinds that `goal_type` may be, where a key decides.

    """

    types = {}
    type_name = None
    goal_type = None
    goal_types = ()
    feed_forward_type = None
    reference = None
    bounded = False
    row_names = None
    remarks = ()
    stretch = 1.0
    keys = {
        'gain': 'gain K, one number or one for each row [1/s]',
        'tolerance': 'error below which the goal counts as reached: a number, or one for each '
                     'unit as {m: …, rad: …} [m, rad]',
        'timeout': 'how long a feed-forward velocity stays in force [s]',
        'mode': 'what happens where a limit is in the way: least_squares comes as near to the '
                'wanted velocity as possible, scale keeps its direction and slows down',
    }

    def __init_subclass__(cls, **options):
        """Register the type."""
        super().__init_subclass__(**options)
        if cls.type_name is not None:
            Task.types[cls.type_name] = cls

    def __init__(self, robot, name, units, keys, *, gain=DEFAULT_GAIN, tolerance=None,
                 timeout=DEFAULT_TIMEOUT, mode=DEFAULT_MODE):
        self.robot = robot
        self.name = name
        self.units = tuple(units)
        self.rows = len(self.units)
        self.gain = keys.check('gain', _gain, gain, None if keys.faults else self.rows)
        self.groups = keys.check('tolerance', _groups, self.units, tolerance)
        self.timeout = keys.check('timeout', positive, timeout)
        self.mode = keys.check('mode', _mode, mode)
        self.goal = None
        self.held = False
        self.last_error = np.zeros(self.rows)
        self._feed_forward = None
        self._feed_forward_time = -math.inf

    @classmethod
    def accepted_keys(cls):
        """Return {key: default} of the keys; `inspect.Parameter.empty` marks a needed one."""
        accepted = {}
        for base in cls.__mro__:
            if '__init__' in vars(base):
                parameters = inspect.signature(base.__init__).parameters.values()
                for parameter in parameters:
                    if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
                        # A subclass may need what its base can do without.
                        accepted.setdefault(parameter.name, parameter.default)
                # Only a constructor with ** hands keys on to the next one.
                if not any(parameter.kind is inspect.Parameter.VAR_KEYWORD
                           for parameter in parameters):
                    break
        return accepted

    @classmethod
    def described_keys(cls):
        """Return {key: description} of the keys taken, in the order of `accepted_keys`."""
        described = {}
        for base in reversed(cls.__mro__):
            described.update(vars(base).get('keys', {}))
        return {key: described.get(key, '') for key in cls.accepted_keys()}

    @abstractmethod
    def value(self, state):
        """Return the actual value at a `RobotState`, in the form of a goal."""

    @abstractmethod
    def error(self, state):
        """Return desired − actual (rows,), in `units`."""

    @abstractmethod
    def jacobian(self, state):
        """Return J (rows, n): the velocity of the value is J q_dot."""

    @abstractmethod
    def parse_goal(self, goal):
        """Return a goal in the form used inside; raise `GoalError` if it cannot be one."""

    def goal_in_reference(self, goal, T_reference_frame):
        """Return a goal given in another frame; raise `GoalError` where goals have no frame."""
        raise GoalError(f'a goal of task {self.name!r} is in no frame')

    def goal_pose(self, state):
        """Return T_reference_goal (4, 4) for display; None where the goal is no place."""
        return None

    def set_goal(self, goal, now):
        """Take a goal as `parse_goal` returned it."""
        self.goal = goal
        self.held = False

    def start(self, state):
        """Hold the value the task has now, unless there is a goal."""
        if self.goal is None:
            self.goal = self.value(state)
            self.held = True

    def release(self):
        """Forget a value that was only held, so that the next start holds a new one."""
        if self.held:
            self.goal = None

    def take_over(self, other):
        """Go on with the goal of a task that this one replaces, where it means the same."""
        if self.goal is None and self.means_the_same(other):
            self.goal, self.held = other.goal, other.held

    def means_the_same(self, other):
        """Say whether a goal of `other` is one of this task, too."""
        return type(self) is type(other) and self.reference == other.reference

    def parse_feed_forward(self, velocity):
        """Return a velocity in the form used inside; raise `GoalError` if it cannot be one."""
        raise GoalError(f'task {self.name!r} takes no feed-forward velocity')

    def feed_forward_in_reference(self, velocity, R_reference_frame):
        """Return a velocity given in the axes of another frame; `GoalError` where it has none."""
        raise GoalError(f'a velocity of task {self.name!r} is in no frame')

    def set_feed_forward(self, velocity, now):
        """Add a velocity, as `parse_feed_forward` returned it, until it times out."""
        self._feed_forward = velocity
        self._feed_forward_time = now

    def velocity(self, error, now):
        """
        Return the wanted velocity, feed-forward + K error (lecture 1.1).

        Parameters
        ----------
        error : ndarray (rows,)
            In `units`.
        now : float
            Time [s], of the clock that `set_feed_forward` was given.

        Returns
        -------
        ndarray (rows,)
            In `units` per second.

        """
        added = self.feed_forward(now)
        return self.gain * error if added is None else self.gain * error + added

    def feed_forward(self, now):
        """Return the feed-forward velocity in force; None where there is none (any more)."""
        # A clock that was set back must not keep an old velocity alive either.
        if self._feed_forward is not None and \
                not abs(now - self._feed_forward_time) <= self.timeout:
            self._feed_forward = None
        return self._feed_forward

    def level(self, state, now):
        """Return the `Level` at a state, and remember the error for the report."""
        error = self.error(state)
        self.last_error = error
        return Level(self.jacobian(state), self.velocity(error, now), self.mode)

    def reported_errors(self, error, residual):
        """
        Return what the report shows as error.

        Parameters
        ----------
        error : ndarray (rows,)
            Error of the value.
        residual : ndarray (rows,)
            Wanted minus achieved velocity.

        Returns
        -------
        tuple of (float, str, float)
            For each unit: norm of the error, unit, tolerance.

        """
        return tuple((norm(error[rows]), unit, tolerance)
                     for rows, unit, tolerance in self.groups)


class Keys:
    """Collects what is wrong with the keys of a task, to report all of it at once."""

    def __init__(self):
        self.faults = []

    def check(self, key, function, *arguments):
        """Return what `function` returns; where it refuses, note the fault and return None."""
        try:
            return function(*arguments)
        except (ValueError, GoalError, RobotError) as error:
            self.faults.append((key, str(error)))
            return None

    def raise_faults(self, name):
        """Raise `TaskError` if there are any."""
        if self.faults:
            raise TaskError(name, self.faults)


def norm(vector):
    """Return the Euclidean norm as a float."""
    return math.sqrt(vector.dot(vector))


def number(value):
    """Return a finite float, or raise ValueError."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
        raise ValueError(f'needs a number of at most {LARGEST:g}, got {value!r}')
    return float(value)


def positive(value):
    """Return a positive float, or raise ValueError."""
    value = number(value)
    if value <= 0.0:
        raise ValueError(f'must be positive, got {value:g}')
    return value


def non_negative(value):
    """Return a float that is not negative, or raise ValueError."""
    value = number(value)
    if value < 0.0:
        raise ValueError(f'must not be negative, got {value:g}')
    return value


def has_shape(values, shape):
    """Say whether `values` is an array, or nested lists, of a shape."""
    try:
        return np.shape(values) == shape
    except ValueError:
        return False


def finite_vector(values, size, what):
    """
    Return `values` as a new float array of one row.

    Raises
    ------
    GoalError
        Another shape, not finite, or beyond `LARGEST`.

    """
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise GoalError(f'{what} needs {size} numbers, got {values!r}') from error
    if vector.shape != (size,):
        raise GoalError(f'{what} needs {size} numbers, got an array of shape {vector.shape}')
    if not (np.abs(vector) <= LARGEST).all():
        raise GoalError(f'{what} must be finite and at most {LARGEST:g}, got {vector.tolist()}')
    return vector


def _mode(mode):
    """Return a mode of `Level`, or raise ValueError."""
    if mode not in MODES:
        raise ValueError(unknown('mode', mode, MODES))
    return mode


def _gain(gain, rows):
    """Return the gain as a float, or as an array with one for each row (None: not known)."""
    if not isinstance(gain, (list, tuple, np.ndarray)):
        return positive(gain)
    if rows is not None and len(gain) != rows:
        raise ValueError(f'needs one number, or one for each of the {rows} rows, '
                         f'got {len(gain)}')
    return np.array([positive(value) for value in gain])


def _groups(units, tolerance):
    """Return (row indices, unit, tolerance) for each unit that occurs."""
    present = tuple(dict.fromkeys(units))
    if tolerance is None:
        tolerance = DEFAULT_TOLERANCE
    if not isinstance(tolerance, dict):
        tolerance = dict.fromkeys(present, tolerance)
    for unit in tolerance:
        if unit not in DEFAULT_TOLERANCE:
            raise ValueError(f'unknown unit {unit!r}; valid: {", ".join(DEFAULT_TOLERANCE)}')
    tolerance = {**DEFAULT_TOLERANCE, **tolerance}
    return tuple((np.flatnonzero([unit == other for other in units]), unit,
                  positive(tolerance[unit])) for unit in present)

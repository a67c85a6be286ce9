# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a task: validation, and one report of all faults."""

from collections.abc import Callable, Mapping, Sequence
import math
from typing import Any, cast, NamedTuple, ParamSpec, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tp_controller.errors import GoalError, RobotError, TaskError, unknown
from tp_controller.model.spatial import Array
from tp_controller.resources import is_number
from tp_controller.solver.level import MODES

# Default tolerance by unit; '1' is the unit of ratios.
DEFAULT_TOLERANCE = {'m': 1e-3, 'rad': 5e-3, '1': 1e-3}
# Largest accepted magnitude of a number; larger ones are mistakes, and would overflow later.
MAX_NUMBER = 1e6

Gain: TypeAlias = float | Sequence[float] | Array
Tolerance: TypeAlias = float | Mapping[str, float]
Given = ParamSpec('Given')
Checked = TypeVar('Checked')


class UnitRows(NamedTuple):
    """
    Rows of a task with the same unit.

    Attributes
    ----------
    rows : ndarray of int, or slice
        Indices of the rows.
    unit : str
    tolerance : float
        Error below which the goal counts as reached.

    """

    rows: NDArray[np.intp] | slice
    unit: str
    tolerance: float


class Keys:
    """Collector of the faults of the keys of a task, to report all at once."""

    def __init__(self) -> None:
        self.faults: list[tuple[str, str]] = []

    def check(self, key: str, function: Callable[Given, Checked], *arguments: Given.args,
              **options: Given.kwargs) -> Checked:
        """Return the result of `function`; if it refuses, record the fault and return None."""
        try:
            return function(*arguments, **options)
        except (ValueError, GoalError, RobotError) as error:
            self.faults.append((key, str(error)))
            # None contradicts the type, but `raise_faults` then refuses the task.
            return cast('Checked', None)

    def raise_faults(self, name: str) -> None:
        """Raise `TaskError` if there are faults."""
        if self.faults:
            raise TaskError(name, self.faults)


def number(value: object) -> float:
    """Return a finite float, or raise ValueError."""
    if not (is_number(value) and abs(value) <= MAX_NUMBER):
        raise ValueError(f'needs a number of at most {MAX_NUMBER:g}, got {value!r}')
    return float(value)


class Number:
    """
    Parser of a number in a range.

    Parameters
    ----------
    zero : bool
        Zero is valid; negative numbers are not.
    below : float, optional
        Number above the range.
    below_text : str, optional
        Its name in texts.

    Attributes
    ----------
    range : str
        Range as text.

    """

    def __init__(self, zero: bool, below: float = math.inf, below_text: str = '') -> None:
        self._zero, self._below, self._below_text = zero, below, below_text
        self.range = ('≥ 0' if zero else '> 0') + (f', < {below_text}' if below_text else '')

    def __call__(self, value: object) -> float:
        """Return the number as a float, or raise ValueError."""
        found = number(value)
        if self._zero and found < 0.0:
            raise ValueError(f'must not be negative, got {found:g}')
        if not self._zero and found <= 0.0:
            raise ValueError(f'must be positive, got {found:g}')
        if found >= self._below:
            raise ValueError(f'must be less than {self._below_text}, got {found:g}')
        return found


def parse_kinds(kinds: object) -> tuple[str, ...]:
    """Return one text or a list of them as a tuple, or raise ValueError."""
    each = [kinds] if isinstance(kinds, str) else kinds
    if not isinstance(each, (list, tuple)) or not all(isinstance(kind, str) for kind in each):
        raise ValueError(f'needs a list of kinds of findings, got {kinds!r}')
    return tuple(each)


# Parsers of positive numbers, and of numbers that are not negative.
positive, non_negative = Number(zero=False), Number(zero=True)


def named_positive(key: str, value: object) -> float:
    """Return a positive float, or raise a ValueError that names the key."""
    try:
        return positive(value)
    except ValueError as error:
        raise ValueError(f'{key} {error}') from error


def has_shape(values: ArrayLike, shape: tuple[int, ...]) -> bool:
    """Return whether `values` is an array, or nested lists, of a shape."""
    try:
        return np.shape(values) == shape
    except ValueError:
        return False


def finite_vector(values: ArrayLike, size: int, what: str) -> Array:
    """
    Return `values` as a new float array (size,).

    Raises
    ------
    GoalError
        Wrong shape, not finite, or beyond `MAX_NUMBER`.

    """
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise GoalError(f'{what} needs {size} numbers, got {values!r}') from error
    if vector.shape != (size,):
        raise GoalError(f'{what} needs {size} numbers, got an array of shape {vector.shape}')
    if not (np.abs(vector) <= MAX_NUMBER).all():
        raise GoalError(f'{what} must be finite and at most {MAX_NUMBER:g}, got {vector.tolist()}')
    return vector


def parse_mode(mode: str) -> str:
    """Return a mode of `Level`, or raise ValueError."""
    if mode not in MODES:
        raise ValueError(unknown('mode', mode, MODES))
    return mode


def parse_gain(gain: Gain, rows: int | None) -> Array:
    """Return the gain as an array () or (rows,); `rows` is None if the number is unknown."""
    if isinstance(gain, np.ndarray) and gain.ndim == 0:
        gain = gain.item()
    if not isinstance(gain, (list, tuple, np.ndarray)):
        return np.array(positive(gain))
    if rows is not None and len(gain) != rows:
        raise ValueError(f'needs one number, or one for each of the {rows} rows, '
                         f'got {len(gain)}')
    return np.array([positive(value) for value in gain])


def parse_tolerance(units: Sequence[str],
                    tolerance: Tolerance | None) -> tuple[UnitRows, ...]:
    """Return the rows and the tolerance of each unit that occurs, or raise ValueError."""
    present = tuple(dict.fromkeys(units))
    given = {} if tolerance is None else (
        tolerance if isinstance(tolerance, dict) else dict.fromkeys(present, tolerance))
    for unit in given:
        if unit not in DEFAULT_TOLERANCE:
            raise ValueError(f'unknown unit {unit!r}; valid: {", ".join(DEFAULT_TOLERANCE)}')
    tolerances = {**DEFAULT_TOLERANCE, **given}
    return tuple(UnitRows(np.flatnonzero([unit == other for other in units]), unit,
                          positive(tolerances[unit])) for unit in present)


def parse_weights(weights: Any, units: Sequence[str],
                  names: Mapping[str, Sequence[int]]) -> Array:
    """
    Return weights of rows as an array () or (rows,), or raise ValueError.

    Parameters
    ----------
    weights : float, sequence or mapping
        One number, one for each row, or {name: number} of some rows; the others weigh 1. Of
        several names of a row, such as a joint and its group, that of fewer rows counts.
    units : sequence of str
        Unit of each row.
    names : mapping
        {name: indices of rows}.

    """
    if not isinstance(weights, Mapping):
        return parse_gain(weights, len(units) or None)
    found = np.ones(len(units))
    for name in weights:
        if name not in names:
            raise ValueError(unknown('name of rows', name, names))
    for name in sorted(weights, key=lambda each: len(names[each]), reverse=True):
        found[list(names[name])] = named_positive(str(name), weights[name])
    return found


def optional(parse: Callable[[Any], Checked]) -> Callable[[Any], Checked | None]:
    """Return a parser that leaves None as it is, and parses other values."""
    def parsed(value: Any) -> Checked | None:
        return None if value is None else parse(value)
    # For the texts about a key.
    parsed.range = getattr(parse, 'range', '')  # type: ignore[attr-defined]
    return parsed


def check_mapping(name: str, keys: Any, valid: Sequence[str], needed: set[str],
                  form: str) -> None:
    """Raise ValueError if a needed key is missing, or a key is invalid."""
    if not isinstance(keys, dict):
        raise ValueError(f'{name} needs {form}, got {keys!r}')
    for key in keys:
        if key not in valid:
            raise ValueError(f'{name}: {unknown("key", key, valid)}')
    if not needed <= set(keys):
        raise ValueError(f'{name} needs {form}, got {keys!r}')

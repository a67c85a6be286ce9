# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Curves of the errors and limiting causes of all tasks over time."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np
from tp_controller.model.spatial import Array
from tp_controller.tools.plots.drawing import label
from tp_controller.tools.recording.series import Series
from tp_controller.untrusted.texts import LONGEST_TEXT

# Largest number of distinct sets of causes, which bounds the memory for any recording.
MOST_SETS = 5000
# Largest number of curves in a plot.
MOST_CURVES = 100


class TaskCurves:
    """
    Curves of all tasks of one controller.

    Attributes
    ----------
    errors : Series
        Errors, in the order of `columns`.
    columns : dict
        {(task, unit): column}
    causes : Series
        Codes of the limiting causes of each task, in the order of `cause_columns`; see `sets`.
    cause_columns : dict
        {task: column}
    sets : list of tuple of str
        Causes of the codes; 0 stands for no cause.

    """

    def __init__(self) -> None:
        self.errors, self.columns = Series(0), dict[tuple[str, str], int]()
        self.causes, self.cause_columns = Series(0), dict[str, int]()
        self.sets: list[tuple[str, ...]] = [()]
        self._codes: dict[tuple[str, ...], float] = {(): 0.0}

    def add(self, time: float,
            samples: Mapping[str, tuple[Mapping[str, float], Sequence[str]]]) -> None:
        """
        Add the samples of one time.

        Parameters
        ----------
        time : float
            [s]
        samples : dict
            {task: ({unit: error}, causes)}

        """
        errors, codes = [math.nan] * len(self.columns), [0.0] * len(self.cause_columns)
        for name, (values, causes) in samples.items():
            for unit, error in values.items():
                _put(errors, self.columns, (name, unit), error, math.nan)
            _put(codes, self.cause_columns, name, self._code(causes), 0.0)
        self.errors.add(time, errors)
        self.causes.add(time, codes)

    def plotted(self) -> tuple[Array, list[tuple[str, str, Array]],
                               dict[str, list[tuple[str, ...]]]]:
        """
        Return the arguments of `plots.curves.plot_errors`, without errors that are always zero.

        Returns
        -------
        times : ndarray (T,)
            [s]
        errors : list of (str, str, ndarray (T,))
            Task, unit and errors; NaN while they are unknown, as during a stop.
        causes : dict
            {task: limiting causes (T,)}

        """
        times, values = self.errors.rows()
        _, codes = self.causes.rows()
        errors = [(label(task), label(unit), values[:, column])
                  for (task, unit), column in self.columns.items()
                  if np.nan_to_num(values[:, column]).max(initial=0.0) > 0.0][:MOST_CURVES]
        sets = [tuple(label(cause, LONGEST_TEXT) for cause in each) for each in self.sets]
        # A task outside the stack has no cause.
        return times, errors, {label(task): [sets[code] for code in np.nan_to_num(
            codes[:, column]).astype(int).tolist()]
            for task, column in self.cause_columns.items()}

    def _code(self, causes: Sequence[str]) -> float:
        """Return the code of a set of causes."""
        key = tuple(sorted({*causes}))
        if key not in self._codes and len(self.sets) >= MOST_SETS:
            key = ('another cause',)
        if key not in self._codes:
            self._codes[key] = float(len(self.sets))
            self.sets.append(key)
        return self._codes[key]


def _put(row: list[float], columns: dict[Any, int], key: object, value: float,
         missing: float) -> None:
    """Set the value in the column of a key; add the column if it is new."""
    column = columns.setdefault(key, len(columns))
    row.extend([missing] * (column + 1 - len(row)))
    row[column] = value

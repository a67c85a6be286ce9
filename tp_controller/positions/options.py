# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Options of a search for configurations."""

from dataclasses import dataclass, fields
import math
from typing import Any

import numpy as np
from tp_controller.errors import SettingsError, unknown
from tp_controller.positions.choice import CRITERIA

# Largest number of descents of a search.
MOST_ATTEMPTS = 10_000


@dataclass(frozen=True)
class SearchOptions:
    """
    Options of `PositionSolver.solve`; see there.

    Raises
    ------
    SettingsError
        All that are out of range.

    """

    attempts: int = 40
    timeout: float = 0.05
    seed: int = 0
    criterion: str = 'nearest'

    def __post_init__(self) -> None:
        """Validate all options."""
        faults = []
        if not _is_whole(self.attempts, MOST_ATTEMPTS) or self.attempts == 0:
            faults.append(f'attempts must be a whole number from 1 to {MOST_ATTEMPTS}, '
                          f'not {self.attempts!r}')
        if not _is_time(self.timeout):
            faults.append(f'timeout must be more than 0 s, not {self.timeout!r}')
        if not _is_whole(self.seed, math.inf):
            faults.append(f'seed must be a whole number that is not negative, not {self.seed!r}')
        if not isinstance(self.criterion, str) or self.criterion not in CRITERIA:
            faults.append(unknown('criterion', self.criterion, CRITERIA))
        if faults:
            raise SettingsError(faults)


def options_of(given: dict[str, Any]) -> SearchOptions:
    """Return options by their names, or raise `SettingsError`."""
    names = [item.name for item in fields(SearchOptions)]
    faults = [unknown('option', name, names) for name in given if name not in names]
    if faults:
        raise SettingsError(faults)
    return SearchOptions(**given)


def _is_whole(value: object, most: float) -> bool:
    """Return whether a value is a whole number from 0 to `most`."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) \
        and 0 <= int(value) <= most


def _is_time(value: object) -> bool:
    """Return whether a value is a time that is not over at once, perhaps infinite."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        return False
    try:
        return float(value) > 0.0
    except (OverflowError, TypeError):
        return False

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of a demonstration: measurements with their references, and the film."""

from dataclasses import dataclass
import os
from pathlib import Path
import sys

from tp_controller.errors import TpControllerError
from tp_controller.tools.demos.motion import Motion
from tp_controller.tools.extras import install_command

# Environment variable of the films, and its value for none.
FILM_VARIABLE, NONE = 'TP_CONTROLLER_FILM', 'none'
DECIMALS = {'m': 3, 'mm': 3, '°': 3, '%': 1, 'rad': 5, 'rad/s': 3}


@dataclass(frozen=True)
class Measurement:
    """Measured number with its reference, or its upper bound if `bound` is set."""

    quantity: str
    unit: str
    measured: float
    reference: float
    tolerance: float
    bound: bool = False

    @property
    def passed(self) -> bool:
        """Return whether the number meets its reference within the tolerance."""
        excess = self.measured - self.reference
        return (excess if self.bound else abs(excess)) <= self.tolerance

    def __str__(self) -> str:
        """Return the line of the table."""
        decimals = DECIMALS[self.unit]
        reference = f'{"<= " if self.bound else ""}{self.reference:.{decimals}f}'
        return (f'{self.quantity:<50} {self.unit:<6} {self.measured:>10.{decimals}f} '
                f'{reference:>10}  {"ok" if self.passed else "WRONG"}')


@dataclass(frozen=True)
class Outcome:
    """Results of an experiment: measurements, more lines to print, written files."""

    title: str
    measurements: tuple[Measurement, ...]
    lines: tuple[str, ...]
    paths: tuple[Path, ...]

    @property
    def passed(self) -> bool:
        """Return whether every measurement passed."""
        return all(measurement.passed for measurement in self.measurements)

    def __str__(self) -> str:
        """Return the outcome as text."""
        head = f'{"":<50} {"unit":<6} {"measured":>10} {"reference":>10}'
        return '\n'.join((self.title, head, *map(str, self.measurements), *self.lines, 'Written:',
                          *(f'  {path}' for path in self.paths)))


def films(path: Path, motion: Motion) -> tuple[Path, ...]:
    """
    Write the film of a motion where viser and a Chromium are installed; print why if not.

    Returns
    -------
    tuple of pathlib.Path
        Path of the film; empty without one, as with ``TP_CONTROLLER_FILM=none``.

    """
    if os.environ.get(FILM_VARIABLE) == NONE:
        return ()
    try:
        from tp_controller.tools.demos.film import write_film
        return (write_film(path, motion),)
    except ModuleNotFoundError as error:
        reason = f'{error.name} is missing: {install_command("view")}'
    except TpControllerError as error:
        reason = str(error)
    print(f'No film is drawn: {reason}', file=sys.stderr, flush=True)
    return ()

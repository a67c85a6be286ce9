# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the method as node parameters."""

from collections.abc import Mapping
from typing import Any

from tp_controller.control.settings import Settings
from tp_controller.errors import SettingsError
from tp_controller.ros.declarations.controller import SETTINGS
from tp_controller.ros.declarations.spec import EQUAL


def settings_from(values: Mapping[str, Any], period: float, origin: str) -> Settings:
    """
    Return `Settings` from parameter values.

    Parameters
    ----------
    values : dict
        Values of `SETTINGS`.
    period : float
        [s]
    origin : str
        Origin of the period, which is not a parameter.

    Raises
    ------
    SettingsError
        Invalid values.

    """
    given = {spec.name: values[spec.name] for spec in SETTINGS}
    given['workspace'] = tuple(given['workspace'])
    given['weights'] = None if list(given['weights']) == EQUAL else tuple(given['weights'])
    try:
        return Settings(period=period, **given)
    except SettingsError as error:
        raise SettingsError([f'{fault} (period is {origin})' if 'period' in fault else fault
                             for fault in error.faults]) from error

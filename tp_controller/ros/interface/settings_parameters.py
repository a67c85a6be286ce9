# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the method as node parameters."""

from collections.abc import Mapping
from typing import Any

from tp_controller.control.settings import Settings
from tp_controller.errors import SettingsError
from tp_controller.ros.declarations.controller import PARAMETERS, SETTINGS
from tp_controller.ros.declarations.spec import EQUAL
from tp_controller.ros.loop.outputs import output_type


def settings_from(values: Mapping[str, Any], period: float, origin: str) -> Settings:
    """
    Return `Settings` from parameter values.

    Parameters
    ----------
    values : dict
        Values of `PARAMETERS`.
    period : float
        [s]
    origin : str
        Origin of the period, which is not a parameter.

    Raises
    ------
    SettingsError
        Invalid values.

    """
    faults = list(filter(None, [spec.fault(values[spec.name]) for spec in PARAMETERS
                                if spec.valid]))
    if faults:
        raise SettingsError(faults)
    given = {spec.name: values[spec.name] for spec in SETTINGS}
    if output_type(values['output']).holds:
        # Commanded positions reflect all commands at once.
        given['command_delay'] = 0
    given['workspace'] = tuple(given['workspace'])
    given['weights'] = None if list(given['weights']) == EQUAL else tuple(given['weights'])
    try:
        return Settings(period=period, **given)
    except SettingsError as error:
        raise SettingsError([f'{fault} (period is {origin})' if 'period' in fault else fault
                             for fault in error.faults]) from error

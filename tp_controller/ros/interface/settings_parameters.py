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

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a terminal that drive a task, from a parameter file."""

from collections.abc import Mapping
import re
from typing import Any, NamedTuple, TypeAlias

from tp_controller.errors import SettingsError, unknown
from tp_controller.tools.teleop.declarations import PARAMETERS
from tp_controller.tools.teleop.mapping import DIRECTIONS, signed_terms

# {key: (direction, sign)}
Keys: TypeAlias = Mapping[str, tuple[str, float]]
# The file that is used by default.
KEYBOARD = 'package://tp_controller/config/teleop/keyboard.yaml'
STOP_KEY, FASTER, SLOWER, QUIT = ' ', '+', '-', 'q'
TERM = re.compile(r'\s*([+-]?)\s*key\s+(\S)\s*')
VALUES = ('linear_scale', 'angular_scale', 'timeout', 'ramp', 'frame')
SPECS = {spec.name: spec for spec in PARAMETERS if spec.name in (*DIRECTIONS, *VALUES)}


class KeyMap(NamedTuple):
    """
    Keys, and how they move the tool.

    Attributes
    ----------
    keys : mapping
        {key: (direction of `DIRECTIONS`, sign)}
    linear, angular : float
        Speeds of the keys [m/s, rad/s].
    seconds, ramp : float
        Time that a key moves, and time to full speed [s].
    frame : str
        Frame along whose axes they move; empty for the reference of the task.

    """

    keys: Keys
    linear: float
    angular: float
    seconds: float
    ramp: float
    frame: str

    @property
    def text(self) -> str:
        """Return the keys for those who press them."""
        groups = [(label, '   '.join(filter(None, map(self._pair, names))))
                  for label, names in (('move', DIRECTIONS[:3]), ('turn', DIRECTIONS[3:]))]
        first = '      '.join(f'{label}   {text}' for label, text in groups if text)
        end = 'Ctrl-C' if QUIT in self.keys else f'{QUIT} or Ctrl-C'
        return (f'{first}\nspace stop     {FASTER}/{SLOWER} faster, slower     {end} end     '
                'hold a key to go on moving')

    def _pair(self, name: str) -> str:
        """Return the keys of a direction, the positive ones first."""
        found = [key for sign in (1.0, -1.0)
                 for key, moved in self.keys.items() if moved == (name, sign)]
        return f'{"/".join(found)} {name.replace("r", "about ")}' if found else ''


def key_map(parameters: Mapping[str, Any]) -> KeyMap:
    """
    Return the keys of a parameter file.

    Parameters
    ----------
    parameters : mapping
        {name: value}; each direction is a sum such as ``key w - key s``.

    Raises
    ------
    SettingsError
        A parameter is unknown or faulty, a key has two meanings, or there is none.

    """
    faults = [SPECS[name].fault(value) for name, value in parameters.items() if name in SPECS]
    others = [name for name in parameters if name not in SPECS]
    if others:
        faults.append(unknown('parameter of a keyboard', others[0], SPECS))
    values = {**{name: spec.default for name, spec in SPECS.items()}, **parameters}
    keys: dict[str, tuple[str, float]] = {}
    for name in DIRECTIONS if not any(faults) else ():
        try:
            for sign, found in signed_terms(values[name], TERM,
                                            'of keys such as key w - key s'):
                key = found[2]
                if key in (*keys, FASTER, SLOWER):
                    raise ValueError(f'key {key} has another meaning, too')
                keys[key] = name, sign
        except ValueError as error:
            faults.append(f'parameter {name}: {error}')
    if not (keys or any(faults)):
        faults.append(f'no keys: one of the parameters {", ".join(DIRECTIONS)} is needed')
    if any(faults):
        raise SettingsError(filter(None, faults))
    return KeyMap(keys, float(values['linear_scale']), float(values['angular_scale']),
                  float(values['timeout']), float(values['ramp']), values['frame'])

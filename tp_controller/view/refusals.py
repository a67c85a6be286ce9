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

"""Refusals of ROS in the words of the page."""

import math
import re

from tp_controller.nodes.parameters import TASKS

OUT_OF_RANGE = re.compile(r'Parameter (\S+) out of range\.? Min: (\S+), Max: (\S+), value: (\S+)')


def refusal_in_words(reason: str) -> str:
    """Return why a parameter was refused; what the node itself says stays as it is."""
    found = OUT_OF_RANGE.fullmatch(reason.strip())
    if found is None:
        return reason
    name, *numbers = found.groups()
    try:
        lower, upper, value = map(float, numbers)
    except ValueError:
        return reason
    if not math.isfinite(upper):
        allowed = f'at least {lower:g}'
    else:
        allowed = f'from {lower:g} to {upper:g}' if math.isfinite(lower) else f'at most {upper:g}'
    task, dot, key = name.removeprefix(TASKS).rpartition('.')
    what = f'{key} of task {task}' if name.startswith(TASKS) and dot else name
    return f'the {what} must be {allowed}, not {value:g}'

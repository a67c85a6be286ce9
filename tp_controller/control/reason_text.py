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

"""Reasons of limited tasks, taken apart and shortened for tables and panels."""

import re

# End of a reason whose causes limit a task only together.
TOGETHER = ' together'
# How many of them are named.
MOST_NAMED = 3


def causes_in(reason: str) -> list[str]:
    """
    Return the causes that a reason names, the most important ones only where there are many.

    Parameters
    ----------
    reason : str
        As a report has it.

    Returns
    -------
    list of str
        Those that limit a task only together begin with ``+`` from the second one on.

    """
    together = reason.removesuffix(TOGETHER)
    if together == reason:
        return [cause for cause in reason.split('; ') if cause]
    first, *others = re.split(', | and ', together)
    named = [f'+ {other}' for other in others[:MOST_NAMED - 1]]
    more = len(others) - len(named)
    return [first, *named, *([f'+ {more} more'] if more else [])]


def brief_reason(reason: str) -> str:
    """Return a reason in one line that names no more causes than can be read."""
    causes = causes_in(reason)
    return ' '.join(causes) if reason.endswith(TOGETHER) else '; '.join(causes)

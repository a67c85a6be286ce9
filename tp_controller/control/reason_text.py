# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reasons of limited tasks, parsed and shortened for tables and panels."""

import re

# End of a reason whose causes limit a task only together.
TOGETHER = ' together'
# Largest number of these causes that are named.
MOST_NAMED = 3


def causes_in(reason: str) -> list[str]:
    """
    Return the causes that a reason names, at most the most important `MOST_NAMED` of many.

    Parameters
    ----------
    reason : str
        `TaskReport.reason`.

    Returns
    -------
    list of str
        Causes that limit a task only together begin with ``+`` from the second one on.

    """
    together = reason.removesuffix(TOGETHER)
    if together == reason:
        return [cause for cause in reason.split('; ') if cause]
    first, *others = re.split(', | and ', together)
    named = [f'+ {other}' for other in others[:MOST_NAMED - 1]]
    more = sum(map(_count, others[MOST_NAMED - 1:]))
    return [first, *named, *([f'+ {more} more'] if more else [])]


def brief_reason(reason: str) -> str:
    """Return a reason in one line, with its most important causes only."""
    causes = causes_in(reason)
    return ' '.join(causes) if reason.endswith(TOGETHER) else '; '.join(causes)


def _count(cause: str) -> int:
    """Return the number of causes of a part of a reason, such as ``2 more tasks``."""
    counted = re.match(r'(\d+) more ', cause)
    return int(counted[1]) if counted else 1

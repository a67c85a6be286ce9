# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Units of numbers in texts."""


def with_unit(value: str, unit: str) -> str:
    """Return a number and its unit as text."""
    return value if unit == '1' else f'{value} {unit}'

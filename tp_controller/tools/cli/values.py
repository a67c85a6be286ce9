# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parsers of numbers of the command line."""

import argparse
import math


def finite_number(text: str) -> float:
    """Parse a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text.strip()!r} is not a finite number')
    return value


def positive_number(text: str) -> float:
    """Parse a positive number."""
    value = finite_number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f'{text.strip()!r} must be positive')
    return value


def whole_number(text: str) -> int:
    """Parse an integer from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 0 on')
    return int(text)


def whole_count(text: str) -> int:
    """Parse an integer from 1 on."""
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f'{text!r} is not a whole number from 1 on')
    return int(text)


def assignment(text: str) -> tuple[str, float]:
    """Parse (name, value) of NAME=VALUE."""
    name, equals, value = text.partition('=')
    if not equals or not name:
        raise argparse.ArgumentTypeError(f'{text!r} is not of the form NAME=VALUE')
    return name, finite_number(value)

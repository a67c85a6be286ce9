# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Offline check of a stack for faults and doubtful properties."""

from tp_controller.tools.check.checker import check
from tp_controller.tools.check.results import CheckReport

__all__ = ['CheckReport', 'check']

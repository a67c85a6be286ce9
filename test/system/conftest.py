# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of the tests that run whole processes and browsers."""

from browser_harness import chromium, server
from processes_harness import cell, domain, environment, listener, start

__all__ = ['cell', 'chromium', 'domain', 'environment', 'listener', 'server', 'start']

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""One Hypothesis profile for all tests: the same examples every time, and no time limits."""

from hypothesis import settings

settings.register_profile('unit', derandomize=True, deadline=None, max_examples=60)
settings.load_profile('unit')

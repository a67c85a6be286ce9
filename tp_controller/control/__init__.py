# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Control cycle: joint limits to bounds, tasks to levels, solution to command and report."""

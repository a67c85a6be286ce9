# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Task-priority solver: levels in, velocities out; independent of robot, tasks and clock."""

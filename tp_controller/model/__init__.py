# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Robot model: kinematics, limits, shapes, a moving base, and a simulator."""

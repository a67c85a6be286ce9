# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
References over time: a value and its velocity at every time.

Knots with times become a smooth curve (`curve`, `forms`); chunks of a stream are joined to one
reference without a jump in value, velocity or acceleration (`reference`, where to begin reading).
It imports the model's rotations and the core: no robot, no task, no clock.
"""

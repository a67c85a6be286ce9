# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Inverse kinematics of a stack: the configuration at which its tasks are carried out best.

Where `control` computes one cycle, this is where the cycles would lead, in large steps. Begin with
`solve_position`.
"""

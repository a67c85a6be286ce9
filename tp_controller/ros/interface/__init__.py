# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Parameters, goals, status, markers and transforms: the interface of a node beside its loop.

Imports the library, the common modules of `ros`, and `loop`. Begin with `task_topics`.
"""

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings of controllers in ROS 2 bags: writing, reading, and reports."""

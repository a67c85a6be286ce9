# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Declarations of the parameters of controller and simulator, as data that need no ROS."""

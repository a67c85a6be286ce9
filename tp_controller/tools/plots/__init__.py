# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Plots of recorded motions."""

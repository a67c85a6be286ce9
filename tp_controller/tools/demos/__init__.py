# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Demonstrations, and films of recorded motions."""

# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Untrusted code and texts of others: a context for calls of the code, a filter for the texts.

It imports nothing of the package. Begin reading with `calls`.
"""

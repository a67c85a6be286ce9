# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The compiled core: one extension module, and one C++ header for each reference in Python.

It computes what the references compute, faster, and knows nothing beyond them. Imported by
`solver.compiled` alone. Begin with the reference that a header names, then `extension.cpp`.
"""

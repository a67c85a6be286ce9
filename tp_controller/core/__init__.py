# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The compiled core: one extension module, and one C++ header for each reference in Python.

It computes what the references compute, faster, and knows nothing beyond them. Imported by
`solver.compiled` alone. Begin with the reference that a header names, then `extension.cpp`.

Neither Eigen nor nanobind: a library may make cycles at most 5 % longer. Eigen's decompositions
made `Solver.solve` up to 2.26 times as slow, its Cholesky factors 1.32 times. nanobind 2.9 takes
0.84 µs for the arguments of a cycle, `python_buffers.h` 0.48.
"""

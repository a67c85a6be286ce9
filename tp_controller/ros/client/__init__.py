# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Connection to a running controller from another process.

Used by the command line, the page and the recorder. Imports the library and the common modules of
`ros`, nothing of `loop` and `interface`. Begin with `client`.
"""

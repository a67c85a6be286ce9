# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Real-time code: joint states in, one cycle of the controller, commands out.

Nothing here waits for the network, a file or a lock that other code holds for long. Imports the
library and the common modules of `ros`, nothing of `interface` and `client`. Begin with
`control_loop`.
"""

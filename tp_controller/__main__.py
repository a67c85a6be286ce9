# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Entry point of ``python -m tp_controller``, the command ``tp_controller``."""

import sys

from tp_controller.tools.cli.main import main

sys.exit(main())

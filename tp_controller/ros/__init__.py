# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS interface: parameters, messages and nodes."""

from typing import Any, TypeAlias

# Classes that rosidl generates have neither types nor a common base class.
Message: TypeAlias = Any

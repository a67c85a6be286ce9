# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Context of ROS for programs that talk to a controller."""

from rclpy import init
from rclpy.context import Context
from tp_controller.errors import TpControllerError


def new_context() -> Context:
    """Return an initialised context; raise `TpControllerError` if ROS cannot start here."""
    context = Context()
    try:
        init(context=context, args=[])
    except (RuntimeError, ValueError) as error:
        raise TpControllerError(f'ROS 2 cannot start: {error}') from error
    return context

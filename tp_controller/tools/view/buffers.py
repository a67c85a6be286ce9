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

"""
Message buffers of viser that may be written from any thread.

viser wakes the senders of a buffer from the writing thread, but asyncio events may be set only on
the thread of their loop: occasionally a write raised ``RuntimeError: deque mutated during
iteration``. viser also wakes the senders on the loop, which suffices.
"""

import asyncio
from typing import Any

import viser.infra._infra as infra


class LoopEvent(asyncio.Event):
    """Event that is set only on the thread of a loop."""

    def set(self) -> None:  # noqa: A003
        """Wake the waiting tasks on the loop; viser repeats the call there for other threads."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class LoopBuffer(infra.AsyncMessageBuffer):
    """Buffer whose event other threads do not set."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.message_event = LoopEvent()


def use_loop_buffers() -> None:
    """Make new servers use these buffers; viser has no option for it."""
    infra.AsyncMessageBuffer = LoopBuffer  # type: ignore[misc]

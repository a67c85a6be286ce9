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

viser wakes the senders of a buffer from the thread that writes, although events of asyncio are for
the thread of their loop alone: now and then a write ended with ``RuntimeError: deque mutated
during iteration``. It wakes them on the loop as well, which is enough.
"""

import asyncio
from typing import Any

import viser.infra._infra as infra


class LoopEvent(asyncio.Event):
    """An event that is set on the thread of a loop, and left alone on others."""

    def set(self) -> None:  # noqa: A003
        """Wake those who wait; elsewhere leave that to the call that viser makes on the loop."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


class LoopBuffer(infra.AsyncMessageBuffer):
    """A buffer whose event is not touched by other threads."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.message_event = LoopEvent()


def use_loop_buffers() -> None:
    """Have servers made from now on use these buffers, for which viser has no option."""
    infra.AsyncMessageBuffer = LoopBuffer  # type: ignore[misc]

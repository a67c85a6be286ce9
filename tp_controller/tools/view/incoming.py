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
"""Messages from browsers: the kinds that the page takes, checked before anything acts on them."""

import asyncio
from collections.abc import Callable
import math
from typing import Any

import msgspec
from tp_controller.tools.view.parts import is_pose, Quaternion, Vector
import viser
from websockets.asyncio.server import ServerConnection

# Longest name of a widget or gizmo [characters], largest message [bytes].
LONGEST_NAME, LONGEST_MESSAGE = 1000, 1 << 16
# Largest message where pictures are taken of the page [bytes].
LONGEST_PICTURE = 1 << 26
# How far the value of a slider may be from its range.
SAME = 1e-3
# Messages of one browser that are taken within a time [s]; more have to wait.
MOST_AT_ONCE, PACE = 100, 0.1


class Camera(msgspec.Struct, forbid_unknown_fields=True, tag='ViewerCameraMessage'):
    """Where somebody looks from."""

    wxyz: Quaternion
    position: Vector
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: Vector
    up_direction: Vector

    def is_valid(self) -> bool:
        """Return whether all numbers are finite."""
        return all(map(math.isfinite, (
            *self.wxyz, *self.position, *self.look_at, *self.up_direction, self.fov, self.near,
            self.far))) and 0 <= self.image_height < 1 << 16 and 0 <= self.image_width < 1 << 16


class DragStart(msgspec.Struct, forbid_unknown_fields=True,
                tag='TransformControlsDragStartMessage'):
    """Somebody has taken hold of a gizmo."""

    name: str
    owner: str = ''

    def is_valid(self) -> bool:
        """Return whether it can be the name of a gizmo."""
        return len(self.name) <= LONGEST_NAME and not self.owner


class DragEnd(DragStart, forbid_unknown_fields=True, tag='TransformControlsDragEndMessage'):
    """The drag of a gizmo has ended."""


class Drag(DragStart, forbid_unknown_fields=True, kw_only=True,
           tag='TransformControlsUpdateMessage'):
    """Where a gizmo was dragged."""

    wxyz: Quaternion
    position: Vector

    def is_valid(self) -> bool:
        """Return whether it is a pose that is not too far away."""
        return super().is_valid() and is_pose(self.wxyz, self.position)


class Value(msgspec.Struct, forbid_unknown_fields=True):
    """The only property of a widget that a browser may set."""

    value: bool | float | str


class Input(msgspec.Struct, forbid_unknown_fields=True, tag='GuiUpdateMessage'):
    """What somebody did to a widget."""

    uuid: str
    updates: Value

    def is_valid(self) -> bool:
        """Return whether it can be the value of any widget."""
        return len(self.uuid) <= LONGEST_NAME


class Picture(msgspec.Struct, forbid_unknown_fields=True, tag='GetRenderResponseMessage'):
    """A picture of the scene that the server has requested."""

    payload: bytes
    render_uuid: str

    def is_valid(self) -> bool:
        """Return whether it can be an answer."""
        return len(self.render_uuid) <= LONGEST_NAME


MESSAGES = msgspec.msgpack.Decoder(Camera | DragStart | DragEnd | Drag | Input)
PICTURES = msgspec.msgpack.Decoder(Camera | Picture)
Find = Callable[[str], Any]


def checked(raw: object, decoder: 'msgspec.msgpack.Decoder[Any]', find: Find) -> bytes | None:
    """
    Return a message of a browser as it is to be acted on; None if it is refused.

    Parameters
    ----------
    raw : bytes
        MessagePack.
    decoder : msgspec.msgpack.Decoder
        Of the kinds that are taken.
    find : callable
        Returns the widget of an identifier, None if there is none.

    """
    if not isinstance(raw, bytes):
        return None
    try:
        message = decoder.decode(raw)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    if not message.is_valid():
        return None
    if isinstance(message, Input) and not fits(find(message.uuid), message.updates.value):
        return None
    # Not the bytes that came: they may say something twice.
    return msgspec.msgpack.encode(message)


def fits(widget: object, value: bool | float | str) -> bool:
    """Return whether somebody can give a value to a widget, as the page shows it."""
    if isinstance(widget, (viser.GuiButtonHandle, viser.GuiCheckboxHandle)):
        return isinstance(value, bool) and not widget.disabled
    if isinstance(widget, viser.GuiNumberHandle):
        # The controller refuses those out of range, with a reason.
        return isinstance(value, float) and math.isfinite(value)
    if isinstance(widget, viser.GuiSliderHandle):
        return isinstance(value, float) and widget.min - SAME <= value <= widget.max + SAME
    if isinstance(widget, (viser.GuiDropdownHandle, viser.GuiButtonGroupHandle)):
        return isinstance(value, str) and value in widget.options
    return False


class CheckedConnection(ServerConnection):
    """
    A connection of a browser that only returns messages which were checked.

    Parameters
    ----------
    *arguments, **options
        Of `ServerConnection`.
    decoder, find
        See `checked`.
    refused : callable
        Called for each message that is refused.

    """

    def __init__(self, *arguments: Any, decoder: 'msgspec.msgpack.Decoder[Any]', find: Find,
                 refused: Callable[[], object], **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._decoder, self._find, self._refused = decoder, find, refused
        self._began, self._count = -math.inf, 0

    async def recv(self, decode: bool | None = None) -> Any:
        """Return the next message that is not refused."""
        while True:
            raw = await super().recv(decode=decode)
            await self._pace()
            message = checked(raw, self._decoder, self._find)
            if message is not None:
                return message
            self._refused()

    async def _pace(self) -> None:
        """Wait where a browser sends more than anybody does."""
        now = self.loop.time()
        if now - self._began > PACE:
            self._began, self._count = now, 0
        self._count += 1
        if self._count >= MOST_AT_ONCE:
            await asyncio.sleep(self._began + PACE - now)

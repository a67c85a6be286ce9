# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from browsers: accepted types, decoding and validation."""

import asyncio
from collections.abc import Callable
import math
from typing import Annotated, Any, Literal

import msgspec
from tp_controller.tools.view.parts import is_pose, Quaternion, Vector
import viser
from websockets.asyncio.server import ServerConnection

# Longest name of a widget or gizmo [characters], largest message [bytes].
LONGEST_NAME, LONGEST_MESSAGE = 1000, 1 << 16
# Largest message with a picture of the page [bytes].
LONGEST_PICTURE = 1 << 26
# Tolerance of the range of a slider.
RANGE_TOLERANCE = 1e-3
# Largest number of messages of one browser per period [s]; further messages are delayed.
MOST_MESSAGES, RATE_PERIOD = 100, 0.1

Name = Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)]
Pixels = Annotated[int, msgspec.Meta(ge=0, lt=1 << 16)]


class Camera(msgspec.Struct, forbid_unknown_fields=True, tag='ViewerCameraMessage'):
    """Camera of a browser."""

    wxyz: Quaternion
    position: Vector
    fov: float
    near: float
    far: float
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector

    def __post_init__(self) -> None:
        """Raise ValueError if a number is not finite."""
        if not all(map(math.isfinite, (
                *self.wxyz, *self.position, *self.look_at, *self.up_direction, self.fov, self.near,
                self.far))):
            raise ValueError('not finite')


class DragStart(msgspec.Struct, forbid_unknown_fields=True,
                tag='TransformControlsDragStartMessage'):
    """Start of a drag of a gizmo."""

    name: Name
    owner: Literal[''] = ''


class DragEnd(DragStart, forbid_unknown_fields=True, tag='TransformControlsDragEndMessage'):
    """End of a drag of a gizmo."""


class Drag(DragStart, forbid_unknown_fields=True, kw_only=True,
           tag='TransformControlsUpdateMessage'):
    """Pose of a dragged gizmo."""

    wxyz: Quaternion
    position: Vector

    def __post_init__(self) -> None:
        """Raise ValueError if the pose is invalid or out of range."""
        if not is_pose(self.wxyz, self.position):
            raise ValueError('not a pose')


class Value(msgspec.Struct, forbid_unknown_fields=True):
    """Value of a widget, its only property that a browser may set."""

    value: bool | float | str


class Input(msgspec.Struct, forbid_unknown_fields=True, tag='GuiUpdateMessage'):
    """Input of a widget."""

    uuid: Name
    updates: Value


class Picture(msgspec.Struct, forbid_unknown_fields=True, tag='GetRenderResponseMessage'):
    """Picture of the scene, requested by the server."""

    payload: bytes
    render_uuid: Name


MESSAGES = msgspec.msgpack.Decoder(Camera | DragStart | DragEnd | Drag | Input)
PICTURES = msgspec.msgpack.Decoder(Camera | Picture)
Find = Callable[[str], Any]


def checked(raw: object, decoder: 'msgspec.msgpack.Decoder[Any]', find: Find) -> bytes | None:
    """
    Return the validated message of a browser, encoded anew; None if it is refused.

    Parameters
    ----------
    raw : bytes
        MessagePack.
    decoder : msgspec.msgpack.Decoder
        Decoder of the accepted types.
    find : callable
        Returns the widget of an identifier; None if there is none.

    """
    if not isinstance(raw, bytes):
        return None
    try:
        message = decoder.decode(raw)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    if isinstance(message, Input) and not fits(find(message.uuid), message.updates.value):
        return None
    # Not the received bytes: they may contain a key twice.
    return msgspec.msgpack.encode(message)


def fits(widget: object, value: bool | float | str) -> bool:
    """Return whether a user can enter a value into a widget."""
    if isinstance(widget, (viser.GuiButtonHandle, viser.GuiCheckboxHandle)):
        return isinstance(value, bool) and not widget.disabled
    if isinstance(widget, viser.GuiNumberHandle):
        # The controller refuses values out of range, with a reason.
        return isinstance(value, float) and math.isfinite(value)
    if isinstance(widget, viser.GuiSliderHandle):
        return (isinstance(value, float)
                and widget.min - RANGE_TOLERANCE <= value <= widget.max + RANGE_TOLERANCE)
    if isinstance(widget, (viser.GuiDropdownHandle, viser.GuiButtonGroupHandle)):
        return isinstance(value, str) and value in widget.options
    return False


class CheckedConnection(ServerConnection):
    """
    Connection of a browser that returns only validated messages.

    Parameters
    ----------
    *arguments, **options
        Arguments of `ServerConnection`.
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
        """Return the next accepted message."""
        while True:
            raw = await super().recv(decode=decode)
            await self._limit_rate()
            message = checked(raw, self._decoder, self._find)
            if message is not None:
                return message
            self._refused()

    async def _limit_rate(self) -> None:
        """Wait if a browser exceeds the rate limit."""
        now = self.loop.time()
        if now - self._began > RATE_PERIOD:
            self._began, self._count = now, 0
        self._count += 1
        if self._count >= MOST_MESSAGES:
            await asyncio.sleep(self._began + RATE_PERIOD - now)

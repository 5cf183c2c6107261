"""Wire: the messages that the page's browsers may send, with the range of every number in them.

viser's own server accepts all of its messages from any browser, such as one that sets an inner attribute of a slider,
one that opens a tunnel to a server on the internet, and uploads without end. Here only the messages that the page needs
are accepted. `settings` checks that a slider's value is in its range.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

_Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Vector = tuple[_Number, _Number, _Number]
_Point = tuple[_Number, _Number]
_Text = Annotated[str, Meta(max_length=1000)]
_Robot = Annotated[int, Meta(ge=0, le=1000)]
_Modifier = Annotated[str, Meta(max_length=40)]


class _Heard(Struct, forbid_unknown_fields=True):
    """A message of this name with these fields, and no others."""


class Camera(_Heard, tag="ViewerCameraMessage"):
    """Where a viewer's camera is."""

    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Vector
    fov: _Number
    near: _Number
    far: _Number
    image_height: Annotated[float, Meta(ge=0, le=1e6)]
    image_width: Annotated[float, Meta(ge=0, le=1e6)]
    look_at: _Vector
    up_direction: _Vector


class Value(_Heard):
    """The new value of a control."""

    value: bool | Annotated[int, Meta(ge=-(10**9), le=10**9)] | _Number | _Text


class Update(_Heard, tag="GuiUpdateMessage"):
    """A control that somebody moved or pressed."""

    uuid: _Text
    updates: Value


class Command(_Heard, tag="CommandTriggerMessage"):
    """A key, or an entry of the command palette."""

    uuid: _Text


class Click(_Heard, tag="SceneNodeClickMessage"):
    """A click on a robot's body."""

    name: _Text
    ray_origin: _Vector
    ray_direction: _Vector
    screen_pos: _Point
    instance_index: _Robot | None = None
    modifier: _Modifier | None = None
    owner: _Text = ""


class Drag(_Heard, tag="SceneNodeDragMessage"):
    """A hand that pulls at a robot's body."""

    phase: Literal["start", "update", "end"]
    name: _Text
    start_position: _Vector
    start_screen_pos: _Point
    end_position: _Vector
    end_screen_pos: _Point
    button: Literal["left", "middle", "right"]
    instance_index: _Robot | None = None
    modifier: _Modifier | None = None
    owner: _Text = ""


_DECODER = msgspec.msgpack.Decoder(Camera | Update | Command | Click | Drag)


def is_heard(data: bytes | str) -> bool:
    """Is this one of the messages that the page needs, with numbers that are finite and in their range?"""
    if isinstance(data, str):
        return False
    try:
        _DECODER.decode(data)
    except (msgspec.DecodeError, RecursionError):  # a ValidationError is a DecodeError
        return False
    return True

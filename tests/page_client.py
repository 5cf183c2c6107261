"""A browser's connection to the live page, without a browser: what it hears and what it may send, or should not."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

import msgspec
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (0.5, -0.5, 0.5, 0.5),
    "position": (3.6, 2.5, 1.45),
    "fov": 0.66,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 560,
    "image_width": 900,
    "look_at": (0.0, 0.0, 0.93),
    "up_direction": (0.0, 0.0, 1.0),
}


def dial(address: str, origin: str | None = None, num_bytes: int = 0, /, **headers: str) -> ClientConnection:
    """A websocket to the page at `address`, opened as by a page of `origin`; raises InvalidStatus if it is refused.

    The system keeps `num_bytes` of what it hears, as many as it likes if 0.
    """
    place, _, query = address.removeprefix("http://").partition("/")
    line = socket.socket()
    if num_bytes:
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, num_bytes)
    host, _, port = place.partition(":")
    line.connect((host, int(port)))
    return connect(
        f"ws://{place}/{query}",
        origin=f"http://{place}" if origin is None else origin,  # type: ignore[arg-type]
        subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        additional_headers=headers,
        sock=line,
        max_queue=1,
        max_size=None,
        compression=None,
        open_timeout=60.0,
        close_timeout=1.0,
        ping_interval=None,
    )


class PageClient:
    """A viewer of the page, of whose messages the system keeps `buffer` bytes.

    Attributes:
        controls: label of a control -> its uuid.
        values: uuid of a control -> its newest value.
        notes: what the page has told this viewer.
        num_bytes: that were heard.
        newest: when what was heard last was sent, by the performance counter [s].
    """

    def __init__(self, address: str, buffer: int = 0):
        self.controls: dict[str, str] = {}
        self.values: dict[str, Any] = {}
        self.notes: list[str] = []
        self.num_bytes = 0
        self.newest = 0.0
        self._websocket = dial(address, None, buffer)
        self.send(**CAMERA)

    def send(self, **message: Any) -> None:
        self._websocket.send(msgspec.msgpack.encode(message))

    def send_raw(self, data: bytes | str) -> None:
        self._websocket.send(data)

    def set(self, label: str, value: Any) -> None:
        """Move a control, or press a button."""
        self.send(type="GuiUpdateMessage", uuid=self.controls[label], updates={"value": value})

    def listen(self, timeout: float) -> bool:
        """Take in the next messages; was there any within that time [s]?"""
        try:
            data = self._websocket.recv(timeout)
        except TimeoutError:
            return False
        assert isinstance(data, bytes)
        self.num_bytes += len(data)
        length = int.from_bytes(data[8:16], "little")
        told = msgspec.msgpack.decode(zstandard.decompress(data[16 : 16 + length]))
        self.newest = told["timestampSec"]
        for message in told["messages"]:
            self._hear(message)
        return True

    def skip(self, timeout: float) -> bool:
        """Take in the next messages without a look at them."""
        with contextlib.suppress(TimeoutError):
            self.num_bytes += len(self._websocket.recv(timeout))
            return True
        return False

    def close(self) -> None:
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            self._websocket.close()

    def __enter__(self) -> PageClient:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _hear(self, message: dict[str, Any]) -> None:
        if message["type"] == "NotificationShowMessage":
            self.notes.append(message["props"]["body"])
        elif "props" in message and "uuid" in message:
            label = message["props"].get("label")
            self.controls[label or str(message["props"].get("options"))] = message["uuid"]
            self.values[message["uuid"]] = message.get("value")
        elif message["type"] == "GuiUpdateMessage" and "value" in message["updates"]:
            self.values[message["uuid"]] = message["updates"]["value"]


def free_port() -> int:
    """A port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(claim: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Has the claim become true within that time?"""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if claim():
            return True
        time.sleep(0.05)
    return False

"""Who may open the live page, and what one of its viewers cannot do to it."""

from __future__ import annotations

import os
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import websockets.asyncio.server as websocket_server
from page_client import CAMERA, PageClient, dial, free_port, until
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request

from surefoot.agents.load import usual_robot
from surefoot.errors import UserError
from surefoot.viewer.guard import Guard
from surefoot.viewer.page import Page
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource, offered_policies
from surefoot.viewer.wire import is_heard


def encoded(**message: object) -> bytes:
    return msgspec.msgpack.encode(message)


# Who may open it.


def refusal(guard: Guard, path: str = "", **headers: str) -> str:
    return guard.refusal(Request(path or f"/?token={guard.token}", Headers(**headers)))


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "LOCALHOST:9000", "127.0.0.1"])
def test_the_page_is_opened_by_this_machines_names(host: str) -> None:
    assert refusal(Guard("127.0.0.1"), Host=host) == ""
    assert refusal(Guard("127.0.0.1"), Host=host, Upgrade="websocket", Origin=f"http://{host}") == ""


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8080", "192.168.1.5:8080", "127.0.0.1.evil.example", "", "a:b:c", "[::1", "@"],
)
def test_another_hosts_name_is_refused(host: str) -> None:
    assert "another name" in refusal(Guard("127.0.0.1"), Host=host)


def test_who_listens_for_all_is_opened_by_its_addresses_and_by_the_names_given() -> None:
    guard = Guard("0.0.0.0", ["Robot-Lab.example"])
    for host in ("192.168.1.5:8080", f"{socket.gethostname()}:8080", "robot-lab.example:8080"):
        assert refusal(guard, Host=host) == ""
    assert "another name" in refusal(guard, Host="evil.example:8080")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "file://", "http://127.0.0.1:8081", "127.0.0.1:8080"]
)
def test_another_pages_origin_is_refused(origin: str) -> None:
    guard = Guard("127.0.0.1")
    assert "only the page itself" in refusal(guard, Host="127.0.0.1:8080", Origin=origin)
    assert "only the page itself" in refusal(guard, Host="127.0.0.1:8080", Origin=origin, Upgrade="WebSocket")


def test_a_websocket_without_an_origin_and_a_request_with_two_hosts_are_refused() -> None:
    guard = Guard("127.0.0.1")
    assert "only the page itself" in refusal(guard, Host="127.0.0.1:8080", Upgrade="websocket")
    twice = Headers([("Host", "127.0.0.1:8080"), ("Host", "evil.example")])
    assert "another name" in guard.refusal(Request(f"/?token={guard.token}", twice))


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=wrong", "/token", "/?x=1&token=\u00e4"])
def test_an_address_without_the_token_is_refused(path: str) -> None:
    assert "surefoot play prints" in refusal(Guard("127.0.0.1"), path, Host="127.0.0.1:8080")


def test_no_two_pages_have_the_same_token() -> None:
    assert len({Guard("127.0.0.1").token for _ in range(20)}) == 20
    assert len(Guard("127.0.0.1").token) >= 20


def test_a_server_that_nothing_guards_is_refused() -> None:
    serve = websocket_server.serve
    with pytest.raises(UserError, match="viser cannot be guarded"), Guard("127.0.0.1").installed():
        pass  # a viser that starts its server in another way
    assert websocket_server.serve is serve


# What a browser may send.


HEARD = {
    "a camera": encoded(**CAMERA),
    "a slider": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": 0.5}),
    "a button": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": True}),
    "a key": encoded(type="CommandTriggerMessage", uuid="1"),
}
NOT_HEARD = {
    "nothing": b"",
    "text": "a text",
    "a tunnel to a server on the internet": encoded(type="ShareUrlRequest"),
    "an upload": encoded(
        type="FileTransferStartUpload",
        source_component_uuid="1",
        transfer_uuid="2",
        filename="f",
        mime_type="",
        part_count=10**9,
        size_bytes=1,
    ),
    "an inner attribute": encoded(type="GuiUpdateMessage", uuid="1", updates={"update_cb": []}),
    "an attribute beside the value": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": 1, "order": 2}),
    "not a number": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": float("nan")}),
    "infinity": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": float("inf")}),
    "a large integer": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": 2**63}),
    "a long text": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": "x" * 5000}),
    "a list": encoded(type="GuiUpdateMessage", uuid="1", updates={"value": [1]}),
    "a camera nowhere": encoded(**CAMERA | {"position": (float("nan"), 0.0, 0.0)}),
    "a camera of two dimensions": encoded(**CAMERA | {"position": (0.0, 0.0)}),
    "an unknown type": encoded(type="Message"),
    "no type": encoded(uuid="1"),
    "no table": msgspec.msgpack.encode([1, 2]),
    "a deep nest": b"\x91" * 60_000,
}


@pytest.mark.parametrize("name", HEARD)
def test_what_the_page_needs_is_heard(name: str) -> None:
    assert is_heard(HEARD[name])


@pytest.mark.parametrize("name", NOT_HEARD)
def test_nothing_else_is_heard(name: str) -> None:
    assert not is_heard(NOT_HEARD[name])


# A page and its viewers.


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    page = Page(PolicySource("nominal"), port=free_port(), folders=[tmp_path_factory.mktemp("runs")])
    yield page
    page.close()


@pytest.fixture
def viewer(page: Page) -> Iterator[PageClient]:
    with PageClient(page.address) as viewer:
        while "Speed" not in viewer.controls or "Robots" not in viewer.controls:
            viewer.listen(30.0)
        yield viewer


def plays(page: Page, viewer: PageClient) -> bool:
    steps = page.player.session.num_steps
    return until(lambda: viewer.skip(0.2) and page.player.session.num_steps > steps + 5)


def fetched(address: str, **headers: str) -> tuple[int, Headers]:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=60.0) as answer:
            return answer.status, answer.headers
    except urllib.error.HTTPError as error:
        return error.code, error.headers


def test_the_server_refuses_what_the_guard_refuses(page: Page) -> None:
    assert fetched(page.address)[0] == 200
    assert fetched(page.origin + "/")[0] == 403
    assert fetched(page.address, Host="evil.example")[0] == 403
    assert fetched(page.address, Origin="http://evil.example")[0] == 403
    for address, origin, headers in (
        (page.origin + "/", None, {}),
        (page.address, "http://evil.example", {}),
        (page.address, "null", {}),
        (page.address, "file://", {}),
        (page.address, None, {"Upgrade": "WebSocket", "Origin": "http://evil.example"}),
    ):
        with pytest.raises(InvalidStatus, match="403"):
            dial(address, origin, **headers)


def test_the_cookie_of_the_page_lets_its_websocket_in(page: Page) -> None:
    _, headers = fetched(page.address)
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    dial(page.origin + "/", Cookie=cookie.partition(";")[0]).close()
    with pytest.raises(InvalidStatus, match="403"):
        dial(page.origin + "/", Cookie=cookie.partition("=")[0] + "=guessed")


def test_no_message_of_one_viewer_stops_the_robots_of_the_others(page: Page, viewer: PageClient) -> None:
    for data in NOT_HEARD.values():
        viewer.send_raw(data)
    assert until(lambda: page.guard.num_refused >= len(NOT_HEARD))
    assert plays(page, viewer)
    with pytest.raises(InvalidStatus, match="403"):
        dial(page.origin + "/")


@pytest.mark.parametrize(
    ("label", "value", "before"),
    [
        *(("Speed", value, 1.0) for value in (0.0, -1.0, 1e9)),
        *(("Robots", value, "1") for value in ("999", "0", "-1", "many", 64.5)),
        *(("Impulse [Ns]", value, 90.0) for value in (-1.0, 1e8, 0.0)),
        ("Duration [s]", 0.0, 0.12),
        ("Direction", 1e6, 0),
        ("Body", "the moon", "pelvis"),
        ("Friction", -1.0, 1.0),
        ("Noise [%]", 1e6, 0),
        *(("Policy", value, "nominal") for value in ("/dev/zero", "/etc/passwd", "../../x.onnx", "os.py:path", "")),
    ],
)
def test_a_value_that_does_not_fit_is_put_back(
    page: Page, viewer: PageClient, label: str, value: object, before: object
) -> None:
    viewer.set(label, value)
    assert until(lambda: viewer.listen(0.2) and bool(viewer.notes)), "who sent it is told"
    assert until(lambda: viewer.listen(0.2) and viewer.values[viewer.controls[label]] == before)
    assert plays(page, viewer)
    assert (page.player.speed, page.player.session.num_robots, page.source.name) == (1.0, 1, "nominal")


def test_a_hand_at_a_robot_that_is_not_there_holds_nothing(page: Page, viewer: PageClient) -> None:
    drag = {
        "type": "SceneNodeDragMessage",
        "phase": "start",
        "name": "/world/body_0",
        "instance_index": 999,
        "start_position": (0.0, 0.0, 1.0),
        "start_screen_pos": (0.5, 0.5),
        "end_position": (1.0, 0.0, 1.0),
        "end_screen_pos": (0.6, 0.5),
        "button": "left",
        "modifier": None,
    }
    click = {"type": "SceneNodeClickMessage", "name": "/world/body_0", "instance_index": 999, "modifier": None}
    click |= {"ray_origin": (0.0, 0.0, 0.0), "ray_direction": (1.0, 0.0, 0.0), "screen_pos": (0.5, 0.5)}
    assert is_heard(encoded(**drag))
    assert is_heard(encoded(**click))
    viewer.send(**drag)
    viewer.send(**click)
    assert plays(page, viewer)
    assert page.watched == 0


def test_a_viewer_who_takes_little_is_not_shown_what_was_long_ago(page: Page, viewer: PageClient) -> None:
    with PageClient(page.address, buffer=16_384) as slow:
        while "Speed" not in slow.controls:
            slow.listen(30.0)
        before, taken = viewer.num_bytes, slow.num_bytes
        while viewer.num_bytes < before + 800_000:
            assert viewer.skip(30.0)
        now = time.perf_counter()
        while slow.newest < now:
            assert slow.listen(30.0)
        # The system keeps twice the 64 KiB that it is asked for, and the line and the libraries some more.
        assert slow.num_bytes - taken < 400_000


def test_an_error_of_what_one_viewer_asked_for_does_not_stop_the_robots(
    page: Page, viewer: PageClient, capfd: pytest.CaptureFixture[str]
) -> None:
    page.player.do(lambda session: 1 / 0)
    assert plays(page, viewer)
    assert not page.player.paused
    assert "ZeroDivisionError" in capfd.readouterr().err


@pytest.mark.parametrize(("times", "is_stopped"), [(3, False), (100, True)])
def test_a_frame_that_cannot_be_shown_is_skipped_and_many_stop_the_robots(
    page: Page, viewer: PageClient, times: int, is_stopped: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    show, failed = page.player._show, list[int]()

    def fail(session: Session, tick: int) -> None:
        failed.append(tick)
        if len(failed) <= times:
            raise RuntimeError("deque mutated during iteration")
        show(session, tick)

    page.player._show = fail
    assert until(lambda: viewer.skip(0.2) or len(failed) > times)
    assert until(lambda: len(failed) > times)
    assert page.player.paused == is_stopped
    page.player._show, page.player.paused = show, False
    assert plays(page, viewer)
    assert ("deque mutated" in capfd.readouterr().err) == is_stopped


def test_only_policies_of_the_folders_named_at_the_start_are_offered(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")
    (tmp_path / "mine.onnx").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("")
    os.mkfifo(tmp_path / "pipe.onnx")
    (tmp_path / "zero.onnx").symlink_to("/dev/zero")
    offered = offered_policies(usual_robot(), [tmp_path, tmp_path / "nowhere"], "given")
    assert [name for name in offered if str(tmp_path) in name] == [str(tmp_path / "mine.onnx"), str(tmp_path / "run")]
    assert offered[-1] == "given"


@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_a_run_whose_checkpoint_is_a_pipe_or_endless_is_named_at_once(tmp_path: Path, kind: str) -> None:
    (tmp_path / "config.json").write_text("{}")
    if kind == "pipe":
        os.mkfifo(tmp_path / "last.onnx")
    else:
        (tmp_path / "last.onnx").symlink_to("/dev/zero")
    said: list[str] = []

    def load() -> None:
        try:
            PolicySource(str(tmp_path))
        except UserError as error:
            said.append(str(error))

    thread = threading.Thread(target=load, daemon=True)
    thread.start()
    thread.join(timeout=30.0)
    assert said
    assert "last.onnx" in said[0]

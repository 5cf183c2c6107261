"""The live page against another web page in the same browser, and the film that it draws, in a real browser."""

from __future__ import annotations

import http.server
import os
import threading
from collections.abc import Iterator

import pytest
from page_client import free_port, until

from surefoot.errors import UserError
from surefoot.viewer import browser
from surefoot.viewer.filming import CANCELLED
from surefoot.viewer.page import Page
from surefoot.viewer.source import PolicySource

pytestmark = [pytest.mark.slow, pytest.mark.browser]

KNOCKS = """async ([address, token, version]) => {
    const knock = (path) => new Promise((answer) => {
        const socket = new WebSocket(address.replace("http", "ws") + path, ["viser-v" + version]);
        socket.onopen = () => answer("opened");
        socket.onerror = () => answer("refused");
    });
    const look = await fetch(address + "/?token=" + token, {credentials: "include"}).then(
        (answer) => "read " + answer.status, () => "refused");
    return [await knock("/"), await knock("/?token=" + token), look];
}"""
"""What a page tries at a server: a websocket by the browser's cookies, one by the token, and a look at the page."""


@pytest.fixture(scope="module")
def chromium() -> Iterator:
    try:
        with browser.launched() as chromium:
            yield chromium
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    page = Page(PolicySource("nominal"), port=free_port())
    yield page
    page.close()


@pytest.fixture(scope="module")
def tab(chromium, page) -> Iterator:
    tab = chromium.new_context(viewport={"width": 900, "height": 560}).new_page()
    tab.set_default_timeout(120_000.0)
    tab.goto(page.address)
    tab.get_by_role("button", name="Reset").wait_for()
    yield tab
    tab.close()


@pytest.fixture
def foreign_server() -> Iterator[str]:
    """The origin of a page of somebody else's."""

    class Stranger(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>a stranger</title>")

        def log_message(self, *_: object) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Stranger)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_film_shows_its_progress_and_is_handed_over(page, tab):
    # A picture takes a third of a second of processor time where there is no GPU: ten show what 200 would.
    page.player.paused = True
    page.clip.clear()
    page.player.paused = False
    assert until(lambda: len(page.clip.shots()) >= 10)
    page.player.paused = True
    with tab.expect_download() as download:
        tab.get_by_role("button", name="Save the last 8 s as MP4").dispatch_event("click")
        tab.get_by_text("Drawing the film").wait_for()
        assert tab.get_by_role("button", name="Save the last 8 s as MP4").count() == 0
    assert download.value.path().read_bytes()[4:8] == b"ftyp"
    tab.get_by_role("button", name="Save the last 8 s as MP4").wait_for()
    page.player.paused = False


def test_a_film_can_be_cancelled_and_leaves_no_process(page, tab):
    tab.get_by_role("button", name="Save the last 8 s as MP4").dispatch_event("click")
    tab.get_by_role("button", name="Cancel the film").wait_for()
    with pytest.raises(UserError, match="another film is being drawn"):
        page._filming.draw(page.player.session.robot, page.clip.shots())
    tab.get_by_role("button", name="Cancel the film").dispatch_event("click")
    tab.get_by_text(CANCELLED).wait_for()
    assert until(lambda: not page._filming.is_busy)
    assert until(lambda: is_gone(page._filming._process.pid))


def is_gone(group: int) -> bool:
    """Has every process of the group ended: the one that draws, and ffmpeg?"""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


# The last one: another tab in front of the page's own keeps its films from being handed over.
def test_a_page_of_another_origin_in_the_same_browser_cannot_reach_the_robots(page, tab, foreign_server):
    import viser

    knocks = [page.origin, page.guard.token, viser.__version__]
    assert tab.evaluate(KNOCKS, knocks) == ["opened", "opened", "read 200"], "the page itself is let in"
    stranger = tab.context.new_page()
    stranger.goto(foreign_server)
    assert stranger.evaluate(KNOCKS, knocks) == ["refused", "refused", "refused"], "even with the token and the cookie"
    stranger.close()


def test_a_reload_goes_on_with_the_page(page, tab):
    tab.reload()
    tab.get_by_role("button", name="Reset").wait_for()
    assert until(lambda: len(page.server.get_clients()) >= 1)
    assert page.guard.num_refused == 0, "the page's own client sends nothing that is not heard"

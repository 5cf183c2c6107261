"""The live page in a real browser: Debian's chromium, headless, driven by Playwright."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Broken
from page_client import free_port, until
from PIL import Image

from surefoot.agents.load import load_policy
from surefoot.errors import UserError
from surefoot.viewer import browser
from surefoot.viewer.page import Page
from surefoot.viewer.server import camera_place
from surefoot.viewer.source import PolicySource
from surefoot.viewer.verdict import State

pytestmark = [pytest.mark.slow, pytest.mark.browser]

SIZE = {"width": 900, "height": 560}
"""Small, because the processor draws it."""


@pytest.fixture(scope="module")
def chromium() -> Iterator:
    try:
        with browser.launched() as chromium:
            yield chromium
    except UserError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def page(chromium) -> Iterator[Page]:
    page = Page(PolicySource("trpo"), port=free_port())
    yield page
    page.close()


@pytest.fixture(scope="module")
def window(chromium, page) -> Iterator:
    """A browser's window on the page."""
    tab = opened(chromium, page)
    yield tab
    tab.context.close()


def opened(chromium, page):
    tab = chromium.new_context(viewport=SIZE).new_page()
    tab.asked, tab.errors = [], []
    tab.on("request", lambda request: tab.asked.append(request.url))
    tab.on("pageerror", lambda error: tab.errors.append(str(error)))
    tab.goto(page.address)
    tab.get_by_role("button", name="Reset").wait_for()
    return tab


@pytest.fixture
def tab(window, page) -> Iterator:
    """The window, with a robot that stands."""
    page.player.paused = False
    page.player.do(lambda session: (session.set_policy(load_policy("trpo")), session.reset()))
    assert until(lambda: says(window, "Standing"))
    yield window
    assert not window.errors


def says(tab, word: str) -> bool:
    verdict = tab.locator("[data-surefoot=verdict]")
    return verdict.count() > 0 and word in (verdict.text_content() or "")


def press(tab, name: str) -> None:
    # Without waiting for the page to hold still, which a page drawn by the processor hardly does.
    tab.get_by_role("button", name=name, exact=True).dispatch_event("click")


def root(page: Page) -> np.ndarray:
    return page.player.session.ticks["root_position"][0, -1].copy()


def scene(tab, path: Path) -> np.ndarray:
    """The pixels between the panels, float (height, width, 3)."""
    tab.screenshot(path=path)
    return np.asarray(Image.open(path).convert("RGB"), float)[:, 350:560]


def num_pixels(picture: np.ndarray, low: tuple[int, int, int], high: tuple[int, int, int]) -> int:
    return int(((picture >= low) & (picture <= high)).all(axis=-1).sum())


def test_the_page_needs_no_network_and_draws_the_robot(tab, page, tmp_path):
    def looks_like_a_robot() -> bool:
        picture = scene(tab, tmp_path / "robot.png")
        badge = num_pixels(picture, (0, 20, 120), (90, 120, 255))
        shell = num_pixels(picture, (215, 215, 215), (255, 255, 255))
        return badge > 20 and shell > 1500

    assert until(looks_like_a_robot, 30.0)
    assert tab.title() == "surefoot"
    assert tab.asked
    assert all(url.startswith((page.origin, f"blob:{page.origin}", "data:")) for url in tab.asked)


def test_a_push_by_button_moves_the_robot_and_its_label(tab, page):
    before = root(page)
    recovered = page.player.session.verdicts.recovered
    press(tab, "Push")
    assert until(lambda: says(tab, "Recovering"))
    assert until(lambda: np.abs(root(page) - before)[0] > 0.1)
    assert until(lambda: says(tab, "Recovered"))
    assert any(says(tab, strategy) for strategy in ("ankle", "hip", "foot tilt", "step"))
    assert page.player.session.verdicts.recovered == recovered + 1


def test_a_push_is_seen_again_by_a_click_on_its_row_while_the_robot_waits(tab, page):
    press(tab, "Push")
    assert until(lambda: says(tab, "Recovered"))
    session = page.player.session
    tab.locator("[data-surefoot=deeds] button:visible").first.click(force=True)
    tab.get_by_text("seen again: 90 Ns forward, 750 N").wait_for()
    steps = session.num_steps
    assert until(lambda: says(tab, "Recovering"))
    assert session.num_steps == steps
    press(tab, "Reset")
    assert until(lambda: page.player.playback is None)
    assert until(lambda: session.num_steps > steps)


def test_an_arrow_key_pushes_and_does_not_turn_the_camera(tab, page):
    client = max(page.server.get_clients().items())[1]
    position = client.camera.position.copy()
    tab.keyboard.press("ArrowRight", delay=300)
    assert until(lambda: page.player.session.verdicts.state[0] == State.RECOVERING)
    # The camera stands in front of the robot and to its left: the right of the screen is the robot's left.
    assert until(lambda: root(page)[1] > 0.03)
    time.sleep(0.5)
    assert client.camera.position == pytest.approx(position, abs=1e-3)


def test_two_browsers_share_the_robots_and_one_that_leaves_in_mid_push_lets_go(tab, chromium, page):
    other = opened(chromium, page)
    assert until(lambda: len(page.server.get_clients()) == 2)
    session = page.player.session
    # The chest, in the middle between the panels. Again until the robot is drawn there.
    for _ in range(20):
        other.mouse.move(455, 230)
        other.mouse.down()
        other.mouse.move(475, 230)
        other.mouse.move(495, 230)
        if until(lambda: bool(session._pulls), 1.0):
            break
        other.mouse.up()
    assert session._pulls, "a hand holds a body"
    assert until(lambda: says(tab, "Recovering"))
    other.context.close()
    assert until(lambda: not session._pulls), "and lets go when its browser is gone"
    assert until(lambda: len(page.server.get_clients()) == 1)
    press(tab, "Drop")
    assert until(lambda: session.deeds.newest.words == "drop from 0.3 m"), "the other browser plays on"


def test_a_fallen_robot_can_be_reset(tab, page):
    page.player.do(lambda session: setattr(session, "stands_up", False))
    page.controls.set_impulse(480)
    press(tab, "Push")
    assert until(lambda: says(tab, "Fell"))
    press(tab, "Reset")
    assert until(lambda: says(tab, "Standing"))
    assert until(lambda: root(page)[2] > 0.9)
    page.player.do(lambda session: setattr(session, "stands_up", True))
    page.controls.set_impulse(90)


def test_pause_step_and_slow_motion(tab, page):
    press(tab, "Pause")
    assert until(lambda: tab.locator("[data-surefoot=rates]").text_content() == "paused")
    steps = page.player.session.num_steps
    press(tab, "Step")
    assert until(lambda: page.player.session.num_steps == steps + 1)
    time.sleep(0.3)
    assert page.player.session.num_steps == steps + 1
    press(tab, "Pause")
    assert until(lambda: page.player.session.num_steps > steps + 5)


def test_a_key_is_a_shortcut_again_after_a_list_was_used(tab, page):
    tab.get_by_label("Body").first.click(force=True)
    tab.get_by_role("option", name="torso").click(force=True)
    chosen = tab.get_by_label("Body").first
    assert until(lambda: tab.evaluate("document.activeElement.tagName") == "BODY")
    tab.keyboard.press("Space")
    assert until(lambda: page.player.paused)
    assert chosen.input_value() == "torso", "nothing was typed into the list"
    tab.keyboard.press("Space")
    assert until(lambda: not page.player.paused)


def test_a_file_that_is_no_policy_is_named_and_the_page_stays_up(tab, page, tmp_path):
    bad = tmp_path / "bad.onnx"
    bad.write_bytes(b"this is no network")
    page.set_source(str(bad))
    tab.get_by_text(f"{bad} is not a policy file: not a readable ONNX network").wait_for()
    assert page.source.name == "trpo"
    steps = page.player.session.num_steps
    assert until(lambda: page.player.session.num_steps > steps + 10)


def test_a_policy_that_returns_nan_is_named_and_the_page_stays_up(tab, page):
    page.player.do(lambda session: session.set_policy(Broken(session.robot)))
    tab.get_by_text("returned numbers that are not finite").first.wait_for()
    steps = page.player.session.num_steps
    assert until(lambda: page.player.session.num_steps > steps + 10)


def test_a_policy_that_raises_is_named_and_the_page_stays_up(tab, page):
    error = RuntimeError("a wheel came off")
    page.player.do(lambda session: session.set_policy(Broken(session.robot, error=error)))
    tab.get_by_text("raised an error (RuntimeError: a wheel came off)").first.wait_for()
    steps = page.player.session.num_steps
    assert until(lambda: page.player.session.num_steps > steps + 10)


def test_an_error_of_the_session_stops_the_robots_but_not_the_page(tab, page, capfd):
    def break_down() -> None:
        raise RuntimeError("a wheel came off")

    page.player.do(lambda session: setattr(session, "step", break_down))
    tab.get_by_text("stopped by an error: RuntimeError: a wheel came off").first.wait_for()
    page.player.do(lambda session: delattr(session, "step"))
    press(tab, "Pause")
    steps = page.player.session.num_steps
    assert until(lambda: page.player.session.num_steps > steps + 10)
    assert "a wheel came off" in capfd.readouterr().err


def test_a_crowd_gets_one_push_and_is_counted(tab, page):
    page.set_num_robots(4)
    assert until(lambda: page.player.session.num_robots == 4)
    press(tab, "Push")
    assert until(lambda: says(tab, "Recovering"))
    assert (page.player.session.verdicts.state == State.RECOVERING).all()
    assert until(lambda: page.player.session.verdicts.recovered + page.player.session.verdicts.fallen >= 4)
    page.set_num_robots(1)
    assert until(lambda: page.player.session.num_robots == 1)


def test_on_a_phone_the_scene_stands_above_the_panel_and_the_push_button_is_seen(chromium, page):
    context = chromium.new_context(viewport={"width": 390, "height": 844})
    tab = context.new_page()
    tab.set_default_timeout(120_000)
    tab.goto(page.address)
    button = tab.get_by_role("button", name="Push", exact=True)
    button.wait_for()
    places = "[...document.querySelectorAll('canvas')].map(canvas => canvas.getBoundingClientRect().bottom)"
    panel = tab.locator("[style*='max-height: 60%']").first
    assert until(lambda: panel.bounding_box()["width"] == 390)
    assert until(lambda: max(tab.evaluate(places)) <= panel.bounding_box()["y"] + 1)
    seen = button.bounding_box()
    assert seen["y"] + seen["height"] <= 844
    assert until(lambda: bool(tab.locator("[data-surefoot=phone] b").first.text_content()))
    usual, target = camera_place(1, 1.0)
    # Farther away, so that the distances on the floor are not cut off at the sides.
    far = 1.1 * np.linalg.norm(usual - target)
    assert until(lambda: max(np.linalg.norm(camera - target) for camera in cameras(page)) > far)
    context.close()


def cameras(page):
    return [np.asarray(client.camera.position) for client in page.server.get_clients().values()]

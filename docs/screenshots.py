"""Screenshots of the live page for the documentation: `make screenshots`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from surefoot.errors import UserError
from surefoot.physics.pushes import horizontal_push
from surefoot.viewer import browser
from surefoot.viewer.page import Page
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource

PICTURES = Path(__file__).parent / "pictures"
SIZE = {"width": 1440, "height": 900}
DRAWN_S = 8.0
"""Time for a browser without a graphics card to draw what stands still."""


def main() -> None:
    """One robot just pushed, and a crowd that has been."""
    try:
        with browser.launched() as chromium:
            take(chromium, 1, pushed_forward, PICTURES / "play.png")
            take(chromium, 16, pushed_left, PICTURES / "play-crowd.png")
    except UserError as error:
        sys.exit(f"screenshots: {error}")


def take(chromium: Any, num_robots: int, act: Callable[[Page], None], path: Path) -> None:
    """A screenshot of the page after `act`."""
    page = Page(PolicySource("best"), num_robots, port=0)
    tab = chromium.new_page(viewport=SIZE)
    try:
        tab.goto(page.address)
        tab.get_by_role("button", name="Reset").wait_for()
        time.sleep(DRAWN_S)
        # Away with the note that there is no graphics card.
        tab.evaluate("document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())")
        act(page)
        time.sleep(DRAWN_S)
        tab.screenshot(path=path)
    finally:
        tab.close()
        page.close()


def pushed_forward(page: Page) -> None:
    """In the first half second after a hard push."""
    run(page, lambda session: session.push(horizontal_push("root", 0.0, 300.0)), 0.28)


def pushed_left(page: Page) -> None:
    """Hard, from the side."""
    run(page, lambda session: session.push(horizontal_push("root", 90.0, 300.0)), 1.6)


def run(page: Page, action: Callable[[Session], object], seconds: float) -> None:
    """Do something and go on for that long, step by step, so that slow drawing changes nothing."""
    page.player.paused = True
    page.push(action)
    for _ in range(round(25 * seconds)):
        page.player.single_step()


if __name__ == "__main__":
    main()

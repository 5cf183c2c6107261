"""Screenshots of the live page and of the report for the documentation: `make screenshots`.

python docs/screenshots.py REPORT.html [SECONDS]
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

from surefoot.errors import UserError
from surefoot.physics.pushes import horizontal_push
from surefoot.viewer import browser
from surefoot.viewer.page import Page
from surefoot.viewer.session import Session
from surefoot.viewer.source import PolicySource

PICTURES = Path(__file__).parent / "pictures"
SIZES = {"": (1440, 900), "-1280": (1280, 720), "-phone": (390, 844)}
"""What is added to a picture's name, and the size of the window [pixels]."""
DRAWN_S = 8.0
"""Time for a browser without a graphics card to draw what stands still; on a busy machine give a longer one."""
PATIENCE_MS = 900_000


QUALITY = 88
"""Of a WebP file: small coloured letters stay as they are, in a third of the bytes of a PNG."""


def main() -> None:
    """One robot just pushed and the report, in windows of three sizes, and a crowd that has been pushed."""
    report = Path(sys.argv[1]).resolve()
    drawn_s = float(sys.argv[2]) if len(sys.argv) > 2 else DRAWN_S
    try:
        with browser.launched() as chromium:
            for name, size in SIZES.items():
                take_report(chromium, report, PICTURES / f"report{name}.webp", size)
                take(chromium, 1, pushed_forward, PICTURES / f"play{name}.webp", size, drawn_s)
            take(chromium, 16, pushed_left, PICTURES / "play-crowd.webp", SIZES[""], drawn_s)
    except UserError as error:
        sys.exit(f"screenshots: {error}")


def take(
    chromium: Any, num_robots: int, act: Callable[[Page], None], path: Path, size: tuple[int, int], drawn_s: float
) -> None:
    """A screenshot of the page after `act`, in a window of a size [pixels]."""
    page = Page(PolicySource("best"), num_robots, port=0)
    tab = chromium.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
    tab.set_default_timeout(PATIENCE_MS)
    try:
        tab.goto(page.address)
        tab.get_by_role("button", name="Push", exact=True).wait_for()
        time.sleep(drawn_s)
        # Away with the note that there is no graphics card.
        tab.evaluate("document.querySelectorAll('.mantine-Notification-closeButton').forEach(button => button.click())")
        act(page)
        time.sleep(drawn_s)
        save(tab, path)
    finally:
        tab.close()
        page.close()


def take_report(chromium: Any, report: Path, path: Path, size: tuple[int, int]) -> None:
    """A screenshot of the report's beginning, in a window of a size [pixels]."""
    tab = chromium.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
    tab.set_default_timeout(PATIENCE_MS)
    tab.goto(report.as_uri())
    save(tab, path)
    tab.close()


def save(tab: Any, path: Path) -> None:
    """What a tab shows, as a picture of few bytes."""
    with Image.open(io.BytesIO(tab.screenshot())) as shot:
        shot.convert("RGB").save(path, quality=QUALITY, method=6)


def pushed_forward(page: Page) -> None:
    """In the first half second after a hard push, and after others whose verdicts are known."""
    for angle, impulse in ((90.0, 120.0), (180.0, 480.0), (-90.0, 200.0)):
        push = horizontal_push("root", angle, impulse)
        run(page, lambda session, push=push: session.push(push), 5.0)
    run(page, lambda session: session.reset(), 1.0)
    run(page, lambda session: session.push(horizontal_push("root", 0.0, 300.0)), 0.28)


def pushed_left(page: Page) -> None:
    """Hard, from the side."""
    run(page, lambda session: session.push(horizontal_push("root", 90.0, 240.0)), 1.6)


def run(page: Page, action: Callable[[Session], object], seconds: float) -> None:
    """Do something and go on for that long, step by step, so that slow drawing changes nothing."""
    page.player.paused = True
    page.push(action)
    for _ in range(round(25 * seconds)):
        page.player.single_step()


if __name__ == "__main__":
    main()

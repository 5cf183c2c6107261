"""Browser: the machine's own Chromium, run headless for the page's tests and screenshots."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from typing import Any

from surefoot.errors import UserError

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # WebGL drawn by the processor.
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # A page nobody looks at is drawn all the same.
    "--disable-backgrounding-occluded-windows",
    "--disable-renderer-backgrounding",
)


@contextlib.contextmanager
def launched() -> Iterator[Any]:
    """A running chromium, as Playwright's `Browser`.

    Raises:
        UserError: there is no chromium, or no Playwright to drive it.
    """
    program = next((path for name in PROGRAMS if (path := shutil.which(name))), None)
    if program is None:
        raise UserError(f"no browser to open the page with ({', '.join(PROGRAMS)}); try: apt install chromium")
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError as error:
        raise UserError("no Playwright to drive the browser with; try: pip install 'surefoot[dev]'") from error
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()

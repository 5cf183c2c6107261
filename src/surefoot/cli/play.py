"""surefoot play: push a robot by hand, in a browser."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli import interrupt
from surefoot.cli.terminal import chosen_robot, say
from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.viewer.page import Page

_PATIENCE_S = 8.0
"""For the page's threads to end after Ctrl-C."""


def has_screen() -> bool:
    """Can a browser's window be opened here? Not on a Linux machine without a display, nor over SSH to one."""
    if sys.platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@dataclass(frozen=True)
class Play:
    """Push the robot by hand, in a browser: opens a page on this machine and prints its address."""

    policy: Annotated[str, tyro.conf.Positional] = "best"
    """A shipped policy's name, a policy file (.onnx), "nominal", or a run folder: its newest checkpoint is followed
    while it learns."""
    robot: str = ""
    """The robot of "nominal": a shipped robot's name, or a description (.toml); the shipped policies' without it."""
    robots: int = 1
    """1 to 64 robots under the same push."""
    port: int = 8080
    """Where the page is."""
    host: tuple[str, ...] = ("127.0.0.1",)
    """Where the page listens: only on this machine unless told otherwise (0.0.0.0: for all who reach it and have the
    printed address). What follows are further names by which browsers reach this machine."""
    runs: tuple[Path, ...] = (Path("runs"),)
    """Folders whose runs and policy files are offered; the page plays no others."""
    open: bool = True
    """Open the page in this machine's browser, where there is one and a screen."""

    def main(self) -> None:
        """Serve the page until Ctrl-C."""
        with interrupt.ends_at_once():
            page = self._page()
        try:
            say(f"push it at {page.address} (Ctrl-C ends)")
            if self.open and has_screen():
                webbrowser.open(page.address)
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            say("closed")
        finally:
            interrupt.end_within(_PATIENCE_S)
            page.close()

    def _page(self) -> Page:
        from surefoot.viewer.page import Page
        from surefoot.viewer.source import PolicySource

        if not self.host:
            raise UserError("host must be an address or a name of this machine; valid: 127.0.0.1, 0.0.0.0")
        source = PolicySource(self.policy, chosen_robot(self.robot))
        return Page(source, self.robots, self.host[0], self.port, self.runs, self.host[1:])

"""surefoot play: push a robot by hand, in a browser."""

from __future__ import annotations

import time
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.terminal import chosen_robot, say


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
    host: str = "127.0.0.1"
    """Who may open the page: only this machine unless told otherwise (0.0.0.0: everyone who reaches it)."""
    runs: Path = Path("runs")
    """Folder whose runs are offered."""
    open: bool = False
    """Open the page in this machine's browser."""

    def main(self) -> None:
        """Serve the page until Ctrl-C."""
        from surefoot.viewer.page import Page
        from surefoot.viewer.source import PolicySource

        page = Page(PolicySource(self.policy, chosen_robot(self.robot)), self.robots, self.host, self.port, self.runs)
        say(f"push it at {page.address} (Ctrl-C ends)")
        if self.open:
            webbrowser.open(page.address)
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            say("closed")
        finally:
            page.close()

"""surefoot play: push a robot by hand, in a browser."""

from __future__ import annotations

import os
import re
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

_STORED = re.compile(r"(.+):(\d+)")
"""A stored trial: the file of its results table, and its number."""
_PATIENCE_S = 8.0
"""For the page's threads to end after Ctrl-C."""


def has_screen() -> bool:
    """Can a browser's window be opened here? Not on a Linux machine without a display, nor over SSH to one."""
    if sys.platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@dataclass(frozen=True)
class Play:
    """Push the robot by hand in a browser: open a page on this machine and print its address."""

    policy: Annotated[str, tyro.conf.Positional] = ""
    """A shipped policy's name (the default is "best"), a policy file (.onnx), a run folder (the page follows its newest
    checkpoint while it learns), a controller (controllers/NAME or FILE.py:CLASS), "nominal" (the default with --robot),
    or a stored trial of `surefoot evaluate`, RESULTS.sqlite:ID, which is played first."""
    robot: str = ""
    """The robot of a controller or of "nominal": a shipped robot's name, or a description (.toml). The
    default is the shipped policies' robot."""
    trial_policy: str | None = None
    """Agent of a stored trial, if it is neither shipped nor in runs/: a policy file, a run folder or a controller."""
    robots: int = 1
    """Number of robots under the same push, 1 to 64."""
    port: int = 8080
    """Port of the page."""
    host: tuple[str, ...] = ("127.0.0.1",)
    """Address on which the page listens. The default is this machine only; 0.0.0.0 admits everybody who can reach the
    machine and has the printed address. Further words are more names by which browsers reach this machine."""
    runs: tuple[Path, ...] = (Path("runs"),)
    """Folders whose runs and policy files the page offers; it plays no others."""
    open: bool = True
    """Open the page in this machine's browser, if the machine has a browser and a screen."""

    def main(self) -> None:
        """Serve the page until Ctrl-C."""
        with interrupt.ends_at_once():
            page = self.page()
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

    def page(self) -> Page:
        """The page, which is served from now on, until somebody closes it."""
        from surefoot.viewer.allocator import keep_little_memory

        keep_little_memory()  # before modules start threads
        from surefoot.viewer.page import Page
        from surefoot.viewer.source import PolicySource

        if not self.host:
            raise UserError("host must be an address or a name of this machine; valid: 127.0.0.1, 0.0.0.0")
        stored = _STORED.fullmatch(self.policy)
        if stored:
            return self._page_of_trial(Path(stored[1]), int(stored[2]))
        name = self.policy or ("nominal" if self.robot else "best")
        source = PolicySource(name, chosen_robot(self.robot))
        return Page(source, self.robots, self.host[0], self.port, self.runs, self.host[1:])

    def _page_of_trial(self, results: Path, number: int) -> Page:
        """The page of the policy of a stored trial, which is run again and played first."""
        from surefoot.evaluation import replay
        from surefoot.evaluation.recorded import record_trials
        from surefoot.evaluation.results import open_results
        from surefoot.rendering.words import trial_words
        from surefoot.viewer.page import Page
        from surefoot.viewer.playback import take_of
        from surefoot.viewer.source import PolicySource

        with open_results(results) as table:
            row = table.row(number)
        what = f"trial {number} of {results}"
        policy = replay.policy_of(row, what, self.trial_policy)
        recorded = record_trials(policy, [row.trial], num_threads=1, engine=row.key.setup.engine_word)[row.trial]
        found = replay.differences(row.outcome, recorded.outcome)
        same = f"different from what is stored: {', '.join(name for name, _, _ in found)}" if found else "as stored"
        say(f"{what}: {row.policy_name}, {row.scenario}, {recorded.outcome.reason}, {same}")
        source = PolicySource(self.trial_policy or row.policy_name, policy.robot, policy)
        page = Page(source, 1, self.host[0], self.port, self.runs, self.host[1:])
        page.show_trial(f"trial {number}: {trial_words(row.trial)}", take_of(recorded))
        return page

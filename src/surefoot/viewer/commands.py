"""Commands that show robots: the live page, films and pictures. What they need is loaded when they run."""

from __future__ import annotations

import time
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro
from rich.console import Console

from surefoot.errors import UserError

if TYPE_CHECKING:
    from surefoot.policy import Policy
    from surefoot.trials import Trial

console = Console(stderr=True)
DIRECTIONS = {"forward": 0.0, "left": 90.0, "backward": 180.0, "right": -90.0}


@dataclass(frozen=True)
class Play:
    """Push the robot by hand, in a browser: opens a page on this machine and prints its address."""

    policy: Annotated[str, tyro.conf.Positional] = "trpo"
    """A shipped policy's name, a policy file (.onnx), "nominal", or a run folder: its newest checkpoint is followed
    while it learns."""
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
        from surefoot.viewer.page import Page
        from surefoot.viewer.source import PolicySource

        page = Page(PolicySource(self.policy), self.robots, self.host, self.port, self.runs)
        console.print(f"push it at {page.address} (Ctrl-C ends)", soft_wrap=True)
        if self.open:
            webbrowser.open(page.address)
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            console.print("closed")
        finally:
            page.close()


@dataclass(frozen=True)
class Video:
    """Film one push of one robot, as .mp4 or .gif, without a screen."""

    policy: Annotated[str, tyro.conf.Positional] = "trpo"
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal"."""
    out: Path = Path("push.mp4")
    """The film: .mp4 or .gif."""
    body: str = "pelvis"
    """Who is pushed: pelvis, torso, left_thigh, right_thigh, left_shank or right_shank."""
    direction: str = "forward"
    """forward, left, backward, right, or degrees from forward to the left."""
    impulse: float = 120.0
    """Force x duration [Ns]."""
    duration: float = 0.12
    """How long it pushes [s]."""
    seed: int = 0
    """Of the start angles."""
    begin: float = -0.5
    """Where the film begins, in seconds from the push."""
    end: float = 6.0
    """Where it ends."""
    speed: float = 1.0
    """0.25 for a quarter of the speed of life."""
    fps: float = 25.0
    """Frames per second."""
    size: tuple[int, int] = (960, 720)
    """Width and height in pixels."""

    def main(self) -> None:
        from surefoot import video

        video.check_film(self.out, self.size)
        trial = push_trial(self.body, self.direction, self.impulse, self.duration, self.seed)
        with console.status(f"filming {self.out}"):
            recording = video.record(named_policy(self.policy), trial)
            video.save_video(self.out, recording, self.fps, self.size, begin=self.begin, end=self.end, speed=self.speed)
        console.print(f"film: {self.out} ({recording.outcome.reason})", soft_wrap=True)


@dataclass(frozen=True)
class Picture:
    """Draw pushes of one robot as a film strip, a row for each impulse and a column for each time; without a screen."""

    policy: Annotated[str, tyro.conf.Positional] = "trpo"
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal"."""
    out: Path = Path("push.png")
    """The picture: .png or .jpg."""
    body: str = "pelvis"
    """Who is pushed: pelvis, torso, left_thigh, right_thigh, left_shank or right_shank."""
    direction: str = "forward"
    """forward, left, backward, right, or degrees from forward to the left."""
    impulse: tuple[float, ...] = (120.0,)
    """Force x duration [Ns], one or more."""
    duration: float = 0.12
    """How long it pushes [s]."""
    seed: int = 0
    """Of the start angles."""
    times: tuple[float, ...] = (0.1, 0.3, 0.6, 1.0, 2.0, 4.0)
    """Seconds from the push; a single time of a single impulse gives a picture without a margin."""
    size: tuple[int, int] = (260, 320)
    """Width and height of each picture in pixels."""

    def main(self) -> None:
        from surefoot import video
        from surefoot.scene import Scene

        video.check_picture(self.out)
        trials = [push_trial(self.body, self.direction, ns, self.duration, self.seed) for ns in self.impulse]
        with console.status(f"drawing {self.out}"):
            recordings = [video.record(named_policy(self.policy), trial) for trial in trials]
            if len(recordings) == len(self.times) == 1:
                with Scene(recordings[0].robot, *self.size) as scene:
                    image = scene.draw(recordings[0].at(self.times[0]), trials[0].push)
            else:
                image = video.filmstrip(recordings, self.times, self.size)
            video.save_picture(self.out, image)
        console.print(f"picture: {self.out} ({', '.join(r.outcome.reason for r in recordings)})", soft_wrap=True)


def named_policy(name: str) -> Policy:
    """A policy as a user names it."""
    from surefoot.policy import NominalPolicy, load_policy

    return NominalPolicy() if name == "nominal" else load_policy(name)


def push_trial(body: str, direction: str, impulse: float, duration: float, seed: int) -> Trial:
    """The trial of one push.

    Raises:
        UserError: there is no such body or direction, or a number will not do.
    """
    from surefoot.robot import load_robot
    from surefoot.trials import Trial
    from surefoot.viewer.session import horizontal_push

    load_robot().body_id(body)
    try:
        angle = DIRECTIONS[direction] if direction in DIRECTIONS else float(direction)
    except ValueError:
        raise UserError(f"unknown direction '{direction}'; valid: {', '.join(DIRECTIONS)}, degrees") from None
    for name, value in (("impulse", impulse), ("duration", duration)):
        if not (np.isfinite(value) and value > 0):
            raise UserError(f"{name} must be a positive number, not {value}")
    if not np.isfinite(angle):
        raise UserError(f"direction must be finite, not {direction}")
    if seed < 0:
        raise UserError(f"seed must not be negative, not {seed}")
    return Trial(horizontal_push(body, angle, impulse, duration), seed)

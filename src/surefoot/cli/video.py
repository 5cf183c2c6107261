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
    from surefoot.agents.agent import Policy
    from surefoot.agents.controllers.controller import ControllerAgent
    from surefoot.evaluation.trials import Trial

console = Console(stderr=True)
DIRECTIONS = {"forward": 0.0, "left": 90.0, "backward": 180.0, "right": -90.0}


@dataclass(frozen=True)
class Play:
    """Push the robot by hand, in a browser: opens a page on this machine and prints its address."""

    policy: Annotated[str, tyro.conf.Positional] = "best"
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
class _Shown:
    """Whose trial is shown, and which."""

    policy: Annotated[str, tyro.conf.Positional] = "best"
    """A shipped policy's name, a policy file (.onnx), a run folder, or "nominal"."""
    out: Path = Path("push")
    """The file."""
    body: str = "root"
    """Who is pushed: root, torso, left_thigh, right_thigh, left_shank or right_shank."""
    direction: str = "forward"
    """forward, left, backward, right, or degrees from forward to the left."""
    scenario: str = ""
    """A scenario of `surefoot evaluate` instead of a push: its name, or FILE.toml:NAME. With a direction, a size and a
    seed it is the very trial of the results table."""
    duration: float = 0.12
    """How long it pushes [s]."""
    seed: int = 0
    """Of the start angles."""

    def trial(self, size: float) -> Trial:
        """A scenario's trial, or a push of `size` [Ns]."""
        if self.scenario:
            return scenario_trial(self.scenario, self.direction, size, self.seed)
        return push_trial(self.body, self.direction, size, self.duration, self.seed)


@dataclass(frozen=True)
class Video(_Shown):
    """Film one push of one robot, as .mp4 or .gif, without a screen."""

    out: Path = Path("push.mp4")
    """The film: .mp4 or .gif."""
    impulse: float = 120.0
    """Force x duration [Ns]; with --scenario the size of what it searches: Ns, m or degrees."""
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
        from surefoot.rendering.film import save_video
        from surefoot.rendering.image_files import check_film
        from surefoot.rendering.recording import record

        check_film(self.out, self.size)
        trial = self.trial(self.impulse)
        with console.status(f"filming {self.out}"):
            recording = record(named_policy(self.policy), trial)
            save_video(self.out, recording, self.fps, self.size, begin=self.begin, end=self.end, speed=self.speed)
        console.print(f"film: {self.out} ({recording.outcome.reason})", soft_wrap=True)


@dataclass(frozen=True)
class Picture(_Shown):
    """Draw pushes of one robot as a film strip, a row for each impulse and a column for each time; without a screen."""

    out: Path = Path("push.png")
    """The picture: .png or .jpg."""
    impulse: tuple[float, ...] = (120.0,)
    """Force x duration [Ns], one or more; with --scenario sizes of what it searches: Ns, m or degrees."""
    times: tuple[float, ...] = (0.1, 0.3, 0.6, 1.0, 2.0, 4.0)
    """Seconds from the push; a single time of a single impulse gives a picture without a margin."""
    size: tuple[int, int] = (260, 320)
    """Width and height of each picture in pixels."""

    def main(self) -> None:
        from surefoot.rendering.film import draw_moment
        from surefoot.rendering.image_files import check_picture, save_picture
        from surefoot.rendering.recording import record
        from surefoot.rendering.renderer import Renderer
        from surefoot.rendering.strip import filmstrip

        check_picture(self.out)
        trials = [self.trial(size) for size in self.impulse]
        with console.status(f"drawing {self.out}"):
            recordings = [record(named_policy(self.policy), trial) for trial in trials]
            if len(recordings) == len(self.times) == 1:
                with Renderer(recordings[0].robot, *self.size, trials[0].domain) as scene:
                    image = draw_moment(scene, trials[0], recordings[0].at(self.times[0]))
            else:
                image = filmstrip(recordings, self.times, self.size)
            save_picture(self.out, image)
        console.print(f"picture: {self.out} ({', '.join(r.outcome.reason for r in recordings)})", soft_wrap=True)


def named_policy(name: str) -> Policy | ControllerAgent:
    """A policy or controller as a user names it."""
    from surefoot.agents.controllers import load_agent

    return load_agent(name)


def scenario_trial(name: str, direction: str, size: float, seed: int) -> Trial:
    """The whole trial of a scenario; `size` is on the grid of what it searches, and means nothing if it does not.

    Raises:
        UserError: there is no such scenario, direction, size or seed.
    """
    from surefoot.evaluation.scenario_file import suite
    from surefoot.evaluation.scenarios import SUITES

    file, _, key = name.rpartition(":")
    among = suite(file) if file else [scenario for scenarios in SUITES.values() for scenario in scenarios]
    scenarios = {scenario.name: scenario for scenario in among}
    if key not in scenarios:
        raise UserError(f"unknown scenario '{key}'; valid: {', '.join(scenarios)}")
    lines = {line.name: line for line in scenarios[key].lines()}
    if direction not in lines:
        raise UserError(f"{key} has no direction '{direction}'; valid: {', '.join(lines)}")
    line = lines[direction]
    if not line.scenario.search:
        if not 0 <= seed < line.scenario.trials:
            raise UserError(f"seed of {key} must be 0 to {line.scenario.trials - 1}, not {seed}")
        return line.fixed_trials()[seed]
    cell = round(size / line.grid) if np.isfinite(size) else 0
    if not 1 <= cell <= line.num_cells or abs(line.size(cell) - size) > 1e-6:
        valid = f"multiples of {line.grid:g} up to {line.size(line.num_cells):g} {line.scenario.unit}"
        raise UserError(f"{key} has no size {size:g}; valid: {valid}")
    if seed < 0:
        raise UserError(f"seed must not be negative, not {seed}")
    return line.trial(cell, seed, whole=True)


def push_trial(body: str, direction: str, impulse: float, duration: float, seed: int) -> Trial:
    """The trial of one push.

    Raises:
        UserError: there is no such body or direction, or a number will not do.
    """
    from surefoot.evaluation.trials import Trial
    from surefoot.physics.pushes import horizontal_push
    from surefoot.robots.robot import load_robot

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

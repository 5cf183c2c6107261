"""surefoot video and picture: draw a trial without a screen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.shown_trial import push_trial, scenario_trial
from surefoot.cli.terminal import chosen_robot, say, working

if TYPE_CHECKING:
    from surefoot.evaluation.trials import Trial
    from surefoot.robots import Robot
    from surefoot.task.agent import Agent

USUAL_IMPULSE = 20
"""Steps of the robot's grid of impulses of a push whose size is not given."""


@dataclass(frozen=True)
class _Shown:
    """The trial that is shown, and its policy."""

    policy: Annotated[str, tyro.conf.Positional] = "best"
    """A shipped policy's name, a policy file (.onnx), a run folder, "nominal", or a controller."""
    robot: str = ""
    """The robot of a controller or of "nominal": a shipped robot's name, or a description (.toml). The
    default is the shipped policies' robot."""
    out: Path = Path("push")
    """The file."""
    body: str = "root"
    """Body that is pushed: the floating body, or another pushable body of the robot. A wrong name is answered with the
    valid ones."""
    direction: str = "forward"
    """forward, left, backward, right, or degrees from forward to the left."""
    scenario: str = ""
    """A scenario of `surefoot evaluate` instead of a push: its name, or FILE.toml:NAME. With a direction, a size and a
    seed it is exactly the trial of the results table."""
    duration: float = 0.12
    """Duration of the push [s]."""
    seed: int = 0
    """Seed of the start angles."""

    def agent(self) -> Agent:
        """The shown agent."""
        from surefoot.agents.load import load_agent

        return load_agent(self.policy, chosen_robot(self.robot))

    def trial(self, robot: Robot, size: float | None) -> Trial:
        """A scenario's trial, or a push of `size` [Ns], without it of `USUAL_IMPULSE`."""
        from surefoot.evaluation.protocol import protocol_for

        if size is None:
            size = USUAL_IMPULSE * protocol_for(robot).impulse_step
        if self.scenario:
            return scenario_trial(robot, self.scenario, self.direction, size, self.seed)
        return push_trial(robot, self.body, self.direction, size, self.duration, self.seed)


@dataclass(frozen=True)
class Video(_Shown):
    """Film one push of one robot, as .mp4 or .gif, without a screen."""

    out: Path = Path("push.mp4")
    """The film: .mp4 or .gif."""
    impulse: float | None = None
    """Force x duration [Ns]. The default is 20 steps of the robot's grid of impulses. With --scenario it is the size of
    the searched quantity, in Ns, m or degrees."""
    begin: float = -0.5
    """Beginning of the film, in seconds from the push."""
    end: float = 6.0
    """End of the film, in seconds from the push."""
    speed: float = 1.0
    """Speed of the film: 0.25 is a quarter of real time."""
    fps: float = 25.0
    """Frames per second."""
    size: tuple[int, int] = (960, 720)
    """Width and height in pixels."""

    def main(self) -> None:
        """Film the trial."""
        from surefoot.rendering.film import save_video
        from surefoot.rendering.image_files import check_film
        from surefoot.rendering.recording import record

        check_film(self.out, self.size)
        agent = self.agent()
        trial = self.trial(agent.robot, self.impulse)
        with working(f"filming {self.out}"):
            recording = record(agent, trial)
            save_video(self.out, recording, self.fps, self.size, begin=self.begin, end=self.end, speed=self.speed)
        say(f"film: {self.out} ({recording.outcome.reason})")


@dataclass(frozen=True)
class Picture(_Shown):
    """Draw pushes of one robot as a film strip without a screen: a row for each impulse, a column for each time."""

    out: Path = Path("push.png")
    """The picture: .png or .jpg."""
    impulse: tuple[float, ...] = ()
    """Force x duration [Ns], one or more. The default is 20 steps of the robot's grid of impulses. With --scenario
    these are sizes of the searched quantity, in Ns, m or degrees."""
    times: tuple[float, ...] = (0.1, 0.3, 0.6, 1.0, 2.0, 4.0)
    """Seconds from the push. A single time with a single impulse gives a picture without a margin."""
    size: tuple[int, int] = (260, 320)
    """Width and height of each picture in pixels."""

    def main(self) -> None:
        """Draw the trials."""
        from surefoot.rendering.film import draw_moment
        from surefoot.rendering.image_files import check_picture, save_picture
        from surefoot.rendering.recording import record
        from surefoot.rendering.renderer import Renderer
        from surefoot.rendering.strip import filmstrip

        check_picture(self.out)
        agent = self.agent()
        trials = [self.trial(agent.robot, size) for size in self.impulse or (None,)]
        with working(f"drawing {self.out}"):
            recordings = [record(agent, trial) for trial in trials]
            if len(recordings) == len(self.times) == 1:
                with Renderer(recordings[0].robot, *self.size, trials[0].domain) as scene:
                    image = draw_moment(scene, trials[0], recordings[0].at(self.times[0]))
            else:
                image = filmstrip(recordings, self.times, self.size)
            save_picture(self.out, image)
        say(f"picture: {self.out} ({', '.join(r.outcome.reason for r in recordings)})")

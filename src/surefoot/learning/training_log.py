"""Training log: the values that a run sends to TensorBoard or Weights & Biases while it learns."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from stable_baselines3.common.logger import HParam, KVWriter, Logger, TensorBoardOutputFormat, make_output_format

from surefoot.agents.network import NetworkAgent
from surefoot.learning.config import TrainConfig
from surefoot.learning.schedule import Progress

PROJECT = "surefoot"
"""Name of the project in Weights & Biases."""
_NUMBERS = (bool, int, float, str)


class Film(NamedTuple):
    """An animated GIF, and its size in pixels."""

    data: bytes
    width: int
    height: int


@dataclass(frozen=True)
class LogConfig:
    """Where a run's figures go.

    Attributes:
        writer: "tensorboard" writes event files into the run folder; "wandb" sends the same to Weights & Biases, or
            keeps them in the run folder if the environment says `WANDB_MODE=offline`.
        film: draws the newest policy; without it there are no films.
        film_minutes: from one film to the next, at least.
    """

    writer: Literal["tensorboard", "wandb"] = "tensorboard"
    film: Callable[[NetworkAgent], Film] | None = None
    film_minutes: float = 5.0


TENSORBOARD = LogConfig()
"""The usual log: no films, since drawing them needs OpenGL."""


class TrainingLog:
    """The log of one run: stable-baselines3 adds its losses to what is recorded here.

    Args:
        config: of the run.
        folder: of the run.
        log: where the figures go.

    Attributes:
        logger: that of stable-baselines3.

    Raises:
        ModuleNotFoundError: the writer's package is not installed.
    """

    def __init__(self, config: TrainConfig, folder: Path, log: LogConfig):
        self.log = log
        writer: KVWriter
        if log.writer == "wandb":
            writer = WandbWriter(folder, config)
        else:
            writer = make_output_format("tensorboard", str(folder))
        self.logger = Logger(str(folder), [writer])
        self._writer = writer
        self._filmed = -float("inf")
        if isinstance(writer, TensorBoardOutputFormat):
            self.logger.record("hparams", HParam(hyperparameters(config), {"validation/recovered": 0.0}))
            self.logger.dump(0)

    def record(self, progress: Progress, rewards: Mapping[str, float], episode_return: float, steps: int) -> None:
        """Write down where a run is.

        Args:
            progress: of the run.
            rewards: mean of every term of the reward since the last call.
            episode_return: mean over the last episodes.
            steps: policy steps.
        """
        logger = self.logger
        for name, mean in rewards.items():
            logger.record(f"reward/{name}", mean)
        logger.record("rollout/episode_length", progress.episode_length)
        logger.record("rollout/episode_return", episode_return)
        logger.record("time/steps_per_s", progress.steps_per_s)
        if progress.validation:
            for name, value in progress.validation.columns().items():
                logger.record(f"validation/{name}", value)
            for direction, impulse in progress.validation.rejected.items():
                logger.record(f"rejected_Ns/{direction}", impulse)
        logger.dump(steps)

    def film(self, policy: Callable[[], NetworkAgent], steps: int) -> None:
        """Draw the newest policy and write the film down, if films are wanted and the last one is old enough."""
        if self.log.film is None or time.monotonic() - self._filmed < 60.0 * self.log.film_minutes:
            return
        self._filmed = time.monotonic()
        film = self.log.film(policy())
        if isinstance(self._writer, WandbWriter):
            self._writer.write_film(film, steps)
        elif isinstance(self._writer, TensorBoardOutputFormat):
            _write_film(self._writer, film, steps)


class WandbWriter(KVWriter):
    """Writes to Weights & Biases what TensorBoard would get.

    Args:
        folder: of the run; its name is the name of the run there.
        config: its hyperparameters.
    """

    def __init__(self, folder: Path, config: TrainConfig):
        import wandb

        self._folder = folder
        self._wandb = wandb
        self._run = wandb.init(project=PROJECT, name=folder.name, dir=str(folder), config=hyperparameters(config))

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Send the numbers of a step."""
        self._run.log({key: value for key, value in key_values.items() if isinstance(value, int | float)}, step=step)

    def write_film(self, film: Film, steps: int) -> None:
        """Send a film."""
        file = self._folder / "film.gif"
        file.write_bytes(film.data)
        self._run.log({"film": self._wandb.Video(str(file), format="gif")}, step=steps)

    def close(self) -> None:
        """End the run."""
        self._run.finish()


def hyperparameters(config: TrainConfig) -> dict[str, Any]:
    """Return every setting of a run that is a number or a word, by the option that sets it."""
    found: dict[str, Any] = {}

    def add(prefix: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            if hasattr(value, "__dataclass_fields__"):
                add(f"{prefix}{name}.", vars(value))
            elif isinstance(value, Mapping):
                add(f"{prefix}{name}.", value)
            elif value is not None:
                found[f"{prefix}{name}"] = value if isinstance(value, _NUMBERS) else str(value)

    add("", vars(config))
    return found


def _write_film(writer: TensorBoardOutputFormat, film: Film, steps: int) -> None:
    """Write an animated GIF into TensorBoard's images, where it plays."""
    from tensorboard.compat.proto.summary_pb2 import Summary

    image = Summary.Image(height=film.height, width=film.width, colorspace=3, encoded_image_string=film.data)
    events = writer.writer._get_file_writer()  # type: ignore[no-untyped-call] # torch's
    events.add_summary(Summary(value=[Summary.Value(tag="film", image=image)]), steps)
    writer.writer.flush()

"""Training: one loop for every algorithm; stable-baselines3 collects and updates, and we validate and keep."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from surefoot.agents.network import NetworkAgent
from surefoot.errors import UserError
from surefoot.learning.budget import budget_for
from surefoot.learning.config import DAGGER, TrainConfig
from surefoot.learning.crew import Crew, check_crew, join
from surefoot.learning.distill import Distiller
from surefoot.learning.interrupt import deferred_interrupt
from surefoot.learning.kept_policies import KeptPolicies
from surefoot.learning.learner import Learner
from surefoot.learning.run_folder import RunFolder, discard_beginning
from surefoot.learning.schedule import Progress, Schedule
from surefoot.learning.speed import learning_speed
from surefoot.learning.standing import validation_for
from surefoot.learning.training_log import TENSORBOARD, LogConfig, TrainingLog
from surefoot.learning.training_record import training_record
from surefoot.learning.warm_start import Origin, begin_with, warm_start
from surefoot.task.environment import PushRecoveryVectorEnv

CHECKPOINT_S = 30.0
"""Time from one checkpoint to the next at most; there is one at each validation too."""
LOG_S = 2.0
"""Time from one line of the log to the next."""
OnProgress = Callable[[Progress], None]
_FOREVER = 10**12
_MISFIT = (KeyError, TypeError, ValueError, RuntimeError, AttributeError, IndexError, OverflowError)
"""What it raises to restore networks and generators from values that are others'."""


class Trainer:
    """One training run in its folder.

    Args:
        config: what to learn.
        folder: where to keep it.
        resume: go on from the folder's checkpoint.
        on_progress: called a few times a second.
        start: what this run begins with: the networks of another run, or a policy, whose critic is learned first.
        log: where the figures go.
        crew: workers that move the robots; this process without it.

    Attributes:
        learner: robots, algorithm and averaged actor.
        schedule: how much of the budget is used.
        kept: the policies so far.
        origin: what the run began with.
        progress: where it is.
        interrupted: a stop was asked for.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: RunFolder,
        resume: bool = False,
        on_progress: OnProgress | None = None,
        start: RunFolder | NetworkAgent | None = None,
        log: LogConfig = TENSORBOARD,
        crew: Crew | None = None,
    ):
        self.config = config
        self.log_config = log
        self.folder = folder
        self.on_progress = on_progress
        self.progress = Progress()
        self.interrupted = False
        self.schedule = Schedule(
            config, budget_for(config, folder, lambda: learning_speed(config, _beginning_with(start), crew))
        )
        self.learner = Learner(config, self.schedule.learning_rate)
        self.kept = KeptPolicies(validation_for(config))
        self.origin = begin_with(self.learner, start) if start else Origin()
        if crew:
            join(self.learner, crew, lambda: (self.schedule.exploration_share, self.schedule.position))
        if resume:
            self._restore()
            self.update_progress()

    @property
    def model(self) -> BaseAlgorithm:
        """Algorithm and networks."""
        return self.learner.model

    @property
    def env(self) -> PushRecoveryVectorEnv:
        """The robots."""
        return self.learner.env

    def run(self) -> None:
        """Learn until the budget is used up; a run that has used it up is left as it is.

        Raises:
            KeyboardInterrupt: on Ctrl-C, after a checkpoint; a second Ctrl-C does not wait for it.
        """
        if self.progress.share >= 1.0:
            if not self.kept.files:  # it was stopped before its first validation, and its budget has been lowered since
                self.keep()
            return
        log = TrainingLog(self.config, self.folder.path, self.log_config)
        self.model.set_logger(log.logger)
        self.schedule.start()
        with deferred_interrupt(self._stop):
            callback = _Callback(self, log)
            self.model.learn(_FOREVER, callback=callback, log_interval=_FOREVER, reset_num_timesteps=False)
        self.model.logger.close()
        if self.interrupted:
            self.checkpoint()
            raise KeyboardInterrupt
        self.keep()

    def update_progress(self) -> None:
        """Bring the progress and all schedules up to date."""
        progress, num_steps = self.progress, self.learner.num_steps - self.origin.num_steps
        self.schedule.update(num_steps)
        progress.seconds, progress.share, progress.steps = self.schedule.seconds, self.schedule.share, num_steps
        progress.episode_length = self.episode_mean("l")
        self.env.set_progress(self.schedule.position)

    def advance(self) -> None:
        """Do what is due between two rollouts: exploration fades, and the actor is averaged or held."""
        held = self.learner.num_steps < self.origin.held_until
        self.learner.advance(self.schedule.exploration_share, held)

    def keep(self) -> None:
        """Validate the policy, keep it, and write a checkpoint."""
        self.update_progress()
        row = {"minutes": self.progress.seconds / 60.0, "steps": self.progress.steps}
        episodes = {"episode_length": self.progress.episode_length, "episode_return": self.episode_mean("r")}
        self.progress.validation = self.kept.add(self.policy_bytes(), row, episodes)
        self.checkpoint()

    def checkpoint(self) -> None:
        """Write all that is needed to go on from here."""
        self.update_progress()
        state = (
            self.learner.state()
            | self.kept.state()
            | {
                "seconds": self.progress.seconds,
                "held_until": self.origin.held_until,
                "inherited": self.origin.record,
            }
        )
        self.folder.save_checkpoint(self.model.get_parameters(), state, self.kept.files)

    def policy_bytes(self) -> bytes:
        """Return the deterministic policy as a policy file."""
        return self.learner.policy_bytes(training_record(self.config, self.progress, self.origin))

    def _restore(self) -> None:
        parameters, state = self.folder.load_checkpoint()
        try:
            self.learner.restore(parameters, state)
            self.origin = Origin(state.get("inherited", {}), state.get("held_until", 0))
            self.schedule.seconds = self.progress.seconds = float(state["seconds"])
            self.kept.restore(state, self.folder.restore_files())
        except _MISFIT as error:
            raise UserError(f"the checkpoint in {self.folder.path} does not fit its configuration: {error}") from error

    def _stop(self) -> None:
        self.interrupted = True

    def episode_mean(self, key: str) -> float:
        """Mean length "l" or return "r" of the last episodes; 0 before the first one has ended."""
        values: list[Any] = [episode[key] for episode in self.model.ep_info_buffer or ()]
        return float(np.mean(values)) if values else 0.0


class _Callback(BaseCallback):
    """The hook of stable-baselines3: it keeps the clock, validates and logs when it is time to, and ends the run."""

    def __init__(self, trainer: Trainer, log: TrainingLog):
        super().__init__()
        self.trainer = trainer
        self._log_of_run = log
        self._saved = self._logged = time.monotonic()
        self._logged_steps = trainer.model.num_timesteps
        self._looked_at = trainer.progress.steps
        self._reward_sums: dict[str, float] = {}
        self._num_sums = 0

    def _on_rollout_start(self) -> None:
        trainer, now = self.trainer, time.monotonic()
        trainer.update_progress()
        trainer.advance()
        before, self._looked_at = self._looked_at, trainer.progress.steps
        if trainer.schedule.budget.is_due(before, self._looked_at):
            trainer.keep()
            self._log_of_run.film(lambda: NetworkAgent(trainer.policy_bytes(), "newest"), self.model.num_timesteps)
            self._saved = self._logged = time.monotonic()
            self._logged_steps = self.model.num_timesteps
        elif now - self._saved > CHECKPOINT_S:
            trainer.checkpoint()
            self._saved = time.monotonic()
        if now - self._logged > LOG_S:
            self._log(now)

    def _on_step(self) -> bool:
        for name, mean in self.trainer.env.reward_means.items():
            self._reward_sums[name] = self._reward_sums.get(name, 0.0) + mean
        self._num_sums += 1
        self.trainer.update_progress()
        return self.trainer.progress.share < 1.0 and not self.trainer.interrupted

    def _log(self, now: float) -> None:
        progress = self.trainer.progress
        progress.steps_per_s = (self.model.num_timesteps - self._logged_steps) / (now - self._logged)
        self._logged, self._logged_steps = now, self.model.num_timesteps
        rewards = {name: total / self._num_sums for name, total in self._reward_sums.items()}
        self._reward_sums, self._num_sums = {}, 0
        episode_return = self.trainer.episode_mean("r")
        self._log_of_run.record(progress, rewards, episode_return, self.model.num_timesteps)
        if self.trainer.on_progress:
            self.trainer.on_progress(progress)


def train(
    config: TrainConfig,
    path: str | Path,
    resume: bool = False,
    on_progress: OnProgress | None = None,
    start: str | Path | None = None,
    log: LogConfig = TENSORBOARD,
    crew: Crew | None = None,
) -> Trainer | Distiller:
    """Run a training to its end: in a new folder, or in one that the same call began and that was interrupted.

    Args:
        config: the configuration of the training.
        path: path of the run folder.
        resume: continue the folder's run, with a configuration that may differ, for example by a larger budget.
        on_progress: called a few times a second.
        start: run folder or policy (a shipped one's name or a file) with whose networks a new run begins. A run that is
            resumed before its first checkpoint knows it. A student can begin with another student only.
        log: destination of the figures beside the learning curve; a student writes the learning curve only.
        crew: workers that move the robots. The default is this process. A student has none.

    Raises:
        UserError: a folder or policy is not suitable.
        KeyboardInterrupt: on Ctrl-C, after a checkpoint.
    """
    start = start or config.begin_with or None
    check_crew(config, crew)
    if resume:
        folder = RunFolder(path)
        start = folder.beginning().get("start") or start
    begins_with = warm_start(config, start) if start and not RunFolder(path).has_checkpoint else None
    if not resume:
        folder = RunFolder.begin(path, config, _absolute(start))
    trainer: Trainer | Distiller
    if config.algorithm == DAGGER:
        assert not isinstance(begins_with, RunFolder)
        trainer = Distiller(config, folder, folder.has_checkpoint, on_progress, begins_with)
    else:
        trainer = Trainer(config, folder, folder.has_checkpoint, on_progress, begins_with, log, crew)
    trainer.run()
    return trainer


def go_on(
    config: TrainConfig,
    path: str | Path,
    on_progress: OnProgress | None = None,
    start: str | Path | None = None,
    log: LogConfig = TENSORBOARD,
    crew: Crew | None = None,
) -> Trainer | Distiller:
    """Run a training to its end, whatever an earlier call has left of it: nothing, a beginning, or a checkpoint.

    Arguments and errors are those of `train`; a run with a checkpoint may have another configuration.
    """
    start = start or config.begin_with or None
    folder = RunFolder(path)
    if not folder.has_checkpoint and not _is_beginning(folder, config, start):
        discard_beginning(folder.path)
    return train(config, path, folder.has_checkpoint, on_progress, start, log, crew)


def is_done(folder: RunFolder, config: TrainConfig) -> bool:
    """Tell whether a run has used up the budget of a configuration."""
    if not folder.has_checkpoint:
        return False
    try:
        return budget_for(config, folder).share(folder.num_steps()) >= 1.0
    except _MISFIT as error:
        raise UserError(f"the checkpoint in {folder.path} is damaged: {error}") from error


def _is_beginning(folder: RunFolder, config: TrainConfig, start: str | Path | None) -> bool:
    """Tell whether a folder is one that the same training began."""
    try:
        return folder.is_of(config, _absolute(start))
    except UserError:
        return False


def _absolute(start: str | Path | None) -> str:
    """The start of a run, so that it is found from any folder: a path, or the name of a shipped policy."""
    return "" if start is None else str(Path(start).absolute() if Path(start).exists() else start)


def _beginning_with(start: RunFolder | NetworkAgent | None) -> Callable[[Learner], object]:
    return lambda learner: begin_with(learner, start) if start else None

"""Training: one loop for every algorithm. SB3 collects and updates; we watch the clock, probe, and keep the best."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import platform
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

import surefoot
from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes, with_record
from surefoot.learning.config import TrainConfig
from surefoot.learning.inheritance import forerunner
from surefoot.learning.models import limit_exploration, make_model
from surefoot.learning.networks import actor_layers, put_actor, with_foresight
from surefoot.learning.probe import Probe, probe
from surefoot.learning.run_folder import KEPT, RunFolder
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.task.contract import Contract
from surefoot.task.environment import PushRecoveryVectorEnv

PROBE_S = 30.0
"""Time from one probe and checkpoint to the next."""
LOG_S = 2.0
AVERAGED_SHARE = 0.2
"""The actor is averaged over at most this share of the steps so far: the first ones are soon forgotten."""
CRITIC_FIRST_STEPS = 250_000
"""Policy steps in which only the critic learns, when a run begins with a policy and no critic."""
_FOREVER = 10**12


@dataclass
class Progress:
    """Where a run is, for whoever shows it.

    Attributes:
        share: of the budget used, 0 to 1.
        seconds: since the run began, earlier sittings included.
        steps: policy steps.
        steps_per_s: lately.
        episode_length: mean of the last episodes, in policy steps.
        probe: the last one.
    """

    share: float = 0.0
    seconds: float = 0.0
    steps: int = 0
    steps_per_s: float = 0.0
    episode_length: float = 0.0
    probe: Probe | None = None


class Trainer:
    """One training run in its folder.

    Args:
        config: what to learn.
        folder: where to keep it.
        resume: go on from the folder's checkpoint.
        after: what this run begins with: the networks of another run, or a policy, whose critic is learned first.
        on_progress: called a few times a second.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: RunFolder,
        resume: bool = False,
        on_progress: Callable[[Progress], None] | None = None,
        after: RunFolder | NetworkAgent | None = None,
    ):
        self.config = config
        self.folder = folder
        self.on_progress = on_progress
        self.progress = Progress()
        self.best_score = -np.inf
        self.interrupted = False
        # DDPG's gradients need a core of their own meanwhile.
        num_threads = max(1, (os.cpu_count() or 1) - 1) if config.algorithm == "ddpg" else 0
        self.env = PushRecoveryVectorEnv(config.num_envs, config.env, num_threads)
        self.venv = SB3VecEnv(self.env, config.foresight)
        self.rng = np.random.default_rng(config.seed)
        self.model = make_model(config, self.venv, self.rng, self._learning_rate)
        self._seconds_before = 0.0
        self._average = actor_layers(self.model)
        self._averaged_steps = 0
        self._held_until = 0
        self._inherited: dict[str, Any] = {}
        if resume:
            self._restore()
        elif isinstance(after, RunFolder):
            self._inherit(after)
        elif after:
            self._fine_tune(after)

    def run(self) -> None:
        """Learn until the budget is used up.

        Raises:
            KeyboardInterrupt: on Ctrl-C, after a checkpoint; a second Ctrl-C does not wait for it.
        """
        self.model.set_logger(configure(str(self.folder.path), ["tensorboard"]))
        self._began = time.monotonic()
        with _deferred_interrupt(self._stop):
            self.model.learn(_FOREVER, callback=_Watch(self), log_interval=_FOREVER, reset_num_timesteps=False)
        self.model.logger.close()
        if self.interrupted:
            self.checkpoint()
            raise KeyboardInterrupt
        self.keep()

    def _stop(self) -> None:
        self.interrupted = True

    def clock(self) -> None:
        """Bring the progress up to date."""
        p, config = self.progress, self.config
        p.seconds = self._seconds_before + time.monotonic() - self._began
        p.steps = self.model.num_timesteps - self._inherited.get("policy_steps", 0)
        p.share = min(1.0, max(p.seconds / (60.0 * config.minutes), p.steps / config.steps if config.steps else 0.0))
        lengths = [episode["l"] for episode in self.model.ep_info_buffer or ()]
        p.episode_length = float(np.mean(lengths)) if lengths else 0.0
        self.env.set_progress(self._scheduled())

    def advance(self) -> None:
        """Between two rollouts: what changes with the share of the training done, and the averaged actor."""
        config = self.config
        if self.model.num_timesteps < self._held_until:
            put_actor(self.model, self._average, self.config.log_std)
        limit_exploration(self.model, config.log_std, self._faded(config.final_noise))
        if config.average_steps:
            steps = self.model.num_timesteps - self._averaged_steps
            over = min(config.average_steps, AVERAGED_SHARE * self.model.num_timesteps)
            newest = 1.0 - np.exp(-steps / max(over, 1.0))
            for averaged, layer in zip(self._average, actor_layers(self.model), strict=True):
                for old, new in zip(averaged, layer, strict=True):
                    old += newest * (new - old)
            self._averaged_steps = self.model.num_timesteps

    def keep(self) -> None:
        """Probe the policy, keep it if it is the best, and write a checkpoint."""
        self.clock()
        data = self.policy_bytes()
        found = self.progress.probe = probe(NetworkAgent(data, "probe"))
        data = with_record(data, probe=found.record())
        self.folder.save_policy("last", data)
        self.folder.save_policy(f"{KEPT}/{self.progress.seconds / 60.0:06.1f}", data)
        if found.score > self.best_score:
            self.best_score = found.score
            self.folder.save_policy("best", data)
        self.folder.append_curve(self._curve_row(found))
        self.checkpoint()

    def checkpoint(self) -> None:
        """Write all that is needed to go on from here."""
        self.clock()
        self.folder.save_checkpoint(self.model.get_parameters(), self._state())

    def policy_bytes(self) -> bytes:
        """The deterministic policy as a policy file."""
        contract = Contract.of(self.env.robot, self.config.env.pose, self.config.env.action_scale, self._record())
        normalise = self.venv.normalise
        squash = isinstance(self.model, OffPolicyAlgorithm)
        layers = self._average if self.config.average_steps else actor_layers(self.model)
        return network_bytes(layers, normalise.mean, normalise.std, squash, contract)

    def _record(self) -> dict[str, Any]:
        p, config, before = self.progress, self.config, self._inherited
        record = {
            "algorithm": config.algorithm,
            "preset": config.preset,
            "seed": config.seed,
            "policy_steps": p.steps + before.get("policy_steps", 0),
            "minutes": round(p.seconds / 60.0 + before.get("minutes", 0.0), 2),
            "cores": os.cpu_count(),
            "machine": platform.machine(),
            "surefoot": surefoot.__version__,
            "commit": _commit(),
        }
        return record | ({"after": before} if before else {})

    def _curve_row(self, found: Probe) -> dict[str, float]:
        returns = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        return {
            "minutes": self.progress.seconds / 60.0,
            "steps": self.progress.steps,
            "recovered": found.recovered,
            "fell": found.fell,
            "calm": found.calm,
            "calm_power": found.power,
            **found.main_directions(),
            "episode_length": self.progress.episode_length,
            "episode_return": float(np.mean(returns)) if returns else 0.0,
        }

    def _state(self) -> dict[str, Any]:
        return {
            "steps": self.model.num_timesteps,
            "seconds": self.progress.seconds,
            "best_score": self.best_score,
            "noise_generator": self.rng.bit_generator.state,
            "env_generator": self.env.generator.bit_generator.state,
            "torch_generator": torch.get_rng_state(),
            "average": [list(layer) for layer in self._average],
            "held_until": self._held_until,
            "inherited": self._inherited,
        }

    def _restore(self) -> None:
        parameters, state = self.folder.load_checkpoint()
        self._take_networks(parameters, state)
        self.best_score = state["best_score"]
        self._inherited = state.get("inherited", {})
        self._held_until = state.get("held_until", 0)
        self._seconds_before = self.progress.seconds = state["seconds"]
        self.rng.bit_generator.state = state["noise_generator"]
        self.venv.seed(None)
        self.env.reset(seed=self.config.seed)
        self.env.generator.bit_generator.state = state["env_generator"]
        torch.set_rng_state(state["torch_generator"])

    def _take_networks(self, parameters: dict[str, dict], state: dict[str, Any]) -> None:
        if self.config.foresight:
            parameters = with_foresight(parameters, self.model)
        self.model.set_parameters(parameters)  # type: ignore[arg-type]
        self._average = [(weight, bias) for weight, bias in state["average"]]
        self._count_from(state["steps"])

    def _count_from(self, steps: int) -> None:
        self.model.num_timesteps = self._averaged_steps = steps
        if isinstance(self.model, OffPolicyAlgorithm):  # its replay buffer was not kept and is filled anew first
            self.model.learning_starts += steps

    def _inherit(self, folder: RunFolder) -> None:
        """Begin with the networks of another run: an own clock, schedule and curve."""
        parameters, state = folder.load_checkpoint()
        config, before = folder.config(), state.get("inherited", {})
        self._take_networks(parameters, state)
        self._inherited = {
            "preset": config.preset,
            "seed": config.seed,
            "policy_steps": state["steps"],
            "minutes": round(state["seconds"] / 60.0 + before.get("minutes", 0.0), 2),
        } | ({"after": before} if before else {})

    def _fine_tune(self, policy: NetworkAgent) -> None:
        """Begin with a policy: the actor is held until the critic has learned what its actions are worth."""
        self._average = policy.layers(self.venv.normalise.mean, self.venv.normalise.std)
        put_actor(self.model, self._average, self.config.log_std)
        record = policy.contract.training
        self._inherited = {key: record[key] for key in ("preset", "seed", "policy_steps", "minutes") if key in record}
        if "after" in record:
            self._inherited["after"] = record["after"]
        self._count_from(self._inherited.get("policy_steps", 0))
        self._held_until = self.model.num_timesteps + CRITIC_FIRST_STEPS

    def _learning_rate(self, _: float) -> float:
        return self.config.hyper["learning_rate"] * self._faded(self.config.final_learning_rate)

    def _scheduled(self) -> float:
        """Where the schedules are, 0 to 1."""
        config = self.config
        return self.progress.share * min(1.0, config.minutes / max(config.schedule_minutes, 1e-9))

    def _faded(self, final: float) -> float:
        """What is left now of something of which `final` is left at the end."""
        return 1.0 - (1.0 - final) * self._scheduled()


class _Watch(BaseCallback):
    """SB3's hook into our loop."""

    def __init__(self, trainer: Trainer):
        super().__init__()
        self.trainer = trainer
        self._kept = self._logged = time.monotonic()
        self._logged_steps = trainer.model.num_timesteps
        self._reward_sums: dict[str, float] = {}
        self._num_sums = 0

    def _on_rollout_start(self) -> None:
        trainer, now = self.trainer, time.monotonic()
        trainer.clock()
        trainer.advance()
        if now - self._kept > PROBE_S:
            trainer.keep()
            self._kept = self._logged = time.monotonic()
            self._logged_steps = self.model.num_timesteps
        elif now - self._logged > LOG_S:
            self._log(now)

    def _on_step(self) -> bool:
        for name, mean in self.trainer.env.reward_means.items():
            self._reward_sums[name] = self._reward_sums.get(name, 0.0) + mean
        self._num_sums += 1
        self.trainer.clock()
        return self.trainer.progress.share < 1.0 and not self.trainer.interrupted

    def _log(self, now: float) -> None:
        progress = self.trainer.progress
        progress.steps_per_s = (self.model.num_timesteps - self._logged_steps) / (now - self._logged)
        self._logged, self._logged_steps = now, self.model.num_timesteps
        for name, total in self._reward_sums.items():
            self.logger.record(f"reward/{name}", total / self._num_sums)
        self._reward_sums, self._num_sums = {}, 0
        self.logger.record("rollout/episode_length", progress.episode_length)
        self.logger.record("time/steps_per_s", progress.steps_per_s)
        if progress.probe:
            self.logger.record("probe/recovered", progress.probe.recovered)
            for name, impulse in progress.probe.main_directions().items():
                self.logger.record(f"probe/{name}_Ns", impulse)
        self.logger.dump(self.model.num_timesteps)
        if self.trainer.on_progress:
            self.trainer.on_progress(progress)


@functools.cache
def _commit() -> str | None:
    """Of the checkout that this runs from; None for an installed package."""
    folder = Path(surefoot.__file__).parent
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return told.stdout.strip()


@contextlib.contextmanager
def _deferred_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Let the first Ctrl-C only ask for a stop, so that no update or file is cut in two."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, before)
        stop()

    before = signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def train(
    config: TrainConfig,
    path: str | Path,
    resume: bool = False,
    on_progress: Callable[[Progress], None] | None = None,
    after: str | Path | None = None,
) -> Trainer:
    """Run a training to its end, in a new folder or from the checkpoint of an old one.

    Args:
        after: a run folder whose networks a new run begins with, or a policy (a shipped one's name or a file).

    Raises:
        UserError: a folder or policy is not fit for it.
    """
    parent = forerunner(config, after) if after else None
    folder = RunFolder(path) if resume else RunFolder.create(path, config)
    trainer = Trainer(config, folder, resume, on_progress, parent)
    trainer.run()
    return trainer


def with_budget(config: TrainConfig, minutes: float | None, steps: int | None, seed: int) -> TrainConfig:
    """The configuration with another budget and seed."""
    return dataclasses.replace(config, minutes=minutes or config.minutes, steps=steps or config.steps, seed=seed)

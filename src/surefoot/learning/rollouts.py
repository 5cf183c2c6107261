"""Rollouts: a worker of a larger training run, which moves robots by the policy that it receives.

A worker has a learner of its own, whose algorithm collects as it does in a run by itself, and never updates.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.type_aliases import TrainFreq, TrainFrequencyUnit
from torch import nn

from surefoot.cores import at_most
from surefoot.learning.config import TrainConfig
from surefoot.learning.learner import Learner
from surefoot.learning.models import limit_exploration

REPLAY_STEPS = 8
"""Policy steps of an off-policy learner's robots between two policies: a message each."""
COLLECTED = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs", "advantages", "returns")
"""The parts of an on-policy rollout, arrays (num_steps, num_robots, ...) of SB3's rollout buffer."""
_FOREVER = 10**12
_TRUNCATED = "TimeLimit.truncated"


@dataclasses.dataclass(frozen=True)
class Order:
    """The instructions of a worker before it moves its robots.

    Attributes:
        weights: of the networks that collect, see `collecting`.
        exploration: share of the exploration that is left.
        position: share of the schedules that is done.
    """

    weights: Mapping[str, np.ndarray]
    exploration: float
    position: float


@dataclasses.dataclass(frozen=True)
class Rollout:
    """The experience of a worker's robots.

    Attributes:
        arrays: on-policy, by the names of `COLLECTED`.
        transitions: off-policy, of each policy step: observations, next observations, actions, rewards, dones and
            whether time had run out, each (num_robots, ...).
        episodes: length and return of every episode that ended, as SB3 keeps them.
        reward_means: mean of every term of the reward.
    """

    arrays: dict[str, np.ndarray]
    transitions: list[tuple[np.ndarray, ...]]
    episodes: list[dict[str, Any]]
    reward_means: dict[str, float]


def collecting(model: BaseAlgorithm) -> nn.Module:
    """Return the networks that a worker needs: policy and critic, or an off-policy algorithm's actor alone."""
    return model.policy.actor if isinstance(model, OffPolicyAlgorithm) else model.policy  # type: ignore[return-value]


class RolloutWorker:
    """Some of the robots of a run.

    Args:
        config: of the run.
        place: number of this worker.
        num_workers: all of them; each has as many robots.
        cores: that it may use.
    """

    def __init__(self, config: TrainConfig, place: int, num_workers: int, cores: int = 1):
        (seed,) = np.random.SeedSequence([config.seed, place]).generate_state(1)
        hyper = dict(config.hyper)
        if "buffer_size" in hyper:
            hyper["buffer_size"] = config.num_envs  # nothing is replayed here
        own = {"num_envs": config.num_envs // num_workers, "seed": int(seed), "hyper": hyper}
        self._config = dataclasses.replace(config, **own)  # type: ignore[arg-type]
        with at_most(cores):
            self._learner = Learner(self._config, lambda _: config.hyper["learning_rate"])
        self._model = self._learner.model
        self._means = _RewardMeans(self._learner)
        self._model._setup_learn(_FOREVER, None)
        self._means.init_callback(self._model)

    def pid(self) -> int:
        """The number of the process that the worker is in."""
        return os.getpid()

    def collect(self, order: Order) -> Rollout:
        """Move the robots for a rollout by the policy of an order."""
        model = self._model
        collecting(model).load_state_dict({name: torch.from_numpy(array) for name, array in order.weights.items()})
        limit_exploration(model, self._config.log_std, order.exploration)
        self._learner.env.set_progress(order.position)
        arrays: dict[str, np.ndarray] = {}
        recorder = _Recorder()
        if isinstance(model, OnPolicyAlgorithm):
            assert model.env
            model.collect_rollouts(model.env, self._means, model.rollout_buffer, model.n_steps)
            arrays = {name: getattr(model.rollout_buffer, name) for name in COLLECTED}
        else:
            assert isinstance(model, OffPolicyAlgorithm)
            assert model.env
            freq = TrainFreq(REPLAY_STEPS, TrainFrequencyUnit.STEP)
            buffer: ReplayBuffer = recorder  # type: ignore[assignment]  # all that is asked of it is to add
            model.collect_rollouts(model.env, self._means, freq, buffer, model.action_noise)
        episodes = list(model.ep_info_buffer or ())
        if model.ep_info_buffer:
            model.ep_info_buffer.clear()
        return Rollout(arrays, recorder.transitions, episodes, self._means.take())


class _Recorder:
    """Stands where SB3 expects a replay buffer, and keeps the transitions in order."""

    def __init__(self) -> None:
        self.transitions: list[tuple[np.ndarray, ...]] = []

    def add(self, *parts: Any) -> None:
        *arrays, infos = parts
        truncated = np.array([info.get(_TRUNCATED, False) for info in infos])
        self.transitions.append((*(np.array(array) for array in arrays), truncated))


def as_infos(truncated: np.ndarray) -> list[dict[str, Any]]:
    """Return what SB3's replay buffer reads of a policy step's infos."""
    return [{_TRUNCATED: bool(each)} for each in truncated]


class _RewardMeans(BaseCallback):
    """Adds up the means of the reward's terms."""

    def __init__(self, learner: Learner):
        super().__init__()
        self._learner = learner
        self._sums: dict[str, float] = {}
        self._num = 0

    def _on_step(self) -> bool:
        for name, mean in self._learner.env.reward_means.items():
            self._sums[name] = self._sums.get(name, 0.0) + mean
        self._num += 1
        return True

    def take(self) -> dict[str, float]:
        """Return the means since the last call."""
        means = {name: total / self._num for name, total in self._sums.items()}
        self._sums, self._num = {}, 0
        return means

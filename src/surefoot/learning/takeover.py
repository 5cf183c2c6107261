"""Takeover: an environment in which another policy drives robots that are beyond a border.

A specialist for small pushes that learns in this way meets the stance and the motions from which the other policy
continues. A specialist that learns alone finds a stance of its own, from which the other policy saves fewer robots.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.buffers import RolloutBuffer

from surefoot.agents.load import load_policy
from surefoot.learning.config import TakeoverConfig, TrainConfig
from surefoot.learning.teachers import Teacher, Teachers
from surefoot.rates import POLICY_HZ
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv

TAKEN_S = 2.0
"""An episode is truncated this long after the other policy took over [s], for a robot with legs as long as the paper's:
what it does then teaches the learning policy nothing more."""


class TakeoverVectorEnv(PushRecoveryVectorEnv):
    """Robots that a given policy drives while they are beyond a border.

    Args:
        num_envs, config, num_threads: as of `PushRecoveryVectorEnv`.
        takeover: the policy and its border.

    Raises:
        UserError: the policy cannot be loaded, has a memory, or is for another robot.

    Attributes:
        taken: whether the given policy drove a robot in the last policy step (N,).
    """

    def __init__(self, num_envs: int, config: EnvConfig, takeover: TakeoverConfig, num_threads: int = 0):
        super().__init__(num_envs, config, num_threads)
        policy = load_policy(takeover.policy)
        policy.prepare(num_envs)
        # The first one stands for the policy that learns; it is never asked.
        self._teachers = Teachers([Teacher(policy), Teacher(policy, takeover.beyond, takeover.capture_point)], self)
        self._clear = np.zeros((num_envs, 0))
        self._steps_taken = np.zeros(num_envs, np.int64)
        self._longest = round(TAKEN_S * self.robot.time_scale * POLICY_HZ)
        self.taken = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start every robot anew; the learning policy drives all of them."""
        result = super().reset(seed=seed, options=options)
        self._clear = self.loop.observe(slice(None), with_errors=False)
        self._teachers.begin(self._clear)
        self._steps_taken[:] = 0
        return result

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every robot by one policy step; the actions of those that are taken over do not count."""
        self.taken = self._teachers.level == 1
        actions = np.where(self.taken[:, None], self._teachers.answers(1, self._clear, self.taken), actions)
        self._steps_taken = np.where(self.taken, self._steps_taken + 1, 0)
        self.loop.tick[self._steps_taken > self._longest] = self.max_ticks
        result = super().step(actions)
        ended = result[2] | result[3]
        self._clear = self.loop.observe(slice(None), with_errors=False)
        self._teachers.update(self._clear, ended)
        self._steps_taken[ended] = 0
        return result


class OwnActionsBuffer(RolloutBuffer):
    """Rollouts of such robots: the actions of a policy step in which a robot was taken over have no advantage.

    Args:
        args, kwargs: those of SB3's buffer.
        env: the robots.
    """

    def __init__(self, *args: Any, env: TakeoverVectorEnv, **kwargs: Any):
        self._env = env
        super().__init__(*args, **kwargs)

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._taken = np.zeros((self.buffer_size, self.n_envs), bool)

    def add(self, *args: Any, **kwargs: Any) -> None:
        """Keep a policy step of all robots."""
        self._taken[self.pos] = self._env.taken
        super().add(*args, **kwargs)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """Compute both as SB3 does; what was not the policy's own doing is neither better nor worse than its mean."""
        super().compute_returns_and_advantage(last_values, dones)
        if not self._taken.all():
            self.advantages[self._taken] = self.advantages[~self._taken].mean()


def make_env(config: TrainConfig, num_threads: int) -> PushRecoveryVectorEnv:
    """Return the robots of a run."""
    if config.takeover.policy:
        return TakeoverVectorEnv(config.num_envs, config.env, config.takeover, num_threads)
    return PushRecoveryVectorEnv(config.num_envs, config.env, num_threads)

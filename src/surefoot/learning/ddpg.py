"""DDPG: the algorithm for a batch of robots, with learning during motion, graded exploration and mirrored replays."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import DDPG
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.common.noise import VectorizedActionNoise
from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.td3.policies import Actor
from torch import nn

from surefoot.learning.networks import Mirror, tensors
from surefoot.learning.sb3 import SB3VecEnv


class BatchDDPG(DDPG):
    """DDPG for a batch of robots that learns while they move, and that can be asked for a smooth actor.

    It begins with its own first policy instead of random actions. The gradient steps after a policy step are done
    while the robots make the next one. The actions of that next one are chosen before, so that the result does not
    depend on which of the two is done first.

    Args:
        args, kwargs: those of DDPG in stable-baselines3.
        smoothness: conditioning for action policy smoothness, Mysore et al. 2021: weight in the actor's loss of the
            action's squared change from one policy step to the next, and of its change under a little noise on the
            observation. 0 for plain DDPG.
    """

    NEARBY = 0.1
    """Standard deviation of that noise, of normalised observations."""

    def __init__(self, *args: Any, smoothness: float = 0.0, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.smoothness = smoothness
        self._owed = (0, 0)
        if isinstance(self.env, SB3VecEnv):
            self.env.meanwhile = self._learn_meanwhile

    def _sample_action(self, learning_starts: int, *args: Any, **kwargs: Any) -> tuple[np.ndarray, np.ndarray]:
        return super()._sample_action(0, *args, **kwargs)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        """Ask for gradient steps, which are done during the next policy step."""
        self._owed = (gradient_steps, batch_size)

    def pay(self, times: int) -> None:
        """Do the gradient steps that are asked for after one policy step, for so many of them."""
        owed = self._owed
        for _ in range(times):
            self._owed = owed
            self._learn_meanwhile()

    def _learn_meanwhile(self) -> None:
        gradient_steps, batch_size = self._owed
        self._owed = (0, 0)
        if not gradient_steps:
            return
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer])
        assert self.replay_buffer is not None
        drawn = [part for part in self.replay_buffer.sample(gradient_steps * batch_size) if part is not None]
        for parts in zip(*(torch.split(part, batch_size) for part in drawn), strict=True):
            batch = ReplayBufferSamples(*parts)
            _descend(self.critic, critic_loss := self._critic_loss(batch))
            _descend(self.actor, actor_loss := self._actor_loss(batch))
            polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
            polyak_update(self.actor.parameters(), self.actor_target.parameters(), self.tau)
        self._n_updates += gradient_steps
        self.logger.record("train/critic_loss", critic_loss.item())
        self.logger.record("train/actor_loss", actor_loss.item())

    def _critic_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        discount = self.gamma if batch.discounts is None else batch.discounts
        with torch.no_grad():
            (value,) = self.critic_target(batch.next_observations, self.actor_target(batch.next_observations))
            target = batch.rewards + (1.0 - batch.dones) * discount * value
        (estimate,) = self.critic(batch.observations, batch.actions)
        return nn.functional.mse_loss(estimate, target)

    def _actor_loss(self, batch: ReplayBufferSamples) -> torch.Tensor:
        if not self.smoothness:
            return -self.critic.q1_forward(batch.observations, self.actor(batch.observations)).mean()
        nearby = batch.observations + self.NEARBY * torch.randn_like(batch.observations)
        action, later, other = self.actor(torch.cat([batch.observations, batch.next_observations, nearby])).chunk(3)
        later = torch.where(batch.dones > 0, action, later)
        change = ((action - later) ** 2).sum(dim=1) + ((action - other) ** 2).sum(dim=1)
        return (self.smoothness * change - self.critic.q1_forward(batch.observations, action)[:, 0]).mean()


def _descend(network: Actor | ContinuousCritic, loss: torch.Tensor) -> None:
    (group,) = network.optimizer.param_groups
    for weight, gradient in zip(group["params"], torch.autograd.grad(loss, group["params"]), strict=True):
        weight.grad = gradient
    network.optimizer.step()


class ExplorationNoise(VectorizedActionNoise):
    """Exploration noise for a whole batch of robots at once, of a different size for each, correlated in time.

    It is an Ornstein-Uhlenbeck process, as in Lillicrap et al. 2016: white noise at 25 Hz mostly shakes the joints.

    Args:
        shape: (num_robots, num_joints).
        std: stationary standard deviation of the robot that explores least and of the one that explores most; the
            others lie evenly between them on a logarithmic scale, so that the replay buffer holds both fine standing
            and wild recoveries.
        correlation: of one policy step with the next; 0 for white noise.
        rng: the run's generator.

    Attributes:
        scale: what all deviations are multiplied by.
    """

    def __init__(self, shape: tuple[int, int], std: tuple[float, float], correlation: float, rng: np.random.Generator):
        self.shape, self.rng, self.correlation = shape, rng, correlation
        self.std = np.geomspace(*std, shape[0])[:, None]
        self.scale = 1.0
        self._noise = rng.standard_normal(shape)

    def __call__(self) -> np.ndarray:
        """Draw the noise of the next policy step, (num_robots, num_joints) float32."""
        fresh = self.rng.standard_normal(self.shape)
        self._noise = self.correlation * self._noise + np.sqrt(1.0 - self.correlation**2) * fresh
        return (self.scale * self.std * self._noise).astype(np.float32)

    def reset(self, indices: Any = None) -> None:
        """The process goes on across episodes: it is stationary."""


class MirroredReplayBuffer(NStepReplayBuffer):
    """A replay buffer that mirrors every other transition, so that a symmetric robot learns both sides at once.

    Args:
        args, kwargs: those of SB3's n-step buffer.
        mirrors: (source, sign) of the observation and of the action, see `observation.mirror`.
    """

    def __init__(self, *args: Any, mirrors: tuple[Mirror, Mirror], **kwargs: Any):
        super().__init__(*args, **kwargs)
        self._mirrors = [tensors(mirror) for mirror in mirrors]

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """Draw transitions, every other one in the mirror."""
        batch = super().sample(batch_size, env)
        for_observation, for_action = self._mirrors
        for vectors, (source, sign) in (
            (batch.observations, for_observation),
            (batch.next_observations, for_observation),
            (batch.actions, for_action),
        ):
            vectors[::2] = vectors[::2, source] * sign
        return batch

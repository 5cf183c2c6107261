"""stable-baselines3: our environment as its VecEnv, the paper's networks as its policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from sb3_contrib import TRPO
from stable_baselines3 import DDPG, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBufferSamples
from stable_baselines3.common.noise import VectorizedActionNoise
from stable_baselines3.common.policies import ActorCriticPolicy, ContinuousCritic
from stable_baselines3.common.utils import polyak_update
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.td3.policies import Actor, TD3Policy
from torch import nn

from surefoot import observation
from surefoot.env import PushRecoveryVectorEnv


class Normalisation:
    """Observations as a network sees them: (observation - mean) / std.

    The mean is the observation of the nominal pose, made left-right symmetric, and the std the table's scales:
    constants, so that no replayed or stored transition goes stale.
    """

    def __init__(self, env: PushRecoveryVectorEnv):
        loop = env.loop
        start = loop.reset(np.array([0]), loop.nominal[None])
        standing = observation.observe(start)[0, 0]
        # At the first tick no ground force is felt yet; each foot is to carry half the weight.
        names = observation.component_names(env.robot)
        for i, name in enumerate(names):
            if name.startswith("foot_force"):
                standing[i] = 0.5 * env.robot.weight / observation.FOOT_FORCE_UNIT
        source, sign = observation.mirror(env.robot)
        self.mean = 0.5 * (standing + sign * standing[source])
        self.std = observation.scales(env.robot)

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        return ((observations - self.mean) / self.std).astype(np.float32)


class SB3VecEnv(VecEnv):
    """The batched environment as stable-baselines3 wants it, with normalised observations.

    Args:
        env: whose robots are to be used.

    Attributes:
        meanwhile: if set, what the learner does while the robots move.
    """

    def __init__(self, env: PushRecoveryVectorEnv):
        self.meanwhile: Callable[[], None] | None = None
        self._mover = ThreadPoolExecutor(1)
        self.env = env  # SB3's constructor asks it for its render mode
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.normalise = Normalisation(env)
        self._no_info: dict[str, Any] = {}
        self._return = np.zeros(env.num_envs)
        self._length = np.zeros(env.num_envs, np.int64)

    def reset(self) -> np.ndarray:
        observations, _ = self.env.reset(seed=self._seeds[0])
        self._reset_seeds()
        self._return[:] = 0.0
        self._length[:] = 0
        return self.normalise(observations)

    def step_async(self, actions: np.ndarray) -> None:
        if self.meanwhile:
            self._moving = self._mover.submit(self.env.step, actions)
        else:
            self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict]]:
        if self.meanwhile:
            self.meanwhile()
            observations, rewards, terminated, truncated, info = self._moving.result()
        else:
            observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        self._return += rewards
        self._length += 1
        infos = [self._no_info] * self.num_envs
        ended = np.flatnonzero(done)
        if len(ended):
            final = self.normalise(info["final_obs"][ended])
            for i, last in zip(ended, final, strict=True):
                infos[i] = {
                    "episode": {"r": self._return[i], "l": int(self._length[i])},
                    "terminal_observation": last,
                    "TimeLimit.truncated": bool(truncated[i]),
                }
            self._return[ended] = 0.0
            self._length[ended] = 0
        return self.normalise(observations), rewards.astype(np.float32), done, infos

    def close(self) -> None:
        self._mover.shutdown()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        return [getattr(self.env, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))


Mirror = tuple[np.ndarray, np.ndarray]
"""(source, sign) of a mirrored vector, see `observation.mirror`."""


class _Symmetric(nn.Module):
    """A network made equal on both sides: (f(s) + mirror(f(mirror(s)))) / 2, or of a scalar without the outer mirror.

    Args:
        network: f.
        inward: mirror of the input.
        outward: mirror of the output; None for a scalar.
    """

    def __init__(self, network: nn.Module, inward: Mirror, outward: Mirror | None):
        super().__init__()
        self.network = network
        self.inward = _tensors(inward)
        self.outward = _tensors(outward) if outward else None

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        source, sign = self.inward
        mirrored = self.network(inputs[:, source] * sign)
        if self.outward:
            source, sign = self.outward
            mirrored = mirrored[:, source] * sign
        return 0.5 * (self.network(inputs) + mirrored)


class _TanhActorReluCritic(nn.Module):
    """SB3's "feature extractor": here the two whole networks, each with activations and an output of its own."""

    def __init__(self, num_inputs: int, num_actions: int, actor: Sequence[int], critic: Sequence[int]):
        super().__init__()
        self.policy_net: nn.Module = _mlp(num_inputs, actor, num_actions, nn.Tanh)
        self.value_net: nn.Module = _mlp(num_inputs, critic, 1, nn.ReLU)
        self.latent_dim_pi, self.latent_dim_vf = num_actions, 1

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.policy_net(features), self.value_net(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.policy_net(features)

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return self.value_net(features)


class GaussianPolicy(ActorCriticPolicy):
    """The paper's networks for TRPO and PPO: tanh actor, ReLU critic, linear outputs, a std of its own.

    Args:
        mirrors: of the observation and of the action; if given, both networks are made symmetric. The other
            arguments are those of SB3's policy.
        correlation: of the exploration from one policy step to the next (Hollenstein et al. 2024): the updates take
            the noise for white all the same.
    """

    def __init__(
        self, *args: Any, mirrors: tuple[Mirror, Mirror] | None = None, correlation: float = 0.0, **kwargs: Any
    ):
        self._mirrors = mirrors
        self._correlation = correlation
        self._noise: torch.Tensor | None = None
        super().__init__(*args, **kwargs)

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        if deterministic or not self._correlation:
            return super().forward(obs, deterministic)
        mean, values = self.mlp_extractor(self.extract_features(obs))
        distribution = self._get_action_dist_from_latent(mean)
        fresh = torch.randn_like(mean)
        if self._noise is None or self._noise.shape != mean.shape:
            self._noise = fresh
        self._noise = self._correlation * self._noise + np.sqrt(1.0 - self._correlation**2) * fresh
        actions = mean + self.log_std.exp() * self._noise
        return actions, values, distribution.log_prob(actions)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        # SB3 initialises the two networks as hidden layers; their outputs are to be its outputs, at the same gains.
        nn.init.orthogonal_(_linear(self.mlp_extractor.policy_net)[-1].weight, gain=0.01)
        nn.init.orthogonal_(_linear(self.mlp_extractor.value_net)[-1].weight, gain=1.0)
        # So that what SB3 puts behind them has nothing to do.
        self.action_net = self.value_net = nn.Identity()  # type: ignore[assignment]
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.net_arch, dict)
        assert self.action_space.shape is not None
        num_actions = self.action_space.shape[0]
        networks = _TanhActorReluCritic(self.features_dim, num_actions, self.net_arch["pi"], self.net_arch["vf"])
        if self._mirrors:
            for_observation, for_action = self._mirrors
            networks.policy_net = _Symmetric(networks.policy_net, for_observation, for_action)
            networks.value_net = _Symmetric(networks.value_net, for_observation, None)
        self.mlp_extractor = networks  # type: ignore[assignment]


class DeterministicPolicy(TD3Policy):
    """The paper's tanh actor for DDPG (squashed into the action's bounds, as SB3 needs it) and a ReLU critic."""

    def make_actor(self, features_extractor: Any = None) -> Actor:
        arguments = self._update_features_extractor(self.actor_kwargs, features_extractor)
        actor = Actor(**{**arguments, "activation_fn": nn.Tanh}).to(self.device)
        # Begin by holding the nominal pose, as SB3's Gaussian policies do, not with random postures.
        with torch.no_grad():
            output = _linear(actor.mu)[-1]
            output.weight *= 0.01
            output.bias.zero_()
        return actor


class BatchDDPG(DDPG):
    """DDPG for a batch of robots that learns while they move, and that can be asked for a smooth actor.

    It begins with its own first policy instead of random actions. The gradient steps after a policy step wait for
    the next one: its actions are chosen before them, so that nothing depends on which is done first.

    Args:
        smoothness: conditioning for action policy smoothness, Mysore et al. 2021: weight in the actor's loss of the
            action's squared change from one policy step to the next, and of its change under a little noise on the
            observation. 0 for plain DDPG.
    """

    NEARBY = 0.1
    """Deviation of that noise, of normalised observations."""

    def __init__(self, *args: Any, smoothness: float = 0.0, **kwargs: Any):
        super().__init__(*args, **kwargs)
        self.smoothness = smoothness
        self._owed = (0, 0)
        if isinstance(self.env, SB3VecEnv):
            self.env.meanwhile = self._learn_meanwhile

    def _sample_action(self, learning_starts: int, *args: Any, **kwargs: Any) -> tuple[np.ndarray, np.ndarray]:
        return super()._sample_action(0, *args, **kwargs)

    def train(self, gradient_steps: int, batch_size: int = 100) -> None:
        self._owed = (gradient_steps, batch_size)

    def _learn_meanwhile(self) -> None:
        gradient_steps, batch_size = self._owed
        self._owed = (0, 0)
        if not gradient_steps:
            return
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer])
        assert self.replay_buffer is not None
        for _ in range(gradient_steps):
            batch = self.replay_buffer.sample(batch_size)
            _descend(self.critic, self._critic_loss(batch))
            _descend(self.actor, self._actor_loss(batch))
            polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
            polyak_update(self.actor.parameters(), self.actor_target.parameters(), self.tau)
        self._n_updates += gradient_steps

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
    network.optimizer.zero_grad()
    loss.backward(inputs=list(network.parameters()))  # not through the critic's weights for the actor's sake
    network.optimizer.step()


class ExplorationNoise(VectorizedActionNoise):
    """Exploration noise for a whole batch of robots at once, from calm to bold, correlated in time.

    An Ornstein-Uhlenbeck process, as in Lillicrap et al. 2016: white noise at 25 Hz mostly shakes the joints.

    Args:
        shape: (num_robots, num_joints).
        std: stationary, of the calmest and of the boldest robot; the others lie evenly between them on a logarithmic
            scale, so that the replay buffer holds both fine standing and wild recoveries.
        correlation: of one policy step with the next; 0 for white noise.

    Attributes:
        scale: what all deviations are multiplied by.
    """

    def __init__(self, shape: tuple[int, int], std: tuple[float, float], correlation: float, rng: np.random.Generator):
        self.shape, self.rng, self.correlation = shape, rng, correlation
        self.std = np.geomspace(*std, shape[0])[:, None]
        self.scale = 1.0
        self._noise = rng.standard_normal(shape)

    def __call__(self) -> np.ndarray:
        fresh = self.rng.standard_normal(self.shape)
        self._noise = self.correlation * self._noise + np.sqrt(1.0 - self.correlation**2) * fresh
        return (self.scale * self.std * self._noise).astype(np.float32)

    def reset(self, indices: Any = None) -> None:
        """The process goes on across episodes: it is stationary."""


class MirroredReplayBuffer(NStepReplayBuffer):
    """A replay buffer that shows half of every batch in the mirror: a symmetric robot learns both sides at once.

    Args:
        mirrors: (source, sign) of the observation and of the action, see `observation.mirror`; the other arguments
            are those of SB3's n-step buffer.
    """

    def __init__(self, *args: Any, mirrors: tuple[tuple[np.ndarray, np.ndarray], ...], **kwargs: Any):
        super().__init__(*args, **kwargs)
        self._mirrors = [_tensors(mirror) for mirror in mirrors]

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        batch = super().sample(batch_size, env)
        for_observation, for_action = self._mirrors
        for vectors, (source, sign) in (
            (batch.observations, for_observation),
            (batch.next_observations, for_observation),
            (batch.actions, for_action),
        ):
            vectors[: batch_size // 2] = vectors[: batch_size // 2, source] * sign
        return batch


def _tensors(mirror: Mirror) -> tuple[torch.Tensor, torch.Tensor]:
    source, sign = mirror
    return torch.as_tensor(source), torch.as_tensor(sign, dtype=torch.float32)


def _mlp(num_inputs: int, layers: Sequence[int], num_outputs: int, activation: type[nn.Module]) -> nn.Sequential:
    sizes = [num_inputs, *layers]
    modules: list[nn.Module] = []
    for i, o in zip(sizes[:-1], sizes[1:], strict=True):
        modules += [nn.Linear(i, o), activation()]
    return nn.Sequential(*modules, nn.Linear(sizes[-1], num_outputs))


def _linear(network: nn.Module) -> list[nn.Linear]:
    return [module for module in network.modules() if isinstance(module, nn.Linear)]


Layers = list[tuple[np.ndarray, np.ndarray]]


def actor_layers(model: BaseAlgorithm) -> Layers:
    """(weight, bias) of every linear layer of the deterministic policy, in order, as one plain network."""
    policy: Any = model.policy
    if isinstance(policy, TD3Policy):
        return _linear_layers(policy.actor.mu)
    network = policy.mlp_extractor.policy_net
    if not isinstance(network, _Symmetric):
        return _linear_layers(network)
    return _unfold(_linear_layers(network.network), *policy._mirrors)


def limit_exploration(model: BaseAlgorithm, log_std: float, share: float) -> None:
    """Leave a share of the exploration: of DDPG's noise, or of the largest deviation that a Gaussian policy may have.

    Args:
        log_std: logarithm of the Gaussian policy's initial deviation.
    """
    noise = getattr(model, "action_noise", None)
    if isinstance(noise, ExplorationNoise):
        noise.scale = share
    elif isinstance(model.policy, GaussianPolicy) and share < 1.0:
        with torch.no_grad():
            model.policy.log_std.clamp_(max=log_std + float(np.log(share)))


def _linear_layers(network: nn.Module) -> Layers:
    return [(layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy()) for layer in _linear(network)]


def _unfold(layers: Layers, for_observation: Mirror, for_action: Mirror) -> Layers:
    """The symmetric network as a plain one of twice the width: f(s) and f(mirror(s)) side by side, then their mean."""
    (first, first_bias), *inner, (last, last_bias) = layers
    source, sign = for_observation
    mirrored_first = np.empty_like(first)
    mirrored_first[:, source] = first * sign
    source, sign = for_action
    wide = [(np.concatenate([first, mirrored_first]), np.tile(first_bias, 2))]
    for weight, bias in inner:
        nothing = np.zeros_like(weight)
        wide.append((np.block([[weight, nothing], [nothing, weight]]), np.tile(bias, 2)))
    mirrored_last, mirrored_bias = sign[:, None] * last[source], sign * last_bias[source]
    wide.append((0.5 * np.concatenate([last, mirrored_last], axis=1), 0.5 * (last_bias + mirrored_bias)))
    return wide


ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"trpo": TRPO, "ppo": PPO, "ddpg": BatchDDPG}

"""Networks: the paper's actors and critics in the form that stable-baselines3 needs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.td3.policies import Actor, TD3Policy
from torch import nn

from surefoot.task.privileged import SIGNS

SIDE = 0.2
"""Standard deviation of a new symmetric network's preference for a side."""
Mirror = tuple[np.ndarray, np.ndarray]
"""(source, sign) of a mirrored vector, see `observation.mirror`."""


class SymmetricNetwork(nn.Module):
    """A network that is equal on both sides, but for a preference for one side.

    It is (f(s, 1) + mirror(f(mirror(s), -1))) / 2; of a scalar output there is no outer mirror. Without the preference
    a robot that stands evenly on both feet and is pushed straight ahead could not choose the foot to step with.

    A scalar network that learns (training mode) returns one of the two terms, drawn anew for each input. Both then
    learn from half the samples each, for half the work.

    Args:
        network: f of s alone.
        inward: mirror of the input.
        outward: mirror of the output; None for a scalar.

    Attributes:
        side: the preference: it is added to the first layer's output for s, and subtracted for its mirror image.
    """

    def __init__(self, network: nn.Module, inward: Mirror, outward: Mirror | None):
        super().__init__()
        self.network = network
        self.side = nn.Parameter(SIDE * torch.randn(linear_modules(network)[0].out_features))
        self.inward = tensors(inward)
        self.outward = tensors(outward) if outward else None

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return f and its mirror image in the mean, or a scalar's drawn term while it learns."""
        first, *others = self.network.children()
        rest = nn.Sequential(*others)
        source, sign = self.inward
        if self.training and not self.outward:
            side = 1.0 - 2.0 * torch.randint(2, (len(inputs), 1))
            drawn = torch.where(side > 0.0, inputs, inputs[:, source] * sign)
            return rest(torch.addmm(first(drawn), side, self.side[None]))
        there, mirrored = rest(first(inputs) + self.side), rest(first(inputs[:, source] * sign) - self.side)
        if self.outward:
            source, sign = self.outward
            mirrored = mirrored[:, source] * sign
        return 0.5 * (there + mirrored)


class _TanhActorReluCritic(nn.Module):
    """What SB3 calls the feature extractor: here the two whole networks, each with its own activations and output.

    Args:
        num_inputs: of the critic.
        num_observed: of the actor, which sees the first inputs only: the observation.
        num_actions: outputs of the actor.
        actor, critic: sizes of the hidden layers.
    """

    def __init__(
        self, num_inputs: int, num_observed: int, num_actions: int, actor: Sequence[int], critic: Sequence[int]
    ):
        super().__init__()
        self.policy_net: nn.Module = mlp(num_observed, actor, num_actions, nn.Tanh)
        self.value_net: nn.Module = mlp(num_inputs, critic, 1, nn.ReLU)
        self.num_observed = num_observed
        self.latent_dim_pi, self.latent_dim_vf = num_actions, 1

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return action and value."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return the action, before noise."""
        return self.policy_net(features[:, : self.num_observed])

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """Return the value."""
        return self.value_net(features)


class GaussianPolicy(ActorCriticPolicy):
    """The paper's networks for TRPO and PPO: tanh actor, ReLU critic, linear outputs, a learned standard deviation.

    Args:
        args, kwargs: those of SB3's policy.
        mirrors: of the observation and of the action; if given, both networks are made symmetric.
        num_privileged: the last inputs, this many, are the privileged observation, which only the critic sees.
    """

    def __init__(
        self, *args: Any, mirrors: tuple[Mirror, Mirror] | None = None, num_privileged: int = 0, **kwargs: Any
    ):
        self._mirrors = mirrors
        self._num_privileged = num_privileged
        super().__init__(*args, **kwargs)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        # SB3 initialises the two networks as hidden layers. Their last layers get the gains of SB3's output layers.
        nn.init.orthogonal_(linear_modules(self.mlp_extractor.policy_net)[-1].weight, gain=0.01)
        nn.init.orthogonal_(linear_modules(self.mlp_extractor.value_net)[-1].weight, gain=1.0)
        # What SB3 puts behind the two networks has nothing to do.
        self.action_net = self.value_net = nn.Identity()  # type: ignore[assignment]
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)
        self.set_training_mode(False)  # as SB3 does before it collects; a critic has one value for an observation then

    def _build_mlp_extractor(self) -> None:
        assert isinstance(self.net_arch, dict)
        assert self.action_space.shape is not None
        num_actions = self.action_space.shape[0]
        num_observed = self.features_dim - self._num_privileged
        layers = self.net_arch["pi"], self.net_arch["vf"]
        networks = _TanhActorReluCritic(self.features_dim, num_observed, num_actions, *layers)
        if self._mirrors:
            for_observation, for_action = self._mirrors
            networks.policy_net = SymmetricNetwork(networks.policy_net, for_observation, for_action)
            for_critic = with_privileged(for_observation) if self._num_privileged else for_observation
            networks.value_net = SymmetricNetwork(networks.value_net, for_critic, None)
        self.mlp_extractor = networks  # type: ignore[assignment]


class _Observed(BaseFeaturesExtractor):
    """The first of the inputs, as many as there are features."""

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the observation."""
        return inputs[:, : self.features_dim]


class DeterministicPolicy(TD3Policy):
    """The paper's tanh actor for DDPG (squashed into the action's bounds, as SB3 needs it) and a ReLU critic.

    Args:
        args, kwargs: those of SB3's policy.
        num_privileged: the last inputs, this many, are the privileged observation, which only the critic sees.
    """

    def __init__(self, *args: Any, num_privileged: int = 0, **kwargs: Any):
        self._num_privileged = num_privileged
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: Any = None) -> Actor:
        """Return an actor that begins by holding the nominal pose, as SB3's Gaussian policies do."""
        (num_inputs,) = self.observation_space.shape or (0,)
        observed = _Observed(self.observation_space, num_inputs - self._num_privileged)
        arguments = self._update_features_extractor(self.actor_kwargs, features_extractor or observed)
        actor = Actor(**{**arguments, "activation_fn": nn.Tanh}).to(self.device)
        with torch.no_grad():
            output = linear_modules(actor.mu)[-1]
            output.weight *= 0.01
            output.bias.zero_()
        return actor


def with_privileged(mirror: Mirror) -> Mirror:
    """Return the mirror of an observation that is followed by the privileged observation."""
    source, sign = mirror
    return np.append(source, len(source) + np.arange(len(SIGNS))), np.append(sign, list(SIGNS.values()))


def tensors(mirror: Mirror) -> tuple[torch.Tensor, torch.Tensor]:
    """Return a mirror as tensors."""
    source, sign = mirror
    return torch.as_tensor(source), torch.as_tensor(sign, dtype=torch.float32)


def mlp(num_inputs: int, layers: Sequence[int], num_outputs: int, activation: type[nn.Module]) -> nn.Sequential:
    """Return a plain network with hidden layers of these sizes and a linear output."""
    sizes = [num_inputs, *layers]
    modules: list[nn.Module] = []
    for i, o in zip(sizes[:-1], sizes[1:], strict=True):
        modules += [nn.Linear(i, o), activation()]
    return nn.Sequential(*modules, nn.Linear(sizes[-1], num_outputs))


def linear_modules(network: nn.Module) -> list[nn.Linear]:
    """Return all linear layers of a network, in order."""
    return [module for module in network.modules() if isinstance(module, nn.Linear)]

"""Networks: the paper's actors and critics as stable-baselines3 has them, and an actor's layers for a policy file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.td3.policies import Actor, TD3Policy
from torch import nn

from surefoot.task.privileged import SIGNS

SIDE = 0.2
"""Deviation of what a new symmetric network prefers one side by: enough to begin with."""
Mirror = tuple[np.ndarray, np.ndarray]
"""(source, sign) of a mirrored vector, see `observation.mirror`."""


class _Symmetric(nn.Module):
    """A network made equal on both sides, but for a side that it prefers.

    (f(s, 1) + mirror(f(mirror(s), -1))) / 2, or of a scalar without the outer mirror. Without a preferred side a robot
    that stands evenly on both feet and is pushed straight ahead could not choose the foot to step with.

    Args:
        network: f of s alone.
        inward: mirror of the input.
        outward: mirror of the output; None for a scalar.

    Attributes:
        side: how f depends on its second argument: added to the first layer's output, or taken from it.
    """

    def __init__(self, network: nn.Module, inward: Mirror, outward: Mirror | None):
        super().__init__()
        self.network = network
        self.side = nn.Parameter(SIDE * torch.randn(_linear(network)[0].out_features))
        self.inward = tensors(inward)
        self.outward = tensors(outward) if outward else None

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        first, *others = self.network.children()
        source, sign = self.inward
        there, mirrored = first(inputs) + self.side, first(inputs[:, source] * sign) - self.side
        for module in others:
            there, mirrored = module(there), module(mirrored)
        if self.outward:
            source, sign = self.outward
            mirrored = mirrored[:, source] * sign
        return 0.5 * (there + mirrored)


class _TanhActorReluCritic(nn.Module):
    """SB3's "feature extractor": here the two whole networks, each with activations and an output of its own.

    Args:
        num_inputs: of the critic; the actor sees the first of them only, the observation.
        num_observed: of the actor.
    """

    def __init__(
        self, num_inputs: int, num_observed: int, num_actions: int, actor: Sequence[int], critic: Sequence[int]
    ):
        super().__init__()
        self.policy_net: nn.Module = _mlp(num_observed, actor, num_actions, nn.Tanh)
        self.value_net: nn.Module = _mlp(num_inputs, critic, 1, nn.ReLU)
        self.num_observed = num_observed
        self.latent_dim_pi, self.latent_dim_vf = num_actions, 1

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        return self.policy_net(features[:, : self.num_observed])

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        return self.value_net(features)


class GaussianPolicy(ActorCriticPolicy):
    """The paper's networks for TRPO and PPO: tanh actor, ReLU critic, linear outputs, a std of its own.

    Args:
        mirrors: of the observation and of the action; if given, both networks are made symmetric. The other
            arguments are those of SB3's policy.
        foreseen: the observation ends with so many numbers that only the critic sees: a push that it did not expect
            is noise on all that was done shortly before.
    """

    def __init__(self, *args: Any, mirrors: tuple[Mirror, Mirror] | None = None, foreseen: int = 0, **kwargs: Any):
        self._mirrors = mirrors
        self._foreseen = foreseen
        super().__init__(*args, **kwargs)

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
        num_observed = self.features_dim - self._foreseen
        layers = self.net_arch["pi"], self.net_arch["vf"]
        networks = _TanhActorReluCritic(self.features_dim, num_observed, num_actions, *layers)
        if self._mirrors:
            for_observation, for_action = self._mirrors
            networks.policy_net = _Symmetric(networks.policy_net, for_observation, for_action)
            for_critic = with_foreseen(for_observation) if self._foreseen else for_observation
            networks.value_net = _Symmetric(networks.value_net, for_critic, None)
        self.mlp_extractor = networks  # type: ignore[assignment]


class _Observed(BaseFeaturesExtractor):
    """The first of the inputs, as many as there are features."""

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        return inputs[:, : self.features_dim]


class DeterministicPolicy(TD3Policy):
    """The paper's tanh actor for DDPG (squashed into the action's bounds, as SB3 needs it) and a ReLU critic.

    Args:
        foreseen: the observation ends with so many numbers that only the critic sees; see `GaussianPolicy`.
    """

    def __init__(self, *args: Any, foreseen: int = 0, **kwargs: Any):
        self._foreseen = foreseen
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: Any = None) -> Actor:
        (num_inputs,) = self.observation_space.shape or (0,)
        observed = _Observed(self.observation_space, num_inputs - self._foreseen)
        arguments = self._update_features_extractor(self.actor_kwargs, features_extractor or observed)
        actor = Actor(**{**arguments, "activation_fn": nn.Tanh}).to(self.device)
        # Begin by holding the nominal pose, as SB3's Gaussian policies do, not with random postures.
        with torch.no_grad():
            output = _linear(actor.mu)[-1]
            output.weight *= 0.01
            output.bias.zero_()
        return actor


def with_foreseen(mirror: Mirror) -> Mirror:
    """The mirror of an observation, for one that is followed by what is foreseen."""
    source, sign = mirror
    return np.append(source, len(source) + np.arange(len(SIGNS))), np.append(sign, list(SIGNS.values()))


def tensors(mirror: Mirror) -> tuple[torch.Tensor, torch.Tensor]:
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


def with_foresight(parameters: Mapping[str, Any], model: BaseAlgorithm) -> dict[str, Any]:
    """What a model learned whose critic foresaw less, or nothing, for a model whose critic has not yet heeded the rest.

    Args:
        parameters: as SB3's `get_parameters` gives them.
        model: whose networks are to have them.
    """
    wanted = model.policy.state_dict()
    narrow = {
        tensor.shape: wanted[name].shape[1]
        for name, tensor in parameters["policy"].items()
        if tensor.shape != wanted[name].shape
    }
    (num_actions,) = model.action_space.shape or (0,)
    acted = num_actions if isinstance(model.policy, TD3Policy) else 0

    def widened(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: widened(item) for key, item in value.items()}
        if not isinstance(value, torch.Tensor) or value.shape not in narrow:
            return value
        known, last = value.split([value.shape[1] - acted, acted], dim=1)
        return torch.cat([known, torch.zeros(len(value), narrow[value.shape] - value.shape[1]), last], dim=1)

    return widened(parameters)


Layers = list[tuple[np.ndarray, np.ndarray]]


def actor_layers(model: BaseAlgorithm) -> Layers:
    """(weight, bias) of every linear layer of the deterministic policy, in order, as one plain network."""
    policy: Any = model.policy
    if isinstance(policy, TD3Policy):
        return _linear_layers(policy.actor.mu)
    network = policy.mlp_extractor.policy_net
    if not isinstance(network, _Symmetric):
        return _linear_layers(network)
    return _unfold(_linear_layers(network.network), network.side.detach().numpy(), *policy._mirrors)


def put_actor(model: BaseAlgorithm, layers: Layers, log_std: float) -> None:
    """Make a model's actor that of `layers`, as `actor_layers` gives them.

    Args:
        log_std: a Gaussian policy's logarithm of the deviation.
    """
    policy: Any = model.policy
    if isinstance(policy, TD3Policy):
        _put_layers(policy.actor.mu, layers)
        _put_layers(policy.actor_target.mu, layers)
        return
    with torch.no_grad():
        policy.log_std.fill_(log_std)
    network = policy.mlp_extractor.policy_net
    if not isinstance(network, _Symmetric):
        _put_layers(network, layers)
        return
    folded, preferred = _fold(layers)
    _put_layers(network.network, folded)
    with torch.no_grad():
        network.side.copy_(torch.from_numpy(preferred))


def _put_layers(network: nn.Module, layers: Layers) -> None:
    with torch.no_grad():
        for layer, (weight, bias) in zip(_linear(network), layers, strict=True):
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.copy_(torch.from_numpy(bias))


def _linear_layers(network: nn.Module) -> Layers:
    return [(layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy()) for layer in _linear(network)]


def _unfold(layers: Layers, preferred: np.ndarray, for_observation: Mirror, for_action: Mirror) -> Layers:
    """The symmetric network as a plain one of twice the width: f of s and of its mirror image next to each other, then
    their mean."""
    (first, first_bias), *inner, (last, last_bias) = layers
    source, sign = for_observation
    mirrored_first = np.empty_like(first)
    mirrored_first[:, source] = first * sign
    source, sign = for_action
    wide = [(np.concatenate([first, mirrored_first]), np.concatenate([first_bias + preferred, first_bias - preferred]))]
    for weight, bias in inner:
        nothing = np.zeros_like(weight)
        wide.append((np.block([[weight, nothing], [nothing, weight]]), np.tile(bias, 2)))
    mirrored_last, mirrored_bias = sign[:, None] * last[source], sign * last_bias[source]
    wide.append((0.5 * np.concatenate([last, mirrored_last], axis=1), 0.5 * (last_bias + mirrored_bias)))
    return wide


def _fold(layers: Layers) -> tuple[Layers, np.ndarray]:
    """The inverse of `_unfold`: f, and what it prefers one side by. The last bias is made symmetric, which changes
    nothing that the network gives."""
    (first, first_bias), *inner, (last, last_bias) = layers
    half = len(first) // 2
    there, mirrored = first_bias[:half], first_bias[half:]
    folded = [(first[:half], 0.5 * (there + mirrored))]
    for weight, bias in inner:
        half = len(weight) // 2
        folded.append((weight[:half, : weight.shape[1] // 2], bias[:half]))
    folded.append((2.0 * last[:, : last.shape[1] // 2], last_bias))
    return folded, 0.5 * (there - mirrored)

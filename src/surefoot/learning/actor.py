"""Actor: a model's policy network as plain layers for a policy file, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from surefoot.learning.networks import Mirror, SymmetricNetwork, linear_modules

Layers = list[tuple[np.ndarray, np.ndarray]]
"""(weight (out, in), bias (out,)) of every linear layer, in order."""


def actor_network(model: BaseAlgorithm) -> nn.Module:
    """Return the network of a model's deterministic policy, before DDPG's squashing."""
    policy: Any = model.policy
    return policy.actor.mu if isinstance(policy, TD3Policy) else policy.mlp_extractor.policy_net


def network_layers(network: nn.Module) -> Layers:
    """Return a network as one plain network; a symmetric one becomes two side by side, of twice the width."""
    if not isinstance(network, SymmetricNetwork):
        return _linear_layers(network)
    assert network.outward is not None
    mirrors = [(source.numpy(), sign.numpy().astype(float)) for source, sign in (network.inward, network.outward)]
    return _unfold(_linear_layers(network.network), network.side.detach().numpy(), *mirrors)


def put_layers(network: nn.Module, layers: Layers) -> None:
    """Make a network that of `layers`, as `network_layers` gives them."""
    preferred = None
    if isinstance(network, SymmetricNetwork):
        layers, preferred = _fold(layers)
    with torch.no_grad():
        for layer, (weight, bias) in zip(linear_modules(network), layers, strict=True):
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.copy_(torch.from_numpy(bias))
        if isinstance(network, SymmetricNetwork) and preferred is not None:
            network.side.copy_(torch.from_numpy(preferred))


def put_actor(model: BaseAlgorithm, network: nn.Module, log_std: float) -> None:
    """Give a model the weights of an actor, and a Gaussian policy a deviation.

    Args:
        model: model that receives the actor.
        network: of the same kind as `actor_network`.
        log_std: logarithm of the Gaussian policy's standard deviation.
    """
    policy: Any = model.policy
    weights = network.state_dict()
    actor_network(model).load_state_dict(weights)
    if isinstance(policy, TD3Policy):
        policy.actor_target.mu.load_state_dict(weights)
        return
    with torch.no_grad():
        policy.log_std.fill_(log_std)


def widen_critic(parameters: Mapping[str, Any], model: BaseAlgorithm) -> dict[str, Any]:
    """Return parameters whose critic has as many inputs as a model's; the new inputs have weights of zero.

    A critic that was learned without a privileged observation, or with a shorter one, can thus go on as one that is
    given all of it: it has the same values at first.

    Args:
        parameters: as `get_parameters` of stable-baselines3 gives them.
        model: model whose networks receive them.
    """
    wanted = model.policy.state_dict()
    narrow = {
        tensor.shape: wanted[name].shape[1]
        for name, tensor in parameters["policy"].items()
        if tensor.shape != wanted[name].shape
    }
    # DDPG's critic is given the action behind the observation.
    (num_actions,) = model.action_space.shape or (0,)
    num_last = num_actions if isinstance(model.policy, TD3Policy) else 0

    def widened(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: widened(item) for key, item in value.items()}
        if not isinstance(value, torch.Tensor) or value.shape not in narrow:
            return value
        known, last = torch.split(value, [value.shape[1] - num_last, num_last], dim=1)
        return torch.cat([known, torch.zeros(len(value), narrow[value.shape] - value.shape[1]), last], dim=1)

    return widened(parameters)


def _linear_layers(network: nn.Module) -> Layers:
    modules = linear_modules(network)
    return [(layer.weight.detach().numpy().copy(), layer.bias.detach().numpy().copy()) for layer in modules]


def _unfold(layers: Layers, preferred: np.ndarray, for_observation: Mirror, for_action: Mirror) -> Layers:
    """Return f of s and f of its mirror image next to each other, then their mean, as one plain network."""
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
    """Return the inverse of `_unfold`: f, and the preference for a side.

    The last bias stays symmetric, which changes nothing that the network gives.
    """
    (first, first_bias), *inner, (last, last_bias) = layers
    half = len(first) // 2
    there, mirrored = first_bias[:half], first_bias[half:]
    folded = [(first[:half], 0.5 * (there + mirrored))]
    for weight, bias in inner:
        half = len(weight) // 2
        folded.append((weight[:half, : weight.shape[1] // 2], bias[:half]))
    folded.append((2.0 * last[:, : last.shape[1] // 2], last_bias))
    return folded, 0.5 * (there - mirrored)

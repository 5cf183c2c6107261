"""Student: a network with a memory that learns to do as it is told, and the labels that it was told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.learning.actor import network_layers, put_layers
from surefoot.learning.networks import mlp
from surefoot.learning.sb3 import Normalisation
from surefoot.task.contract import Contract
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.memory import Memory


class Student:
    """A tanh network on what N robots observe and remember.

    Args:
        env: the robots.
        hidden: sizes of the hidden layers.
        past_observations, past_actions: what it remembers, see `Memory`.
        learning_rate: of Adam, at first.

    Attributes:
        normalise: what the network is given.
        memory: of the robots.
        network: normalised inputs to actions.
    """

    def __init__(
        self,
        env: PushRecoveryVectorEnv,
        hidden: Sequence[int],
        past_observations: int,
        past_actions: int,
        learning_rate: float,
    ):
        self.env = env
        self.normalise = Normalisation(env, past_observations, past_actions)
        (num_observed,) = env.single_observation_space.shape or (0,)
        self.memory = Memory(past_observations, past_actions, num_observed, env.robot.num_joints)
        self.memory.prepare(env.num_envs)
        self.network = mlp(len(self.normalise.mean), hidden, env.robot.num_joints, nn.Tanh)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=learning_rate, fused=True)
        self._past = {"past_observations": past_observations, "past_actions": past_actions}
        self._everyone = np.arange(env.num_envs)

    def inputs(self, observations: np.ndarray) -> np.ndarray:
        """Return what the network is given for all robots' observations (N, num_observations): (N, num_inputs)."""
        return self.normalise(self.memory.inputs(observations, self._everyone))

    def act(self, inputs: np.ndarray) -> np.ndarray:
        """Return actions (N, num_joints) in [-1, 1] for normalised inputs."""
        with torch.no_grad():
            return self.network(torch.from_numpy(inputs)).clamp(-1.0, 1.0).numpy()

    def remember(self, observations: np.ndarray, actions: np.ndarray) -> None:
        """Remember a policy step of all robots."""
        self.memory.add(observations, actions, self._everyone)

    def descend(self, batch: tuple[torch.Tensor, torch.Tensor, torch.Tensor], learning_rate: float) -> None:
        """Take a gradient step on a batch of inputs, labels and weights."""
        inputs, labels, weights = batch
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        error = (self.network(inputs) - labels).square().mean(dim=1)
        self.optimizer.zero_grad()
        (weights * error).mean().backward()
        self.optimizer.step()

    def policy_bytes(self, record: dict[str, Any]) -> bytes:
        """Return the student as a policy file with this training record."""
        config = self.env.config
        contract = Contract.of(self.env.robot, config.pose, config.action_scale, record, **self._past)
        return network_bytes(network_layers(self.network), self.normalise.mean, self.normalise.std, False, contract)

    def take_policy(self, policy: NetworkAgent) -> None:
        """Go on with the network of a policy with the same memory and layers."""
        put_layers(self.network, policy.layers(self.normalise.mean, self.normalise.std))

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return what a checkpoint needs."""
        return {"network": dict(self.network.state_dict()), "optimizer": self.optimizer.state_dict()}

    def restore(self, parameters: Mapping[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.network.load_state_dict(parameters["network"])
        self.optimizer.load_state_dict(parameters["optimizer"])


class LabelBuffer:
    """The newest labels.

    Args:
        size: how many are kept.
        num_inputs, num_actions: of the network.
    """

    def __init__(self, size: int, num_inputs: int, num_actions: int):
        self._tensors = torch.zeros(size, num_inputs), torch.zeros(size, num_actions), torch.zeros(size)
        self._size, self._next, self._filled = size, 0, 0

    def add(self, inputs: np.ndarray, labels: np.ndarray, weights: np.ndarray) -> None:
        """Keep inputs (n, num_inputs), labels (n, num_actions) and their weights (n,)."""
        places = torch.from_numpy((self._next + np.arange(len(inputs))) % self._size)
        for kept, new in zip(self._tensors, (inputs, labels, weights), strict=True):
            kept[places] = torch.from_numpy(np.asarray(new, np.float32))
        self._next = (self._next + len(inputs)) % self._size
        self._filled = min(self._size, self._filled + len(inputs))

    def draw(self, number: int, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return inputs, labels and weights of so many of them, drawn with replacement."""
        rows = torch.from_numpy(rng.integers(self._filled, size=number))
        inputs, labels, weights = (kept[rows] for kept in self._tensors)
        return inputs, labels, weights

"""Student: a network with a memory that learns to imitate labels, and the buffer of these labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import nn

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.errors import UserError
from surefoot.learning.actor import network_layers, put_layers
from surefoot.learning.mixture import MixtureNetwork
from surefoot.learning.networks import mlp
from surefoot.learning.sb3 import Normalisation
from surefoot.task.contract import Contract
from surefoot.task.environment import PushRecoveryVectorEnv
from surefoot.task.memory import Memory

GATE_WEIGHT = 0.05
"""Of the surprise of a mixture's gate [nats], beside squared errors."""


class Student:
    """A tanh network on what N robots observe and remember.

    Args:
        env: the robots.
        hidden: sizes of the hidden layers.
        past_observations, past_actions: what it remembers, see `Memory`.
        learning_rate: of Adam, at first.

    Attributes:
        normalise: what the network is given.
        num_observed: components of an observation.
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
        (self.num_observed,) = env.single_observation_space.shape or (0,)
        self.memory = Memory(past_observations, past_actions, self.num_observed, env.robot.num_joints)
        self.memory.prepare(env.num_envs)
        self.network = self.new_network(hidden)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=learning_rate, fused=True)
        self._past = {"past_observations": past_observations, "past_actions": past_actions}
        self._everyone = np.arange(env.num_envs)

    @property
    def num_targets(self) -> int:
        """How many numbers it is to tell of each robot, see `targets`."""
        return self.env.robot.num_joints

    def new_network(self, hidden: Sequence[int]) -> nn.Module:
        """Return a network that has learned nothing."""
        return mlp(len(self.normalise.mean), hidden, self.env.robot.num_joints, nn.Tanh)

    def layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the network as a chain of linear layers with tanh between them."""
        return network_layers(self.network)

    def targets(self, labels: np.ndarray, levels: np.ndarray, clear: np.ndarray) -> np.ndarray:
        """Return what it is to tell of N robots.

        Args:
            labels: what their teachers would do (N, num_joints).
            levels: indices of these teachers (N,).
            clear: their observations without noise (N, num_observations).

        Returns:
            (N, num_targets); here the labels.
        """
        return labels

    def error(self, inputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return how far it is from its targets (n, num_targets): (n,)."""
        return (self.network(inputs) - targets).square().mean(dim=1)

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
        """Take a gradient step on a batch of inputs, targets and weights."""
        inputs, targets, weights = batch
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate
        loss = (weights * self.error(inputs, targets)).mean()
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()

    def policy_bytes(self, record: dict[str, Any]) -> bytes:
        """Return the student as a policy file with this training record."""
        config = self.env.config
        contract = Contract.of(self.env.robot, config.pose, config.action_scale, record, **self._past)
        return network_bytes(self.layers(), self.normalise.mean, self.normalise.std, False, contract)

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


class MixtureStudent(Student):
    """A student with all teachers inside: it learns what its sensors hide, and which teacher fits.

    Args:
        env, hidden, past_observations, past_actions, learning_rate: as of a `Student`; the layers are the trunk's.
        teachers: two or more.

    Raises:
        UserError: there are too few teachers, or a network cannot be taken in.
    """

    network: MixtureNetwork

    def __init__(
        self,
        env: PushRecoveryVectorEnv,
        hidden: Sequence[int],
        past_observations: int,
        past_actions: int,
        learning_rate: float,
        teachers: Sequence[NetworkAgent],
    ):
        if len(teachers) < 2 or len(hidden) != 2:
            raise UserError(
                f"a mixture has 2 or more teachers and 2 hidden layers, not {len(teachers)} and {len(hidden)}"
            )
        self._teachers = teachers
        self._gated = np.array([0, *range(2, len(teachers))])
        super().__init__(env, hidden, past_observations, past_actions, learning_rate)

    @property
    def num_targets(self) -> int:
        """The labels, the clear observation, and which teacher gave them."""
        return self.env.robot.num_joints + self.num_observed + len(self._gated)

    def new_network(self, hidden: Sequence[int]) -> nn.Module:
        """Return a mixture that hears the second teacher only, and believes its sensors."""
        teachers = [self._taken_in(teacher) for teacher in self._teachers]
        return MixtureNetwork(len(self.normalise.mean), self.num_observed, hidden, teachers)

    def layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the network as a chain of linear layers with tanh between them."""
        return self.network.layers()

    def targets(self, labels: np.ndarray, levels: np.ndarray, clear: np.ndarray) -> np.ndarray:
        """Return labels, normalised clear observation, and for each gate whether its teacher gave the label."""
        observed = slice(self.num_observed)
        normalised = (clear - self.normalise.mean[observed]) / self.normalise.std[observed]
        return np.column_stack([labels, normalised, levels[:, None] == self._gated])

    def error(self, inputs: torch.Tensor, targets: torch.Tensor) -> torch.Tensor:
        """Return the squared errors of actions and clear observation, and how surprised the gates are: (n,)."""
        actions, clear, logits = self.network.parts(inputs)
        sizes = [actions.shape[1], clear.shape[1], logits.shape[1]]
        labels, truth, gates = torch.split(targets, sizes, dim=1)
        surprise = nn.functional.binary_cross_entropy_with_logits(logits, gates, reduction="none").sum(dim=1)
        action_error = (actions.clamp(-1.0, 1.0) - labels).square().mean(dim=1)
        return action_error + (clear - truth).square().mean(dim=1) + GATE_WEIGHT * surprise

    def take_policy(self, policy: NetworkAgent) -> None:
        """Go on with the trunk of a mixture with the same sizes and as many teachers, which may be others.

        Raises:
            UserError: the policy is no such mixture.
        """
        try:
            if policy.contract.num_inputs != len(self.normalise.mean):
                raise ValueError("it has another number of inputs")
            self.network.put_trunk(policy.layers(self.normalise.mean, self.normalise.std))
        except ValueError as error:
            raise UserError(f"a mixture cannot go on with {policy.name}: {error}") from error

    def _taken_in(self, teacher: NetworkAgent) -> list[tuple[np.ndarray, np.ndarray]]:
        """A teacher's layers on the normalised observation, in the student's actions."""
        contract, config = teacher.contract, self.env.config
        if contract.action_scale < config.action_scale:
            raise UserError(
                f"the teacher {teacher.name} has the action scale {contract.action_scale}, less than the mixture's "
                f"{config.action_scale}"
            )
        observed = slice(self.num_observed)
        layers = teacher.layers(self.normalise.mean[observed], self.normalise.std[observed])
        if teacher.squash:  # its last tanh becomes one more layer
            layers.append((np.eye(self.env.robot.num_joints), np.zeros(self.env.robot.num_joints)))
        *hidden, (weight, bias) = layers
        scale = contract.action_scale / config.action_scale
        shift = (np.array(contract.nominal_pose) - self.env.loop.nominal) / config.action_scale
        return [*hidden, (scale * weight, scale * bias + shift)]


class LabelBuffer:
    """The newest labels.

    Args:
        size: how many are kept.
        num_inputs, num_targets: of the student.
    """

    def __init__(self, size: int, num_inputs: int, num_targets: int):
        self._tensors = torch.zeros(size, num_inputs), torch.zeros(size, num_targets), torch.zeros(size)
        self._size, self._next, self._filled = size, 0, 0

    def add(self, inputs: np.ndarray, targets: np.ndarray, weights: np.ndarray) -> None:
        """Keep inputs (n, num_inputs), targets (n, num_targets) and their weights (n,)."""
        places = torch.from_numpy((self._next + np.arange(len(inputs))) % self._size)
        for kept, new in zip(self._tensors, (inputs, targets, weights), strict=True):
            kept[places] = torch.from_numpy(np.asarray(new, np.float32))
        self._next = (self._next + len(inputs)) % self._size
        self._filled = min(self._size, self._filled + len(inputs))

    def draw(self, number: int, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return inputs, targets and weights of so many of them, drawn with replacement."""
        rows = torch.from_numpy(rng.integers(self._filled, size=number))
        inputs, targets, weights = (kept[rows] for kept in self._tensors)
        return inputs, targets, weights

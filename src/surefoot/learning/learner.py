"""Learner: an algorithm with its robots and the average of its actor, without clock or files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from surefoot.agents.network import NetworkAgent
from surefoot.agents.policy_file import network_bytes
from surefoot.cores import num_cores
from surefoot.learning.actor import actor_network, network_layers, put_actor, put_layers, widen_critic
from surefoot.learning.average import AveragedActor
from surefoot.learning.config import TrainConfig
from surefoot.learning.models import limit_exploration, make_model
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.takeover import make_env
from surefoot.task.contract import Contract


class Learner:
    """All that learns in a run.

    Args:
        config: of the run.
        learning_rate: called before every update, with a number that is of no use here.

    Attributes:
        env, venv: the robots, and the same as stable-baselines3 wants them.
        rng: of the exploration.
        model: algorithm and networks.
        average: of the actor.
    """

    def __init__(self, config: TrainConfig, learning_rate: Callable[[float], float]):
        self.config = config
        # DDPG's gradients need a core of their own while the robots move.
        num_threads = max(1, num_cores() - 1) if config.algorithm == "ddpg" else 0
        self.env = make_env(config, num_threads)
        self.venv = SB3VecEnv(self.env, config.privileged_critic, config.past_observations, config.past_actions)
        self.rng = np.random.default_rng(config.seed)
        self.model = make_model(config, self.venv, self.rng, learning_rate)
        self.average = AveragedActor(actor_network(self.model), config.average_steps)

    @property
    def num_steps(self) -> int:
        """Policy steps so far, those of a run that this one began with included."""
        return self.model.num_timesteps

    def advance(self, exploration_share: float, hold_actor: bool) -> None:
        """Do what is due between two rollouts.

        Args:
            exploration_share: what is left of the exploration.
            hold_actor: take the actor back to the averaged one: only the critic learns.
        """
        if hold_actor:
            put_actor(self.model, self.average.averaged, self.config.log_std)
        limit_exploration(self.model, self.config.log_std, exploration_share)
        if self.config.average_steps:
            self.average.update(self.num_steps)

    def policy_bytes(self, record: dict[str, Any]) -> bytes:
        """Return the deterministic policy as a policy file with this training record."""
        config, env = self.config, self.config.env
        past = config.past_observations, config.past_actions
        contract = Contract.of(self.env.robot, env.pose, env.action_scale, record, *past)
        normalise = self.venv.normalise
        squash = isinstance(self.model, OffPolicyAlgorithm)
        return network_bytes(network_layers(self.average.kept), normalise.mean, normalise.std, squash, contract)

    def take_networks(self, parameters: dict[str, dict[str, Any]], state: dict[str, Any]) -> None:
        """Go on with the networks and the average of a checkpoint, see `state`."""
        if self.config.privileged_critic:
            parameters = widen_critic(parameters, self.model)
        self.model.set_parameters(parameters)  # type: ignore[arg-type]
        self._count_from(state["steps"])
        if "averaged_actor" in state:
            self.average.restore(state["averaged_actor"], state["steps"])
        else:  # a checkpoint of version 0.1
            layers = [(weight, bias) for weight, bias in state["average"]]
            put_layers(self.average.averaged, layers)

    def take_policy(self, policy: NetworkAgent, num_steps: int) -> None:
        """Go on with the actor of a policy that was learned for `num_steps` policy steps; the critic stays new."""
        layers = policy.layers(self.venv.normalise.mean, self.venv.normalise.std)
        put_layers(actor_network(self.model), layers)
        put_actor(self.model, actor_network(self.model), self.config.log_std)
        self._count_from(num_steps)

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint needs beside the networks' parameters."""
        return {
            "steps": self.num_steps,
            "noise_generator": self.rng.bit_generator.state,
            "env_generator": self.env.generator.bit_generator.state,
            "torch_generator": torch.get_rng_state(),
            "averaged_actor": dict(self.average.state()),
        }

    def restore(self, parameters: dict[str, dict[str, Any]], state: dict[str, Any]) -> None:
        """Go on from a checkpoint of this run; its robots start anew."""
        self.take_networks(parameters, state)
        self.rng.bit_generator.state = state["noise_generator"]
        self.venv.seed(None)
        self.env.reset(seed=self.config.seed)
        self.env.generator.bit_generator.state = state["env_generator"]
        torch.set_rng_state(state["torch_generator"])

    def _count_from(self, num_steps: int) -> None:
        self.model.num_timesteps = num_steps
        self.average.restart(num_steps)
        if isinstance(self.model, OffPolicyAlgorithm):  # its replay buffer was not kept and is filled anew first
            self.model.learning_starts += num_steps

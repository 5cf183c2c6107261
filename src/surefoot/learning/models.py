"""Models: each algorithm on its environment, and how much it may explore."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from sb3_contrib import TRPO
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

from surefoot.learning.config import TrainConfig
from surefoot.learning.ddpg import BatchDDPG, ExplorationNoise, MirroredReplayBuffer
from surefoot.learning.networks import DeterministicPolicy, GaussianPolicy, with_foreseen
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.task import observation
from surefoot.task.privileged import SIGNS

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"trpo": TRPO, "ppo": PPO, "ddpg": BatchDDPG}


def make_model(
    config: TrainConfig, venv: SB3VecEnv, rng: np.random.Generator, learning_rate: Callable[[float], float] | float
) -> BaseAlgorithm:
    """The algorithm on its environment, networks new."""
    hyper = {**config.hyper, "learning_rate": learning_rate}
    common: dict[str, Any] = {"seed": config.seed, "device": "cpu"}
    robot = venv.env.robot
    for_observation, for_action = observation.mirror(robot), (robot.mirror_source, robot.mirror_sign)
    foreseen = {"foreseen": len(SIGNS) if config.foresight else 0}
    if config.algorithm == "ddpg":
        torch.set_num_threads(1)  # the other cores move the robots meanwhile
        networks: dict[str, Any] = {"net_arch": {"pi": list(config.actor), "qf": list(config.critic)}, **foreseen}
        networks["optimizer_kwargs"] = {"fused": True}  # these networks are small: a loop over their weights costs more
        if config.mirror:
            hyper["replay_buffer_class"] = MirroredReplayBuffer
            for_critic = with_foreseen(for_observation) if config.foresight else for_observation
            n_step_return = {"n_steps": hyper.pop("n_steps", 1), "gamma": hyper["gamma"]}
            hyper["replay_buffer_kwargs"] = {"mirrors": (for_critic, for_action), **n_step_return}
        hyper["action_noise"] = ExplorationNoise(
            (config.num_envs, robot.num_joints), config.noise, config.noise_correlation, rng
        )
        return ALGORITHMS["ddpg"](DeterministicPolicy, venv, policy_kwargs=networks, **hyper, **common)
    networks = {"net_arch": {"pi": list(config.actor), "vf": list(config.critic)}, **foreseen}
    networks |= {"log_std_init": config.log_std, "mirrors": (for_observation, for_action) if config.mirror else None}
    return ALGORITHMS[config.algorithm](GaussianPolicy, venv, policy_kwargs=networks, **hyper, **common)


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

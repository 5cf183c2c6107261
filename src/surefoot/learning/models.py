"""Models: the algorithms of stable-baselines3 on their environments, and the amount of their exploration."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from sb3_contrib import TRPO
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

from surefoot.errors import UserError
from surefoot.learning.config import TrainConfig
from surefoot.learning.ddpg import BatchDDPG, ExplorationNoise, MirroredReplayBuffer
from surefoot.learning.networks import DeterministicPolicy, GaussianPolicy, with_privileged
from surefoot.learning.sb3 import SB3VecEnv
from surefoot.learning.takeover import OwnActionsBuffer, TakeoverVectorEnv
from surefoot.task.privileged import SIGNS

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"trpo": TRPO, "ppo": PPO, "ddpg": BatchDDPG}


def make_model(
    config: TrainConfig, venv: SB3VecEnv, rng: np.random.Generator, learning_rate: Callable[[float], float] | float
) -> BaseAlgorithm:
    """Return the algorithm on its environment, with new networks.

    Args:
        config: of the run.
        venv: the robots.
        rng: of DDPG's exploration.
        learning_rate: a number, or what stable-baselines3 calls before every update.

    Raises:
        UserError: the algorithm does not have an argument of `hyper`, or does not take its value.
    """
    torch.set_num_threads(1)  # sums depend on their number; and with DDPG the other cores move the robots meanwhile
    make = _off_policy if config.algorithm == "ddpg" else _on_policy
    hyper = {**config.hyper, "learning_rate": learning_rate, "seed": config.seed, "device": "cpu"}
    networks = {"num_privileged": len(SIGNS) if config.privileged_critic else 0}
    try:
        return make(config, venv, rng, hyper, networks)
    except (TypeError, ValueError, AssertionError, MemoryError) as error:
        raise UserError(f"{config.algorithm} cannot be made with the arguments of hyper: {error}") from error


def _on_policy(
    config: TrainConfig, venv: SB3VecEnv, rng: np.random.Generator, hyper: dict[str, Any], networks: dict[str, Any]
) -> BaseAlgorithm:
    networks |= {
        "net_arch": {"pi": list(config.actor), "vf": list(config.critic)},
        "log_std_init": config.log_std,
        "mirrors": venv.normalise.mirrors if config.mirror else None,
    }
    if isinstance(venv.env, TakeoverVectorEnv):
        hyper |= {"rollout_buffer_class": OwnActionsBuffer, "rollout_buffer_kwargs": {"env": venv.env}}
    return ALGORITHMS[config.algorithm](GaussianPolicy, venv, policy_kwargs=networks, **hyper)


def _off_policy(
    config: TrainConfig, venv: SB3VecEnv, rng: np.random.Generator, hyper: dict[str, Any], networks: dict[str, Any]
) -> BaseAlgorithm:
    networks |= {
        "net_arch": {"pi": list(config.actor), "qf": list(config.critic)},
        "optimizer_kwargs": {"fused": True},  # these networks are small: a loop over their weights costs more
    }
    if config.mirror:
        for_observation, for_action = venv.normalise.mirrors
        for_critic = with_privileged(for_observation) if config.privileged_critic else for_observation
        n_step_return = {"n_steps": hyper.pop("n_steps", 1), "gamma": hyper["gamma"]}
        hyper["replay_buffer_class"] = MirroredReplayBuffer
        hyper["replay_buffer_kwargs"] = {"mirrors": (for_critic, for_action), **n_step_return}
    shape = config.num_envs, venv.env.robot.num_joints
    hyper["action_noise"] = ExplorationNoise(shape, config.noise, config.noise_correlation, rng)
    return ALGORITHMS["ddpg"](DeterministicPolicy, venv, policy_kwargs=networks, **hyper)


def limit_exploration(model: BaseAlgorithm, log_std: float, share: float) -> None:
    """Leave a share of the exploration: of DDPG's noise, or of the largest deviation that a Gaussian policy may have.

    Args:
        model: that explores.
        share: that is left.
        log_std: logarithm of the Gaussian policy's initial deviation.
    """
    noise = getattr(model, "action_noise", None)
    if isinstance(noise, ExplorationNoise):
        noise.scale = share
    elif isinstance(model.policy, GaussianPolicy) and share < 1.0:
        with torch.no_grad():
            model.policy.log_std.clamp_(max=log_std + float(np.log(share)))

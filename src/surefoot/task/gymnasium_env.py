"""One robot as an ordinary gymnasium environment: ``gymnasium.make("surefoot/PushRecovery-v0")``."""

from __future__ import annotations

import importlib.resources
import tomllib
from typing import Any

import gymnasium as gym
import numpy as np

from surefoot.rates import POLICY_HZ
from surefoot.task.environment import EnvConfig, PushRecoveryVectorEnv

ENV_ID = "surefoot/PushRecovery-v0"
DEFAULT_PRESET, DEFAULT_ALGORITHM = "fast", "ddpg"
"""The preset whose task is the default: the task that the shipped policies began with."""


def register() -> None:
    """Make the environment known to gymnasium; its entry point calls this."""
    if ENV_ID not in gym.registry:
        gym.register(ENV_ID, entry_point=f"{__name__}:PushRecoveryEnv")


def default_config() -> EnvConfig:
    """Return the task of the preset `fast`, with which a policy is learned in minutes."""
    preset = importlib.resources.files("surefoot") / "learning" / "presets" / f"{DEFAULT_PRESET}.toml"
    return EnvConfig.from_values(tomllib.loads(preset.read_text())[DEFAULT_ALGORITHM]["env"])


class PushRecoveryEnv(gym.Env[np.ndarray, np.ndarray]):
    """A batch of one robot: see `PushRecoveryVectorEnv` for observation, action and ends of episodes.

    Args:
        config: the task; without it, that of the preset `fast`.
        render_mode: None; the environment draws nothing.
    """

    metadata = {"render_modes": [], "render_fps": POLICY_HZ}

    def __init__(self, config: EnvConfig | None = None, render_mode: None = None):
        self.batch = PushRecoveryVectorEnv(1, config or default_config(), num_threads=1)
        self.observation_space = self.batch.single_observation_space
        self.action_space = self.batch.single_action_space
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode; the same seed gives the same bits."""
        super().reset(seed=seed)
        observations, info = self.batch.reset(seed=seed, options=options)
        return observations[0], info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one policy step; after an end the caller resets, as gymnasium has it."""
        observations, rewards, terminated, truncated, info = self.batch.step(np.asarray(action)[None])
        last = info.get("final_obs", observations)
        return last[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), dict(self.batch.reward_means)


register()

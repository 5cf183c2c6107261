"""One robot as an ordinary gymnasium environment: ``gymnasium.make("surefoot/PushRecovery-v0")``."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from surefoot.environments.batch import PushRecoveryBatch, RenderMode
from surefoot.rates import POLICY_HZ
from surefoot.task.agent import as_numbers
from surefoot.task.environment import EnvConfig


class PushRecoveryEnv(gym.Env[np.ndarray, np.ndarray]):
    """One robot that is pushed and must not fall.

    Observation: (47,) float32 for Valkyrie, filtered (`surefoot.task.observation.component_names` names its
    components). Action: (11,) in [-1, 1], joint targets as the nominal pose plus `action_scale` times the action.
    An episode terminates when anything but a foot touches the ground, and is truncated at `EnvConfig.episode_s`.
    The info of a step holds the mean of every term of the reward, by the term's name.

    Args:
        config: the task. The default is that of the preset `fast`.
        robot: a shipped robot's name or the path of a description; the task is scaled to it.
        render_mode: "rgb_array" for pictures, None for none.
        width: width of the pictures [pixels].
        height: height of the pictures [pixels].

    Raises:
        UserError: there is no such robot or render mode.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": POLICY_HZ}

    def __init__(
        self,
        config: EnvConfig | None = None,
        robot: str | None = None,
        render_mode: RenderMode | None = None,
        width: int = 640,
        height: int = 480,
    ):
        self.batch = PushRecoveryBatch(
            1, config, robot, render_mode, AutoresetMode.DISABLED, width, height, num_threads=1
        )
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
        """Advance by one policy step of 40 ms; after an end the caller resets, as usual in gymnasium."""
        observations, rewards, terminated, truncated, _ = self.batch.step(as_numbers(action)[None])
        means = dict(self.batch.reward_means)
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), means

    def render(self) -> np.ndarray | None:
        """Draw the robot with its push, CoM, capture point and foot forces: uint8 (height, width, 3)."""
        pictures = self.batch.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Free the picture's OpenGL context."""
        self.batch.close()
